//! Calibration of costs: small scenes through the real planner, backend and detector -> [`CostModel`] of this machine.
//!
//! Empty frames of two sizes, stars at rest and moved, a slew and jitter with few stars, stars by samples, kernels with few
//! and many nodes and stars, that of a line, and an Airy PSF; the median time of each, then `plan::exposure::cost`. Limits: an
//! idle machine is assumed; on a GPU
//! drawing and readout are timed together and the time per pixel is shared out between the two as in the built-in
//! constants.
//!
//! Who uses the result: runs on the real clock and `check`. The virtual clock and `render` always use the built-in
//! constants, because what the planner chooses must be the same, bit for bit, on every machine
//! (`tests/closed_loop/calibrated.rs`).

use crate::runtime::error::{Result, RunError};
use crate::runtime::imager::Imager;
use base::{
    accuracy::AccuracyBudget, axes::Rotation, clock::Stopwatch, image::DnImage, least_squares::median, random::philox,
    time::Tai,
};
use config::Backend;
use glam::DVec3;
use image::detector::{DetectorConditions, DetectorParams};
use plan::attitude::{JitterLine, LosPath};
use plan::exposure::cost::{CostModel, Load, NEAR_PIXELS, Timing, fit};
use plan::exposure::method::{Method, MethodName};
use plan::exposure::{
    Instrument, MethodChoice, PixelPath, PixelPoint, Planner, PsfSampling, Shutter, Source, SourcePlace,
};
use plan::optics::{Illumination, PsfModel};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};

/// Exposure of every scene, s.
const EXPOSURE_S: f64 = 0.1;
/// Focal length, px: a 20 degree field on 1024 pixels.
const FOCAL_PX: f64 = 2900.0;
/// Width and height of the path of the scenes with motion, px.
const PATH_PX: f64 = 3.0;
/// Cycles of jitter in an exposure.
const JITTER_CYCLES: f64 = 10.3;
/// Steps of its positions along x and y, as shares of that: powers of the inverse of the plastic number, which spread them evenly.
const STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];
/// Longest time spent on one scene, s.
const SCENE_S: f64 = 0.8;
/// Frames drawn before any is timed.
const WARM_UP: u32 = 2;

/// How much calibration measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Sides of the two detectors, px.
    sides_px: [usize; 2],
    /// Stars of a scene with few and one with many.
    stars: [usize; 2],
    /// Frames timed per scene.
    repeats: usize,
}

impl Effort {
    /// Returns the effort of a full calibration (a few seconds) or, when `quick`, of one that takes about one second.
    /// The reference backend gets scenes it can draw in that time.
    pub fn of(choice: Backend, quick: bool) -> Self {
        match (choice, quick) {
            (Backend::Reference, _) => Self { sides_px: [128, 256], stars: [20, 80], repeats: 3 },
            (_, true) => Self { sides_px: [512, 1024], stars: [2_000, 8_000], repeats: 5 },
            (_, false) => Self { sides_px: [1024, 2048], stars: [5_000, 20_000], repeats: 25 },
        }
    }
}

/// One scene and the time it took.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredScene {
    /// Name of the scene.
    pub name: &'static str,
    /// Side of its detector, px.
    pub side_px: usize,
    /// Stars drawn.
    pub stars: usize,
    /// Drawing method.
    pub method: Method,
    /// Median time of planning and drawing, ms (on a GPU: and of readout).
    pub render_ms: f64,
    /// Median time of readout, ms (on a GPU: of waiting for both).
    pub readout_ms: f64,
    psf: PsfModel,
    half_px: usize,
    extent_px: f64,
    narrow_px: f64,
    path_steps: usize,
}

/// Constants of one backend on this machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Name of the backend.
    pub backend: &'static str,
    /// Device the backend ran on.
    pub adapter: String,
    /// The constants.
    pub cost: CostModel,
    /// The scenes.
    pub scenes: Vec<MeasuredScene>,
}

struct Scene {
    name: &'static str,
    large: bool,
    stars: usize,
    method: MethodChoice,
    psf: PsfModel,
    moves: Moves,
}

/// Motion of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Moves {
    /// None.
    Still,
    /// A short straight line.
    Slew,
    /// Jitter that takes many nodes to follow.
    Jitter,
    /// So many positions all over a square: the kernel of a straight path has fewer terms, and would promise too much for jitter.
    Positions(usize),
}

/// Returns the scenes. Together they determine every cost constant.
fn scenes(effort: &Effort) -> [Scene; 14] {
    const FEW_FOR_A_KERNEL: usize = 16;
    let [few, many] = effort.stars;
    let scene = |name, stars, moves, method| {
        let method = MethodChoice::Fixed(method, if let Moves::Positions(nodes) = moves { Some(nodes) } else { None });
        Scene { name, large: false, stars, method, psf: PsfModel::gaussian(0.8), moves }
    };
    let still = |name, stars| scene(name, stars, Moves::Still, MethodName::Static);
    let samples = |name, nodes| scene(name, few, Moves::Positions(nodes), MethodName::Samples);
    let line = Scene {
        method: MethodChoice::Fixed(MethodName::EffectivePsf, Some(16)),
        ..scene("kernel of a line", many, Moves::Slew, MethodName::EffectivePsf)
    };
    let kernel = |name, stars, nodes| scene(name, stars, Moves::Positions(nodes), MethodName::EffectivePsf);
    let chosen =
        |name, moves| Scene { method: MethodChoice::Auto, ..scene(name, FEW_FOR_A_KERNEL, moves, MethodName::Static) };
    [
        Scene { large: true, ..still("empty, large", 0) },
        still("empty, small", 0),
        still("static, few stars", few),
        still("static, many stars", many),
        scene("moved, many stars", many, Moves::Slew, MethodName::Static),
        chosen("slew, few stars", Moves::Slew),
        chosen("jitter, few stars", Moves::Jitter),
        samples("samples, 16 nodes", 16),
        samples("samples, 64 nodes", 64),
        kernel("kernel, 16 nodes", FEW_FOR_A_KERNEL, 16),
        kernel("kernel, 256 nodes", FEW_FOR_A_KERNEL, 256),
        kernel("kernel, many stars", many, 16),
        line,
        Scene { psf: PsfModel::airy(1.5, 0.0), ..still("Airy, few stars", few.div_ceil(10)) },
    ]
}

/// Measures a backend. `progress` gets each scene's name, its number and how many there are.
///
/// # Errors
/// When the backend is unavailable or fails.
pub fn calibrate(
    choice: Backend,
    effort: &Effort,
    progress: &mut dyn FnMut(&str, usize, usize),
) -> Result<Calibration> {
    let scenes = scenes(effort);
    let mut measured = Vec::with_capacity(scenes.len());
    let mut imager: Option<(usize, Imager)> = None;
    for (i, scene) in scenes.iter().enumerate() {
        progress(scene.name, i, scenes.len());
        let side_px = effort.sides_px[usize::from(scene.large)];
        let here = match imager.take() {
            Some((side, imager)) if side == side_px => imager,
            _ => Imager::new(choice, detector(), [side_px; 2], 1)?,
        };
        let (_, here) = imager.insert((side_px, here));
        measured.push(measure(scene, side_px, effort.repeats, here)?);
    }
    progress("done", scenes.len(), scenes.len());
    let Some((_, imager)) = imager else { return Err(RunError::NothingMeasured) };
    let cost = constants(&measured, &imager);
    Ok(Calibration { backend: imager.name(), adapter: imager.description(), cost, scenes: measured })
}

/// Returns the constants that explain the measured times.
fn constants(scenes: &[MeasuredScene], imager: &Imager) -> CostModel {
    let built_in = imager.cost;
    let threads = if built_in.threads > 1.0 { rayon::current_num_threads() as f64 } else { built_in.threads };
    let timings: Vec<_> = scenes.iter().map(MeasuredScene::timing).collect();
    let mut cost = fit(&timings, &CostModel { threads, ..built_in });
    if imager.is_on_device() {
        // On a GPU the first half of a frame only submits work, so the two halves were timed together.
        let share = built_in.pixel_ns / (built_in.pixel_ns + built_in.readout_pixel_ns);
        (cost.pixel_ns, cost.readout_pixel_ns) = (cost.pixel_ns * share, cost.pixel_ns * (1.0 - share));
        if scenes.iter().any(|scene| scene.side_px * scene.side_px > NEAR_PIXELS) {
            cost.far_pixel_ns = (cost.far_pixel_ns - cost.readout_pixel_ns).max(0.0);
        }
    } else if let Some(empty) = scenes.iter().find(|scene| scene.stars == 0) {
        cost.readout_pixel_ns = empty.readout_ms * 1e6 / (empty.side_px * empty.side_px) as f64;
    }
    cost
}

impl MeasuredScene {
    fn timing(&self) -> Timing<'_> {
        let Self { extent_px, narrow_px, .. } = *self;
        let moves = self.path_steps > 0;
        let load = Load { extent_px, narrow_px, moves, ..Load::still(&self.psf, self.half_px, self.stars) };
        let (pixels, path_steps) = (self.side_px * self.side_px, self.path_steps);
        Timing { pixels, method: self.method, load, path_steps, ms: self.render_ms }
    }

    /// Returns the time that `cost` predicts for this scene, ms; on a GPU including the readout.
    pub fn predicted_ms(&self, cost: &CostModel, is_timed_whole: bool) -> f64 {
        let readout_ms = if is_timed_whole { cost.readout_ms(self.side_px * self.side_px) } else { 0.0 };
        self.timing().predicted_ms(cost) + readout_ms
    }
}

fn measure(scene: &Scene, side_px: usize, repeats: usize, imager: &mut Imager) -> Result<MeasuredScene> {
    let mut planner = planner(scene, side_px, imager.cost)?;
    let sources = sources(scene.stars, side_px);
    let conditions = DetectorConditions::dark(planner.latest().motion.los.exposure_s);
    let mut out = DnImage::new(side_px, side_px);
    let mut times: Vec<[f64; 2]> = Vec::with_capacity(repeats);
    for number in 0..WARM_UP {
        imager.image(planner.plan(&sources), number, &conditions, &mut out)?;
    }
    let mut spent_s = 0.0;
    while times.len() < repeats && (times.len() < 3 || spent_s < SCENE_S) {
        let mut watch = Stopwatch::start();
        let plan = planner.plan(&sources);
        let plan_ms = watch.lap().ms();
        let taken = imager.image(plan, WARM_UP, &conditions, &mut out)?;
        let (render_ms, readout_ms) = (plan_ms + taken.render.ms(), taken.detector.ms());
        times.push([if imager.is_on_device() { render_ms + readout_ms } else { render_ms }, readout_ms]);
        spent_s += plan_ms * 1e-3 + watch.lap().s();
    }
    let plan = planner.latest();
    let [render_ms, readout_ms] = [0, 1].map(|i| median(&mut times.iter().map(|times| times[i]).collect::<Vec<_>>()));
    Ok(MeasuredScene {
        name: scene.name,
        side_px,
        stars: plan.stars.len(),
        method: plan.chosen.method,
        render_ms,
        readout_ms,
        psf: plan.psf.clone(),
        half_px: plan.half_px,
        extent_px: plan.extent_px,
        narrow_px: plan.narrow_px,
        path_steps: plan.path_steps,
    })
}

fn detector() -> DetectorParams {
    DetectorParams {
        full_well_e: 1e5,
        gain_e_per_dn: 2.0,
        bits: 16,
        black_level_dn: 100.0,
        read_noise_e_rms: 5.0,
        dark_e_per_s: 1.0,
        prnu: 0.01,
        dsnu_e_rms: 1.0,
        ..DetectorParams::QUIET
    }
}

fn planner(scene: &Scene, side_px: usize, cost: CostModel) -> Result<Planner> {
    let camera = CameraGeometry::new(CameraParameters {
        width_px: side_px,
        height_px: side_px,
        focal_px: [FOCAL_PX; 2],
        principal_point_px: [0.5 * (side_px as f64 - 1.0); 2],
        distortion: BrownConrady::default(),
    })
    .map_err(|_| RunError::NothingMeasured)?;
    let detector = detector();
    let instrument = Instrument {
        camera,
        shutter: Shutter::Global,
        psf: scene.psf.clone(),
        sampling: PsfSampling::Auto,
        illumination: Illumination::EVEN,
        full_well_e: detector.full_well_e,
        read_noise_e_rms: detector.read_noise_e_rms,
    };
    let mut los = LosPath::commanded(Rotation::IDENTITY, Tai::from_ns(0), EXPOSURE_S);
    let along_rad = DVec3::new(PATH_PX / FOCAL_PX, 0.0, 0.0);
    let mut image_path = None;
    match scene.moves {
        Moves::Still => {}
        Moves::Slew => los.rate_rad_s = along_rad / EXPOSURE_S,
        Moves::Jitter => {
            let frequency_hz = JITTER_CYCLES / EXPOSURE_S;
            los.jitter.lines.push(JitterLine { frequency_hz, amplitude_rad: along_rad, phase_rad: 0.0 });
        }
        Moves::Positions(count) => image_path = PixelPath::samples((0..count).map(position).collect()).ok(),
    }
    let mut planner = Planner::new(instrument, AccuracyBudget::default(), cost, scene.method, los);
    planner.motion_mut().image_path = image_path;
    Ok(planner)
}

/// Returns a position of a path all over a square.
fn position(i: usize) -> PixelPoint {
    let [dx_px, dy_px] = STEPS.map(|step| PATH_PX * ((i as f64 * step).fract() - 0.5));
    PixelPoint { t_s: 0.0, dx_px, dy_px, roll_rad: 0.0 }
}

/// Returns bright stars spread over the whole detector.
#[allow(clippy::cast_possible_truncation, reason = "thousands of stars")]
fn sources(stars: usize, side_px: usize) -> Vec<Source> {
    let source = |i: u32| {
        let [x, y, light, _] = philox([i, 0, 0, 0], [1, 2]).map(|word| f64::from(word) / 4_294_967_296.0);
        let place = SourcePlace::Pixel([x * (side_px as f64 - 1.0), y * (side_px as f64 - 1.0)]);
        Source { id: i, electrons: 1e3 + 1e4 * light, mag: f32::NAN, place }
    };
    (0..stars as u32).map(source).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quick_calibration_gives_constants_that_predict_its_own_scenes() {
        let effort = Effort { sides_px: [256, 512], stars: [500, 2000], repeats: 3 };
        let mut reported = 0;
        let found = calibrate(Backend::Cpu, &effort, &mut |_, _, _| reported += 1).unwrap();
        assert_eq!(reported, 15, "one line per scene and one at the end");
        assert_eq!(found.backend, "cpu");
        let CostModel { frame_ms, pixel_ns, readout_pixel_ns, .. } = found.cost;
        assert!(frame_ms + pixel_ns > 0.0 && readout_pixel_ns > 0.0, "{:?}", found.cost);
        let kernel = found.scenes.iter().find(|scene| scene.name == "kernel, 256 nodes").unwrap();
        assert_eq!(kernel.method, Method::EffectivePsf { nodes: 256, stretches: 0 }, "the scene is drawn as asked");
        assert!(found.scenes.iter().all(|scene| scene.predicted_ms(&found.cost, false) > 0.0));
    }
}
