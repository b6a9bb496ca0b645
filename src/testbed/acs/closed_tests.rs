//! Body, gyro, late tracker, estimator and control together, against the paper of [`super::pointing_error`].

use super::params::{AcsInput, Command};
use super::pointing_error::{PointingNoise, PointingPrediction};
use super::test_body::{PERIOD, TestBody, params, start};
use super::{
    control::Acs, filter::StructuralFilter, laws::Gains, linear::PointingLoop, mode_logic::Mode, params::AcsParams,
};
use crate::estimator::{GyroNoise, Mekf, MekfParams};
use base::axes::{Body, Icrf, Rotation};
use base::time::{Span, Tai};
use base::units::{ARCSEC, DEG};
use core::f64::consts::{PI, TAU};
use glam::{DMat3, DVec3};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

const FINE: Gains = Gains { bandwidth_hz: 0.04, damping: 0.7, integral_s: None };
/// Gyro samples between tracker measurements, and from a measurement to its arrival.
const PER_FIX: u32 = 5;
/// Simulated time, s.
const SECONDS: f64 = 6000.0;

fn noise(latency_steps: usize) -> PointingNoise {
    PointingNoise {
        nea_rad: 15.0 * ARCSEC,
        tracker_period_s: f64::from(PER_FIX) * PERIOD.s(),
        latency_s: latency_steps as f64 * PERIOD.s(),
        gyro: GyroNoise { arw_rad_sqrt_s: 2e-5, rrw_rad_s_sqrt_s: 5e-7 },
    }
}

fn estimator(noise: &PointingNoise) -> Mekf {
    let params = MekfParams {
        gyro_arw_rad_sqrt_s: DVec3::splat(noise.gyro.arw_rad_sqrt_s),
        gyro_rrw_rad_s_sqrt_s: DVec3::splat(noise.gyro.rrw_rad_s_sqrt_s),
        initial_attitude_sigma_rad: PI,
        initial_bias_sigma_rad_s: 1e-4,
        dropout_acceleration_rad_s2: 1e-3,
        gate_sigma: 6.0,
        lost_after: 5,
        history: Span::from_ms(5000),
        history_steps: 200,
        converged_sigma_rad: 0.02 * DEG,
    };
    Mekf::new(params, start()).expect("settings in range")
}

/// Gyro and tracker of a [`TestBody`].
struct Sensors {
    random: StdRng,
    bias: DVec3,
    before: Rotation<Body, Icrf>,
    under_way: Vec<(Tai, Rotation<Body, Icrf>, u32)>,
}

impl Sensors {
    fn gaussian(&mut self) -> DVec3 {
        let mut one = || {
            let (u, v): (f64, f64) = (self.random.random(), self.random.random());
            (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
        };
        DVec3::new(one(), one(), one())
    }

    /// Returns the mean rate since the last sample.
    fn gyro(&mut self, body: &TestBody, noise: &PointingNoise) -> DVec3 {
        let dt_s = PERIOD.s();
        let turned = self.before.rotation_vector_to(&body.attitude);
        self.before = body.attitude;
        let walk = self.gaussian() * noise.gyro.rrw_rad_s_sqrt_s * dt_s.sqrt();
        self.bias += walk;
        turned / dt_s + self.bias + self.gaussian() * noise.gyro.arw_rad_sqrt_s / dt_s.sqrt()
    }
}

/// Rms about one axis of the true pointing error and of the estimate's error.
fn simulated(noise: &PointingNoise, latency_steps: u32) -> (f64, f64) {
    let mut body = TestBody::new(DVec3::ZERO);
    let target = body.attitude.rotated_by(DVec3::X * 0.2 * DEG);
    let mut acs = Acs::new(AcsParams { fine: FINE, ..params() }, start()).expect("settings in range");
    acs.command(Command::Point(target)).expect("accepted");
    let mut filter = estimator(noise);
    let mut sensors =
        Sensors { random: StdRng::seed_from_u64(2), bias: DVec3::ZERO, before: body.attitude, under_way: Vec::new() };
    sensors.bias = DVec3::new(8e-5, -5e-5, 3e-5);
    let (mut pointing, mut knowledge, mut count) = (0.0, 0.0, 0.0);
    let mut step = 0;
    while (body.at - start()).s() < SECONDS {
        let rate = sensors.gyro(&body, noise);
        filter.propagate(body.at, Some(rate));
        if step % PER_FIX == 0 {
            let measured = body.attitude.rotated_by(sensors.gaussian() * noise.nea_rad);
            sensors.under_way.push((body.at, measured, step + latency_steps));
        }
        while let Some((at, measured, _)) = sensors.under_way.first().copied().filter(|fix| fix.2 <= step) {
            filter.measure(at, &measured, &(DMat3::IDENTITY * noise.nea_rad.powi(2)));
            sensors.under_way.remove(0);
        }
        let input = AcsInput {
            attitude: filter.attitude(body.at),
            rate_rad_s: filter.rate_rad_s(),
            attitude_sigma_rad: filter.sigma_rad().max_element(),
            ..body.input()
        };
        let output = acs.step(body.at, &input);
        if (body.at - start()).s() > 400.0 {
            assert_eq!(output.mode, Mode::FinePointing, "at {} s", (body.at - start()).s());
            pointing += body.attitude.rotation_vector_to(&target).length_squared() / 3.0;
            let estimate = input.attitude.expect("started");
            knowledge += body.attitude.rotation_vector_to(&estimate).length_squared() / 3.0;
            count += 1.0;
        }
        body.turn(output.torque_n_m);
        step += 1;
    }
    ((pointing / count).sqrt(), (knowledge / count).sqrt())
}

fn predicted(noise: &PointingNoise) -> PointingPrediction {
    let model = PointingLoop {
        gains: FINE,
        delay_s: 0.0,
        control_period_s: PERIOD.s(),
        filter: StructuralFilter::None,
        inertia_ratio: 1.0,
    };
    model.pointing_error(noise)
}

/// Some thousand independent errors per run scatter the rms by two percent; the continuous observer is good to a few.
const PREDICTED: f64 = 0.05;

#[test]
fn the_pointing_error_with_estimator_and_late_tracker_is_the_predicted_one() {
    for latency_steps in [0, 4, 40] {
        let noise = noise(latency_steps as usize);
        let wanted = predicted(&noise);
        let (pointing, knowledge) = simulated(&noise, latency_steps);
        let ratios = [pointing / wanted.pointing_sigma_rad, knowledge / wanted.knowledge_sigma_rad];
        assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < PREDICTED), "{latency_steps} late: {ratios:?}");
        let timely = predicted(&PointingNoise { latency_s: 0.0, ..noise }).knowledge_sigma_rad;
        let ignored = knowledge / timely - 1.0;
        assert_eq!(ignored.abs() > PREDICTED, latency_steps > 0, "latency left out: {ignored}");
    }
    let (late, timely) = (predicted(&noise(40)), predicted(&noise(0)));
    assert!(late.knowledge_sigma_rad > 1.2 * timely.knowledge_sigma_rad, "four seconds of latency must cost");
}
