//! Layers against brute force over the same stars; imports that are cut short; files that are damaged.

use super::*;
use crate::healpix::chord_squared;
use base::units::{DEG, MAS};
use base::{source::direction_from_ra_dec, source_id::SourceId};
use core::f64::consts::{PI, TAU};
use glam::DVec3;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::path::{Path, PathBuf};

const LIMITS: [f32; 3] = [10.0, 14.0, 18.0];

/// Returns stars all over the sky, more of them in a cluster at a pole.
fn stars(count: usize, seed: u64) -> Vec<NewStar> {
    let mut rng = StdRng::seed_from_u64(seed);
    let star = |i: usize| {
        let (u, v): (f64, f64) = (rng.random(), rng.random());
        let dec_rad = if i.is_multiple_of(4) { (1.0 - 1e-4 * v).asin() } else { (2.0 * v - 1.0).asin() };
        NewStar {
            source_id: i as i64 * 7 + 3,
            ra_rad: TAU * u,
            dec_rad,
            motion_mas_yr: (!i.is_multiple_of(3))
                .then(|| [rng.random_range(-50.0..50.0), rng.random_range(-3000.0..3000.0)]),
            parallax_mas: (!i.is_multiple_of(5)).then(|| rng.random_range(0.0..100.0)),
            mag_g: rng.random_range(2.0..18.0),
            bp_rp: (!i.is_multiple_of(7)).then(|| rng.random_range(-0.4..4.9)),
        }
    };
    (0..count).map(star).collect()
}

fn build(folder: &Path, stars: &[NewStar]) -> Vec<LayerReport> {
    let mut sorting = Sorting::start(&folder.join("work"), &LIMITS).unwrap();
    stars.iter().for_each(|star| sorting.add(star).unwrap());
    sorting.finish(&folder.join("layers"), 2016.0, "whom it concerns", &mut |_| {}).unwrap()
}

fn direction(star: &NewStar) -> DVec3 {
    direction_from_ra_dec(star.ra_rad, star.dec_rad)
}

#[test]
fn every_star_comes_back_within_half_steps() {
    let folder = tempfile::tempdir().unwrap();
    let stars = stars(20_000, 1);
    let reports = build(folder.path(), &stars);
    assert_eq!(reports.iter().map(|report| report.stars).sum::<u64>(), 20_000, "none lost, none doubled");
    assert!(!folder.path().join("work").exists(), "nothing is left behind");
    let (mut seen, mut found) = (0, Vec::new());
    for (report, limits) in reports.iter().zip([[f32::NEG_INFINITY, 10.0], [10.0, 14.0], [14.0, 18.0]]) {
        let layer = Layer::open(&report.path).unwrap();
        layer.verify(&mut |_| {}).unwrap();
        assert_eq!(
            (layer.index().stars(), layer.index().magnitudes, layer.index().epoch_yr),
            (report.stars, limits, 2016.0)
        );
        assert_eq!((layer.index().credits.as_str(), report.doubled), ("whom it concerns", 0));
        layer.cone(DVec3::Z, PI, 99.0, &mut found).unwrap();
        assert_eq!(found.len() as u64, layer.index().stars());
        seen += found.len();
        for star in stars.iter().filter(|s| (s.mag_g as f32) < limits[1] && (s.mag_g as f32) >= limits[0]).step_by(17) {
            let near =
                |other: &&base::source::CatalogSource| (other.direction_icrf - direction(star)).length() < 0.4 * MAS;
            let back = found.iter().find(near).expect("at its place");
            assert!((f64::from(back.mag_g) - star.mag_g).abs() < 0.000_501);
            match (back.proper_motion, star.motion_mas_yr) {
                (None, None) => {}
                (Some(got), Some([east, north])) => {
                    assert!((f64::from(got.pm_ra_cosdec_mas_yr) - east).abs() < 0.0251);
                    let half_step = if north.abs() < 1400.0 { 0.0251 } else { 1.251 };
                    assert!((f64::from(got.pm_dec_mas_yr) - north).abs() < half_step, "{north} {got:?}");
                }
                other => panic!("{other:?}"),
            }
            match (back.parallax_mas, star.parallax_mas) {
                (None, None) => {}
                (Some(got), Some(wanted)) => assert!((f64::from(got) - wanted).abs() < 0.010_01, "{got} {wanted}"),
                other => panic!("{other:?}"),
            }
            let colour = star.bp_rp.unwrap_or(f64::from(UNKNOWN_BP_RP_MAG));
            assert!((f64::from(back.bp_rp) - colour).abs() < 0.000_501);
        }
    }
    assert_eq!(seen, 20_000);
}

#[test]
fn cones_agree_with_brute_force() {
    let folder = tempfile::tempdir().unwrap();
    let stars = stars(30_000, 2);
    let reports = build(folder.path(), &stars);
    let layers: Vec<Layer> = reports.iter().map(|report| Layer::open(&report.path).unwrap()).collect();
    let mut rng = StdRng::seed_from_u64(3);
    let mut found = Vec::new();
    let mut total = 0;
    for trial in 0..60 {
        let axis = match trial % 4 {
            0 => DVec3::Z,
            1 => direction(&stars[trial * 11]),
            _ => direction_from_ra_dec(TAU * rng.random::<f64>(), (2.0 * rng.random::<f64>() - 1.0_f64).asin()),
        };
        let radius_rad = [1e-6, 0.3, 1.0, 5.0, 40.0, 170.0][trial % 6] * DEG;
        let limit = [8.0, 12.345, 17.0][trial % 3];
        let mut counted = 0;
        for layer in &layers {
            layer.cone(axis, radius_rad, limit, &mut found).unwrap();
            counted += found.len();
        }
        // Stars that roundings of place or magnitude may put on either side are neither wanted nor refused.
        let within = |extra_rad: f64, extra_mag: f64| {
            let chord2 = chord_squared((radius_rad + extra_rad).max(0.0));
            let is_in = |star: &&NewStar| {
                direction(star).distance_squared(axis) <= chord2 && star.mag_g <= f64::from(limit) + extra_mag
            };
            stars.iter().filter(is_in).count()
        };
        let (least, most) = (within(-MAS, -0.001), within(MAS, 0.001));
        assert!((least..=most).contains(&counted), "trial {trial}: {counted}, wanted {least}..{most}");
        total += counted;
    }
    assert!(total > 100_000, "control: there was something to find: {total}");
}

#[test]
fn nothing_is_found_where_there_is_nothing_to_ask() {
    let folder = tempfile::tempdir().unwrap();
    let reports = build(folder.path(), &stars(100, 4));
    let layer = Layer::open(&reports[2].path).unwrap();
    let mut found = Vec::new();
    for (axis, radius) in [(DVec3::ZERO, 1.0), (DVec3::Z, -1.0), (DVec3::Z, f64::NAN), (DVec3::NAN, 1.0)] {
        layer.cone(axis, radius, 99.0, &mut found).unwrap();
        assert!(found.is_empty());
    }
}

#[test]
fn the_same_stars_in_any_order_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let mut stars = stars(3000, 5);
    let first = build(&folder.path().join("a"), &stars);
    stars.reverse();
    let second = build(&folder.path().join("b"), &stars);
    for (a, b) in first.iter().zip(&second) {
        assert_eq!(std::fs::read(&a.path).unwrap(), std::fs::read(&b.path).unwrap());
        assert_eq!(std::fs::metadata(&a.path).unwrap().len(), a.bytes);
    }
}

#[test]
fn stars_that_come_twice_are_taken_once_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut twice = stars(500, 6);
    twice.extend(stars(500, 6).into_iter().take(200));
    let reports = build(folder.path(), &twice);
    let sum = |of: fn(&LayerReport) -> u64| reports.iter().map(of).sum::<u64>();
    assert_eq!((sum(|report| report.stars), sum(|report| report.doubled)), (500, 200));
}

#[test]
fn stars_of_one_number_are_one_at_one_place_and_two_far_apart() {
    let folder = tempfile::tempdir().unwrap();
    let [star] = stars(1, 6)[..] else { panic!("one") };
    let star = NewStar { mag_g: 9.0, ..star };
    let east = NewStar { ra_rad: (star.ra_rad + MAS) % TAU, ..star };
    let north = NewStar { dec_rad: star.dec_rad - MAS, ..star };
    let fainter = NewStar { mag_g: 9.001, ..star };
    let other_motion = NewStar { motion_mas_yr: Some([1.0, 2.0]), ..star };
    let reports = build(folder.path(), &[star, east, north, fainter, star, other_motion]);
    assert_eq!((reports[0].stars, reports[0].doubled), (1, 5), "one star, the brightest row");
    assert_eq!(reports[0].doubled_number.map(|number| number.to_string()), Some(star.source_id.to_string()));
    let far = NewStar { dec_rad: star.dec_rad - 20_000.0 * MAS, ..star };
    let other = NewStar { source_id: star.source_id + 1, ..east };
    let reports = build(&folder.path().join("far"), &[star, far, other]);
    assert_eq!((reports[0].stars, reports[0].doubled, reports[0].doubled_number), (3, 0, None));
}

#[test]
fn fainter_stars_than_the_last_layer_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut sorting = Sorting::start(folder.path(), &LIMITS).unwrap();
    let [star] = stars(1, 7)[..] else { panic!("one") };
    for mag_g in [17.999, 18.0, 21.0] {
        sorting.add(&NewStar { mag_g, ..star }).unwrap();
    }
    assert_eq!((sorting.counts().stars, sorting.counts().too_faint), (1, 2));
}

/// Runs an import of two inputs that is cut short somewhere in the second.
fn cut_short(work: &Path, halves: [&[NewStar]; 2], taken: usize) {
    let mut sorting = Sorting::start(work, &LIMITS).unwrap();
    halves[0].iter().for_each(|star| sorting.add(star).unwrap());
    sorting.announce("rows without a place", 3);
    sorting.checkpoint("first.csv", "11 bytes").unwrap();
    halves[1][..taken].iter().for_each(|star| sorting.add(star).unwrap());
    sorting.write_rows_for_tests();
}

#[test]
fn an_import_that_is_cut_short_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let stars = stars(2000, 8);
    let whole = build(&folder.path().join("whole"), &stars);
    let halves = stars.split_at(1200);
    let work = folder.path().join("work");
    cut_short(&work, [halves.0, halves.1], 500);
    let mut sorting = Sorting::start(&work, &LIMITS).unwrap();
    assert!(sorting.has("first.csv", "11 bytes").unwrap());
    assert!(!sorting.has("second.csv", "any").unwrap());
    assert_eq!(sorting.counts().stars, 1200, "what was counted after the checkpoint is gone with its rows");
    assert_eq!(sorting.reported().collect::<Vec<_>>(), [("rows without a place", 3)]);
    let changed = sorting.has("first.csv", "12 bytes").unwrap_err().to_string();
    assert!(changed.contains("first.csv") && changed.contains("12 bytes"), "{changed}");
    halves.1.iter().for_each(|star| sorting.add(star).unwrap());
    let resumed = sorting.finish(&folder.path().join("resumed"), 2016.0, "whom it concerns", &mut |_| {}).unwrap();
    for (a, b) in whole.iter().zip(&resumed) {
        assert_eq!(std::fs::read(&a.path).unwrap(), std::fs::read(&b.path).unwrap());
    }
}

#[test]
fn an_import_goes_on_only_with_the_same_options_and_all_its_inputs() {
    let folder = tempfile::tempdir().unwrap();
    let stars = stars(100, 12);
    let (work, j2016) = (folder.path().join("work"), "epoch J2016");
    let mut sorting = Sorting::start(&work, &LIMITS).unwrap();
    sorting.hold_to("what was tried before any input was taken in", &[]).unwrap();
    sorting.hold_to(j2016, &["first.csv", "second.csv"]).unwrap();
    stars.iter().for_each(|star| sorting.add(star).unwrap());
    sorting.checkpoint("first.csv", "11 bytes").unwrap();
    let mut sorting = Sorting::start(&work, &LIMITS).unwrap();
    let mut refused = |options: &str, inputs: &[&str]| sorting.hold_to(options, inputs).unwrap_err().to_string();
    let reported = refused("epoch J2000", &["first.csv"]);
    assert!(reported.contains("an import with epoch J2016 was cut short here, wanted epoch J2000"), "{reported}");
    let reported = refused(j2016, &["second.csv"]);
    assert!(reported.contains("took in \"first.csv\", which is not named now"), "{reported}");
    sorting.hold_to(j2016, &["zeroth.csv", "first.csv"]).unwrap();

    let unmarked = folder.path().join("unmarked");
    cut_short(&unmarked, [&stars, &stars], 0);
    let reported = Sorting::start(&unmarked, &LIMITS).unwrap().hold_to(j2016, &["first.csv"]).unwrap_err().to_string();
    assert!(reported.contains("an import with unknown options"), "{reported}");
}

#[test]
fn rows_that_no_checkpoint_knows_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let (work, stars) = (folder.path().join("work"), stars(300, 13));
    let rows = |work: &Path| {
        let files = std::fs::read_dir(work).unwrap().map(|entry| entry.unwrap().path());
        files.filter(|path| path.extension().is_some_and(|kind| kind == "rows")).count()
    };
    let mut sorting = Sorting::start(&work, &LIMITS).unwrap();
    stars.iter().for_each(|star| sorting.add(star).unwrap());
    sorting.write_rows_for_tests();
    assert!(rows(&work) > 100, "control: an import that is cut short before its first checkpoint leaves rows");
    drop(sorting);
    let mut sorting = Sorting::start(&work, &LIMITS).unwrap();
    assert_eq!(rows(&work), 0);
    sorting.add(&stars[0]).unwrap();
    // Files left behind by another failure do not keep the last step from its end.
    std::fs::write(work.join("layer7_part0000.rows"), "left over").unwrap();
    std::fs::write(work.join("progress.part"), "{").unwrap();
    let reports = sorting.finish(&folder.path().join("layers"), 2016.0, "", &mut |_| {}).unwrap();
    assert_eq!(reports.iter().map(|report| report.stars).sum::<u64>(), 1);
    assert!(!work.exists());
}

#[test]
fn layers_get_their_names_when_all_are_whole_and_an_import_cut_short_there_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let (work, out, stars) = (folder.path().join("work"), folder.path().join("layers"), stars(500, 14));
    let wanted = build(&folder.path().join("whole"), &stars);
    let old = build(folder.path(), &stars[..7]);
    let old: Vec<Vec<u8>> = old.iter().map(|report| std::fs::read(&report.path).unwrap()).collect();
    let of = |out: &Path| LIMITS.map(|limit| std::fs::read(out.join(layer_name(limit))).unwrap());
    let mut sorting = Sorting::start(&work, &LIMITS).unwrap();
    stars.iter().for_each(|star| sorting.add(star).unwrap());
    sorting.checkpoint("all.csv", "11 bytes").unwrap();
    assert!(!Sorting::is_finishing(&work, &out), "control: not yet");
    // The last layer cannot be written: a folder is in its place.
    let in_the_way = out.join("g18.part");
    std::fs::create_dir(&in_the_way).unwrap();
    let error = sorting.finish(&out, 2016.0, "whom it concerns", &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("g18.part"), "{error}");
    assert_eq!(of(&out).to_vec(), old, "no mixture of old and new layers");
    assert!(Sorting::is_finishing(&work, &out));
    assert!(Sorting::is_finishing(&work, &out.join("../layers")), "named in another way");
    assert!(!Sorting::is_finishing(&work, folder.path()), "layers elsewhere are not its own");
    std::fs::remove_dir(&in_the_way).unwrap();
    let sorting = Sorting::start(&work, &LIMITS).unwrap();
    assert!(sorting.has("all.csv", "11 bytes").unwrap());
    sorting.finish(&out, 2016.0, "whom it concerns", &mut |_| {}).unwrap();
    for (bytes, report) in of(&out).iter().zip(&wanted) {
        assert!(*bytes == std::fs::read(&report.path).unwrap());
    }
    assert!(!work.exists() && !Sorting::is_finishing(&work, &out));
}

#[test]
fn work_that_does_not_fit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |work: &Path, limits: &[f32]| {
        let error = Sorting::start(work, limits).err().expect("refused").to_string();
        assert!(error.contains("remove the folder"), "{error}");
        error
    };
    let work = |name: &str| -> PathBuf {
        let work = folder.path().join(name);
        let stars = stars(100, 9);
        cut_short(&work, [&stars, &stars], 0);
        work
    };
    assert!(refused(&work("limits"), &[10.0]).contains("wanted [10.0]"));
    let rows = |work: &Path| {
        let mut files = std::fs::read_dir(work).unwrap().map(|entry| entry.unwrap().path());
        files.find(|path| path.extension().is_some_and(|kind| kind == "rows")).unwrap()
    };
    let lost = work("lost");
    std::fs::remove_file(rows(&lost)).unwrap();
    assert!(refused(&lost, &LIMITS).contains("missing"));
    let short = work("short");
    std::fs::write(rows(&short), "").unwrap();
    assert!(refused(&short, &LIMITS).contains("0 bytes"));
    let garbled = work("garbled");
    std::fs::write(garbled.join("progress.json"), "{").unwrap();
    assert!(refused(&garbled, &LIMITS).contains("cannot be read"));
}

#[test]
fn numbers_come_back_and_may_be_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let stars = stars(3000, 16);
    let reports = build(&folder.path().join("with"), &stars);
    let mut sorting = Sorting::start(&folder.path().join("work"), &LIMITS).unwrap();
    sorting.leave_numbers_out();
    stars.iter().for_each(|star| sorting.add(star).unwrap());
    let without = sorting.finish(&folder.path().join("without"), 2016.0, "whom it concerns", &mut |_| {}).unwrap();
    let paths = |reports: &[LayerReport]| reports.iter().map(|report| report.path.clone()).collect::<Vec<_>>();
    let set = LayerSet::open(&paths(&reports), 99.0).unwrap();
    let (mut bytes, mut found) = (Vec::new(), Vec::new());
    for tile in set.all_tiles() {
        found.clear();
        set.read(tile, &mut bytes, &mut found).unwrap();
        for (place, star) in found.iter().enumerate() {
            assert_eq!(set.place_of(star.id), Some((tile, place)));
            let Some(SourceId::Own(number)) = star.source_id else { panic!("{star:?}") };
            let given = &stars[usize::try_from((number - 3) / 7).unwrap()];
            assert!((star.direction_icrf - direction(given)).length() < 0.4 * MAS, "{star:?} is not {given:?}");
        }
    }
    assert_eq!(set.place_of(3000), None, "no star has this number");
    for (with, without) in reports.iter().zip(&without) {
        let tables = 4 * tiles_of(with.order) as u64;
        assert_eq!(with.bytes - without.bytes, 8 * with.stars + tables);
        let layer = Layer::open(&without.path).unwrap();
        layer.verify(&mut |_| {}).unwrap();
        layer.cone(DVec3::Z, PI, 99.0, &mut found).unwrap();
        assert!(found.iter().all(|star| star.source_id.is_none()) && found.len() as u64 == without.stars);
    }
}

#[test]
fn a_layer_with_holes_in_the_place_of_stars_is_refused_before_memory_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let reports = build(folder.path(), &stars(300, 17));
    let whole = std::fs::read(&reports[0].path).unwrap();
    let head_bytes = writer::head_bytes(reports[0].order, "whom it concerns".len(), true) as usize;
    // Two terabytes of stars in the last tile, by a head whose checksum fits.
    let stars = 1_u64 << 37;
    let mut head = whole[..head_bytes].to_vec();
    head[16..24].copy_from_slice(&stars.to_le_bytes());
    let last_first = layout::HEADER_BYTES + 8 * tiles_of(reports[0].order);
    head[last_first..last_first + 8].copy_from_slice(&stars.to_le_bytes());
    let crc32 = layout::head_crc32(&head);
    head[layout::CRC_AT..][..4].copy_from_slice(&crc32.to_le_bytes());
    let path = folder.path().join("sparse.starlayer");
    std::fs::write(&path, &head).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    file.set_len(head_bytes as u64 + 24 * stars).expect("a file system with long files");
    let reported = Layer::open(&path).unwrap_err().to_string();
    assert!(
        reported.contains("sparse.starlayer") && reported.contains("has holes where stars should be"),
        "{reported}"
    );
}

/// Returns the error of a layer whose bytes were changed, opened and read.
fn reported_of(bytes: &[u8], folder: &Path) -> Option<String> {
    let path = folder.join("damaged.starlayer");
    std::fs::write(&path, bytes).unwrap();
    let read = Layer::open(&path).and_then(|layer| layer.verify(&mut |_| {}));
    read.err().map(|error| error.to_string())
}

#[test]
fn damage_anywhere_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let reports = build(folder.path(), &stars(300, 10));
    let whole = std::fs::read(&reports[2].path).unwrap();
    assert_eq!(reported_of(&whole, folder.path()), None, "control: the whole file");
    let mut rng = StdRng::seed_from_u64(11);
    let anywhere: Vec<usize> = (0..200).map(|_| rng.random_range(0..whole.len())).collect();
    for at in (0..64).chain(anywhere).chain(whole.len() - 64..whole.len()) {
        let mut flipped = whole.clone();
        flipped[at] ^= 1 << rng.random_range(0..8);
        assert!(reported_of(&flipped, folder.path()).is_some(), "byte {at}");
    }
    for cut in [0, 5, 8, 63, 64, 10_000, whole.len() - 1] {
        let reported = reported_of(&whole[..cut], folder.path()).expect("cut short");
        assert!(reported.contains("cut short") || reported.contains("not a star layer"), "{cut}: {reported}");
    }
    let packed = reported_of(&[b"STARCAT1".as_slice(), &whole[8..]].concat(), folder.path()).unwrap();
    assert!(packed.contains("got \"STARCAT1\"; `starloop catalog import` makes layers"), "{packed}");
    let mut longer = whole.clone();
    longer.push(0);
    assert!(reported_of(&longer, folder.path()).unwrap().contains("follows its end"));
    let stars = reports[2].stars as usize;
    for (before_end, words) in [(8 * stars + 5, ["tile", "RA"]), (5, ["numbers of the stars of tile", "CRC-32"])] {
        let mut changed = whole.clone();
        changed[whole.len() - before_end] ^= 4;
        let reported = reported_of(&changed, folder.path()).unwrap();
        assert!(words.iter().all(|word| reported.contains(word)), "{reported}");
    }
}

#[test]
fn heads_that_were_written_wrong_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let reports = build(folder.path(), &stars(300, 15));
    let whole = std::fs::read(&reports[2].path).unwrap();
    // Checksums fit: it is the numbers that are wrong.
    let reported = |at: usize, value: f32| {
        let mut bytes = whole.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let head = writer::head_bytes(reports[2].order, "whom it concerns".len(), true) as usize;
        let crc32 = layout::head_crc32(&bytes[..head]);
        bytes[layout::CRC_AT..][..4].copy_from_slice(&crc32.to_le_bytes());
        reported_of(&bytes, folder.path())
    };
    let (from_at, below_at, fastest_at) = (32, 36, 48);
    assert_eq!((reported(from_at, 14.0), reported(below_at, 18.0)), (None, None), "control: what it is");
    for (at, value, words) in [
        (from_at, f32::NAN, "magnitudes: wanted from, and below"),
        (from_at, 18.0, "got 18 and 18"),
        (below_at, f32::NAN, "got 14 and NaN"),
        (below_at, 15.0, "magnitude: wanted [14.0, 15.0]"),
        (fastest_at, f32::NAN, "fastest proper motion"),
        (fastest_at, -1.0, "fastest proper motion: wanted 0..26000 mas/yr, got -1"),
        (fastest_at, f32::INFINITY, "fastest proper motion"),
        (fastest_at, 100.0, "proper motion: wanted at most 100 mas/yr"),
    ] {
        let reported = reported(at, value).expect(words);
        assert!(reported.contains(words), "{reported}");
    }
    assert_eq!(reported(fastest_at, 26_000.0), None, "the other side");
}
