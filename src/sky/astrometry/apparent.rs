//! Catalog sources, time, observer -> apparent sources: space motion, then parallax, then deflection of light by the
//! Sun (where the [`Vantage`] has one), then aberration.
//!
//! Neglected, in mas: radial velocities that are not known ([`super::at_epoch`]), the light's time across the
//! observer's distance from the barycentre (0.16 per au for Barnard's star, 0.08 for 61 Cygni), the difference of TDB
//! and the catalog's TCB year (below 0.01), bodies other than the Sun ([`super::deflected`]). Atmosphere: none.
//!
//! Measured against ERFA with JPL's Earth, Sun and Moon, 1991-2050, observers from low orbits to the Moon and about the
//! Sun: 0.21 mas at worst over 199 cases, Barnard's star; 0.03 for stars that are slower. Outside [`PROVEN_YEARS`]
//! `starloop check` warns. Tests: `agrees_with_an_independent_library`, `tests/physics/apparent_vectors.rs` and, from
//! other stars' data and by other formulae, `tests/physics/apparent_places.rs`.
//!
//! *Parallax.* Barycentric direction -> direction from the observer's position.
//!
//! u' = normalise(u - parallax r), r the observer's barycentric position in au, parallax in rad (Urban and Seidelmann,
//! Explanatory Supplement, 3rd ed., sec. 7.2.3.1; exact for the distance 1 au / parallax up to the third order of the
//! parallax, 1e-17 rad). A source of unknown parallax is taken as infinitely far, parallax zero: wrong by its true
//! parallax, which for a blank in the built-in catalog is typically below 10 mas. Test: `a_year_draws_the_parallax`.
//!
//! *Space motion.* Catalog epoch -> direction at another time: uniform straight motion in space.
//!
//! u(t) = normalise(u0 + (t - t0) (pm_ra_cosdec e + pm_dec n + radial u0)), e and n the directions of east and north at
//! u0 (ESA, The Hipparcos and Tycho Catalogues, vol. 1, sec. 1.5.5; Urban and Seidelmann, Explanatory Supplement, 3rd
//! ed., sec. 7.2.3). The radial rate is v_r parallax / 4.74.
//!
//! Limit: catalogs here list no radial velocities; those of seventeen near and fast stars are known
//! (`stars::radial_velocity`). Neglect would displace Barnard's star by 740 mas in 2050, Kapteyn's by 640, 61 Cygni by
//! 118 (10 in 2026), Groombridge 1830 by 90. Of the other stars of the built-in catalog 281 come to more than 1 mas by
//! 2050, and 17 to 10, at 30 km/s; nearly all stay below 0.1. A source without proper motion stays. Tests:
//! `follows_a_published_position`, `tests/physics/space_motion.rs` (these numbers) and `tests/physics/apparent_places`.

use super::{Sight, Vantage};
use base::source::{CatalogSource, ProperMotion};
use base::time::Tai;
use base::units::{AU_KM, MAS};
use glam::DVec3;

/// Years over which places were compared with independent ephemerides and found good to 1 mas.
pub const PROVEN_YEARS: [f64; 2] = [1991.0, 2051.0];
/// Julian year of J2000.0.
const J2000_YR: f64 = 2000.0;

/// Where sources of one catalog epoch are seen from one [`Vantage`] at one time. Made once per frame.
#[derive(Debug, Clone, Copy)]
pub struct ApparentPlaces {
    years: f64,
    observer_km: DVec3,
    sight: Sight,
}

impl ApparentPlaces {
    /// Prepares for sources of the catalog epoch `epoch_yr` (Julian year) as they are seen from `vantage` at `at`.
    pub fn new(epoch_yr: f64, at: Tai, vantage: &Vantage) -> Self {
        let observer_km = vantage.observer.position_km;
        Self { years: years_since(epoch_yr, at), observer_km, sight: vantage.sight() }
    }

    /// Returns the apparent direction, unit vector in ICRF axes, of what is in the direction `direction_icrf` (unit
    /// vector) at the catalog epoch; a motion or parallax of zero is none.
    #[inline]
    pub fn place(&self, direction_icrf: DVec3, motion: ProperMotion, parallax_mas: f32) -> DVec3 {
        // Not of length 1: the parallax is that of the distance of then.
        let barycentric = moved_in_space(direction_icrf, motion, self.years);
        self.sight.apparent(parallax_shifted(barycentric, parallax_mas, self.observer_km))
    }

    /// Returns the same of a catalog source.
    pub fn of(&self, source: &CatalogSource) -> DVec3 {
        let motion = source.proper_motion.unwrap_or_default();
        self.place(source.direction_icrf, motion, source.parallax_mas.unwrap_or(0.0))
    }
}

/// Returns how much wider than the field of view a catalog cone must be so that no star is missed that is seen in the
/// field from `vantage`, or has moved into it since the catalog's epoch at `fastest_mas_yr` at most, rad.
pub fn cone_margin_rad(epoch_yr: f64, fastest_mas_yr: f64, at: Tai, vantage: &Vantage) -> f64 {
    vantage.margin_rad() + years_since(epoch_yr, at).abs() * fastest_mas_yr * MAS
}

/// Returns the Julian years (TDB) from the catalog epoch `epoch_yr` (a Julian year such as 2016.0) to `at`.
pub fn years_since(epoch_yr: f64, at: Tai) -> f64 {
    at.years_since_j2000() - (epoch_yr - J2000_YR)
}

/// Returns the direction of a source from the barycentric position `observer_km`; unit vector. `direction_icrf` has the
/// length of its distance in units of that at which it has `parallax_mas`.
pub fn parallax_shifted(direction_icrf: DVec3, parallax_mas: f32, observer_km: DVec3) -> DVec3 {
    (direction_icrf - observer_km * (f64::from(parallax_mas) * MAS / AU_KM)).normalize()
}

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
    use crate::{earth, state::BarycentricState};
    use base::source::direction_from_ra_dec;
    use base::units::{ARCSEC, DEG};
    use stars::catalog::Catalog;

    /// Measured 0.05: light-time across the Earth's orbit times Barnard's proper motion (erfa counts it) is 0.1,
    /// f32 proper motions and VSOP87 against erfa's Earth are less.
    const AGREEMENT_MAS: f64 = 0.2;
    /// Velocity (km/s) and position (km) of the imagined orbit.
    const ORBIT: BarycentricState = BarycentricState {
        position_km: DVec3::new(5_000.0, 3_000.0, -3_000.0),
        velocity_km_s: DVec3::new(3.0, -6.0, 3.5),
    };

    /// Time, [ra deg, dec deg, pm ra cos dec, pm dec, parallax] at J2016.0, apparent direction by pyerfa 2.0.1:
    /// epv00 plus ORBIT, pmpx (zero radial velocity), ab; no deflection. Betelgeuse, Sirius, Polaris, and stars like
    /// alpha Centauri and Barnard's, and one without motion. Behind each case: what the Sun's deflection would add (by
    /// erfa.ldsun) and the distance from the Sun, deg.
    #[rustfmt::skip]
    const CASES: [(&str, [f64; 5], [f64; 3]); 12] = [
        ("2026-03-01T12:00:00Z", [88.79306242, 7.40711422, 27.54, 11.3, 6.55], [0.020864026277, 0.991437095327, 0.128907635216]), // + 3.01 mas at 107.5
        ("2026-03-01T12:00:00Z", [101.28462149, -16.72155163, -546.01, -1223.07, 379.21], [-0.187418083123, 0.939163662687, -0.287829944251]), // + 2.61 mas at 115.2
        ("2026-03-01T12:00:00Z", [37.96995124, 89.26405625, 44.48, -11.85, 7.54], [0.010100369607, 0.007798422786, 0.999918580253]), // + 3.62 mas at 97.2
        ("2026-03-01T12:00:00Z", [219.9, -60.83, -3679.25, 473.67, 754.81], [-0.374047274417, -0.312605428081, -0.873136004776]), // + 3.56 mas at 98.1
        ("2026-03-01T12:00:00Z", [269.45, 4.69, -802.8, 10362.5, 547.45], [-0.009627310054, -0.996566157354, 0.082238731250]), // + 5.51 mas at 73.5
        ("2026-03-01T12:00:00Z", [10.0, 0.0, 0.0, 0.0, 0.0], [0.984825181694, 0.173549303770, -0.000025720855]), // + 15.95 mas at 28.9
        ("2031-09-15T06:00:00Z", [88.79306242, 7.40711422, 27.54, 11.3, 6.55], [0.020906563909, 0.991429338208, 0.128960392857]), // + 4.55 mas at 83.3
        ("2031-09-15T06:00:00Z", [101.28462149, -16.72155163, -546.01, -1223.07, 379.21], [-0.187332708754, 0.939206549665, -0.287745570422]), // + 5.47 mas at 73.0
        ("2031-09-15T06:00:00Z", [37.96995124, 89.26405625, 44.48, -11.85, 7.54], [0.010146236337, 0.007975145501, 0.999916722004]), // + 4.25 mas at 87.3
        ("2031-09-15T06:00:00Z", [219.9, -60.83, -3679.25, 473.67, 754.81], [-0.374130601470, -0.312402045849, -0.873173095550]), // + 5.40 mas at 73.8
        ("2031-09-15T06:00:00Z", [269.45, 4.69, -802.8, 10362.5, 547.45], [-0.009608205118, -0.996535876666, 0.082607075440]), // + 3.60 mas at 96.7
        ("2031-09-15T06:00:00Z", [10.0, 0.0, 0.0, 0.0, 0.0], [0.984796477190, 0.173712106512, 0.000050648177]), // + 0.64 mas at 162.2
    ];

    #[allow(clippy::cast_possible_truncation, reason = "the literals have six digits")]
    fn source(star: [f64; 5]) -> CatalogSource {
        let [ra, dec, pm_ra, pm_dec, parallax] = star;
        CatalogSource {
            id: 0,
            source_id: None,
            direction_icrf: direction_from_ra_dec(ra * DEG, dec * DEG),
            proper_motion: Some(ProperMotion {
                pm_ra_cosdec_mas_yr: pm_ra as f32,
                pm_dec_mas_yr: pm_dec as f32,
                radial_mas_yr: 0.0,
            }),
            parallax_mas: Some(parallax as f32),
            mag_g: 0.0,
            bp_rp: 0.0,
        }
    }

    fn worst_mas(edit: impl Fn(&mut CatalogSource, &mut BarycentricState)) -> f64 {
        let error_mas = CASES.map(|(text, star, wanted)| {
            let at = Tai::from_rfc3339(text).expect("a valid instant");
            let (mut source, mut state) = (source(star), earth::barycentric_state(at) + ORBIT);
            edit(&mut source, &mut state);
            let place = ApparentPlaces::new(2016.0, at, &state.into()).of(&source);
            place.distance(DVec3::from_array(wanted)) / MAS
        });
        error_mas.into_iter().fold(0.0, f64::max)
    }

    #[test]
    fn agrees_with_an_independent_library() {
        let worst = worst_mas(|_, _| ());
        println!("apparent places against pyerfa: worst of 12 is {worst:.3} mas");
        assert!(worst < AGREEMENT_MAS, "{worst} mas");
    }

    #[test]
    fn leaving_out_any_effect_is_noticed() {
        assert!(worst_mas(|source, _| source.proper_motion = None) > 1e4 * AGREEMENT_MAS, "proper motion");
        assert!(worst_mas(|source, _| source.parallax_mas = None) > 500.0 * AGREEMENT_MAS, "parallax");
        assert!(worst_mas(|_, state| state.velocity_km_s = DVec3::ZERO) > 1e4 * AGREEMENT_MAS, "aberration");
        assert!(worst_mas(|_, state| state.velocity_km_s -= ORBIT.velocity_km_s) > 1e3 * AGREEMENT_MAS, "orbit");
    }

    #[test]
    fn the_margin_covers_aberration_and_the_fastest_star() {
        let catalog = Catalog::built_in().expect("the built-in catalog");
        let at = Tai::from_rfc3339("2026-03-01T12:00:00Z").expect("a valid instant");
        let state = earth::barycentric_state(at) + ORBIT;
        let (vantage, epoch_yr) = (Vantage::from(state), catalog.index().epoch_yr);
        let places = ApparentPlaces::new(epoch_yr, at, &vantage);
        let moved = catalog.sources().iter().map(|star| star.direction_icrf.distance(places.of(star)));
        let farthest_rad = moved.fold(0.0, f64::max);
        assert!(
            farthest_rad < cone_margin_rad(epoch_yr, catalog.index().fastest_mas_yr, at, &vantage),
            "{} arcsec",
            farthest_rad / ARCSEC
        );
        assert!(farthest_rad > 60.0 * ARCSEC, "control: Barnard's star has moved by more than a minute of arc");
    }
}

#[cfg(test)]
mod parallax_tests {
    use super::*;

    #[test]
    fn a_year_draws_the_parallax() {
        let star = DVec3::Z;
        let shift = parallax_shifted(star, 750.0, DVec3::X * AU_KM) - star;
        assert!((shift.x / MAS + 750.0).abs() < 1e-6, "towards -x by one parallax for 1 au towards +x: {shift}");
        assert_eq!(parallax_shifted(star, 0.0, DVec3::X * AU_KM), star);
        assert_eq!(parallax_shifted(star, 750.0, DVec3::ZERO), star);
    }
}

#[cfg(test)]
mod space_motion_tests {
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
