//! A CANopen star tracker: boot-up, heartbeat, NMT, four transmit PDOs, expedited SDO, SDO in segments for its
//! name, SYNC, EMCY.
//!
//! Source: CiA 301 as its public summaries have it; the objects of the attitude are at the numbers of OreSat's star
//! tracker (0x4000, 0x4002). Little-endian, classic frames, 11-bit identifiers of the predefined connection set. PDO1:
//! state, known, stars, milliseconds of the UTC day at mid-exposure; PDO2: real part, i; PDO3: j, k (f32); PDO4: rates
//! in arcsec/s (i16), frame. With OreSat's map PDO3 to PDO5 have state, known, milliseconds; real part, i; j, k. PDOs go
//! out with each report (type 254 or 255) or with every n-th SYNC (1 to 240), while the node is operational. EMCY FF01
//! reports that the attitude was lost, 0000 that it is known again. The dictionary is in [`dictionary`], and writes its
//! EDS file.
//!
//! Left out: other segmented SDO, block SDO, RPDO, time stamp, node guarding, LSS, changes of mappings and of identifiers.
//!
//! [`CanOpenReader`] reads the transmit PDOs of one node with a part of its attitude. Those of one report are those that
//! follow one another: the time begins a report, k ends it. Other identifiers are passed over.

use crate::device::{Continuity, single};
use crate::reading::{Measured, Reader, unit};
use crate::{Answered, Device, Limits, Mode, Order, Report, Sense, Wire};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use dictionary::{
    ATTITUDE, ERROR_REGISTER, EXPOSURE, Entry, FRAME, HEARTBEAT, MAPPING, NAME, NAME_TEXT, PDOS_MAX, PdoMap, RATE,
    RESET, STARS, STATE, TEMPERATURE, TPDO,
};
use firmware_protocol::can::CanFrame;
use sdo::{Abort, Request, Text};

pub mod dictionary;
pub mod sdo;

/// Node numbers of the predefined connection set.
pub const NODES: core::ops::RangeInclusive<u8> = 1..=127;
/// The first node number none of whose identifiers starloop's own messages have, at base 0.
pub const FIRST_FREE_NODE: u8 = 96;

const NMT: u16 = 0x000;
const SYNC: u16 = 0x080;
const EMCY: u16 = 0x080;
const SDO_ANSWER: u16 = 0x580;
const SDO_REQUEST: u16 = 0x600;
const ERROR_CONTROL: u16 = 0x700;
const STANDBY: u8 = 2;
const STAR_TRACK: u8 = 4;
const ATTITUDE_LOST: u16 = 0xFF01;
/// Generic and manufacturer-specific error.
const ERROR_BITS: u8 = 0x81;
pub(crate) const MS_PER_DAY: i64 = 86_400_000;

/// States of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Nmt {
    Stopped,
    Operational,
    PreOperational,
}

impl Nmt {
    fn code(self) -> u8 {
        match self {
            Self::Stopped => 4,
            Self::Operational => 5,
            Self::PreOperational => 0x7F,
        }
    }
}

/// A CANopen star tracker.
#[derive(Debug)]
pub struct CanOpenDevice {
    node: u8,
    map: &'static PdoMap,
    starts_operational: bool,
    sense: Sense,
    limits: Limits,
    nmt: Nmt,
    heartbeat_ms: u16,
    heartbeat_ms_at_start: u16,
    next_heartbeat: Option<Tai>,
    types: [u8; PDOS_MAX],
    syncs: [u8; PDOS_MAX],
    state: u8,
    exposure_us: u32,
    error_register: u8,
    /// The text that a client reads in segments.
    text: Option<Text>,
    continuity: Continuity,
    newest: Option<Report>,
    answered: Answered,
}

/// How a node begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeParams {
    /// Number, 1 to 127.
    pub node: u8,
    /// Milliseconds from one heartbeat to the next; 0 for none.
    pub heartbeat_ms: u16,
    /// It is operational without being started by a master.
    pub starts_operational: bool,
    /// Its transmit PDOs.
    pub map: &'static PdoMap,
}

impl CanOpenDevice {
    /// Returns a node that has not been switched on; `exposure_s` is its camera's.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "saturates; exposures are shorter than an hour"
    )]
    pub fn new(params: NodeParams, sense: Sense, limits: Limits, exposure_s: f64) -> Self {
        let NodeParams { node, heartbeat_ms, starts_operational, map } = params;
        Self {
            node,
            map,
            starts_operational,
            sense,
            limits,
            nmt: Nmt::PreOperational,
            heartbeat_ms,
            heartbeat_ms_at_start: heartbeat_ms,
            next_heartbeat: None,
            types: [255; PDOS_MAX],
            syncs: [0; PDOS_MAX],
            state: STAR_TRACK,
            exposure_us: (exposure_s * 1e6).round() as u32,
            error_register: 0,
            text: None,
            continuity: Continuity::default(),
            newest: None,
            answered: Answered::default(),
        }
    }

    fn send(&self, id: u16, data: &[u8], out: &mut Vec<Wire>) {
        out.extend(CanFrame::classic(id, data).map(Wire::Can));
    }

    fn boot(&mut self, now: Tai, out: &mut Vec<Wire>) {
        self.send(ERROR_CONTROL + u16::from(self.node), &[0], out);
        self.nmt = if self.starts_operational { Nmt::Operational } else { Nmt::PreOperational };
        self.types = [255; PDOS_MAX];
        self.syncs = [0; PDOS_MAX];
        self.heartbeat_ms = self.heartbeat_ms_at_start;
        self.schedule(now);
    }

    fn schedule(&mut self, from: Tai) {
        let period = Span::from_ms(i64::from(self.heartbeat_ms));
        self.next_heartbeat = (self.heartbeat_ms > 0).then(|| from + period);
    }

    fn obey_nmt(&mut self, data: &[u8], now: Tai, out: &mut Vec<Wire>, orders: &mut Vec<Order>) {
        let [command, node] = data else { return self.answered.refused += 1 };
        if *node != 0 && *node != self.node {
            return;
        }
        match command {
            1 => self.nmt = Nmt::Operational,
            2 => self.nmt = Nmt::Stopped,
            128 => self.nmt = Nmt::PreOperational,
            129 => {
                orders.push(Order::Reset);
                self.state = STAR_TRACK;
                self.boot(now, out);
            }
            130 => self.boot(now, out),
            _unknown => return self.answered.refused += 1,
        }
        self.answered.commands += 1;
    }

    fn sync(&mut self, out: &mut Vec<Wire>) {
        if self.nmt != Nmt::Operational {
            return;
        }
        for pdo in 0..self.map.pdos.len() {
            if !(1..=240).contains(&self.types[pdo]) {
                continue;
            }
            self.syncs[pdo] += 1;
            if self.syncs[pdo] >= self.types[pdo] {
                self.syncs[pdo] = 0;
                self.send_pdo(pdo, out);
            }
        }
    }

    fn send_pdo(&self, pdo: usize, out: &mut Vec<Wire>) {
        let mut data = Vec::with_capacity(8);
        for (index, sub) in self.map.pdos[pdo].objects {
            if let Some(entry) = self.map.find(*index, *sub) {
                data.extend(self.value(&entry).iter().take(usize::from(entry.kind.bytes())));
            }
        }
        self.send(self.map.pdos[pdo].id() + u16::from(self.node), &data, out);
    }

    /// Value of an entry, little-endian, padded with zeros.
    fn value(&self, entry: &Entry) -> [u8; 4] {
        let report = self.newest;
        let q = report.and_then(|report| report.attitude_wxyz).map_or([0.0; 4], |q| self.sense.of(q));
        let rate = report.and_then(|report| report.rate_rad_s).unwrap_or([0.0; 3]);
        let node = u32::from(self.node);
        let pdo = self.map.place(entry.index).unwrap_or_default();
        match (entry.index, entry.sub) {
            (ERROR_REGISTER, _) => u32::from(self.error_register).to_le_bytes(),
            (0x1005, _) => u32::from(SYNC).to_le_bytes(),
            (0x1014, _) => (u32::from(EMCY) + node).to_le_bytes(),
            (HEARTBEAT, _) => u32::from(self.heartbeat_ms).to_le_bytes(),
            (0x1018, 0) => 4_u32.to_le_bytes(),
            (0x1018, 2 | 3) => 1_u32.to_le_bytes(),
            (0x1200, 0) | (TPDO..MAPPING, 0) => 2_u32.to_le_bytes(),
            (0x1200, 1) => (u32::from(SDO_REQUEST) + node).to_le_bytes(),
            (0x1200, _) => (u32::from(SDO_ANSWER) + node).to_le_bytes(),
            (TPDO..MAPPING, 1) => (u32::from(self.map.pdos[pdo].id()) + node).to_le_bytes(),
            (TPDO..MAPPING, _) => u32::from(self.types[pdo]).to_le_bytes(),
            (MAPPING..STATE, 0) => u32::try_from(self.map.pdos[pdo].objects.len()).unwrap_or(0).to_le_bytes(),
            (MAPPING..STATE, sub) => self.map.mapping_word(pdo, usize::from(sub) - 1).unwrap_or(0).to_le_bytes(),
            (STATE, _) => u32::from(self.state).to_le_bytes(),
            (ATTITUDE, 0) => 6_u32.to_le_bytes(),
            (ATTITUDE, sub @ 1..=3) => single(q[usize::from(sub)]),
            (ATTITUDE, 4) => report.map_or(0, |report| ms_of_day(report.time_tag)).to_le_bytes(),
            (ATTITUDE, 5) => single(q[0]),
            (ATTITUDE, _) => u32::from(report.is_some_and(|report| report.attitude_wxyz.is_some())).to_le_bytes(),
            (RATE, 0) => 3_u32.to_le_bytes(),
            (RATE, sub) => arcsec_s(rate[usize::from(sub.clamp(1, 3)) - 1]),
            (STARS, _) => report.map_or(0, |report| u32::from(report.stars)).to_le_bytes(),
            (EXPOSURE, _) => self.exposure_us.to_le_bytes(),
            (FRAME, _) => (report.map_or(0, |report| report.frame) & 0xFFFF).to_le_bytes(),
            (TEMPERATURE, _) => single(report.map_or(0.0, |report| report.temperature_c)),
            _zero => [0; 4],
        }
    }

    fn write(&mut self, entry: &Entry, value: [u8; 4], now: Tai, orders: &mut Vec<Order>) -> Result<(), Abort> {
        let [a, b, ..] = value;
        match entry.index {
            HEARTBEAT => {
                self.heartbeat_ms = u16::from_le_bytes([a, b]);
                self.schedule(now);
            }
            STATE => {
                let order = match a {
                    STANDBY => Order::Pause,
                    STAR_TRACK => Order::Operate,
                    _other => return Err(Abort::BadValue),
                };
                self.state = a;
                orders.push(order);
            }
            EXPOSURE => {
                let us = u32::from_le_bytes(value);
                if self.limits.exposure_s.is_none() {
                    return Err(Abort::NotNow);
                }
                orders.push(self.limits.exposure(f64::from(us) * 1e-6).ok_or(Abort::BadValue)?);
                self.exposure_us = us;
            }
            RESET => orders.push(if a == 1 { Order::Reset } else { return Err(Abort::BadValue) }),
            // Its index is that of a transmit PDO, since nothing else can be written.
            TPDO..MAPPING => {
                if (241..=253).contains(&a) || a == 0 {
                    return Err(Abort::BadValue);
                }
                let pdo = self.map.place(entry.index).ok_or(Abort::NoObject)?;
                (self.types[pdo], self.syncs[pdo]) = (a, 0);
            }
            _only_read => return Err(Abort::ReadOnly),
        }
        Ok(())
    }

    fn transfer(&mut self, data: [u8; 8], now: Tai, out: &mut Vec<Wire>, orders: &mut Vec<Order>) {
        // Whatever else a client does ends the text that it read.
        let text = self.text.take();
        let done = sdo::read(data, self.map).and_then(|request| match request {
            Request::Read(entry) if entry.index == NAME => {
                let (text, answer) = Text::begin(&entry, NAME_TEXT);
                self.text = Some(text);
                Ok(Some(answer))
            }
            Request::Segment(toggle) => {
                let (answer, rest) = text.ok_or(Abort::BadCommand)?.next(toggle)?;
                self.text = rest;
                Ok(Some(answer))
            }
            Request::Read(entry) => Ok(Some(sdo::value(&entry, self.value(&entry)))),
            Request::Write(entry, value) => self.write(&entry, value, now, orders).map(|()| Some(sdo::written(&entry))),
            Request::Abort => Ok(None),
        });
        match done {
            Ok(_) => self.answered.commands += 1,
            Err(_) => self.answered.refused += 1,
        }
        if let Some(answer) = done.unwrap_or_else(|abort| Some(sdo::aborted(data, abort))) {
            self.send(SDO_ANSWER + u16::from(self.node), &answer, out);
        }
    }
}

/// Milliseconds of the UTC day, rounded down.
fn ms_of_day(at: Tai) -> u32 {
    u32::try_from((at.to_unix_ns().div_euclid(1_000_000)).rem_euclid(MS_PER_DAY)).unwrap_or(0)
}

fn arcsec_s(rad_s: f64) -> [u8; 4] {
    #[allow(clippy::cast_possible_truncation, reason = "saturates at 9.1 degrees per second")]
    let [a, b] = ((rad_s / ARCSEC).round() as i16).to_le_bytes();
    [a, b, 0, 0]
}

impl Device for CanOpenDevice {
    fn start(&mut self, now: Tai, out: &mut Vec<Wire>) {
        self.boot(now, out);
    }

    fn report(&mut self, report: &Report, _now: Tai, out: &mut Vec<Wire>) {
        let was_known = self.newest.is_none_or(|newest| newest.attitude_wxyz.is_some());
        let attitude_wxyz = report.attitude_wxyz.map(|q| self.continuity.next(q));
        self.newest = Some(Report { attitude_wxyz, ..*report });
        self.state = if report.mode == Mode::Standby { STANDBY } else { STAR_TRACK };
        let is_known = attitude_wxyz.is_some();
        self.error_register = if is_known || self.state == STANDBY { 0 } else { ERROR_BITS };
        if was_known != is_known && self.nmt != Nmt::Stopped && self.state != STANDBY {
            let [a, b] = if is_known { [0, 0] } else { ATTITUDE_LOST.to_le_bytes() };
            let data = [a, b, self.error_register, 0, 0, 0, 0, 0];
            self.send(EMCY + u16::from(self.node), &data, out);
        }
        if self.nmt == Nmt::Operational {
            let pdos = 0..self.map.pdos.len();
            pdos.filter(|pdo| self.types[*pdo] >= 254).for_each(|pdo| self.send_pdo(pdo, out));
        }
    }

    fn take(&mut self, wire: &Wire, now: Tai, out: &mut Vec<Wire>, orders: &mut Vec<Order>) {
        let Wire::Can(frame) = wire else { return };
        if frame.is_fd() {
            return;
        }
        if frame.id() == NMT {
            self.obey_nmt(frame.data(), now, out, orders);
        } else if frame.id() == SYNC {
            self.sync(out);
        } else if frame.id() == SDO_REQUEST + u16::from(self.node) && self.nmt != Nmt::Stopped {
            match <[u8; 8]>::try_from(frame.data()) {
                Ok(data) => self.transfer(data, now, out, orders),
                Err(_of_another_length) => self.answered.refused += 1,
            }
        }
    }

    fn step(&mut self, now: Tai, out: &mut Vec<Wire>) {
        let Some(due) = self.next_heartbeat.filter(|due| *due <= now) else { return };
        self.send(ERROR_CONTROL + u16::from(self.node), &[self.nmt.code()], out);
        self.schedule(due);
        self.next_heartbeat = self.next_heartbeat.map(|next| next.max(now));
    }

    fn next_due(&self) -> Option<Tai> {
        self.next_heartbeat
    }

    fn answered(&self) -> Answered {
        self.answered
    }
}

#[cfg(test)]
mod tests;

/// A report that has begun.
#[derive(Debug, Clone, Copy)]
struct Begun {
    time_tag: Tai,
    stars: Option<u16>,
    /// Real part, i, j, k.
    parts: [Option<f64>; 4],
}

/// Where the parts of a quaternion are among the attitude's objects.
const PARTS: [u8; 4] = [5, 1, 2, 3];

/// Reads a CANopen star tracker.
#[derive(Debug)]
pub struct CanOpenReader {
    node: u8,
    map: &'static PdoMap,
    sense: Sense,
    begun: Option<Begun>,
    damaged: u64,
}

impl CanOpenReader {
    /// Makes a reader of this node with this map, whose quaternions are in this sense.
    pub fn new(node: u8, map: &'static PdoMap, sense: Sense) -> Self {
        Self { node, map, sense, begun: None, damaged: 0 }
    }

    /// The time of a report: one without an attitude is whole; another one begins.
    fn begin(&mut self, ms: u32, known: u8, stars: Option<u16>, at: Tai, out: &mut Vec<Measured>) {
        self.damaged += u64::from(self.begun.take().is_some());
        let ms = i64::from(ms);
        if known > 1 || ms >= MS_PER_DAY {
            self.damaged += 1;
            return;
        }
        let time_tag = nearest_day(ms, at);
        if known == 1 {
            self.begun = Some(Begun { time_tag, stars, parts: [None; 4] });
        } else {
            out.push(Measured { at, time_tag: Some(time_tag), frame: None, attitude_wxyz: None, stars });
        }
    }

    /// The last part of an attitude: the report is whole.
    fn end(&mut self, at: Tai, out: &mut Vec<Measured>) {
        // The last part without those before it: the capture begins in the midst of a report.
        let Some(Begun { time_tag, stars, parts }) = self.begun.take() else { return };
        let whole = parts.iter().all(Option::is_some).then(|| parts.map(Option::unwrap_or_default));
        let attitude_wxyz = whole.and_then(|q| unit(self.sense.of(q)));
        if attitude_wxyz.is_none() {
            self.damaged += 1;
            return;
        }
        out.push(Measured { at, time_tag: Some(time_tag), frame: None, attitude_wxyz, stars });
    }
}

impl Reader for CanOpenReader {
    fn take(&mut self, wire: &Wire, at: Tai, out: &mut Vec<Measured>) {
        let Wire::Can(frame) = wire else { return };
        let pdo = self.map.pdos.iter().find(|pdo| frame.id() == pdo.id() + u16::from(self.node));
        let Some(pdo) = pdo.filter(|pdo| pdo.objects.iter().any(|(index, _)| *index == ATTITUDE)) else { return };
        let data = frame.data();
        if data.len() != pdo.bytes() {
            self.damaged += 1;
            return;
        }
        if let Some(ms) = pdo.part(data, (ATTITUDE, 4)) {
            let [known, ..] = pdo.part(data, (ATTITUDE, 6)).unwrap_or_default();
            let stars = pdo.part(data, (STARS, 0)).map(|[low, high, ..]| u16::from_le_bytes([low, high]));
            self.begin(u32::from_le_bytes(ms), known, stars, at, out);
        }
        for (place, sub) in PARTS.into_iter().enumerate() {
            if let (Some(begun), Some(four)) = (&mut self.begun, pdo.part(data, (ATTITUDE, sub))) {
                begun.parts[place] = Some(f64::from(f32::from_le_bytes(four)));
            }
        }
        if pdo.objects.contains(&(ATTITUDE, PARTS[3])) {
            self.end(at, out);
        }
    }

    fn damaged(&self) -> u64 {
        self.damaged
    }
}

/// Returns the instant of these milliseconds of a UTC day that is nearest to `at`.
fn nearest_day(ms: i64, at: Tai) -> Tai {
    let day_ns = MS_PER_DAY * 1_000_000;
    let midnight_ns = at.to_unix_ns().div_euclid(day_ns) * day_ns;
    let candidates = [-1, 0, 1].map(|day| Tai::from_unix_ns(midnight_ns + day * day_ns + ms * 1_000_000));
    let distance = |instant: &Tai| if *instant > at { *instant - at } else { at - *instant };
    candidates.into_iter().min_by_key(distance).unwrap_or(at + Span::ZERO)
}
