//! All that a measurement needs: the scene as an instrument, the backends, the clock.
//!
//! Scene -> instrument, motion and stars, ready to be planned.

use crate::chart::Backends;
use crate::chart::scenes::{Movement, Psf, Scene, Stars};
use base::{
    accuracy::AccuracyBudget, axes::Rotation, clock::Stopwatch, image::Image, least_squares::median, random::philox,
    refused::Refused, time::Tai,
};
use core::f64::consts::TAU;
use glam::DVec3;
use image::gpu::{AdapterChoice, Electrons, GpuDevice};
use image::render::{Backend, cpu::Cpu, gpu::Gpu, reference::Reference};
use plan::attitude::{JitterLine, LosPath};
use plan::exposure::cost::CostModel;
use plan::exposure::{
    ExposurePlan, Instrument, MethodChoice, PixelPath, PixelPoint, Planner, PsfSampling, Shutter, Source, SourcePlace,
};
use plan::optics::{Illumination, PsfModel};
use sky::astrometry::{AstrometryError, BrownConrady, CameraGeometry, CameraParameters};
use std::sync::Arc;

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

// The refusal of a scene.

/// A scene's camera was refused.
pub(super) fn camera_refused(why: AstrometryError) -> Refused {
    Refused(format!("a scene's camera: {why}"))
}

// The backends under test, and the reference: draw a plan and wait for the image in f64.

/// A square image in f64.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Row by row.
    pub pixels: Vec<f64>,
}

/// A backend that is rebuilt for the size of the scene.
#[derive(Debug)]
pub enum Drawer {
    /// The CPU.
    Cpu {
        /// Side of the latest scene, px.
        size_px: usize,
        /// The backend.
        backend: Box<Cpu>,
    },
    /// A GPU.
    Gpu {
        /// The device.
        device: Arc<GpuDevice>,
        /// Side of the latest scene, px.
        size_px: usize,
        /// The backend.
        backend: Option<Box<Gpu>>,
    },
}

impl Drawer {
    /// Returns the requested backends, and a line about one that is missing.
    ///
    /// # Errors
    /// When a GPU was requested by name and is not available.
    pub fn open(backends: Backends) -> Result<(Vec<Self>, Option<String>), Refused> {
        let mut drawers = Vec::new();
        if backends != Backends::Gpu {
            drawers.push(Self::Cpu { size_px: 0, backend: Box::new(Cpu::new(0, 0)) });
        }
        if backends == Backends::Cpu {
            return Ok((drawers, None));
        }
        match GpuDevice::open(&AdapterChoice::Best) {
            Ok(device) => drawers.push(Self::Gpu { device, size_px: 0, backend: None }),
            Err(error) if backends == Backends::Gpu => return Err(Refused(format!("--backend gpu: {error}"))),
            Err(error) => return Ok((drawers, Some(format!("no GPU: {error}")))),
        }
        Ok((drawers, None))
    }

    /// Returns the name used in commands.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Cpu { .. } => "cpu",
            Self::Gpu { .. } => "gpu",
        }
    }

    /// Returns true for a GPU that is emulated in software.
    pub fn is_software_gpu(&self) -> bool {
        matches!(self, Self::Gpu { device, .. } if device.is_software())
    }

    /// Returns a description of its device.
    pub fn description(&self) -> String {
        match self {
            Self::Cpu { backend, .. } => format!("cpu: {}", backend.description()),
            Self::Gpu { device, .. } => format!("gpu: {}", device.description()),
        }
    }

    /// Returns the cost constants.
    pub fn cost(&self) -> CostModel {
        match self {
            Self::Cpu { .. } => CostModel::CPU,
            Self::Gpu { device, .. } if device.is_software() => CostModel::SOFTWARE_GPU,
            Self::Gpu { .. } => CostModel::GPU,
        }
    }

    /// Draws, and waits until the image is complete; it stays on its device.
    ///
    /// # Errors
    /// When the backend refuses the plan or fails.
    pub fn draw(&mut self, plan: &ExposurePlan) -> Result<(), Refused> {
        let wanted_px = plan.camera.width_px();
        match self {
            Self::Cpu { size_px, backend } => {
                if *size_px != wanted_px {
                    (*size_px, **backend) = (wanted_px, Cpu::new(wanted_px, plan.camera.height_px()));
                }
                backend.render(plan)
            }
            Self::Gpu { device, size_px, backend } => {
                if *size_px != wanted_px {
                    *backend = None;
                    *size_px = wanted_px;
                }
                let gpu = match backend {
                    Some(gpu) => gpu,
                    none => none.insert(Box::new(Gpu::new(Arc::clone(device), wanted_px, plan.camera.height_px())?)),
                };
                gpu.render(plan)?;
                Ok(device.wait()?)
            }
        }
    }

    /// Draws, and returns the image in main memory.
    ///
    /// # Errors
    /// When the backend refuses the plan or fails.
    pub fn picture(&mut self, plan: &ExposurePlan) -> Result<Picture, Refused> {
        self.draw(plan)?;
        match self {
            Self::Cpu { backend, .. } => Ok(in_memory(&backend.electrons())),
            Self::Gpu { backend, .. } => {
                let mut image = Image::new(plan.camera.width_px(), plan.camera.height_px());
                if let Some(gpu) = backend {
                    gpu.read_electrons(&mut image)?;
                }
                Ok(in_memory(&Electrons::Host(&image)))
            }
        }
    }
}

/// Returns the reference's image of `plan`'s motion and stars.
///
/// # Errors
/// When the reference refuses the plan.
pub fn truth(plan: &ExposurePlan) -> Result<Picture, Refused> {
    let mut reference = Reference::new(plan.camera.width_px(), plan.camera.height_px());
    reference.render(plan)?;
    Ok(in_memory(&reference.electrons()))
}

fn in_memory(electrons: &Electrons<'_>) -> Picture {
    match electrons {
        Electrons::Host(image) => {
            Picture { width: image.width(), pixels: image.pixels().iter().map(|e| f64::from(*e)).collect() }
        }
        Electrons::Precise(image) => Picture { width: image.width(), pixels: image.pixels().to_vec() },
        Electrons::Device(_) => Picture { width: 0, pixels: Vec::new() },
    }
}

// Medians of frame times, after two warm-up frames, within a time limit.

/// Time of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameTime {
    /// Median, ms.
    pub median_ms: f64,
    /// The fastest, without other load, ms.
    pub least_ms: f64,
}

/// Effort for one value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Time after which no further repetition starts, ms.
    pub most_ms: f64,
    /// Largest number of repetitions.
    pub most: usize,
}

impl Effort {
    /// Returns the effort of a quick run, or a full one.
    pub fn new(quick: bool) -> Self {
        if quick { Self { most_ms: 12.0, most: 40 } } else { Self { most_ms: 60.0, most: 200 } }
    }

    /// Returns an effort multiplied by `factor`.
    #[must_use]
    pub fn times(self, factor: usize) -> Self {
        Self { most_ms: self.most_ms * factor as f64, most: self.most * factor }
    }

    /// Measures the time of `frame`.
    ///
    /// # Errors
    /// Those of `frame`.
    pub fn time<E>(self, mut frame: impl FnMut() -> Result<(), E>) -> Result<FrameTime, E> {
        frame()?;
        frame()?;
        let mut taken_ms = Vec::with_capacity(self.most);
        let (mut watch, mut spent_ms) = (Stopwatch::start(), 0.0);
        while taken_ms.len() < self.most && spent_ms <= self.most_ms {
            frame()?;
            let ms = watch.lap().ms();
            spent_ms += ms;
            taken_ms.push(ms);
        }
        let least_ms = taken_ms.iter().copied().fold(f64::INFINITY, f64::min);
        Ok(FrameTime { median_ms: median(&mut taken_ms), least_ms })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_frames_warm_up_and_the_number_or_the_limit_ends_it() {
        let mut frames = 0;
        let mut frame = || -> Result<(), ()> {
            frames += 1;
            std::thread::sleep(core::time::Duration::from_millis(2));
            Ok(())
        };
        let time = Effort { most_ms: 1e9, most: 5 }.time(&mut frame).unwrap();
        assert!(time.least_ms >= 2.0 && time.median_ms >= time.least_ms, "{time:?}");
        let time = Effort { most_ms: 1.0, most: 50 }.time(&mut frame).unwrap();
        assert_eq!(time.least_ms, time.median_ms, "one frame is beyond the limit");
        assert_eq!(frames, (2 + 5) + (2 + 1));
        assert_eq!(Effort { most_ms: 1.0, most: 1 }.time(|| Err("lost")), Err("lost"));
    }
}
