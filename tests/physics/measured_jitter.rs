//! A measured record of jitter at 10 kHz, from its text to drawn frames: the image smears as the record's band powers
//! say.

use crate::scene::{
    EXPOSURE_S, FOCAL_PX, Picture, camera, draw_cpu, draw_reference, instrument, los, planner_of, star,
};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use core::{f64::consts::TAU, fmt::Write};
use glam::DQuat;
use plan::attitude::{
    HistoryLimits, JitterHistory, JitterRecord, LosPath, RecordEnd, RecordedJitter, band_power_rad2, read_series,
    smear_power_rad2,
};
use plan::optics::PsfModel;
use std::sync::Arc;

const SIZE: usize = 48;
const SIGMA_PX: f64 = 1.2;
const ELECTRONS: f64 = 1e5;
/// Largest relative difference of second moments.
const MOMENTS: f64 = 0.02;
/// Amplitudes about x and y in arcsec, frequency in Hz, phase.
const TONES: [([f64; 2], f64, f64); 6] = [
    ([40.0, 20.0], 13.0, 0.3),
    ([25.0, 30.0], 171.0, 1.1),
    ([30.0, 25.0], 994.0, 2.0),
    ([25.0, 30.0], 1995.0, -0.4),
    ([30.0, 20.0], 3207.0, 0.2),
    ([20.0, 35.0], 4371.0, 0.9),
];

/// Returns the text of a record of some seconds, every `every`-th row of 10 kHz.
fn text(scale: f64, every: usize) -> String {
    let mut text = "t_s,x_arcsec,y_arcsec\n".to_owned();
    for row in (0..40_000).step_by(every) {
        let t_s = f64::from(row) * 1e-4;
        let at = |axis: usize, quarter: f64| {
            TONES.iter().map(|(a, hz, phase)| scale * a[axis] * (TAU * hz * t_s + phase + quarter).sin()).sum::<f64>()
        };
        writeln!(text, "{t_s:.4},{:.6},{:.6}", at(0, 0.0), at(1, 1.0)).expect("text grows");
    }
    text
}

fn record(text: &str) -> Arc<JitterRecord> {
    Arc::new(read_series(text, RecordEnd::Still).expect("a record"))
}

/// Returns the variance of a picture along x and y together, px^2.
fn spread_px2(picture: &Picture) -> f64 {
    let (mut sums, mut flux) = ([0.0; 4], 0.0);
    for i in 0..SIZE * SIZE {
        let (x, y) = (i % SIZE, i / SIZE);
        let value = picture.at(x, y);
        flux += value;
        let [x, y] = [x, y].map(|place| place as f64 - 23.5);
        for (sum, term) in sums.iter_mut().zip([x, y, x * x, y * y]) {
            *sum += value * term;
        }
    }
    let [x, y, xx, yy] = sums.map(|sum| sum / flux);
    xx + yy - x * x - y * y
}

/// Returns how much wider a frame of this exposure is than a still one, px^2: by the reference and by the automatic
/// method.
fn smear_px2(record: Option<&Arc<JitterRecord>>, start_s: f64) -> [f64; 2] {
    let mut history = JitterHistory::new(HistoryLimits::default(), Span::from_ms(5));
    if let Some(record) = record {
        history.set_record(RecordedJitter {
            record: Arc::clone(record),
            start: Tai::from_ns(0) - Span::from_s(start_s),
            sensor_from_record: DQuat::IDENTITY,
            exposure_s: EXPOSURE_S,
        });
    }
    let mut los = LosPath { jitter: history.new_track(), ..los() };
    history.fill(los.exposure_start, los.exposure_start + Span::from_s(EXPOSURE_S), &mut los.jitter);
    let psf = PsfModel::gaussian(SIGMA_PX);
    let mut planner = planner_of(instrument(camera(SIZE), &psf), "auto", los, None);
    let plan = planner.plan(&[star(0, ELECTRONS, [23.3, 24.1])]).clone();
    [draw_reference(&plan), draw_cpu(&plan)].map(|picture| spread_px2(&picture))
}

/// Starts of exposures in the record, s.
fn starts_s() -> impl Iterator<Item = f64> {
    (0..12).map(|i| 0.2 + 0.2837 * f64::from(i))
}

/// Returns the mean smear of the frames, px^2.
fn mean_smear_px2(record: &Arc<JitterRecord>) -> [f64; 2] {
    let still = smear_px2(None, 0.0);
    let frames = starts_s().map(|start_s| smear_px2(Some(record), start_s));
    let sums = frames.fold([0.0; 2], |sums, frame| [sums[0] + frame[0] - still[0], sums[1] + frame[1] - still[1]]);
    sums.map(|sum| sum / starts_s().count() as f64)
}

#[test]
fn frames_smear_as_the_band_powers_of_a_10_khz_record_say() {
    let record = record(&text(1.0, 1));
    let spectrum = record.spectrum();
    // By hand: half the squares of the amplitudes.
    for (band, tones) in [([0.0, 100.0], 0..1), ([100.0, 1500.0], 1..3), ([1500.0, 5001.0], 3..6)] {
        let wanted: f64 = TONES[tones].iter().map(|(a, ..)| 0.5 * (a[0] * a[0] + a[1] * a[1])).sum();
        let found = band_power_rad2(&spectrum, band) / (ARCSEC * ARCSEC);
        assert!(((found.x + found.y) / wanted - 1.0).abs() < 0.01, "{band:?}: {found} for {wanted}");
    }
    let predicted = smear_power_rad2(&spectrum, EXPOSURE_S) * (FOCAL_PX * FOCAL_PX);
    let predicted = predicted.x + predicted.y;
    assert!(predicted > 0.5, "control: it smears by {predicted} px^2");
    for smear in mean_smear_px2(&record) {
        assert!((smear / predicted - 1.0).abs() < MOMENTS, "{smear} px^2, predicted {predicted}");
    }
    for (what, wrong) in [("scaled by 1.1", text(1.1, 1)), ("every tenth sample", text(1.0, 10))] {
        let record = self::record(&wrong);
        for smear in mean_smear_px2(&record) {
            assert!((smear / predicted - 1.0).abs() > 2.0 * MOMENTS, "negative control, {what}: {smear}, {predicted}");
        }
    }
}

/// Each frame by itself: the variance of the tones over its own exposure, integrated finely.
#[test]
fn each_frame_has_the_moments_of_its_own_exposure() {
    let record = record(&text(1.0, 1));
    let still = smear_px2(None, 0.0);
    for start_s in starts_s().take(5) {
        let angle = |t_s: f64, axis: usize| -> f64 {
            let quarter = [0.0, 1.0][axis];
            TONES.iter().map(|(a, hz, phase)| a[axis] * (TAU * hz * t_s + phase + quarter).sin()).sum()
        };
        const STEPS: u32 = 50_000;
        let mut wanted = 0.0;
        for axis in 0..2 {
            let at = |i: u32| angle(start_s + (f64::from(i) + 0.5) / f64::from(STEPS) * EXPOSURE_S, axis);
            let (first, second) = (0..STEPS).fold((0.0, 0.0), |(f, s), i| (f + at(i), s + at(i) * at(i)));
            let [first, second] = [first, second].map(|sum| sum / f64::from(STEPS));
            wanted += (second - first * first) * (ARCSEC * FOCAL_PX) * (ARCSEC * FOCAL_PX);
        }
        for (drawn, still) in smear_px2(Some(&record), start_s).into_iter().zip(still) {
            assert!(((drawn - still) / wanted - 1.0).abs() < MOMENTS, "{start_s} s: {} for {wanted}", drawn - still);
        }
    }
}
