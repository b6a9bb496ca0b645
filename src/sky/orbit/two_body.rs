//! Time -> position and velocity on a conic about one body: ellipse, parabola or hyperbola.
//!
//! Input: a state or Kepler's elements at an epoch, about a centre of gravitational parameter `gm_km3_s2`. Output: km
//! and km/s from that centre, in the axes of the input (ICRF for an observer).
//!
//! Equation: Kepler's in the universal variable x, dx/dt = sqrt(gm) / r, with Stumpff's functions (Battin, An
//! Introduction to the Mathematics and Methods of Astrodynamics, rev. ed., sec. 4.5; Vallado, Fundamentals of
//! Astrodynamics and Applications, 4th ed., sec. 2.3). One form serves all conics, the parabola included. Time is
//! strictly increasing in x, so Newton's steps are kept in a bracket and always arrive.
//!
//! Error of the arithmetic: below 1e-11 of the largest distance on the way, and of the fastest speed times the phase
//! reached (rounding of time x mean motion): below 1 mm after 10 revolutions of a low orbit, 1 m after 15,000.
//!
//! Left out, and what it does to the velocity (1 m/s is 0.7 mas of aberration):
//!
//! | | acceleration, m/s^2 | after an hour, m/s |
//! |---|---|---|
//! | the Earth's oblateness, 500 km high | 1.2e-2 | up to 42; the node moves by up to 8 deg a day |
//! | the same, geostationary | 8e-6 | 0.03 |
//! | the Sun's tide, 400,000 km from the Earth | 3e-5 | 0.1 |
//! | the Moon's oblateness, 100 km high | 4e-4 | 1.6 |
//! | the Earth's tide, 70,000 km from the Moon | 1e-3 | 3.5 |
//!
//! So give a state near the time it is used at. Tests: below, against 40-digit arithmetic and a published case.

use crate::state::BarycentricState;
use base::{refused::Refused, time::Tai};
use core::f64::consts::TAU;
use glam::DVec3;

/// Distances accepted, km: from ten metres to 670 au.
const DISTANCE_KM: [f64; 2] = [0.01, 1e11];
/// Speeds accepted, km/s: below a hundredth of the speed of light.
const FASTEST_KM_S: f64 = 2_998.0;
/// Nearest approach accepted, km: a fall straight at a point mass has no end.
const NEAREST_KM: f64 = 1e-3;
/// Newton's steps at most: a bracket halves each time a step would leave it.
const STEPS_MAX: usize = 200;
/// Below this argument Stumpff's functions are summed as series, above by sines: no cancellation in either.
const SERIES_BELOW: f64 = 1.0;

/// Kepler's elements. A hyperbola has a negative semi-major axis and an eccentricity above 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeplerElements {
    /// Half of the longest axis, km.
    pub semi_major_axis_km: f64,
    /// 0 for a circle, below 1 for an ellipse, above 1 for a hyperbola.
    pub eccentricity: f64,
    /// Angle between the orbit's plane and that of x and y, rad.
    pub inclination_rad: f64,
    /// Right ascension of the ascending node, rad.
    pub raan_rad: f64,
    /// From the node to the nearest point, along the orbit, rad.
    pub argument_of_periapsis_rad: f64,
    /// Mean motion times the time since the nearest point, rad.
    pub mean_anomaly_rad: f64,
}

/// An orbit about one point mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoBodyOrbit {
    epoch: Tai,
    /// Time at the epoch since the orbit was in the state below, s.
    since_s: f64,
    position_km: DVec3,
    velocity_km_s: DVec3,
    gm_km3_s2: f64,
    /// 1 / semi-major axis: positive for an ellipse.
    alpha_per_km: f64,
}

impl TwoBodyOrbit {
    /// Returns the orbit through this state at `epoch`.
    ///
    /// # Errors
    /// When a number is not finite or out of range, or the orbit falls straight at the centre.
    pub fn from_state(epoch: Tai, position_km: DVec3, velocity_km_s: DVec3, gm_km3_s2: f64) -> Result<Self, Refused> {
        check("gm_km3_s2", "1e-9..1e15", gm_km3_s2, 1e-9, 1e15)?;
        let (r, v) = (position_km.length(), velocity_km_s.length());
        check("distance of position_km", "0.01..1e11", r, DISTANCE_KM[0], DISTANCE_KM[1])?;
        check("length of velocity_km_s", "0..2998", v, 0.0, FASTEST_KM_S)?;
        let alpha_per_km = 2.0 / r - v * v / gm_km3_s2;
        let orbit = Self { epoch, since_s: 0.0, position_km, velocity_km_s, gm_km3_s2, alpha_per_km };
        let wanted = "0.001 or more: position and velocity must not be in one line";
        check("nearest distance, km,", wanted, orbit.periapsis_km(), NEAREST_KM, f64::MAX)?;
        Ok(orbit)
    }

    /// Returns the orbit with these elements at `epoch`.
    ///
    /// # Errors
    /// When a number is not finite or out of range, or axis and eccentricity do not go together (a parabola has no
    /// axis: give a state).
    pub fn from_elements(epoch: Tai, elements: &KeplerElements, gm_km3_s2: f64) -> Result<Self, Refused> {
        let (a, e) = (elements.semi_major_axis_km, elements.eccentricity);
        check("gm_km3_s2", "1e-9..1e15", gm_km3_s2, 1e-9, 1e15)?;
        check("eccentricity", "0 or more", e, 0.0, 1e6)?;
        let periapsis_km = a * (1.0 - e);
        let wanted =
            "above 0: a positive semi-major axis with an eccentricity below 1, a negative one with more than 1";
        check("semi_major_axis_km x (1 - eccentricity)", wanted, periapsis_km, NEAREST_KM, DISTANCE_KM[1])?;
        let angles = [
            ("inclination_rad", elements.inclination_rad),
            ("raan_rad", elements.raan_rad),
            ("argument_of_periapsis_rad", elements.argument_of_periapsis_rad),
            ("mean_anomaly_rad", elements.mean_anomaly_rad),
        ];
        for (parameter, angle_rad) in angles {
            check(parameter, "a finite number", angle_rad, f64::MIN, f64::MAX)?;
        }
        let [towards_periapsis, a_quarter_later] = axes(elements);
        let fastest_km_s = (gm_km3_s2 * (1.0 + e) / periapsis_km).sqrt();
        let [position_km, velocity_km_s] = [towards_periapsis * periapsis_km, a_quarter_later * fastest_km_s];
        let through = Self::from_state(epoch, position_km, velocity_km_s, gm_km3_s2)?;
        let since_s = elements.mean_anomaly_rad * (a.abs().powi(3) / gm_km3_s2).sqrt();
        // The axis as given: from the state, 1 - e of a near-parabola would have lost its last digits.
        Ok(Self { since_s, alpha_per_km: 1.0 / a, ..through })
    }

    /// Returns the state from the central body at `at`. Does not allocate; about a microsecond.
    pub fn state(&self, at: Tai) -> BarycentricState {
        let mut after_s = (at - self.epoch).s() + self.since_s;
        if let Some(period_s) = self.period_s() {
            after_s -= period_s * (after_s / period_s).round();
        }
        let (r0, root_gm) = (self.position_km.length(), self.gm_km3_s2.sqrt());
        let x = self.universal_anomaly(after_s);
        let [c1, c2, c3] = stumpff(self.alpha_per_km * x * x);
        let f = 1.0 - x * x * c2 / r0;
        let g = after_s - x * x * x * c3 / root_gm;
        let position_km = f * self.position_km + g * self.velocity_km_s;
        let r = position_km.length();
        let f_rate = -root_gm * x * c1 / (r * r0);
        let g_rate = 1.0 - x * x * c2 / r;
        BarycentricState { position_km, velocity_km_s: f_rate * self.position_km + g_rate * self.velocity_km_s }
    }

    /// Returns the instant of the state or elements it was made of.
    pub fn epoch(&self) -> Tai {
        self.epoch
    }

    /// Returns the time for one revolution, s; `None` on an open orbit.
    pub fn period_s(&self) -> Option<f64> {
        let period_s = TAU / (self.gm_km3_s2 * self.alpha_per_km.powi(3)).sqrt();
        period_s.is_finite().then_some(period_s)
    }

    /// Returns the nearest distance from the centre on the whole orbit, km.
    pub fn periapsis_km(&self) -> f64 {
        let parameter_km = self.position_km.cross(self.velocity_km_s).length_squared() / self.gm_km3_s2;
        let eccentricity = (1.0 - parameter_km * self.alpha_per_km).max(0.0).sqrt();
        parameter_km / (1.0 + eccentricity)
    }

    /// Returns the greatest speed on the whole orbit, km/s.
    pub fn fastest_km_s(&self) -> f64 {
        (self.gm_km3_s2 * (2.0 / self.periapsis_km() - self.alpha_per_km).max(0.0)).sqrt()
    }

    /// Returns the root of `time_s(x) = after_s`.
    fn universal_anomaly(&self, after_s: f64) -> f64 {
        let [mut low, mut high] = self.bracket(after_s);
        let mut x = (after_s * self.gm_km3_s2.sqrt() / self.position_km.length()).clamp(low, high);
        for _ in 0..STEPS_MAX {
            let (time_s, rate_s) = self.time_s(x);
            let late_s = time_s - after_s;
            if late_s > 0.0 {
                high = x
            } else {
                low = x
            }
            let newton = x - late_s / rate_s;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            let step = (next - x).abs();
            x = next;
            if step <= f64::EPSILON * x.abs() {
                break;
            }
        }
        x
    }

    /// Returns two values with the root between them, by doubling from where every conic is still well behaved.
    fn bracket(&self, after_s: f64) -> [f64; 2] {
        let first = self.position_km.length().sqrt().min(self.alpha_per_km.abs().sqrt().recip());
        let mut far = first;
        while self.time_s(far.copysign(after_s)).0.abs() < after_s.abs() {
            far *= 2.0;
        }
        if after_s < 0.0 { [-far, 0.0] } else { [0.0, far] }
    }

    /// Returns the time from the reference state, s, and its derivative, at the universal anomaly `x`, sqrt(km).
    fn time_s(&self, x: f64) -> (f64, f64) {
        let root_gm = self.gm_km3_s2.sqrt();
        let r0 = self.position_km.length();
        let outward = self.position_km.dot(self.velocity_km_s) / root_gm;
        let [c1, c2, c3] = stumpff(self.alpha_per_km * x * x);
        let c0 = 1.0 - self.alpha_per_km * x * x * c2;
        let time_s = (r0 * x * c1 + outward * x * x * c2 + x * x * x * c3) / root_gm;
        let radius_km = r0 * c0 + outward * x * c1 + x * x * c2;
        (time_s, radius_km / root_gm)
    }
}

/// Returns the unit vectors towards the nearest point and a quarter of a turn after it.
fn axes(elements: &KeplerElements) -> [DVec3; 2] {
    let (sin_node, cos_node) = elements.raan_rad.sin_cos();
    let (sin_i, cos_i) = elements.inclination_rad.sin_cos();
    let (sin_w, cos_w) = elements.argument_of_periapsis_rad.sin_cos();
    let node = DVec3::new(cos_node, sin_node, 0.0);
    let a_quarter_later = DVec3::new(-sin_node * cos_i, cos_node * cos_i, sin_i);
    [node * cos_w + a_quarter_later * sin_w, a_quarter_later * cos_w - node * sin_w]
}

/// Returns Stumpff's c1, c2, c3 of `z`: sin s / s, (1 - cos s) / s^2, (s - sin s) / s^3 with s = sqrt(z), and their
/// hyperbolic kin for negative `z`.
fn stumpff(z: f64) -> [f64; 3] {
    if z.abs() < SERIES_BELOW {
        return [series(z, 1.0), series(z, 2.0) / 2.0, series(z, 3.0) / 6.0];
    }
    let s = z.abs().sqrt();
    if z > 0.0 {
        let (sin, cos) = s.sin_cos();
        [sin / s, (1.0 - cos) / z, (s - sin) / (s * z)]
    } else {
        let (sinh, cosh) = (s.sinh(), s.cosh());
        [sinh / s, (1.0 - cosh) / z, (s - sinh) / (s * z)]
    }
}

/// Returns n! times the sum of (-z)^k / (n + 2k)!: below 1 its tenth term is 1e-18.
fn series(z: f64, n: f64) -> f64 {
    let term = |sum: f64, k: i32| {
        let first = n + 2.0 * f64::from(k);
        1.0 - z / ((first - 1.0) * first) * sum
    };
    (1..=10).rev().fold(1.0, term)
}

fn check(parameter: &'static str, wanted: &'static str, got: f64, low: f64, high: f64) -> Result<(), Refused> {
    if (low..=high).contains(&got) {
        Ok(())
    } else {
        Err(Refused(format!("two-body orbit: {parameter} wanted {wanted}, got {got}")))
    }
}

#[cfg(test)]
#[path = "two_body_tests.rs"]
mod tests;
