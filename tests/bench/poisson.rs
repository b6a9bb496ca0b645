//! ns per pixel of every Poisson method: one million flat pixels through a detector with shot noise alone, on one
//! thread. The same with no light at all is the rest of the detector.
#![allow(missing_docs, reason = "criterion's macros make undocumented functions")]

use base::image::{DnImage, Image};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use starloop_image::detector::{Detector, DetectorConditions, DetectorParams, PoissonMethod};

const SIZE: usize = 1000;

fn detector(poisson: PoissonMethod) -> Detector {
    let params = DetectorParams { gain_e_per_dn: 100.0, poisson, ..DetectorParams::QUIET };
    Detector::new(params, SIZE, SIZE, 1)
}

fn methods(c: &mut Criterion) {
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let mut dn = DnImage::new(SIZE, SIZE);
    let mut group = c.benchmark_group("poisson");
    group.sample_size(10).throughput(Throughput::Elements((SIZE * SIZE) as u64));
    for (method, lambda) in [
        (PoissonMethod::Auto, 0.0_f32),
        // Denormal numbers, and means whose powers would be: as fast as no light.
        (PoissonMethod::Auto, 1e-40),
        (PoissonMethod::Auto, 1e-9),
        (PoissonMethod::Inversion, 1.0),
        (PoissonMethod::Inversion, 10.0),
        (PoissonMethod::Inversion, 19.0),
        (PoissonMethod::CornishFisher, 1000.0),
        (PoissonMethod::Ptrs, 10.0),
        (PoissonMethod::Ptrs, 1000.0),
        (PoissonMethod::Ptrs, 1e6),
        (PoissonMethod::RoundedNormal, 1000.0),
    ] {
        let mut detector = detector(method);
        let mut mean = Image::new(SIZE, SIZE);
        mean.pixels_mut().fill(lambda);
        group.bench_function(BenchmarkId::new(method.name(), lambda), |b| {
            b.iter(|| one_thread.install(|| detector.collect(&mean, 1, &DetectorConditions::dark(0.1), &mut dn)));
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().warm_up_time(std::time::Duration::from_millis(300)).measurement_time(std::time::Duration::from_secs(1));
    targets = methods
}
criterion_main!(benches);
