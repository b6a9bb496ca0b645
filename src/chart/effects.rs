//! What each effect costs: a frame with it, less the same frame without it, on every backend.
//!
//! In: a list of effects, each a change of a quiet detector or of a plain instrument. Out: `effects.csv`. Frames with and without
//! take turns, so that what else the machine does falls on both; medians. An effect that is off takes no time, as nothing of
//! it runs: what is "without" here is a camera that does not name it.

use crate::base::clock::Stopwatch;
use crate::base::image::{DnImage, Image};
use crate::chart::ChartError;
use crate::chart::drawer::Drawer;
use crate::chart::scenes::{Movement, Psf, Scene, Stars};
use crate::chart::stage::{EXPOSURE_S, Stage};
use crate::chart::timing::median;
use crate::detector::gpu::GpuDetector;
use crate::detector::{Detector, DetectorParams};
use crate::exposure::{ExposurePlan, Instrument, MethodChoice};
use crate::render::RenderError;
use crate::render::gpu::Gpu;
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
    /// With it, ms.
    pub with_ms: f64,
    /// The difference, ms.
    pub cost_ms: f64,
}

/// An effect of the detector: its name, and what switches it on.
pub type DetectorCase = (&'static str, fn(&mut DetectorParams));
/// An effect of the optics: its name, and what switches it on.
pub type DrawingCase = (&'static str, fn(&mut Instrument));

/// Everything a detector can do beyond shot noise and conversion.
pub const DETECTOR: [DetectorCase; 4] = [
    ("PRNU", |params| params.prnu = 0.01),
    ("DSNU", |params| params.dsnu_e_rms = 2.0),
    ("dark current", |params| params.dark_e_per_s = 100.0),
    ("read noise", |params| params.read_noise_e_rms = 5.0),
];

/// What drawing can do beyond a round Gaussian.
pub const DRAWING: [DrawingCase; 2] = [
    ("Airy pattern", |instrument| instrument.psf = crate::optics::PsfModel::airy(1.5, 0.3)),
    ("wide Gaussian (table)", |instrument| instrument.psf = crate::optics::PsfModel::gaussian(3.0)),
];

/// Light in every pixel, e-.
const LIGHT_E: f32 = 20.0;
/// Turns at most.
const MOST_TURNS: usize = 41;

/// The scene of the drawing cases; the detector's are of the same size.
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

/// Every effect on every backend.
///
/// # Errors
/// When a backend fails.
pub fn measure(quick: bool, drawers: &mut [Drawer]) -> Result<Vec<EffectRow>, ChartError> {
    let (scene, turns) = (scene(quick), if quick { 3 } else { MOST_TURNS });
    let stage = Stage::new(&scene, 1)?;
    let mut rows = Vec::new();
    for drawer in drawers {
        for (effect, switch) in DRAWING {
            let mut with = stage.clone();
            switch(&mut with.instrument);
            let plans = [&stage, &with].map(|stage| plan(stage, drawer));
            let ms = by_turns(turns, |i| drawer.draw(&plans[i]).map_err(|error| failed(effect, &error)))?;
            rows.push(row(drawer, "drawing", effect, ms));
        }
        for (effect, switch) in DETECTOR {
            let mut with = DetectorParams::QUIET;
            switch(&mut with);
            let mut readouts = Vec::new();
            for params in [DetectorParams::QUIET, with] {
                let readout = Readout::new(params, scene.size_px, drawer).map_err(|error| failed(effect, &error))?;
                readouts.push(readout);
            }
            let mut out = DnImage::new(scene.size_px, scene.size_px);
            let ms = by_turns(turns, |i| readouts[i].collect(&mut out).map_err(|error| failed(effect, &error)))?;
            rows.push(row(drawer, "detector", effect, ms));
        }
    }
    Ok(rows)
}

fn failed(effect: &'static str, error: &dyn core::fmt::Display) -> ChartError {
    ChartError::Effect { effect, why: error.to_string() }
}

fn row(drawer: &Drawer, part: &str, effect: &str, [without_ms, with_ms]: [f64; 2]) -> EffectRow {
    let backend = drawer.name().into();
    let cost_ms = with_ms - without_ms;
    EffectRow { backend, part: part.into(), effect: effect.into(), without_ms, with_ms, cost_ms }
}

/// Medians of two that take turns, ms, after one turn that warms up.
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
    Ok(taken_ms.map(median))
}

/// A detector in front of the same light.
enum Readout {
    Cpu { detector: Box<Detector>, light: Image<f32>, frame: u32 },
    Gpu { detector: Box<GpuDetector>, light: Box<Gpu>, frame: u32 },
}

impl Readout {
    fn new(params: DetectorParams, size_px: usize, drawer: &Drawer) -> Result<Self, RenderError> {
        let mut detector = Detector::new(params, size_px, size_px, 1);
        match drawer {
            Drawer::Cpu { .. } => {
                let mut light = Image::new(size_px, size_px);
                light.pixels_mut().fill(LIGHT_E);
                Ok(Self::Cpu { detector: Box::new(detector), light, frame: 0 })
            }
            Drawer::Gpu { device, .. } => {
                detector.set_stray_light_e(0.0);
                let mut on_device = GpuDetector::new(Arc::clone(device), &detector, size_px, size_px)?;
                on_device.set_stray_light_e(LIGHT_E);
                // Never drawn into: the light comes as stray light.
                let light = Box::new(Gpu::new(Arc::clone(device), size_px, size_px)?);
                Ok(Self::Gpu { detector: Box::new(on_device), light, frame: 0 })
            }
        }
    }

    fn collect(&mut self, out: &mut DnImage) -> Result<(), RenderError> {
        match self {
            Self::Cpu { detector, light, frame } => {
                *frame += 1;
                detector.collect(light, *frame, EXPOSURE_S, out);
                Ok(())
            }
            Self::Gpu { detector, light, frame } => {
                *frame += 1;
                Ok(detector.collect(light.device_electrons(), *frame, EXPOSURE_S, out)?)
            }
        }
    }
}

/// The table for a terminal.
#[must_use]
pub fn summary(rows: &[EffectRow]) -> String {
    let mut text = format!(
        "\n{:<26} {:<9} {:<4} {:>12} {:>10} {:>10}\n",
        "effect", "part", "", "without ms", "with ms", "costs ms"
    );
    for row in rows {
        text += &format!(
            "{:<26} {:<9} {:<4} {:>12.3} {:>10.3} {:>+10.3}\n",
            row.effect, row.part, row.backend, row.without_ms, row.with_ms, row.cost_ms
        );
    }
    text
}

fn plan(stage: &Stage, drawer: &Drawer) -> ExposurePlan {
    stage.planner(drawer.cost(), MethodChoice::Auto).plan(&stage.sources).clone()
}
