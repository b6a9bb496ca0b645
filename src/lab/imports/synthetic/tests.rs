//! Numbers of made-up stars against the table that they follow; seeds; the files.

use super::{density::Density, *};
use base::{source::CatalogSource, units::DEG};
use core::f64::consts::PI;
use glam::DVec3;
use stars::galactic::galactic_rad;
use stars::layer::{Layer, LayerReport};
use std::path::Path;

fn written(folder: &Path, limits: &[f32], stars: Option<f64>, seed: u64) -> Vec<LayerReport> {
    Population::new(limits, stars, seed).unwrap().write(folder, &mut |_| {}).unwrap()
}

fn read(report: &LayerReport) -> Vec<CatalogSource> {
    let layer = Layer::open(&report.path).unwrap();
    layer.verify(&mut |_| {}).unwrap();
    let mut found = Vec::new();
    layer.cone(DVec3::Z, PI, 99.0, &mut found).unwrap();
    found
}

/// Returns the five standard deviations of a Poisson number, and what cells across a border are worth.
fn is_near(got: usize, expected: f64, share: f64) -> bool {
    (got as f64 - expected).abs() < 5.0 * expected.sqrt() + share * expected
}

/// Tiles have one density each: at the borders of regions some are half on either side.
const BORDER_SHARE: f64 = 0.02;

#[test]
fn regions_have_the_stars_that_were_measured() {
    let folder = tempfile::tempdir().unwrap();
    let stars: Vec<_> = written(folder.path(), &[8.0, 10.0, 11.0], None, 1).iter().flat_map(read).collect();
    let strip = |low: f64, high: f64| 2.0 * PI / (DEG * DEG) * ((high * DEG).sin() - (low * DEG).sin());
    for (latitudes, longitudes, share, density) in [
        ([60.0, 90.0], [0.0, 180.0], 1.0, 5.2),
        ([40.0, 60.0], [0.0, 180.0], 1.0, 6.5),
        ([20.0, 40.0], [0.0, 180.0], 1.0, 10.0),
        ([0.0, 5.0], [90.0, 180.0], 0.5, 22.0),
        ([0.0, 5.0], [30.0, 90.0], 1.0 / 3.0, 28.0),
        ([0.0, 5.0], [0.0, 30.0], 1.0 / 6.0, 23.0),
        ([0.0, 90.0], [0.0, 180.0], 1.0, 11.7),
    ] {
        let is_in = |star: &&CatalogSource| {
            let [l, b] = galactic_rad(star.direction_icrf).map(|rad| (rad / DEG).abs());
            let inside = |range: [f64; 2], at: f64| (range[0]..range[1]).contains(&at);
            star.mag_g < 10.0 && inside(latitudes, b) && inside(longitudes, l)
        };
        let counted = stars.iter().filter(is_in).count();
        let expected = density * 2.0 * strip(latitudes[0], latitudes[1]) * share;
        assert!(is_near(counted, expected, BORDER_SHARE), "{latitudes:?} {longitudes:?}: {counted}, {expected}");
        assert!(!is_near(counted, 1.1 * expected, BORDER_SHARE), "control: a tenth more is seen");
    }
    // Within one tile and between the measured magnitudes the number is the curve's, magnitude by magnitude.
    let pole = Density::towards(DVec3::Z);
    let near_pole: Vec<_> = stars.iter().filter(|s| s.direction_icrf.z > (5.0 * DEG).cos()).collect();
    for mag in [10.3_f32, 10.6, 11.0] {
        let expected = pole.brighter_than(f64::from(mag)) * 2.0 * PI * (1.0 - (5.0 * DEG).cos()) / (DEG * DEG);
        let counted = near_pole.iter().filter(|s| s.mag_g < mag).count();
        assert!(is_near(counted, expected, 0.05), "{mag}: {counted}, {expected}");
    }
}

#[test]
fn numbers_of_tiles_spread_as_poisson_numbers_do() {
    let folder = tempfile::tempdir().unwrap();
    let reports = written(folder.path(), &[11.0], Some(4e5), 2);
    let layer = Layer::open(&reports[0].path).unwrap();
    assert!(is_near(usize::try_from(layer.index().stars()).unwrap(), 4e5, 0.0), "{}", layer.index().stars());
    let scale = 4e5 / Population::new(&[11.0], None, 2).unwrap().expected();
    let area_deg2 = 4.0 * PI / (DEG * DEG) / 49_152.0;
    // Squared deviations over the expected numbers: one each on average.
    let mut sum = 0.0;
    for (tile, stars) in (0..).zip(layer.index().stars_of_tiles()) {
        let (ra, dec) = stars::healpix::centre(6, tile);
        let density = Density::towards(base::source::direction_from_ra_dec(ra, dec));
        let expected = density.brighter_than(11.0) * area_deg2 * scale;
        sum += (stars as f64 - expected).powi(2) / expected;
    }
    let mean = sum / 49_152.0;
    // The mean of n such squares has a standard deviation of sqrt(2 / n): 0.0064.
    assert!((mean - 1.0).abs() < 0.03, "{mean}");
}

#[test]
fn places_are_even_over_a_tile() {
    let folder = tempfile::tempdir().unwrap();
    let stars = read(&written(folder.path(), &[9.0], Some(3e5), 3)[0]);
    let mut quarters = [0_usize; 4];
    for star in &stars {
        let [ra, dec] = base::source::ra_dec_rad(star.direction_icrf);
        quarters[usize::try_from(stars::healpix::cell(7, ra, dec) % 4).unwrap()] += 1;
    }
    assert!(quarters.iter().all(|count| is_near(*count, stars.len() as f64 / 4.0, 0.0)), "{quarters:?}");
}

#[test]
fn a_seed_gives_its_own_bytes_and_says_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = |name: &str, seed: u64| {
        let reports = written(&folder.path().join(name), &[7.0, 9.0], None, seed);
        reports.iter().map(|report| std::fs::read(&report.path).unwrap()).collect::<Vec<_>>()
    };
    let first = bytes("a", 7);
    assert!(first == bytes("b", 7), "the same seed, the same bytes");
    assert!(first != bytes("c", 8), "another seed, other stars");
    let layer = Layer::open(&folder.path().join("a/g9.starlayer")).unwrap();
    assert!(
        layer.index().credits.starts_with("synthetic population, seed 7: not real stars"),
        "{}",
        layer.index().credits
    );
    assert_eq!((layer.index().magnitudes, layer.index().epoch_yr), ([7.0, 9.0], 2016.0));
}

#[test]
fn stars_are_plausible() {
    let folder = tempfile::tempdir().unwrap();
    let stars = read(&written(folder.path(), &[9.0], None, 4)[0]);
    let mean =
        |of: &dyn Fn(&CatalogSource) -> f32| stars.iter().map(|s| f64::from(of(s))).sum::<f64>() / stars.len() as f64;
    let colour = mean(&|star| star.bp_rp);
    assert!((0.5..1.0).contains(&colour), "{colour}");
    let parallax = mean(&|star| star.parallax_mas.unwrap());
    assert!((2.0..20.0).contains(&parallax), "{parallax}");
    let motion = mean(&|star| star.proper_motion.unwrap().pm_dec_mas_yr);
    assert!(motion.abs() < 3.0, "no common motion: {motion}");
    assert!(stars.iter().all(|star| star.mag_g >= 0.0));
}

#[test]
fn numbers_that_make_no_layers_are_refused() {
    for limits in [&[][..], &[12.0, 10.0], &[10.0, 10.0], &[22.1], &[-0.1], &[f32::NAN]] {
        let reported = Population::new(limits, None, 1).unwrap_err();
        assert!(reported.contains("wanted rising magnitudes in 0..22"), "{reported}");
    }
    assert!(Population::new(&[10.0, 22.0], None, 1).is_ok(), "control");
}

/// Returns whether a layer of these bytes is refused, at its head or when its stars are read.
fn is_refused(path: &Path, bytes: &[u8]) -> bool {
    std::fs::write(path, bytes).unwrap();
    let read = |layer: Layer| layer.cone(DVec3::Z, 0.1, 99.0, &mut Vec::new());
    Layer::open(path).and_then(read).is_err()
}

#[test]
fn no_flipped_bit_and_no_cut_of_a_layer_goes_unseen() {
    let folder = tempfile::tempdir().unwrap();
    // All of its stars about the pole, so that reading a few tiles reads them all.
    let mut sorting = stars::layer::Sorting::start(&folder.path().join("work"), &[10.0]).unwrap();
    for source_id in 0..12_i32 {
        let (ra_rad, dec_rad) = (f64::from(source_id) * 0.5, PI / 2.0 - 0.001 * f64::from(source_id));
        let star = stars::layer::NewStar {
            source_id: source_id.into(),
            ra_rad,
            dec_rad,
            motion_mas_yr: None,
            parallax_mas: None,
            mag_g: 9.0,
            bp_rp: None,
        };
        sorting.add(&star).unwrap();
    }
    let report = sorting.finish(&folder.path().join("layers"), 2016.0, "credits", &mut |_| {}).unwrap().remove(0);
    let (whole, path) = (std::fs::read(&report.path).unwrap(), folder.path().join("damaged"));
    assert!(!is_refused(&path, &whole), "control");
    let end = whole.len();
    let records = end - 12 * 16 - "credits".len();
    // The head bit by bit, its tables here and there, credits and stars bit by bit.
    for at in (0..64).chain((64..records).step_by(8191)).chain(records..end) {
        for bit in 0..8 {
            let mut flipped = whole.clone();
            flipped[at] ^= 1 << bit;
            assert!(is_refused(&path, &flipped), "byte {at} of {end}, bit {bit}");
        }
    }
    for length in (0..64).chain((64..records).step_by(8191)).chain(records..end) {
        assert!(is_refused(&path, &whole[..length]), "cut to {length} of {end}");
    }
}
