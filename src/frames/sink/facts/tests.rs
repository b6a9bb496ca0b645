//! The table agrees with itself, with the layouts and with its reference; every output, byte by byte.

use super::reference::reference;
use super::{FactSource, Feature, Part, Row, TABLE};
use crate::sink::sample::{bare_sample_frame, compare_with_file, sample_frame};
use crate::sink::{SentFrame, crc32::pixel_crc32, facts::Form};
use std::{collections::BTreeSet, path::Path};

fn names(of: impl Fn(&Row) -> Vec<&'static str>) -> Vec<&'static str> {
    TABLE.iter().flat_map(of).collect()
}

/// Returns names that are there twice.
fn repeated(names: &[&'static str]) -> Vec<&'static str> {
    let mut seen = BTreeSet::new();
    names.iter().copied().filter(|name| !seen.insert(*name)).collect()
}

#[test]
fn no_output_has_a_name_twice() {
    let lists = [
        names(|row| vec![row.name]),
        names(|row| row.fits.iter().map(|card| card.0).collect()),
        names(|row| row.csv.iter().map(|column| column.0).collect()),
        names(|row| row.chunk.iter().map(|feature| feature.name).collect()),
        names(|row| row.live.iter().map(|key| key.0).collect()),
        names(|row| row.control.iter().map(|key| key.0).collect()),
        names(|row| row.control_meta.iter().map(|key| key.0).collect()),
    ];
    for list in &lists {
        assert_eq!(repeated(list), [""; 0]);
        assert!(list.len() >= 5, "control: there are some");
    }
    assert_eq!(repeated(&["a", "b", "a"]), ["a"], "control");
}

#[test]
fn values_are_of_the_kind_that_the_table_says() {
    let mut present = BTreeSet::new();
    for frame in [sample_frame(7), bare_sample_frame(8)] {
        let source = FactSource::of_frame(&frame, Some(pixel_crc32(&frame.image)));
        for row in TABLE {
            let fact = (row.value)(&source);
            assert!(row.kind.fits(fact), "{}: {fact:?} is not {}", row.name, row.kind.name());
            if fact != super::Fact::Absent {
                present.insert(row.name);
            }
        }
    }
    assert_eq!(present.len(), TABLE.len(), "each fact is in one of the two frames");
    let frame = sample_frame(1);
    assert!(!TABLE[0].kind.fits((TABLE[1].value)(&FactSource::of_frame(&frame, None))), "control: another's value");
}

/// Elements of a row's value.
fn elements(row: &Row) -> usize {
    match row.kind {
        super::Kind::Reals(count) | super::Kind::Wholes(count) => count,
        super::Kind::Flag
        | super::Kind::U32
        | super::Kind::U64
        | super::Kind::Count
        | super::Kind::Real
        | super::Kind::Text
        | super::Kind::Time
        | super::Kind::Span
        | super::Kind::Faults
        | super::Kind::Active
        | super::Kind::Regions => 1,
    }
}

#[test]
fn lists_have_a_name_for_each_element() {
    for row in TABLE.iter().filter(|row| elements(row) > 1) {
        for count in [row.fits.len(), row.csv.len(), row.chunk.len()] {
            assert!(count == 0 || count == elements(row), "{}: {count} of {}", row.name, elements(row));
        }
    }
}

#[test]
fn chunk_places_count_up_without_gaps() {
    let mut features: Vec<&Feature> = TABLE.iter().flat_map(|row| row.chunk).collect();
    features.sort_by_key(|feature| feature.place);
    let places: Vec<usize> = features.iter().map(|feature| feature.place).collect();
    assert_eq!(places, (0..features.len()).collect::<Vec<_>>());
    assert!(features.iter().all(|feature| feature.name.starts_with("Chunk")), "clients find chunk data by this word");
}

#[test]
fn places_in_shared_memory_are_aligned_and_apart() {
    let mut places: Vec<(usize, usize)> = TABLE
        .iter()
        .filter_map(|row| {
            let place = row.memory?;
            assert_eq!(place.0 % place.1.bytes(), 0, "{}", row.name);
            Some((place.0, place.0 + place.1.bytes() * elements(row)))
        })
        .collect();
    places.sort_unstable();
    assert!(places.windows(2).all(|two| two[0].1 <= two[1].0), "{places:?}");
    let (first, last) = (places[0].0, places[places.len() - 1].1);
    assert!(first >= 8 && last <= 256, "behind the serial, within the head: {first}, {last}");
}

#[test]
fn every_part_of_a_header_has_facts() {
    for part in Part::OF_EVERY_FILE.into_iter().chain([Part::Detector]) {
        assert!(TABLE.iter().any(|row| row.part == part && !row.fits.is_empty()), "{part:?}");
    }
}

#[test]
fn unknown_facts_are_absent() {
    let frame = sample_frame(1);
    let facts = |source: &FactSource<'_>| TABLE.iter().filter(|row| (row.value)(source) == super::Fact::Absent).count();
    let without = |source| facts(&source);
    let [whole, no_crc, meta] =
        [FactSource::of_frame(&frame, Some(1)), FactSource::of_frame(&frame, None), FactSource::of_meta(&frame.meta)]
            .map(without);
    assert_eq!((no_crc, meta), (whole + 1, whole + 4), "the checksum; the size and the stars");
}

#[test]
fn forms_of_one_fact_differ() {
    let frame: SentFrame = sample_frame(1);
    let lateness = TABLE.iter().find(|row| row.name == "lateness").unwrap();
    let fact = (lateness.value)(&FactSource::of_frame(&frame, None));
    assert_eq!(fact.element(0, Form::Ns), super::Scalar::Whole(-1_234_567));
    assert_eq!(fact.element(0, Form::Ms), super::Scalar::Real(frame.meta.lateness.ms()));
    assert_eq!(super::json(fact, Form::Ms), serde_json::json!(frame.meta.lateness.ms()));
}

#[test]
fn reference_is_the_table() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../guide/frame_facts.md"));
    compare_with_file(path, &reference()).unwrap();
    let other = reference().replace("NOISSEED", "NOISESEED");
    assert_ne!(std::fs::read_to_string(path).unwrap(), other, "control: one keyword");
}
