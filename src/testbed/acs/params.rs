//! Parameters of the attitude control for its spacecraft, the errors of bad ones, and its inputs and outputs.

use crate::acs::mode_logic::{Mode, ModeEvent, Thresholds};
use crate::{acs::avoidance::KeepOut, acs::filter::StructuralFilter, acs::laws::Gains, acs::slew::SlewLimits};
use base::axes::{Body, Icrf, Rotation};
use base::{refused::Refused, time::Span};
use glam::{DMat3, DVec3};

/// Safe mode: a body axis to the Sun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafeParams {
    /// Axis to turn to the Sun, body axes; of any length.
    pub sun_axis_body: DVec3,
    /// Loop.
    pub gains: Gains,
    /// Rate to turn with while no Sun is seen, rad/s, body axes.
    pub search_rate_rad_s: DVec3,
}

/// When to ask for momentum unloading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnloadParams {
    /// Begins above this wheel momentum, N m s.
    pub above_n_m_s: f64,
    /// Ends below this one, N m s.
    pub below_n_m_s: f64,
}

/// Settings of the attitude control.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AcsParams {
    /// Inertia of the body with its wheels' transverse inertia, body axes.
    pub inertia_kg_m2: DMat3,
    /// Time between steps; the structural filter is made for it.
    pub control_period: Span,
    /// Loop of fine pointing and of slews.
    pub fine: Gains,
    /// Loop of coarse pointing.
    pub coarse: Gains,
    /// Rate damping: torque `-2 pi f J w`, Hz.
    pub damping_bandwidth_hz: f64,
    /// Safe mode.
    pub safe: SafeParams,
    /// Largest torque about any body axis, N m.
    pub largest_torque_n_m: f64,
    /// Largest part of that torque that the integral may hold.
    pub integral_share: f64,
    /// Limits of planned turns. Feedback turns keep them too.
    pub slew: SlewLimits,
    /// Filter in the fine loop.
    pub filter: StructuralFilter,
    /// Momentum unloading.
    pub unload: UnloadParams,
    /// Mode logic.
    pub thresholds: Thresholds,
    /// A boresight to keep from the Sun.
    pub exclusion: Option<KeepOut>,
}

impl AcsParams {
    /// Checks every setting.
    ///
    /// # Errors
    /// The first setting out of range.
    pub fn check(&self) -> Result<(), Refused> {
        let j = &self.inertia_kg_m2;
        let second = j.x_axis.x * j.y_axis.y - j.x_axis.y * j.y_axis.x;
        let positive_j = j.x_axis.x > 0.0 && second > 0.0 && j.determinant() > 0.0;
        let symmetric = j.abs_diff_eq(j.transpose(), 1e-9 * j.x_axis.x.abs());
        refuse_unless(positive_j && symmetric, "inertia_kg_m2", j, "symmetric and positive")?;
        for (name, value) in self.positive_numbers() {
            refuse_unless(value.is_finite() && value > 0.0, name, &value, "finite and positive")?;
        }
        for (name, ti) in [("fine.integral_s", self.fine.integral_s), ("coarse.integral_s", self.coarse.integral_s)] {
            refuse_unless(ti.is_none_or(|ti| ti > 0.0), name, &ti, "positive")?;
        }
        let share = self.integral_share;
        refuse_unless((0.0..=1.0).contains(&share), "integral_share", &share, "between 0 and 1")?;
        let section = self.filter.section(self.control_period.s());
        refuse_unless(section.is_some(), "filter", &self.filter, "frequencies below half the control frequency")?;
        let sun_axis = self.safe.sun_axis_body;
        let good = sun_axis.is_finite() && sun_axis.length() > 0.0 && self.safe.search_rate_rad_s.is_finite();
        refuse_unless(good, "safe", &self.safe, "a finite axis and search rate")?;
        if let Some(cone) = self.exclusion {
            let good = cone.boresight_body.length() > 0.0 && cone.half_angle_rad > 0.0 && cone.margin_rad >= 0.0;
            refuse_unless(good, "exclusion", &cone, "a boresight, a positive half angle, a margin")?;
        }
        self.check_hysteresis()
    }

    fn positive_numbers(&self) -> [(&'static str, f64); 11] {
        [
            ("control_period", self.control_period.s()),
            ("fine.bandwidth_hz", self.fine.bandwidth_hz),
            ("fine.damping", self.fine.damping),
            ("coarse.bandwidth_hz", self.coarse.bandwidth_hz),
            ("coarse.damping", self.coarse.damping),
            ("damping_bandwidth_hz", self.damping_bandwidth_hz),
            ("safe.gains.bandwidth_hz", self.safe.gains.bandwidth_hz),
            ("safe.gains.damping", self.safe.gains.damping),
            ("largest_torque_n_m", self.largest_torque_n_m),
            ("slew.largest_rate_rad_s", self.slew.largest_rate_rad_s),
            ("slew.largest_acceleration_rad_s2", self.slew.largest_acceleration_rad_s2),
        ]
    }

    fn check_hysteresis(&self) -> Result<(), Refused> {
        let t = &self.thresholds;
        let ordered = [
            ("rate_low_rad_s below rate_high_rad_s", t.rate_low_rad_s, t.rate_high_rad_s),
            ("slew rate below rate_high_rad_s", self.slew.largest_rate_rad_s, t.rate_high_rad_s),
            ("fine_enter_rad below fine_leave_rad", t.fine_enter_rad, t.fine_leave_rad),
            ("fine_enter_sigma_rad below fine_leave_sigma_rad", t.fine_enter_sigma_rad, t.fine_leave_sigma_rad),
            ("fine_leave_rad below slew_above_rad", t.fine_leave_rad, t.slew_above_rad),
            ("unload below under above", self.unload.below_n_m_s, self.unload.above_n_m_s),
        ];
        for (name, below, above) in ordered {
            refuse_unless(below < above, "thresholds", &(below, above), name)?;
        }
        Ok(())
    }
}

fn refuse_unless(
    good: bool,
    name: &'static str,
    got: &dyn core::fmt::Debug,
    wanted: &'static str,
) -> Result<(), Refused> {
    if good { Ok(()) } else { Err(Refused(format!("attitude control: {name} is {got:?}, wanted {wanted}"))) }
}

/// Commands of people to the control.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Hold this attitude; by a planned turn when it is far off. In safe mode and rate damping: later.
    Point(Rotation<Body, Icrf>),
    /// Turn to this attitude now.
    SlewTo(Rotation<Body, Icrf>),
    /// To safe mode.
    Safe,
    /// Out of safe mode, by way of rate damping.
    Resume,
}

/// Knowledge of the control at one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AcsInput {
    /// Estimated attitude.
    pub attitude: Option<Rotation<Body, Icrf>>,
    /// Estimated rate, rad/s, body axes.
    pub rate_rad_s: DVec3,
    /// Sigma of the attitude, rad, largest axis.
    pub attitude_sigma_rad: f64,
    /// Direction of the Sun, ICRF.
    pub sun_icrf: Option<DVec3>,
    /// Direction of the Sun as the coarse Sun sensor has it, body axes.
    pub sun_body: Option<DVec3>,
    /// Momentum of all wheels, N m s, body axes.
    pub wheel_momentum_n_m_s: DVec3,
}

/// Torques and reports of the control at one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AcsOutput {
    /// Torque on the body, N m, body axes.
    pub torque_n_m: DVec3,
    /// Wheel momentum should be unloaded.
    pub unload: bool,
    /// Mode of this step.
    pub mode: Mode,
    /// Attitude followed now: the target, or the moving reference of a slew. `None` in safe mode, in rate damping and
    /// before the first target.
    pub target: Option<Rotation<Body, Icrf>>,
    /// Rotation vector from the attitude to what is followed (in safe mode: that turns the axis to the Sun), rad, body
    /// axes; zero when unknown.
    pub error_rad: DVec3,
    /// Change of mode at this step.
    pub event: Option<ModeEvent>,
}

impl AcsInput {
    /// Returns numbers that are not finite count as missing; a rate as none.
    pub(super) fn finite(&self) -> Self {
        let direction = |v: &DVec3| v.is_finite() && v.length_squared() > 0.0;
        let or_zero = |v: DVec3| if v.is_finite() { v } else { DVec3::ZERO };
        Self {
            attitude: self.attitude.filter(|attitude| attitude.quat().is_finite()),
            rate_rad_s: or_zero(self.rate_rad_s),
            attitude_sigma_rad: if self.attitude_sigma_rad.is_nan() { f64::INFINITY } else { self.attitude_sigma_rad },
            sun_icrf: self.sun_icrf.filter(direction),
            sun_body: self.sun_body.filter(direction),
            wheel_momentum_n_m_s: or_zero(self.wheel_momentum_n_m_s),
        }
    }
}
