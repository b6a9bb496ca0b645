//! The error of one attitude: a small turn of the measured frame from the true one, in sensor axes.
//!
//! Quaternions are this program's: `v_sensor = q v_icrf q*`, so a frame that turned by +a about its x axis has x = -sin(a/2).

use glam::{DQuat, DVec3};

/// Returns the turn from the true frame to the measured one, rad, sensor axes: -2 times the vector part of `q_meas
/// q_true*` where it is small, and the whole rotation vector where it is not.
pub fn attitude_error(measured: DQuat, truth: DQuat) -> DVec3 {
    let difference = measured * truth.conjugate();
    let difference = if difference.w < 0.0 { -difference } else { difference };
    let vector = difference.xyz();
    let sine = vector.length();
    if sine < 1e-9 {
        return -2.0 * vector;
    }
    vector * (-2.0 * sine.atan2(difference.w) / sine)
}

/// Returns the attitude of a frame that has turned by `turn_rad`, a rotation vector in its own axes.
pub fn turned(attitude: DQuat, turn_rad: DVec3) -> DQuat {
    (DQuat::from_scaled_axis(-turn_rad) * attitude).normalize()
}

/// Returns the error of directions, across the boresight.
pub fn directional(error_rad: DVec3) -> f64 {
    error_rad.x.hypot(error_rad.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_turned_by_a_has_the_error_a() {
        let truth = DQuat::from_xyzw(0.1, -0.4, 0.3, 0.86).normalize();
        for turn in [DVec3::X * 1e-4, DVec3::new(-2e-5, 3e-6, 1e-3), DVec3::Z * 2.5, DVec3::Y * 1e-12] {
            let error = attitude_error(turned(truth, turn), truth);
            assert!((error - turn).length() < 1e-15 + 1e-14 * turn.length(), "{error} {turn}");
            assert_eq!(attitude_error(-turned(truth, turn), truth), error, "q and -q are one attitude");
        }
    }

    #[test]
    fn it_is_the_sense_of_the_programs_quaternion() {
        // Written from the convention: a frame turned by +a about x sees the fixed direction y at cos a in y and -sin a
        // in z.
        let a = 0.02_f64;
        let measured = turned(DQuat::IDENTITY, DVec3::X * a);
        let seen = measured * DVec3::Y;
        assert!((seen - DVec3::new(0.0, a.cos(), -a.sin())).length() < 1e-15, "{seen}");
        assert!((measured.x + (0.5 * a).sin()).abs() < 1e-16, "x is -sin(a/2)");
    }
}
