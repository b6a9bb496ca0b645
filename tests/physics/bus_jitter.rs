//! Jitter that comes over the bus as parameters, against formulae written afresh.

use base::time::{Span, Tai};
use core::f64::consts::TAU;
use glam::DVec3;
use plan::attitude::{
    ClockEstimate, HARMONICS_MAX, HistoryLimits, JitterHistory, JitterLine, JitterTrack, LINES_PER_AXIS, PsdPoint,
    UPLOADED_LINES_MAX, WheelHarmonic, psd_variance,
};

const ARCSEC: f64 = 4.848_136_811_095_36e-6;
/// 2027-01-15, some local instant.
const BOOT: Tai = Tai::from_ns(1_800_000_000_123_456_789);
/// Phases in f64 after a day of turns: 1e-7 of a turn, of an amplitude of arcseconds.
const PHASE_RAD: f64 = 1e-6;

fn estimate(drift: f64) -> ClockEstimate {
    ClockEstimate {
        offset: Span::from_ns(BOOT.ns()),
        reference_remote_ns: 0,
        drift,
        offset_sigma: Span::ZERO,
        drift_sigma: 0.0,
        drift_walk_per_s: 0.0,
        residual: Span::ZERO,
        spread: Span::ZERO,
        pairs: 1,
    }
}

fn history() -> JitterHistory {
    JitterHistory::new(HistoryLimits::default(), Span::from_ms(5))
}

fn at(t_s: f64) -> Tai {
    BOOT + Span::from_s(t_s)
}

fn track_of(history: &JitterHistory, from_s: f64, exposure_s: f64) -> JitterTrack {
    let mut track = history.new_track();
    history.fill(at(from_s), at(from_s + exposure_s), &mut track);
    track
}

fn lines() -> [JitterLine; 3] {
    [
        JitterLine { frequency_hz: 0.7, amplitude_rad: DVec3::new(3.0, -1.0, 20.0) * ARCSEC, phase_rad: 0.4 },
        JitterLine { frequency_hz: 53.0, amplitude_rad: DVec3::new(2.0, 2.5, 0.0) * ARCSEC, phase_rad: -2.0 },
        JitterLine { frequency_hz: 311.7, amplitude_rad: DVec3::new(0.1, 0.2, 0.5) * ARCSEC, phase_rad: 5.0 },
    ]
}

/// Returns the mean and mean square of the rotation over an exposure: Simpson's rule, so many panels per second.
fn moments(track: &JitterTrack, from_s: f64, exposure_s: f64, panels_per_s: f64) -> (DVec3, DVec3) {
    let panels = 2 * (0.5 * panels_per_s * exposure_s).ceil() as u32;
    let weight = |i: u32| if i == 0 || i == panels { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
    let node = |i: u32| (weight(i), track.rotation_at(at(from_s + exposure_s * f64::from(i) / f64::from(panels))));
    let (mut mean, mut square) = (DVec3::ZERO, DVec3::ZERO);
    for (weight, rotation_rad) in (0..=panels).map(node) {
        mean += weight * rotation_rad;
        square += weight * rotation_rad * rotation_rad;
    }
    let unit = 1.0 / (3.0 * f64::from(panels));
    (mean * unit, square * unit)
}

#[test]
fn uploaded_lines_move_a_frame_as_configured_ones() {
    let (mut configured, mut uploaded) = (history(), history());
    configured.set_lines(&lines(), BOOT).unwrap();
    uploaded.set_uploaded_lines(&lines()).unwrap();
    assert!(track_of(&uploaded, 100.0, 0.1).is_still(), "no remote time, no phase");
    uploaded.follow_clock(&estimate(0.0));
    for from_s in [0.0, 100.0, 86_400.0] {
        let (a, b) = (track_of(&configured, from_s, 0.1), track_of(&uploaded, from_s, 0.1));
        for t_s in [0.0, 0.0123, 0.05, 0.1] {
            let difference = (a.rotation_at(at(from_s + t_s)) - b.rotation_at(at(from_s + t_s))).length();
            assert!(difference < 20.0 * ARCSEC * PHASE_RAD, "{difference} rad at {from_s} + {t_s} s");
        }
        let ((mean_a, square_a), (mean_b, square_b)) =
            (moments(&a, from_s, 0.1, 12_000.0), moments(&b, from_s, 0.1, 12_000.0));
        assert!((mean_a - mean_b).length() < 20.0 * ARCSEC * PHASE_RAD, "{mean_a} {mean_b}");
        assert!((square_a - square_b).length() < 1e-6 * square_a.length(), "{square_a} {square_b}");
    }
}

/// A day after boot at 20 ppm a line of 53 Hz is 92 turns away from where local time would put it.
#[test]
fn uploaded_lines_run_by_the_remote_clock() {
    const DRIFT: f64 = -20e-6;
    let mut uploaded = history();
    uploaded.set_uploaded_lines(&lines()).unwrap();
    uploaded.follow_clock(&estimate(DRIFT));
    let (from_s, exposure_s) = (86_400.0, 0.2);
    let track = track_of(&uploaded, from_s, exposure_s);
    let wanted = |t_s: f64, drift: f64| {
        let remote_s = t_s / (1.0 + drift);
        lines().iter().map(|l| l.amplitude_rad * (TAU * l.frequency_hz * remote_s + l.phase_rad).sin()).sum::<DVec3>()
    };
    // 4.6e6 turns keep 1e-9 of one; the remote time is a whole nanosecond: 2e-6 rad at 312 Hz.
    let tolerance = 3.0 * ARCSEC * 1e-5;
    for t_s in [0.0, 0.033, 0.1, 0.2].map(|t| from_s + t) {
        let error = (track.rotation_at(at(t_s)) - wanted(t_s, DRIFT)).length();
        assert!(error < tolerance, "{} arcsec", error / ARCSEC);
    }
    let blind =
        (0..20).map(|i| from_s + 0.01 * f64::from(i)).map(|t| (track.rotation_at(at(t)) - wanted(t, 0.0)).length());
    assert!(blind.fold(0.0, f64::max) > 1000.0 * tolerance, "the drift matters");
}

/// Returns a density from 1 to 200 Hz: flat, falling as f^-2, an empty notch, a hump.
fn density() -> Vec<PsdPoint> {
    let point = |frequency_hz: f64, x: f64, y: f64| PsdPoint { frequency_hz, density: DVec3::new(x, y, 0.0) * 1e-12 };
    vec![
        point(1.0, 4.0, 1.0),
        point(8.0, 4.0, 1.0),
        point(40.0, 0.16, 1.0),
        point(60.0, 0.16, 1.0),
        point(200.0, 0.4, 1.0),
    ]
}

/// Returns the integral of the density of x over a band, by small steps of straight lines in log-log.
fn band_power(points: &[PsdPoint], low_hz: f64, high_hz: f64) -> f64 {
    fine_power(points, low_hz, high_hz, 20_000)
}

fn fine_power(points: &[PsdPoint], low_hz: f64, high_hz: f64, steps: i32) -> f64 {
    let at_hz = |hz: f64| {
        let pair = points.windows(2).find(|pair| hz >= pair[0].frequency_hz && hz <= pair[1].frequency_hz);
        pair.map_or(0.0, |pair| {
            let share = (hz / pair[0].frequency_hz).ln() / (pair[1].frequency_hz / pair[0].frequency_hz).ln();
            (pair[0].density.x.ln() * (1.0 - share) + pair[1].density.x.ln() * share).exp()
        })
    };
    let step_hz = (high_hz - low_hz) / f64::from(steps);
    (0..steps).map(|i| at_hz(low_hz + (f64::from(i) + 0.5) * step_hz) * step_hz).sum()
}

fn noise(seed: u64) -> JitterHistory {
    let mut history = history();
    history.set_psd(&density(), seed, |body| body).unwrap();
    history.follow_clock(&estimate(0.0));
    history
}

/// Returns samples of x, rad, every 1/1024 s.
fn samples(seed: u64, count: u32) -> Vec<f64> {
    let track = track_of(&noise(seed), 1000.0, f64::from(count) / 1024.0);
    (0..count).map(|i| track.rotation_at(at(1000.0 + f64::from(i) / 1024.0)).x).collect()
}

/// Returns the power of a band by the periodogram with a Hann window, at every bin.
fn periodogram_power(x: &[f64], low_hz: f64, high_hz: f64) -> f64 {
    let n = x.len() as f64;
    let window: Vec<f64> = (0..x.len()).map(|i| 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / n).cos()).collect();
    let energy: f64 = window.iter().map(|w| w * w).sum();
    let steps = ((high_hz - low_hz) * n / 1024.0).round() as u32;
    let step_hz = (high_hz - low_hz) / f64::from(steps);
    let power = |hz: f64| {
        // A rotor instead of a sine per sample.
        let (turn_s, turn_c) = (TAU * hz / 1024.0).sin_cos();
        let (mut s, mut c, mut re, mut im) = (0.0, 1.0, 0.0, 0.0);
        for (x, w) in x.iter().zip(&window) {
            re += x * w * c;
            im += x * w * s;
            (s, c) = (s * turn_c + c * turn_s, c * turn_c - s * turn_s);
        }
        2.0 * (re * re + im * im) / (energy * 1024.0)
    };
    (0..steps).map(|i| power(low_hz + (f64::from(i) + 0.5) * step_hz) * step_hz).sum()
}

#[test]
fn noise_has_the_power_of_its_density_in_every_band() {
    const SEEDS: u64 = 60;
    println!("band, Hz: power by periodogram over that of the density, standard error");
    let runs: Vec<Vec<f64>> = (0..SEEDS).map(|seed| samples(seed, 4096)).collect();
    for (low_hz, high_hz) in [(2.0, 7.0), (10.0, 20.0), (20.0, 36.0), (70.0, 120.0), (120.0, 195.0)] {
        let wanted = band_power(&density(), low_hz, high_hz);
        let ratios: Vec<f64> = runs.iter().map(|x| periodogram_power(x, low_hz, high_hz) / wanted).collect();
        let mean = ratios.iter().sum::<f64>() / SEEDS as f64;
        let variance = ratios.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (SEEDS as f64 - 1.0);
        let error = (variance / SEEDS as f64).sqrt();
        println!("{low_hz:4} to {high_hz:4}: {mean:.3} +- {error:.3}");
        // Four standard errors: false alarm 6e-5 per band. Bands' edges lie inside strata: 2 % of leakage.
        assert!((mean - 1.0).abs() < 4.0 * error + 0.02, "{low_hz} to {high_hz} Hz: {mean} +- {error}");
        // A density wrong by 3 dB would be seen.
        assert!(error < 0.1, "{error}");
    }
}

#[test]
fn noise_has_the_variance_of_its_density_and_is_nearly_normal() {
    let wanted = psd_variance(&density());
    let independent = band_power(&density(), 1.0, 200.0);
    assert!((wanted.x / independent - 1.0).abs() < 1e-6, "{} {independent}", wanted.x);
    assert!((wanted.y / 199e-12 - 1.0).abs() < 1e-12 && wanted.z == 0.0, "flat: density times band");
    // Half a minute: the slowest line of 1 Hz turns 30 times, so squares average to 1/(2 pi 30) and better.
    let (mut square, mut fourth, mut count) = (0.0, 0.0, 0.0);
    for seed in 0..12 {
        let x = samples(seed, 30 * 1024);
        let own = x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64;
        assert!((own / wanted.x - 1.0).abs() < 0.03, "seed {seed}: {}", own / wanted.x);
        square += x.iter().map(|x| x * x).sum::<f64>();
        fourth += x.iter().map(|x| x.powi(4)).sum::<f64>();
        count += x.len() as f64;
    }
    let kurtosis = fourth / count / (square / count).powi(2);
    println!("variance / integral {:.4}, kurtosis {kurtosis:.3} (normal: 3)", square / count / wanted.x);
    assert!((2.75..3.05).contains(&kurtosis), "{kurtosis}");
}

/// Smear of an exposure of T: the root of the density's integral times `1 - sinc^2(f T)` (what is slower moves the
/// image as a whole), which for a long one is the root of the integral.
#[test]
fn smear_of_an_exposure_is_the_root_of_what_it_sees_of_the_density() {
    const SEEDS: u64 = 16;
    for (exposure_s, tolerance) in [(10.0, 0.03), (0.1, 0.12), (0.02, 0.15)] {
        let sinc = |x: f64| (0.5 * TAU * x).sin() / (0.5 * TAU * x);
        let bands = (0..1990).map(|i| (1.0 + 0.1 * f64::from(i), 1.1 + 0.1 * f64::from(i)));
        let seen = bands.map(|(low, high)| {
            let middle = 0.5 * (low + high);
            fine_power(&density(), low, high, 4) * (1.0 - sinc(middle * exposure_s).powi(2))
        });
        let wanted = seen.sum::<f64>().sqrt();
        let variance = |seed: u64| {
            let (mean, square) = moments(&track_of(&noise(seed), 500.0, exposure_s), 500.0, exposure_s, 3200.0);
            square.x - mean.x * mean.x
        };
        let rms = ((0..SEEDS).map(variance).sum::<f64>() / SEEDS as f64).sqrt();
        println!("{exposure_s} s: smear {:.4} of what the density says, {:.4} arcsec", rms / wanted, rms / ARCSEC);
        // 16 seeds of a sum of 32 squares: the short ones see some ten lines each.
        assert!((rms / wanted - 1.0).abs() < tolerance, "{exposure_s} s: {}", rms / wanted);
    }
}

fn harmonic(multiple: f64, exponent: f64) -> WheelHarmonic {
    let amplitude_rad = DVec3::new(1.0, -0.5, 0.2) * ARCSEC;
    WheelHarmonic { wheel: 2, harmonic: multiple, amplitude_rad, exponent, phase_rad: 0.6 }
}

fn with_wheel(table: &[WheelHarmonic], speeds: &[(f64, f64)]) -> JitterHistory {
    let mut history = history();
    history.set_wheel_harmonics(table).unwrap();
    for &(t_s, rad_s) in speeds {
        history.wheel_speeds([0.0, 0.0, rad_s, 0.0], at(t_s)).unwrap();
    }
    history
}

#[test]
fn a_harmonic_at_constant_speed_is_a_line() {
    // 3180 rpm = 53 Hz; the fifth harmonic and a quarter. Phase 0.6 rad at the first message, 1 s after boot.
    for rpm in [3180.0, -3180.0, 1000.0] {
        let rad_s = rpm * TAU / 60.0;
        let table = [harmonic(5.25, 2.0)];
        let history = with_wheel(&table, &[(1.0, rad_s), (1.1, rad_s), (1.2, rad_s)]);
        let track = track_of(&history, 1.15, 0.1);
        let scale = (rpm / 1000.0) * (rpm / 1000.0);
        for t_s in [1.15, 1.19, 1.2, 1.25] {
            let phase = TAU * 5.25 * rpm / 60.0 * (t_s - 1.0) + 0.6;
            let wanted = table[0].amplitude_rad * scale * phase.sin();
            let error = (track.rotation_at(at(t_s)) - wanted).length();
            // Instants are whole nanoseconds: 2 urad of phase at 280 Hz.
            assert!(error < 1e-5 * scale * ARCSEC, "{rpm} rpm at {t_s} s: {} arcsec", error / ARCSEC);
        }
        assert!((track.highest_line_hz() - 5.25 * rpm.abs() / 60.0).abs() < 1e-9, "what the planner resolves");
        assert_eq!(history.frozen_speed_bound_rad(at(1.15), at(1.25)), DVec3::ZERO);
    }
}

/// A wheel that speeds up: the line errs by less than the bound, and by more than a third of it at the ends.
#[test]
fn frozen_speeds_err_within_their_bound_and_reach_for_it() {
    let slope = 40.0;
    for (multiple, exponent, exposure_s) in [(1.0, 0.0, 0.1), (5.0, 0.0, 0.1), (5.0, 2.0, 0.1), (5.0, 2.0, 0.02)] {
        let table = [harmonic(multiple, exponent)];
        let speeds: Vec<(f64, f64)> =
            (0..8).map(|i| (0.1 * f64::from(i), 200.0 + slope * 0.1 * f64::from(i))).collect();
        let history = with_wheel(&table, &speeds);
        let mut largest = DVec3::ZERO;
        let mut bound = DVec3::ZERO;
        // Exposures at several phases: an error in phase shows where the sine is steep.
        for place in 0..40 {
            let from_s = 0.2 + 0.007 * f64::from(place);
            let track = track_of(&history, from_s, exposure_s);
            bound = history.frozen_speed_bound_rad(at(from_s), at(from_s + exposure_s));
            for i in 0..=50 {
                let t_s = from_s + exposure_s * f64::from(i) / 50.0;
                let (speed, angle) = (200.0 + slope * t_s, 200.0 * t_s + 0.5 * slope * t_s * t_s);
                let scale = (speed / (1000.0 * TAU / 60.0)).powf(exponent);
                let wanted = table[0].amplitude_rad * scale * (multiple * angle + 0.6).sin();
                let error = (track.rotation_at(at(t_s)) - wanted).abs();
                assert!((error - 1.001 * bound).max_element() <= 1e-5 * ARCSEC, "{error} over {bound} at {t_s} s");
                largest = largest.max(error);
            }
        }
        let share = largest.x / bound.x;
        println!("harmonic {multiple}, exponent {exponent}, {exposure_s} s: largest error {share:.2} of the bound");
        assert!(share > 0.33, "{share}: the bound is not empty words");
    }
}

#[test]
fn full_tables_fit_a_track_made_before_them() {
    let mut history = history();
    history.set_lines(&lines(), BOOT).unwrap();
    let mut track = history.new_track();
    let space = track.lines.capacity();
    history.set_uploaded_lines(&[lines()[1]; UPLOADED_LINES_MAX]).unwrap();
    history.set_psd(&density(), 7, |body| body).unwrap();
    history.set_wheel_harmonics(&[harmonic(3.0, 2.0); HARMONICS_MAX]).unwrap();
    history.wheel_speeds([100.0, 200.0, 300.0, 400.0], at(0.0)).unwrap();
    history.follow_clock(&estimate(1e-5));
    history.fill(at(1.0), at(1.1), &mut track);
    // The density has nothing about z.
    let wanted = lines().len() + UPLOADED_LINES_MAX + 2 * LINES_PER_AXIS + HARMONICS_MAX;
    assert_eq!((track.lines.len(), track.lines.capacity()), (wanted, space));
    assert!(history.set_uploaded_lines(&[lines()[1]; UPLOADED_LINES_MAX + 1]).is_err(), "one too many");
    history.fill(at(1.0), at(1.1), &mut track);
    assert_eq!(track.lines.len(), wanted, "and the former ones stay");
    history.set_uploaded_lines(&[]).unwrap();
    history.set_psd(&[], 0, |body| body).unwrap();
    history.set_wheel_harmonics(&[]).unwrap();
    history.fill(at(1.0), at(1.1), &mut track);
    assert_eq!((track.lines.len(), track.lines_epoch), (lines().len(), BOOT), "cleared: as configured");
}
