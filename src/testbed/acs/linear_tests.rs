//! The loop on paper against a simulated double integrator with held, late torque, and against textbook formulae.

use super::{filter::StructuralFilter, laws::Gains, linear::PointingLoop, pointing_error::PointingNoise};
use crate::estimator::{Farrenkopf, GyroNoise};
use base::units::{ARCSEC, DEG};
use core::f64::consts::TAU;
use glam::DVec3;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::collections::VecDeque;

const GAINS: Gains = Gains { bandwidth_hz: 0.1, damping: 0.7, integral_s: None };
/// Physics steps per control period.
const FINE: u32 = 50;

fn real_loop() -> PointingLoop {
    PointingLoop {
        gains: GAINS,
        delay_s: 0.2,
        control_period_s: 0.1,
        filter: StructuralFilter::LowPass { corner_hz: 1.0, damping: 0.7 },
        inertia_ratio: 1.0,
    }
}

/// A double integrator whose acceleration is computed once per control period, filtered, held, and late.
struct Axis {
    angle: f64,
    rate: f64,
    integral: f64,
    filter: super::filter::BiquadState,
    late: VecDeque<f64>,
    held: f64,
    dt_s: f64,
    steps: u32,
}

impl Axis {
    fn new(model: &PointingLoop, late_steps: usize) -> Self {
        let filter = model.filter.section(model.control_period_s).expect("in range").at_rest();
        let dt_s = model.control_period_s / f64::from(FINE);
        let late = VecDeque::from(vec![0.0; late_steps]);
        Self { angle: 0.0, rate: 0.0, integral: 0.0, filter, late, held: 0.0, dt_s, steps: 0 }
    }

    /// Takes one physics step with errors of the measured angle and rate and a disturbing acceleration.
    fn step(&mut self, model: &PointingLoop, angle_error: f64, rate_error: f64, disturbance: f64) {
        if self.steps.is_multiple_of(FINE) {
            let wn = TAU * model.gains.bandwidth_hz;
            let angle = self.angle + angle_error;
            self.integral += angle * model.control_period_s;
            let slow = model.gains.integral_s.map_or(0.0, |ti| self.integral / ti);
            let raw = -wn * wn * (angle + slow) - 2.0 * model.gains.damping * wn * (self.rate + rate_error);
            self.held = self.filter.step(DVec3::X * raw).x;
        }
        self.steps += 1;
        self.late.push_back(self.held);
        let acceleration = self.late.pop_front().expect("one was pushed") / model.inertia_ratio + disturbance;
        self.angle += self.dt_s * (self.rate + self.dt_s / 2.0 * acceleration);
        self.rate += self.dt_s * acceleration;
    }
}

fn grows(model: &PointingLoop, late_steps: usize) -> bool {
    let mut axis = Axis::new(model, late_steps);
    axis.angle = 1.0;
    let mut most = [0.0_f64; 2];
    for k in 0..200_000_u32 {
        axis.step(model, 0.0, 0.0, 0.0);
        if k >= 50_000 {
            let half = usize::from(k >= 125_000);
            most[half] = most[half].max(axis.angle.abs());
        }
        if axis.angle.abs() > 1e6 {
            return true;
        }
    }
    most[1] > most[0]
}

/// Returns the delay at which the simulated loop begins to grow, s.
fn simulated_edge_s(model: &PointingLoop) -> f64 {
    let (mut stable, mut unstable) = (0_usize, 2000_usize);
    while unstable - stable > 1 {
        let middle = (stable + unstable) / 2;
        if grows(model, middle) {
            unstable = middle;
        } else {
            stable = middle;
        }
    }
    0.5 * (stable + unstable) as f64 * model.control_period_s / f64::from(FINE)
}

#[test]
fn the_delay_margin_is_where_the_simulation_becomes_unstable() {
    let integral = Gains { integral_s: Some(8.0), ..GAINS };
    let plain = PointingLoop { delay_s: 0.0, filter: StructuralFilter::None, ..real_loop() };
    let filtered = PointingLoop { delay_s: 0.0, ..real_loop() };
    let notched = StructuralFilter::Notch { centre_hz: 0.8, width_hz: 0.4 };
    for model in [
        plain,
        filtered,
        PointingLoop { gains: integral, ..filtered },
        PointingLoop { inertia_ratio: 1.3, filter: notched, ..plain },
    ] {
        let (got, wanted) = (simulated_edge_s(&model), model.delay_margin_s().expect("a crossover"));
        assert!((got / wanted - 1.0).abs() < 0.05, "{model:?}: unstable at {got} s, predicted {wanted} s");
    }
    let wrong = PointingLoop { control_period_s: 1e-9, filter: StructuralFilter::None, ..plain };
    let missed = simulated_edge_s(&filtered) / wrong.delay_margin_s().expect("a crossover") - 1.0;
    assert!(missed.abs() > 0.05, "without filter and hold the edge must be missed: {missed}");
}

#[test]
fn the_ideal_loop_has_the_textbooks_crossover_and_margin() {
    // |wn^2 + 2 zeta wn s| = w^2 at w = wn sqrt(2 zeta^2 + sqrt(4 zeta^4 + 1)); phase margin atan(2 zeta w / wn).
    let ideal = PointingLoop::ideal(GAINS);
    let z2 = GAINS.damping.powi(2);
    let factor = (2.0 * z2 + (4.0 * z2 * z2 + 1.0).sqrt()).sqrt();
    let (crossover, wn) = (ideal.gain_crossover_rad_s().expect("one"), TAU * GAINS.bandwidth_hz);
    assert!((crossover / (wn * factor) - 1.0).abs() < 1e-12, "{crossover}");
    let margin = ideal.phase_margin_rad().expect("one");
    assert!((margin - (2.0 * GAINS.damping * factor).atan()).abs() < 1e-12, "{margin}");
    // Each delay takes its angle at the crossover, which stays where it is.
    let late = PointingLoop { delay_s: 0.3, ..ideal }.phase_margin_rad().expect("one");
    assert!((margin - late - 0.3 * crossover).abs() < 1e-12, "{late}");
    assert!(margin / DEG > 60.0 && late / DEG < 60.0, "{} {}", margin / DEG, late / DEG);
}

#[test]
fn the_noise_bandwidth_is_the_integral_in_closed_form() {
    // int |T|^2 df over all f for T = (2 zeta wn s + wn^2) / (s^2 + 2 zeta wn s + wn^2) is wn (1 + 4 zeta^2) / (4 zeta)
    // (Gardner, "Phaselock Techniques", noise bandwidth of a second-order loop: 2 BL).
    let (z, wn) = (GAINS.damping, TAU * GAINS.bandwidth_hz);
    let wanted = wn * (1.0 + 4.0 * z * z) / (4.0 * z);
    let got = PointingLoop::ideal(GAINS).noise_bandwidth_hz();
    // The part past four decades: 4 zeta^2 wn / (pi 1e4).
    assert!((got / wanted - 1.0).abs() < 1e-4, "{got} for {wanted}");
    let other = PointingLoop::ideal(Gains { damping: 0.71, ..GAINS }).noise_bandwidth_hz();
    assert!((other / wanted - 1.0).abs() > 1e-3, "another damping must differ: {other}");
}

/// Returns the amplitude of the angle's answer to `amplitude(t)`-shaped disturbances at `w`, by correlation over whole
/// cycles.
fn answer(model: &PointingLoop, w: f64, drive: impl Fn(f64) -> (f64, f64, f64)) -> f64 {
    let late = (model.delay_s / model.control_period_s * f64::from(FINE)).round() as usize;
    let mut axis = Axis::new(model, late);
    let (mut cos, mut sin, mut count) = (0.0, 0.0, 0.0);
    let cycle_s = TAU / w;
    loop {
        let t = f64::from(axis.steps) * axis.dt_s;
        let (angle, rate, disturbance) = drive(t);
        axis.step(model, angle, rate, disturbance);
        if t > 20.0 * cycle_s + 100.0 {
            cos += axis.angle * (w * t).cos();
            sin += axis.angle * (w * t).sin();
            count += 1.0;
        }
        if count * axis.dt_s > 20.0 * cycle_s {
            return 2.0 * cos.hypot(sin) / count;
        }
    }
}

#[test]
fn simulated_sines_come_out_as_the_transfer_functions_say() {
    let model = real_loop();
    for w in [0.2, 0.6, 1.2, 3.0] {
        let followed = answer(&model, w, |t| (-(w * t).sin(), -w * (w * t).cos(), 0.0));
        let wanted = model.complementary(w).modulus();
        assert!((followed / wanted - 1.0).abs() < 0.02, "|T({w})| {followed} for {wanted}");
        let shaken = answer(&model, w, |t| (0.0, 0.0, (w * t).sin()));
        let wanted = model.compliance(w).modulus();
        assert!((shaken / wanted - 1.0).abs() < 0.02, "compliance at {w}: {shaken} for {wanted}");
        let other = PointingLoop { delay_s: 0.6, ..model }.complementary(w).modulus();
        assert!(w < 0.5 || (followed / other - 1.0).abs() > 0.02, "another delay must differ at {w}");
    }
}

/// Returns one axis with gyro, tracker and a filter with Farrenkopf's constant gains; returns the rms of pointing and
/// of knowledge.
fn simulated_errors(model: &PointingLoop, noise: &PointingNoise, seconds: u32, seed: u64) -> (f64, f64) {
    let mut random = StdRng::seed_from_u64(seed);
    let mut gaussian = move || {
        let (u, v): (f64, f64) = (random.random(), random.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
    };
    let steady = Farrenkopf::new(noise.nea_rad, noise.tracker_period_s, &noise.gyro);
    let late = (model.delay_s / model.control_period_s * f64::from(FINE)).round() as usize;
    let mut axis = Axis::new(model, late);
    let tc = model.control_period_s;
    let per_fix = (noise.tracker_period_s / tc).round() as u32;
    let (mut estimate, mut bias, mut believed, mut rate_error) = (0.0, 0.0, 0.0, 0.0);
    let (mut pointing, mut knowledge, mut count) = (0.0, 0.0, 0.0);
    let periods = (f64::from(seconds) / tc) as u32;
    for k in 0..periods {
        for _ in 0..FINE {
            let error = estimate - axis.angle;
            axis.step(model, error, rate_error, 0.0);
            estimate = axis.angle + error;
        }
        // The gyro's mean rate over the period just gone: the true turn cancels out of the estimate's error.
        bias += gaussian() * noise.gyro.rrw_rad_s_sqrt_s * tc.sqrt();
        rate_error = gaussian() * noise.gyro.arw_rad_sqrt_s / tc.sqrt() + bias - believed;
        estimate += rate_error * tc;
        if k % per_fix == 0 {
            let innovation = axis.angle + gaussian() * noise.nea_rad - estimate;
            estimate += steady.attitude_gain * innovation;
            believed += steady.bias_gain_per_s * innovation;
        }
        if k > periods / 20 {
            pointing += axis.angle.powi(2);
            knowledge += (estimate - axis.angle).powi(2);
            count += 1.0;
        }
    }
    ((pointing / count).sqrt(), (knowledge / count).sqrt())
}

/// The simulated rms scatters by a few percent (some thousand independent errors per run); the continuous observer is
/// good to the tracker's gain, a few percent.
const PREDICTED: f64 = 0.05;

#[test]
fn the_predicted_pointing_error_is_the_simulated_one() {
    let gyro = GyroNoise { arw_rad_sqrt_s: 1e-5, rrw_rad_s_sqrt_s: 2e-7 };
    let quiet = GyroNoise { arw_rad_sqrt_s: 2e-6, rrw_rad_s_sqrt_s: 5e-8 };
    for (nea, gyro, gains) in [
        (10.0 * ARCSEC, gyro, GAINS),
        (10.0 * ARCSEC, quiet, GAINS),
        (40.0 * ARCSEC, gyro, Gains { bandwidth_hz: 0.02, ..GAINS }),
    ] {
        let model = PointingLoop { gains, ..real_loop() };
        let noise = PointingNoise { nea_rad: nea, tracker_period_s: 0.5, latency_s: 0.0, gyro };
        let wanted = model.pointing_error(&noise);
        let (pointing, knowledge) = simulated_errors(&model, &noise, 20_000, 1);
        let ratios = (pointing / wanted.pointing_sigma_rad, knowledge / wanted.knowledge_sigma_rad);
        assert!((ratios.0 - 1.0).abs() < PREDICTED, "pointing {pointing} is {} of {wanted:?}", ratios.0);
        assert!((ratios.1 - 1.0).abs() < PREDICTED, "knowledge {knowledge} is {} of {wanted:?}", ratios.1);
        let noisier = PointingNoise { nea_rad: 2.0 * nea, ..noise };
        let other = model.pointing_error(&noisier).pointing_sigma_rad;
        assert!((pointing / other - 1.0).abs() > PREDICTED, "twice the tracker noise must show");
    }
}
