//! Faults of the parts aboard.

use crate::spacecraft::{Gyro, GyroFault};
use base::units::DEG;
use core::fmt;
use glam::DVec3;

/// A fault of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VehicleFault {
    /// The gyro gives nothing.
    GyroDropout,
    /// The gyro repeats its last reading.
    GyroStuck,
    /// The gyro's bias jumps for good, rad/s.
    GyroBiasJump(DVec3),
    /// The gyro reads this much too much while it lasts, rad/s.
    GyroSpike(DVec3),
    /// A wheel's motor dies for good.
    WheelFailure(usize),
    /// One head gives nothing, or all of them.
    TrackerOff(Option<usize>),
}

impl fmt::Display for VehicleFault {
    /// Returns how much of it there is, or what it hits.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::GyroDropout | Self::GyroStuck => Ok(()),
            Self::GyroBiasJump(by) | Self::GyroSpike(by) => {
                write!(f, "{:.3?} deg/h", (*by * (3600.0 / DEG)).to_array())
            }
            Self::WheelFailure(wheel) => write!(f, "wheel {wheel}"),
            Self::TrackerOff(Some(head)) => write!(f, "head {head}"),
            Self::TrackerOff(None) => f.write_str("all heads"),
        }
    }
}

/// Faults of the gyro under way, each kind as often as it was begun and not ended, and what they hit so far.
#[derive(Debug, Default)]
pub(super) struct ActiveFaults {
    dropouts: u32,
    stuck: u32,
    spikes_rad_s: Vec<DVec3>,
    dropout_hits: u64,
    stuck_hits: u64,
    spike_hits: u64,
    lasting_hits: u64,
}

impl ActiveFaults {
    pub(super) fn begin(&mut self, fault: &VehicleFault) {
        match *fault {
            VehicleFault::GyroDropout => self.dropouts += 1,
            VehicleFault::GyroStuck => self.stuck += 1,
            VehicleFault::GyroSpike(spike) => self.spikes_rad_s.push(spike),
            VehicleFault::GyroBiasJump(_) | VehicleFault::WheelFailure(_) => self.lasting_hits += 1,
            VehicleFault::TrackerOff(_) => {}
        }
    }

    pub(super) fn end(&mut self, fault: &VehicleFault) {
        match *fault {
            VehicleFault::GyroDropout => self.dropouts = self.dropouts.saturating_sub(1),
            VehicleFault::GyroStuck => self.stuck = self.stuck.saturating_sub(1),
            VehicleFault::GyroSpike(spike) => {
                if let Some(place) = self.spikes_rad_s.iter().position(|active| *active == spike) {
                    self.spikes_rad_s.remove(place);
                }
            }
            VehicleFault::GyroBiasJump(_) | VehicleFault::WheelFailure(_) | VehicleFault::TrackerOff(_) => {}
        }
    }

    /// Makes the gyro's next sample as wrong as it has to be.
    pub(super) fn spoil(&mut self, gyro: &mut Gyro) {
        gyro.clear_faults();
        if self.dropouts > 0 {
            gyro.inject(GyroFault::Dropout);
            self.dropout_hits += 1;
        }
        if self.stuck > 0 {
            gyro.inject(GyroFault::Stuck);
            self.stuck_hits += 1;
        }
        if !self.spikes_rad_s.is_empty() {
            gyro.inject(GyroFault::Spike(self.spikes_rad_s.iter().sum()));
            self.spike_hits += 1;
        }
    }

    /// Returns samples hit so far, or things broken for good.
    pub(super) fn hits(&self, fault: &VehicleFault) -> u64 {
        match fault {
            VehicleFault::GyroDropout => self.dropout_hits,
            VehicleFault::GyroStuck => self.stuck_hits,
            VehicleFault::GyroSpike(_) => self.spike_hits,
            VehicleFault::GyroBiasJump(_) | VehicleFault::WheelFailure(_) => self.lasting_hits,
            VehicleFault::TrackerOff(_) => 0,
        }
    }
}
