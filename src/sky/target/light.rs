//! Range, phase, sunlight -> magnitude of a target (Gaia G).
//!
//! A sphere of diameter D and diffuse (Lambert) reflectance a, distance d, lit at phase angle p by a Sun of magnitude M
//! at 1 au: of the Sun's light at the target `a (D / 2 d)^2 (2 / 3 pi) (sin p + (pi - p) cos p)` arrives (Lambert's
//! sphere; Seeliger; van de Hulst, Multiple Light Scattering, 1980, sec. 18.1), and of one that mirrors the share s `s
//! (D / 4 d)^2` at any phase. A magnitude given for 1000 km and half phase goes with the same law; so does a table of
//! magnitudes at 1000 km over phase, by its own numbers. The Sun's distance counts, and the share of it that the Earth
//! leaves. Limits: convex bodies that do not flash; no light from the Earth or the Moon. Test: below, against a
//! numerical integral over the sphere and the full Moon.
//!
//! *Sunlight.* Target, Sun, Earth -> how much of the Sun the target sees, and whether the Earth is between it and the
//! observer.
//!
//! The Sun's disc is covered by the Earth's as two circles cover each other (Montenbruck and Gill, Satellite Orbits,
//! 2000, sec. 3.4.2): umbra and penumbra of a conical shadow. The Earth is the ellipsoid of WGS 84 about the ICRF's
//! pole (0.15 deg from its own in 2026: 50 m of the flattening's 21 km), taken by scaling the polar axis, which keeps
//! lines of sight straight and makes a sphere of it: exact for the limb, within 0.2 % of the Sun's disc for the shadow.
//! No atmosphere: real shadows begin some 10 km higher and are red within; the light of the Earth itself on targets is
//! left out. Limits: a target above the surface. Tests: below, against the times of a flat triangle.

use base::units::AU_KM;
use core::f64::consts::PI;
use glam::DVec3;

/// The Sun at 1 au, Gaia G (absolute magnitude 4.67: Casagrande and VandenBerg 2018, MNRAS 479, L102; distance modulus
/// -31.572).
pub const SUN_MAG_G: f64 = -26.90;
/// Colour of sunlight, BP-RP (same source), which grey bodies reflect.
pub const SUN_BP_RP: f64 = 0.82;
/// Range of given magnitudes, km.
const STANDARD_RANGE_KM: f64 = 1_000.0;
/// Most points of a table over phase.
pub const MOST_PHASE_POINTS: usize = 32;

/// A table of magnitudes over phase; linear between its points, held beyond them.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseCurve {
    /// Phase angle, rad, ascending; magnitude at 1000 km.
    pub points: Vec<[f64; 2]>,
}

/// Source of a target's brightness.
#[derive(Debug, Clone, PartialEq)]
pub enum Brightness {
    /// A sphere, of size and reflectances.
    Sphere {
        /// Diameter, m.
        diameter_m: f64,
        /// Share of light that is scattered (Lambert).
        diffuse: f64,
        /// Share of light that is mirrored.
        specular: f64,
    },
    /// Its magnitude at 1000 km and phase 90 deg in full sunlight; over phase as a diffuse sphere.
    AtThousandKm(f64),
    /// Its magnitude at 1000 km over phase.
    Table(PhaseCurve),
    /// Its magnitude at any range and phase, in full sunlight.
    Constant(f64),
}

impl Brightness {
    /// Returns the magnitude in full sunlight at `range_km`, where the Sun is `sun_km` from the target.
    pub fn mag_g(&self, range_km: f64, phase_rad: f64, sun_km: f64) -> f64 {
        let from_thousand = 5.0 * (range_km / STANDARD_RANGE_KM).log10() + 5.0 * (sun_km / AU_KM).log10();
        match self {
            Self::Sphere { diameter_m, diffuse, specular } => {
                let size = 0.5e-3 * diameter_m / STANDARD_RANGE_KM;
                let share = size * size * (diffuse * 2.0 / 3.0 * sphere_phase(phase_rad) + 0.25 * specular);
                SUN_MAG_G - 2.5 * share.log10() + from_thousand
            }
            // At 90 deg the sphere sends 1 / pi of what it sends back to the Sun.
            Self::AtThousandKm(mag) => mag - 2.5 * (PI * sphere_phase(phase_rad)).log10() + from_thousand,
            Self::Table(curve) => curve.at(phase_rad) + from_thousand,
            Self::Constant(mag) => *mag,
        }
    }
}

/// Returns the light of a diffuse sphere over that at phase 0: `(sin p + (pi - p) cos p) / pi`.
pub fn sphere_phase(phase_rad: f64) -> f64 {
    // Rounding may bring it below 0 where it ends.
    ((phase_rad.sin() + (PI - phase_rad) * phase_rad.cos()) / PI).max(0.0)
}

impl PhaseCurve {
    fn at(&self, phase_rad: f64) -> f64 {
        let after = self.points.partition_point(|[at, _]| *at <= phase_rad);
        match (after.checked_sub(1).and_then(|before| self.points.get(before)), self.points.get(after)) {
            (Some([a, low]), Some([b, high])) => low + (high - low) * (phase_rad - a) / (b - a),
            (Some([_, mag]), None) | (None, Some([_, mag])) => *mag,
            (None, None) => f64::INFINITY,
        }
    }
}

/// Equatorial radius of the Earth, km (WGS 84).
const EARTH_RADIUS_KM: f64 = 6_378.137;
/// Equatorial over polar radius (WGS 84, flattening 1 / 298.257 223 563).
const OBLATENESS: f64 = 1.003_364_090;
/// Nominal solar radius, km (IAU 2015 Resolution B3).
const SUN_RADIUS_KM: f64 = 695_700.0;

base::words! {
    /// How the Sun shines on a target.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Sunlight {
        /// All of the disc is seen.
        Full = "sunlit",
        /// A part of it.
        Penumbra = "penumbra",
        /// Nothing of it.
        Umbra = "umbra",
    }
}

impl Sunlight {
    /// Returns the kind of light for a share of the Sun's light.
    pub fn of_share(share: f64) -> Self {
        if share >= 1.0 {
            Self::Full
        } else if share > 0.0 {
            Self::Penumbra
        } else {
            Self::Umbra
        }
    }
}

/// Returns axes in which the Earth is a sphere of its equatorial radius.
fn rounded(geocentric_km: DVec3) -> DVec3 {
    DVec3::new(geocentric_km.x, geocentric_km.y, geocentric_km.z * OBLATENESS)
}

/// Returns the share of the Sun's disc that a target at `target_km` sees past the Earth, 0 to 1; both from the
/// geocentre, km.
pub fn sunlight(target_km: DVec3, sun_km: DVec3) -> f64 {
    let (target, sun) = (rounded(target_km), rounded(sun_km));
    let (to_sun, to_earth) = (sun - target, -target);
    let sun_rad = (SUN_RADIUS_KM / to_sun.length()).asin();
    let earth_rad = (EARTH_RADIUS_KM / to_earth.length().max(EARTH_RADIUS_KM)).asin();
    1.0 - covered_share(sun_rad, earth_rad, to_sun.angle_between(to_earth))
}

/// Returns the share of a circle of radius `a` that one of radius `b`, `c` away, covers.
fn covered_share(a: f64, b: f64, c: f64) -> f64 {
    if c >= a + b {
        return 0.0;
    }
    if c <= b - a {
        return 1.0;
    }
    if c <= a - b {
        return (b / a).powi(2);
    }
    let x = (c * c + a * a - b * b) / (2.0 * c);
    let y = (a * a - x * x).max(0.0).sqrt();
    let segments = a * a * (x / a).clamp(-1.0, 1.0).acos() + b * b * ((c - x) / b).clamp(-1.0, 1.0).acos() - c * y;
    (segments / (PI * a * a)).clamp(0.0, 1.0)
}

/// Returns how far above the limb the line of sight from `observer_km` to `target_km` passes, km (from the geocentre,
/// both); negative when the Earth is between. An observer inside the Earth, as at its centre, sees through it.
pub fn limb_clearance_km(observer_km: DVec3, target_km: DVec3) -> f64 {
    let (observer, target) = (rounded(observer_km), rounded(target_km));
    if observer.length() < EARTH_RADIUS_KM {
        return f64::INFINITY;
    }
    let way = target - observer;
    let nearest = (-observer.dot(way) / way.length_squared()).clamp(0.0, 1.0);
    (observer + nearest * way).length() - EARTH_RADIUS_KM
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::DEG;
    use glam::DVec3;

    /// Returns the light of a Lambert sphere of unit radius and reflectance by summing its surface: both cosines over
    /// pi.
    fn summed(phase_rad: f64) -> f64 {
        const STEPS: usize = 400;
        let (sun, observer) = (DVec3::X, DVec3::new(phase_rad.cos(), phase_rad.sin(), 0.0));
        let mut sum = 0.0;
        for i in 0..STEPS {
            let z = (i as f64 + 0.5) / STEPS as f64 * 2.0 - 1.0;
            for j in 0..STEPS {
                let (sin, cos) = ((j as f64 + 0.5) / STEPS as f64 * 2.0 * PI).sin_cos();
                let normal = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
                sum += normal.dot(sun).max(0.0) * normal.dot(observer).max(0.0);
            }
        }
        sum * 4.0 / (STEPS * STEPS) as f64
    }

    #[test]
    fn a_diffuse_sphere_is_its_integral() {
        for phase_deg in [0.0, 30.0, 90.0, 150.0] {
            let (got, wanted) = (2.0 / 3.0 * sphere_phase(phase_deg * DEG), summed(phase_deg * DEG));
            assert!((got - wanted).abs() < 2e-4, "{phase_deg}: {got} {wanted}");
        }
        assert!(sphere_phase(PI) < 1e-15, "nothing of the dark side");
        assert!((sphere_phase(90.0 * DEG) - 1.0 / PI).abs() < 1e-15);
    }

    #[test]
    fn the_full_moon_is_as_bright_as_published() {
        // V = -12.74 at 384 400 km and full (Allen's Astrophysical Quantities, 4th ed., table 12.9), geometric albedo 0.12,
        // diameter 3474.8 km: of a Lambert sphere of reflectance 3/2 x 0.12. V of the Sun: -26.75; G is 0.15 brighter.
        let moon = Brightness::Sphere { diameter_m: 3_474_800.0, diffuse: 0.18, specular: 0.0 };
        let mag_v = moon.mag_g(384_400.0, 0.0, AU_KM) - (SUN_MAG_G + 26.75);
        assert!((mag_v + 12.74).abs() < 0.05, "{mag_v}");
    }

    #[test]
    fn reported_magnitudes_hold_where_they_were_reported() {
        let at = |brightness: &Brightness, km: f64, phase_deg: f64| brightness.mag_g(km, phase_deg * DEG, AU_KM);
        let reported = Brightness::AtThousandKm(4.0);
        assert!((at(&reported, 1_000.0, 90.0) - 4.0).abs() < 1e-12);
        assert!((at(&reported, 10_000.0, 90.0) - 9.0).abs() < 1e-12, "ten times as far: five magnitudes");
        assert!((at(&reported, 1_000.0, 0.0) - (4.0 - 2.5 * PI.log10())).abs() < 1e-12);
        // A sphere described by its own magnitude is itself.
        let sphere = Brightness::Sphere { diameter_m: 2.0, diffuse: 0.2, specular: 0.0 };
        let same = Brightness::AtThousandKm(at(&sphere, 1_000.0, 90.0));
        for (km, phase_deg) in [(300.0, 20.0), (40_000.0, 140.0)] {
            assert!((at(&sphere, km, phase_deg) - at(&same, km, phase_deg)).abs() < 1e-12);
        }
        // A mirror ball sends the same everywhere: (D / 4 d)^2 of the Sun.
        let ball = Brightness::Sphere { diameter_m: 4.0, diffuse: 0.0, specular: 1.0 };
        assert!((at(&ball, 1_000.0, 170.0) - (SUN_MAG_G + 30.0)).abs() < 1e-12, "{}", at(&ball, 1_000.0, 170.0));
        let table = Brightness::Table(PhaseCurve { points: vec![[0.0, 3.0], [90.0 * DEG, 5.0]] });
        assert!((at(&table, 1_000.0, 45.0) - 4.0).abs() < 1e-12 && (at(&table, 1_000.0, 170.0) - 5.0).abs() < 1e-12);
        assert!((at(&Brightness::Constant(7.5), 12_345.0, 77.0) - 7.5).abs() < 1e-15);
        let near = reported.mag_g(1_000.0, 1.0, 0.98 * AU_KM) - reported.mag_g(1_000.0, 1.0, AU_KM);
        assert!((near - 5.0 * 0.98_f64.log10()).abs() < 1e-12, "a nearer Sun");
    }
}

#[cfg(test)]
mod shadow_tests {
    use super::*;
    use base::units::AU_KM;
    use core::f64::consts::PI;

    #[test]
    fn entry_and_exit_are_those_of_the_cone() {
        // A target on a circle of radius r whose plane holds the Sun. The tangents that Sun and Earth have in common
        // make cones: inside the umbra's at distance x behind the Earth, less than (R - x (S - R) / D) / cos(half
        // angle) from the axis; written with angles at the geocentre: the edge is where the target is asin(R / r) -
        // (asin((S -+ R) / D)) from the axis. Equatorial plane: the sphere is exact there.
        let (earth, sun_radius, distance) = (EARTH_RADIUS_KM, SUN_RADIUS_KM, AU_KM);
        let sun = DVec3::X * distance;
        for altitude_km in [500.0, 35_786.0] {
            let r = earth + altitude_km;
            let on_circle = |angle: f64| DVec3::new(-r * angle.cos(), r * angle.sin(), 0.0);
            let tangent = |sum: f64| (earth / r).asin() + sum;
            let umbra = tangent(-((sun_radius - earth) / distance).asin());
            let penumbra = tangent(((sun_radius + earth) / distance).asin());
            let edge = |wanted: f64, angle: f64| {
                let [inside, outside] = [angle - 2e-7, angle + 2e-7].map(|angle| sunlight(on_circle(angle), sun));
                assert!(
                    if wanted > 0.5 { inside < 1.0 && outside >= 1.0 } else { inside <= 0.0 && outside > 0.0 },
                    "{altitude_km} km, edge of {wanted}: {inside} {outside}"
                );
            };
            edge(0.0, umbra);
            edge(1.0, penumbra);
            // Half of the light where the limb cuts the disc in the middle, nearly: its curve is the larger one's.
            let middle = sunlight(on_circle(0.5 * (umbra + penumbra)), sun);
            assert!((middle - 0.5).abs() < 0.02, "{middle}");
        }
    }

    #[test]
    fn a_low_orbit_crosses_the_penumbra_in_eight_seconds() {
        // 0.53 deg of the Sun at 360 deg in 94.6 min, where the orbit's plane holds the Sun: 8.4 s.
        let (sun, r) = (DVec3::X * AU_KM, EARTH_RADIUS_KM + 500.0);
        let share = |t_s: f64| {
            let angle = 2.0 * PI * t_s / (94.6 * 60.0);
            sunlight(DVec3::new(-r * angle.cos(), r * angle.sin(), 0.0), sun)
        };
        let partial = (0..200_000).filter(|i| Sunlight::of_share(share(f64::from(*i) * 0.01)) == Sunlight::Penumbra);
        let penumbra_s = partial.count() as f64 * 0.01;
        assert!((penumbra_s - 8.4).abs() < 0.1, "{penumbra_s} s");
        assert_eq!(Sunlight::of_share(share(0.0)), Sunlight::Umbra);
        assert_eq!(Sunlight::of_share(share(2_000.0)), Sunlight::Full);
    }

    #[test]
    fn circles_cover_each_other() {
        assert!((covered_share(1.0, 1.0, 0.0) - 1.0).abs() < 1e-15);
        assert!((covered_share(2.0, 1.0, 0.5) - 0.25).abs() < 1e-15, "an annular eclipse");
        // Unit circles a radius apart: 2 pi / 3 - sqrt(3) / 2 of pi.
        assert!((covered_share(1.0, 1.0, 1.0) - (2.0 / 3.0 - 3.0_f64.sqrt() / (2.0 * PI))).abs() < 1e-14);
        assert!(covered_share(1.0, 1.0, 2.0) <= 0.0 && covered_share(1.0, 1.0, 1.999) > 0.0);
    }

    #[test]
    fn the_limb_is_the_ellipsoids() {
        let b = EARTH_RADIUS_KM / OBLATENESS;
        assert!((b - 6_356.752_314).abs() < 1e-5, "polar radius of WGS 84: {b}");
        let [left, right] = [DVec3::new(-9_000.0, 0.0, b + 1.0), DVec3::new(9_000.0, 0.0, b + 1.0)];
        assert!((limb_clearance_km(left, right) - OBLATENESS).abs() < 1e-6, "over the pole");
        let [left, right] = [left, right].map(|v| v - DVec3::Z * 2.0);
        assert!(limb_clearance_km(left, right) < 0.0, "below the pole's height");
        assert!(limb_clearance_km(left, left * 2.0) > 1_000.0, "away from the Earth");
        assert!(limb_clearance_km(DVec3::ZERO, right).is_infinite(), "the geocentre sees through");
        let behind = limb_clearance_km(DVec3::X * 7_000.0, DVec3::X * -42_000.0);
        assert!((behind + EARTH_RADIUS_KM).abs() < 1e-9, "through the centre: {behind}");
    }
}
