//! Cost of each effect: the time of a frame with it minus that of the same frame without it, on every backend.
//!
//! In: a list of effects, each a change of a quiet detector or of a plain instrument. Out: `effects.csv`. Frames with
//! and without alternate, so that other load on the machine affects both; medians. An effect that is off takes no time,
//! because none of its code runs: "without" means a camera that does not name it.

use super::error;
use crate::chart::drawer::Drawer;
use crate::chart::effect_cases::{DETECTOR, DRAWING, DrawingSwitch, Switch};
use crate::chart::scenes::{Movement, Psf, Scene, Stars};
use crate::chart::stage::{EXPOSURE_S, Stage};
use base::image::{DnImage, Image};
use base::{clock::Stopwatch, least_squares::median, refused::Refused};
use image::detector::{Background, Detector, DetectorConditions, DetectorParams};
use image::{detector::gpu::GpuDetector, render::gpu::Gpu};
use plan::exposure::MethodChoice;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// One effect on one backend.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectRow {
    /// `cpu` or `gpu`.
    pub backend: String,
    /// `drawing` or `detector`.
    pub part: String,
    /// The effect.
    pub effect: String,
    /// A frame of this part without it, ms.
    pub without_ms: f64,
    /// Time of a frame with it, ms.
    pub with_ms: f64,
    /// The difference, ms.
    pub cost_ms: f64,
}

/// Light in every pixel, e-.
const LIGHT_E: f32 = 20.0;
/// Largest number of turns.
const MOST_TURNS: usize = 41;

/// Returns the scene of the drawing cases; the detector's are of the same size.
fn scene(quick: bool) -> Scene {
    Scene {
        name: "effects",
        title: "stars at rest",
        size_px: if quick { 256 } else { 1024 },
        psf: Psf::Gaussian(0.8),
        line_s: 0.0,
        motion: Movement::Still,
        stars: Stars::Field(if quick { 200 } else { 2000 }),
        is_charted: false,
        note: "",
    }
}

/// Measures every effect on every backend.
///
/// # Errors
/// When a backend fails.
pub fn measure(quick: bool, drawers: &mut [Drawer]) -> Result<Vec<EffectRow>, Refused> {
    let (scene, turns) = (scene(quick), if quick { 3 } else { MOST_TURNS });
    let stage = Stage::new(&scene, 1).map_err(error::camera)?;
    let mut rows = Vec::new();
    for drawer in drawers {
        for (effect, switch) in DRAWING {
            let ms = drawing(&stage, switch, drawer, turns).map_err(|error| failed(effect, &error))?;
            rows.push(row(drawer, "drawing", effect, ms));
        }
        for (effect, switch) in DETECTOR {
            let ms = detector(scene.size_px, switch, drawer, turns).map_err(|error| failed(effect, &error))?;
            rows.push(row(drawer, "detector", effect, ms));
        }
    }
    Ok(rows)
}

/// Returns the time of planning and drawing without and with an effect, ms.
fn drawing(stage: &Stage, switch: DrawingSwitch, drawer: &mut Drawer, turns: usize) -> Result<[f64; 2], Refused> {
    let mut with = stage.clone();
    if let DrawingSwitch::Instrument(switch) = switch {
        switch(&mut with.instrument);
    }
    let mut planners = [stage, &with].map(|stage| stage.planner(drawer.cost(), MethodChoice::Auto));
    if let DrawingSwitch::Planner(switch) = switch {
        switch(&mut planners[1]);
    }
    by_turns(turns, |i| drawer.draw(planners[i].plan(&stage.sources)))
}

/// Returns the time of readout without and with an effect, ms.
fn detector(size_px: usize, switch: Switch, drawer: &Drawer, turns: usize) -> Result<[f64; 2], Refused> {
    let mut params = DetectorParams::QUIET;
    if let Switch::Params(switch) = switch {
        switch(&mut params);
    }
    let mut readouts = [Readout::new(DetectorParams::QUIET, size_px, drawer)?, Readout::new(params, size_px, drawer)?];
    if let Switch::Background(background, is_uneven) = switch {
        readouts[1].light_up(background, is_uneven.then_some(size_px))?;
    }
    by_turns(turns, |i| readouts[i].collect())
}

fn failed(effect: &'static str, error: &dyn core::fmt::Display) -> Refused {
    Refused(format!("effect \"{effect}\": {error}"))
}

fn row(drawer: &Drawer, part: &str, effect: &str, [without_ms, with_ms]: [f64; 2]) -> EffectRow {
    let backend = drawer.name().into();
    let cost_ms = with_ms - without_ms;
    EffectRow { backend, part: part.into(), effect: effect.into(), without_ms, with_ms, cost_ms }
}

/// Returns the medians of two alternating measurements, ms, after one warm-up turn.
fn by_turns<E>(turns: usize, mut frame: impl FnMut(usize) -> Result<(), E>) -> Result<[f64; 2], E> {
    let mut taken_ms = [const { Vec::new() }; 2];
    let mut watch = Stopwatch::start();
    for turn in 0..=turns {
        for (i, taken_ms) in taken_ms.iter_mut().enumerate() {
            watch.lap();
            frame(i)?;
            let ms = watch.lap().ms();
            if turn > 0 {
                taken_ms.push(ms);
            }
        }
    }
    Ok(taken_ms.map(|mut times| median(&mut times)))
}

/// A detector in front of the same light.
struct Readout {
    detector: OnBackend,
    conditions: DetectorConditions,
    out: DnImage,
    frame: u32,
}

enum OnBackend {
    Cpu { detector: Box<Detector>, light: Image<f32> },
    Gpu { detector: Box<GpuDetector>, light: Box<Gpu> },
}

impl Readout {
    fn new(params: DetectorParams, size_px: usize, drawer: &Drawer) -> Result<Self, Refused> {
        let detector = Detector::new(params, size_px, size_px, 1);
        let [width, height] = params.spatial.output([size_px; 2]).size_px;
        let out = DnImage::new(width, height);
        let detector = match drawer {
            Drawer::Cpu { .. } => {
                let mut light = Image::new(size_px, size_px);
                light.pixels_mut().fill(LIGHT_E);
                OnBackend::Cpu { detector: Box::new(detector), light }
            }
            Drawer::Gpu { device, .. } => {
                let on_device = GpuDetector::new(Arc::clone(device), &detector, size_px, size_px)?;
                let light = Box::new(Gpu::new(Arc::clone(device), size_px, size_px)?);
                OnBackend::Gpu { detector: Box::new(on_device), light }
            }
        };
        let mut made = Self { detector, conditions: DetectorConditions::dark(EXPOSURE_S), out, frame: 0 };
        made.light_up(Background::DARK, None)?;
        Ok(made)
    }

    /// Lights the detector; unevenly if a size is given.
    fn light_up(&mut self, background: Background, uneven_px: Option<usize>) -> Result<(), Refused> {
        let map = uneven_px.map(|side| vec![0.9_f32; side * side]);
        match &mut self.detector {
            OnBackend::Cpu { detector, .. } => {
                self.conditions.background = background;
                detector.set_illumination_map(map);
            }
            OnBackend::Gpu { detector, .. } => {
                // Nothing is drawn: the light is added as stray light.
                self.conditions.background = background.and_uniform(LIGHT_E);
                detector.set_illumination_map(map.as_deref())?;
            }
        }
        Ok(())
    }

    fn collect(&mut self) -> Result<(), Refused> {
        self.frame += 1;
        match &mut self.detector {
            OnBackend::Cpu { detector, light } => {
                detector.collect(light, self.frame, &self.conditions, &mut self.out);
                Ok(())
            }
            OnBackend::Gpu { detector, light } => {
                Ok(detector.collect(light.device_electrons(), self.frame, &self.conditions, &mut self.out)?)
            }
        }
    }
}

/// Returns the table for a terminal.
pub fn summary(rows: &[EffectRow]) -> String {
    let mut text = format!(
        "\n{:<32} {:<9} {:<4} {:>12} {:>10} {:>10}\n",
        "effect", "part", "", "without ms", "with ms", "costs ms"
    );
    for row in rows {
        text += &format!(
            "{:<32} {:<9} {:<4} {:>12.3} {:>10.3} {:>+10.3}\n",
            row.effect, row.part, row.backend, row.without_ms, row.with_ms, row.cost_ms
        );
    }
    text
}
