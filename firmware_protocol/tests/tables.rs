//! Upload of parameter tables: only whole, matching, legal tables take effect, and a refusal leaves what was.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use firmware_protocol::handshake::{Answer, Did, Handshake};
use firmware_protocol::message::{
    Command, Identity, Rates, Refusal, Reply, Request, Response, Table, TableCell, capability,
};
use firmware_protocol::tables::{self, Applied, HarmonicRow, LineRow, PsdRow, Row, TableStore};
use firmware_protocol::version::{self, Version};
use firmware_protocol::{Message, MessageId};

fn line(frequency_hz: f32) -> LineRow {
    LineRow { frequency_hz, amplitude_xyz_arcsec: [0.5, -1.0, 0.0], phase_rad: 0.25 }
}

fn psd(frequency_hz: f32) -> PsdRow {
    PsdRow { frequency_hz, density_xyz_arcsec2_hz: [0.5, 0.0, 2.0] }
}

fn harmonic(wheel: u8) -> HarmonicRow {
    HarmonicRow { wheel, harmonic: 2.8, amplitude_xyz_arcsec: [0.1, 0.2, -0.3], exponent: 2.0, phase_rad: -1.0 }
}

fn upload<R: Row>(store: &mut TableStore, rows: &[R]) {
    tables::cells(rows).for_each(|cell| store.put(&cell));
}

/// Uploads and applies.
fn outcome<R: Row>(rows: &[R]) -> Result<Applied, Refusal> {
    let mut store = TableStore::new();
    upload(&mut store, rows);
    store.apply(R::TABLE.number(), u8::try_from(rows.len()).unwrap(), tables::crc(rows), 7)
}

#[test]
fn rows_come_out_as_they_went_in() {
    let lines: Vec<_> = (1..=32_u8).map(|i| line(f32::from(i))).collect();
    let points: Vec<_> = (1..=32_u8).map(|i| psd(f32::from(i))).collect();
    let harmonics: Vec<_> = (0..64_u8).map(|i| harmonic(i % 4)).collect();
    let mut store = TableStore::new();
    upload(&mut store, &lines);
    upload(&mut store, &points);
    upload(&mut store, &harmonics);
    assert_eq!(store.lines().count() + store.psd().count() + store.harmonics().count(), 0, "nothing before APPLY");
    let applied = |table, rows| Ok(Applied { table, rows });
    assert_eq!(store.apply(1, 32, tables::crc(&lines), 0), applied(Table::Lines, 32));
    assert_eq!(store.apply(2, 32, tables::crc(&points), 0xABCD), applied(Table::Psd, 32));
    assert_eq!(store.apply(3, 64, tables::crc(&harmonics), 0), applied(Table::WheelHarmonics, 64));
    assert!(store.lines().eq(lines) && store.psd().eq(points) && store.harmonics().eq(harmonics));
    assert_eq!(store.psd_seed(), 0xABCD);
}

#[test]
fn cells_may_come_in_any_order_and_change_one_by_one() {
    let mut store = TableStore::new();
    let rows = [line(3.0), line(1.0)];
    let mut cells: Vec<_> = tables::cells(&rows).collect();
    assert_eq!(cells.len(), 10);
    cells.reverse();
    cells.iter().for_each(|cell| store.put(cell));
    store.apply(1, 2, tables::crc(&rows), 0).unwrap();
    let changed = [rows[0], line(9.0)];
    store.put(&TableCell { table: Table::Lines, row: 1, column: 0, value: 9.0 });
    assert!(store.lines().eq(rows), "in effect until the next APPLY");
    store.apply(1, 2, tables::crc(&changed), 0).unwrap();
    assert!(store.lines().eq(changed));
}

#[test]
fn a_missing_cell_another_crc_and_too_many_rows_leave_what_was() {
    let mut store = TableStore::new();
    let rows = [line(1.0), line(2.0)];
    upload(&mut store, &rows);
    store.apply(1, 2, tables::crc(&rows), 0).unwrap();
    for (table, count, crc, wanted) in [
        (1, 3, tables::crc(&rows), Refusal::TableIncomplete),
        (1, 2, tables::crc(&rows) ^ 1, Refusal::TableCrc),
        (1, 1, tables::crc(&rows), Refusal::TableCrc),
        (1, 33, 0, Refusal::TableValue),
        (2, 33, 0, Refusal::TableValue),
        (3, 65, 0, Refusal::TableValue),
        (0, 1, 0, Refusal::TableValue),
        (4, 1, 0, Refusal::TableValue),
    ] {
        assert_eq!(store.apply(table, count, crc, 0), Err(wanted), "table {table}, {count} rows");
        assert!(store.lines().eq(rows), "as before");
    }
}

#[test]
fn no_rows_clear_the_table_and_its_cells() {
    let mut store = TableStore::new();
    let rows = [psd(1.0), psd(2.0)];
    upload(&mut store, &rows);
    store.apply(2, 2, tables::crc(&rows), 5).unwrap();
    assert_eq!(store.apply(2, 0, 0, 9), Ok(Applied { table: Table::Psd, rows: 0 }));
    assert_eq!((store.psd().count(), store.psd_seed()), (0, 0));
    assert_eq!(store.apply(2, 2, tables::crc(&rows), 5), Err(Refusal::TableIncomplete));
}

#[test]
fn illegal_lines_are_refused_on_both_sides_of_each_limit() {
    let refused = Err(Refusal::TableValue);
    let with = |change: fn(&mut LineRow)| {
        let mut row = line(1.0);
        change(&mut row);
        outcome(&[line(1.0), row])
    };
    assert!(with(|_| {}).is_ok(), "control");
    assert_eq!(with(|row| row.frequency_hz = 0.0), refused);
    assert_eq!(with(|row| row.frequency_hz = -1.0), refused);
    assert!(with(|row| row.frequency_hz = 10_000.0).is_ok());
    assert_eq!(with(|row| row.frequency_hz = 10_001.0), refused);
    assert!(with(|row| row.amplitude_xyz_arcsec[2] = -3600.0).is_ok());
    assert_eq!(with(|row| row.amplitude_xyz_arcsec[2] = -3601.0), refused);
    assert!(with(|row| row.phase_rad = -core::f32::consts::TAU).is_ok());
    assert_eq!(with(|row| row.phase_rad = 6.3), refused);
    assert_eq!(with(|row| row.phase_rad = f32::NAN), refused, "no decoder lets it this far");
}

#[test]
fn illegal_densities_and_harmonics_are_refused_on_both_sides_of_each_limit() {
    let refused = Err(Refusal::TableValue);
    assert!(outcome(&[psd(1.0), psd(1.5)]).is_ok(), "control");
    assert_eq!(outcome(&[psd(1.0)]), refused, "one point spans nothing");
    assert_eq!(outcome(&[psd(1.0), psd(1.0)]), refused, "not rising");
    assert_eq!(outcome(&[psd(2.0), psd(1.0)]), refused, "falling");
    assert_eq!(outcome(&[psd(0.0), psd(1.0)]), refused, "zero has no logarithm");
    let negative = PsdRow { density_xyz_arcsec2_hz: [0.0, -0.0001, 0.0], ..psd(2.0) };
    assert_eq!(outcome(&[psd(1.0), negative]), refused);
    let with = |change: fn(&mut HarmonicRow)| {
        let mut row = harmonic(3);
        change(&mut row);
        outcome(&[row])
    };
    assert!(with(|_| {}).is_ok(), "control");
    assert_eq!(with(|row| row.wheel = 4), refused);
    assert_eq!(with(|row| row.harmonic = 0.0), refused);
    assert!(with(|row| row.harmonic = 1000.0).is_ok());
    assert_eq!(with(|row| row.harmonic = 1000.1), refused);
    assert!(with(|row| row.exponent = 4.0).is_ok() && with(|row| row.exponent = 0.0).is_ok());
    assert_eq!(with(|row| row.exponent = 4.1), refused);
    assert_eq!(with(|row| row.exponent = -0.1), refused);
    assert_eq!(with(|row| row.amplitude_xyz_arcsec[0] = 3601.0), refused);
    let mut store = TableStore::new();
    upload(&mut store, &[harmonic(1)]);
    store.put(&TableCell { table: Table::WheelHarmonics, row: 0, column: 0, value: 1.5 });
    let values: Vec<u8> =
        [1.5, 2.8, 0.1, 0.2, -0.3, 2.0, -1.0_f32].iter().flat_map(|value| value.to_le_bytes()).collect();
    assert_eq!(store.apply(3, 1, firmware_protocol::crc::crc16(&values), 0), refused, "half a wheel");
}

#[test]
fn a_cell_outside_its_table_is_left_out() {
    let mut store = TableStore::new();
    let rows = [line(1.0)];
    upload(&mut store, &rows);
    store.put(&TableCell { table: Table::Lines, row: 32, column: 0, value: 5.0 });
    store.put(&TableCell { table: Table::Lines, row: 0, column: 5, value: 5.0 });
    assert!(store.apply(1, 1, tables::crc(&rows), 0).is_ok());
    assert!(store.lines().eq(rows));
}

fn peer(capabilities: u16) -> Handshake {
    Handshake::new(0, Rates { attitude_hz: 100, jitter_hz: 1000 }).with_capabilities(capabilities)
}

fn hello(minor: u8) -> Command {
    Command { token: 1, request: Request::Hello(Version { major: version::MAJOR, minor }) }
}

#[test]
fn apply_is_done_once_and_answered_each_time() {
    let (mut handshake, mut store) = (peer(capability::PARAMETER_TABLES), TableStore::new());
    let rows = [line(1.0)];
    upload(&mut store, &rows);
    let request = Request::Apply { table: 1, rows: 1, crc: tables::crc(&rows), seed: 0 };
    let refused = |reason| Reply::Refused { opcode: 5, reason };
    let early = handshake.answer(&Command { token: 9, request }, &mut store);
    assert_eq!((early.response.reply, early.did), (refused(Refusal::NoHandshake), None));
    handshake.answer(&hello(1), &mut store);
    let apply = Command { token: 2, request };
    let first = handshake.answer(&apply, &mut store);
    let applied = Applied { table: Table::Lines, rows: 1 };
    assert_eq!(first.response, Response { token: 2, reply: Reply::Applied(applied) });
    assert_eq!(first.did, Some(Did::Applied(Table::Lines)));
    // Cells of the next upload are coming in; the retry is late and must not touch them.
    store.put(&TableCell { table: Table::Lines, row: 0, column: 0, value: 2.0 });
    assert_eq!(handshake.answer(&apply, &mut store), Answer { did: None, ..first });
    assert!(store.lines().eq(rows), "not done twice");
    let again = handshake.answer(&Command { token: 3, request }, &mut store);
    assert_eq!((again.response.reply, again.did), (refused(Refusal::TableCrc), None), "control: a new token is new");
    let clear = Request::Apply { table: 1, rows: 0, crc: 0, seed: 0 };
    let cleared = handshake.answer(&Command { token: 4, request: clear }, &mut store);
    assert_eq!(cleared.did, Some(Did::Applied(Table::Lines)));
}

#[test]
fn a_peer_of_1_0_works_as_before() {
    let mut store = TableStore::new();
    // A 1.0 flight computer says 1.0 and reads major, minor, capabilities and convention at the same places.
    let mut handshake = peer(0x7);
    let answer = handshake.answer(&hello(0), &mut store);
    let identity = Identity { version: Version { major: 1, minor: 4 }, capabilities: 7, attitude_convention: 1 };
    assert_eq!(answer.response.reply, Reply::Hello(identity));
    assert_eq!(Message::Response(answer.response).payload().unwrap().as_slice(), [1, 1, 0, 1, 4, 7, 0, 1]);
    let run = Command { token: 2, request: Request::Run };
    assert_eq!(handshake.answer(&run, &mut store).response.reply, Reply::Run);
    // A stimulator without tables answers APPLY as 1.0 does: an unknown opcode, which this version can read.
    let mut without = peer(0);
    without.answer(&hello(1), &mut store);
    let apply = Command { token: 3, request: Request::Apply { table: 1, rows: 0, crc: 0, seed: 0 } };
    let response = without.answer(&apply, &mut store).response;
    assert_eq!(response.reply, Reply::Refused { opcode: 5, reason: Refusal::UnknownOpcode });
    let bytes = [5, 3, 1, 0, 0, 0, 0, 0];
    assert_eq!(Message::from_payload(MessageId::Response, &bytes), Ok(Message::Response(response)));
}
