//! Catalog epoch -> direction at another time: uniform straight motion in space.
//!
//! u(t) = normalise(u0 + (t - t0) (pm_ra_cosdec e + pm_dec n + radial u0)), e and n the directions of east and north at
//! u0 (ESA, The Hipparcos and Tycho Catalogues, vol. 1, sec. 1.5.5; Urban and Seidelmann, Explanatory Supplement, 3rd
//! ed., sec.
//! 7.2.3). The radial rate is v_r parallax / 4.74.
//!
//! Limit: catalogs here list no radial velocities; those of seventeen near and fast stars are known
//! (`stars::radial_velocity`). Neglect would displace Barnard's star by 740 mas in 2050, Kapteyn's by 640, 61 Cygni by
//! 118 (10 in 2026), Groombridge 1830 by 90. Of the other stars of the built-in catalog 281 come to more than 1 mas by
//! 2050, and 17 to 10, at 30 km/s; nearly all stay below 0.1. A source without proper motion stays. Tests:
//! `follows_a_published_position`, `tests/physics/space_motion.rs` (these numbers) and `tests/physics/apparent_places`.

use base::{source::ProperMotion, units::MAS};
use glam::DVec3;

/// Returns the direction `years` (Julian) after the epoch of `direction_icrf`, as seen from the barycentre; unit
/// vector.
pub fn at_epoch(direction_icrf: DVec3, motion: Option<ProperMotion>, years: f64) -> DVec3 {
    motion.map_or(direction_icrf, |motion| moved_in_space(direction_icrf, motion, years).normalize())
}

/// Returns the place `years` (Julian) after the epoch of `direction_icrf`, from the barycentre, in units of the
/// distance at that epoch: its length says how much further away the star is.
pub(super) fn moved_in_space(direction_icrf: DVec3, motion: ProperMotion, years: f64) -> DVec3 {
    let east = DVec3::new(-direction_icrf.y, direction_icrf.x, 0.0).normalize_or_zero();
    let north = direction_icrf.cross(east);
    let across_mas_yr = east * f64::from(motion.pm_ra_cosdec_mas_yr) + north * f64::from(motion.pm_dec_mas_yr);
    let rate_mas_yr = across_mas_yr + direction_icrf * f64::from(motion.radial_mas_yr);
    direction_icrf + rate_mas_yr * (years * MAS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::source::{direction_from_ra_dec, ra_dec_rad};
    use base::units::DEG;

    #[test]
    fn follows_a_published_position() {
        // Meeus, Astronomical Algorithms, 2nd ed., example 21.b gives theta Persei's proper motion to J2028.8670:
        // J2000 2h44m11.986s +49d13'42.48", +0.03425 s/yr, -0.0895 arcsec/yr -> 2h44m12.975s (+0.989 s),
        // +49d13'39.90" (-2.58"), to its printed digits (0.001 s = 15 mas x cos dec, 0.01 arcsec).
        let start = [(2.0 + 44.0 / 60.0 + 11.986 / 3600.0) * 15.0 * DEG, (49.0 + 13.0 / 60.0 + 42.48 / 3600.0) * DEG];
        let cos_dec = start[1].cos();
        #[allow(clippy::cast_possible_truncation, reason = "the literal has five digits")]
        let pm_ra = (0.034_25 * 15_000.0 * cos_dec) as f32;
        let motion = ProperMotion { pm_ra_cosdec_mas_yr: pm_ra, pm_dec_mas_yr: -89.5, radial_mas_yr: 0.0 };
        let years = 28.867_0;
        let [ra, dec] = ra_dec_rad(at_epoch(direction_from_ra_dec(start[0], start[1]), Some(motion), years));
        assert!(((ra - start[0]) / (15.0 * DEG) * 3600.0 - 0.989).abs() < 0.001, "{}", (ra - start[0]) / DEG);
        assert!(((dec - start[1]) / DEG * 3600.0 + 2.58).abs() < 0.01, "{}", (dec - start[1]) / DEG);
    }

    #[test]
    fn unknown_motion_and_zero_time_change_nothing() {
        let star = direction_from_ra_dec(1.0, 1.5);
        let motion = ProperMotion { pm_ra_cosdec_mas_yr: 500.0, pm_dec_mas_yr: -500.0, radial_mas_yr: 0.0 };
        assert_eq!(at_epoch(star, None, 50.0), star);
        assert!(at_epoch(star, Some(motion), 0.0).distance(star) < 1e-15);
        assert!(at_epoch(star, Some(motion), 1.0).distance(star) > 700.0 * MAS, "control: it moves");
    }

    #[test]
    fn the_pole_itself_gives_a_direction() {
        let motion = ProperMotion { pm_ra_cosdec_mas_yr: 500.0, pm_dec_mas_yr: -500.0, radial_mas_yr: 0.0 };
        assert!(at_epoch(DVec3::Z, Some(motion), 10.0).is_normalized());
    }
}
