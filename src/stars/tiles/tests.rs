//! Fields of tiles against the catalog that the layers were made of.

use super::*;
use crate::layer::{LayerSet, NewStar, Sorting};
use crate::{catalog::Catalog, numbering::stored_number};
use base::source::{CatalogSource, direction_from_ra_dec, ra_dec_rad};
use base::units::{DEG, MAS};
use glam::DVec3;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Returns the names and bytes of layers of the built-in catalog's stars, to magnitude 5 and 7, at an epoch.
fn built(epoch_yr: f64) -> Vec<(OsString, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let mut sorting = Sorting::start(&folder.path().join("work"), &[5.0, 7.0]).unwrap();
    for star in Catalog::built_in().unwrap().sources() {
        let [ra_rad, dec_rad] = ra_dec_rad(star.direction_icrf);
        let motion = star.proper_motion.map(|m| [m.pm_ra_cosdec_mas_yr, m.pm_dec_mas_yr].map(f64::from));
        let new = NewStar {
            source_id: stored_number(star.source_id),
            ra_rad,
            dec_rad,
            motion_mas_yr: motion,
            parallax_mas: star.parallax_mas.map(f64::from),
            mag_g: f64::from(star.mag_g),
            bp_rp: Some(f64::from(star.bp_rp)),
        };
        sorting.add(&new).unwrap();
    }
    let reports = sorting.finish(folder.path(), epoch_yr, "credits", &mut |_| {}).unwrap();
    let read = |path: &Path| (path.file_name().unwrap().to_owned(), std::fs::read(path).unwrap());
    reports.iter().map(|report| read(&report.path)).collect()
}

/// Writes the layers at epoch 2016.0 into a folder, and returns their paths. They are built once for all tests.
fn layers(folder: &Path) -> Vec<PathBuf> {
    static BUILT: OnceLock<Vec<(OsString, Vec<u8>)>> = OnceLock::new();
    written(folder, BUILT.get_or_init(|| built(2016.0)))
}

fn written(folder: &Path, layers: &[(OsString, Vec<u8>)]) -> Vec<PathBuf> {
    std::fs::create_dir_all(folder).unwrap();
    let write = |(name, bytes): &(OsString, Vec<u8>)| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    layers.iter().map(write).collect()
}

/// Returns electrons that encode magnitude and colour.
fn light() -> Light {
    Light::new(|mag_g, bp_rp| (f64::from(mag_g) * 1000.0 + f64::from(bp_rp), mag_g))
}

fn sky(paths: &[PathBuf], limiting_mag: f32, most_stars: u64) -> TileSky {
    TileSky::new(Arc::new(LayerSet::open(paths, limiting_mag).unwrap()), light(), most_stars)
}

/// Returns stars of the field within its radius, in order.
fn found(sky: &TileSky, axis: DVec3, radius_rad: f64) -> Vec<TileStar> {
    let within = |star: &&TileStar| star.direction_icrf.angle_between(axis) <= radius_rad;
    sky.blocks().flatten().filter(within).copied().collect()
}

fn towards(ra_deg: f64, dec_deg: f64) -> DVec3 {
    direction_from_ra_dec(ra_deg * DEG, dec_deg * DEG)
}

#[test]
fn fields_reach_as_deep_as_memory_allows() {
    let folder = tempfile::tempdir().unwrap();
    let set = LayerSet::open(&layers(folder.path()), 8.0).unwrap();
    let deepest = |most_stars| set.faintest_of_fields(10.0 * DEG, most_stars);
    let whole: u64 = set.layers().map(crate::StarIndex::stars).sum();
    assert_eq!((deepest(whole), deepest(1)), (7.0, 5.0), "all layers, and the brightest at least");
    // Somewhere between a field's own stars and those of the sky both layers begin to fit.
    let least = (1..whole).step_by(50).find(|most_stars| deepest(*most_stars) > 5.0).unwrap();
    assert!(least > 100 && least < whole / 10, "{least} of {whole}");
}

#[test]
fn a_field_has_the_stars_of_the_catalog() {
    let folder = tempfile::tempdir().unwrap();
    let mut sky = sky(&layers(folder.path()), 6.5, 1_000_000);
    let built_in = Catalog::built_in().unwrap();
    let (mut wanted, mut total): (Vec<CatalogSource>, usize) = (Vec::new(), 0);
    for (ra_deg, dec_deg, radius_deg) in
        [(84.0, -1.2, 10.0), (0.0, 90.0, 20.0), (266.0, -29.0, 60.0), (10.0, 0.0, 180.0)]
    {
        let (axis, radius_rad) = (towards(ra_deg, dec_deg), radius_deg * DEG);
        assert_eq!(sky.take_field(axis, radius_rad).unwrap(), Shortfall::default());
        let got = found(&sky, axis, radius_rad + MAS);
        built_in.cone(axis, radius_rad, 6.5, &mut wanted);
        assert_eq!(got.len(), wanted.len(), "{ra_deg} {dec_deg} {radius_deg}");
        for star in wanted.iter().step_by(7) {
            let wanted_e = f64::from(star.mag_g) * 1000.0 + f64::from(star.bp_rp);
            let is_it = |other: &&TileStar| {
                let off_rad = other.direction_icrf.distance(star.direction_icrf);
                off_rad < 0.4 * MAS && other.mag == star.mag_g && (other.electrons - wanted_e).abs() < 1e-3
            };
            let other = got.iter().find(is_it).unwrap_or_else(|| panic!("{star:?}"));
            assert!((other.parallax_mas - star.parallax_mas.unwrap_or(0.0)).abs() < 0.02);
            let motion = star.proper_motion.unwrap_or_default();
            let off = [
                other.motion.pm_ra_cosdec_mas_yr - motion.pm_ra_cosdec_mas_yr,
                other.motion.pm_dec_mas_yr - motion.pm_dec_mas_yr,
                other.motion.radial_mas_yr - motion.radial_mas_yr,
            ];
            assert!(off.iter().all(|off_mas_yr| off_mas_yr.abs() < 1.3), "{off:?} {motion:?}");
        }
        total += got.len();
    }
    assert!(total > 8000, "control: there was something to find: {total}");
    let ids: std::collections::BTreeSet<u32> = sky.blocks().flatten().map(|star| star.id).collect();
    assert_eq!(ids.len(), sky.blocks().map(<[TileStar]>::len).sum::<usize>(), "a number is one star's");
    assert!(sky.layers().fastest_mas_yr() > 5000.0, "61 Cygni or a faster one");
}

#[test]
fn a_field_depends_on_where_it_is_and_not_on_what_was_seen_before() {
    let folder = tempfile::tempdir().unwrap();
    let paths = layers(folder.path());
    // The whole sky to 6.5 has 8,000 stars: a memory of 3,000 is full after a few fields.
    let mut small = sky(&paths, 6.5, 3000);
    for step in 0..60 {
        let axis = towards(f64::from(step) * 37.0, 60.0 * (f64::from(step) * 0.7).sin());
        assert_eq!(small.take_field(axis, 15.0 * DEG).unwrap(), Shortfall::default());
        let mut fresh = sky(&paths, 6.5, 1_000_000);
        fresh.take_field(axis, 15.0 * DEG).unwrap();
        assert!(small.blocks().eq(fresh.blocks()), "step {step}");
        assert!(small.held_stars() <= 3000);
    }
    assert!(small.held_stars() > 1500, "control: what was seen is kept: {}", small.held_stars());
}

#[test]
fn a_crowded_field_goes_without_its_faintest_layer() {
    let folder = tempfile::tempdir().unwrap();
    let paths = layers(folder.path());
    let count = |path: &PathBuf| crate::layer::Layer::open(path).unwrap().index().stars();
    let [bright, faint] = [count(&paths[0]), count(&paths[1])];
    for (most, fits) in [(bright + faint, true), (bright + faint - 1, false), (bright, false)] {
        let mut sky = sky(&paths, 7.0, most);
        for _ in 0..2 {
            let shortfall = sky.take_field(DVec3::X, 4.0).unwrap();
            let left = if fits { 0 } else { faint };
            assert_eq!(shortfall, Shortfall { crowded_out_stars: left, ..Shortfall::default() }, "{most}");
            let stars: usize = sky.blocks().map(<[TileStar]>::len).sum();
            assert_eq!(stars as u64, bright + faint - left);
        }
    }
    let mut none = sky(&paths, 7.0, bright - 1);
    assert_eq!(none.take_field(DVec3::X, 4.0).unwrap().crowded_out_stars, bright + faint, "nothing fits");
    assert_eq!(none.take_field(DVec3::X, 0.1).unwrap(), Shortfall::default(), "a small field does");
}

/// Waits until the reader has answered; it has nothing else to do.
fn settle(sky: &mut TileSky, axis: DVec3, radius_rad: f64) -> u32 {
    for field in 0..10_000 {
        if sky.take_field(axis, radius_rad).unwrap() == Shortfall::default() {
            return field;
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    panic!("the reader does not answer");
}

#[test]
fn late_tiles_are_missing_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let paths = layers(folder.path());
    let (axis, radius_rad) = (towards(84.0, -1.2), 12.0 * DEG);
    let mut in_line = sky(&paths, 6.5, 100_000);
    in_line.take_field(axis, radius_rad).unwrap();
    let mut ahead = sky(&paths, 6.5, 100_000);
    ahead.read_ahead().unwrap();
    let shortfall = ahead.take_field(axis, radius_rad).unwrap();
    let wanted = in_line.tiles_of_the_field();
    assert_eq!((shortfall.late_tiles, shortfall.crowded_out_stars), (wanted.len() as u64, 0), "nothing is there yet");
    let stars: u64 = wanted.iter().map(|tile| ahead.layers().stars_of(*tile)).sum();
    assert_eq!(shortfall.late_stars, stars);
    assert!(ahead.blocks().next().is_none());
    settle(&mut ahead, axis, radius_rad);
    assert!(ahead.blocks().eq(in_line.blocks()), "the same stars in the same order");
}

#[test]
fn a_crowded_field_goes_without_its_faintest_layer_also_when_a_thread_reads() {
    let folder = tempfile::tempdir().unwrap();
    let paths = layers(folder.path());
    let count = |path: &PathBuf| crate::layer::Layer::open(path).unwrap().index().stars();
    let [bright, faint] = [count(&paths[0]), count(&paths[1])];
    let mut crowded = sky(&paths, 7.0, bright + faint / 2);
    crowded.read_ahead().unwrap();
    let wanted = Shortfall { crowded_out_stars: faint, ..Shortfall::default() };
    let settled = (0..10_000).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(1));
        crowded.take_field(DVec3::X, 4.0).unwrap() == wanted
    });
    assert!(settled, "once it is known how many stars there are");
    let mut answered = || {
        while crowded.settle().unwrap() > 0 {
            std::thread::yield_now();
        }
        let shortfall = crowded.take_field(DVec3::X, 4.0).unwrap();
        crowded.look_ahead(DVec3::X, 4.0);
        (shortfall, crowded.blocks().map(<[TileStar]>::len).sum::<usize>() as u64)
    };
    for _ in 0..50 {
        assert_eq!(answered(), (wanted, bright), "and from then on: no holes");
    }
}

#[test]
fn a_tile_that_was_asked_for_ahead_and_then_lacking_comes_once() {
    let folder = tempfile::tempdir().unwrap();
    let paths = layers(folder.path());
    let mut sky = sky(&paths, 6.5, 100_000);
    sky.read_ahead().unwrap();
    let (there, radius_rad) = (towards(100.0, 0.0), 5.0 * DEG);
    sky.look_ahead(there, radius_rad);
    settle(&mut sky, there, radius_rad);
    while sky.settle().unwrap() > 0 {
        std::thread::yield_now();
    }
    sky.take_field(there, radius_rad).unwrap();
    let in_field: u64 = sky.blocks().map(|block| block.len() as u64).sum();
    assert_eq!(sky.held_stars(), in_field, "each tile is there once");
}

#[test]
fn an_announced_field_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let paths = layers(folder.path());
    let mut sky = sky(&paths, 6.5, 100_000);
    sky.read_ahead().unwrap();
    let (here, there, radius_rad) = (towards(84.0, 0.0), towards(100.0, 0.0), 5.0 * DEG);
    settle(&mut sky, here, radius_rad);
    assert!(sky.would_be_late(there, radius_rad).late_tiles > 0, "control: it is not there by itself");
    sky.look_ahead(there, radius_rad);
    // The reader answers while the camera looks here.
    for _ in 0..10_000 {
        sky.take_field(here, radius_rad).unwrap();
        if sky.would_be_late(there, radius_rad).late_tiles == 0 {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert_eq!(sky.take_field(there, radius_rad).unwrap(), Shortfall::default());
}

#[test]
fn a_damaged_tile_is_reported_by_either_way_of_reading() {
    let folder = tempfile::tempdir().unwrap();
    let paths = layers(folder.path());
    let mut bytes = std::fs::read(&paths[0]).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&paths[0], bytes).unwrap();
    let mut in_line = sky(&paths, 6.5, 100_000);
    let reported = in_line.take_field(DVec3::X, 4.0).unwrap_err().to_string();
    assert!(reported.contains("g5.starlayer") && reported.contains("tile"), "{reported}");
    let mut ahead = sky(&paths, 6.5, 100_000);
    ahead.read_ahead().unwrap();
    let reported = (0..10_000).find_map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(1));
        ahead.take_field(DVec3::X, 4.0).err()
    });
    assert!(reported.unwrap().to_string().contains("g5.starlayer"));
}

#[test]
fn reader_that_breaks_down_is_known_and_its_tiles_stay_missing() {
    let folder = tempfile::tempdir().unwrap();
    let layers = Arc::new(LayerSet::open(&layers(folder.path()), 6.5).unwrap());
    let broken = Light::new(|_, _| panic!("as the test wants it"));
    for (light, is_lost) in [(light(), false), (broken, true)] {
        let mut sky = TileSky::new(Arc::clone(&layers), light, 100_000);
        assert!(!sky.has_lost_reader(), "nothing reads yet");
        sky.read_ahead().unwrap();
        sky.take_field(DVec3::X, 0.5).unwrap();
        let in_time = (0..10_000).any(|_| {
            std::thread::sleep(std::time::Duration::from_millis(1));
            sky.has_lost_reader() || sky.settle().unwrap() == 0
        });
        assert!(in_time && sky.has_lost_reader() == is_lost, "wanted lost: {is_lost}");
        assert_eq!(sky.take_field(DVec3::X, 0.5).unwrap().late_tiles > 0, is_lost);
    }
}

#[test]
fn a_sky_reports_where_its_stars_begin_and_end() {
    let folder = tempfile::tempdir().unwrap();
    let paths = layers(folder.path());
    let limits = |paths: &[PathBuf]| LayerSet::open(paths, 10.0).map(|set| set.magnitudes()).unwrap();
    assert_eq!(limits(&paths), [f32::NEG_INFINITY, 7.0]);
    assert_eq!(limits(&paths[1..]), [5.0, 7.0], "the bright layer was left out");
}

#[test]
fn layers_that_are_no_one_sky_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let paths = layers(&folder.path().join("a"));
    let refused = |paths: &[PathBuf], limit| LayerSet::open(paths, limit).unwrap_err().to_string();
    let others = written(&folder.path().join("b"), &built(2000.0));
    let reported = refused(&[paths[0].clone(), others[1].clone()], 9.0);
    assert!(
        reported.contains("g7.starlayer") && reported.contains("wanted J2016") && reported.contains("J2000"),
        "{reported}"
    );
    assert!(refused(&[folder.path().join("no.starlayer")], 1.0).contains("no.starlayer"));
    let reported = refused(&[paths[0].clone(), paths[0].clone()], 9.0);
    assert!(reported.contains("begins at G = -inf") && reported.contains("ends at 5"), "twice: {reported}");
    let reported = refused(&paths[1..], 4.0);
    assert!(reported.contains("begins at G = 5") && reported.contains("stars to 4"), "{reported}");
    assert!(refused(&[], 4.0).contains("no layer"));
    let set = LayerSet::open(&[paths[1].clone(), paths[0].clone()], 6.0).unwrap();
    assert_eq!((set.layers().len(), set.epoch_yr()), (2, 2016.0), "in any order");
    assert_eq!(LayerSet::open(&paths, 4.0).unwrap().layers().len(), 1, "what is not needed is left closed");
}
