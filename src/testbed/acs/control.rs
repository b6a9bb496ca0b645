//! The attitude control: one call per control period.
//!
//! Input: estimated attitude and rate, Sun, wheel momentum. Output: torque on the body, mode and its changes. Pure
//! function of its inputs and time; nothing allocates.

use super::laws::{FeedbackLoop, Gains, error_to_direction, gyroscopic, limited};
use super::mode_logic::{Cause, Mode, ModeEvent, ModeLogic, Situation};
use super::params::{AcsInput, AcsOutput, AcsParams, Command};
use super::slew::{Leg, SlewLimits, SlewPath};
use super::{avoidance::KeepOut, filter::StructuralFilter};
use base::axes::{Body, Icrf, Rotation};
use base::{refused::Refused, time::Tai, units::DEG};
use core::f64::consts::TAU;
use glam::DVec3;
use histories::AttitudeMotion;

/// The attitude control.
#[derive(Debug, Clone)]
pub struct Acs {
    params: AcsParams,
    limits: SlewLimits,
    logic: ModeLogic,
    target: Option<Rotation<Body, Icrf>>,
    slew: Option<(Tai, SlewPath)>,
    asked: Option<(Mode, Option<SlewPath>)>,
    fine: FeedbackLoop,
    coarse: FeedbackLoop,
    safe: FeedbackLoop,
    unload: bool,
    last_at: Tai,
    attitude: Option<Rotation<Body, Icrf>>,
    sun_icrf: Option<DVec3>,
}

impl Acs {
    /// Begins in rate damping, without target: the first attitude known when the body is at rest will be held.
    ///
    /// # Errors
    /// Settings out of range.
    pub fn new(params: AcsParams, at: Tai) -> Result<Self, Refused> {
        params.check()?;
        let period_s = params.control_period.s();
        let make = |gains: &Gains, filter: StructuralFilter| {
            let refused = || Refused(format!("attitude control: filter is {filter:?}, wanted in range"));
            Ok(FeedbackLoop::new(gains.of(&params.inertia_kg_m2), filter.section(period_s).ok_or_else(refused)?))
        };
        Ok(Self {
            limits: torque_limited(&params),
            logic: ModeLogic::new(Mode::RateDamping, params.thresholds),
            target: None,
            slew: None,
            asked: None,
            fine: make(&params.fine, params.filter)?,
            coarse: make(&params.coarse, StructuralFilter::None)?,
            safe: make(&params.safe.gains, StructuralFilter::None)?,
            unload: false,
            last_at: at,
            attitude: None,
            sun_icrf: None,
            params,
        })
    }

    /// Takes a command; it acts at the next step.
    ///
    /// # Errors
    /// A target inside the keep-out cone; a slew without attitude, Sun (when there is a cone) or in a wrong mode.
    pub fn command(&mut self, command: Command) -> Result<(), Refused> {
        match command {
            Command::Point(target) => {
                self.check_target(&target)?;
                self.point(target);
            }
            Command::SlewTo(target) => {
                let path = self.slew_to(&target)?;
                self.target = Some(target);
                self.asked = Some((Mode::Slew, Some(path)));
            }
            Command::Safe => self.asked = Some((Mode::Safe, None)),
            Command::Resume if self.mode_to_be() == Mode::Safe => self.asked = Some((Mode::RateDamping, None)),
            Command::Resume => {}
        }
        Ok(())
    }

    /// Returns one control period up to `at`.
    pub fn step(&mut self, at: Tai, input: &AcsInput) -> AcsOutput {
        let input = input.finite();
        self.attitude = input.attitude;
        self.sun_icrf = input.sun_icrf.or(self.sun_icrf);
        let event = self.change_mode(at, &input);
        let reference = self.reference(at);
        let error_rad = self.error(&input, reference.as_ref());
        let dt_s = (at - self.last_at).s().max(0.0);
        self.last_at = at;
        let wanted = self.wanted_torque(&input, reference.as_ref(), error_rad, dt_s);
        let torque_n_m = limited(wanted, self.params.largest_torque_n_m);
        self.note_saturation(torque_n_m != wanted);
        let momentum = input.wheel_momentum_n_m_s.length();
        let limit = if self.unload { self.params.unload.below_n_m_s } else { self.params.unload.above_n_m_s };
        self.unload = momentum > limit;
        AcsOutput {
            torque_n_m,
            unload: self.unload,
            mode: self.logic.mode,
            target: reference.map(|reference| reference.body_from_icrf),
            error_rad,
            event,
        }
    }

    /// Returns the mode.
    pub fn mode(&self) -> Mode {
        self.logic.mode
    }

    /// Returns the slew under way or done last, with its beginning.
    pub fn slew(&self) -> Option<&(Tai, SlewPath)> {
        self.slew.as_ref()
    }

    /// Returns the mode at the next step, as far as commands go: a later command does not undo one to safe mode.
    fn mode_to_be(&self) -> Mode {
        self.asked.map_or(self.logic.mode, |(mode, _)| mode)
    }

    /// Takes a new target: starts a planned turn at once when it is far off; ends a slew in progress.
    fn point(&mut self, target: Rotation<Body, Icrf>) {
        let pointing = matches!(self.mode_to_be(), Mode::CoarsePointing | Mode::FinePointing);
        let start = self.attitude.filter(|attitude| pointing && self.is_far(attitude, &target));
        if let Some(attitude) = start {
            self.asked = Some((Mode::Slew, Some(self.planned(self.slew_start(attitude), &target))));
        } else if self.mode_to_be() == Mode::Slew {
            self.asked = Some((Mode::CoarsePointing, None));
        }
        self.target = Some(target);
    }

    fn is_far(&self, attitude: &Rotation<Body, Icrf>, target: &Rotation<Body, Icrf>) -> bool {
        attitude.rotation_vector_to(target).length() > self.params.thresholds.slew_above_rad
    }

    /// Returns the start of a slew: in fine pointing the target, not the estimate, so that the reference goes on
    /// without a step.
    fn slew_start(&self, attitude: Rotation<Body, Icrf>) -> Rotation<Body, Icrf> {
        let is_fine = self.logic.mode == Mode::FinePointing;
        self.target.filter(|target| is_fine && !self.is_far(&attitude, target)).unwrap_or(attitude)
    }

    fn check_target(&self, target: &Rotation<Body, Icrf>) -> Result<(), Refused> {
        if !target.quat().is_finite() {
            return Err(Refused("target is not a finite quaternion".to_owned()));
        }
        if let (Some(cone), Some(sun)) = (&self.params.exclusion, self.sun_icrf) {
            let angle = cone.sun_angle_rad(target, sun);
            if angle < cone.half_angle_rad {
                let least_deg = cone.half_angle_rad / DEG;
                return Err(Refused(format!(
                    "target puts the boresight {sun_angle_deg:.2} deg from the Sun, wanted at least {least_deg:.2} deg",
                    sun_angle_deg = angle / DEG
                )));
            }
        }
        Ok(())
    }

    fn slew_to(&self, target: &Rotation<Body, Icrf>) -> Result<SlewPath, Refused> {
        let mode = self.mode_to_be();
        if !matches!(mode, Mode::CoarsePointing | Mode::FinePointing) {
            return Err(Refused(format!(
                "slew refused in mode {mode:?}, wanted CoarsePointing or FinePointing; try Point, or Resume before"
            )));
        }
        let attitude =
            self.attitude.ok_or_else(|| Refused("slew refused: no attitude is known; try later".to_owned()))?;
        if self.params.exclusion.is_some() && self.sun_icrf.is_none() {
            return Err(Refused(
                "slew refused: the boresight must keep from the Sun, and no direction of the Sun came yet; try later"
                    .to_owned(),
            ));
        }
        self.check_target(target)?;
        Ok(self.planned(self.slew_start(attitude), target))
    }

    /// Returns the around the Sun where there is a cone and the Sun is known; else straight.
    fn planned(&self, start: Rotation<Body, Icrf>, end: &Rotation<Body, Icrf>) -> SlewPath {
        let cone: Option<(&KeepOut, DVec3)> = self.params.exclusion.as_ref().zip(self.sun_icrf);
        cone.map_or_else(
            || SlewPath::single(Leg::between(start, end, &self.limits)),
            |(cone, sun)| cone.path(start, end, sun, &self.limits),
        )
    }

    fn change_mode(&mut self, at: Tai, input: &AcsInput) -> Option<ModeEvent> {
        let event = if let Some((mode, path)) = self.asked.take() {
            self.slew = path.map(|path| (at, path)).or(self.slew);
            Some(self.logic.change(at, mode, Cause::Commanded))
        } else {
            let situation = self.situation(at, input);
            self.logic.step(at, &situation)
        }?;
        self.enter(at, &event, input);
        Some(event)
    }

    fn enter(&mut self, at: Tai, event: &ModeEvent, input: &AcsInput) {
        for pointing in [&mut self.fine, &mut self.coarse, &mut self.safe] {
            pointing.start_again();
        }
        if event.to == Mode::CoarsePointing && self.target.is_none() {
            self.target = input.attitude;
        }
        if let (Cause::FarFromTarget, Some(attitude), Some(target)) = (event.cause, input.attitude, self.target) {
            self.slew = Some((at, self.planned(attitude, &target)));
        }
    }

    fn situation(&self, at: Tai, input: &AcsInput) -> Situation {
        let reference = self.reference(at);
        // Without a target the attitude now is the target.
        let error = input.attitude.map(|attitude| {
            reference.map_or(0.0, |wanted| attitude.rotation_vector_to(&wanted.body_from_icrf).length())
        });
        let wanted_rate = reference.map_or(DVec3::ZERO, |wanted| wanted.rate_rad_s);
        Situation {
            rate_rad_s: input.rate_rad_s.length(),
            rate_error_rad_s: (input.rate_rad_s - wanted_rate).length(),
            error_rad: error,
            sigma_rad: input.attitude_sigma_rad,
            slew_over: self.slew.is_some_and(|(start, path)| (at - start).s() >= path.duration_s()),
        }
    }

    fn reference(&self, at: Tai) -> Option<AttitudeMotion> {
        let at_rest = || self.target.map(AttitudeMotion::at_rest);
        match self.logic.mode {
            Mode::Safe | Mode::RateDamping => None,
            Mode::CoarsePointing | Mode::FinePointing => at_rest(),
            Mode::Slew => match &self.slew {
                Some((start, path)) => Some(path.reference((at - *start).s())),
                None => at_rest(),
            },
        }
    }

    fn error(&self, input: &AcsInput, reference: Option<&AttitudeMotion>) -> DVec3 {
        if self.logic.mode == Mode::Safe {
            return input.sun_body.map_or(DVec3::ZERO, |sun| error_to_direction(self.params.safe.sun_axis_body, sun));
        }
        let (Some(attitude), Some(wanted)) = (input.attitude, reference) else { return DVec3::ZERO };
        attitude.rotation_vector_to(&wanted.body_from_icrf)
    }

    fn wanted_torque(
        &mut self,
        input: &AcsInput,
        reference: Option<&AttitudeMotion>,
        error: DVec3,
        dt_s: f64,
    ) -> DVec3 {
        let j = self.params.inertia_kg_m2;
        let rate = input.rate_rad_s;
        let coupling = gyroscopic(&j, rate, input.wheel_momentum_n_m_s);
        let wanted = reference.copied().unwrap_or_else(|| AttitudeMotion::at_rest(Rotation::IDENTITY));
        let limits = self.limits;
        let control = match self.logic.mode {
            Mode::RateDamping => j * (rate * (-TAU * self.params.damping_bandwidth_hz)),
            Mode::Safe => {
                let search = if input.sun_body.is_some() { DVec3::ZERO } else { self.params.safe.search_rate_rad_s };
                self.safe.torque(error, rate - search, dt_s, &limits, DVec3::ZERO)
            }
            Mode::CoarsePointing => {
                // A far target is not turned to by feedback, blind to the Sun: stop, then a turn is planned.
                let is_near = error.length() <= self.params.thresholds.slew_above_rad;
                let error = if is_near { error } else { DVec3::ZERO };
                self.coarse.torque(error, rate, dt_s, &limits, self.integral_limit())
            }
            Mode::FinePointing => self.fine.torque(error, rate, dt_s, &limits, self.integral_limit()),
            Mode::Slew => {
                let feedback = self.fine.torque(error, rate - wanted.rate_rad_s, dt_s, &limits, DVec3::ZERO);
                feedback + j * wanted.acceleration_rad_s2
            }
        };
        control + coupling
    }

    fn integral_limit(&self) -> DVec3 {
        DVec3::splat(self.params.largest_torque_n_m * self.params.integral_share)
    }

    fn note_saturation(&mut self, saturated: bool) {
        for pointing in [&mut self.fine, &mut self.coarse, &mut self.safe] {
            pointing.note_saturation(saturated);
        }
    }
}

/// Returns the slew limits, with the acceleration cut to what half the torque gives about the stiffest axis.
fn torque_limited(params: &AcsParams) -> SlewLimits {
    let j = &params.inertia_kg_m2;
    // Largest row sum: a bound on the largest principal inertia (Gershgorin).
    let stiffest = [j.x_axis, j.y_axis, j.z_axis].map(|row| row.abs().element_sum()).into_iter().fold(0.0, f64::max);
    let possible = 0.5 * params.largest_torque_n_m / stiffest;
    SlewLimits {
        largest_rate_rad_s: params.slew.largest_rate_rad_s,
        largest_acceleration_rad_s2: params.slew.largest_acceleration_rad_s2.min(possible),
    }
}
