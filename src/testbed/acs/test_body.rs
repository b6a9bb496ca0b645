//! A rigid body with wheels for the tests of this module, and settings for it.

use super::mode_logic::{ModeEvent, Thresholds};
use super::params::{AcsInput, AcsOutput, AcsParams, SafeParams, UnloadParams};
use super::{avoidance::KeepOut, control::Acs, filter::StructuralFilter, laws::Gains, slew::SlewLimits};
use base::axes::{Body, Icrf, Rotation};
use base::time::{Span, Tai};
use base::units::DEG;
use glam::{DMat3, DVec3};

pub(super) const PERIOD: Span = Span::from_ms(100);
/// Physics steps per control period.
const FINE: u32 = 10;

/// Returns the inertia of a small satellite with products of inertia.
pub(super) fn inertia() -> DMat3 {
    DMat3::from_cols(DVec3::new(12.0, 0.6, -0.4), DVec3::new(0.6, 10.0, 0.8), DVec3::new(-0.4, 0.8, 7.0))
}

pub(super) fn start() -> Tai {
    Tai::from_ns(5_000_000_000_000)
}

pub(super) fn thresholds() -> Thresholds {
    Thresholds {
        rate_low_rad_s: 0.2 * DEG,
        rate_high_rad_s: 2.0 * DEG,
        rate_dwell: Span::from_ms(3000),
        fine_enter_rad: 0.1 * DEG,
        fine_enter_rate_rad_s: 0.02 * DEG,
        fine_enter_sigma_rad: 0.02 * DEG,
        fine_enter_dwell: Span::from_ms(5000),
        fine_leave_rad: 0.5 * DEG,
        fine_leave_sigma_rad: 0.1 * DEG,
        fine_leave_dwell: Span::from_ms(1000),
        slew_above_rad: 5.0 * DEG,
        coarse_without_attitude: Span::from_ms(2000),
        safe_without_attitude: Span::from_ms(30_000),
        slew_settle: Span::from_ms(20_000),
    }
}

pub(super) fn params() -> AcsParams {
    let gains = |bandwidth_hz| Gains { bandwidth_hz, damping: 0.7, integral_s: None };
    AcsParams {
        inertia_kg_m2: inertia(),
        control_period: PERIOD,
        fine: gains(0.05),
        coarse: gains(0.02),
        damping_bandwidth_hz: 0.02,
        safe: SafeParams { sun_axis_body: DVec3::NEG_Y, gains: gains(0.01), search_rate_rad_s: DVec3::X * 0.3 * DEG },
        largest_torque_n_m: 0.1,
        integral_share: 0.2,
        slew: SlewLimits { largest_rate_rad_s: 1.0 * DEG, largest_acceleration_rad_s2: 0.05 * DEG },
        filter: StructuralFilter::None,
        unload: UnloadParams { above_n_m_s: 3.0, below_n_m_s: 1.0 },
        thresholds: thresholds(),
        exclusion: None,
    }
}

pub(super) const KEEP_OUT: KeepOut =
    KeepOut { boresight_body: DVec3::Z, half_angle_rad: 30.0 * DEG, margin_rad: 3.0 * DEG };

/// Truth.
pub(super) struct TestBody {
    pub(super) at: Tai,
    pub(super) attitude: Rotation<Body, Icrf>,
    pub(super) rate: DVec3,
    pub(super) wheels: DVec3,
    pub(super) disturbance: DVec3,
    pub(super) tracker_works: bool,
    pub(super) sun: Option<DVec3>,
}

impl TestBody {
    pub(super) fn new(rate: DVec3) -> Self {
        Self {
            at: start(),
            attitude: Rotation::from_rotation_vector(DVec3::new(1.0, -0.5, 0.7)),
            rate,
            wheels: DVec3::new(0.2, -0.1, 0.15),
            disturbance: DVec3::ZERO,
            tracker_works: true,
            sun: None,
        }
    }

    /// Returns the outputs of a perfect estimator and Sun sensor.
    pub(super) fn input(&self) -> AcsInput {
        AcsInput {
            attitude: self.tracker_works.then_some(self.attitude),
            rate_rad_s: self.rate,
            attitude_sigma_rad: 1e-5,
            sun_icrf: self.sun,
            sun_body: self.sun.map(|sun| self.attitude.apply(sun)),
            wheel_momentum_n_m_s: self.wheels,
        }
    }

    /// Takes one control period under a torque from the wheels: Euler's equations, `J w' = T - w x (J w + h)`, `h' =
    /// -T` in the body; midpoint rule.
    pub(super) fn turn(&mut self, torque: DVec3) {
        let dt = PERIOD.s() / f64::from(FINE);
        let (j, inverse) = (inertia(), inertia().inverse());
        let acceleration = |w: DVec3, h: DVec3| inverse * (torque + self.disturbance - w.cross(j * w + h));
        for _ in 0..FINE {
            let middle_h = self.wheels - torque * (dt / 2.0);
            let middle = self.rate + acceleration(self.rate, self.wheels) * (dt / 2.0);
            self.attitude = self.attitude.rotated_by(middle * dt);
            self.rate += acceleration(middle, middle_h) * dt;
            self.wheels -= torque * dt;
        }
        self.at = self.at + PERIOD;
    }

    /// Returns the momentum of body and wheels, ICRF.
    pub(super) fn momentum_icrf(&self) -> DVec3 {
        self.attitude.inverse().apply(inertia() * self.rate + self.wheels)
    }
}

/// Runs the loop for `seconds`, collecting mode changes; `each` sees every step.
pub(super) fn run(
    acs: &mut Acs,
    body: &mut TestBody,
    seconds: f64,
    mut each: impl FnMut(&TestBody, &AcsOutput),
) -> Vec<ModeEvent> {
    let mut events = Vec::new();
    let until = body.at + Span::from_s(seconds);
    while body.at < until {
        let output = acs.step(body.at, &body.input());
        events.extend(output.event);
        each(body, &output);
        body.turn(output.torque_n_m);
    }
    events
}
