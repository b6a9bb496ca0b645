//! Scenes and comparators that all GPU tests share.

use base::image::{DnImage, Image};
use base::time::{Span, Tai};
use base::{accuracy::AccuracyBudget, axes::Rotation, random::philox};
use plan::attitude::{JitterTrack, LosPath, PathOrigin};
use plan::exposure::cost::CostModel;
use plan::exposure::{
    ExposurePlan, Instrument, PixelPath, PixelPoint, Planner, PsfSampling, Shutter, Source, SourcePlace,
};
use plan::optics::{Illumination, PsfModel};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};
use starloop_image::detector::{Detector, DetectorParams};
use starloop_image::gpu::{AdapterChoice, Electrons, GpuDevice};
use starloop_image::render::{Backend, cpu::Cpu, gpu::Gpu};
use std::sync::{Arc, OnceLock};

/// Exposure of every scene, s.
pub const EXPOSURE_S: f64 = 0.1;

/// Returns the device, or `None` (and a printed line that a script counts) when there is none and none is required.
pub fn device() -> Option<Arc<GpuDevice>> {
    static DEVICE: OnceLock<Result<Arc<GpuDevice>, String>> = OnceLock::new();
    let opened = DEVICE.get_or_init(|| GpuDevice::open(&AdapterChoice::Best).map_err(|error| error.to_string()));
    match opened {
        Ok(device) => Some(Arc::clone(device)),
        Err(error) => {
            assert!(std::env::var("STARLOOP_REQUIRE_GPU").as_deref() != Ok("1"), "a GPU is required: {error}");
            println!("SKIPPED: no Vulkan adapter");
            None
        }
    }
}

/// Returns a uniform in [0, 1).
pub fn unit(i: u32, stream: u32) -> f64 {
    f64::from(philox([i, stream, 7, 0], [3, 4])[0]) / 4_294_967_296.0
}

/// Motion of the stars of a scene.
pub enum Motion {
    /// Nothing.
    Still,
    /// A smooth slew, rad/s about each sensor axis.
    Slew([f64; 3]),
    /// This many random displacements of up to this many px, with roll.
    Jitter(u32, f64),
    /// A slow turn of the image about its middle, rad in all, in steps.
    Roll(f64),
}

/// A detector, a PSF and a path.
pub struct Scene {
    pub size: [usize; 2],
    pub psf: PsfModel,
    pub motion: Motion,
    pub method: String,
    pub shutter: Shutter,
}

impl Scene {
    pub fn new(psf: PsfModel, motion: Motion, method: &str) -> Self {
        Self { size: [320, 240], psf, motion, method: method.into(), shutter: Shutter::Global }
    }

    pub fn with_shutter(self, shutter: Shutter) -> Self {
        Self { shutter, ..self }
    }

    pub fn of_size(self, size: [usize; 2]) -> Self {
        Self { size, ..self }
    }

    /// Returns a planner set up for this scene.
    pub fn planner(&self) -> Planner {
        let [width_px, height_px] = self.size;
        let camera = CameraGeometry::new(CameraParameters {
            width_px,
            height_px,
            focal_px: [2900.0; 2],
            principal_point_px: [0.5 * (width_px as f64 - 1.0), 0.5 * (height_px as f64 - 1.0)],
            distortion: BrownConrady::default(),
        })
        .expect("a camera");
        let rate = match self.motion {
            Motion::Slew(rate) => rate.into(),
            Motion::Still | Motion::Jitter(..) | Motion::Roll(_) => glam::DVec3::ZERO,
        };
        let los = LosPath {
            exposure_start: Tai::from_ns(0),
            exposure_s: EXPOSURE_S,
            mid_sensor_from_icrf: Rotation::IDENTITY,
            rate_rad_s: rate,
            acceleration_rad_s2: glam::DVec3::ZERO,
            jitter: JitterTrack::none(),
            origin: PathOrigin::Commanded,
            horizon: Span::ZERO,
        };
        let instrument = Instrument {
            camera,
            psf: self.psf.clone(),
            full_well_e: 1e5,
            read_noise_e_rms: 10.0,
            shutter: self.shutter,
            sampling: PsfSampling::Auto,
            illumination: Illumination::EVEN,
        };
        let method = self.method.parse().expect("a method");
        let mut planner = Planner::new(instrument, AccuracyBudget::default(), CostModel::CPU, method, los);
        if let Motion::Jitter(count, px) = self.motion {
            let point = |i| PixelPoint {
                t_s: 0.0,
                dx_px: px * (2.0 * unit(i, 10) - 1.0),
                dy_px: px * (2.0 * unit(i, 11) - 1.0),
                roll_rad: 1e-3 * (2.0 * unit(i, 12) - 1.0),
            };
            let path = PixelPath::samples((0..count).map(point).collect()).expect("a path");
            planner.motion_mut().image_path = Some(path);
        }
        if let Motion::Roll(turn_rad) = self.motion {
            const STEPS: u32 = 48;
            let point = |i: u32| PixelPoint {
                t_s: 0.0,
                dx_px: 0.0,
                dy_px: 0.0,
                roll_rad: turn_rad * (f64::from(i) / f64::from(STEPS - 1) - 0.5),
            };
            planner.motion_mut().image_path =
                Some(PixelPath::samples((0..STEPS).map(point).collect()).expect("a path"));
        }
        planner
    }

    /// Returns random stars all over the detector and up to 10 px beyond its edges.
    pub fn stars(&self, count: u32) -> Vec<Source> {
        let place = |i, stream, size: usize| unit(i, stream) * (size as f64 + 20.0) - 10.5;
        let [width, height] = self.size;
        (0..count)
            .map(|i| star(i, 300.0 + 2e4 * unit(i, 0).powi(4), [place(i, 1, width), place(i, 2, height)]))
            .collect()
    }
}

/// Returns a star at a place on the detector.
pub fn star(id: u32, electrons: f64, px: [f64; 2]) -> Source {
    Source { id, electrons, mag: f32::NAN, place: SourcePlace::Pixel(px) }
}

/// Draws on the CPU.
pub fn draw_cpu(plan: &ExposurePlan, [width, height]: [usize; 2]) -> Image<f32> {
    let mut cpu = Cpu::new(width, height);
    cpu.render(plan).expect("the CPU draws");
    let Electrons::Host(image) = cpu.electrons() else { panic!("the CPU draws on the host") };
    image.clone()
}

/// Draws on the GPU and reads the image back.
pub fn draw_gpu(gpu: &mut Gpu, plan: &ExposurePlan, [width, height]: [usize; 2]) -> Image<f32> {
    gpu.render(plan).expect("the GPU draws");
    let mut image = Image::new(width, height);
    gpu.read_electrons(&mut image).expect("the image comes back");
    image
}

/// How two electron images differ.
#[derive(Debug, Clone, Copy)]
pub struct Difference {
    /// Largest pixel difference, e-.
    pub largest_e: f64,
    /// Largest pixel of the first image, e-.
    pub peak_e: f64,
    /// Difference of the sums over the first sum.
    pub flux_rel: f64,
}

impl Difference {
    pub fn between(a: &Image<f32>, b: &Image<f32>) -> Self {
        assert_eq!(a.pixels().len(), b.pixels().len(), "images of one size");
        let sum = |image: &Image<f32>| image.pixels().iter().map(|v| f64::from(*v)).sum::<f64>();
        let pairs = a.pixels().iter().zip(b.pixels());
        let largest_e = pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs()).fold(0.0, f64::max);
        let peak_e = a.pixels().iter().map(|v| f64::from(*v)).fold(0.0, f64::max);
        Self { largest_e, peak_e, flux_rel: (sum(b) - sum(a)) / sum(a).max(1.0) }
    }

    /// Returns true if no pixel is off by more than `share` of the peak and `floor_e`, and the flux agrees to `flux`.
    pub fn within(&self, share: f64, floor_e: f64, flux: f64) -> bool {
        self.largest_e <= share * self.peak_e + floor_e && self.flux_rel.abs() <= flux
    }
}

/// How two DN images differ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DnDifference {
    /// Largest difference, DN.
    pub largest_dn: u16,
    /// Share of the pixels that differ.
    pub share: f64,
}

impl DnDifference {
    pub fn between(a: &DnImage, b: &DnImage) -> Self {
        assert_eq!(a.pixels().len(), b.pixels().len(), "images of one size");
        let differences = || a.pixels().iter().zip(b.pixels()).map(|(a, b)| a.abs_diff(*b));
        let differing = differences().filter(|d| *d != 0).count();
        Self { largest_dn: differences().max().unwrap_or(0), share: differing as f64 / a.pixels().len() as f64 }
    }

    /// Returns true if no pixel is off by more than 1 DN and no more than `share` of them differ.
    pub fn within(&self, share: f64) -> bool {
        self.largest_dn <= 1 && self.share <= share
    }
}

/// Returns a detector with every effect switched on.
pub fn detector([width, height]: [usize; 2], gain_e_per_dn: f64, seed: u64) -> Detector {
    let params = DetectorParams {
        full_well_e: 1e5,
        gain_e_per_dn,
        bits: 16,
        black_level_dn: 100.0,
        read_noise_e_rms: 10.0,
        dark_e_per_s: 30.0,
        prnu: 0.01,
        dsnu_e_rms: 2.0,
        ..DetectorParams::QUIET
    };
    Detector::new(params, width, height, seed)
}
