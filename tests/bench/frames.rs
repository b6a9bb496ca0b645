//! ms per frame: 1024 x 1024, {100, 2k, 10k} stars x {1, 16, 64} path samples, mean image and full noise, per backend.
#![allow(missing_docs, reason = "criterion's macros make undocumented functions")]

use base::time::{Span, Tai};
use base::{accuracy::AccuracyBudget, axes::Rotation, image::DnImage, random::philox};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use plan::attitude::{JitterTrack, LosPath, PathOrigin};
use plan::exposure::cost::CostModel;
use plan::exposure::{
    Instrument, MethodChoice, PixelPath, PixelPoint, Planner, PsfSampling, Shutter, Source, SourcePlace,
};
use plan::optics::{Illumination, PsfModel};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};
use starloop_image::detector::{Detector, DetectorConditions, DetectorParams};
use starloop_image::gpu::{AdapterChoice, Electrons, GpuDevice};
use starloop_image::{detector::gpu::GpuDetector, render::Backend, render::cpu::Cpu, render::gpu::Gpu};

const SIZE: usize = 1024;

fn unit(i: u32, stream: u32) -> f64 {
    f64::from(philox([i, stream, 0, 0], [1, 2])[0]) / 4_294_967_296.0
}

fn los() -> LosPath {
    LosPath {
        exposure_start: Tai::from_ns(0),
        exposure_s: 0.1,
        mid_sensor_from_icrf: Rotation::IDENTITY,
        rate_rad_s: glam::DVec3::ZERO,
        acceleration_rad_s2: glam::DVec3::ZERO,
        jitter: JitterTrack::none(),
        origin: PathOrigin::Commanded,
        horizon: Span::ZERO,
    }
}

fn planner(cost: CostModel, samples: u32, method: &str) -> Planner {
    let camera = CameraGeometry::new(CameraParameters {
        width_px: SIZE,
        height_px: SIZE,
        focal_px: [2900.0; 2],
        principal_point_px: [511.5; 2],
        distortion: BrownConrady::default(),
    })
    .expect("a camera");
    let instrument = Instrument {
        camera,
        psf: PsfModel::gaussian(0.8),
        full_well_e: 1e5,
        read_noise_e_rms: 10.0,
        shutter: Shutter::Global,
        sampling: PsfSampling::Auto,
        illumination: Illumination::EVEN,
    };
    let choice: MethodChoice = method.parse().expect("a method");
    let mut planner = Planner::new(instrument, AccuracyBudget::default(), cost, choice, los());
    let rms = if samples == 1 { 0.0 } else { 1.0 };
    let point = |i| PixelPoint {
        t_s: 0.0,
        dx_px: rms * 1.7 * (2.0 * unit(i, 10) - 1.0),
        dy_px: rms * 1.7 * (2.0 * unit(i, 11) - 1.0),
        roll_rad: 0.0,
    };
    planner.motion_mut().image_path = Some(PixelPath::samples((0..samples).map(point).collect()).expect("a path"));
    planner
}

fn sources(count: u32) -> Vec<Source> {
    (0..count)
        .map(|i| Source {
            id: i,
            mag: f32::NAN,
            electrons: 200.0 + 5000.0 * unit(i, 0).powi(4),
            place: SourcePlace::Pixel([unit(i, 1) * SIZE as f64, unit(i, 2) * SIZE as f64]),
        })
        .collect()
}

fn detector() -> Detector {
    let params = DetectorParams {
        full_well_e: 1e5,
        gain_e_per_dn: 2.0,
        bits: 16,
        black_level_dn: 100.0,
        read_noise_e_rms: 10.0,
        dark_e_per_s: 30.0,
        prnu: 0.01,
        dsnu_e_rms: 2.0,
        ..DetectorParams::QUIET
    };
    Detector::new(params, SIZE, SIZE, 1)
}

/// Returns the cases every backend is measured with.
fn cases() -> impl Iterator<Item = (u32, u32, String)> {
    [100, 2_000, 10_000].into_iter().flat_map(|stars| {
        [1, 16, 64].into_iter().flat_map(move |samples| {
            ["auto".into(), format!("samples:{samples}")].into_iter().map(move |method| (stars, samples, method))
        })
    })
}

/// Measures the GPU, whichever is installed: drawing alone (waited for), and drawing, noise and readback.
fn gpu_frames(c: &mut Criterion) {
    let device = match GpuDevice::open(&AdapterChoice::Best) {
        Ok(device) => device,
        Err(error) => {
            println!("SKIPPED: {error}");
            return;
        }
    };
    println!("GPU: {}", device.description());
    let cost = if device.is_software() { CostModel::SOFTWARE_GPU } else { CostModel::GPU };
    let mut gpu = Gpu::new(device.clone(), SIZE, SIZE).expect("a backend");
    let mut readout = GpuDetector::new(device.clone(), &detector(), SIZE, SIZE).expect("a detector");
    let mut dn = DnImage::new(SIZE, SIZE);
    let mut group = c.benchmark_group("gpu");
    group.sample_size(20);
    for (stars, samples, method) in cases() {
        let sources = sources(stars);
        let mut planner = planner(cost, samples, &method);
        let id = format!("{stars} stars x {samples}, {method}");
        group.bench_function(BenchmarkId::new("mean", &id), |b| {
            b.iter(|| {
                gpu.render(planner.plan(&sources)).expect("draws");
                device.wait().expect("finishes");
            });
        });
        group.bench_function(BenchmarkId::new("noise", &id), |b| {
            b.iter(|| {
                gpu.render(planner.plan(&sources)).expect("draws");
                readout.collect(gpu.device_electrons(), 1, &DetectorConditions::dark(0.1), &mut dn).expect("reads out");
            });
        });
    }
    group.finish();
}

fn frames(c: &mut Criterion) {
    let mut cpu = Cpu::new(SIZE, SIZE);
    let mut detector = detector();
    let mut dn = DnImage::new(SIZE, SIZE);
    let mut group = c.benchmark_group("cpu");
    group.sample_size(20);
    for stars in [100, 2_000, 10_000] {
        let sources = sources(stars);
        for samples in [1, 16, 64] {
            for method in ["auto", "samples"] {
                let method = if method == "samples" { format!("samples:{samples}") } else { method.into() };
                let mut planner = planner(CostModel::CPU, samples, &method);
                let id = format!("{stars} stars x {samples}, {method}");
                group.bench_function(BenchmarkId::new("mean", &id), |b| {
                    b.iter(|| cpu.render(planner.plan(&sources)).expect("draws"));
                });
                group.bench_function(BenchmarkId::new("noise", &id), |b| {
                    b.iter(|| {
                        cpu.render(planner.plan(&sources)).expect("draws");
                        let Electrons::Host(mean) = cpu.electrons() else { unreachable!("the CPU draws on the host") };
                        detector.collect(mean, 1, &DetectorConditions::dark(0.1), &mut dn);
                    });
                });
            }
        }
    }
    group.finish();
    c.bench_function("plan 10000 stars x 64", |b| {
        let sources = sources(10_000);
        let mut planner = planner(CostModel::CPU, 64, "auto");
        b.iter(|| planner.plan(&sources).stars.len());
    });
}

/// Starts the threads that draw as the program does: this one is the first of them.
fn start_threads(_: &mut Criterion) {
    rayon::ThreadPoolBuilder::new().use_current_thread().build_global().expect("no threads before");
}

criterion_group!(benches, start_threads, frames, gpu_frames);
criterion_main!(benches);
