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
mod plant;
mod telemetry;

use fault::ActiveFaults;
pub use fault::VehicleFault;
pub use head::{HeadParams, HeadReport, Heads};
pub use plant::Plant;
pub use telemetry::{ROW_BYTES, Telemetry, TelemetryRow};

use crate::acs::{Acs, AcsInput, AcsOutput, AcsParams, Command, Mode};
use crate::estimator::{Mekf, MekfParams};
use crate::spacecraft::{
    CircularOrbit, Gyro, GyroFault, GyroParams, SpacecraftParams, SunSensor, TestTorque, sun_direction_icrf,
};
use crate::tracker::{Outcome, earth_beta};
use base::axes::{Body, Icrf, Rotation};
use base::time::{Span, Tai};
use base::{image::DnImage, refused::Refused, units::DEG};
use glam::DVec3;
use head::BodyAttitude;
use histories::AttitudeMotion;
use plant::Drive;

/// Speed of light, m/s (exact).
const LIGHT_M_S: f64 = 299_792_458.0;

/// One vehicle.
#[derive(Debug, Clone)]
pub struct VehicleParams {
    /// Body, wheels, modes, disturbances, orbit.
    pub spacecraft: SpacecraftParams,
    /// Attitude at the start.
    pub initial: Rotation<Body, Icrf>,
    /// Rate at the start, body axes.
    pub initial_rate_rad_s: DVec3,
    /// Gyro.
    pub gyro: GyroParams,
    /// Noise of the Sun sensor, rad, one sigma per axis.
    pub sun_sensor_noise_rad: f64,
    /// Estimator.
    pub estimator: MekfParams,
    /// Above this sigma the attitude counts as unknown, rad.
    pub attitude_known_sigma_rad: f64,
    /// Control; its period is that of the gyro and must be whole steps of the spacecraft.
    pub acs: AcsParams,
    /// Where to point from the start.
    pub target: Rotation<Body, Icrf>,
    /// Star tracker heads.
    pub heads: Vec<HeadParams>,
    /// Time between a control step and its torque: what is injected to study latency.
    pub actuation_delay: Span,
    /// Delay of the time tags of frames: a date error unknown to the estimator. It shows as rate times error while the
    /// body turns, and not at rest.
    pub tag_error: Span,
    /// Torques from outside by which the loop is tested.
    pub test_torques: Vec<TestTorque>,
    /// Time between samples of micro-vibration; `None`: none is computed.
    pub vibration_period: Option<Span>,
    /// In safe mode with an attitude known for so long the ground sends `Resume`; `None`: never.
    pub resume_after: Option<Span>,
    /// Control steps from one row of telemetry to the next.
    pub telemetry_every: u32,
    /// Seed of every sensor's noise.
    pub seed: u64,
}

/// A vehicle in flight.
#[derive(Debug)]
pub struct Vehicle {
    /// Parameters of its parts.
    pub params: VehicleParams,
    /// The spacecraft.
    pub plant: Plant,
    /// Its star trackers.
    pub heads: Heads,
    /// Attitude and gyro bias as the gyro and the trackers give them.
    pub estimator: Mekf,
    /// Last commanded target; shown in telemetry even when the control does not follow it.
    pub target: Rotation<Body, Icrf>,
    /// A control outside drives the wheels.
    pub is_driven_outside: bool,
    /// Telemetry not yet taken.
    pub telemetry: Telemetry,
    gyro: Gyro,
    sun_sensor: SunSensor,
    orbit: CircularOrbit,
    acs: Acs,
    /// Attitude at the last gyro sample, and when.
    last: (Tai, Rotation<Body, Icrf>),
    faults: ActiveFaults,
    /// A tracker outside takes the place of those inside.
    is_sighted_outside: bool,
    /// Attitudes of a tracker outside for the next control step.
    fixes: Vec<BodyAttitude>,
    control_steps: u64,
    ground: Ground,
}

/// Ground control: since when it sees attitude and safe mode, and its last command.
#[derive(Debug, Default)]
struct Ground {
    known_since: Option<Tai>,
    safe_since: Option<Tai>,
    safe_by_command: bool,
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
        let plant = Plant::new(&params, start, [seed(1), seed(2)])?;
        let mut acs = Acs::new(params.acs, start)?;
        keep_out_holds(&params, start)?;
        acs.command(Command::Point(params.target))?;
        Ok(Self {
            gyro: Gyro::new(&params.gyro, seed(3)).map_err(of_spacecraft)?,
            sun_sensor: SunSensor::new(params.sun_sensor_noise_rad, seed(4)),
            orbit: CircularOrbit::new(&params.spacecraft.orbit),
            estimator: Mekf::new(params.estimator, start)?,
            heads: Heads::new(&params.heads, start)?,
            last: (start, params.initial),
            faults: ActiveFaults::default(),
            is_driven_outside: false,
            is_sighted_outside: false,
            fixes: Vec::new(),
            control_steps: 0,
            ground: Ground::default(),
            target: params.target,
            telemetry: Telemetry::default(),
            plant,
            acs,
            params,
        })
    }

    /// Returns when the next control step is due.
    pub fn next_due(&self) -> Tai {
        self.last.0 + self.params.acs.control_period
    }

    /// Records when a frame was exposed.
    pub fn tag_frame(&mut self, frame: u8, mid_exposure: Tai) {
        let tagged = mid_exposure + self.params.tag_error;
        self.heads.tag(frame, tagged);
    }

    /// Takes a frame of head `head` that arrived at `at`; a frame of a head that does not exist is ignored.
    pub fn take_frame(&mut self, head: usize, number: u32, image: &DnImage, at: Tai) {
        let beta = self.beta(at);
        let rate = self.estimator.rate_rad_s();
        if let Some(head) = self.heads.0.get_mut(head) {
            head.take_frame(number, image, at, beta, rate);
        }
    }

    /// Returns one control step, at [`Self::next_due`].
    ///
    /// # Errors
    /// When the motion left what can be integrated.
    pub fn act(&mut self) -> Result<(), Refused> {
        let at = self.next_due();
        let truth = self.plant.truth(at)?;
        self.sense(at, &truth);
        self.take_attitudes(at);
        let output = self.control(at, &truth);
        let apply_at = at + self.params.actuation_delay;
        if !self.is_driven_outside {
            self.plant.torques.push_back((apply_at, Drive::Body(output.torque_n_m)));
        }
        self.plant.fly_to(at);
        self.plant.spacecraft.command_unloading(output.unload && !self.is_driven_outside);
        self.telemetry.mode_events.extend(output.event);
        self.resume(at, output.mode);
        self.control_steps += 1;
        if self.control_steps.is_multiple_of(u64::from(self.params.telemetry_every.max(1))) {
            let row = self.row(at, &truth, &output);
            self.plant.largest_vibration_rad = 0.0;
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
            Command::Safe => self.ground.safe_by_command = true,
            Command::Resume => self.ground.safe_by_command = false,
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
            VehicleFault::WheelFailure(wheel) => self.plant.spacecraft.fail_wheel(wheel).map_err(of_spacecraft)?,
            VehicleFault::TrackerOff(head) => self.heads.switch(head, true),
            VehicleFault::GyroDropout | VehicleFault::GyroStuck | VehicleFault::GyroSpike(_) => {}
        }
        Ok(())
    }

    /// Ends a fault whose time is over; another of its kind may go on.
    pub fn clear(&mut self, fault: VehicleFault) {
        self.faults.end(&fault);
        if let VehicleFault::TrackerOff(head) = fault {
            self.heads.switch(head, false);
        }
    }

    /// Returns how often faults of this kind have hit something so far: gyro samples, frames not looked at, things
    /// broken.
    pub fn fault_hits(&self, fault: &VehicleFault) -> u64 {
        match fault {
            VehicleFault::TrackerOff(head) => self.heads.ignored(*head),
            VehicleFault::GyroDropout
            | VehicleFault::GyroStuck
            | VehicleFault::GyroBiasJump(_)
            | VehicleFault::GyroSpike(_)
            | VehicleFault::WheelFailure(_) => self.faults.hits(fault),
        }
    }

    /// Returns the mode of the control.
    pub fn mode(&self) -> Mode {
        self.acs.mode()
    }

    /// Returns the estimated attitude now, if there is one.
    pub fn estimate(&self) -> Option<Rotation<Body, Icrf>> {
        self.estimator.attitude(self.last.0)
    }

    /// Returns when the estimate holds: the last control step.
    pub fn estimate_at(&self) -> Tai {
        self.last.0
    }

    /// Passes the gyro's sample over the control period to the estimator.
    fn sense(&mut self, at: Tai, truth: &AttitudeMotion) {
        let (last_at, last) = self.last;
        self.faults.spoil(&mut self.gyro);
        let reading = self.gyro.measure(&last, &truth.body_from_icrf, at - last_at);
        self.last = (at, truth.body_from_icrf);
        let rate = reading.valid.then_some(reading.rate_rad_s);
        self.estimator.propagate(at, rate);
    }

    fn take_attitudes(&mut self, at: Tai) {
        // Heads share one estimator: their attitudes go in by readiness, the first head first.
        for head in &mut self.heads.0 {
            while let Some(measured) = head.next_ready(at) {
                self.estimator.measure(measured.at, &measured.body_from_icrf, &measured.covariance_rad2);
            }
        }
        for fix in self.fixes.drain(..) {
            self.estimator.measure(fix.at, &fix.body_from_icrf, &fix.covariance_rad2);
        }
    }

    fn control(&mut self, at: Tai, truth: &AttitudeMotion) -> AcsOutput {
        let sun = sun_direction_icrf(at);
        let is_sunlit = self.orbit.is_sunlit(at, sun);
        let seen = self.sun_sensor.measure(&truth.body_from_icrf, sun, is_sunlit);
        let sigma_rad = self.estimator.sigma_rad().max_element();
        let is_known = sigma_rad < self.params.attitude_known_sigma_rad && !self.estimator.is_lost();
        let attitude = self.estimator.attitude(at).filter(|_| is_known);
        self.ground.known_since = attitude.and(self.ground.known_since.or(Some(at)));
        let input = AcsInput {
            attitude,
            rate_rad_s: self.estimator.rate_rad_s(),
            attitude_sigma_rad: sigma_rad,
            sun_icrf: Some(sun),
            sun_body: seen.valid.then_some(seen.direction_body),
            wheel_momentum_n_m_s: self.plant.spacecraft.wheel_momentum_n_m_s(),
        };
        self.acs.step(at, &input)
    }

    /// Acts as ground control: leaves a safe mode that was not commanded once the attitude has been known in it for a
    /// while.
    fn resume(&mut self, at: Tai, mode: Mode) {
        let ground = &mut self.ground;
        ground.safe_since = (mode == Mode::Safe).then(|| ground.safe_since.unwrap_or(at));
        let (Some(wait), Some(safe_since)) = (self.params.resume_after, ground.safe_since) else { return };
        let is_known = ground.known_since.is_some_and(|since| at - since.max(safe_since) >= wait);
        if is_known && !ground.safe_by_command {
            // Resume is refused in no mode.
            let _accepted = self.acs.command(Command::Resume);
        }
    }

    /// Returns the velocity of the vehicle about the barycentre over the speed of light: what its ephemeris aboard
    /// says.
    fn beta(&self, at: Tai) -> DVec3 {
        earth_beta(at) + self.orbit.velocity_m_s(at) / LIGHT_M_S
    }

    fn row(&self, at: Tai, truth: &AttitudeMotion, output: &AcsOutput) -> TelemetryRow {
        let solved = self.heads.0.iter().filter(|head| head.is_solved(at)).count();
        let speeds = self.plant.wheel_speeds_rad_s();
        let first = self.heads.0.first().and_then(|head| head.report.last);
        let solution = match first {
            Some(Outcome::Solved(solution)) => Some(solution),
            Some(Outcome::NoSolution(_)) | None => None,
        };
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
            vibration_rad: self.plant.largest_vibration_rad,
            wheel_speed_rad_s: speeds.iter().fold(0.0, |most, speed| f64::max(most, speed.abs())),
            wheel_momentum_n_m_s: self.plant.spacecraft.wheel_momentum_n_m_s().length(),
            heads_solved: u32::try_from(solved).unwrap_or(u32::MAX),
            no_solution: match first {
                Some(Outcome::NoSolution(reason)) => Some(reason),
                Some(Outcome::Solved(_)) | None => None,
            },
            stars: solution.map_or(0, |solution| solution.stars),
            tracker_sigma_rad: solution.map(|solution| {
                let variance = solution.covariance_rad2;
                (0.5 * (variance.x_axis.x + variance.y_axis.y)).sqrt()
            }),
            sun_angle_rad: self.sun_angle_rad(at, truth),
        }
    }

    fn sun_angle_rad(&self, at: Tai, truth: &AttitudeMotion) -> Option<f64> {
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
