//! Gaia's CSV, Hipparcos' and Tycho-2's lines: every line is a star, or left out and counted, or the whole is an error.

#![no_main]

use base::refused::Refused;
use flate2::{Compression, write::GzEncoder};
use imports::published::add_bright;
use imports::published::bright::BrightStars;
use imports::published::gaia::{self, Names};
use libfuzzer_sys::fuzz_target;
use starloop_fuzz::{Input, control, scratch};
use stars::layer::Sorting;
use std::io::{BufReader, Write};
use std::path::Path;

/// For a few thousand bytes of text.
const MEMORY_MAX: u64 = 1 << 20;
/// The columns that a file must have, under the archive's names and under others.
const HEADERS: [&str; 2] = [
    "source_id,ra,dec,pmra,pmdec,parallax,phot_g_mean_mag,bp_rp,phot_bp_mean_mag,phot_rp_mean_mag\n",
    "# %ECSV 1.0\nid,ra,dec,pmra,pmdec,parallax,G,phot_bp_mean_mag,phot_rp_mean_mag\n",
];

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    let (kind, form, length) = (input.u8() % 6, input.u8(), input.u8());
    let place = input.u16();
    let header = HEADERS[usize::from(form % 2)].as_bytes();
    match kind {
        0 => drop(read_gaia(input.rest(), form, length)),
        1 => drop(read_gaia(&[header, input.rest()].concat(), form, length)),
        2 => read_packed(&[header, input.rest()].concat(), form, place, length),
        3 => read_any_packed(input.rest()),
        4 => drop(read_bright(input.rest())),
        _ => {
            let (gaia, bright) = input.rest().split_at(usize::from(place).min(input.rest().len()));
            merge(&[header, gaia].concat(), bright, form);
        }
    }
});

fn names(form: u8) -> Names {
    let mut names = Names::default();
    if form % 2 == 1 {
        assert!(names.rename("source_id", "id") && names.rename("phot_g_mean_mag", "G"));
    }
    names
}

fn sorting() -> Sorting {
    let work = scratch::path("sorted");
    let _ = std::fs::remove_dir_all(&work);
    Sorting::start(&work, &[10.0, 18.0]).expect("an empty folder")
}

fn reported(sorting: &Sorting, what: &str) -> u64 {
    sorting.reported().find(|reported| reported.0 == what).map_or(0, |reported| reported.1)
}

// --- Gaia ------------------------------------------------------------------------------------------------------------

/// Rows, and stars among them.
type Read = Result<(u64, u64), String>;

fn read_gaia(text: &[u8], form: u8, length: u8) -> Read {
    let (names, mut sorting) = (names(form), sorting());
    let mut done = None;
    let memory = allocation_counter::measure(|| {
        // In pieces of any length.
        let text = BufReader::with_capacity(usize::from(length) + 1, text);
        done = Some(gaia::import_text(text, Path::new("stars.csv"), &names, &mut sorting, &mut |_| {}));
    });
    assert!(memory.bytes_max < MEMORY_MAX, "{} bytes of memory for {}", memory.bytes_max, text.len());
    counted(text, done.expect("it was read or refused"), &sorting)
}

/// Compares the counts with the lines.
fn counted(text: &[u8], done: Result<u64, Refused>, sorting: &Sorting) -> Read {
    let rows = done.map_err(|error| shown(&error))?;
    let counts = sorting.counts();
    let left_out =
        counts.too_faint + reported(sorting, gaia::WITHOUT_PLACE) + reported(sorting, gaia::WITHOUT_MAGNITUDE);
    assert_eq!(counts.stars + left_out, rows, "every row is a star or counted");
    let mut lines = lines(text).skip_while(|line| line.starts_with(b"#"));
    assert!(lines.next().is_some(), "a header");
    let comments = lines.clone().filter(|line| line.starts_with(b"#")).count() as u64;
    assert_eq!(reported(sorting, gaia::COMMENTS), comments);
    // Broken: such lines are taken to be rows.
    let not_rows = if control::is_broken() { 0 } else { comments };
    assert_eq!(rows + not_rows, lines.count() as u64, "every line is a row or counted");
    Ok((rows, counts.stars))
}

/// Returns lines that are not empty.
fn lines(text: &[u8]) -> impl Iterator<Item = &[u8]> + Clone {
    let lines = text.split(|byte| *byte == b'\n').map(|line| line.strip_suffix(b"\r").unwrap_or(line));
    lines.filter(|line| !line.is_empty())
}

fn shown(error: &Refused) -> String {
    let shown = error.to_string();
    assert!(shown.contains("stars.") && shown.len() < 2000, "{shown}");
    shown
}

/// Asserts the same stars as of the plain text, or an error when the packed file is damaged.
fn read_packed(text: &[u8], form: u8, place: u16, change: u8) {
    let wanted = read_gaia(text, form, u8::MAX);
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(text).expect("memory takes everything");
    let mut packed = encoder.finish().expect("memory takes everything");
    let place = usize::from(place) % packed.len();
    let is_cut = change == u8::MAX;
    if is_cut {
        packed.truncate(place);
    } else {
        packed[place] ^= change;
    }
    let (path, mut sorting) = (scratch::file("stars.csv.gz", &packed), sorting());
    let done = gaia::import(&path, &names(form), &mut sorting, &mut |_| {});
    let got = counted(text, done, &sorting);
    // Its head has a time and other fields that are not used.
    assert!(got.is_err() || got == wanted, "damage at {place} gives {got:?}, wanted {wanted:?}");
    assert!(change != 0 || got.is_ok() == wanted.is_ok(), "{got:?}, wanted {wanted:?}");
    assert!(!is_cut || got.is_err(), "cut at {place}");
}

/// Reads any bytes as a packed file.
fn read_any_packed(bytes: &[u8]) {
    let (path, mut sorting) = (scratch::file("stars.any.gz", bytes), sorting());
    if let Err(error) = gaia::import(&path, &names(0), &mut sorting, &mut |_| {}) {
        shown(&error);
    }
}

// --- Hipparcos and Tycho-2 -------------------------------------------------------------------------------------------

fn read_bright(text: &[u8]) -> Result<BrightStars, String> {
    let mut bright = BrightStars::default();
    let mut done = Ok(());
    let memory = allocation_counter::measure(|| done = bright.read_text(text, Path::new("stars.dat")));
    assert!(memory.bytes_max < MEMORY_MAX, "{} bytes of memory for {}", memory.bytes_max, text.len());
    done.map_err(|error| shown(&error))?;
    let left_out = bright.reported.iter().filter(|(what, _)| what.contains("left out")).map(|(_, count)| count);
    let stars = (bright.hipparcos.len() + bright.tycho.len()) as u64;
    assert_eq!(stars + left_out.sum::<u64>(), lines(text).count() as u64, "every line is a star or counted");
    Ok(bright)
}

/// Merges both into one import: asserts that every bright star was there, or is added, or counted.
fn merge(gaia: &[u8], bright: &[u8], form: u8) {
    let mut sorting = sorting();
    let Ok(bright) = read_bright(bright) else { return };
    if gaia::import_text(gaia, Path::new("stars.csv"), &names(form), &mut sorting, &mut |_| {}).is_err() {
        return;
    }
    let before = sorting.counts();
    let stars = (bright.hipparcos.len() + bright.tycho.len()) as u64;
    match add_bright(bright, gaia::EPOCH_YR, &mut sorting) {
        Ok(()) => {
            let added = reported(&sorting, "bright stars that were missing, added");
            assert_eq!(sorting.counts().stars - before.stars, added);
            let left_out = [
                "bright stars that came twice, taken once",
                "stars of Tycho-2 that Hipparcos has, left out",
                "bright stars fainter than the layers, left out",
                "bright stars that were there, left out",
            ];
            let left_out: u64 = left_out.iter().map(|what| reported(&sorting, what)).sum();
            assert_eq!(added + left_out, stars, "every bright star is counted");
        }
        Err(error) => assert!(error.to_string().contains("source "), "{error}"),
    }
}
