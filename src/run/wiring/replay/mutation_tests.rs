//! Tests the tables of a capture with many kinds of damage: each gives usable rows, or an error that names file and
//! line.
//!
//! The fuzz targets of `tests/fuzz` build no drawing crate; these readers are fuzzed here, from seeds, by random
//! changes of bytes, lines and fields. Rows that the test makes must be read back unchanged.

use super::{rows::columns, *};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::path::Path;

/// Damaged tables of each kind.
const TABLES: usize = 60_000;

const FRAMES: &str = concat!(
    "frame,head,messages,",
    columns!(),
    ",exposed\n0,0,120;118,3ff0000000000000,full,sent,0badcafe,\n\
     1,2,121;119,0,none,dropped,,1;2;0000000000000000;0000000000000000;bus;3;1:2:3:4+100:2:3:4\n2,0,,,,held,1,\n"
);
const FRAMES_OF_ONE: &str = concat!("frame,messages,", columns!(), "\n0,7,0,full,late,ffffffff\n1,8,0,full,sent,\n");
const SAMPLES: &str = "part,at_tai_ns,numbers\nobserver,5,7000.0,0.0,-1e-3,0,7.5,0\n\
    attitude,5,1.0,0.0,0.0,0.0,0.1,0.2,0.3,0.0,0.0,0.0\njitter,-6,1e-6,0,-2e-6\n";
/// Pieces that are inserted at random places.
const PIECES: [&str; 16] = [
    ",",
    ";",
    "\n",
    "\r\n",
    "-",
    "0",
    "9999999999999999999999",
    "nan",
    "inf",
    "1e308",
    "held",
    "attitude,",
    "jitter,",
    "\u{fffd}",
    "7ff8000000000000",
    concat!("frame,head,messages,", columns!(), "\n"),
];

fn damaged(seed: &[u8], random: &mut StdRng) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..random.random_range(1..5) {
        let place = random.random_range(0..=bytes.len());
        match random.random_range(0..6) {
            0 => bytes.truncate(place),
            1 => bytes.insert(place, random.random_range(0..=255)),
            2 if place < bytes.len() => bytes[place] ^= 1 << random.random_range(0..8),
            3 if place < bytes.len() => drop(bytes.remove(place)),
            4 => {
                let until = random.random_range(place..=bytes.len());
                let piece = bytes[place..until].to_vec();
                bytes.splice(place..place, piece);
            }
            _ => {
                let piece = PIECES[random.random_range(0..PIECES.len())];
                bytes.splice(place..place, piece.bytes());
            }
        }
    }
    bytes
}

/// Asserts that an error names the file and an existing line.
fn assert_named(error: &ReplayError, bytes: &[u8]) {
    let text = error.to_string();
    let line = text.strip_prefix("file:").and_then(|rest| rest.split(':').next()?.parse::<usize>().ok());
    let lines = 1 + bytes.iter().filter(|byte| **byte == b'\n').count();
    assert!(line.is_some_and(|line| (1..=lines).contains(&line)), "{text}");
}

fn frames(bytes: &[u8]) -> Result<Vec<FrameRow>, ReplayError> {
    let mut reader = RowReader::new(bytes, Path::new("file"))?;
    core::iter::from_fn(|| reader.read().transpose()).collect()
}

fn samples(bytes: &[u8]) -> Result<Vec<CapturedSample>, ReplayError> {
    let mut reader = SampleReader::new(bytes, Path::new("file"))?;
    core::iter::from_fn(|| reader.read().transpose()).collect()
}

/// Asserts that a sample has one part, of finite numbers, and a unit quaternion.
fn assert_usable(CapturedSample { sample, .. }: &CapturedSample) {
    let parts = [sample.attitude.is_some(), sample.jitter_rad.is_some(), sample.observer.is_some()];
    assert_eq!(parts.into_iter().filter(|part| *part).count(), 1);
    if let Some(attitude) = sample.attitude {
        assert!((attitude.body_from_icrf.quat().length() - 1.0).abs() < 1e-8);
        assert!(attitude.rate_rad_s.is_finite() && attitude.acceleration_rad_s2.is_finite());
    }
    assert!(sample.jitter_rad.is_none_or(|rotation| rotation.is_finite()));
    assert!(sample.observer.is_none_or(|state| state.position_km.is_finite() && state.velocity_km_s.is_finite()));
}

/// Reads many damaged tables; both outcomes must occur.
fn try_all<T>(seeds: &[&str], read: fn(&[u8]) -> Result<Vec<T>, ReplayError>, check: fn(&T)) {
    let mut random = StdRng::seed_from_u64(20);
    let [mut taken, mut refused] = [0, 0];
    for number in 0..TABLES {
        let bytes = damaged(seeds[number % seeds.len()].as_bytes(), &mut random);
        match read(&bytes) {
            Ok(rows) => {
                taken += 1;
                rows.iter().for_each(check);
            }
            Err(error) => {
                refused += 1;
                assert_named(&error, &bytes);
            }
        }
    }
    assert!(taken > TABLES / 50 && refused > TABLES / 5, "{taken} taken, {refused} refused");
}

#[test]
fn damaged_tables_of_frames_are_read_or_refused_with_file_and_line() {
    try_all(&[FRAMES, FRAMES_OF_ONE], frames, |row| {
        assert!(row.drawn.is_none_or(|drawn| drawn.load.is_finite()), "{row:?}");
    });
}

#[test]
fn damaged_tables_of_samples_are_read_or_refused_with_file_and_line() {
    let real =
        SAMPLES.replace("at_tai_ns,", "at_tai_ns,arrived_tai_ns,").replace(",5,", ",5,6,").replace(",-6,", ",-6,-5,");
    try_all(&[SAMPLES, real.as_str()], samples, assert_usable);
}

#[test]
fn long_lines_take_no_more_than_their_limit() {
    for (header, read) in [(FRAMES, false), (SAMPLES, true)] {
        let text = format!("{}{}\n", header.split_inclusive('\n').next().unwrap(), "0".repeat(1 << 20));
        let error = if read { samples(text.as_bytes()).err() } else { frames(text.as_bytes()).err() };
        assert!(error.is_some_and(|error| error.to_string().contains("longer than")), "{header}");
    }
}

#[test]
fn rows_come_back_as_they_were_made() {
    let mut random = StdRng::seed_from_u64(21);
    let fates = [("sent", CapturedFate::Sent), ("held", CapturedFate::Held), ("dropped", CapturedFate::Dropped)];
    for _ in 0..2000 {
        let (frame, head, messages): (u32, u8, u32) = (random.random(), random.random(), random.random());
        let (load, crc): (f64, u32) = (random.random(), random.random());
        let (name, fate) = fates[random.random_range(0..fates.len())];
        let header = FRAMES.split_inclusive('\n').next().unwrap();
        let row = format!("{header}{frame},{head},{messages},{:016x},full,{name},{crc:08x},\n", load.to_bits());
        let [read] = frames(row.as_bytes()).unwrap().try_into().unwrap();
        let drawn = read.drawn.unwrap();
        assert_eq!((read.frame, read.head, read.fate, read.crc32), (frame, head.into(), fate, Some(crc)), "{row}");
        assert_eq!((drawn.messages[0], drawn.load.to_bits()), (messages.into(), load.to_bits()), "{row}");
        assert!(frames(row.replace(name, "lost").as_bytes()).is_err(), "control: a fate that there is not");

        let half: f64 = random.random();
        let numbers: [f64; 6] = core::array::from_fn(|_| random.random_range(-1e4..1e4));
        let list = numbers.map(|number| format!("{number:?}")).join(",");
        let of = |scale: f64| {
            let [w, x] = [half.cos() * scale, -half.sin() * scale];
            format!("part,at_tai_ns,numbers\nattitude,{messages},{w:?},{x:?},0,0,{list}\n")
        };
        let [read] = samples(of(1.0).as_bytes()).unwrap().try_into().unwrap();
        let attitude = read.sample.attitude.unwrap();
        let rates = [attitude.rate_rad_s.to_array(), attitude.acceleration_rad_s2.to_array()].concat();
        assert_eq!((read.sample.at.ns(), rates), (messages.into(), numbers.to_vec()));
        assert!(samples(of(1.001).as_bytes()).is_err(), "control: a quaternion without unit norm");
    }
}
