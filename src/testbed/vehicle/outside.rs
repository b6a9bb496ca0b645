//! Commands of an external controller and star tracker to a vehicle simulated inside.
//!
//! Inputs: the side that drives the wheels, motor torques, torques on the body, attitudes with time tags. Commands act
//! at their instants, so that a run repeats in whatever order they were announced; those in the past are refused. The
//! vehicle's own control keeps running beside an external one, and drives nothing. Tests:
//! `tests/closed_loop/reaction.rs`.

use super::{Vehicle, head::BodyAttitude, plant::Drive};
use crate::spacecraft::WHEELS_MAX;
use base::axes::{Body, Icrf, Rotation};
use base::refused::Refused;
use base::time::{Span, Tai};
use glam::{DMat3, DVec3};

/// Commands of each kind that may wait for their instants.
const WAITING_MAX: usize = 4096;
/// Oldest attitude of a tracker outside that is taken.
const OLDEST_FIX: Span = Span::from_ms(2000);
/// Largest torque that is taken for a command, N m: no spacecraft has more.
const MOST_N_M: f64 = 1e6;

impl Vehicle {
    /// Hands the wheels over to a control outside, with their motors off, or back to the one inside.
    pub fn hand_over(&mut self, to_outside: bool, now: Tai) {
        if self.is_driven_outside == to_outside {
            return;
        }
        self.is_driven_outside = to_outside;
        self.plant.torques.clear();
        self.plant.torques.push_back((now, Drive::Body(DVec3::ZERO)));
    }

    /// Switches the trackers inside off, because an external one gives the attitudes, or on again.
    pub fn hand_over_trackers(&mut self, to_outside: bool) {
        if self.is_sighted_outside != to_outside {
            self.is_sighted_outside = to_outside;
            self.heads.switch(None, to_outside);
        }
    }

    /// Drives each wheel's motor with a torque on its rotor, N m, from `at` until the next such command. The body feels
    /// the opposite; limits of motors and speeds hold as they do for the control inside.
    ///
    /// # Errors
    /// When the wheels are driven inside, a number is bad, or `at` has passed.
    pub fn drive_wheels(&mut self, torques_n_m: &[f64], at: Tai, now: Tai) -> Result<(), Refused> {
        let count = self.plant.wheel_speeds_rad_s().len();
        if !self.is_driven_outside {
            let wanted = "a hand-over to the control outside first";
            return Err(Refused(format!("the control inside drives the wheels; wanted {wanted}")));
        }
        if torques_n_m.len() != count {
            return Err(Refused(format!("got torques of {} wheels; wanted those of {count}", torques_n_m.len())));
        }
        torques_n_m.iter().try_for_each(|torque| check_torque(*torque))?;
        check_time(at, now)?;
        if self.plant.torques.len() >= WAITING_MAX {
            return Err(full());
        }
        let mut drive = [0.0; WHEELS_MAX];
        drive.iter_mut().zip(torques_n_m).for_each(|(place, torque)| *place = *torque);
        let place = self.plant.torques.partition_point(|(other, _)| *other <= at);
        self.plant.torques.insert(place, (at, Drive::Wheels(drive)));
        Ok(())
    }

    /// Turns the body by a torque from outside, body axes, N m, from `from` on for so long, on top of all others:
    /// thrusters, magnetic rods, a tug.
    ///
    /// # Errors
    /// When a number is bad or `from` has passed.
    pub fn push(&mut self, torque_n_m: DVec3, from: Tai, lasts: Span, now: Tai) -> Result<(), Refused> {
        check_torque(torque_n_m.length())?;
        check_time(from, now)?;
        if lasts.ns() <= 0 {
            return Err(Refused(format!("it lasts for {} s; wanted a time above 0", lasts.s())));
        }
        let is_taken = self.plant.spacecraft.push(torque_n_m, from, from + lasts, WAITING_MAX);
        if is_taken { Ok(()) } else { Err(full()) }
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
    ) -> Result<(), Refused> {
        let age = now - at;
        if age.ns() < 0 || age > OLDEST_FIX {
            return Err(Refused(format!("its time tag is {} s ago; wanted 0 to {} s", age.s(), OLDEST_FIX.s())));
        }
        if let Some(got) = sigma_rad.to_array().into_iter().find(|sigma| !(*sigma > 0.0 && *sigma < 1.0)) {
            return Err(Refused(format!("got a sigma of {got} rad; wanted one above 0 and below 1")));
        }
        if self.fixes.len() >= WAITING_MAX {
            return Err(full());
        }
        let covariance_rad2 = DMat3::from_diagonal(sigma_rad * sigma_rad);
        self.fixes.push(BodyAttitude { at, body_from_icrf, covariance_rad2 });
        Ok(())
    }
}

fn full() -> Refused {
    Refused(format!("{WAITING_MAX} commands wait already; wanted fewer at a time"))
}

fn check_torque(got: f64) -> Result<(), Refused> {
    if got.abs() <= MOST_N_M {
        return Ok(());
    }
    Err(Refused(format!("got a torque of {got} N m; wanted a finite one, at most {MOST_N_M} N m")))
}

fn check_time(at: Tai, now: Tai) -> Result<(), Refused> {
    if at >= now {
        return Ok(());
    }
    Err(Refused(format!("its time has passed {} s ago; wanted one not before the run's", (now - at).s())))
}
