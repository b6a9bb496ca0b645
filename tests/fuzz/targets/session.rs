//! Commands and table cells in any order -> the answers, the state and the effective tables of a simple model.

#![no_main]

use firmware_protocol::handshake::{Answer, Did, Handshake, Takes};
use firmware_protocol::message::{
    CameraSet, CameraSetting, CameraTrigger, CameraTriggered, Command, Info, Rates, Refusal, Reply, Request, Response,
    Table, TableCell, Trigger, Triggered, capability,
};
use firmware_protocol::tables::{Applied, Row, TableStore};
use firmware_protocol::version::{self, Version};
use firmware_protocol::{Message, MessageId};
use libfuzzer_sys::fuzz_target;
use starloop_fuzz::{Input, control, damage};
use std::collections::BTreeMap;

const DBC_CRC32: u32 = 0x1234_5678;
const RATES: Rates = Rates { attitude_hz: 100, jitter_hz: 1000 };

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    let has_tables = input.bool();
    let capabilities =
        if has_tables { capability::PARAMETER_TABLES } else { capability::TRIGGERS | capability::CAMERA };
    let mut handshake = Handshake::new(DBC_CRC32, RATES).with_capabilities(capabilities);
    let (mut store, mut model) = (TableStore::new(), Model { has_tables, ..Model::default() });
    while !input.is_empty() {
        match input.u8() % 8 {
            0..3 => {
                let cell = cell(&mut input);
                store.put(&cell);
                model.put(&cell);
            }
            3 => upload(&mut input, &mut |cell| {
                store.put(cell);
                model.put(cell);
            }),
            choice => {
                let command = command(choice, &model, &mut input);
                let fired_before = model.fired;
                let mut taker = Taker::default();
                let answer = handshake.answer_by(&command, &mut store, &mut taker);
                assert_eq!(answer, model.answer(&command), "to {command:?}");
                assert_eq!(taker.taken, model.fired - fired_before, "{command:?}: once, and not for a retry");
                assert_is_sent_whole(&answer.response);
            }
        }
        assert_eq!(handshake.is_running(), model.is_running);
        assert!(model.is_agreed || !handshake.is_running(), "running without agreement");
        assert_same_tables(&store, &model);
    }
});

// --- what is said ----------------------------------------------------------------------------------------------------

/// Returns values at both sides of every limit of every column.
fn value(input: &mut Input<'_>) -> f32 {
    const VALUES: [f32; 24] = [
        1.0,
        2.0,
        3.0,
        4.0,
        0.0,
        -0.0,
        0.5,
        -1.0,
        1e-9,
        4.000_001,
        6.283_185_5,
        6.283_186,
        -6.283_185_5,
        -6.283_186,
        1000.0,
        1_000.000_1,
        3600.0,
        3_600.000_3,
        -3600.0,
        10_000.0,
        10_000.001,
        f32::NAN,
        f32::INFINITY,
        f32::MAX,
    ];
    let choice = usize::from(input.u8());
    VALUES.get(choice % 32).copied().unwrap_or(choice as f32)
}

fn cell(input: &mut Input<'_>) -> TableCell {
    let table = Table::ALL[usize::from(input.u8()) % 3];
    // Small tables are completed more often; the store must bear rows and columns that no decoder gives.
    let (row, column) = (input.u8(), input.u8() % 8);
    TableCell { table, row: if row < 192 { row % 4 } else { row }, column, value: value(input) }
}

/// Uploads a few whole rows, mostly legal ones.
fn upload(input: &mut Input<'_>, put: &mut impl FnMut(&TableCell)) {
    let table = Table::ALL[usize::from(input.u8()) % 3];
    for row in 0..1 + input.u8() % 4 {
        for column in 0..table.columns() {
            let is_odd = input.u8() > 240;
            let value = if is_odd { value(input) } else { f32::from(row) + if column == 0 { 1.0 } else { 0.0 } };
            put(&TableCell { table, row, column, value });
        }
    }
}

fn command(choice: u8, model: &Model, input: &mut Input<'_>) -> Command {
    let token = input.u8() % 4;
    let request = match (choice, input.u8() % 8) {
        (4, _) => return model.last.map_or(Command { token, request: Request::Run }, |(command, _)| command),
        (5, _) => apply(model, input),
        (_, 0 | 1) => Request::Hello(Version { major: version::MAJOR, minor: input.u8() }),
        (_, 2) => Request::Hello(Version { major: input.u8(), minor: 0 }),
        (_, 3) => Request::Info { page: input.u8() % 4 },
        (_, 4 | 5) => Request::Run,
        (_, 6) => Request::Stop,
        _ => match input.u8() {
            0..=31 => Request::Camera(CameraSetting { kind: input.u8(), head: input.u8() % 4, value: input.u32() }),
            32..=63 => Request::CameraTrigger(CameraTrigger { head: input.u8() % 4, at_us: input.u32() }),
            64..=127 => Request::Trigger(Trigger { number: input.u16() % 4, at_us: input.u32() }),
            opcode => Request::Unknown { opcode: opcode.max(9) },
        },
    };
    Command { token, request }
}

/// Returns a stimulator that takes even numbers, finds 1 too far away, and has nothing that waits for 3.
fn fire(trigger: Trigger) -> Result<Triggered, Refusal> {
    let triggered = Triggered { number: trigger.number, is_late: trigger.at_us % 2 == 1 };
    match trigger.number % 4 {
        1 => Err(Refusal::TriggerTime),
        3 => Err(Refusal::UnknownTrigger),
        _ => Ok(triggered),
    }
}

/// Returns a camera that lacks head 1, and refuses head 3 for a reason of its own.
fn expose(head: u8) -> Result<(), Refusal> {
    match head {
        1 => Err(Refusal::UnknownHead),
        3 => Err(Refusal::CameraRange),
        _ => Ok(()),
    }
}

/// Counts what it takes in.
#[derive(Default)]
struct Taker {
    taken: u32,
}

impl Takes for Taker {
    fn trigger(&mut self, trigger: Trigger) -> Result<Triggered, Refusal> {
        self.taken += 1;
        fire(trigger)
    }

    fn camera(&mut self, setting: CameraSetting) -> Result<(), Refusal> {
        self.taken += 1;
        expose(setting.head)
    }

    fn camera_trigger(&mut self, trigger: CameraTrigger) -> Result<bool, Refusal> {
        self.taken += 1;
        expose(trigger.head).map(|()| trigger.at_us % 2 == 1)
    }
}

/// Returns APPLY, mostly with the right CRC.
fn apply(model: &Model, input: &mut Input<'_>) -> Request {
    let (number, rows, seed) = (input.u8(), input.u8(), input.u16());
    let table = if number < 250 { 1 + number % 3 } else { number };
    let rows = if rows < 250 { rows % 5 } else { rows };
    let crc = match (seed % 8, model.uploaded(table, rows)) {
        (1.., Some(values)) => crc_of(&values),
        _ => input.u16(),
    };
    Request::Apply { table, rows, crc, seed }
}

fn crc_of(values: &[f32]) -> u16 {
    damage::crc16(values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<_>>().iter())
}

// --- the model -------------------------------------------------------------------------------------------------------

/// Agreements of the two ends and uploaded tables, without any regard to size.
#[derive(Default)]
struct Model {
    has_tables: bool,
    is_agreed: bool,
    /// Minor version of the last HELLO.
    peer_minor: u8,
    is_running: bool,
    last: Option<(Command, Response)>,
    fired: u32,
    cells: BTreeMap<(u8, u8, u8), f32>,
    effective: BTreeMap<u8, Vec<f32>>,
    seed: u16,
}

impl Model {
    fn put(&mut self, cell: &TableCell) {
        if cell.row < cell.table.rows_max() && cell.column < cell.table.columns() {
            self.cells.insert((cell.table.number(), cell.row, cell.column), cell.value);
        }
    }

    /// Returns the values of rows `0..rows`, if all have come.
    fn uploaded(&self, table: u8, rows: u8) -> Option<Vec<f32>> {
        let columns = Table::from_number(table)?.columns();
        let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (table, row, column)));
        places.map(|place| self.cells.get(&place).copied()).collect()
    }

    /// Returns the answer of the model. Broken: a retry is done again.
    fn answer(&mut self, command: &Command) -> Answer {
        if let Some((last, response)) = self.last
            && last == *command
            && !control::is_broken()
        {
            return Answer { response, did: None };
        }
        let was_running = self.is_running;
        let reply = match self.reply(command.request) {
            Ok(reply) => reply,
            Err(reason) => Reply::Refused { opcode: command.request.opcode(), reason },
        };
        let did = match reply {
            Reply::Applied(applied) => Some(Did::Applied(applied.table)),
            Reply::Triggered(triggered) => Some(Did::Triggered(triggered)),
            Reply::CameraSet(_) | Reply::CameraTriggered(_) => Some(Did::Camera),
            _ if self.is_running && !was_running => Some(Did::Run),
            _ if was_running && !self.is_running => Some(Did::Stop),
            Reply::Hello(_) | Reply::Info(_) | Reply::Run | Reply::Stop | Reply::Refused { .. } => None,
        };
        let response = Response { token: command.token, reply };
        self.last = Some((*command, response));
        Answer { response, did }
    }

    fn reply(&mut self, request: Request) -> Result<Reply, Refusal> {
        match request {
            Request::Hello(peer) if peer.major == version::MAJOR => {
                (self.is_agreed, self.peer_minor) = (true, peer.minor);
                let capabilities = if self.has_tables { 1 } else { 24 };
                let bytes = [1, 0, 0, version::MAJOR, version::MINOR, capabilities, 0, 1];
                match Message::from_payload(MessageId::Response, &bytes) {
                    Ok(Message::Response(response)) => Ok(response.reply),
                    other => panic!("{other:?}"),
                }
            }
            Request::Hello(_) => {
                (self.is_agreed, self.is_running) = (false, false);
                Err(Refusal::WrongMajor)
            }
            Request::Info { page: 0 } => Ok(Reply::Info(Info::DbcCrc32(DBC_CRC32))),
            Request::Info { page: 1 } => Ok(Reply::Info(Info::Rates(RATES))),
            Request::Info { .. } => Err(Refusal::UnknownPage),
            Request::Stop => {
                self.is_running = false;
                Ok(Reply::Stop)
            }
            Request::Unknown { .. } => Err(Refusal::UnknownOpcode),
            Request::Apply { .. } if !self.has_tables => Err(Refusal::UnknownOpcode),
            Request::Trigger(_) | Request::Camera(_) | Request::CameraTrigger(_) if self.has_tables => {
                Err(Refusal::UnknownOpcode)
            }
            _ if !self.is_agreed => Err(Refusal::NoHandshake),
            Request::Run => {
                self.is_running = true;
                Ok(Reply::Run)
            }
            Request::Trigger(trigger) => {
                self.fired += 1;
                // Before 1.3 this refusal did not have a code.
                let is_known = |reason| reason != Refusal::UnknownTrigger || self.peer_minor >= 3;
                let known = |reason| if is_known(reason) { reason } else { Refusal::UnknownOpcode };
                fire(trigger).map(Reply::Triggered).map_err(known)
            }
            Request::Camera(CameraSetting { kind, head, .. }) => {
                self.fired += 1;
                expose(head)
                    .map(|()| Reply::CameraSet(CameraSet { kind, head }))
                    .map_err(|reason| self.since_1_4(reason))
            }
            Request::CameraTrigger(CameraTrigger { head, at_us }) => {
                self.fired += 1;
                let triggered = |()| Reply::CameraTriggered(CameraTriggered { head, is_late: at_us % 2 == 1 });
                expose(head).map(triggered).map_err(|reason| self.since_1_4(reason))
            }
            Request::Apply { table, rows, crc, seed } => self.apply(table, rows, crc, seed).map(Reply::Applied),
        }
    }

    /// Returns the refusal, which did not have a code before 1.4.
    fn since_1_4(&self, reason: Refusal) -> Refusal {
        if self.peer_minor >= 4 { reason } else { Refusal::UnknownOpcode }
    }

    fn apply(&mut self, number: u8, rows: u8, crc: u16, seed: u16) -> Result<Applied, Refusal> {
        let table = Table::from_number(number).ok_or(Refusal::TableValue)?;
        if rows > table.rows_max() {
            return Err(Refusal::TableValue);
        }
        let values = self.uploaded(number, rows).ok_or(Refusal::TableIncomplete)?;
        if rows == 0 {
            self.cells.retain(|place, _| place.0 != number);
        } else if crc_of(&values) != crc {
            return Err(Refusal::TableCrc);
        } else if !is_legal(table, &values) {
            return Err(Refusal::TableValue);
        }
        if table == Table::Psd {
            self.seed = if rows == 0 { 0 } else { seed };
        }
        self.effective.insert(number, values);
        Ok(Applied { table, rows })
    }
}

/// Returns whether values are within the limits of INTERFACE.md, by column.
fn is_legal(table: Table, values: &[f32]) -> bool {
    let rows = || values.chunks(usize::from(table.columns()));
    let frequencies = || rows().map(|row| row[0]);
    let is_within = |value: &f32, low: f32, high: f32| low <= *value && *value <= high;
    let is_amplitude = |value: &f32| is_within(value, -3600.0, 3600.0);
    let is_phase = |value: &f32| is_within(value, -core::f32::consts::TAU, core::f32::consts::TAU);
    let is_above_zero = |value: f32, high: f32| value > 0.0 && value <= high;
    let are_frequencies = frequencies().all(|frequency| is_above_zero(frequency, 10_000.0));
    match table {
        Table::Lines => are_frequencies && rows().all(|row| row[1..4].iter().all(is_amplitude) && is_phase(&row[4])),
        Table::Psd => {
            let rises = frequencies().zip(frequencies().skip(1)).all(|(low, high)| high > low);
            let is_density = |value: &f32| is_within(value, 0.0, f32::MAX);
            are_frequencies && rises && rows().count() > 1 && rows().all(|row| row[1..].iter().all(is_density))
        }
        Table::WheelHarmonics => rows().all(|row| {
            [0.0, 1.0, 2.0, 3.0].contains(&row[0])
                && is_above_zero(row[1], 1000.0)
                && row[2..5].iter().all(is_amplitude)
                && is_within(&row[5], 0.0, 4.0)
                && is_phase(&row[6])
        }),
    }
}

// --- comparison ------------------------------------------------------------------------------------------------------

fn assert_same_tables(store: &TableStore, model: &Model) {
    assert_same(store.lines(), model, 5);
    assert_same(store.psd(), model, 4);
    assert_same(store.harmonics(), model, 7);
    assert_eq!(store.psd_seed(), model.seed);
}

/// Compares rows bit by bit, but for the wheel's number, which has no sign.
fn assert_same<R: Row>(rows: impl Iterator<Item = R>, model: &Model, columns: usize) {
    let mut wanted = model.effective.get(&R::TABLE.number()).map_or(&[][..], Vec::as_slice).chunks(columns);
    for row in rows {
        let wanted = wanted.next().expect("no more rows than were applied");
        assert_eq!(row.cells().as_ref().len(), columns);
        assert!(row.cells().as_ref().iter().zip(wanted).all(|(a, b)| a == b), "{wanted:?}");
    }
    assert!(wanted.next().is_none(), "every row that was applied");
}

fn assert_is_sent_whole(response: &Response) {
    let payload = Message::Response(*response).payload().expect("a response has no scaled field");
    assert_eq!(Message::from_payload(MessageId::Response, payload.as_slice()), Ok(Message::Response(*response)));
}
