//! Places of catalog stars decades after the catalog's epoch: from the published numbers, by other formulae.

use base::source::{CatalogSource, ProperMotion, direction_from_ra_dec};
use base::source_id::{GaiaRelease, SourceId};
use base::units::{DEG, MAS};
use glam::DVec3;
use sky::astrometry::at_epoch;
use stars::{catalog::Catalog, radial_velocity::radial_velocity_km_s};

/// Every hundredth row, and the fastest 300, of the CSV that the built-in catalog was packed from.
const SAMPLE: &str = include_str!("bright_g85_sample.csv");
/// From the catalog's epoch to 2050.
const YEARS: f64 = 34.0;
/// Promised of a place in 2050, with the radial velocities that are known.
const PROMISED_MAS: f64 = 1.0;

/// Returns the direction `years` after the epoch by spherical trigonometry along the great circle of the motion.
fn propagated([ra_deg, dec_deg]: [f64; 2], motion_mas_yr: [f64; 2], years: f64) -> DVec3 {
    let speed_mas_yr = motion_mas_yr[0].hypot(motion_mas_yr[1]);
    // Straight motion at right angles to the first line of sight.
    let arc = (speed_mas_yr * MAS * years).atan();
    let position_angle = motion_mas_yr[0].atan2(motion_mas_yr[1]);
    let (sin_dec, cos_dec) = (dec_deg * DEG).sin_cos();
    let sin_later = sin_dec * arc.cos() + cos_dec * arc.sin() * position_angle.cos();
    let along = position_angle.sin() * arc.sin() * cos_dec;
    let ra = ra_deg * DEG + along.atan2(arc.cos() - sin_dec * sin_later);
    direction_from_ra_dec(ra, sin_later.asin())
}

fn star_named(catalog: &Catalog, name: SourceId) -> CatalogSource {
    let found = catalog.sources().iter().find(|star| star.source_id == Some(name));
    *found.unwrap_or_else(|| panic!("{name} is in the catalog"))
}

#[test]
#[allow(clippy::float_cmp, reason = "steps as they are stored")]
fn places_in_2050_are_those_of_the_csv() {
    let catalog = Catalog::built_in().unwrap();
    let (mut worst_mas, mut coarse_mas, mut compared): (f64, f64, _) = (0.0, 0.0, 0);
    for line in SAMPLE.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |column: usize| cells[column].parse::<f64>().ok();
        let (Some(east), Some(north)) = (number(4), number(5)) else { continue };
        let name = match cells[0].parse::<i64>().unwrap() {
            bright if bright < 0 => SourceId::Hipparcos(u32::try_from(-bright).unwrap()),
            gaia => SourceId::Gaia(GaiaRelease::Dr3, gaia.unsigned_abs()),
        };
        let star = star_named(&catalog, name);
        let Some(motion) = star.proper_motion else { continue };
        // Radial velocities are not in the CSV.
        let motion = ProperMotion { radial_mas_yr: 0.0, ..motion };
        let wanted = propagated([2, 3].map(|column| number(column).unwrap()), [east, north], YEARS);
        let off_mas = |motion| at_epoch(star.direction_icrf, Some(motion), YEARS).distance(wanted) / MAS;
        worst_mas = worst_mas.max(off_mas(motion));
        let coarse = |mas_yr: f32| (mas_yr / 0.5).round() * 0.5;
        let [pm_ra_cosdec_mas_yr, pm_dec_mas_yr] = [motion.pm_ra_cosdec_mas_yr, motion.pm_dec_mas_yr].map(coarse);
        coarse_mas = coarse_mas.max(off_mas(ProperMotion { pm_ra_cosdec_mas_yr, pm_dec_mas_yr, ..motion }));
        compared += 1;
    }
    println!("{compared} stars, worst in 2050 {worst_mas:.3} mas; with motions in steps of 0.5 mas/yr {coarse_mas:.1}");
    assert!(compared > 1300, "control: {compared} stars");
    assert!(worst_mas < 0.25 && 0.25 < PROMISED_MAS, "places to 0.17 mas, motions to less: {worst_mas} mas");
    assert!(coarse_mas > 8.0, "control: steps of 0.5 mas/yr cost {coarse_mas} mas");
}

/// Returns the effect of neglecting a radial velocity after `years`, mas: v_r parallax pm t^2 / 4.74 (perspective
/// acceleration; Schlesinger 1917, AJ 30, 137).
fn neglect_mas(km_s: f64, parallax_mas: f64, speed_mas_yr: f64, years: f64) -> f64 {
    km_s.abs() * parallax_mas * speed_mas_yr * MAS * years * years / 4.740_47
}

/// Published by Hipparcos and Gaia: name, Gaia DR3 number, radial velocity (km/s), parallax (mas), proper motion
/// (mas/yr), and what an independent library (astropy's `apply_space_motion`) finds that neglect comes to from J2016 to
/// 2050, arcsec.
const PUBLISHED: [(&str, u64, f64, f64, f64, f64); 4] = [
    ("Barnard's star", 4_472_832_130_942_575_872, -110.5, 546.98, 10_393.3, 0.744),
    ("Kapteyn's star", 4_810_594_479_418_041_856, 245.0, 254.2, 8_644.0, 0.635),
    ("61 Cygni A", 1_872_046_609_345_556_480, -65.7, 286.0, 5_281.0, 0.118),
    ("Groombridge 1830", 4_034_171_629_042_489_088, -98.0, 109.0, 7_059.0, 0.089),
];

#[test]
fn neglect_of_radial_velocity_is_what_the_documents_say() {
    let catalog = Catalog::built_in().unwrap();
    let sentence = include_str!("../../src/sky/astrometry/apparent.rs").replace("\n//! ", " ");
    for (name, number, km_s, parallax_mas, speed_mas_yr, published_arcsec) in PUBLISHED {
        let formula_mas = neglect_mas(km_s, parallax_mas, speed_mas_yr, YEARS);
        assert!((formula_mas / (1000.0 * published_arcsec) - 1.0).abs() < 0.03, "{name}: {formula_mas} mas");
        let star = star_named(&catalog, SourceId::Gaia(GaiaRelease::Dr3, number));
        let motion = star.proper_motion.unwrap();
        let without = ProperMotion { radial_mas_yr: 0.0, ..motion };
        let at = |motion| at_epoch(star.direction_icrf, Some(motion), YEARS);
        let used_mas = at(motion).distance(at(without)) / MAS;
        println!("{name}: {used_mas:.1} mas in 2050");
        assert!((used_mas / (1000.0 * published_arcsec) - 1.0).abs() < 0.03, "{name}: {used_mas} mas");
        let said = format!("{}", 10.0 * (used_mas / 10.0).round());
        let said = if name.starts_with("61") { format!("{used_mas:.0}") } else { said };
        assert!(sentence.contains(&format!(" by {said}")) || sentence.contains(&format!(" {said} ")), "{name}: {said}");
    }
    let (_, _, km_s, parallax_mas, speed_mas_yr, _) = PUBLISHED[2];
    assert!((neglect_mas(km_s, parallax_mas, speed_mas_yr, 10.0) - 10.0).abs() < 0.5, "61 Cygni in 2026");
}

#[test]
fn stars_of_unknown_radial_velocity_are_as_few_as_the_documents_say() {
    let catalog = Catalog::built_in().unwrap();
    let unknown = catalog.sources().iter().filter_map(|star| {
        let is_known = star.source_id.is_some_and(|name| radial_velocity_km_s(name).is_some());
        let (motion, parallax_mas) = (star.proper_motion?, star.parallax_mas?);
        (!is_known).then(|| neglect_mas(30.0, parallax_mas.into(), motion.speed_mas_yr().into(), YEARS))
    });
    let unknown: Vec<f64> = unknown.collect();
    let above = |mas: f64| unknown.iter().filter(|neglect| **neglect > mas).count();
    println!("at 30 km/s {} stars above 1 mas in 2050, {} above 10", above(1.0), above(10.0));
    let sentence = include_str!("../../src/sky/astrometry/apparent.rs").replace("\n//! ", " ");
    let wanted = format!("{} come to more than 1 mas by 2050, and {} to 10", above(1.0), above(10.0));
    assert!(sentence.contains(&wanted), "{wanted}");
}

#[test]
fn a_star_that_comes_nearer_moves_as_one_in_space() {
    let (ra_deg, dec_deg, km_s, parallax_mas) = (30.0, -20.0, -300.0, 400.0);
    let motion_mas_yr = [3000.0, -4000.0];
    // In au and years: distance, velocity in space, and where it is later.
    let distance_au = 1.0 / (parallax_mas * MAS);
    let line = direction_from_ra_dec(ra_deg * DEG, dec_deg * DEG);
    let east = DVec3::new(-(ra_deg * DEG).sin(), (ra_deg * DEG).cos(), 0.0);
    let across = east * motion_mas_yr[0] + line.cross(east) * motion_mas_yr[1];
    let velocity_au_yr = across * MAS * distance_au + line * (km_s * 31_557_600.0 / 149_597_870.7);
    let wanted = (line * distance_au + velocity_au_yr * 50.0).normalize();
    let motion = |radial_mas_yr| ProperMotion { pm_ra_cosdec_mas_yr: 3000.0, pm_dec_mas_yr: -4000.0, radial_mas_yr };
    let off_mas = |motion| at_epoch(line, Some(motion), 50.0).distance(wanted) / MAS;
    #[allow(clippy::cast_possible_truncation, reason = "catalogs are single precision")]
    let radial_mas_yr = (km_s * parallax_mas / 4.740_470_463) as f32;
    assert!(off_mas(motion(radial_mas_yr)) < 0.01, "{}", off_mas(motion(radial_mas_yr)));
    assert!(off_mas(motion(0.0)) > 1000.0, "control: without it");
}
