//! Range, phase, sunlight -> magnitude of a target (Gaia G).
//!
//! A sphere of diameter D and diffuse (Lambert) reflectance a, distance d, lit at phase angle p by a Sun of magnitude M
//! at 1 au: of the Sun's light at the target `a (D / 2 d)^2 (2 / 3 pi) (sin p + (pi - p) cos p)` arrives (Lambert's
//! sphere; Seeliger; van de Hulst, Multiple Light Scattering, 1980, sec. 18.1), and of one that mirrors the share s `s
//! (D / 4 d)^2` at any phase. A magnitude given for 1000 km and half phase goes with the same law; so does a table of
//! magnitudes at 1000 km over phase, by its own numbers. The Sun's distance counts, and the share of it that the Earth
//! leaves. Limits: convex bodies that do not flash; no light from the Earth or the Moon. Test: below, against a
//! numerical integral over the sphere and the full Moon.

use base::units::AU_KM;
use core::f64::consts::PI;

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
