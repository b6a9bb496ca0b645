//! The effects that cost time: their list, and how much each costs.
//!
//! Cost of each effect: the time of a frame with it minus that of the same frame without it, on every backend.
//!
//! In: a list of effects, each a change of a quiet detector or of a plain instrument. Out: `effects.csv`. Frames with
//! and without alternate, so that other load on the machine affects both; medians. An effect that is off takes no time,
//! because none of its code runs: "without" means a camera that does not name it.

use crate::chart::scenes::{STILL, Scene, Stars};
use crate::chart::stage;
use crate::chart::stage::{Drawer, EXPOSURE_S, Stage};
use base::image::{DnImage, Image};
use base::{bayer::BayerPattern, clock::Stopwatch, least_squares::median, refused::Refused, time::Tai};
use image::detector::binning::{Binning, BinningKind};
use image::detector::charge_transfer::{ChargeTransfer, OutputCorner};
use image::detector::protons::{ProtonDirection, ProtonFlux};
use image::detector::{
    Background, Detector, DetectorConditions, DetectorParams, LinePattern, Nonlinearity, Rounding, RowNoise,
};
use image::detector::{
    blooming::Blooming, defects::population::DefectPopulation, gpu::GpuDetector, image_lag::ImageLag,
    pattern::ColourFilter, tdi::Tdi, window::Window,
};
use image::render::gpu::Gpu;
use plan::exposure::{Instrument, MethodChoice, Target, TargetCurve, TargetPath, TargetWay};
use plan::exposure::{planner::Planner, target::FIRST_TARGET_ID};
use plan::optics::{Illumination, PsfModel};
use plan::optics::{illumination::Vignetting, psf_field::PsfField};
use serde::{Deserialize, Serialize};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};
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
        stars: Stars::Field(if quick { 200 } else { 2000 }),
        ..STILL
    }
}

/// Measures every effect on every backend.
///
/// # Errors
/// When a backend fails.
pub fn measure(quick: bool, drawers: &mut [Drawer]) -> Result<Vec<EffectRow>, Refused> {
    let (scene, turns) = (scene(quick), if quick { 3 } else { MOST_TURNS });
    let stage = Stage::new(&scene, 1).map_err(stage::camera_refused)?;
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

// The effects whose cost is charted, as data: a name and a change that switches it on.

/// Change that switches an effect of the detector on.
#[derive(Debug, Clone, Copy)]
pub enum Switch {
    /// Its parameters.
    Params(fn(&mut DetectorParams)),
    /// Light besides the stars, and true when the image plane is lit unevenly.
    Background(Background, bool),
}

/// Change that switches an effect of drawing on.
#[derive(Debug, Clone, Copy)]
pub enum DrawingSwitch {
    /// A change of the instrument.
    Instrument(fn(&mut Instrument)),
    /// A change of the planner.
    Planner(fn(&mut Planner)),
}

/// Detector effects besides shot noise and conversion.
pub const DETECTOR: [(&str, Switch); 22] = [
    ("background, the same everywhere", Switch::Background(Background::uniform(20.0), false)),
    ("background with a shape", Switch::Background(SHAPED, false)),
    ("sky through uneven illumination", Switch::Background(SKY, true)),
    ("colour filter", Switch::Params(|params| params.spatial.colour_filter = Some(FILTER))),
    ("PRNU", Switch::Params(|params| params.prnu = 0.01)),
    ("dark current", Switch::Params(|params| params.dark_e_per_s = 100.0)),
    ("dark current, uneven", Switch::Params(|params| (params.dark_e_per_s, params.dark_nonuniformity) = (100.0, 0.1))),
    ("defects, 1 in 1000", Switch::Params(|params| params.spatial.defects = SOME_DEFECTS)),
    ("protons, 1e4 per cm2 and s", Switch::Params(|params| params.spatial.protons = Some(STORM))),
    ("image lag", Switch::Params(|params| params.spatial.image_lag = Some(ImageLag { share: 0.01 }))),
    ("blooming", Switch::Params(|params| params.spatial.blooming = Some(Blooming { drained_share: 0.0 }))),
    ("charge transfer", Switch::Params(|params| params.spatial.charge_transfer = Some(POOR_TRANSFER))),
    ("binning of charge, 2 x 2", Switch::Params(|params| params.spatial.binning = Some(BINNING))),
    ("time-delayed integration, 16", Switch::Params(|params| params.spatial.tdi = Some(Tdi { stages: 16 }))),
    ("nonlinear response", Switch::Params(|params| params.nonlinearity = bent())),
    ("columns and rows", Switch::Params(|params| params.line_pattern = LINES)),
    ("DSNU", Switch::Params(|params| params.dsnu_e_rms = 2.0)),
    ("row noise with 1/f", Switch::Params(|params| params.row_noise = ROWS)),
    ("read noise", Switch::Params(|params| params.read_noise_e_rms = 5.0)),
    ("amplifier noise", Switch::Params(|params| params.amplifier_noise_e_rms = 5.0)),
    ("truncation", Switch::Params(|params| params.rounding = Rounding::Truncate)),
    ("window, a quarter", Switch::Params(|params| params.spatial.window = Some(QUARTER))),
];

/// Drawing effects besides round Gaussians of stars on an even image plane.
pub const DRAWING: [(&str, DrawingSwitch); 8] = [
    ("wide Gaussian", DrawingSwitch::Instrument(|instrument| instrument.psf = PsfModel::gaussian(3.0))),
    ("Airy pattern", DrawingSwitch::Instrument(|instrument| instrument.psf = PsfModel::airy(1.5, 0.3))),
    ("Moffat", DrawingSwitch::Instrument(|instrument| instrument.psf = PsfModel::moffat(1.2, 3.5))),
    (
        "PSF of the field, 2 x 2 cells",
        DrawingSwitch::Instrument(|instrument| instrument.psf = over_the_field(instrument)),
    ),
    ("relative illumination", DrawingSwitch::Instrument(|instrument| instrument.illumination = UNEVEN)),
    ("distortion", DrawingSwitch::Instrument(distort)),
    ("rolling shutter, at rest", DrawingSwitch::Instrument(|instrument| instrument.shutter = ROLLING)),
    ("ten targets, 3 px", DrawingSwitch::Planner(|planner| planner.set_targets(ten_targets()))),
];

const SHAPED: Background = Background { gradient_e: [5.0, -3.0], quadratic_e: 4.0, ..Background::uniform(20.0) };
const SKY: Background = Background { sky_e: 20.0, ..Background::DARK };
const SOME_DEFECTS: DefectPopulation =
    DefectPopulation { hot_share: 1e-3, hot_e_per_s: 500.0, ..DefectPopulation::NONE };
const STORM: ProtonFlux = ProtonFlux { per_cm2_s: 1e4, energy_mev: 50.0, direction: ProtonDirection::Isotropic };
const POOR_TRANSFER: ChargeTransfer =
    ChargeTransfer { parallel_share: 1e-4, serial_share: 1e-5, corner: OutputCorner::TopLeft };
const BINNING: Binning = Binning { factor: 2, kind: BinningKind::Charge { full_well_e: 4e7 } };
const FILTER: ColourFilter = ColourFilter { pattern: BayerPattern::Rggb, red: 0.35, green: 0.45, blue: 0.25 };
const LINES: LinePattern = LinePattern { column_e_rms: 2.0, column_gain_rms: 0.005, row_e_rms: 1.0 };
const ROWS: RowNoise = RowNoise { e_rms: 2.0, corner_cycles_per_row: 0.01 };
const QUARTER: Window = Window { left_px: 64, top_px: 64, width_px: 128, height_px: 128 };
const ROLLING: plan::exposure::Shutter = plan::exposure::Shutter::Rolling { line_s: 2e-5 };
const UNEVEN: Illumination = Illumination {
    vignetting: Some(Vignetting { window_radius_mm: 20.0, pupil_radius_mm: 18.0, distance_mm: 30.0 }),
    cos4: true,
    unblocked: 0.9,
};

fn bent() -> Nonlinearity {
    Nonlinearity::through(&[[1e4, 1e4], [2e4, 1.95e4], [4e4, 3.7e4]]).unwrap_or(Nonlinearity::OFF)
}

/// Returns a field of nine PSFs, sharper in the middle.
fn over_the_field(instrument: &Instrument) -> PsfModel {
    let size_px = [instrument.camera.width_px(), instrument.camera.height_px()];
    let node = |i: u32| PsfModel::moffat(1.2 + 0.1 * f64::from((i % 3).abs_diff(1) + (i / 3).abs_diff(1)), 3.5);
    PsfField::new([3, 3], size_px, (0..9).map(node).collect()).map_or(instrument.psf.clone(), PsfModel::field)
}

fn distort(instrument: &mut Instrument) {
    let distortion = BrownConrady { k1: -0.1, ..BrownConrady::default() };
    let parameters = CameraParameters { distortion, ..*instrument.camera.parameters() };
    if let Ok(camera) = CameraGeometry::new(parameters) {
        instrument.camera = camera;
    }
}

fn ten_targets() -> Vec<Target> {
    let target = |i: u32| Target {
        id: FIRST_TARGET_ID + i,
        mag: f32::NAN,
        e_per_s: 1e6,
        begin: Tai::from_ns(-1_000_000_000),
        end: Tai::from_ns(1_000_000_000),
        way: TargetWay::Script(TargetPath {
            position_px: [20.0 * f64::from(i) + 20.0, 100.0],
            velocity_px_s: [20.0, 22.0],
            curve: TargetCurve::Straight,
        }),
        light: None,
    };
    (0..10).map(target).collect()
}
