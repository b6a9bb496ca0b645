//! The motion of a bench's script or file, as a scale for bounds of prediction.

use base::units::DEG;
use config::{Bench, Plant};
use core::f64::consts::PI;
use plan::attitude::MotionScale;

/// Returns the motion in the attitude records of a plant, as far as it is known before a run; for a file, from the
/// differences of its rows.
pub fn motion_scale(plant: &Plant, bench: &Bench) -> MotionScale {
    match plant {
        Plant::File(file) => {
            let [rate_rad_s, acceleration_rad_s2, jerk_rad_s3] = file.history.motion_limits();
            MotionScale { rate_rad_s, acceleration_rad_s2, jerk_rad_s3, sinusoids: Vec::new() }
        }
        Plant::Outside | Plant::FlightComputer | Plant::Vehicle(_) => script_scale(bench),
    }
}

/// Returns the peak of the scripted motion; a slew has ramps of half its length, `rate = peak (1 - cos(pi t / ramp)) /
/// 2`.
pub fn script_scale(bench: &Bench) -> MotionScale {
    if let Some(motion) = &bench.flight_computer.motion {
        return motion.scale();
    }
    let Some(slew) = &bench.flight_computer.slew else { return MotionScale::default() };
    let (peak_rad_s, ramp_s) = (2.0 * slew.angle_deg.abs() * DEG / slew.duration_s, 0.5 * slew.duration_s);
    MotionScale {
        rate_rad_s: peak_rad_s,
        acceleration_rad_s2: 0.5 * peak_rad_s * PI / ramp_s,
        jerk_rad_s3: 0.5 * peak_rad_s * (PI / ramp_s).powi(2),
        sinusoids: Vec::new(),
    }
}
