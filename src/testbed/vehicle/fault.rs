//! What can go wrong aboard.

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
