//! A vehicle: spacecraft, gyro, star trackers, estimator and control, closed over frames that come from outside.
//!
//! ```text
//! spacecraft -> gyro ------------------------> estimator -> control -> wheels -> spacecraft
//! frames + EXPOSURE time tags -> tracker heads -----^
//! ```
//!
//! In: frames (pixels only), EXPOSURE messages, commands, faults. Out: the true attitude for the bus, telemetry.
//! Deterministic: parameters, seed and inputs decide every bit. Time only moves forward: `Vehicle::act` does one
//! control step, `Vehicle::truth` carries the smooth motion to an instant before the next one. Micro-vibration is on
//! top of the smooth motion and not seen by gyro or control. Tests: `tests`, and the closed loop over pixels in
//! `tests/closed_loop/pixels.rs`.

mod fault;
mod head;
mod outside;
mod params;
mod telemetry;

use fault::ActiveFaults;
pub use fault::VehicleFault;
pub use head::HeadReport;
pub use outside::OutsideError;
pub use params::{HeadParams, VehicleParams};
pub use telemetry::{ROW_BYTES, Telemetry, TelemetryRow};

use crate::acs::{Acs, AcsInput, AcsOutput, Command, Mode};
use crate::estimator::{Mekf, MekfCounts};
use crate::spacecraft::{
    AttitudeTruth, CircularOrbit, Gyro, GyroFault, MicroVibration, Spacecraft, SunSensor, sun_direction_icrf,
};
use crate::tracker::{CameraWish, Exposed, GuideStars, Outcome, Solution, TrackerParams, earth_beta};
use base::axes::{Body, Icrf, Rotation};
use base::time::Tai;
use base::{image::DnImage, refused::Refused, units::DEG};
use glam::DVec3;
use head::{BodyAttitude, Head};
use outside::Drive;
use stars::catalog::Catalog;
use std::{collections::VecDeque, sync::Arc};

/// Speed of light, m/s (exact).
const LIGHT_M_S: f64 = 299_792_458.0;

/// A vehicle in flight.
#[derive(Debug)]
pub struct Vehicle {
    params: VehicleParams,
    spacecraft: Spacecraft,
    vibration: Option<MicroVibration>,
    gyro: Gyro,
    sun_sensor: SunSensor,
    orbit: CircularOrbit,
    estimator: Mekf,
    acs: Acs,
    heads: Vec<Head>,
    /// Attitude at the last gyro sample, and when.
    last: (Tai, Rotation<Body, Icrf>),
    faults: ActiveFaults,
    /// Torques on their way to the wheels.
    torques: VecDeque<(Tai, Drive)>,
    /// A control outside drives the wheels.
    is_driven_outside: bool,
    /// A tracker outside takes the place of those inside.
    is_sighted_outside: bool,
    /// Attitudes of a tracker outside for the next control step.
    fixes: Vec<BodyAttitude>,
    control_steps: u64,
    known_since: Option<Tai>,
    safe_since: Option<Tai>,
    safe_by_command: bool,
    /// Last commanded target; shown in telemetry even when the control does not follow it.
    target: Rotation<Body, Icrf>,
    largest_vibration_rad: f64,
    telemetry: Telemetry,
}

impl Vehicle {
    /// Returns a vehicle at `start`; its first control step is one period later.
    ///
    /// # Errors
    /// The first parameter that cannot be flown.
    pub fn new(params: VehicleParams, start: Tai) -> Result<Self, Refused> {
        let (control, step) = (params.acs.control_period, params.spacecraft.step);
        if step.ns() <= 0 || control.ns() < step.ns() || control.ns() % step.ns() != 0 {
            return Err(Refused(format!(
                "control period {} ms: wanted a whole number of the spacecraft's steps of {} ms",
                control.ms(),
                step.ms()
            )));
        }
        let seed = |stream: u64| params.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(stream);
        let rate = params.initial_rate_rad_s;
        let mut spacecraft =
            Spacecraft::new(&params.spacecraft, start, params.initial, rate, seed(1)).map_err(of_spacecraft)?;
        spacecraft.add_test_torques(&params.test_torques).map_err(of_spacecraft)?;
        let vibration = params
            .vibration_period
            .map(|period| MicroVibration::new(&params.spacecraft, start, period, seed(2)))
            .transpose()
            .map_err(of_spacecraft)?;
        let mut acs = Acs::new(params.acs, start)?;
        keep_out_holds(&params, start)?;
        acs.command(Command::Point(params.target))?;
        Ok(Self {
            gyro: Gyro::new(&params.gyro, seed(3)).map_err(of_spacecraft)?,
            sun_sensor: SunSensor::new(params.sun_sensor_noise_rad, seed(4)),
            orbit: CircularOrbit::new(&params.spacecraft.orbit),
            estimator: Mekf::new(params.estimator, start)?,
            heads: heads(&params, start)?,
            last: (start, params.initial),
            faults: ActiveFaults::default(),
            torques: VecDeque::with_capacity(64),
            is_driven_outside: false,
            is_sighted_outside: false,
            fixes: Vec::new(),
            control_steps: 0,
            known_since: None,
            safe_since: None,
            safe_by_command: false,
            target: params.target,
            largest_vibration_rad: 0.0,
            telemetry: Telemetry::default(),
            spacecraft,
            vibration,
            acs,
            params,
        })
    }

    /// Returns when the next control step is due.
    pub fn next_due(&self) -> Tai {
        self.last.0 + self.params.acs.control_period
    }

    /// Returns the smooth attitude at `at`: at most two seconds ago, at most the next control step.
    ///
    /// # Errors
    /// When `at` is outside.
    pub fn truth(&mut self, at: Tai) -> Result<AttitudeTruth, Refused> {
        self.fly_to(at);
        self.spacecraft.attitude_at(at).map_err(of_spacecraft)
    }

    /// Returns the same of what has been flown already: looking changes nothing. At most a bus record's time behind.
    ///
    /// # Errors
    /// When `at` is outside.
    pub fn flown_truth(&self, at: Tai) -> Result<AttitudeTruth, Refused> {
        self.spacecraft.attitude_at(at).map_err(of_spacecraft)
    }

    /// Returns the instant until which the motion has been flown.
    pub fn flown_until(&self) -> Tai {
        self.spacecraft.time()
    }

    /// Returns the micro-vibration at `at`: rotation vector of the body away from its smooth attitude, body axes, rad.
    /// Zero when none is computed.
    ///
    /// # Errors
    /// When `at` is more than about two seconds ago.
    pub fn vibration(&mut self, at: Tai) -> Result<DVec3, Refused> {
        self.fly_to(at);
        let speeds = self.spacecraft.wheel_speeds_rad_s();
        let Some(vibration) = self.vibration.as_mut() else { return Ok(DVec3::ZERO) };
        let Some(period) = self.params.vibration_period else { return Ok(DVec3::ZERO) };
        // A sample further, so that any instant lies between two.
        vibration.advance_to(at + period, speeds);
        let sample = vibration.sample(at).map_err(of_spacecraft)?;
        self.largest_vibration_rad = self.largest_vibration_rad.max(sample.length());
        Ok(sample)
    }

    /// Records when a frame was exposed.
    pub fn tag_frame(&mut self, frame: u8, mid_exposure: Tai) {
        let tagged = mid_exposure + self.params.tag_error;
        self.heads.iter_mut().for_each(|head| head.tag(frame, tagged));
    }

    /// Returns whether the EXPOSURE message of a frame has come.
    pub fn has_tag(&self, head: usize, number: u32) -> bool {
        self.heads.get(head).is_some_and(|head| head.tag_of(number).is_some())
    }

    /// Takes a frame of head `head` that arrived at `at`; a frame of a head that does not exist is ignored.
    pub fn take_frame(&mut self, head: usize, number: u32, image: &DnImage, at: Tai) {
        let beta = self.beta(at);
        let rate = self.rate_rad_s();
        if let Some(head) = self.heads.get_mut(head) {
            head.take_frame(number, image, at, beta, rate);
        }
    }

    /// Takes how the next frame of a head was exposed, where that is not as the camera's file says.
    pub fn expose(&mut self, head: usize, exposed: &Exposed) {
        if let Some(head) = self.heads.get_mut(head) {
            head.expose(exposed);
        }
    }

    /// Returns what a head's tracker asks of its camera after the last frame, once.
    pub fn take_wish(&mut self, head: usize) -> Option<CameraWish> {
        self.heads.get_mut(head)?.wish.take()
    }

    /// Returns one control step, at [`Self::next_due`].
    ///
    /// # Errors
    /// When the motion left what can be integrated.
    pub fn act(&mut self) -> Result<(), Refused> {
        let at = self.next_due();
        let truth = self.truth(at)?;
        self.sense(at, &truth);
        self.take_attitudes(at);
        let output = self.control(at, &truth);
        let apply_at = at + self.params.actuation_delay;
        if !self.is_driven_outside {
            self.torques.push_back((apply_at, Drive::Body(output.torque_n_m)));
        }
        self.fly_to(at);
        self.spacecraft.command_unloading(output.unload && !self.is_driven_outside);
        self.telemetry.mode_events.extend(output.event);
        self.resume(at, output.mode);
        self.control_steps += 1;
        if self.control_steps.is_multiple_of(u64::from(self.params.telemetry_every.max(1))) {
            let row = self.row(at, &truth, &output);
            self.largest_vibration_rad = 0.0;
            self.telemetry.rows.push(row);
        }
        Ok(())
    }

    /// Returns a command from the ground.
    ///
    /// # Errors
    /// When the control refuses it.
    pub fn command(&mut self, command: Command) -> Result<(), Refused> {
        self.acs.command(command)?;
        match command {
            Command::Safe => self.safe_by_command = true,
            Command::Resume => self.safe_by_command = false,
            Command::Point(_) | Command::SlewTo(_) => {}
        }
        if let Command::Point(target) | Command::SlewTo(target) = command {
            self.target = target;
        }
        Ok(())
    }

    /// Starts a fault.
    ///
    /// # Errors
    /// When the wheel does not exist.
    pub fn inject(&mut self, fault: VehicleFault) -> Result<(), Refused> {
        self.faults.begin(&fault);
        match fault {
            VehicleFault::GyroBiasJump(jump) => self.gyro.inject(GyroFault::BiasJump(jump)),
            VehicleFault::WheelFailure(wheel) => self.spacecraft.fail_wheel(wheel).map_err(of_spacecraft)?,
            VehicleFault::TrackerOff(head) => self.switch_heads(head, true),
            VehicleFault::GyroDropout | VehicleFault::GyroStuck | VehicleFault::GyroSpike(_) => {}
        }
        Ok(())
    }

    /// Ends a fault whose time is over; another of its kind may go on.
    pub fn clear(&mut self, fault: VehicleFault) {
        self.faults.end(&fault);
        if let VehicleFault::TrackerOff(head) = fault {
            self.switch_heads(head, false);
        }
    }

    /// Returns how often faults of this kind have hit something so far: gyro samples, frames not looked at, things
    /// broken.
    pub fn fault_hits(&self, fault: &VehicleFault) -> u64 {
        match fault {
            VehicleFault::TrackerOff(head) => {
                let chosen = |(i, _): &(usize, &Head)| head.is_none_or(|head| head == *i);
                self.heads.iter().enumerate().filter(chosen).map(|(_, head)| head.report.ignored).sum()
            }
            VehicleFault::GyroDropout
            | VehicleFault::GyroStuck
            | VehicleFault::GyroBiasJump(_)
            | VehicleFault::GyroSpike(_)
            | VehicleFault::WheelFailure(_) => self.faults.hits(fault),
        }
    }

    /// Returns the telemetry not yet taken.
    pub fn telemetry_mut(&mut self) -> &mut Telemetry {
        &mut self.telemetry
    }

    /// Returns the last result of each head.
    pub fn head_reports(&self) -> impl Iterator<Item = &HeadReport> {
        self.heads.iter().map(|head| &head.report)
    }

    /// Returns the counters of the estimator.
    pub fn estimator_counts(&self) -> MekfCounts {
        self.estimator.counts()
    }

    /// Returns the mode of the control.
    pub fn mode(&self) -> Mode {
        self.acs.mode()
    }

    /// Returns the estimated attitude now, if there is one.
    pub fn estimate(&self) -> Option<Rotation<Body, Icrf>> {
        self.estimator.attitude(self.last.0)
    }

    /// Returns one sigma of the estimated attitude per body axis, rad.
    pub fn estimate_sigma_rad(&self) -> DVec3 {
        self.estimator.sigma_rad()
    }

    /// Returns when the estimate holds: the last control step.
    pub fn estimate_at(&self) -> Tai {
        self.last.0
    }

    /// Returns the parameters of the parts.
    pub fn params(&self) -> &VehicleParams {
        &self.params
    }

    /// Returns the commanded target.
    pub fn target(&self) -> Rotation<Body, Icrf> {
        self.target
    }

    /// Speeds of the wheels, rad/s.
    pub fn wheel_speeds_rad_s(&self) -> &[f64] {
        self.spacecraft.wheel_speeds_rad_s()
    }

    /// Moves the smooth motion to the first step boundary not before `at`, with each torque from its time on.
    fn fly_to(&mut self, at: Tai) {
        while let Some((from, drive)) = self.torques.front().copied().filter(|(from, _)| *from <= at) {
            self.spacecraft.advance_to(from);
            match drive {
                Drive::Body(torque_n_m) => {
                    self.spacecraft.command_torques(torque_n_m);
                }
                Drive::Wheels(torques_n_m) => self.spacecraft.command_wheels(&torques_n_m),
            }
            self.torques.pop_front();
        }
        self.spacecraft.advance_to(at);
        if self.spacecraft.time() < at {
            self.spacecraft.advance_to(at + self.params.spacecraft.step);
        }
    }

    /// Passes the gyro's sample over the control period to the estimator.
    fn sense(&mut self, at: Tai, truth: &AttitudeTruth) {
        let (last_at, last) = self.last;
        self.faults.spoil(&mut self.gyro);
        let reading = self.gyro.measure(&last, &truth.body_from_icrf, at - last_at);
        self.last = (at, truth.body_from_icrf);
        let rate = reading.valid.then_some(reading.rate_rad_s);
        self.estimator.propagate(at, rate);
    }

    fn take_attitudes(&mut self, at: Tai) {
        // Heads share one estimator: their attitudes go in by readiness, the first head first.
        for head in &mut self.heads {
            while let Some(measured) = head.next_ready(at) {
                self.estimator.measure(measured.at, &measured.body_from_icrf, &measured.covariance_rad2);
            }
        }
        for fix in self.fixes.drain(..) {
            self.estimator.measure(fix.at, &fix.body_from_icrf, &fix.covariance_rad2);
        }
    }

    fn control(&mut self, at: Tai, truth: &AttitudeTruth) -> AcsOutput {
        let sun = sun_direction_icrf(at);
        let is_sunlit = self.orbit.is_sunlit(at, sun);
        let seen = self.sun_sensor.measure(&truth.body_from_icrf, sun, is_sunlit);
        let sigma_rad = self.estimator.sigma_rad().max_element();
        let is_known = sigma_rad < self.params.attitude_known_sigma_rad && !self.estimator.is_lost();
        let attitude = self.estimator.attitude(at).filter(|_| is_known);
        self.known_since = attitude.and(self.known_since.or(Some(at)));
        let input = AcsInput {
            attitude,
            rate_rad_s: self.rate_rad_s(),
            attitude_sigma_rad: sigma_rad,
            sun_icrf: Some(sun),
            sun_body: seen.valid.then_some(seen.direction_body),
            wheel_momentum_n_m_s: self.spacecraft.wheel_momentum_n_m_s(),
        };
        self.acs.step(at, &input)
    }

    /// Acts as ground control: leaves a safe mode that was not commanded once the attitude has been known in it for a
    /// while.
    fn resume(&mut self, at: Tai, mode: Mode) {
        self.safe_since = (mode == Mode::Safe).then(|| self.safe_since.unwrap_or(at));
        let (Some(wait), Some(safe_since)) = (self.params.resume_after, self.safe_since) else { return };
        let is_known = self.known_since.is_some_and(|since| at - since.max(safe_since) >= wait);
        if is_known && !self.safe_by_command {
            // Resume is refused in no mode.
            let _accepted = self.acs.command(Command::Resume);
        }
    }

    fn rate_rad_s(&self) -> DVec3 {
        self.estimator.rate_rad_s()
    }

    fn switch_heads(&mut self, head: Option<usize>, is_off: bool) {
        let chosen = |(i, _): &(usize, &mut Head)| head.is_none_or(|head| head == *i);
        self.heads.iter_mut().enumerate().filter(chosen).for_each(|(_, head)| head.switch(is_off));
    }

    /// Returns the velocity of the vehicle about the barycentre over the speed of light: what its ephemeris aboard
    /// says.
    fn beta(&self, at: Tai) -> DVec3 {
        earth_beta(at) + self.orbit.velocity_m_s(at) / LIGHT_M_S
    }

    fn row(&self, at: Tai, truth: &AttitudeTruth, output: &AcsOutput) -> TelemetryRow {
        let solved = self.heads.iter().filter(|head| head.is_solved(at)).count();
        let speeds = self.spacecraft.wheel_speeds_rad_s();
        let estimate = self.estimator.attitude(at);
        TelemetryRow {
            at,
            mode: output.mode,
            pointing_error_rad: truth.body_from_icrf.rotation_vector_to(&self.target),
            knowledge_error_rad: estimate.map(|estimate| truth.body_from_icrf.rotation_vector_to(&estimate)),
            sigma_rad: self.estimator.sigma_rad().max_element(),
            rate_rad_s: truth.rate_rad_s,
            bias_error_rad_s: self.estimator.bias_rad_s() - self.gyro.bias_rad_s(),
            torque_n_m: output.torque_n_m,
            vibration_rad: self.largest_vibration_rad,
            wheel_speed_rad_s: speeds.iter().fold(0.0, |most, speed| f64::max(most, speed.abs())),
            wheel_momentum_n_m_s: self.spacecraft.wheel_momentum_n_m_s().length(),
            heads_solved: u32::try_from(solved).unwrap_or(u32::MAX),
            no_solution: match self.heads.first().and_then(|head| head.report.last) {
                Some(Outcome::NoSolution(reason)) => Some(reason),
                _ => None,
            },
            stars: self.solution().map_or(0, |solution| solution.stars),
            tracker_sigma_rad: self.solution().map(|solution| {
                let variance = solution.covariance_rad2;
                (0.5 * (variance.x_axis.x + variance.y_axis.y)).sqrt()
            }),
            sun_angle_rad: self.sun_angle_rad(at, truth),
        }
    }

    /// Returns the first head's last attitude, when its last frame gave one.
    fn solution(&self) -> Option<Solution> {
        match self.heads.first()?.report.last? {
            Outcome::Solved(solution) => Some(solution),
            Outcome::NoSolution(_) => None,
        }
    }

    fn sun_angle_rad(&self, at: Tai, truth: &AttitudeTruth) -> Option<f64> {
        let cone = self.params.acs.exclusion?;
        Some(cone.sun_angle_rad(&truth.body_from_icrf, sun_direction_icrf(at)))
    }
}

fn of_spacecraft(why: Refused) -> Refused {
    Refused(format!("spacecraft: {why}"))
}

/// Checks the first target against the Sun: the control does not know the Sun before its first step.
fn keep_out_holds(params: &VehicleParams, start: Tai) -> Result<(), Refused> {
    let Some(cone) = params.acs.exclusion else { return Ok(()) };
    let angle_rad = cone.sun_angle_rad(&params.target, sun_direction_icrf(start));
    if angle_rad >= cone.half_angle_rad {
        return Ok(());
    }
    let (sun_angle_deg, least_deg) = (angle_rad / DEG, cone.half_angle_rad / DEG);
    Err(Refused(format!(
        "target puts the boresight {sun_angle_deg:.2} deg from the Sun, wanted at least {least_deg:.2} deg"
    )))
}

/// Returns the heads; equal trackers share one list of guide stars.
fn heads(params: &VehicleParams, start: Tai) -> Result<Vec<Head>, Refused> {
    let catalog = Catalog::built_in().map_err(|why| Refused(format!("catalog: {why}")))?;
    let mut guides: Vec<(TrackerParams, Arc<GuideStars>)> = Vec::new();
    let mut heads = Vec::with_capacity(params.heads.len());
    for head in &params.heads {
        let known = guides.iter().find(|(tracker, _)| *tracker == head.tracker).map(|(_, guide)| Arc::clone(guide));
        let guide = match known {
            Some(guide) => guide,
            None => {
                let guide = Arc::new(GuideStars::new(&catalog, &head.tracker, start)?);
                guides.push((head.tracker, Arc::clone(&guide)));
                guide
            }
        };
        heads.push(Head::new(*head, guide));
    }
    Ok(heads)
}
