//! Tests tones, margins and the theoretical loop against independent formulae and simulations.

use super::theory::{LoopOnPaper, noise_of, taken_over};
use super::trial::Tone;
use crate::study::trial::{delay_margin_s, margin_of, phasor, read_at};
use base::units::{ARCSEC, DEG};
use config::{Document, Scenario};
use core::f64::consts::TAU;
use testbed::acs::{Gains, PointingLoop, StructuralFilter};
use testbed::{acs::filter::Complex, acs::pointing_error::PointingNoise, estimator::GyroNoise};

const PERIOD_S: f64 = 0.1;

fn paper(delay_s: f64) -> LoopOnPaper {
    let textbook = PointingLoop {
        gains: Gains { bandwidth_hz: 0.05, damping: 0.8, integral_s: Some(16.0) },
        delay_s,
        control_period_s: PERIOD_S,
        filter: StructuralFilter::None,
        inertia_ratio: 1.0,
    };
    LoopOnPaper { textbook, gyro_period_s: PERIOD_S }
}

#[test]
fn a_tone_is_found_beside_another_a_constant_and_a_drift() {
    let (count, first_s) = (1000_u32, 7.3);
    let record_s = f64::from(count) * PERIOD_S;
    let [hz, other_hz] = [8.0 / record_s, 11.0 / record_s];
    let sample = |k: u32| {
        let t = first_s + PERIOD_S * f64::from(k);
        2.0 * (TAU * hz * t + 0.4).cos() + 3.0 * (TAU * other_hz * t).sin() + 5.0 + 0.02 * (t - first_s)
    };
    let samples: Vec<f64> = (0..count).map(sample).collect();
    let found = phasor(samples.iter().copied(), first_s, PERIOD_S, hz);
    // A drift of 2 over the record leaks 2 / (pi 8^3) = 1.2e-3 eight lines away; the rest is rounding.
    assert!((found - Complex::unit(0.4) * 2.0).modulus() < 2e-3, "{found:?}");
    let nothing = phasor(samples.iter().copied(), first_s, PERIOD_S, 20.0 / record_s);
    assert!(nothing.modulus() < 2e-3, "no tone, nothing found: {nothing:?}");
}

#[test]
fn values_between_points_are_on_straight_lines() {
    let points = [[0.0, 1.0], [2.0, 5.0], [3.0, 4.0]];
    let read = |x: f64| read_at(&points, x).expect("three points");
    assert_eq!([read(1.0), read(2.5), read(-1.0), read(4.0)], [3.0, 4.5, -1.0, 3.0]);
    assert_eq!(read_at(&points[..1], 0.0), None);
}

/// Returns `S` of a simulated loop: a double integrator (exact between control steps), the rate as the mean of the last
/// period, torque held and late, a sine of acceleration from outside in ten steps per period.
fn simulated(model: &LoopOnPaper, late_steps: usize, w: f64) -> Complex {
    let gains = model.textbook.gains;
    let wn = TAU * gains.bandwidth_hz;
    let (mut angle, mut rate, mut before, mut integral) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    let mut late = std::collections::VecDeque::from(vec![0.0; late_steps]);
    let periods = (TAU / w / PERIOD_S).round();
    let (settle, count) = (4000, 10.0 * periods);
    let mut seen = Complex::real(0.0);
    let mut k = 0_u32;
    while f64::from(k) < f64::from(settle) + count {
        let t = f64::from(k) * PERIOD_S;
        if k >= settle {
            seen = seen + Complex::unit(-w * t) * (2.0 / count * angle);
        }
        integral += angle * PERIOD_S;
        let mean_rate = (angle - before) / PERIOD_S;
        before = angle;
        let slow = gains.integral_s.map_or(0.0, |ti| integral / ti);
        late.push_back(-wn * wn * (angle + slow) - 2.0 * gains.damping * wn * mean_rate);
        let held = late.pop_front().expect("one was pushed");
        for part in 0..10 {
            let h = PERIOD_S / 10.0;
            let outside = (w * (t + (f64::from(part) + 0.5) * h)).sin();
            angle += rate * h + 0.5 * (held + outside) * h * h;
            rate += (held + outside) * h;
        }
        k += 1;
    }
    // A free body would turn by -sin(w t) / w^2.
    seen / Complex::imaginary(1.0 / (w * w))
}

/// Largest relative difference between theory and simulation: the hold's images and ten steps per period, both `(w
/// Tc)^2 / 12`.
const SIMULATED: f64 = 0.01;

#[test]
fn the_loop_on_paper_is_the_sampled_loop_with_a_mean_rate() {
    for late_steps in [0_u32, 8, 15] {
        let model = paper(f64::from(late_steps) * PERIOD_S);
        for periods in [40.0, 100.0, 120.0, 160.0, 400.0] {
            let w = TAU / (periods * PERIOD_S);
            let found = simulated(&model, late_steps as usize, w);
            let off = (found / model.sensitivity(w) - Complex::ONE).modulus();
            assert!(off < SIMULATED, "{late_steps} late, {w} rad/s: off by {off}");
        }
    }
    // Near the margin the gyro's half period matters: theory without it is wrong.
    let (model, w) = (paper(1.5), TAU / 12.0);
    let found = simulated(&model, 15, w);
    let off = (found / model.textbook.sensitivity(w) - Complex::ONE).modulus();
    assert!(off > 5.0 * SIMULATED, "negative control: the textbook's loop is off by {off}");
    let hasty = (found / paper(1.2).sensitivity(w) - Complex::ONE).modulus();
    assert!(hasty > 5.0 * SIMULATED, "negative control: another delay is off by {hasty}");
}

#[test]
fn a_margin_is_read_from_tones_about_the_crossover() {
    let model = paper(0.8);
    let (crossover, margin) = (model.crossover_rad_s().expect("one"), model.phase_margin_rad().expect("one"));
    assert!((model.open_loop(crossover).modulus() - 1.0).abs() < 1e-12);
    let tones = |shift: f64| {
        [0.8, 1.0, 1.2].map(|times| Tone { axis: 0, frequency_hz: shift * times * crossover / TAU, amplitude_rad: 1.0 })
    };
    for shift in [0.95, 1.0, 1.07] {
        let tones = tones(shift);
        let left = tones.map(|tone| model.sensitivity(TAU * tone.frequency_hz));
        let (w, read) = margin_of(&tones, &left).expect("three tones");
        assert!((w / crossover - 1.0).abs() < 0.002, "crossover {w} for {crossover}");
        // Straight lines between tones 20 % apart; the study's middle tone is at the crossover itself.
        assert!((read - margin).abs() < 0.3 * DEG, "margin {} for {}", read / DEG, margin / DEG);
    }
    let wrong = tones(1.0).map(|tone| paper(0.9).sensitivity(TAU * tone.frequency_hz));
    let (_, other) = margin_of(&tones(1.0), &wrong).expect("three tones");
    assert!((other - margin).abs() > 2.0 * DEG, "negative control: another delay");
}

#[test]
fn margins_fall_with_delay_to_zero_at_the_delay_margin() {
    let whole_s = paper(0.0).delay_margin_s().expect("one");
    let points: Vec<[f64; 2]> =
        [0.0, 0.5, 1.0].iter().map(|s| [*s, paper(*s).phase_margin_rad().expect("one")]).collect();
    let found_s = delay_margin_s(&points).expect("a line");
    assert!((found_s / whole_s - 1.0).abs() < 1e-9, "{found_s} for {whole_s}");
    assert!(paper(1.1 * whole_s).phase_margin_rad().expect("one") < 0.0, "beyond it the loop is unstable");
    let (model, w) = (paper(0.0), paper(0.0).crossover_rad_s().expect("one"));
    let lag_s = -(model.open_loop(w) / model.textbook.open_loop(w)).argument_rad() / w;
    assert!(lag_s > 0.0 && lag_s < 0.5 * PERIOD_S, "the gyro costs less than half a period of phase: {lag_s}");
}

#[test]
fn a_constant_tracker_error_is_taken_over_as_a_simulated_observer_does() {
    let gyro = GyroNoise { arw_rad_sqrt_s: 2e-6, rrw_rad_s_sqrt_s: 2e-8 };
    let noise = PointingNoise { nea_rad: 5.0 * ARCSEC, tracker_period_s: 0.5, latency_s: 0.0, gyro };
    let steady = testbed::estimator::Farrenkopf::new(noise.nea_rad, noise.tracker_period_s, &noise.gyro);
    let (mut error, mut bias, mut t) = (0.0_f64, 0.0_f64, 0.0_f64);
    assert!(taken_over(&noise, 0.0).abs() < 1e-12);
    for _ in 0..200 {
        error -= bias * noise.tracker_period_s;
        t += noise.tracker_period_s;
        let innovation = 1.0 - error;
        error += steady.attitude_gain * innovation;
        bias += steady.bias_gain_per_s * innovation;
        // Steps and the continuous observer differ by one measurement's contribution.
        assert!((taken_over(&noise, t) - error).abs() < steady.attitude_gain, "after {t} s: {error}");
    }
    assert!((error - 1.0).abs() < 0.05, "in the end all of it: {error}");
}

#[test]
fn noise_is_that_of_the_vehicle() {
    let document = Document::built_in("scenarios/study.toml").expect("shipped");
    let scenario = Scenario::from_document(&document).expect("sound");
    let vehicle = run::wiring::vehicle_parts::vehicle_params(
        &scenario,
        scenario.vehicle().expect("flown"),
        base::time::Tai::from_ns(0),
    );
    let noise = noise_of(&vehicle, 3e-6, 0.5, 0.07);
    assert!((noise.latency_s - 0.12).abs() < 1e-12, "exposure, readout and the tracker's 50 ms: {}", noise.latency_s);
    assert_eq!([noise.nea_rad, noise.tracker_period_s], [3e-6, 0.5]);
    let model = LoopOnPaper::of(&vehicle);
    let slow = model.with_delay(1.5).pointing_sigma_rad(&noise);
    assert!(slow > 1.2 * model.pointing_sigma_rad(&noise), "delay makes noise worse");
}
