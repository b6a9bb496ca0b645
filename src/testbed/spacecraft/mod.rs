//! A simulated spacecraft: torques commanded -> attitude, rate and acceleration as they really are.
//!
//! Two scales of time. The smooth motion (rigid body, reaction wheels, flexible modes, torques from outside) is
//! integrated here at a fixed step of 5 to 20 ms. What the wheels' imbalance adds above it is linear and small, and
//! `MicroVibration` samples it apart, as a rotation vector on top. `Gyro` and `SunSensor` measure.
//!
//! Assumptions: circular orbit, constant inertia, small deflections, commands take effect at step boundaries.
//! Deterministic: the same parameters, seed and calls give the same bits. After `new` nothing is allocated.
//!
//! `tests` hold conservation (1e-10 over 1000 s), order 4 of the method, closed forms and every refusal.

use base::refused::Refused;

mod check;
mod equations;
mod gyro;
mod history;
mod micro_vibration;
mod motors;
mod orbit;
mod params;
#[cfg(test)]
mod tests;

pub use check::is_inertia;
pub use gyro::{Gyro, GyroFault, GyroParams, GyroReading};
pub use micro_vibration::MicroVibration;
pub use motors::TestTorque;
pub use orbit::{CircularOrbit, SunReading, SunSensor, sun_direction_icrf};
pub use params::{
    CircularOrbitParams, DisturbanceParams, FlexibleMode, Harmonic, MODES_MAX, SpacecraftParams, UnloadingParams,
    WHEELS_MAX, WheelParams,
};

use crate::noise::Gaussian;
use base::axes::{Body, Icrf, Rotation};
use base::time::{Span, Tai};
use equations::{Equations, Held, State};
use glam::DVec3;
use histories::AttitudeMotion;
use history::History;
use motors::Motors;

/// How long the past is kept: a tracker asks for the middle of an exposure that is over.
const KEPT: Span = Span::from_ms(2000);

/// One integrated step: where it began and what was held during it.
#[derive(Debug, Clone, Copy)]
struct Step {
    from: State,
    held: Held,
}

/// A spacecraft in motion.
#[derive(Debug)]
pub struct Spacecraft {
    equations: Equations,
    motors: Motors,
    unloading: UnloadingParams,
    is_unloading: bool,
    walk_per_step_n_m: f64,
    walk_torque_n_m: DVec3,
    noise: Gaussian,
    test_torques: Vec<TestTorque>,
    /// Torques from outside: from when to when, and body axes, N m.
    pushes: Vec<(Tai, Tai, DVec3)>,
    start: Tai,
    step: Span,
    state: State,
    steps: History<Step>,
}

impl Spacecraft {
    /// Makes a spacecraft at `start` with this attitude and rate (body axes, rad/s). `seed` is for the random walk of
    /// the torque.
    ///
    /// # Errors
    /// When a parameter is not physical or the step too long: [`Refused`].
    pub fn new(
        params: &SpacecraftParams,
        start: Tai,
        body_from_icrf: Rotation<Body, Icrf>,
        rate_rad_s: DVec3,
        seed: u64,
    ) -> Result<Self, Refused> {
        check::check(params)?;
        check::within("body", 0, "length of rate_rad_s", rate_rad_s.length(), "finite", true)?;
        let equations = Equations::new(params, (start - params.orbit.epoch).s());
        let mut speeds = [0.0; WHEELS_MAX];
        for (speed, wheel) in speeds.iter_mut().zip(&params.wheels) {
            *speed = wheel.initial_speed_rad_s;
        }
        let still = [0.0; MODES_MAX];
        Ok(Self {
            motors: Motors::new(params, &equations),
            equations,
            unloading: params.unloading,
            is_unloading: false,
            walk_per_step_n_m: params.disturbance.random_walk_n_m_sqrt_s * params.step.s().sqrt(),
            walk_torque_n_m: DVec3::ZERO,
            noise: Gaussian::new(seed),
            test_torques: Vec::new(),
            pushes: Vec::new(),
            start,
            step: params.step,
            state: State { q: body_from_icrf.quat(), rate: rate_rad_s, speeds, modal: still, modal_rate: still },
            steps: History::new(entries_kept(params.step)),
        })
    }

    /// Integrates whole steps up to the last step boundary that is not after `at`. An earlier `at` changes nothing.
    pub fn advance_to(&mut self, at: Tai) {
        while self.time() + self.step <= at {
            self.advance_one_step();
        }
    }

    /// Returns the boundary that the motion has reached.
    pub fn time(&self) -> Tai {
        self.boundary(self.steps.next())
    }

    /// Returns the truth at `at`, from about two seconds ago up to [`Self::time`]: one step of the method from the
    /// boundary before `at` to `at`, with the torques held then. So the error is that of the integration itself, and at
    /// a boundary the integrated state comes out bit for bit. The acceleration jumps where torques do; at a boundary it
    /// is that of the step that ends there.
    ///
    /// # Errors
    /// When `at` is not kept.
    pub fn attitude_at(&self, at: Tai) -> Result<AttitudeMotion, Refused> {
        let (first, last) = (self.boundary(self.steps.oldest()), self.time());
        let outside = Refused(format!("no truth kept for {at}: kept are {first} to {last}"));
        if at < first || at > last {
            return Err(outside);
        }
        if at == self.start {
            let held = self.steps.get(0).map_or_else(|| self.held(), |step| step.held);
            let state = self.steps.get(0).map_or(self.state, |step| step.from);
            return Ok(self.truth(&state, &held, at));
        }
        // The step that ends at or after `at`; at the oldest boundary, the one that begins there.
        let number = ((at - self.start).ns() - 1).div_euclid(self.step.ns()).unsigned_abs().max(self.steps.oldest());
        let step = self.steps.get(number).ok_or(outside)?;
        let from = self.boundary(number);
        let state = if at == from {
            step.from
        } else {
            self.equations.step(&step.from, &step.held, self.since_start_s(from), (at - from).s())
        };
        Ok(self.truth(&state, &step.held, at))
    }

    /// Commands a torque on the body (body axes, N m), held from [`Self::time`] until the next command. Distributed
    /// over the healthy wheels. Returns what their motors can give at their present speeds; friction is not in it.
    pub fn command_torques(&mut self, torque_body_n_m: DVec3) -> DVec3 {
        self.motors.demand(torque_body_n_m);
        let motor = self.motors.torques(&self.equations, &self.state, self.step.s());
        self.equations.rotors.iter().zip(motor).map(|(rotor, torque)| rotor.axis * -torque).sum()
    }

    /// Commands a torque on each rotor about its axis (N m), held from [`Self::time`] until the next command of either
    /// kind. Limits apply wheel by wheel; a dead motor gives nothing.
    pub fn command_wheels(&mut self, torques_n_m: &[f64; WHEELS_MAX]) {
        self.motors.demand_of_each(torques_n_m);
    }

    /// Turns the body by a torque (body axes, N m) between two instants, on top of all others; over an integration step
    /// that it covers in part it acts with that share. Returns false when `most` wait or act already.
    pub fn push(&mut self, torque_n_m: DVec3, from: Tai, until: Tai, most: usize) -> bool {
        let has_place = self.pushes.len() < most;
        if has_place {
            self.pushes.push((from, until, torque_n_m));
        }
        has_place
    }

    /// Switches momentum unloading on or off, from [`Self::time`] on.
    pub fn command_unloading(&mut self, is_on: bool) {
        self.is_unloading = is_on;
    }

    /// Returns the motor of wheel `index` is dead from [`Self::time`] on: it coasts against its friction. The torque
    /// already commanded is not redistributed; the next one is.
    ///
    /// # Errors
    /// When the wheel does not exist.
    pub fn fail_wheel(&mut self, index: usize) -> Result<(), Refused> {
        let count = self.equations.rotors.len();
        if index >= count {
            return Err(Refused(format!("wheel {index}: wanted one of the {count}, counted from 0")));
        }
        self.motors.fail(index, &self.equations);
        Ok(())
    }

    /// Adds torques from outside by which the loop is tested; each is held over an integration step at its value in the
    /// middle.
    ///
    /// # Errors
    /// When a number is not finite or a frequency or a time negative.
    pub fn add_test_torques(&mut self, torques: &[TestTorque]) -> Result<(), Refused> {
        torques.iter().enumerate().try_for_each(|(index, torque)| torque.check(index))?;
        self.test_torques.extend_from_slice(torques);
        Ok(())
    }

    /// Speeds of the wheels relative to the body at [`Self::time`], rad/s.
    pub fn wheel_speeds_rad_s(&self) -> &[f64] {
        &self.state.speeds[..self.equations.rotors.len()]
    }

    /// Returns the momentum of the wheels relative to the body at [`Self::time`], body axes, N m s.
    pub fn wheel_momentum_n_m_s(&self) -> DVec3 {
        self.equations.wheel_momentum(&self.state.speeds)
    }

    /// Returns the angular momentum of everything at [`Self::time`], ICRF, N m s: constant without torques from
    /// outside.
    #[cfg(test)]
    pub fn momentum_icrf_n_m_s(&self) -> DVec3 {
        self.state.q.conjugate() * self.equations.momentum(&self.state)
    }

    /// Returns the kinetic and elastic energy at [`Self::time`], J: constant without torques, friction and damping.
    #[cfg(test)]
    pub fn energy_j(&self) -> f64 {
        self.equations.energy(&self.state)
    }

    /// Returns the modal coordinates at [`Self::time`], sqrt(kg) m.
    #[cfg(test)]
    pub fn modal_coordinates(&self) -> &[f64] {
        &self.state.modal[..self.equations.modes.len()]
    }

    fn advance_one_step(&mut self) {
        let step = Step { from: self.state, held: self.held() };
        let t_s = self.since_start_s(self.time());
        self.state = self.equations.step(&step.from, &step.held, t_s, self.step.s());
        self.steps.push(step);
        let now = self.time();
        self.pushes.retain(|(_, until, _)| *until > now);
        if self.walk_per_step_n_m > 0.0 {
            self.walk_torque_n_m += self.noise.vector(self.walk_per_step_n_m);
        }
    }

    /// Returns the values that are constant during the next step.
    fn held(&self) -> Held {
        let unloading = if self.is_unloading { self.unloading_torque_n_m() } else { DVec3::ZERO };
        Held {
            motor: self.motors.torques(&self.equations, &self.state, self.step.s()),
            outside: self.walk_torque_n_m + unloading + self.test_torque_n_m() + self.pushed_n_m(),
        }
    }

    fn test_torque_n_m(&self) -> DVec3 {
        let middle_s = self.since_start_s(self.time()) + 0.5 * self.step.s();
        self.test_torques.iter().map(|torque| torque.at_n_m(middle_s)).sum()
    }

    /// Returns the mean of the torques from outside over the next step.
    fn pushed_n_m(&self) -> DVec3 {
        let (begin, end) = (self.time(), self.time() + self.step);
        let share = |from: Tai, until: Tai| (until.min(end) - from.max(begin)).s().max(0.0) / self.step.s();
        self.pushes.iter().map(|(from, until, torque_n_m)| *torque_n_m * share(*from, *until)).sum()
    }

    fn unloading_torque_n_m(&self) -> DVec3 {
        let largest = DVec3::splat(self.unloading.largest_torque_n_m);
        (self.wheel_momentum_n_m_s() * -self.unloading.gain_per_s).clamp(-largest, largest)
    }

    fn truth(&self, state: &State, held: &Held, at: Tai) -> AttitudeMotion {
        AttitudeMotion {
            body_from_icrf: Rotation::from_quat(state.q),
            rate_rad_s: state.rate,
            acceleration_rad_s2: self.equations.acceleration(state, held, self.since_start_s(at)),
        }
    }

    fn since_start_s(&self, at: Tai) -> f64 {
        (at - self.start).s()
    }

    #[allow(clippy::cast_possible_wrap, reason = "2^63 steps are not lived to see")]
    fn boundary(&self, number: u64) -> Tai {
        self.start + Span::from_ns((number as i64).saturating_mul(self.step.ns()))
    }
}

/// Entries of one `period` that cover [`KEPT`].
#[allow(clippy::cast_possible_truncation, reason = "at most 2e9 entries of 1 ns; memory ends before")]
fn entries_kept(period: Span) -> usize {
    (KEPT.ns() / period.ns()).unsigned_abs() as usize + 1
}
