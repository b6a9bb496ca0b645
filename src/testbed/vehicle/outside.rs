//! Commands of an external controller and star tracker to a vehicle simulated inside.
//!
//! Inputs: the side that drives the wheels, motor torques, torques on the body, attitudes with time tags. Commands act
//! at their instants, so that a run repeats in whatever order they were announced; those in the past are refused. The
//! vehicle's own control keeps running beside an external one, and drives nothing. Tests:
//! `tests/closed_loop/reaction.rs`.

use super::{Vehicle, head::BodyAttitude};
use crate::spacecraft::WHEELS_MAX;
use base::axes::{Body, Icrf, Rotation};
use base::time::{Span, Tai};
use glam::{DMat3, DVec3};

/// Commands of each kind that may wait for their instants.
const WAITING_MAX: usize = 4096;
/// Oldest attitude of a tracker outside that is taken.
const OLDEST_FIX: Span = Span::from_ms(2000);
/// Largest torque that is taken for a command, N m: no spacecraft has more.
const MOST_N_M: f64 = 1e6;

/// Request to the wheels' motors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Drive {
    /// A torque on the body, to be shared out.
    Body(DVec3),
    /// A torque on each rotor about its axis.
    Wheels([f64; WHEELS_MAX]),
}

/// Why something from outside is refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum OutsideError {
    /// The wheels are driven inside.
    #[error("the control inside drives the wheels; wanted a hand-over to the control outside first")]
    DrivenInside,
    /// Another number of wheels.
    #[error("got torques of {got} wheels; wanted those of {count}")]
    WheelCount {
        /// Numbers given.
        got: usize,
        /// Wheels.
        count: usize,
    },
    /// A torque that is not finite or too large.
    #[error("got a torque of {got} N m; wanted a finite one, at most {} N m", MOST_N_M)]
    Torque {
        /// The number.
        got: f64,
    },
    /// A command of the past.
    #[error("its time has passed {} s ago; wanted one not before the run's", behind.s())]
    Past {
        /// How long ago.
        behind: Span,
    },
    /// An interval that is not above zero.
    #[error("it lasts for {} s; wanted a time above 0", lasts.s())]
    Lasts {
        /// Its length.
        lasts: Span,
    },
    /// Too many commands wait.
    #[error("{} commands wait already; wanted fewer at a time", WAITING_MAX)]
    Full,
    /// An attitude of another time.
    #[error("its time tag is {} s ago; wanted 0 to {} s", age.s(), OLDEST_FIX.s())]
    Tag {
        /// How long ago.
        age: Span,
    },
    /// A sigma that is not between 0 and 1.
    #[error("got a sigma of {got} rad; wanted one above 0 and below 1")]
    Sigma {
        /// The number.
        got: f64,
    },
}

impl Vehicle {
    /// Hands the wheels over to a control outside, with their motors off, or back to the one inside.
    pub fn hand_over(&mut self, to_outside: bool, now: Tai) {
        if self.is_driven_outside == to_outside {
            return;
        }
        self.is_driven_outside = to_outside;
        self.torques.clear();
        self.torques.push_back((now, Drive::Body(DVec3::ZERO)));
    }

    /// Returns true when a control outside drives the wheels.
    pub fn is_driven_outside(&self) -> bool {
        self.is_driven_outside
    }

    /// Switches the trackers inside off, because an external one gives the attitudes, or on again.
    pub fn hand_over_trackers(&mut self, to_outside: bool) {
        if self.is_sighted_outside != to_outside {
            self.is_sighted_outside = to_outside;
            self.switch_heads(None, to_outside);
        }
    }

    /// Drives each wheel's motor with a torque on its rotor, N m, from `at` until the next such command. The body feels
    /// the opposite; limits of motors and speeds hold as they do for the control inside.
    ///
    /// # Errors
    /// When the wheels are driven inside, a number is bad, or `at` has passed.
    pub fn drive_wheels(&mut self, torques_n_m: &[f64], at: Tai, now: Tai) -> Result<(), OutsideError> {
        let count = self.spacecraft.wheel_speeds_rad_s().len();
        if !self.is_driven_outside {
            return Err(OutsideError::DrivenInside);
        }
        if torques_n_m.len() != count {
            return Err(OutsideError::WheelCount { got: torques_n_m.len(), count });
        }
        torques_n_m.iter().try_for_each(|torque| check_torque(*torque))?;
        check_time(at, now)?;
        if self.torques.len() >= WAITING_MAX {
            return Err(OutsideError::Full);
        }
        let mut drive = [0.0; WHEELS_MAX];
        drive.iter_mut().zip(torques_n_m).for_each(|(place, torque)| *place = *torque);
        let place = self.torques.partition_point(|(other, _)| *other <= at);
        self.torques.insert(place, (at, Drive::Wheels(drive)));
        Ok(())
    }

    /// Turns the body by a torque from outside, body axes, N m, from `from` on for so long, on top of all others:
    /// thrusters, magnetic rods, a tug.
    ///
    /// # Errors
    /// When a number is bad or `from` has passed.
    pub fn push(&mut self, torque_n_m: DVec3, from: Tai, lasts: Span, now: Tai) -> Result<(), OutsideError> {
        check_torque(torque_n_m.length())?;
        check_time(from, now)?;
        if lasts.ns() <= 0 {
            return Err(OutsideError::Lasts { lasts });
        }
        let is_taken = self.spacecraft.push(torque_n_m, from, from + lasts, WAITING_MAX);
        if is_taken { Ok(()) } else { Err(OutsideError::Full) }
    }

    /// Takes an attitude of a tracker outside into the estimator at the next control step. `at` is its time tag, and
    /// `sigma_rad` its error about each body axis.
    ///
    /// # Errors
    /// When the time tag is ahead or too old, or a number is bad.
    pub fn take_attitude(
        &mut self,
        at: Tai,
        body_from_icrf: Rotation<Body, Icrf>,
        sigma_rad: DVec3,
        now: Tai,
    ) -> Result<(), OutsideError> {
        let age = now - at;
        if age.ns() < 0 || age > OLDEST_FIX {
            return Err(OutsideError::Tag { age });
        }
        if let Some(got) = sigma_rad.to_array().into_iter().find(|sigma| !(*sigma > 0.0 && *sigma < 1.0)) {
            return Err(OutsideError::Sigma { got });
        }
        if self.fixes.len() >= WAITING_MAX {
            return Err(OutsideError::Full);
        }
        let covariance_rad2 = DMat3::from_diagonal(sigma_rad * sigma_rad);
        self.fixes.push(BodyAttitude { at, body_from_icrf, covariance_rad2 });
        Ok(())
    }
}

fn check_torque(got: f64) -> Result<(), OutsideError> {
    if got.abs() <= MOST_N_M { Ok(()) } else { Err(OutsideError::Torque { got }) }
}

fn check_time(at: Tai, now: Tai) -> Result<(), OutsideError> {
    if at >= now { Ok(()) } else { Err(OutsideError::Past { behind: now - at }) }
}
