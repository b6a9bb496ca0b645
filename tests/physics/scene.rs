//! Scenes for the tests of this folder: a camera, a plan, an image in f64, and the window a tracker looks through.

use base::time::{Span, Tai};
use base::{accuracy::AccuracyBudget, axes::Rotation, random::philox};
use core::ops::Range;
use glam::DVec3;
use image::{gpu::Electrons, render::Backend, render::cpu::Cpu, render::reference::Reference};
use plan::attitude::{JitterTrack, LosPath, PathOrigin};
use plan::exposure::cost::CostModel;
use plan::exposure::{
    ExposurePlan, Instrument, MethodChoice, PixelPath, Planner, PsfSampling, Shutter, Source, SourcePlace,
};
use plan::optics::{Illumination, PsfModel};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};

/// Exposure of every scene, s.
pub(crate) const EXPOSURE_S: f64 = 0.1;
/// Focal length of every scene, px.
pub(crate) const FOCAL_PX: f64 = 2900.0;
/// Electrons at which the scenes' pixels saturate.
pub(crate) const FULL_WELL_E: f64 = 1e5;
/// Read noise of the scenes' instrument, e-.
pub(crate) const READ_NOISE_E: f64 = 10.0;
/// Half-width of a tracker's window, px.
const WINDOW_HALF: usize = 2;

/// An image in f64.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) pixels: Vec<f64>,
}

/// A rectangle of pixels.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    pub(crate) columns: Range<usize>,
    pub(crate) rows: Range<usize>,
}

impl Picture {
    pub(crate) fn at(&self, x: usize, y: usize) -> f64 {
        self.pixels[y * self.width + x]
    }

    pub(crate) fn sum(&self) -> f64 {
        self.pixels.iter().sum()
    }

    /// Returns the brightest pixel among those of `window`.
    pub(crate) fn brightest(&self, window: &Window) -> [usize; 2] {
        let places = window.rows.clone().flat_map(|y| window.columns.clone().map(move |x| [x, y]));
        places.max_by(|a, b| self.at(a[0], a[1]).total_cmp(&self.at(b[0], b[1]))).expect("the window has pixels")
    }

    /// Returns the 5 x 5 window about the brightest pixel among those of `window`.
    pub(crate) fn tracker_window(&self, window: &Window) -> Window {
        let [x, y] = self.brightest(window);
        let around = |v: usize, end: usize| v.saturating_sub(WINDOW_HALF)..(v + WINDOW_HALF + 1).min(end);
        Window { columns: around(x, self.width), rows: around(y, self.pixels.len() / self.width) }
    }

    /// Returns the flux and centroid inside `window`.
    pub(crate) fn moments(&self, window: &Window) -> (f64, [f64; 2]) {
        let (mut flux, mut first) = (0.0, [0.0, 0.0]);
        for y in window.rows.clone() {
            for x in window.columns.clone() {
                let value = self.at(x, y);
                flux += value;
                first[0] += value * x as f64;
                first[1] += value * y as f64;
            }
        }
        (flux, first.map(|v| v / flux))
    }
}

/// Returns the distance of the centroids of two images in the same window, px.
pub(crate) fn centroid_error_px(image: &Picture, truth: &Picture, window: &Window) -> f64 {
    let ([a, b], [c, d]) = (image.moments(window).1, truth.moments(window).1);
    (a - c).hypot(b - d)
}

/// Returns the relative difference of the flux of two images in the same window.
pub(crate) fn flux_error(image: &Picture, truth: &Picture, window: &Window) -> f64 {
    (image.moments(window).0 / truth.moments(window).0 - 1.0).abs()
}

/// Returns the whole of a square detector.
pub(crate) fn everything(size: usize) -> Window {
    Window { columns: 0..size, rows: 0..size }
}

/// Returns a camera of `size` x `size` pixels without distortion.
pub(crate) fn camera(size: usize) -> CameraGeometry {
    let middle = 0.5 * (size as f64 - 1.0);
    let parameters = CameraParameters {
        width_px: size,
        height_px: size,
        focal_px: [FOCAL_PX; 2],
        principal_point_px: [middle; 2],
        distortion: BrownConrady::default(),
    };
    CameraGeometry::new(parameters).expect("a camera")
}

/// Returns a line of sight at rest.
pub(crate) fn los() -> LosPath {
    LosPath {
        exposure_start: Tai::from_ns(0),
        exposure_s: EXPOSURE_S,
        mid_sensor_from_icrf: Rotation::IDENTITY,
        rate_rad_s: DVec3::ZERO,
        acceleration_rad_s2: DVec3::ZERO,
        jitter: JitterTrack::none(),
        origin: PathOrigin::Commanded,
        horizon: Span::ZERO,
    }
}

/// Returns an instrument with a full well of [`FULL_WELL_E`] and a read noise of [`READ_NOISE_E`].
pub(crate) fn instrument(camera: CameraGeometry, psf: &PsfModel) -> Instrument {
    Instrument {
        camera,
        psf: psf.clone(),
        full_well_e: FULL_WELL_E,
        read_noise_e_rms: READ_NOISE_E,
        shutter: Shutter::Global,
        sampling: PsfSampling::Auto,
        illumination: Illumination::EVEN,
    }
}

/// Returns a planner with the default budget.
pub(crate) fn planner(size: usize, psf: &PsfModel, method: &str, los: LosPath, path: Option<PixelPath>) -> Planner {
    planner_of(instrument(camera(size), psf), method, los, path)
}

/// Returns a planner for an instrument, with the default budget.
pub(crate) fn planner_of(instrument: Instrument, method: &str, los: LosPath, path: Option<PixelPath>) -> Planner {
    let choice: MethodChoice = method.parse().expect("a method");
    let mut planner = Planner::new(instrument, AccuracyBudget::default(), CostModel::CPU, choice, los);
    planner.motion_mut().image_path = path;
    planner
}

/// Returns a star on the detector.
pub(crate) fn star(id: u32, electrons: f64, px: [f64; 2]) -> Source {
    Source { id, electrons, mag: f32::NAN, place: SourcePlace::Pixel(px) }
}

/// Draws `plan` with the CPU backend.
pub(crate) fn draw_cpu(plan: &ExposurePlan) -> Picture {
    draw(&mut Cpu::new(plan.camera.width_px(), plan.camera.height_px()), plan)
}

/// Integrates the motion of `plan` with the reference.
pub(crate) fn draw_reference(plan: &ExposurePlan) -> Picture {
    draw(&mut Reference::new(plan.camera.width_px(), plan.camera.height_px()), plan)
}

fn draw(backend: &mut dyn Backend, plan: &ExposurePlan) -> Picture {
    backend.render(plan).expect("draws");
    match backend.electrons() {
        Electrons::Host(image) => {
            Picture { width: image.width(), pixels: image.pixels().iter().map(|e| f64::from(*e)).collect() }
        }
        Electrons::Precise(image) => Picture { width: image.width(), pixels: image.pixels().to_vec() },
        Electrons::Device(_) => panic!("these backends draw in memory"),
    }
}

/// Uniform numbers in [0, 1) that depend on nothing but `seed` and the order of calls.
#[derive(Debug)]
pub(crate) struct Dice {
    seed: u32,
    drawn: u32,
}

impl Dice {
    pub(crate) fn new(seed: u32) -> Self {
        Self { seed, drawn: 0 }
    }

    pub(crate) fn unit(&mut self) -> f64 {
        self.drawn += 1;
        f64::from(philox([self.drawn, 0, 0, 0], [self.seed, 77])[0]) / 4_294_967_296.0
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}
