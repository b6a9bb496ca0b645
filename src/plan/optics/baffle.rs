//! Sun, Moon and Earth off the field -> irradiance of the detector through a baffle.
//!
//! Out: shares of the Sun's irradiance at 1 au that reach the detector, and from which side. In: the bodies in sensor
//! axes, and the baffle's point-source transmittance `PST(w) = E_detector / E_source`, `E_source` taken normal to the
//! source's direction, `w` its angle off the boresight (Breault, Handbook of Optics vol. I, ch. 38). `ln PST` is linear
//! between table rows; the first holds below its angle, the last up to 90 deg; beyond, the aperture sees no source.
//!
//! * Sun: `(1 au / d)^2`, a point.
//! * Moon: magnitude -12.74 at full and mean distance against the Sun's -26.76 (Allen's Astrophysical Quantities, 4th ed.;
//!   Willmer 2018, ApJS 236, 47), fainter by `0.026 |a| + 4e-9 a^4` at phase angle `a`, deg (Krisciunas and Schaefer 1991,
//!   PASP 103, 1033, eq. 9), and by the squares of both distances. A point; no Earthshine.
//! * Earth: a Lambert sphere of one albedo, sunlit, cut into [`RINGS`] x [`SECTORS`] equal solid angles of its disc, each
//!   with radiance `albedo cos(i) E_sun / pi` and its own angle off the boresight: good from low orbits, where the disc
//!   fills half the sky, to the Moon's distance. No clouds, ocean glint, airglow or twilight.
//! * The Earth hides Sun and Moon; the visible part of the Sun's disc is linear in its depth.
//!
//! A body inside the field of view is not stray light: only its scatter at the table's first row is computed here; its
//! image is drawn if a bench includes bodies. Light within a frame is uniform plus the gradient given in the camera
//! file ([`Glare::towards`]). Tests below: Lambert sphere in closed form, table, phases, eclipse;
//! `tests/physics/field_light` for the whole chain.

use base::refused::Refused;
use base::units::{AU_KM, DEG};
use core::f64::consts::{FRAC_PI_2, PI, TAU};
use glam::{DVec2, DVec3};
use std::sync::Arc;

/// Number of rings of equal solid angle on the Earth's disc.
pub const RINGS: u32 = 32;
/// Number of sectors of each ring.
pub const SECTORS: u32 = 64;
/// Equatorial radius of the Earth, km (WGS 84).
pub const EARTH_RADIUS_KM: f64 = 6_378.137;
/// Bond albedo of the Earth (Allen's Astrophysical Quantities, 4th ed.: 0.306).
pub const EARTH_ALBEDO: f64 = 0.306;
/// Gaia G of the Sun at 1 au (Casagrande and VandenBerg 2018, MNRAS 479, L102: M_G 4.67; minus 31.572).
pub const SUN_MAG_G: f64 = -26.90;
/// Gaia BP - RP of the Sun (the same).
pub const SUN_BP_RP: f64 = 0.82;
/// Magnitude of the full Moon at mean distance minus that of the Sun.
const MOON_LESS_SUN_MAG: f64 = -12.74 + 26.76;
/// Mean distance of the Moon to which its magnitude refers, km.
const MOON_DISTANCE_KM: f64 = 384_400.0;
/// Radius of the Sun, km (IAU 2015 Resolution B3).
const SUN_RADIUS_KM: f64 = 695_700.0;
/// Radius of the Moon, km.
const MOON_RADIUS_KM: f64 = 1_737.4;

/// Transmittance against the angle off the boresight.
#[derive(Debug, Clone, PartialEq)]
pub struct PointSourceTransmittance {
    angle_rad: Vec<f64>,
    ln: Vec<f64>,
}

impl PointSourceTransmittance {
    /// Returns a table from rows of angle, deg, and transmittance.
    ///
    /// # Errors
    /// When there are fewer than two rows, angles do not rise within 0..180, or a share is not in 0..1.
    pub fn new(rows: &[[f64; 2]]) -> Result<Self, Refused> {
        if !(2..=1000).contains(&rows.len()) {
            return Err(Refused(format!(
                "point-source transmittance: wanted 2 to 1000 rows of [angle_deg, transmittance], got {got}; one row gives no slope",
                got = rows.len()
            )));
        }
        let mut after_deg = f64::NEG_INFINITY;
        for (i, [got_deg, got]) in rows.iter().copied().enumerate() {
            let row = i + 1;
            if !(got_deg > after_deg && (0.0..=180.0).contains(&got_deg)) {
                return Err(Refused(format!(
                    "point-source transmittance, row {row}: wanted an angle above {after_deg} and up to 180 deg, got {got_deg}; sort the rows by angle",
                    after_deg = after_deg.max(0.0)
                )));
            }
            if !(got > 0.0 && got <= 1.0) {
                return Err(Refused(format!(
                    "point-source transmittance, row {row}: wanted a share above 0 and up to 1, got {got}; where no light is left, give a very small one such as 1e-30"
                )));
            }
            after_deg = got_deg;
        }
        let angle_rad = rows.iter().map(|row| row[0] * DEG).collect();
        Ok(Self { angle_rad, ln: rows.iter().map(|row| row[1].ln()).collect() })
    }

    /// Returns the share of a source's irradiance that reaches the detector, at an angle off the boresight.
    pub fn at(&self, off_axis_rad: f64) -> f64 {
        if off_axis_rad > FRAC_PI_2 || off_axis_rad.is_nan() {
            return 0.0;
        }
        let after = self.angle_rad.partition_point(|angle| *angle <= off_axis_rad);
        let last = self.ln.len() - 1;
        if after == 0 {
            return self.ln[0].exp();
        }
        if after > last {
            return self.ln[last].exp();
        }
        let (a, b) = (self.angle_rad[after - 1], self.angle_rad[after]);
        let share = (off_axis_rad - a) / (b - a);
        (self.ln[after - 1] * (1.0 - share) + self.ln[after] * share).exp()
    }
}

/// A baffle and the bodies that shine on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Baffle {
    /// Transmittance.
    pub transmittance: Arc<PointSourceTransmittance>,
    /// True for each of Sun, Moon and Earth that shines.
    pub shines: [bool; 3],
    /// Exclusion angles between boresight and limb, below which the instrument is not meant to work: Sun, Moon, Earth,
    /// rad.
    pub exclusion_rad: [f64; 3],
    /// Albedo of the Earth.
    pub earth_albedo: f64,
}

/// Bodies in sensor axes (+Z boresight, +X image right, +Y image down), from the sensor, km.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrightBodies {
    /// The Sun's centre.
    pub sun_km: DVec3,
    /// The Moon's centre.
    pub moon_km: DVec3,
    /// The Earth's centre; `None` without the Earth.
    pub earth_km: Option<DVec3>,
}

/// Stray light of one frame, as shares of the Sun's irradiance at 1 au.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Glare {
    /// Mean over the detector.
    pub share: f64,
    /// Sum of every source's share times the unit vector towards its side of the image (x right, y down).
    pub towards: DVec2,
    /// True for each of Sun, Moon and Earth that is inside its exclusion angle.
    pub excluded: [bool; 3],
}

impl Glare {
    fn add(&mut self, share: f64, direction: DVec3) {
        self.share += share;
        self.towards += share * direction.truncate().normalize_or_zero();
    }
}

impl Baffle {
    /// Returns the stray light of the bodies. Does not allocate; 2048 angles when the Earth shines, about 0.1 ms.
    pub fn glare(&self, bodies: &BrightBodies) -> Glare {
        let mut glare = Glare::default();
        let [sun_shines, moon_shines, earth_shines] = self.shines;
        if sun_shines {
            let seen = seen_past_earth(bodies.sun_km, SUN_RADIUS_KM, bodies.earth_km);
            glare.add(seen * nearness(bodies.sun_km) * self.at(bodies.sun_km), bodies.sun_km);
        }
        if moon_shines {
            let seen = seen_past_earth(bodies.moon_km, MOON_RADIUS_KM, bodies.earth_km);
            glare.add(seen * moonlight(bodies) * self.at(bodies.moon_km), bodies.moon_km);
        }
        if let (true, Some(earth_km)) = (earth_shines, bodies.earth_km) {
            self.add_earth(bodies.sun_km, earth_km, &mut glare);
        }
        let bodies = [
            (Some(bodies.sun_km), SUN_RADIUS_KM),
            (Some(bodies.moon_km), MOON_RADIUS_KM),
            (bodies.earth_km, EARTH_RADIUS_KM),
        ];
        for (i, (body_km, radius_km)) in bodies.into_iter().enumerate() {
            let limb_rad = |km: DVec3| km.angle_between(DVec3::Z) - apparent_radius_rad(km, radius_km);
            glare.excluded[i] = body_km.is_some_and(|km| limb_rad(km) < self.exclusion_rad[i]);
        }
        glare
    }

    fn at(&self, direction: DVec3) -> f64 {
        self.transmittance.at(direction.angle_between(DVec3::Z))
    }

    /// Adds the Earth's sunlit disc, patch by patch.
    fn add_earth(&self, sun_km: DVec3, earth_km: DVec3, glare: &mut Glare) {
        let distance_km = earth_km.length();
        let nadir = earth_km / distance_km;
        let to_sun = (sun_km - earth_km).normalize();
        let east = nadir.any_orthonormal_vector();
        let north = nadir.cross(east);
        // 1 - cos of the disc's radius, without cancellation far away.
        let sine = (EARTH_RADIUS_KM / distance_km).min(1.0);
        let depth = sine * sine / (1.0 + (1.0 - sine * sine).sqrt());
        let solid_angle = TAU * depth / f64::from(RINGS * SECTORS);
        let radiance = self.earth_albedo / PI * nearness(sun_km - earth_km);
        for ring in 0..RINGS {
            // 1 - cos of the ring's angle from nadir.
            let short = depth * (f64::from(ring) + 0.5) / f64::from(RINGS);
            let (cos, sin2) = (1.0 - short, short * (2.0 - short));
            let half_chord = (sine * sine - sin2).max(0.0).sqrt();
            let range_km = distance_km * (cos - half_chord);
            for sector in 0..SECTORS {
                let (s, c) = (TAU * (f64::from(sector) + 0.5) / f64::from(SECTORS)).sin_cos();
                let direction = nadir * cos + (east * c + north * s) * sin2.sqrt();
                let normal = (direction * range_km - earth_km) / EARTH_RADIUS_KM;
                let lit = normal.dot(to_sun);
                if lit > 0.0 {
                    glare.add(radiance * lit * solid_angle * self.at(direction), direction);
                }
            }
        }
    }
}

/// Returns the ratio of the Sun's irradiance at this distance to that at 1 au.
fn nearness(km: DVec3) -> f64 {
    AU_KM * AU_KM / km.length_squared()
}

/// Returns the ratio of the Moon's irradiance to that of the Sun at 1 au.
fn moonlight(bodies: &BrightBodies) -> f64 {
    let sun_from_moon_km = bodies.sun_km - bodies.moon_km;
    let phase_deg = sun_from_moon_km.angle_between(-bodies.moon_km) / DEG;
    let fainter_mag = MOON_LESS_SUN_MAG + 0.026 * phase_deg + 4e-9 * phase_deg.powi(4);
    let near = MOON_DISTANCE_KM * MOON_DISTANCE_KM / bodies.moon_km.length_squared();
    10_f64.powf(-0.4 * fainter_mag) * near * nearness(sun_from_moon_km)
}

fn apparent_radius_rad(km: DVec3, radius_km: f64) -> f64 {
    (radius_km / km.length()).min(1.0).asin()
}

/// Returns the share of a body's disc that the Earth leaves visible: linear in depth.
fn seen_past_earth(body_km: DVec3, radius_km: f64, earth_km: Option<DVec3>) -> f64 {
    let Some(earth_km) = earth_km else { return 1.0 };
    let [earth_rad, body_rad] =
        [apparent_radius_rad(earth_km, EARTH_RADIUS_KM), apparent_radius_rad(body_km, radius_km)];
    let beyond_rad = body_km.angle_between(earth_km) - earth_rad;
    (0.5 + 0.5 * beyond_rad / body_rad).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: [[f64; 2]; 3] = [[5.0, 1e-3], [30.0, 1e-7], [80.0, 1e-11]];

    fn baffle(rows: &[[f64; 2]], shines: [bool; 3]) -> Baffle {
        let transmittance = Arc::new(PointSourceTransmittance::new(rows).expect("a table"));
        Baffle { transmittance, shines, exclusion_rad: [30.0 * DEG, 15.0 * DEG, 25.0 * DEG], earth_albedo: 0.3 }
    }

    /// A table that transmits everything in front of the aperture.
    const OPEN: [[f64; 2]; 2] = [[0.0, 1.0], [90.0, 1.0]];

    fn off_axis(deg: f64) -> DVec3 {
        DVec3::new((deg * DEG).sin(), 0.0, (deg * DEG).cos())
    }

    /// Returns bodies far from the boresight and from one another, with no effect.
    fn nothing_near() -> BrightBodies {
        BrightBodies { sun_km: DVec3::NEG_Z * AU_KM, moon_km: DVec3::NEG_X * MOON_DISTANCE_KM, earth_km: None }
    }

    #[test]
    fn the_table_is_straight_in_the_logarithm_and_ends_at_both_sides() {
        let table = PointSourceTransmittance::new(&ROWS).expect("a table");
        let near = |deg: f64, wanted: f64| (table.at(deg * DEG) / wanted - 1.0).abs() < 1e-9;
        assert!(near(17.5, 1e-5) && near(55.0, 1e-9), "half-way in the logarithm");
        assert!(near(5.0, 1e-3) && near(30.0, 1e-7) && near(80.0, 1e-11), "the rows themselves");
        assert!(near(0.0, 1e-3) && near(89.9, 1e-11), "held beyond both ends");
        assert_eq!(table.at(90.1 * DEG), 0.0, "from behind");
    }

    #[test]
    fn bad_tables_are_named() {
        let refuse = |rows: &[[f64; 2]]| PointSourceTransmittance::new(rows).expect_err("bad").to_string();
        assert!(refuse(&ROWS[..1]).contains("got 1"));
        let unsorted = refuse(&[ROWS[1], ROWS[0]]);
        assert!(
            unsorted.contains("row 2") && unsorted.contains("above 30") && unsorted.contains("got 5"),
            "{unsorted}"
        );
        assert!(refuse(&[[-1.0, 0.1], ROWS[0]]).contains("row 1"));
        let dark = refuse(&[[1.0, 0.0], ROWS[1]]);
        assert!(dark.contains("row 1") && dark.contains("1e-30"), "{dark}");
        assert!(refuse(&[[1.0, 1.1], ROWS[1]]).contains("1.1") && refuse(&[[1.0, f64::NAN], ROWS[1]]).contains("NaN"));
    }

    #[test]
    fn the_sun_shines_through_the_table_from_its_side() {
        let only = baffle(&ROWS, [true, false, false]);
        let bodies = |deg: f64, au: f64| BrightBodies { sun_km: off_axis(deg) * AU_KM * au, ..nothing_near() };
        let glare = only.glare(&bodies(30.0, 1.0));
        assert!((glare.share / 1e-7 - 1.0).abs() < 1e-9 && glare.towards.distance(DVec2::X * glare.share) < 1e-20);
        assert!((only.glare(&bodies(30.0, 0.983)).share / glare.share - 1.0 / 0.983_f64.powi(2)).abs() < 1e-9);
        // Exclusion counts from the limb: 30 deg and the Sun's 0.267 deg.
        assert!(only.glare(&bodies(30.2, 1.0)).excluded[0] && !only.glare(&bodies(30.3, 1.0)).excluded[0]);
        let off = baffle(&ROWS, [false; 3]).glare(&bodies(10.0, 1.0));
        assert!(off.share == 0.0 && off.excluded[0], "its exclusion is still reported");
    }

    #[test]
    fn the_moon_fades_with_its_phase() {
        let only = baffle(&OPEN, [false, true, false]);
        let moon_km = off_axis(40.0) * MOON_DISTANCE_KM;
        let at_phase = |deg: f64| {
            let back = -moon_km.normalize();
            let side = back.any_orthonormal_vector();
            let to_sun = back * (deg * DEG).cos() + side * (deg * DEG).sin();
            only.glare(&BrightBodies { sun_km: moon_km + to_sun * AU_KM, moon_km, earth_km: None }).share
        };
        // Full: 14.02 mag below the Sun. Quarter: 0.026 x 90 + 4e-9 x 90^4 = 2.60 mag below full.
        assert!((at_phase(0.0) / 10_f64.powf(-0.4 * 14.02) - 1.0).abs() < 1e-9, "{}", at_phase(0.0));
        assert!((at_phase(90.0) / at_phase(0.0) - 10_f64.powf(-0.4 * 2.602_44)).abs() < 1e-6);
    }

    /// Returns the light of a Lambert sphere seen from far away: (2/3) A (R/d)^2 (sin a + (pi - a) cos a) / pi (Russell
    /// 1916).
    fn lambert(phase_rad: f64, distance_km: f64) -> f64 {
        let shape = (phase_rad.sin() + (PI - phase_rad) * phase_rad.cos()) / PI;
        2.0 / 3.0 * 0.3 * (EARTH_RADIUS_KM / distance_km).powi(2) * shape
    }

    fn earth_at(distance_km: f64, phase_deg: f64, rows: &[[f64; 2]]) -> f64 {
        let earth_km = off_axis(50.0) * distance_km;
        let (back, side) = (-off_axis(50.0), off_axis(50.0).any_orthonormal_vector());
        let to_sun = back * (phase_deg * DEG).cos() + side * (phase_deg * DEG).sin();
        let bodies = BrightBodies { sun_km: earth_km + to_sun * AU_KM, earth_km: Some(earth_km), ..nothing_near() };
        baffle(rows, [false, false, true]).glare(&bodies).share
    }

    #[test]
    fn the_earth_far_away_is_a_lambert_sphere() {
        for phase_deg in [0.0, 45.0, 90.0, 135.0] {
            let (got, wanted) = (earth_at(4e6, phase_deg, &OPEN), lambert(phase_deg * DEG, 4e6));
            // The terminator crosses patches; a thinner crescent has fewer of them.
            assert!((got / wanted - 1.0).abs() < 0.01, "{phase_deg}: {got} {wanted}");
        }
        assert!(earth_at(4e6, 180.0, &OPEN) < 1e-3 * lambert(0.0, 4e6), "new Earth");
    }

    #[test]
    fn the_earth_from_low_orbit_is_a_wide_disc() {
        // Full Earth right below: the limb is at asin(R/d) = 68 deg, radiance 0.3 / pi at nadir.
        let distance_km = EARTH_RADIUS_KM + 500.0;
        let bodies =
            BrightBodies { sun_km: DVec3::NEG_Z * AU_KM, earth_km: Some(DVec3::Z * distance_km), ..nothing_near() };
        let got = baffle(&OPEN, [false, false, true]).glare(&bodies);
        // The same integral by 20000 rings: 2 A int cos(i) d(cos rho).
        let sine: f64 = EARTH_RADIUS_KM / distance_km;
        let depth = 1.0 - (1.0 - sine * sine).sqrt();
        let ring = |k: u32| {
            let cos: f64 = 1.0 - depth * (f64::from(k) + 0.5) / 20_000.0;
            // The Sun is behind the observer: its angle to the normal is that at the Earth's centre.
            let rho = cos.acos();
            let at_centre = (rho.sin() / sine).asin() - rho;
            at_centre.cos() * depth / 20_000.0
        };
        let wanted = 2.0 * 0.3 * (0..20_000).map(ring).sum::<f64>();
        assert!((got.share / wanted - 1.0).abs() < 2e-3, "{} {wanted}", got.share);
        assert!(got.excluded[2] && got.towards.length() < 1e-9 * got.share, "straight ahead, no side");
        let point = 0.3 * 2.0 / 3.0 * sine * sine;
        assert!((wanted / point - 1.0).abs() > 0.1, "control: a point at its centre is another thing");
    }

    #[test]
    fn steep_tables_need_no_finer_disc() {
        // Four decades over the disc, seen from a low orbit with the boresight 20 deg above the limb.
        let rows: Vec<[f64; 2]> = (0..=18).map(|i| [5.0 * f64::from(i), 10_f64.powf(-0.3 * f64::from(i))]).collect();
        let fine: f64 = {
            // The same sum by random directions.
            let table = PointSourceTransmittance::new(&rows).expect("a table");
            let earth_km = off_axis(50.0) * (EARTH_RADIUS_KM + 500.0);
            let nadir = earth_km.normalize();
            let (back, side) = (-nadir, nadir.any_orthonormal_vector());
            let to_sun = (back * (40.0 * DEG).cos() + side * (40.0 * DEG).sin()).normalize();
            let (n, mut sum) = (400_000_u32, 0.0);
            for i in 0..n {
                // Fibonacci points over the whole sphere.
                let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
                let (s, c) = (f64::from(i) * 2.399_963_229_728_653).sin_cos();
                let u = DVec3::new(c, s, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z;
                let along = u.dot(earth_km);
                let under = along * along - earth_km.length_squared() + EARTH_RADIUS_KM * EARTH_RADIUS_KM;
                if along > 0.0 && under > 0.0 {
                    let normal = (u * (along - under.sqrt()) - earth_km) / EARTH_RADIUS_KM;
                    sum += normal.dot(to_sun).max(0.0) * table.at(u.angle_between(DVec3::Z));
                }
            }
            sum * 4.0 * PI / f64::from(n) * 0.3 / PI
        };
        let got = earth_at(EARTH_RADIUS_KM + 500.0, 40.0, &rows);
        assert!((got / fine - 1.0).abs() < 0.02, "{got:e} {fine:e}");
    }

    #[test]
    fn the_earth_hides_the_sun() {
        let only = baffle(&OPEN, [true, false, false]);
        let at = |from_earth_deg: f64| {
            let bodies = BrightBodies {
                sun_km: off_axis(from_earth_deg - 60.0) * AU_KM,
                earth_km: Some(off_axis(-60.0) * (EARTH_RADIUS_KM + 500.0)),
                ..nothing_near()
            };
            only.glare(&bodies).share
        };
        let limb_deg = (EARTH_RADIUS_KM / (EARTH_RADIUS_KM + 500.0)).asin() / DEG;
        assert_eq!(at(limb_deg - 0.3), 0.0, "night");
        assert!((at(limb_deg) - 0.5).abs() < 1e-6, "half the disc at the limb");
        assert!((at(limb_deg + 0.3) - 1.0).abs() < 1e-9, "day");
    }
}
