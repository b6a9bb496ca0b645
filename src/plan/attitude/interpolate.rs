//! Attitude between two samples: a cubic Hermite curve on the rotation vector, through both attitudes and rates.
//!
//! *Algorithm.* Let `phi(t)` be the rotation vector from the earlier attitude, so `q(t) = q0.rotated_by(phi(t))`.
//! `phi` is the cubic with `phi(0) = 0`, `phi(H) = Phi` and the end slopes that the two rates give through the
//! kinematics of the rotation vector (Bortz 1971): `phi' = w + phi x w / 2 + k(|phi|) phi x (phi x w)`, `w` in body
//! axes; the rate of the curve comes back by the inverse relation. Near 180 degrees the rates decide between the two
//! directions of rotation.
//!
//! *Error.* [`hermite_error_bound_rad`]: `H^4 / 384` times the largest fourth derivative of `phi`.
//! *Limits.* Less than 270 degrees between samples; the acceleration neglects terms of relative size `|phi|^2 / 12`.
//! *Validation.* `wobble_error_meets_its_bound`.

use crate::attitude::{history::AttitudeSample, predict::AttitudeState};
use base::time::Tai;
use core::f64::consts::{FRAC_PI_2, TAU};
use glam::DVec3;

/// Angle below which the closed forms lose digits (`1 - cos x` keeps `eps / x^2`), and three terms of their series are
/// exact to `x^6 / 10^6`.
const SERIES_BELOW_RAD: f64 = 1e-2;

/// Returns the state at `at` on the curve between `earlier` and `later`.
///
/// `at` should lie between the two epochs; outside them the cubic is continued. For samples of the same epoch the
/// earlier one is returned.
pub fn interpolate(earlier: &AttitudeSample, later: &AttitudeSample, at: Tai) -> AttitudeState {
    let h_s = (later.at - earlier.at).s();
    if h_s <= 0.0 {
        return AttitudeState { at, ..AttitudeState::from(earlier) };
    }
    let mean_turn_rad = (earlier.rate_rad_s + later.rate_rad_s) * (0.5 * h_s);
    let end_rad = way_round_nearest(earlier.body_from_icrf.rotation_vector_to(&later.body_from_icrf), mean_turn_rad);
    let start_slope = earlier.rate_rad_s;
    let end_slope = slope_of_rate(end_rad, later.rate_rad_s);
    let [phi, slope, curvature] = hermite(end_rad, start_slope, end_slope, h_s, (at - earlier.at).s());
    AttitudeState {
        at,
        body_from_icrf: earlier.body_from_icrf.rotated_by(phi),
        rate_rad_s: rate_of_slope(phi, slope),
        acceleration_rad_s2: acceleration_of_curvature(phi, slope, curvature),
    }
}

/// Returns the largest error, rad, of the curve between samples `interval_s` apart when the fourth derivative of the
/// rotation angle is at most `snap_rad_s4` (for `A sin(2 pi f t)`: `A (2 pi f)^4`).
pub fn hermite_error_bound_rad(interval_s: f64, snap_rad_s4: f64) -> f64 {
    interval_s.powi(4) * snap_rad_s4 / 384.0
}

/// Returns the rotation vector nearer to the one expected from the rates: two vectors, `2 pi` apart, lead to one
/// attitude. The choice is made from 90 degrees on only, so that the longer one stays below 270.
fn way_round_nearest(short_way_rad: DVec3, expected_rad: DVec3) -> DVec3 {
    let angle = short_way_rad.length();
    if angle < FRAC_PI_2 {
        return short_way_rad;
    }
    let long_way_rad = short_way_rad * (1.0 - TAU / angle);
    if (long_way_rad - expected_rad).length() < (short_way_rad - expected_rad).length() {
        long_way_rad
    } else {
        short_way_rad
    }
}

/// Returns value, slope and curvature at `t_s` of the cubic from 0 to `end` in `h_s`.
fn hermite(end: DVec3, start_slope: DVec3, end_slope: DVec3, h_s: f64, t_s: f64) -> [DVec3; 3] {
    let chord = end / h_s;
    let c2 = (chord * 3.0 - start_slope * 2.0 - end_slope) / h_s;
    let c3 = (start_slope + end_slope - chord * 2.0) / (h_s * h_s);
    let value = ((c3 * t_s + c2) * t_s + start_slope) * t_s;
    let slope = (c3 * (3.0 * t_s) + c2 * 2.0) * t_s + start_slope;
    [value, slope, c3 * (6.0 * t_s) + c2 * 2.0]
}

/// Returns the slope of the rotation vector at `phi` when the body turns at `rate` (body axes): Bortz's equation.
fn slope_of_rate(phi: DVec3, rate: DVec3) -> DVec3 {
    let x = phi.length();
    let k = if x < SERIES_BELOW_RAD {
        1.0 / 12.0 + x * x / 720.0
    } else {
        (1.0 - 0.5 * x * x.sin() / (1.0 - x.cos())) / (x * x)
    };
    rate + phi.cross(rate) * 0.5 + phi.cross(phi.cross(rate)) * k
}

/// Returns `(1 - cos x) / x^2` and `(x - sin x) / x^3`.
fn kinematic_coefficients(x: f64) -> (f64, f64) {
    let xx = x * x;
    if x < SERIES_BELOW_RAD {
        (0.5 - xx / 24.0 + xx * xx / 720.0, 1.0 / 6.0 - xx / 120.0 + xx * xx / 5040.0)
    } else {
        ((1.0 - x.cos()) / xx, (x - x.sin()) / (xx * x))
    }
}

/// Returns the rate of the body (body axes) whose rotation vector `phi` has this slope.
fn rate_of_slope(phi: DVec3, slope: DVec3) -> DVec3 {
    let (b, c) = kinematic_coefficients(phi.length());
    slope - phi.cross(slope) * b + phi.cross(phi.cross(slope)) * c
}

/// Returns the derivative of [`rate_of_slope`] with its two coefficients kept constant.
fn acceleration_of_curvature(phi: DVec3, slope: DVec3, curvature: DVec3) -> DVec3 {
    let (b, c) = kinematic_coefficients(phi.length());
    let double_cross = slope.cross(phi.cross(slope)) + phi.cross(phi.cross(curvature));
    curvature - phi.cross(curvature) * b + double_cross * c
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::axes::{Body, Icrf, Rotation};
    use base::time::Span;
    use base::units::{ARCSEC, DEG};
    use core::f64::consts::PI;

    /// Rounding of f64 quaternions and of the Hermite sums, as an angle.
    const ROUNDING_RAD: f64 = 1e-14;
    /// Rounding of rates, which come from differences over one interval of 10 ms.
    const ROUNDING_RAD_S: f64 = 1e-11;

    fn epoch(t_s: f64) -> Tai {
        Tai::from_ns(5_000_000_000) + Span::from_s(t_s)
    }

    fn sample(t_s: f64, body_from_icrf: Rotation<Body, Icrf>, rate_rad_s: DVec3) -> AttitudeSample {
        AttitudeSample { at: epoch(t_s), seq: 0, body_from_icrf, rate_rad_s, acceleration_rad_s2: DVec3::ZERO }
    }

    /// Returns the attitude after a constant rate.
    fn spun(rate_rad_s: DVec3, t_s: f64) -> Rotation<Body, Icrf> {
        Rotation::from_rotation_vector(DVec3::new(0.2, 0.4, -0.7)).rotated_by(rate_rad_s * t_s)
    }

    fn spin_error_rad(rate_rad_s: DVec3, h_s: f64, t_s: f64) -> f64 {
        let ends = [0.0, h_s].map(|t| sample(t, spun(rate_rad_s, t), rate_rad_s));
        interpolate(&ends[0], &ends[1], epoch(t_s)).body_from_icrf.rotation_vector_to(&spun(rate_rad_s, t_s)).length()
    }

    #[test]
    fn constant_rate_is_exact_up_to_and_beyond_half_a_turn() {
        let axis = DVec3::new(1.0, -2.0, 0.5).normalize();
        for turn_deg in [0.001, 1.0, 90.0, 179.9, 180.0, 180.1, 250.0] {
            let error = spin_error_rad(axis * turn_deg * DEG / 0.1, 0.1, 0.037);
            assert!(error < 10.0 * ROUNDING_RAD, "{turn_deg} deg: {error} rad");
        }
    }

    #[test]
    fn q_and_minus_q_give_the_same_curve() {
        let rate = DVec3::new(0.01, 0.03, -0.02);
        let (a, b) = (sample(0.0, spun(rate, 0.0), rate), sample(0.01, spun(rate, 0.01), rate));
        let flipped = AttitudeSample { body_from_icrf: Rotation::from_quat(-b.body_from_icrf.quat()), ..b };
        let (plain, other) = (interpolate(&a, &b, epoch(0.004)), interpolate(&a, &flipped, epoch(0.004)));
        assert_eq!(plain, other);
        assert!((plain.rate_rad_s - rate).length() < ROUNDING_RAD_S, "{}", plain.rate_rad_s);
    }

    /// Returns attitude and rate of a wobble about a fixed axis in closed form.
    fn wobble(t_s: f64, amplitude_rad: f64, hz: f64) -> AttitudeSample {
        let (sin, cos) = (TAU * hz * t_s).sin_cos();
        let axis = DVec3::new(0.6, 0.0, 0.8);
        let q = Rotation::from_rotation_vector(DVec3::X).rotated_by(axis * amplitude_rad * sin);
        sample(t_s, q, axis * amplitude_rad * TAU * hz * cos)
    }

    /// Returns the largest error over one period with samples every `h_s`.
    fn wobble_error_rad(amplitude_rad: f64, hz: f64, h_s: f64) -> f64 {
        (0..2000).fold(0.0, |worst, i| {
            let t = f64::from(i) / 2000.0 / hz;
            let k = (t / h_s).floor();
            let ends = [k * h_s, (k + 1.0) * h_s].map(|t| wobble(t, amplitude_rad, hz));
            let got = interpolate(&ends[0], &ends[1], epoch(t)).body_from_icrf;
            got.rotation_vector_to(&wobble(t, amplitude_rad, hz).body_from_icrf).length().max(worst)
        })
    }

    #[test]
    fn wobble_error_meets_its_bound() {
        for (hz, h_s) in [(1.0, 0.1), (1.0, 0.01), (5.0, 0.01)] {
            let amplitude = 100.0 * ARCSEC;
            let error = wobble_error_rad(amplitude, hz, h_s);
            let bound = hermite_error_bound_rad(h_s, amplitude * (TAU * hz).powi(4));
            // Epochs are whole nanoseconds: at most 1 ns at the largest rate.
            let tag = amplitude * TAU * hz * 1e-9;
            assert!(error <= bound + tag, "{hz} Hz, {h_s} s: {} arcsec over {}", error / ARCSEC, bound / ARCSEC);
            assert!(error >= 0.8 * bound, "{hz} Hz, {h_s} s: {} arcsec idle under {}", error / ARCSEC, bound / ARCSEC);
        }
    }

    #[test]
    fn linear_interpolation_would_miss_the_bound() {
        let (amplitude, h_s) = (100.0 * ARCSEC, 0.1);
        let (a, b) = (wobble(0.2, amplitude, 1.0), wobble(0.3, amplitude, 1.0));
        let half_way = a.body_from_icrf.rotation_vector_to(&b.body_from_icrf) * 0.5;
        let linear = a.body_from_icrf.rotated_by(half_way);
        let error = linear.rotation_vector_to(&wobble(0.25, amplitude, 1.0).body_from_icrf).length();
        assert!(error > 20.0 * hermite_error_bound_rad(h_s, amplitude * TAU.powi(4)), "{} arcsec", error / ARCSEC);
    }

    /// Returns a sample of precession: a cone traced at one rate while spinning at another, so that the axis of
    /// rotation moves.
    fn coning(t_s: f64) -> AttitudeSample {
        let (slow, fast) = (DVec3::Z * 0.8, DVec3::new(0.5, 0.0, 0.3));
        let base = Rotation::<Body, Icrf>::from_rotation_vector(slow * t_s);
        let q = base.rotated_by(fast * t_s);
        // Body rate = fast rate + slow rate rotated into the axes that the fast rotation reaches.
        let rate = fast + Rotation::<Body, Body>::from_rotation_vector(fast * t_s).apply(slow);
        sample(t_s, q, rate)
    }

    #[test]
    fn a_moving_axis_keeps_attitude_rate_and_acceleration() {
        let (a, b) = (coning(2.0), coning(2.1));
        let got = interpolate(&a, &b, epoch(2.05));
        let truth = coning(2.05);
        // H^4 / 384 times a snap of |w|^4 ~ 1.5 rad/s^4; the rate loses one power of H, the acceleration two.
        let bound = hermite_error_bound_rad(0.1, 1.5);
        assert!(got.body_from_icrf.rotation_vector_to(&truth.body_from_icrf).length() < bound, "attitude");
        assert!((got.rate_rad_s - truth.rate_rad_s).length() < bound * 4.0 / 0.1, "rate {}", got.rate_rad_s);
        let around = [coning(2.0499), coning(2.0501)];
        let acceleration = (around[1].rate_rad_s - around[0].rate_rad_s) / 2e-4;
        let neglected = 0.1 * 0.1 / 12.0 + bound * 48.0 / 0.01;
        assert!((got.acceleration_rad_s2 - acceleration).length() < neglected, "{}", got.acceleration_rad_s2);
    }

    #[test]
    fn the_ends_are_the_samples() {
        let (a, b) = (coning(0.0), coning(0.1));
        for (end, at) in [(&a, 0.0), (&b, 0.1)] {
            let got = interpolate(&a, &b, epoch(at));
            assert!(got.body_from_icrf.rotation_vector_to(&end.body_from_icrf).length() < ROUNDING_RAD, "{at}");
            assert!((got.rate_rad_s - end.rate_rad_s).length() < ROUNDING_RAD_S, "{at}: {}", got.rate_rad_s);
        }
        let same = interpolate(&a, &a, epoch(0.0));
        assert_eq!(same.body_from_icrf, a.body_from_icrf, "no interval");
    }

    #[test]
    fn rate_and_slope_are_inverse_to_each_other() {
        for angle in [1e-6, 0.009, 0.011, 1.0, PI, 4.0] {
            let (phi, rate) = (DVec3::new(0.6, -0.64, 0.48) * angle, DVec3::new(0.1, 0.7, -0.3));
            let back = rate_of_slope(phi, slope_of_rate(phi, rate));
            assert!((back - rate).length() < 1e-12, "{angle} rad: {back}");
        }
    }
}
