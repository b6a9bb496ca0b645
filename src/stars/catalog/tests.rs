//! Round trip, refusal of bad files, cone against brute force, and the built-in catalog's facts.

use super::layout::{DEC_STEP_RAD, FASTEST_MAS_YR, PARALLAX_STEP_MAS};
use super::*;
use crate::numbering::Origins;
use base::source::{CatalogSource, ProperMotion, direction_from_ra_dec};
use base::source_id::{GaiaRelease, SourceId};
use base::units::{ARCSEC, DEG, MAS};
use glam::DVec3;

const HEADER: &str = "source_id,hip,ra_deg,dec_deg,pmra_masyr,pmdec_masyr,parallax_mas,g_mag,bp_rp,origin\n";

/// Faintest star of the built-in catalog and more.
const ALL: f32 = 99.0;

/// Half a step of right ascension and of declination together, mas (module doc of `catalog`).
const POSITION_MAS: f64 = 0.17;

fn packed(rows: &str) -> Vec<u8> {
    pack(format!("{HEADER}{rows}").as_bytes(), 2016.0, Some("credits")).expect("a valid CSV").0
}

fn small() -> Vec<u8> {
    packed(
        "1,,10.5,20.25,0.00,0.00,,8.1,7.2,gaia_nopm\n\
         2,,10.6,20.30,0.00,1.00,3.20,7.0,0.5,gaia+hip_lb\n\
         3,,359.99999999,-89.9,,,-5.00,-1.45,-0.8,hip_only\n",
    )
}

#[test]
fn packing_keeps_every_field() {
    let catalog = Catalog::from_bytes(&small()).expect("a valid file");
    let find = |mag: f32| *catalog.sources().iter().find(|s| s.mag_g == mag).expect("a star of that magnitude");
    let star = find(7.0);
    let wanted = direction_from_ra_dec(10.6 * DEG, 20.3 * DEG);
    assert!(
        star.direction_icrf.distance(wanted) < POSITION_MAS * MAS,
        "{}",
        star.direction_icrf.distance(wanted) / MAS
    );
    let motion = star.proper_motion.expect("known, though zero in right ascension");
    assert_eq!([motion.pm_ra_cosdec_mas_yr, motion.pm_dec_mas_yr], [0.0, 1.0]);
    assert!((f64::from(star.parallax_mas.expect("known")) - 3.2).abs() <= PARALLAX_STEP_MAS / 2.0);
    assert_eq!(star.bp_rp, 0.5);
    assert_eq!(
        (catalog.index().epoch_yr, catalog.index().credits.as_str(), catalog.index().fastest_mas_yr),
        (2016.0, "credits", 1.0)
    );
}

#[test]
fn blank_is_not_zero_and_traps_are_counted() {
    let csv = format!("{HEADER}1,,10,20,0.00,0.00,,8.1,7.2,gaia_nopm\n2,,10,20,0.00,0.00,-5.0,8.0,1.0,gaia+hip_lb\n");
    let (bytes, report) = pack(csv.as_bytes(), 2016.0, None).expect("a valid CSV");
    let catalog = Catalog::from_bytes(&bytes).expect("a valid file");
    let [bright, faint] = catalog.sources() else { panic!("two stars") };
    assert_eq!((faint.proper_motion, faint.parallax_mas, faint.bp_rp), (None, None, 5.0));
    assert_eq!(
        bright.proper_motion,
        Some(ProperMotion { pm_ra_cosdec_mas_yr: 0.0, pm_dec_mas_yr: 0.0, radial_mas_yr: 0.0 })
    );
    assert_eq!(bright.parallax_mas, Some(0.0));
    let wanted = PackReport {
        stars: 2,
        without_proper_motion: 1,
        without_parallax: 1,
        negative_parallaxes: 1,
        clamped_colours: 1,
        origins: Origins { numbered: 2, named_hipparcos: 1, ..Origins::default() },
    };
    assert_eq!(report, wanted);
}

#[test]
fn row_order_of_the_csv_does_not_matter() {
    let [a, b] = ["1,,10,20,1,1,,8.1,1,\n", "2,,10,20,1,1,,8.1,1,\n"];
    assert_eq!(packed(&format!("{a}{b}")), packed(&format!("{b}{a}")), "deterministic bytes");
    assert_ne!(packed(a), packed(b.replace("8.1", "8.2").as_str()), "control: a change shows");
}

#[test]
fn bad_csv_is_refused_with_line_and_column() {
    let refuse = |text: &str| pack(text.as_bytes(), 2016.0, None).expect_err("bad CSV").to_string();
    let cell = refuse(&format!("{HEADER}1,,10,20,1,1,,8.1,1,\n1,,10,95,1,1,,8.1,1,\n"));
    assert!(cell.contains("line 3") && cell.contains("dec_deg") && cell.contains("95"), "{cell}");
    let blank = refuse(&format!("{HEADER}1,,10,20,1,1,,,1,\n"));
    assert!(blank.contains("g_mag") && blank.contains("\"\""), "{blank}");
    let fast = refuse(&format!("{HEADER}1,,10,20,1,21000,,8,1,\n"));
    assert!(fast.contains("pmdec_masyr") && fast.contains(&FASTEST_MAS_YR.to_string()), "{fast}");
    let missing = refuse("ra_deg,pmra_masyr,pmdec_masyr,g_mag\n");
    assert!(missing.contains("no column dec_deg, parallax_mas, bp_rp, source_id; got ra_deg,"), "{missing}");
}

#[test]
fn a_file_too_long_for_memory_is_refused_unread() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("long.starcat");
    let file = std::fs::File::create(&path).expect("a new file");
    file.set_len(layout::MOST_BYTES + 1).expect("a sparse file");
    let reported = Catalog::open(&path).expect_err("too long").to_string();
    assert!(reported.contains("bytes, wanted at most") && reported.contains("catalog import"), "{reported}");
    let long = "9".repeat(100_000);
    let cell = pack(format!("{HEADER}1,,10,{long},1,1,,8.1,1,\n").as_bytes(), 2016.0, None).expect_err("a bad cell");
    assert!(cell.to_string().len() < 600, "a long cell is not shown whole");
}

#[test]
fn bad_files_are_refused_never_misread() {
    let good = small();
    let refuse = |bytes: &[u8]| Catalog::from_bytes(bytes).expect_err("a bad file").to_string();
    assert!(refuse(b"source_id,hip").starts_with("not a packed star catalog"), "a CSV");
    assert!(refuse(b"").starts_with("not a packed star catalog"), "empty");
    for cut in [9, 39, 40, 5000, good.len() - 1] {
        assert!(refuse(&good[..cut]).starts_with("packed catalog is cut short"), "cut at {cut}");
    }
    assert!(refuse(&[&good[..], b"x"].concat()).contains("something follows its end"), "too long");
    for flipped in [25, 33, 41, 12_340, good.len() - 1] {
        let mut bytes = good.clone();
        bytes[flipped] ^= 1;
        assert!(refuse(&bytes).contains("is damaged: CRC-32"), "byte {flipped}: {}", refuse(&bytes));
    }
    for version in [1, 3] {
        let mut other = good.clone();
        other[8] = version;
        let reported = refuse(&other);
        assert!(
            reported.contains("format version wanted 2 (pack its CSV again")
                && reported.ends_with(&format!("got {version}")),
            "{reported}"
        );
    }
}

#[test]
fn unsorted_tiles_are_refused_even_with_a_good_checksum() {
    let mut bytes = packed("1,,10,20,1,1,,8.1,1,\n2,,10,20,1,1,,8.2,1,\n");
    let first_record = layout::HEADER_BYTES + (layout::TILES + 1) * 4;
    let (a, b) = bytes[first_record..].split_at_mut(layout::RECORD_BYTES);
    a.swap_with_slice(&mut b[..layout::RECORD_BYTES]);
    let crc = layout::file_crc32(&bytes);
    bytes[layout::CRC_AT..layout::CRC_AT + 4].copy_from_slice(&crc.to_le_bytes());
    let error = Catalog::from_bytes(&bytes).expect_err("unsorted");
    assert!(error.to_string().starts_with("packed catalog, tile "), "{error}");
}

#[test]
fn the_built_in_catalog_opens() {
    let catalog = Catalog::built_in().expect("the bytes this program was built with");
    assert_eq!((catalog.sources().len(), catalog.index().epoch_yr), (106_462, 2016.0));
    let without_motion = catalog.sources().iter().filter(|s| s.proper_motion.is_none()).count();
    assert_eq!(without_motion, 278, "258 + 16 + 4 unknown proper motions in the CSV");
    let credited = ["Gaia", "Hipparcos", "Tycho-2"].iter().all(|name| catalog.index().credits.contains(name));
    assert!(credited, "{}", catalog.index().credits);
    assert!(
        (catalog.index().fastest_mas_yr / 1000.0 - 10.4).abs() < 0.1,
        "Barnard's star: {}",
        catalog.index().fastest_mas_yr
    );
}

#[test]
fn sirius_is_where_and_as_bright_as_it_should_be() {
    // ICRS J2000 06 45 08.917 -16 42 58.02 (van Leeuwen 2007); 1.34 arcsec/yr for 16 years.
    let catalog = Catalog::built_in().expect("the built-in catalog");
    let axis = direction_from_ra_dec(101.287_155 * DEG, -16.716_116 * DEG);
    let mut found = Vec::new();
    catalog.cone(axis, 30.0 * ARCSEC, 1.0, &mut found);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!((found[0].direction_icrf.angle_between(axis) / ARCSEC - 21.4).abs() < 0.3, "{found:?}");
    assert_eq!((found[0].mag_g, found[0].parallax_mas), (-1.45, Some(379.2)));
}

fn brute_force(catalog: &Catalog, axis: DVec3, radius_rad: f64, mag: f32) -> Vec<u32> {
    let unit = axis.normalize();
    let inside =
        |s: &&CatalogSource| s.mag_g <= mag && s.direction_icrf.dot(unit).clamp(-1.0, 1.0).acos() <= radius_rad;
    catalog.sources().iter().filter(inside).map(|s| s.id).collect()
}

#[test]
fn cone_agrees_with_brute_force() {
    let catalog = Catalog::built_in().expect("the built-in catalog");
    let mut found = Vec::new();
    let mut total = 0;
    for step in 0..60_u8 {
        // A golden-angle spiral over the sphere, poles included.
        let z = 1.0 - f64::from(step) / 29.5;
        let axis = direction_from_ra_dec(f64::from(step) * 2.4, z.clamp(-1.0, 1.0).asin()) * 3.0;
        for (radius_deg, mag) in [(0.3, ALL), (4.0, 7.0), (12.0, ALL), (60.0, 5.0), (179.0, 3.0), (200.0, 2.0)] {
            catalog.cone(axis, radius_deg * DEG, mag, &mut found);
            let ids: Vec<u32> = found.iter().map(|s| s.id).collect();
            let wanted = brute_force(&catalog, axis, radius_deg * DEG, mag);
            assert_eq!(ids, wanted, "axis {axis}, {radius_deg} deg, G < {mag}");
            total += ids.len();
        }
    }
    assert!(total > 50_000, "control: the cones must not be empty, got {total}");
}

#[test]
fn a_cone_of_nonsense_is_empty_and_reuses_its_buffer() {
    let catalog = Catalog::built_in().expect("the built-in catalog");
    let mut found = Vec::new();
    catalog.cone(DVec3::X, 10.0 * DEG, ALL, &mut found);
    let (count, place) = (found.len(), found.as_ptr());
    catalog.cone(DVec3::X, 9.0 * DEG, ALL, &mut found);
    assert!(found.len() < count && found.as_ptr() == place, "no new allocation");
    for (axis, radius_rad) in [(DVec3::ZERO, 1.0), (DVec3::NAN, 1.0), (DVec3::X, f64::NAN), (DVec3::X, -1.0)] {
        catalog.cone(axis, radius_rad, ALL, &mut found);
        assert!(found.is_empty(), "{axis} {radius_rad}");
    }
    catalog.cone(DVec3::X, 1.0, f32::NAN, &mut found);
    assert!(found.is_empty(), "a limit that is not a number");
}

#[test]
fn declination_reaches_both_poles() {
    let catalog = Catalog::from_bytes(&packed("1,,0,90,1,1,,8.1,1,\n2,,360,-90,1,1,,8.2,1,\n")).expect("a valid file");
    let z: Vec<f64> = catalog.sources().iter().map(|s| s.direction_icrf.z).collect();
    assert!(z.iter().all(|z| (z.abs() - 1.0).abs() < DEC_STEP_RAD), "{z:?}");
}

#[test]
fn built_in_stars_have_the_names_of_their_sources() {
    let catalog = Catalog::built_in().expect("the built-in catalog");
    let counted = |is: fn(&SourceId) -> bool| {
        catalog.sources().iter().filter(|star| star.source_id.is_some_and(|name| is(&name))).count()
    };
    let gaia = counted(|name| matches!(name, SourceId::Gaia(GaiaRelease::Dr3, _)));
    let hipparcos = counted(|name| matches!(name, SourceId::Hipparcos(_)));
    let tycho = counted(|name| matches!(name, SourceId::Tycho(..)));
    assert_eq!([gaia, hipparcos, tycho], [106_363, 93, 6], "as the CSV's origins count them");
    let sirius = catalog.sources().iter().min_by(|a, b| a.mag_g.total_cmp(&b.mag_g)).expect("stars");
    assert_eq!(sirius.source_id.map(|name| name.to_string()).as_deref(), Some("HIP 32349"));
}

#[test]
fn own_stars_keep_their_numbers_and_credit_no_one() {
    let own = format!("{HEADER}7,,10,20,1,1,,8.1,1,\n-9,,10,21,1,1,,8.2,1,\n");
    let catalog =
        Catalog::from_bytes(&pack(own.as_bytes(), 2016.0, None).expect("a valid CSV").0).expect("a valid file");
    assert_eq!(catalog.index().credits, "");
    let names: Vec<Option<SourceId>> = catalog.sources().iter().map(|star| star.source_id).collect();
    assert_eq!(names, [Some(SourceId::Own(7)), Some(SourceId::Own(-9))]);
    let barnard = format!("{HEADER}4472832130942575872,,269.448503,4.73942,1,1,,8.1,1,gaia+tyc_lb\n");
    let gaia = pack(barnard.as_bytes(), 2016.0, None).expect("a valid CSV");
    let credits = Catalog::from_bytes(&gaia.0).expect("a valid file").index().credits.clone();
    assert!(credits.contains("Gaia") && credits.contains("Tycho-2"), "control: {credits}");
}
