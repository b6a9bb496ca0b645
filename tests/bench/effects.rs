//! The time that every pixel-local effect adds to the detector's readout: one flat million pixels on one thread, effect
//! by effect.
#![allow(missing_docs, reason = "criterion's macros make undocumented functions")]

use base::image::{DnImage, Image};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use starloop_image::detector::{Detector, DetectorConditions, DetectorParams, LinePattern, Nonlinearity, RowNoise};

const SIZE: usize = 1000;

/// Returns the full noise, and each effect on top of it.
fn cases() -> Vec<(&'static str, DetectorParams)> {
    let base = DetectorParams {
        full_well_e: 6e4,
        gain_e_per_dn: 2.0,
        black_level_dn: 100.0,
        read_noise_e_rms: 10.0,
        dark_e_per_s: 30.0,
        prnu: 0.01,
        dsnu_e_rms: 2.0,
        ..DetectorParams::QUIET
    };
    let knots = [[1e4, 9.9e3], [2e4, 1.97e4], [3e4, 2.9e4], [5e4, 4.5e4]];
    let nonlinearity = Nonlinearity::through(&knots).expect("rising");
    let columns = LinePattern { column_e_rms: 1.0, column_gain_rms: 0.01, row_e_rms: 0.0 };
    let row_noise = RowNoise { e_rms: 1.0, corner_cycles_per_row: 0.1 };
    vec![
        ("none", base),
        ("dark non-uniformity", DetectorParams { dark_nonuniformity: 0.2, ..base }),
        ("nonlinearity", DetectorParams { nonlinearity, ..base }),
        ("columns", DetectorParams { line_pattern: columns, ..base }),
        ("rows", DetectorParams { line_pattern: LinePattern { row_e_rms: 1.0, ..LinePattern::OFF }, ..base }),
        ("row noise", DetectorParams { row_noise, ..base }),
        ("amplifier noise", DetectorParams { amplifier_noise_e_rms: 3.0, ..base }),
    ]
}

fn effects(c: &mut Criterion) {
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let (mean, mut dn) = (Image::new(SIZE, SIZE), DnImage::new(SIZE, SIZE));
    let mut group = c.benchmark_group("effects");
    group.sample_size(10).throughput(Throughput::Elements((SIZE * SIZE) as u64));
    for (name, params) in cases() {
        let mut detector = Detector::new(params, SIZE, SIZE, 1);
        group.bench_function(name, |b| {
            b.iter(|| one_thread.install(|| detector.collect(&mean, 1, &DetectorConditions::dark(0.1), &mut dn)));
        });
        if name == "none" {
            detector.keep_charge();
            group.bench_function("two passes", |b| {
                b.iter(|| one_thread.install(|| detector.collect(&mean, 1, &DetectorConditions::dark(0.1), &mut dn)));
            });
        }
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().warm_up_time(std::time::Duration::from_millis(300)).measurement_time(std::time::Duration::from_secs(1));
    targets = effects
}
criterion_main!(benches);
