//! Scene -> instrument, motion and stars, ready to be planned.

use crate::chart::scenes::{Movement, Psf, Scene, Stars};
use base::{accuracy::AccuracyBudget, axes::Rotation, random::philox, time::Tai};
use core::f64::consts::TAU;
use glam::DVec3;
use plan::attitude::{JitterLine, LosPath};
use plan::exposure::cost::CostModel;
use plan::exposure::{
    ExposurePlan, Instrument, MethodChoice, PixelPath, PixelPoint, Planner, PsfSampling, Shutter, Source, SourcePlace,
};
use plan::optics::{Illumination, PsfModel};
use sky::astrometry::{AstrometryError, BrownConrady, CameraGeometry, CameraParameters};

/// Exposure of every scene, s.
pub const EXPOSURE_S: f64 = 0.1;
/// Read noise of every scene, e-.
pub const READ_NOISE_E: f64 = 10.0;
/// Focal length of every scene, px.
const FOCAL_PX: f64 = 2900.0;
/// Electrons of a separate star.
const ELECTRONS: f64 = 2e4;
/// Distance of the outermost stars from the detector's edge, px.
const MARGIN_PX: f64 = 9.0;
/// Straight pieces of a random path.
const PIECES: u32 = 512;
/// Largest number of stars of a field whose errors are measured.
const ALONE: usize = 24;
/// Distance between them, px.
const ALONE_PX: f64 = 40.0;

/// A scene with all its objects.
#[derive(Debug, Clone)]
pub struct Stage {
    /// The instrument.
    pub instrument: Instrument,
    /// The stars.
    pub sources: Vec<Source>,
    los: LosPath,
    path: Option<PixelPath>,
    is_field: bool,
}

impl Stage {
    /// Returns the scene with the random numbers of `seed`.
    ///
    /// # Errors
    /// When the camera is refused.
    pub fn new(scene: &Scene, seed: u32) -> Result<Self, AstrometryError> {
        let psf = match scene.psf {
            Psf::Gaussian(sigma_px) => PsfModel::gaussian(sigma_px),
            Psf::Airy(lambda_n_px, obscuration) => PsfModel::airy(lambda_n_px, obscuration),
        };
        let shutter = if scene.line_s > 0.0 { Shutter::Rolling { line_s: scene.line_s } } else { Shutter::Global };
        let instrument = Instrument {
            camera: camera(scene.size_px)?,
            shutter,
            psf,
            sampling: PsfSampling::Auto,
            illumination: Illumination::EVEN,
            full_well_e: 1e5,
            read_noise_e_rms: READ_NOISE_E,
        };
        let (los, path) = motion(&scene.motion, seed);
        let sources = match scene.stars {
            Stars::Apart(count) => apart(count, scene.size_px, seed),
            Stars::Field(count) => field(count, scene.size_px, seed),
        };
        Ok(Self { instrument, sources, los, path, is_field: scene.is_for_speed() })
    }

    /// Returns a planner with the default budget.
    pub fn planner(&self, cost: CostModel, choice: MethodChoice) -> Planner {
        let budget = AccuracyBudget::default();
        let mut planner = Planner::new(self.instrument.clone(), budget, cost, choice, self.los.clone());
        planner.motion_mut().image_path.clone_from(&self.path);
        planner
    }

    /// Returns `plan` with only those stars whose errors are measured: all separate ones; of a field, isolated bright
    /// ones.
    pub fn measured_part(&self, plan: &ExposurePlan) -> ExposurePlan {
        let mut part = plan.clone();
        if self.is_field {
            part.stars = alone(plan);
        }
        part
    }
}

/// Returns the brightest stars of the first class that keep their distance from one another.
fn alone(plan: &ExposurePlan) -> Vec<plan::exposure::PlannedStar> {
    let faintest_e = plan.classes.first().map_or(0.0, |class| class.faintest_e);
    // Even with one class for all, errors in units of noise need bright stars.
    let mut stars: Vec<_> = plan.stars.iter().filter(|star| star.electrons >= faintest_e).copied().collect();
    stars.sort_by(|a, b| b.electrons.total_cmp(&a.electrons));
    let mut chosen: Vec<plan::exposure::PlannedStar> = Vec::with_capacity(ALONE);
    for star in stars {
        let [x, y] = star.mean_px;
        if chosen.iter().all(|other| (other.mean_px[0] - x).hypot(other.mean_px[1] - y) >= ALONE_PX) {
            chosen.push(star);
        }
        if chosen.len() == ALONE {
            break;
        }
    }
    chosen
}

/// Returns the `i`-th number in [0, 1) of a stream.
fn unit(seed: u32, stream: u32, i: u32) -> f64 {
    f64::from(philox([i, stream, 0, 0], [seed, 0x00c4_a127])[0]) / 4_294_967_296.0
}

fn camera(size_px: usize) -> Result<CameraGeometry, AstrometryError> {
    CameraGeometry::new(CameraParameters {
        width_px: size_px,
        height_px: size_px,
        focal_px: [FOCAL_PX; 2],
        principal_point_px: [0.5 * (size_px as f64 - 1.0); 2],
        distortion: BrownConrady::default(),
    })
}

/// Returns the rate that moves the image by `px` and rolls it by `roll_rad` during the exposure.
fn rate_rad_s([x, y]: [f64; 2], roll_rad: f64) -> DVec3 {
    DVec3::new(y / FOCAL_PX, -x / FOCAL_PX, roll_rad) / EXPOSURE_S
}

fn motion(movement: &Movement, seed: u32) -> (LosPath, Option<PixelPath>) {
    let mut los = LosPath::commanded(Rotation::IDENTITY, Tai::from_ns(0), EXPOSURE_S);
    match *movement {
        Movement::Still => (los, None),
        Movement::Drift { px, roll_rad } => {
            los.rate_rad_s = rate_rad_s(px, roll_rad);
            (los, None)
        }
        Movement::Sinusoid { amplitude_px, cycles } => {
            let along = DVec3::new(0.28, -0.96, 0.0);
            los.jitter.lines = vec![JitterLine {
                frequency_hz: cycles / EXPOSURE_S,
                amplitude_rad: along * (amplitude_px / FOCAL_PX),
                phase_rad: 0.4,
            }];
            (los, None)
        }
        Movement::Wander { rms_px, most_cycles } => (los, Some(wander(rms_px, most_cycles, seed))),
        Movement::Positions { rms_px, count } => {
            // Uniform: rms is the half-width over the root of 3.
            let at = |stream, i| 3.0_f64.sqrt() * rms_px * (2.0 * unit(seed, stream, i) - 1.0);
            let point = |i| PixelPoint { t_s: 0.0, dx_px: at(10, i), dy_px: at(11, i), roll_rad: 0.0 };
            (los, Some(PixelPath::Samples((0..count).map(point).collect())))
        }
    }
}

/// Returns the straight pieces along a sum of sinusoids of equal amplitude, one in every unit of frequency.
fn wander(rms_px: f64, most_cycles: u32, seed: u32) -> PixelPath {
    let amplitude_px = rms_px * (2.0 / f64::from(most_cycles)).sqrt();
    let along = |axis: u32, share: f64| -> f64 {
        let wave = |k: u32| {
            let cycles = f64::from(k) + unit(seed, 20 + axis, k);
            amplitude_px * (TAU * (cycles * share + unit(seed, 30 + axis, k))).sin()
        };
        (0..most_cycles).map(wave).sum()
    };
    let row = |i: u32| {
        let share = f64::from(i) / f64::from(PIECES);
        PixelPoint { t_s: share * EXPOSURE_S, dx_px: along(0, share), dy_px: along(1, share), roll_rad: 0.0 }
    };
    PixelPath::Line((0..=PIECES).map(row).collect())
}

fn star(id: u32, electrons: f64, px: [f64; 2]) -> Source {
    Source { id, electrons, mag: f32::NAN, place: SourcePlace::Pixel(px) }
}

/// Returns a grid of stars from corner to corner, each displaced by a random part of a pixel.
fn apart(count: usize, size_px: usize, seed: u32) -> Vec<Source> {
    let columns = (1..=count).find(|n| n * n >= count).unwrap_or(1);
    let rows = count.div_ceil(columns);
    let span_px = size_px as f64 - 1.0 - 2.0 * MARGIN_PX;
    let along = |i: usize, n: usize| MARGIN_PX + span_px * i as f64 / (n.max(2) - 1) as f64;
    let place = |i: u32| {
        let (column, row) = (i as usize % columns, i as usize / columns);
        let off = |stream| unit(seed, stream, i) - 0.5;
        [along(column, columns) + off(1), along(row, rows) + off(2)]
    };
    (0..).take(count).map(|i| star(i, ELECTRONS, place(i))).collect()
}

/// Returns stars at uniform random places over the detector, few bright and many faint.
fn field(count: usize, size_px: usize, seed: u32) -> Vec<Source> {
    let place = |i: u32| [unit(seed, 3, i), unit(seed, 4, i)].map(|v| v * size_px as f64 - 0.5);
    (0..).take(count).map(|i| star(i, 200.0 + 5000.0 * unit(seed, 5, i).powi(4), place(i))).collect()
}
