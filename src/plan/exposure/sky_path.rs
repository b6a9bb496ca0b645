//! The trajectory of a target on the sky within one exposure -> its apparent direction at any instant of it.
//!
//! In: the target's place from the observer, km, at four instants evenly over the exposure, and the observer's
//! barycentric velocity. Out: the apparent direction, ICRF axes, at any instant. The place is the cubic through the
//! four, so that the geometry of a close pass, the cause of its speed, is exact; the direction is aberrated like those
//! of stars. Error of the cubic: h^4 / 24 times the fourth derivative, h being the step; for an orbit about a body at
//! distance r that derivative is at most `14 GM^2 / r^5` (two-body motion up to parabolic speed, differentiated twice
//! more): [`SkyPath::bound_km`]. 10 s of two low orbits: 0.1 mm or less; a minute: 0.2 m. Beyond the four instants the
//! error grows. Tests: below; against the orbits themselves `scene::sky_targets`.

use glam::DVec3;
use sky::astrometry::aberrated;

/// Number of instants from which a trajectory is made.
pub const PATH_INSTANTS: usize = 4;
/// Largest fourth derivative of an orbit at distance r, in units of GM^2 / r^5 (module doc).
const FOURTH_DERIVATIVE: f64 = 14.0;

/// Gravity that acts on one end of the line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fall {
    /// Gravitational parameter of the body, km^3/s^2.
    pub gm_km3_s2: f64,
    /// Smallest distance from its centre, km.
    pub radius_km: f64,
}

impl Fall {
    /// At rest, or nearly so.
    pub const NONE: Self = Self { gm_km3_s2: 0.0, radius_km: 1.0 };
}

/// The cubic through four places; times count from the middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cubic {
    /// Coefficients of the place by powers of `t / half_s`, km.
    powers_km: [DVec3; PATH_INSTANTS],
    /// Time from the middle to the first and the last instant, s.
    half_s: f64,
}

impl Cubic {
    /// Returns the cubic through the places at [`SkyPath::instants_s`].
    pub fn through(places_km: [DVec3; PATH_INSTANTS], half_s: f64) -> Self {
        let [a, b, c, d] = places_km;
        // Even and odd parts at 1 and 1/3.
        let [even, odd] = [0.5 * (d + a), 0.5 * (d - a)];
        let [even_third, odd_third] = [0.5 * (c + b), 0.5 * (c - b)];
        let square = (even - even_third) * (9.0 / 8.0);
        let cube = (odd - 3.0 * odd_third) * (9.0 / 8.0);
        Self { powers_km: [even - square, odd - cube, square, cube], half_s }
    }

    /// Returns the place `t_s` after the middle, km.
    pub fn at(&self, t_s: f64) -> DVec3 {
        let u = t_s / self.half_s;
        let [one, u1, u2, u3] = self.powers_km;
        one + u * (u1 + u * (u2 + u * u3))
    }
}

/// Place from the observer over one exposure; times count from mid-exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyPath {
    from_observer_km: Cubic,
    /// The observer's barycentric velocity in the middle, km/s.
    observer_km_s: DVec3,
    /// Its change, km/s^2.
    observer_km_s2: DVec3,
}

impl SkyPath {
    /// Returns the instants at which places are needed, s after mid-exposure, for a trajectory of `2 half_s`.
    pub fn instants_s(half_s: f64) -> [f64; PATH_INSTANTS] {
        [-half_s, -half_s / 3.0, half_s / 3.0, half_s]
    }

    /// Returns the trajectory through these places, for an observer with these barycentric velocities at the first and
    /// last instant.
    pub fn through(from_observer_km: [DVec3; PATH_INSTANTS], half_s: f64, [first, last]: [DVec3; 2]) -> Self {
        Self {
            from_observer_km: Cubic::through(from_observer_km, half_s),
            observer_km_s: 0.5 * (first + last),
            observer_km_s2: 0.5 * (last - first) / half_s,
        }
    }

    /// Returns the bound of the place's error, km; gravity acts on both ends of the line of sight.
    pub fn bound_km(half_s: f64, falls: [Fall; 2]) -> f64 {
        let step_s = 2.0 * half_s / (PATH_INSTANTS as f64 - 1.0);
        let fourth = |fall: Fall| FOURTH_DERIVATIVE * fall.gm_km3_s2.powi(2) / fall.radius_km.powi(5);
        falls.into_iter().map(fourth).sum::<f64>() * step_s.powi(4) / 24.0
    }

    /// Returns the place from the observer `t_s` after mid-exposure, km.
    pub fn from_observer_km(&self, t_s: f64) -> DVec3 {
        self.from_observer_km.at(t_s)
    }

    /// Returns the apparent direction `t_s` after mid-exposure, ICRF axes.
    pub fn apparent_icrf(&self, t_s: f64) -> DVec3 {
        aberrated(self.from_observer_km(t_s).normalize(), self.observer_km_s + self.observer_km_s2 * t_s)
    }

    /// Returns the angle that the direction turns through between two instants, rad; slightly more if the trajectory
    /// bends.
    pub fn swept_rad(&self, from_s: f64, to_s: f64) -> f64 {
        let middle = self.apparent_icrf(0.5 * (from_s + to_s));
        self.apparent_icrf(from_s).angle_between(middle) + middle.angle_between(self.apparent_icrf(to_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EARTH_GM_KM3_S2: f64 = 398_600.441_8;

    /// Returns a circular orbit of radius r about an axis, as seen from a place at rest.
    fn circle_km(r: f64, t_s: f64) -> DVec3 {
        let n = (EARTH_GM_KM3_S2 / r.powi(3)).sqrt();
        let (sin, cos) = (n * t_s).sin_cos();
        DVec3::new(r * cos, r * sin * 0.6, r * sin * 0.8)
    }

    fn worst_km(r: f64, half_s: f64) -> f64 {
        let path = SkyPath::through(SkyPath::instants_s(half_s).map(|t| circle_km(r, t)), half_s, [DVec3::ZERO; 2]);
        let steps = (-100..=100).map(|i| f64::from(i) / 100.0 * half_s);
        steps.map(|t| path.from_observer_km(t).distance(circle_km(r, t))).fold(0.0, f64::max)
    }

    #[test]
    fn the_error_stays_below_its_bound_and_near_it() {
        for half_s in [0.5, 5.0, 30.0] {
            let r = 6_778.0;
            let (worst, bound) = (
                worst_km(r, half_s),
                SkyPath::bound_km(half_s, [Fall { gm_km3_s2: EARTH_GM_KM3_S2, radius_km: r }, Fall::NONE]),
            );
            println!("{half_s} s: {worst:e} of {bound:e} km");
            assert!(worst < bound + 1e-11, "{half_s}: {worst:e} {bound:e}");
            // A circle's own fourth derivative is a fourteenth of the bound's.
            assert!(half_s < 4.0 || worst > bound / 20.0, "{half_s}: {worst:e} {bound:e}");
        }
        assert!(worst_km(6_778.0, 300.0) > 0.5, "control: ten minutes are too long for a cubic");
    }

    #[test]
    fn a_cubic_is_itself_and_directions_are_aberrated() {
        let way = |t: f64| DVec3::new(900.0 + 7.0 * t, -3.0 + t * t, 200.0 - t * t * t);
        let velocity = DVec3::new(0.0, 29.8, 0.0);
        let path = SkyPath::through(SkyPath::instants_s(2.0).map(way), 2.0, [velocity * 0.5, velocity * 1.5]);
        for t in [-2.0, -0.7, 0.0, 1.3, 2.0] {
            assert!(path.from_observer_km(t).distance(way(t)) < 1e-9, "{t}");
            let wanted = aberrated(way(t).normalize(), velocity * (1.0 + 0.25 * t));
            assert!(path.apparent_icrf(t).distance(wanted) < 1e-13, "{t}");
        }
        let apart = path.apparent_icrf(0.0).angle_between(way(0.0).normalize());
        assert!(apart > 5e-5, "control: aberration is {apart} rad");
    }
}
