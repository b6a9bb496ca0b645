//! The spacecraft in flight: its smooth motion under the torques of a control, each from its time on, and the
//! micro-vibration on top of it.

use super::{VehicleParams, of_spacecraft};
use crate::spacecraft::{MicroVibration, Spacecraft, WHEELS_MAX};
use base::refused::Refused;
use base::time::{Span, Tai};
use glam::DVec3;
use histories::AttitudeMotion;
use std::collections::VecDeque;

/// Request to the wheels' motors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Drive {
    /// A torque on the body, to be shared out.
    Body(DVec3),
    /// A torque on each rotor about its axis.
    Wheels([f64; WHEELS_MAX]),
}

/// A spacecraft, its micro-vibration, and the torques on their way to its wheels.
#[derive(Debug)]
pub struct Plant {
    pub(super) spacecraft: Spacecraft,
    step: Span,
    /// With the time between its samples.
    vibration: Option<(MicroVibration, Span)>,
    pub(super) largest_vibration_rad: f64,
    pub(super) torques: VecDeque<(Tai, Drive)>,
}

impl Plant {
    pub(super) fn new(params: &VehicleParams, start: Tai, [own, vibration]: [u64; 2]) -> Result<Self, Refused> {
        let rate = params.initial_rate_rad_s;
        let mut spacecraft =
            Spacecraft::new(&params.spacecraft, start, params.initial, rate, own).map_err(of_spacecraft)?;
        spacecraft.add_test_torques(&params.test_torques).map_err(of_spacecraft)?;
        let vibration = params
            .vibration_period
            .map(|period| Ok((MicroVibration::new(&params.spacecraft, start, period, vibration)?, period)))
            .transpose()
            .map_err(of_spacecraft)?;
        let torques = VecDeque::with_capacity(64);
        Ok(Self { spacecraft, step: params.spacecraft.step, vibration, largest_vibration_rad: 0.0, torques })
    }

    /// Returns the smooth attitude at `at`: at most two seconds ago, at most the next control step.
    ///
    /// # Errors
    /// When `at` is outside.
    pub fn truth(&mut self, at: Tai) -> Result<AttitudeMotion, Refused> {
        self.fly_to(at);
        self.flown_truth(at)
    }

    /// Returns the same of what has been flown already: looking changes nothing. At most a bus record's time behind.
    ///
    /// # Errors
    /// When `at` is outside.
    pub fn flown_truth(&self, at: Tai) -> Result<AttitudeMotion, Refused> {
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
        let Some((vibration, period)) = self.vibration.as_mut() else { return Ok(DVec3::ZERO) };
        // A sample further, so that any instant lies between two.
        vibration.advance_to(at + *period, speeds);
        let sample = vibration.sample(at).map_err(of_spacecraft)?;
        self.largest_vibration_rad = self.largest_vibration_rad.max(sample.length());
        Ok(sample)
    }

    /// Returns the speeds of the wheels, rad/s.
    pub fn wheel_speeds_rad_s(&self) -> &[f64] {
        self.spacecraft.wheel_speeds_rad_s()
    }

    /// Moves the smooth motion to the first step boundary not before `at`, with each torque from its time on.
    pub(super) fn fly_to(&mut self, at: Tai) {
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
            self.spacecraft.advance_to(at + self.step);
        }
    }
}
