//! The DBC file against the Rust crate: identifiers, lengths, formats, cycles, every field of random messages.

use crate::c_program::hex;
use crate::dbc_signals::{decode, expected, is_active};
use crate::samples::{KINDS, Samples};
use can_dbc::{AttributeValue, Dbc, MessageId as DbcId, NumericValue};
use firmware_protocol::can::{self, CanFrame, CanId, Format, IdMap};
use firmware_protocol::message::{CameraKind, MessageId, Refusal, StartedBy, Table};
use firmware_protocol::{Message, Reject, version};
use std::collections::BTreeSet;

/// Random messages of each kind and format.
const MESSAGES: u64 = 500 * KINDS;
/// DBC: messages above this length are FD frames; index of `StandardCAN_FD` in `VFrameFormat`.
const FD_FORMAT: f64 = 14.0;

pub(crate) fn dbc() -> Dbc {
    Dbc::try_from(crate::text("dbc/starloop.dbc").as_str()).unwrap()
}

pub(crate) fn raw(id: &DbcId) -> CanId {
    match id {
        DbcId::Standard(id) => CanId::standard(*id),
        DbcId::Extended(id) => CanId::extended(*id),
    }
    .unwrap()
}

/// Returns the value of a message's attribute, or the default 0.
pub(crate) fn attribute(dbc: &Dbc, name: &str, id: &DbcId) -> f64 {
    let found = dbc.attribute_values_message.iter().find(|value| value.name == name && value.message_id == *id);
    match found.map(|found| &found.value) {
        None => 0.0,
        Some(AttributeValue::Uint(value)) => *value as f64,
        Some(AttributeValue::Int(value)) => *value as f64,
        Some(AttributeValue::Double(value)) => *value,
        Some(AttributeValue::String(text)) => panic!("{name} is `{text}`"),
    }
}

/// Differences between what the frame should say and what the DBC reads from it.
fn differences(dbc: &Dbc, message: &Message, frame: &CanFrame) -> Vec<String> {
    let Some(described) = dbc.messages.iter().find(|described| raw(&described.id) == frame.id()) else {
        return vec![format!("{:X} is not in the DBC", frame.id())];
    };
    let number = u8::try_from(frame.id().number() >> 4).unwrap();
    let wanted = expected(message, MessageId::from_number(number).unwrap(), frame.data());
    let read = decode(dbc, described, frame.data());
    let mut found = Vec::new();
    if described.size != frame.data().len() as u64 {
        found.push(format!("{}: {} bytes", described.name, described.size));
    }
    for (name, value, tolerance) in &wanted {
        match read.iter().find(|(known, _)| known == name) {
            None => found.push(format!("{}.{name} is not read", described.name)),
            Some((_, got)) if (got - value).abs() > *tolerance => {
                found.push(format!("{}.{name}: wanted {value}, got {got} from {}", described.name, hex(frame.data())));
            }
            Some(_) => {}
        }
    }
    let unwanted = read.iter().filter(|(name, _)| !wanted.iter().any(|(known, ..)| known == name));
    found.extend(unwanted.map(|(name, _)| format!("{}.{name} is read, unasked", described.name)));
    found
}

/// Returns all differences of many random messages, CAN FD and classic.
fn all_differences(dbc: &Dbc) -> Vec<String> {
    let mut samples = Samples::new(7);
    let mut found = Vec::new();
    for _ in 0..MESSAGES {
        let message = samples.message();
        for format in [Format::Fd, Format::Classic] {
            if let Ok(frames) = can::encode(&message, format, &IdMap::default()) {
                found.extend(frames.iter().flat_map(|frame| differences(dbc, &message, frame)));
            }
        }
    }
    found
}

#[test]
fn every_field_of_random_messages_is_read_as_it_was_meant() {
    let found = all_differences(&dbc());
    assert!(found.is_empty(), "{} differ:\n{}", found.len(), found[..found.len().min(10)].join("\n"));
}

/// Negative control: whichever signal is moved, scaled or retyped, some message shows it.
#[test]
fn every_spoiled_signal_is_noticed() {
    let good = dbc();
    for (i, message) in good.messages.iter().enumerate() {
        for j in 0..message.signals.len() {
            let mut dbc = good.clone();
            let signal = &mut dbc.messages[i].signals[j];
            if signal.start_bit + signal.size < 8 * message.size {
                signal.start_bit += 1
            } else {
                signal.factor *= 2.0
            };
            assert!(!all_differences_of(&dbc, i).is_empty(), "{}.{} moved", message.name, message.signals[j].name);
        }
    }
    let mut dbc = good;
    dbc.signal_extended_value_type_list.clear();
    assert!(!all_differences(&dbc).is_empty(), "floats read as integers");
}

/// Returns the same as [`all_differences`], of one message only and fewer samples.
fn all_differences_of(dbc: &Dbc, index: usize) -> Vec<String> {
    let id = raw(&dbc.messages[index].id);
    let mut samples = Samples::new(8);
    let mut found = Vec::new();
    for _ in 0..MESSAGES {
        let message = samples.message();
        for format in [Format::Fd, Format::Classic] {
            let Ok(frames) = can::encode(&message, format, &IdMap::default()) else {
                continue;
            };
            for frame in frames.iter().filter(|frame| frame.id() == id) {
                found.extend(differences(dbc, &message, frame));
            }
        }
        if !found.is_empty() {
            break;
        }
    }
    found
}

#[test]
fn identifiers_lengths_and_formats_are_those_of_the_crate() {
    let dbc = dbc();
    let described: Vec<_> = dbc.messages.iter().map(|message| (raw(&message.id), message.size)).collect();
    let ids = IdMap::default();
    let known: Vec<_> = MessageId::ALL.iter().map(|id| (ids.id(*id), id.len_bytes() as u64)).collect();
    assert_eq!(described, known, "in the order of the identifiers");
    for message in &dbc.messages {
        let wanted = if message.size > 8 { FD_FORMAT } else { 0.0 };
        assert_eq!(attribute(&dbc, "VFrameFormat", &message.id), wanted, "{}", message.name);
    }
}

#[test]
fn every_message_and_signal_is_explained_and_has_a_sane_range() {
    let dbc = dbc();
    let comments: BTreeSet<_> = dbc.comments.iter().map(|comment| format!("{comment:?}")).collect();
    let explains = |id: &DbcId, signal: Option<&str>| {
        comments.iter().any(|comment| {
            let names_signal =
                signal.map_or(!comment.contains("signal_name"), |signal| comment.contains(&format!("{signal:?}")));
            comment.contains(&format!("{id:?}")) && names_signal
        })
    };
    for message in &dbc.messages {
        assert!(explains(&message.id, None), "{}", message.name);
        for signal in &message.signals {
            let place = format!("{}.{}", message.name, signal.name);
            assert!(explains(&message.id, Some(&signal.name)), "{place} has no comment");
            assert!(signal.start_bit + signal.size <= 8 * message.size, "{place} does not fit");
            assert!(number(&signal.min) < number(&signal.max), "{place} has no range");
        }
    }
    assert!(!explains(&dbc.messages[0].id, Some("Nothing")), "control");
}

pub(crate) fn number(value: &NumericValue) -> f64 {
    match value {
        NumericValue::Uint(value) => *value as f64,
        NumericValue::Int(value) => *value as f64,
        NumericValue::Double(value) => *value,
    }
}

/// No two signals that are read from the same payload share a bit.
#[test]
fn signals_do_not_overlap() {
    let dbc = dbc();
    let mut samples = Samples::new(9);
    for _ in 0..MESSAGES {
        let message = samples.message();
        for format in [Format::Fd, Format::Classic] {
            let Ok(frames) = can::encode(&message, format, &IdMap::default()) else {
                continue;
            };
            for frame in frames.iter() {
                let described = dbc.messages.iter().find(|described| raw(&described.id) == frame.id()).unwrap();
                let mut taken = BTreeSet::new();
                for signal in described.signals.iter().filter(|signal| is_active(&dbc, described, signal, frame.data()))
                {
                    for bit in signal.start_bit..signal.start_bit + signal.size {
                        assert!(taken.insert(bit), "{}.{}: bit {bit}", described.name, signal.name);
                    }
                }
            }
        }
    }
}

/// Names of values, as the DBC has them, and as the crate has them.
#[test]
fn enumerations_have_the_names_of_the_crate() {
    let text = crate::text("dbc/starloop.dbc");
    let names = |start: &str| {
        let line = text.lines().find(|line| line.starts_with(start)).unwrap_or_else(|| panic!("no {start}"));
        let mut names: Vec<_> = line.split('"').skip(1).step_by(2).map(str::to_owned).collect();
        names.reverse();
        names
    };
    let debug = |all: &[&dyn std::fmt::Debug]| all.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>();
    let rejects: Vec<&dyn std::fmt::Debug> = Reject::ALL.iter().map(|reason| reason as _).collect();
    assert_eq!(names("VAL_ 400 Reason"), debug(&rejects));
    let refusals: Vec<&dyn std::fmt::Debug> = Refusal::ALL.iter().map(|reason| reason as _).collect();
    assert_eq!(names("VAL_ 1408 Code")[1..], debug(&refusals)[..]);
    let tables: Vec<&dyn std::fmt::Debug> = Table::ALL.iter().map(|table| table as _).collect();
    assert_eq!(names("VAL_ 1152 TableNumber"), debug(&tables));
    let kinds: Vec<&dyn std::fmt::Debug> = CameraKind::ALL.iter().map(|kind| kind as _).collect();
    assert_eq!(names("VAL_ 1536 CameraKind"), debug(&kinds));
    assert_eq!(names("VAL_ 1408 CameraKind"), debug(&kinds));
    let starts: Vec<&dyn std::fmt::Debug> = StartedBy::ALL.iter().map(|source| source as _).collect();
    assert_eq!(names("VAL_ 416 StartedBy"), debug(&starts));
}

/// Returns places of the kit that name a version: what each says, and what the crate says.
fn named_versions(dbc: &str, header: &str, document: &str) -> Vec<(String, String)> {
    let version = format!("{}.{}", version::MAJOR, version::MINOR);
    let between = |text: &str, start: &str, end: &str| {
        let rest = text.split_once(start).unwrap_or_else(|| panic!("no {start}")).1;
        rest.split_once(end).unwrap().0.to_owned()
    };
    let said = [
        between(dbc, "VERSION \"", "\""),
        between(dbc, "stimulator, protocol ", ","),
        between(header, "stimulator, protocol ", ","),
        between(document, "stimulator, protocol ", "\n"),
    ];
    let minor = between(header, "#define SL_MINOR ", "\n");
    said.map(|said| (said, version.clone())).into_iter().chain([(minor, version::MINOR.to_string())]).collect()
}

#[test]
fn every_file_of_the_kit_names_the_version_of_the_crate() {
    let [dbc, header, document] = ["dbc/starloop.dbc", "c/starloop_protocol.h", "INTERFACE.md"].map(crate::text);
    for (said, wanted) in named_versions(&dbc, &header, &document) {
        assert_eq!(said, wanted);
    }
    // Negative control: the version that the DBC file said for too long.
    let wrong = dbc.replacen(&format!("VERSION \"1.{}\"", version::MINOR), "VERSION \"1.2\"", 1);
    let differ = named_versions(&wrong, &header, &document).into_iter().filter(|(said, wanted)| said != wanted);
    assert_eq!(differ.count(), 1);
}

#[test]
fn the_checksum_of_the_file_is_the_one_that_info_reports() {
    let bytes = std::fs::read(crate::kit().join("dbc/starloop.dbc")).unwrap();
    assert_eq!(firmware_protocol::DBC_CRC32, crc32fast::hash(&bytes));
    assert_ne!(firmware_protocol::DBC_CRC32, crc32fast::hash(&bytes[1..]), "control");
}
