use super::*;
use crate::attitude::{jitter::JitterHistory, ring::HistoryLimits};
use base::units::ARCSEC;

const START: Tai = Tai::from_ns(3_000_000_000);

/// Amplitude (arcsec, about x and y), frequency (Hz) and phase of sinusoids, as functions of time.
type Tones<'a> = &'a [([f64; 2], f64, f64)];

fn signal(tones: Tones<'_>, t_s: f64) -> DVec3 {
    let tone = |([x, y], hz, phase): &([f64; 2], f64, f64)| {
        let angle = TAU * hz * t_s + phase;
        DVec3::new(x * angle.sin(), y * angle.cos(), 0.0) * ARCSEC
    };
    tones.iter().map(tone).sum()
}

fn record(tones: Tones<'_>, rate_hz: f64, duration_s: f64, end: RecordEnd) -> Arc<JitterRecord> {
    let count = whole(rate_hz * duration_s);
    let samples = (0..count).map(|i| signal(tones, i as f64 / rate_hz)).collect();
    Arc::new(JitterRecord::new(1.0 / rate_hz, samples, end).unwrap())
}

fn history(record: Arc<JitterRecord>, exposure_s: f64) -> JitterHistory {
    let mut history = JitterHistory::new(HistoryLimits::default(), Span::from_ms(5));
    let sensor_from_record = DQuat::IDENTITY;
    history.set_record(RecordedJitter { record, start: START, sensor_from_record, exposure_s });
    history
}

fn track(history: &JitterHistory, from_s: f64, exposure_s: f64) -> (JitterTrack, Tai) {
    let from = START + Span::from_s(from_s);
    let mut track = history.new_track();
    history.fill(from, from + Span::from_s(exposure_s), &mut track);
    (track, from)
}

/// Returns the mean and covariance (xx, xy, yy) of a path over an exposure, arcsec.
fn moments(at_s: impl Fn(f64) -> DVec3, exposure_s: f64) -> ([f64; 2], [f64; 3]) {
    const STEPS: u32 = 40_000;
    let points: Vec<DVec3> =
        (0..STEPS).map(|i| at_s((f64::from(i) + 0.5) / f64::from(STEPS) * exposure_s) / ARCSEC).collect();
    let mean = points.iter().sum::<DVec3>() / f64::from(STEPS);
    let sum = |f: &dyn Fn(DVec3) -> f64| points.iter().map(|p| f(*p - mean)).sum::<f64>() / f64::from(STEPS);
    ([mean.x, mean.y], [sum(&|d| d.x * d.x), sum(&|d| d.x * d.y), sum(&|d| d.y * d.y)])
}

const BROAD: Tones<'static> = &[
    ([0.8, 0.3], 13.0, 0.3),
    ([0.5, 0.6], 171.0, 1.1),
    ([0.6, -0.5], 990.0, 2.0),
    ([0.4, 0.7], 2013.0, -0.4),
    ([0.5, 0.2], 4371.0, 0.9),
];

#[test]
fn moments_of_an_exposure_are_those_of_the_signal() {
    let record = record(BROAD, 10_000.0, 60.0, RecordEnd::Still);
    for (exposure_s, from_s) in [(0.01, 2.3), (0.05, 7.1), (0.2, 11.003), (1.0, 20.0), (10.0, 30.0)] {
        let history = history(Arc::clone(&record), exposure_s);
        let (track, from) = track(&history, from_s, exposure_s);
        assert!(track.points.len() <= RECORD_POINTS_MAX && track.lines.len() <= RECORD_LINES, "{exposure_s} s");
        let (mean, covariance) = moments(|t_s| track.rotation_at(from + Span::from_s(t_s)), exposure_s);
        let (wanted_mean, wanted) = moments(|t_s| signal(BROAD, from_s + t_s), exposure_s);
        let spread = wanted[0] + wanted[2];
        for axis in 0..2 {
            let off = (mean[axis] - wanted_mean[axis]).abs();
            assert!(off < 0.01 * spread.sqrt(), "{exposure_s} s: mean off by {off} arcsec");
        }
        for term in 0..3 {
            let off = (covariance[term] - wanted[term]).abs() / spread;
            assert!(off < 0.02, "{exposure_s} s, term {term}: {covariance:?} for {wanted:?}");
        }
    }
}

#[test]
fn a_record_of_every_tenth_sample_and_a_scaled_one_are_found_out() {
    let exposure_s = 0.05;
    let (_, wanted) = moments(|t_s| signal(BROAD, 7.1 + t_s), exposure_s);
    let spread = |record| {
        let (track, from) = track(&history(record, exposure_s), 7.1, exposure_s);
        let (_, [xx, _, yy]) = moments(|t_s| track.rotation_at(from + Span::from_s(t_s)), exposure_s);
        (xx + yy) / (wanted[0] + wanted[2])
    };
    assert!((spread(record(BROAD, 10_000.0, 20.0, RecordEnd::Still)) - 1.0).abs() < 0.02);
    // 990 Hz becomes 10 Hz, 2013 Hz becomes 13 Hz.
    let aliased = spread(record(BROAD, 1000.0, 20.0, RecordEnd::Still));
    assert!((aliased - 1.0).abs() > 0.05, "{aliased}");
    let scaled: Vec<_> = BROAD.iter().map(|([x, y], hz, phase)| ([1.1 * x, 1.1 * y], *hz, *phase)).collect();
    let scaled = spread(record(&scaled, 10_000.0, 20.0, RecordEnd::Still));
    assert!((scaled - 1.21).abs() < 0.03, "{scaled}");
}

/// Returns the largest amplitude of a tone's lines, arcsec. Straight lines between points lose `(2 pi f step)^2 / 6` of
/// its power. Four lines in phase restore it for each column of the covariance, each with its root times `sqrt(1/2)`.
fn largest_of_lines_arcsec(tones: Tones<'_>, step_s: f64) -> f64 {
    let lacking =
        |([x, y], f_hz, _): &([f64; 2], f64, f64)| (TAU * f_hz * step_s).powi(2) / 6.0 * (x * x + y * y) / 2.0;
    4.0 * (0.5 * tones.iter().map(lacking).sum::<f64>()).sqrt()
}

#[test]
fn slow_record_is_followed_point_by_point() {
    let slow: Tones<'_> = &[([1.0, 0.5], 13.0, 0.2), ([0.2, 0.3], 31.0, 1.0)];
    let exposure_s = 0.2;
    for rate_hz in [200.0, 10_000.0] {
        let history = history(record(slow, rate_hz, 20.0, RecordEnd::Still), exposure_s);
        let (track, from) = track(&history, 5.0, exposure_s);
        for i in 0..200 {
            let t_s = f64::from(i) * 1e-3;
            let off = track.rotation_at(from + Span::from_s(t_s)) - signal(slow, 5.0 + t_s);
            let limit_arcsec = largest_of_lines_arcsec(slow, exposure_s / 128.0);
            assert!(limit_arcsec < 0.15, "a tenth of the signal: {limit_arcsec}");
            assert!(
                off.length() < limit_arcsec * ARCSEC,
                "{rate_hz} Hz, {t_s} s: off by {} arcsec",
                off.length() / ARCSEC
            );
        }
    }
}

#[test]
fn a_record_ends_or_repeats_as_it_says() {
    let tones: Tones<'_> = &[([1.0, 0.0], 5.0, 0.7)];
    let exposure_s = 0.1;
    let fill = |end, from_s: f64| {
        let history = history(record(tones, 1000.0, 2.0, end), exposure_s);
        let (mut track, from) = track(&history, from_s, exposure_s);
        let coverage = history.fill(from, from + Span::from_s(exposure_s), &mut track);
        (track.rotation_at(from + Span::from_s(0.03)) / ARCSEC, coverage.missing)
    };
    let (inside, missing) = fill(RecordEnd::Still, 1.0);
    assert!((inside - signal(tones, 1.03) / ARCSEC).length() < 0.01 && missing == Span::ZERO);
    let (repeated, missing) = fill(RecordEnd::Repeat, 7.0);
    assert!((repeated - inside).length() < 0.01 && missing == Span::ZERO, "{repeated} for {inside}");
    let (after, missing) = fill(RecordEnd::Still, 7.0);
    assert!(after.length() < 1e-12 && (missing.s() - exposure_s).abs() < 1e-6, "{after}, {missing:?}");
    let (_, missing) = fill(RecordEnd::Still, 1.96);
    assert!((missing.s() - 0.06).abs() < 1e-6, "{missing:?}");
    let (before, missing) = fill(RecordEnd::Still, -3.0);
    assert!(before.length() < 1e-12 && missing > Span::ZERO);
}

#[test]
fn a_record_and_samples_of_the_bus_add_up() {
    let slow: Tones<'_> = &[([1.0, 0.5], 8.0, 0.2)];
    let exposure_s = 0.05;
    let mut history = history(record(slow, 1000.0, 20.0, RecordEnd::Still), exposure_s);
    let from = START + Span::from_s(5.0);
    let bus = |t_s: f64| DVec3::new(0.0, 40.0 * t_s, 2.0 - 10.0 * t_s) * ARCSEC;
    for i in -3..60 {
        let at = from + Span::from_ms(i);
        history.insert(JitterPoint { at, rotation_rad: bus((at - from).s()) }, at).unwrap();
    }
    let mut track = history.new_track();
    history.fill(from, from + Span::from_s(exposure_s), &mut track);
    for i in 0..50 {
        let t_s = f64::from(i) * 1e-3;
        let off = track.rotation_at(from + Span::from_s(t_s)) - signal(slow, 5.0 + t_s) - bus(t_s);
        assert!(off.length() < 0.02 * ARCSEC, "{t_s} s: off by {} arcsec", off.length() / ARCSEC);
    }
}

#[test]
fn filling_allocates_nothing() {
    for exposure_s in [0.002, 0.1, 3.0] {
        let history = history(record(BROAD, 10_000.0, 20.0, RecordEnd::Repeat), exposure_s);
        let mut track = history.new_track();
        let space = (track.points.capacity(), track.lines.capacity());
        history.fill(START, START + Span::from_s(exposure_s + 0.1), &mut track);
        assert_eq!((track.points.capacity(), track.lines.capacity()), space, "{exposure_s} s");
    }
}

#[test]
fn invalid_record_is_refused() {
    let new = |period_s, samples| JitterRecord::new(period_s, samples, RecordEnd::Still).unwrap_err();
    assert_eq!(new(1e-3, vec![DVec3::ZERO]), Refused(format!("1 samples; wanted 2 to {RECORD_SAMPLES_MAX}")));
    assert_eq!(new(0.0, vec![DVec3::ZERO; 2]), Refused("a period of 0 s; wanted 1e-6 to 1000 s".into()));
    assert_eq!(new(1e-3, vec![DVec3::ZERO, DVec3::NAN]), Refused("sample 1 is not finite".into()));
}
