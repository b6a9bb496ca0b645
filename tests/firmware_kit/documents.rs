//! INTERFACE.md against the crate and the DBC; vectors.json against the program that made it.

use crate::dbc::{attribute, dbc, number, raw};
use crate::vectors::bytes;
use can_dbc::{Dbc, Message as Described, MultiplexIndicator, Signal};
use firmware_protocol::can::{CanFrame, Decoder, IdMap};
use firmware_protocol::message::{AttitudeFlags, MessageId, Refusal, Reply, Table};
use firmware_protocol::tables::{self, LineRow, TableStore};
use firmware_protocol::{Message, Reject, serial};
use std::{collections::BTreeMap, ops::Range, process::Command};

/// Returns cells of every table row between this heading and the next of the same or a higher level.
fn rows(text: &str, heading: &str) -> Vec<Vec<String>> {
    let level = heading.chars().take_while(|c| *c == '#').count();
    let is_end = |line: &&str| {
        let depth = line.chars().take_while(|c| *c == '#').count();
        depth == 0 || depth > level
    };
    let body = text.lines().skip_while(|line| *line != heading).skip(1).take_while(is_end);
    let cells = |line: &str| line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    let rows: Vec<_> = body.filter(|line| line.starts_with('|') && !line.starts_with("|---")).map(cells).collect();
    assert!(!rows.is_empty(), "no table under `{heading}`");
    rows
}

fn interface() -> String {
    crate::text("INTERFACE.md")
}

/// Returns the rows of the table of messages that differ from crate and DBC.
fn wrong_messages(text: &str) -> Vec<String> {
    let dbc = dbc();
    // The first table of section 2 has six columns, the byte tables fewer.
    let rows = rows(text, "## 2. Messages").into_iter().filter(|row| row.len() == 6 && row[0].starts_with("`0x"));
    let reported: Vec<_> = rows.map(|row| row[..5].join(" ")).collect();
    let wanted = MessageId::ALL.map(|id| {
        let described = dbc.messages.iter().find(|message| raw(&message.id) == IdMap::default().id(id)).unwrap();
        let digits = format!("{:02X}", id.number());
        let node = if id == MessageId::Sync { "0" } else { "n" };
        let (name, sender) = (&described.name, described.transmitter.as_deref().unwrap());
        let cycle_ms = attribute(&dbc, "GenMsgCycleTime", &described.id);
        format!("`0x{digits}{node}` {name} {} {sender} {cycle_ms}", id.len_bytes())
    });
    let missing = wanted.iter().filter(|row| !reported.contains(row)).map(|row| format!("lacks {row}"));
    let extra = reported.iter().filter(|row| !wanted.contains(row)).map(|row| format!("has {row}"));
    missing.chain(extra).collect()
}

/// Returns bits of `4`, `0..4` (bytes) or `0..63` (bits).
fn bit_range(text: &str, bits_per_unit: u64) -> Range<u64> {
    let (start, end): (u64, u64) = match text.split_once("..") {
        Some((start, end)) => (start.parse().unwrap(), end.parse().unwrap()),
        None => (text.parse().unwrap(), text.parse::<u64>().unwrap() + 1),
    };
    start * bits_per_unit..end * bits_per_unit
}

/// Returns the page or opcode under which a signal is read; `all` without one.
fn branch_of(dbc: &Dbc, message: &Described, signal: &Signal) -> String {
    let parent = dbc.extended_multiplex.iter().find_map(|entry| {
        let is_own = entry.message_id == message.id && entry.signal_name == signal.name;
        is_own.then(|| message.signals.iter().find(|other| other.name == entry.multiplexor_signal_name)).flatten()
    });
    match (signal.multiplexer_indicator, parent.map(|parent| (parent, parent.multiplexer_indicator))) {
        (_, Some((parent, MultiplexIndicator::MultiplexorAndMultiplexedSignal(_)))) => branch_of(dbc, message, parent),
        (MultiplexIndicator::MultiplexedSignal(value), _)
        | (MultiplexIndicator::MultiplexorAndMultiplexedSignal(value), _) => value.to_string(),
        (MultiplexIndicator::Plain | MultiplexIndicator::Multiplexor, _) => "all".into(),
    }
}

/// Returns the byte tables whose rows leave gaps, or cut a signal of the DBC in two.
fn wrong_layouts(text: &str) -> Vec<String> {
    let dbc = dbc();
    let mut found = Vec::new();
    for message in &dbc.messages {
        let table = rows(text, &format!("### {}", message.name));
        let (head, body) = table.split_first().unwrap();
        let place = head.iter().position(|cell| cell == "byte" || cell == "bit").unwrap();
        let unit = if head[place] == "byte" { 8 } else { 1 };
        let mut branches = BTreeMap::<&str, Vec<Range<u64>>>::new();
        for row in body {
            let branch = if place == 0 { "all" } else { row[0].as_str() };
            branches.entry(branch).or_default().push(bit_range(&row[place], unit));
        }
        for signal in message.signals.iter().filter(|signal| signal.name != "Page" || message.name != "STATUS") {
            let bits = signal.start_bit..signal.start_bit + signal.size;
            let own = branch_of(&dbc, message, signal);
            let ranges = ["all", &own].into_iter().filter_map(|branch| branches.get(branch)).flatten();
            if !ranges.into_iter().any(|range| range.start <= bits.start && bits.end <= range.end) {
                found.push(format!("{}.{} lies in no row", message.name, signal.name));
            }
        }
        for (branch, ranges) in &branches {
            let is_contiguous = ranges.windows(2).all(|pair| pair[0].end == pair[1].start);
            let reaches_end = ranges.last().unwrap().end.div_ceil(8) == message.size;
            // The pages of STATUS and the opcodes have reserved bytes in between.
            if place == 0 && !(is_contiguous && reaches_end && ranges[0].start == 0) {
                found.push(format!("{}, {branch}: rows {ranges:?}", message.name));
            }
        }
    }
    found
}

/// Returns lines of the worked example in order: identifier and bytes, or a serial packet.
fn example(text: &str) -> Vec<(Option<u16>, Vec<u8>)> {
    let body = text.lines().skip_while(|line| !line.starts_with("## 8.")).take_while(|line| !line.starts_with("## 9."));
    let inside = body.scan(false, |is_code, line| {
        *is_code ^= line.starts_with("```");
        Some((*is_code && !line.starts_with("```")).then_some(line))
    });
    let read = |line: &str| {
        let (start, hex) = line.split_once("  ").unwrap();
        (u16::from_str_radix(start, 16).ok(), bytes(&hex.replace(' ', "")))
    };
    inside.flatten().map(read).collect()
}

#[test]
fn messages_and_layouts_are_those_of_crate_and_dbc() {
    let text = interface();
    assert_eq!(wrong_messages(&text), Vec::<String>::new());
    assert_eq!(wrong_layouts(&text), Vec::<String>::new());
}

#[test]
fn the_worked_example_says_what_the_text_says() {
    let mut decoder = Decoder::new(IdMap::default());
    let mut messages = Vec::new();
    for (id, data) in example(&interface()) {
        let Some(id) = id else {
            messages.push(serial::Decoder::new().read(&mut &data[..]).unwrap().unwrap());
            continue;
        };
        let frame = CanFrame::classic(id, &data).or_else(|| CanFrame::fd(id, &data)).unwrap();
        // The FD form has the sequence number of the group: another decoder, as if on another bus.
        let mut fresh = Decoder::new(IdMap::default());
        let reader = if frame.is_fd() { &mut fresh } else { &mut decoder };
        messages.extend(reader.read(&frame).unwrap());
    }
    let attitudes: Vec<_> =
        messages.iter().filter_map(|m| if let Message::Attitude(record) = m { Some(record) } else { None }).collect();
    assert_eq!(attitudes.len(), 3, "classic, FD, serial");
    let half_rad = 2.5_f64.to_radians();
    for record in attitudes {
        assert_eq!((record.t_us, record.seq), (1_000_000, 7));
        assert_eq!(record.flags, AttitudeFlags { rate: true, acceleration: false });
        assert_eq!(record.q_wxyz.map(f64::from)[..2], [half_rad.cos(), -half_rad.sin()].map(|v| f64::from(v as f32)));
        assert!((f64::from(record.rate_rad_s[0]) - 0.5_f64.to_radians()).abs() < 0.5e-6);
    }
    let mut store = TableStore::new();
    let cells: Vec<_> = messages.iter().filter(|m| matches!(m, Message::Table(_))).collect();
    for message in &messages {
        if let Message::Table(cell) = message {
            store.put(cell);
        }
    }
    assert_eq!(cells.len(), 10);
    assert_eq!(store.apply(1, 2, 0xA896, 0).unwrap().rows, 2);
    let first = LineRow { frequency_hz: 42.0, amplitude_xyz_arcsec: [0.5, 0.25, 0.0], phase_rad: 0.0 };
    assert_eq!(store.lines().next(), Some(first));
    let Some(Message::Response(last)) = messages.last() else { panic!("ends with RSP") };
    assert!(matches!(last.reply, Reply::Applied(applied) if applied.rows == 2));
}

/// Returns the node of a CANopen identifier of the predefined connection set (CiA 301); 0 for what belongs to the
/// network.
fn canopen_node(id: u16) -> Option<u16> {
    const FUNCTIONS: [u16; 12] = [0x080, 0x180, 0x200, 0x280, 0x300, 0x380, 0x400, 0x480, 0x500, 0x580, 0x600, 0x700];
    // NMT, SYNC, TIME, LSS.
    if [0x000, 0x080, 0x100, 0x7E4, 0x7E5].contains(&id) {
        return Some(0);
    }
    FUNCTIONS.iter().find_map(|function| id.checked_sub(*function).filter(|node| (1..=127).contains(node)))
}

/// Returns the CANopen nodes whose identifiers, or the network's, none of our nodes uses at this base; as in the
/// document.
fn clear_of_canopen(base: u16) -> String {
    let ids = (0..16).map(|node| IdMap::new(base, node).unwrap());
    let used: Vec<_> =
        ids.flat_map(|map| MessageId::ALL.map(|id| map.id(id).parts().0)).filter_map(canopen_node).collect();
    if used.contains(&0) {
        return "none".into();
    }
    let clear: Vec<_> = (1..=127).filter(|node| !used.contains(node)).collect();
    let runs = clear.chunk_by(|a, b| a + 1 == *b);
    runs.map(|run| format!("{} to {}", run[0], run[run.len() - 1])).collect::<Vec<_>>().join(", ")
}

#[test]
fn bases_beside_canopen_are_clear_of_the_nodes_that_the_document_names() {
    let text = interface();
    let documented: Vec<_> = rows(&text, "## 2. Messages").into_iter().filter(|row| row.len() == 2).collect();
    let wanted = (1..8).map(|i| vec![format!("0x{:03X}", 16 * i), clear_of_canopen(16 * i)]);
    assert_eq!(documented[1..], wanted.collect::<Vec<_>>());
    // The default shares the SYNC of CANopen; so do 0x080 (its TIME) and 0x0E0 (its LSS), which the document leaves
    // out.
    assert_eq!([0x000, 0x080, 0x0E0].map(clear_of_canopen), ["none", "none", "none"]);
}

/// Returns `CODE NAME` of a table's rows.
fn coded(text: &str, heading: &str) -> Vec<String> {
    let is_coded = |row: &Vec<String>| row[0].parse::<u8>().is_ok();
    rows(text, heading).iter().filter(|row| is_coded(row)).map(|row| format!("{} {}", row[0], row[1])).collect()
}

#[test]
fn every_reason_and_refusal_is_reported_with_its_code() {
    let text = interface();
    let rejects: Vec<_> = Reject::ALL.iter().map(|reason| format!("{} {reason:?}", reason.code())).collect();
    assert_eq!(coded(&text, "## 9. What is refused"), rejects);
    let refusals: Vec<_> = Refusal::ALL.iter().map(|reason| format!("{} {reason:?}", reason.code())).collect();
    assert_eq!(coded(&text, "## 6. Commands"), refusals);
}

fn is_word(text: &str) -> bool {
    text.starts_with(char::is_alphabetic)
}

/// Rows, columns and limits of section 7 as the crate has them; the DBC's ranges too.
#[test]
fn tables_have_the_limits_of_the_crate() {
    let text = interface();
    let reported = rows(&text, "## 7. Parameter tables of jitter");
    let dbc = dbc();
    for table in Table::ALL {
        let own: Vec<_> = reported.iter().filter(|row| row[0].starts_with(&table.number().to_string())).collect();
        assert!(own.iter().all(|row| row[1] == table.rows_max().to_string()), "{table:?}: rows");
        // `1, 2, 3 amplitude about body x, y, z`: the numbers before the first word.
        let columns = own.iter().flat_map(|row| row[2].split([' ', ',']).take_while(|word| !is_word(word)));
        let columns: Vec<u8> = columns.filter_map(|number| number.parse().ok()).collect();
        assert_eq!(columns, (0..table.columns()).collect::<Vec<_>>(), "{table:?}: columns");
    }
    for (signal, limit) in [
        ("LineFrequency", tables::FREQUENCY_MAX_HZ),
        ("PsdFrequency", tables::FREQUENCY_MAX_HZ),
        ("LineAmplitudeX", tables::AMPLITUDE_MAX_ARCSEC),
        ("HarmonicAmplitudeZ", tables::AMPLITUDE_MAX_ARCSEC),
        ("LinePhase", tables::PHASE_MAX_RAD),
        ("HarmonicPhase", tables::PHASE_MAX_RAD),
        ("HarmonicNumber", tables::HARMONIC_MAX),
        ("HarmonicExponent", tables::EXPONENT_MAX),
    ] {
        let found = dbc.messages.iter().flat_map(|message| &message.signals).find(|known| known.name == signal);
        assert!((number(&found.unwrap().max) - f64::from(limit)).abs() < 1e-6, "{signal}");
    }
    for limit in [tables::FREQUENCY_MAX_HZ, tables::AMPLITUDE_MAX_ARCSEC, tables::HARMONIC_MAX, tables::EXPONENT_MAX] {
        assert!(reported.iter().any(|row| row[4].ends_with(&format!("to {limit}"))), "{limit}");
    }
}

/// Negative control: one digit of the document changed.
#[test]
fn a_wrong_document_is_noticed() {
    let text = interface();
    for (right, wrong) in
        [("| ATT_FD | 48 |", "| ATT_FD | 44 |"), ("`0x28n`", "`0x29n`"), ("| 100 | all |", "| 50 | all |")]
    {
        assert!(text.contains(right));
        assert!(!wrong_messages(&text.replacen(right, wrong, 1)).is_empty(), "{wrong}");
    }
    for (right, wrong) in [
        ("| 2..6 | u32 | middle", "| 2..5 | u32 | middle"),
        ("| 8..24 | f32", "| 8..25 | f32"),
        ("| 4..6 | u16 | CRC", "| 4..5 | u16 | CRC"),
    ] {
        assert_eq!(text.matches(right).count(), 1, "{right}");
        assert!(!wrong_layouts(&text.replace(right, wrong)).is_empty(), "{wrong}");
    }
    assert!(example(&text).len() > 15);
}

#[test]
fn vectors_are_what_their_program_makes() {
    let Ok(output) = Command::new("python3").arg("-B").arg(crate::kit().join("vectors.py")).output() else {
        println!("SKIPPED: no python3, so vectors.py was not run");
        return;
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(
        String::from_utf8(output.stdout).unwrap(),
        crate::text("vectors.json"),
        "python3 vectors.py > vectors.json"
    );
}
