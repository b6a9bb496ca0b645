//! ms per frame of the four scenes on every backend, electrons only: planning and drawing together, and apart.
//!
//! S1: 1024 x 1024, 100 stars. S2: 5,000 stars. S3: 2048 x 2048, 100,000 stars. S4: S2 with a path of 64 samples.
//! Gaussian PSF of 0.8 px, isolated and crowded stars alike, methods by the planner.
#![allow(missing_docs, reason = "criterion's macros make undocumented functions")]

use base::accuracy::AccuracyBudget;
use base::axes::Rotation;
use base::random::philox;
use base::time::Tai;
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use plan::attitude::LosPath;
use plan::exposure::cost::CostModel;
use plan::exposure::{Instrument, Planner, Source, SourcePlace};
use plan::exposure::{MethodChoice, PixelPath, PixelPoint, PsfSampling, Shutter};
use plan::optics::{Illumination, PsfModel};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};
use starloop_image::gpu::{AdapterChoice, GpuDevice};
use starloop_image::render::Backend;
use starloop_image::render::cpu::Cpu;
use starloop_image::render::gpu::Gpu;

/// One scene.
struct Scene {
    name: &'static str,
    size: usize,
    stars: u32,
    samples: u32,
}

const SCENES: [Scene; 4] = [
    Scene { name: "S1", size: 1024, stars: 100, samples: 0 },
    Scene { name: "S2", size: 1024, stars: 5_000, samples: 0 },
    Scene { name: "S3", size: 2048, stars: 100_000, samples: 0 },
    Scene { name: "S4", size: 1024, stars: 5_000, samples: 64 },
];

fn unit(i: u32, stream: u32) -> f64 {
    f64::from(philox([i, stream, 0, 0], [1, 2])[0]) / 4_294_967_296.0
}

impl Scene {
    fn planner(&self, cost: CostModel) -> Planner {
        let middle = 0.5 * (self.size as f64 - 1.0);
        let camera = CameraGeometry::new(CameraParameters {
            width_px: self.size,
            height_px: self.size,
            focal_px: [2900.0; 2],
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
        let los = LosPath::commanded(Rotation::IDENTITY, Tai::from_ns(0), 0.1);
        let mut planner = Planner::new(instrument, AccuracyBudget::default(), cost, MethodChoice::Auto, los);
        if self.samples > 0 {
            let at = |i, stream| 3.0 * (unit(i, stream) - 0.5);
            let point = |i| PixelPoint { t_s: 0.0, dx_px: at(i, 10), dy_px: at(i, 11), roll_rad: 0.0 };
            let path = PixelPath::samples((0..self.samples).map(point).collect()).expect("a path");
            planner.motion_mut().image_path = Some(path);
        }
        planner
    }

    fn sources(&self) -> Vec<Source> {
        let at = |i, stream| unit(i, stream) * self.size as f64 - 0.5;
        (0..self.stars)
            .map(|id| Source {
                id,
                electrons: 200.0 + 5000.0 * unit(id, 0).powi(4),
                mag: f32::NAN,
                place: SourcePlace::Pixel([at(id, 1), at(id, 2)]),
            })
            .collect()
    }
}

fn cpu(c: &mut Criterion) {
    let mut group = c.benchmark_group("cpu");
    group.sample_size(30);
    for scene in &SCENES {
        let (sources, mut planner) = (scene.sources(), scene.planner(CostModel::CPU));
        let mut backend = Cpu::new(scene.size, scene.size);
        group.bench_function(BenchmarkId::new("plan and draw", scene.name), |b| {
            b.iter(|| backend.render(planner.plan(&sources)).expect("draws"));
        });
        let plan = planner.plan(&sources).clone();
        println!("{}: {}, predicted {:.3} ms", scene.name, plan.chosen.method, plan.chosen.cost_ms);
        group
            .bench_function(BenchmarkId::new("draw", scene.name), |b| b.iter(|| backend.render(&plan).expect("draws")));
    }
    group.finish();
}

/// Measures the GPU, whichever is installed; drawing is waited for.
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
    for scene in &SCENES {
        let (sources, mut planner) = (scene.sources(), scene.planner(cost));
        let mut backend = Gpu::new(device.clone(), scene.size, scene.size).expect("a backend");
        group.bench_function(BenchmarkId::new("plan and draw", scene.name), |b| {
            b.iter(|| {
                backend.render(planner.plan(&sources)).expect("draws");
                device.wait().expect("finishes");
            });
        });
        let chosen = planner.latest().chosen;
        println!("{}: {}, predicted {:.3} ms", scene.name, chosen.method, chosen.cost_ms);
    }
    group.finish();
}

criterion_group!(benches, cpu, gpu);
criterion_main!(benches);
