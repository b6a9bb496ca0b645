//! ms per frame of eight scenes on every backend, electrons only: planning and drawing together, and apart.
//!
//! S1: 1024 x 1024, 100 stars. S2: 5,000 stars. S3: 2048 x 2048, 100,000 stars. S4: S2 with a path of 64 samples.
//! S5: S4 with stars over four decades of brightness, the brightest just unsaturated. S6: S5 where the same path is
//! jitter of the attitude, which perspective makes different all over the field. S7: S2 with a path of 20,001 rows.
//! S8: 2048 x 2048, 330,000 stars in 2.5 degrees, jitter of 0.5 px. Gaussian PSF of 0.8 px, isolated and crowded stars
//! alike, methods by the planner. For S1, S2, S4 and S5 the sum of all pixel errors relative to the light
//! (L1) is printed, against the f64 reference.
#![allow(missing_docs, reason = "criterion's macros make undocumented functions")]

use base::{accuracy::AccuracyBudget, axes::Rotation, clock::Stopwatch, random::philox, time::Tai};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use glam::DVec3;
use plan::attitude::{JitterLine, JitterPoint, LosPath};
use plan::exposure::cost::CostModel;
use plan::exposure::{
    ExposurePlan, Instrument, MethodChoice, PixelPath, PixelPoint, Planner, PsfSampling, Shutter, Source, SourcePlace,
};
use plan::optics::{Illumination, PsfModel};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};
use starloop_image::gpu::{AdapterChoice, Electrons, GpuDevice};
use starloop_image::render::{Backend, cpu::Cpu, gpu::Gpu, reference::Reference};
use std::time::Duration;

/// Motion of a scene during the exposure.
#[derive(Clone, Copy)]
enum Moves {
    /// None.
    Still,
    /// Positions of the image, all with one weight.
    Samples(u32),
    /// The same positions as rotations of the line of sight, straight in between.
    Walk(u32),
    /// Rows of a smooth path in time.
    Rows(u32),
    /// A sinusoid of this amplitude, px.
    Sinusoid(f64),
}

/// One scene.
struct Scene {
    name: &'static str,
    size: usize,
    focal_px: f64,
    stars: u32,
    /// True: stars over four decades of brightness.
    is_wide: bool,
    moves: Moves,
}

const S2: Scene = Scene { name: "S2", size: 1024, focal_px: 2900.0, stars: 5_000, is_wide: false, moves: Moves::Still };

const SCENES: [Scene; 8] = [
    Scene { name: "S1", stars: 100, ..S2 },
    S2,
    Scene { name: "S3", size: 2048, stars: 100_000, ..S2 },
    Scene { name: "S4", moves: Moves::Samples(64), ..S2 },
    Scene { name: "S5", moves: Moves::Samples(64), is_wide: true, ..S2 },
    Scene { name: "S6", moves: Moves::Walk(64), is_wide: true, ..S2 },
    Scene { name: "S7", moves: Moves::Rows(20_001), ..S2 },
    Scene { name: "S8", size: 2048, focal_px: 46_900.0, stars: 330_000, is_wide: true, moves: Moves::Sinusoid(0.5) },
];
/// Exposure, s.
const EXPOSURE_S: f64 = 0.1;
/// Electrons of the faintest and the brightest star over four decades: the brightest fills its brightest pixel.
const WIDE_E: [f64; 2] = [45.0, 4.5e5];

fn unit(i: u32, stream: u32) -> f64 {
    f64::from(philox([i, stream, 0, 0], [1, 2])[0]) / 4_294_967_296.0
}

impl Scene {
    /// Returns true when the reference draws the scene in a few seconds.
    fn is_compared(&self) -> bool {
        self.stars <= 5_000 && !matches!(self.moves, Moves::Rows(_) | Moves::Walk(_))
    }

    /// Returns true when `STARLOOP_SCENES` is not set, or names the scene, such as `S4,S5`.
    fn is_asked_for(&self) -> bool {
        std::env::var("STARLOOP_SCENES").map_or(true, |names| names.split(',').any(|name| name == self.name))
    }

    fn planner(&self, cost: CostModel) -> Planner {
        let middle = 0.5 * (self.size as f64 - 1.0);
        let camera = CameraGeometry::new(CameraParameters {
            width_px: self.size,
            height_px: self.size,
            focal_px: [self.focal_px; 2],
            principal_point_px: [middle; 2],
            distortion: BrownConrady::default(),
        })
        .expect("a camera");
        let instrument = Instrument {
            camera,
            shutter: Shutter::Global,
            psf: PsfModel::gaussian(0.8),
            sampling: PsfSampling::Auto,
            illumination: Illumination::EVEN,
            full_well_e: 1e5,
            read_noise_e_rms: 10.0,
        };
        let los = LosPath::commanded(Rotation::IDENTITY, Tai::from_ns(0), EXPOSURE_S);
        let mut planner = Planner::new(instrument, AccuracyBudget::default(), cost, MethodChoice::Auto, los);
        let motion = planner.motion_mut();
        let at = |i, stream| 3.0 * (unit(i, stream) - 0.5);
        match self.moves {
            Moves::Still => {}
            Moves::Samples(count) => {
                let point = |i| PixelPoint { t_s: 0.0, dx_px: at(i, 10), dy_px: at(i, 11), roll_rad: 0.0 };
                motion.image_path = Some(PixelPath::samples((0..count).map(point).collect()).expect("a path"));
            }
            Moves::Walk(count) => {
                let point = |i| JitterPoint {
                    at: Tai::from_ns(i64::from(i) * 100_000_000 / i64::from(count - 1)),
                    rotation_rad: DVec3::new(at(i, 10), at(i, 11), 0.0) / self.focal_px,
                };
                motion.los.jitter.points = (0..count).map(point).collect();
            }
            Moves::Rows(count) => {
                let point = |i| {
                    let share = f64::from(i) / f64::from(count - 1);
                    let [x, y] = [7.3 * share, 4.1 * share].map(|turn| (core::f64::consts::TAU * turn).sin());
                    PixelPoint { t_s: share * EXPOSURE_S, dx_px: x, dy_px: 0.7 * y, roll_rad: 0.0 }
                };
                let rows = (0..count).map(point).collect();
                motion.image_path = Some(PixelPath::line(rows, EXPOSURE_S).expect("a path"));
            }
            Moves::Sinusoid(amplitude_px) => {
                motion.los.jitter.lines = vec![JitterLine {
                    frequency_hz: 2.25 / EXPOSURE_S,
                    amplitude_rad: DVec3::new(0.28, -0.96, 0.0) * (amplitude_px / self.focal_px),
                    phase_rad: 0.4,
                }];
            }
        }
        planner
    }

    fn sources(&self) -> Vec<Source> {
        let at = |i, stream| unit(i, stream) * self.size as f64 - 0.5;
        let electrons = |id| match WIDE_E {
            [least_e, most_e] if self.is_wide => least_e * (most_e / least_e).powf(unit(id, 0)),
            _ => 200.0 + 5000.0 * unit(id, 0).powi(4),
        };
        (0..self.stars)
            .map(|id| Source {
                id,
                electrons: electrons(id),
                mag: f32::NAN,
                place: SourcePlace::Pixel([at(id, 1), at(id, 2)]),
            })
            .collect()
    }
}

/// Returns the sum of all pixel errors of the latest image, relative to its light.
fn l1_error(backend: &Cpu, plan: &ExposurePlan) -> f64 {
    let mut reference = Reference::new(plan.camera.width_px(), plan.camera.height_px());
    reference.render(plan).expect("draws");
    let (Electrons::Host(image), Electrons::Precise(truth)) = (backend.electrons(), reference.electrons()) else {
        return f64::NAN;
    };
    let apart: f64 = image.pixels().iter().zip(truth.pixels()).map(|(a, b)| (f64::from(*a) - b).abs()).sum();
    apart / truth.pixels().iter().sum::<f64>()
}

fn cpu(c: &mut Criterion) {
    let mut group = c.benchmark_group("cpu");
    group.sample_size(30);
    for scene in SCENES.iter().filter(|scene| scene.is_asked_for()) {
        let (sources, mut planner) = (scene.sources(), scene.planner(CostModel::CPU));
        let mut backend = Cpu::new(scene.size, scene.size);
        group.bench_function(BenchmarkId::new("plan and draw", scene.name), |b| {
            b.iter(|| backend.render(planner.plan(&sources)).expect("draws"));
        });
        let plan = planner.plan(&sources).clone();
        println!("{}: predicted {:.3} ms", scene.name, plan.chosen.cost_ms);
        for class in &plan.classes {
            let (stars, chosen) = (class.stars, &class.chosen);
            println!("    {stars} stars up to {:.0} e-: {}, {:?}", class.brightest_e, chosen.method, chosen.verdict);
        }
        if scene.is_compared() {
            backend.render(&plan).expect("draws");
            println!("    L1 error {:.2e}", l1_error(&backend, &plan));
        }
        group.bench_function(BenchmarkId::new("plan", scene.name), |b| b.iter(|| planner.plan(&sources).stars.len()));
        group
            .bench_function(BenchmarkId::new("draw", scene.name), |b| b.iter(|| backend.render(&plan).expect("draws")));
    }
    group.finish();
}

/// Measures the GPU, whichever is installed; drawing is waited for. "prepare and hand over" is the host's share of drawing.
fn gpu(c: &mut Criterion) {
    let device = match GpuDevice::open(&AdapterChoice::Best) {
        Ok(device) => device,
        Err(error) => {
            println!("SKIPPED: {error}");
            return;
        }
    };
    println!("GPU: {}", device.description());
    let cost = if device.is_software() { CostModel::SOFTWARE_GPU } else { CostModel::GPU };
    let mut group = c.benchmark_group("gpu");
    group.sample_size(20);
    for scene in SCENES.iter().filter(|scene| scene.is_asked_for()) {
        let (sources, mut planner) = (scene.sources(), scene.planner(cost));
        let mut backend = Gpu::new(device.clone(), scene.size, scene.size).expect("a backend");
        group.bench_function(BenchmarkId::new("plan and draw", scene.name), |b| {
            b.iter(|| {
                backend.render(planner.plan(&sources)).expect("draws");
                device.wait().expect("finishes");
            });
        });
        let plan = planner.plan(&sources).clone();
        println!("{}: {}, predicted {:.3} ms", scene.name, plan.chosen.method, plan.chosen.cost_ms);
        group.bench_function(BenchmarkId::new("plan", scene.name), |b| b.iter(|| planner.plan(&sources).stars.len()));
        group.bench_function(BenchmarkId::new("draw", scene.name), |b| {
            b.iter(|| {
                backend.render(&plan).expect("draws");
                device.wait().expect("finishes");
            });
        });
        group.bench_function(BenchmarkId::new("prepare and hand over", scene.name), |b| {
            b.iter_custom(|rounds| {
                let mut host = Duration::ZERO;
                for _ in 0..rounds {
                    let mut watch = Stopwatch::start();
                    backend.render(&plan).expect("draws");
                    host += Duration::from_secs_f64(watch.lap().s());
                    device.wait().expect("finishes");
                }
                host
            });
        });
    }
    group.finish();
}

/// Starts the threads that draw as the program does: this one is the first of them.
fn start_threads(_: &mut Criterion) {
    rayon::ThreadPoolBuilder::new().use_current_thread().build_global().expect("no threads before");
}

criterion_group!(benches, start_threads, cpu, gpu);
criterion_main!(benches);
