//! Layers: any bytes, and layers that are damaged in head, table or records, with checksums as they were or made to
//! fit; what was written is read again.

#![no_main]

use base::refused::Refused;
use base::source::{CatalogSource, direction_from_ra_dec};
use libfuzzer_sys::fuzz_target;
use starloop_fuzz::{Input, control, scratch};
use stars::layer::{Layer, LayerSet, NewStar, Sorting, is_layer};
use std::{fs, path::Path, sync::LazyLock};

/// Offsets of the parts of a layer, from the table of `layer/layout.rs`, written independently.
const CRC_AT: usize = 44;
const FIRSTS_AT: usize = 64;
const ORDER: u32 = 6;
const TILES: usize = 12 << (2 * ORDER);
const CRCS_AT: usize = FIRSTS_AT + 8 * (TILES + 1);
const CREDITS_AT: usize = CRCS_AT + 4 * TILES;
const RECORD: usize = 16;
/// Beside what the file's own bytes become in memory.
const MEMORY_BESIDE: u64 = 1 << 16;
/// Fainter than any magnitude that a layer stores.
const ALL: f32 = 99.0;

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    match input.u8() % 4 {
        0 => drop(read(input.rest())),
        1 | 2 => read_damaged(&mut input),
        _ => write_and_read(&mut input),
    }
});

// --- reading ---------------------------------------------------------------------------------------------------------

/// Returns the stars that were read, when all of them were and `verify` finds nothing wrong.
fn read(bytes: &[u8]) -> Result<Vec<CatalogSource>, Refused> {
    let path = scratch::file("any.starlayer", bytes);
    let mut opened = None;
    let memory = allocation_counter::measure(|| opened = Some(Layer::open(&path)));
    let most = 3 * bytes.len() as u64 + MEMORY_BESIDE;
    assert!(memory.bytes_max < most, "{} bytes of memory to open {}", memory.bytes_max, bytes.len());
    let layer = match opened.expect("it was opened or refused") {
        Ok(layer) => layer,
        Err(error) => {
            assert!(error.to_string().contains("any.starlayer"), "{error}");
            // Broken: a refused file does not begin like a layer.
            let is_none = !is_layer(&path) || control::is_broken();
            assert_eq!(error.to_string().contains(": not a star layer: "), is_none, "{error}");
            return Err(error);
        }
    };
    let (stars, wrong) = read_tiles(&layer);
    let verified = layer.verify(&mut |_| {});
    assert!(verified.is_err() || wrong == 0, "{wrong} tiles cannot be read");
    verified?;
    stars.iter().for_each(|star| assert_is_of(&layer, star));
    // All tiles again, and one more opening: not each time.
    if bytes.len().is_multiple_of(8) {
        let mut found = Vec::new();
        layer.cone(glam::DVec3::Z, 4.0, ALL, &mut found)?;
        assert_eq!(found, stars, "the whole sky");
        let set = LayerSet::open(&[path], ALL)?;
        assert_eq!(set.all_tiles().map(|tile| set.stars_of(tile)).sum::<u64>(), layer.index().stars());
    }
    Ok(stars)
}

/// Returns all stars, and how many tiles could not be read.
fn read_tiles(layer: &Layer) -> (Vec<CatalogSource>, usize) {
    let (mut scratch, mut all, mut wrong, mut stars) = (Vec::new(), Vec::new(), 0, 0);
    for (tile, count) in (0..).zip(layer.index().stars_of_tiles()).filter(|(_, count)| *count > 0) {
        stars += count;
        let (before, mut restored) = (all.len(), Vec::new());
        let done = layer.read_tile(tile, ALL, 0, &mut scratch, &mut all);
        assert_eq!(done.is_ok(), layer.restore_tile(tile, &mut scratch, &mut restored).is_ok());
        let is_read = done.is_ok();
        if let Err(error) = done {
            wrong += 1;
            assert!(error.to_string().contains(&format!("tile {tile} of order")), "{error}");
        }
        let wanted = if is_read { count } else { 0 };
        assert_eq!((all.len() - before) as u64, wanted, "tile {tile}");
        assert_eq!(restored.len() as u64, wanted, "tile {tile}");
        assert!(restored.iter().all(|star| star.ra_rad.is_finite() && star.dec_rad.is_finite()));
    }
    assert_eq!(stars, layer.index().stars(), "every star is in a tile");
    (all, wrong)
}

fn assert_is_of(layer: &Layer, star: &CatalogSource) {
    assert!((star.direction_icrf.length() - 1.0).abs() < 1e-9, "{star:?}");
    let [from, below] = layer.index().magnitudes;
    assert!(star.mag_g > from - 0.002 && star.mag_g < below + 0.002, "{star:?} in {from}..{below}");
    if let Some(motion) = star.proper_motion {
        let speed = f64::from(motion.pm_ra_cosdec_mas_yr).hypot(f64::from(motion.pm_dec_mas_yr));
        assert!(speed <= layer.index().fastest_mas_yr * (1.0 + 1e-6), "{star:?} of {}", layer.index().fastest_mas_yr);
    }
}

// --- damage ----------------------------------------------------------------------------------------------------------

/// A head of no stars, as it is written without numbers.
static EMPTY: LazyLock<Vec<u8>> = LazyLock::new(|| written(&[], &mut 0, false));

/// Reads a layer of any records, after any changes to it, then checksums that fit or do not.
fn read_damaged(input: &mut Input<'_>) {
    let flags = input.u8();
    let (repairs_tiles, repairs_head) = (flags & 1 == 0, flags & 2 == 0);
    let (whole, tiles) = layer_of(input);
    let mut damaged = whole.clone();
    while !input.is_empty() && input.bool() {
        change(&mut damaged, input);
    }
    if repairs_tiles && damaged != whole {
        repair_tiles(&mut damaged, &tiles);
    }
    if repairs_head {
        repair_head(&mut damaged);
    }
    // A changed checksum is right again after its repair.
    let is_damaged = damaged != whole;
    match read(&damaged) {
        Ok(stars) => {
            let records: usize = tiles.iter().map(|(_, count)| count).sum();
            assert!(stars.len() == records || is_damaged, "{} stars of {records}", stars.len());
            assert!(!is_damaged || repairs_head, "damage was not reported");
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// Returns a layer whose checksums fit, and its tiles: number and count of records.
fn layer_of(input: &mut Input<'_>) -> (Vec<u8>, Vec<(usize, usize)>) {
    let credits_length = usize::from(input.u8() % 64);
    let credits = input.take(credits_length);
    let mut tiles: Vec<(usize, &[u8])> = (0..input.u8() % 5)
        .map(|_| {
            let (tile, count) = (input.below(TILES), usize::from(input.u8() % 6) + 1);
            (tile, input.take(count * RECORD))
        })
        .collect();
    tiles.sort_by_key(|(tile, _)| *tile);
    tiles.dedup_by_key(|(tile, _)| *tile);
    let mut layer = EMPTY.clone();
    layer[40..44].copy_from_slice(&u32::try_from(credits.len()).expect("64 at most").to_le_bytes());
    layer.extend(credits);
    let (mut stars, mut next, mut of_tiles) = (0_u64, 0, Vec::new());
    for (tile, records) in tiles {
        let (records, _) = records.as_chunks::<RECORD>();
        // Brightest first, as in a layer; a change may put them out of order.
        let mut records = records.to_vec();
        records.sort_by_key(|record| u16::from_le_bytes([record[6], record[7]]));
        put_firsts(&mut layer, next..=tile, stars);
        put(&mut layer, CRCS_AT + 4 * tile, &crc32fast::hash(records.as_flattened()).to_le_bytes());
        layer.extend(records.as_flattened());
        of_tiles.push((tile, records.len()));
        (stars, next) = (stars + records.len() as u64, tile + 1);
    }
    put_firsts(&mut layer, next..=TILES, stars);
    put(&mut layer, 16, &stars.to_le_bytes());
    put(&mut layer, 48, &2e4_f32.to_le_bytes());
    repair_head(&mut layer);
    (layer, of_tiles)
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..at + value.len()].copy_from_slice(value);
}

fn put_firsts(layer: &mut [u8], tiles: core::ops::RangeInclusive<usize>, stars: u64) {
    let firsts = &mut layer[FIRSTS_AT + 8 * tiles.start()..FIRSTS_AT + 8 * (tiles.end() + 1)];
    firsts.copy_from_slice(&stars.to_le_bytes().repeat(tiles.count()));
}

/// Makes one change: of the header, of a row of the tables, of what follows them, or of the length.
fn change(layer: &mut Vec<u8>, input: &mut Input<'_>) {
    let (kind, place) = (input.u8() % 6, input.u16());
    let place = usize::from(place);
    let (at, value): (usize, &[u8]) = match kind {
        0 => (place % FIRSTS_AT, input.take(1)),
        1 => (place % FIRSTS_AT / 4 * 4, input.take(4)),
        2 => (FIRSTS_AT + 8 * (place % (TILES + 1)), input.take(8)),
        3 => (CRCS_AT + 4 * (place % TILES), input.take(4)),
        4 => (CREDITS_AT + place, input.take(2)),
        _ => return layer.resize(place * 64 + usize::from(input.u8()), 0x55),
    };
    let end = (at + value.len()).min(layer.len());
    if at < end {
        layer[at..end].copy_from_slice(&value[..end - at]);
    }
}

/// Writes checksums of the records listed in the tables, as far as the records are there.
fn repair_tiles(layer: &mut [u8], tiles: &[(usize, usize)]) {
    if layer.len() < CREDITS_AT {
        return;
    }
    let credits = u32::from_le_bytes(layer[40..44].try_into().expect("four")) as usize;
    let first = |layer: &[u8], tile: usize| {
        let at = FIRSTS_AT + 8 * tile;
        u64::from_le_bytes(layer[at..at + 8].try_into().expect("eight")) as usize
    };
    for (tile, _) in tiles {
        let at = |star: usize| CREDITS_AT.saturating_add(credits).saturating_add(star.saturating_mul(RECORD));
        let range = at(first(layer, *tile))..at(first(layer, tile + 1));
        if let Some(records) = layer.get(range) {
            let crc = crc32fast::hash(records);
            put(layer, CRCS_AT + 4 * tile, &crc.to_le_bytes());
        }
    }
}

/// Writes the checksum of everything before the records, its own field taken as zero.
fn repair_head(layer: &mut [u8]) {
    if layer.len() < CREDITS_AT {
        return;
    }
    let credits = u32::from_le_bytes(layer[40..44].try_into().expect("four")) as usize;
    let end = CREDITS_AT.saturating_add(credits).min(layer.len());
    put(layer, CRC_AT, &[0; 4]);
    let crc = crc32fast::hash(&layer[..end]);
    put(layer, CRC_AT, &crc.to_le_bytes());
}

// --- written layers --------------------------------------------------------------------------------------------------

/// Returns the bytes of the layer to magnitude 20 of these stars; `doubled` counts those that came twice.
fn written(stars: &[NewStar], doubled: &mut u64, has_numbers: bool) -> Vec<u8> {
    let work = scratch::path("work");
    let _ = fs::remove_dir_all(&work);
    let mut sorting = Sorting::start(&work, &[20.0]).expect("an empty folder");
    if !has_numbers {
        sorting.leave_numbers_out();
    }
    let mut refused = 0;
    for star in stars {
        refused += u64::from(sorting.add(star).is_err());
    }
    let counts = sorting.counts();
    assert_eq!(counts.stars + counts.too_faint + refused, stars.len() as u64, "every star is counted");
    let reports = sorting.finish(&scratch::path("layers"), 2016.0, "", &mut |_| {}).expect("the disk takes it");
    *doubled = reports[0].doubled;
    assert_eq!(reports[0].stars + reports[0].doubled, counts.stars, "no star is lost");
    fs::read(&reports[0].path as &Path).expect("it was written")
}

fn write_and_read(input: &mut Input<'_>) {
    let stars: Vec<NewStar> = core::iter::from_fn(|| (!input.is_empty()).then(|| star(input))).take(32).collect();
    let mut doubled = 0;
    let layer = written(&stars, &mut doubled, stars.len().is_multiple_of(2));
    for star in read(&layer).expect("what was written is a layer") {
        let near = |given: &&NewStar| {
            let place = direction_from_ra_dec(given.ra_rad, given.dec_rad);
            // 0.4 mas, half a step of order 6.
            place.distance(star.direction_icrf) < 2e-9 && (given.mag_g - f64::from(star.mag_g)).abs() < 0.000_6
        };
        assert!(stars.iter().any(|given| near(&given)), "{star:?} was not given");
    }
}

/// Returns a star that can be stored, mostly.
fn star(input: &mut Input<'_>) -> NewStar {
    let flags = input.u8();
    let mut share = || f64::from(input.u16()) / 65_535.0;
    let (ra, dec, g, east, north) = (share(), share(), share(), share(), share());
    let odd = |bit: u8, value: f64, otherwise: f64| if flags >> bit & 3 == 3 { otherwise } else { value };
    NewStar {
        source_id: i64::from(flags),
        ra_rad: odd(0, ra * core::f64::consts::TAU, f64::from(input.finite())),
        dec_rad: (dec - 0.5) * core::f64::consts::PI,
        motion_mas_yr: (flags & 4 == 0).then_some([(east - 0.5) * 3e4, (north - 0.5) * 2e4]),
        parallax_mas: (flags & 8 == 0).then_some((east - 0.1) * 1000.0),
        mag_g: odd(6, g * 24.0 - 2.0, f64::NAN),
        bp_rp: (flags & 16 == 0).then_some(g * 10.0 - 2.0),
    }
}
