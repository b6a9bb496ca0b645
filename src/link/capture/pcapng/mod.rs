//! pcapng: the blocks that a bus capture needs, written and read.
//!
//! Written by hand, as are the readers: the needs are four kinds of blocks, an error with its offset for each
//! damage, and a file that was cut off read up to the cut.

use crate::capture::{BLOCK_MAX, CaptureError, CapturedPacket, Direction};
use crate::{CHUNK_MAX, Datagram, Packet, SerialChunk};
use base::time::Tai;
use firmware_protocol::can::{CanFrame, CanId};
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};

/// Section header; the same read from either end.
pub(super) const SECTION: u32 = 0x0A0D_0D0A;
const INTERFACE: u32 = 1;
const SIMPLE_PACKET: u32 = 3;
const OBSOLETE_PACKET: u32 = 2;
const ENHANCED_PACKET: u32 = 6;
/// Number that shows the byte order of a section.
const ORDER_MAGIC: u32 = 0x1A2B_3C4D;

const OPTION_END: u16 = 0;
const OPTION_COMMENT: u16 = 1;
/// Option of an interface: its name.
const OPTION_NAME: u16 = 2;
/// Option of an enhanced packet: direction and more.
const OPTION_FLAGS: u16 = 2;
/// Option of an interface: units of its stamps.
const OPTION_RESOLUTION: u16 = 9;
/// Option of an interface: seconds to add to its stamps.
const OPTION_OFFSET: u16 = 14;
/// Option of a section: the program that wrote it.
const OPTION_PROGRAM: u16 = 4;

/// LINKTYPE_CAN_SOCKETCAN.
const LINK_CAN: u16 = 227;
/// LINKTYPE_USER0: here, bytes of a serial line.
const LINK_SERIAL: u16 = 147;
/// LINKTYPE_USER1: here, a plain datagram, or a record or line of a plain stream.
const LINK_DATAGRAM: u16 = 148;

/// Flags in the identifier of a SocketCAN header: remote, error. Bit 31 says 29 bits.
const CAN_NOT_DATA: u32 = 0x6000_0000;
/// FD flag of a SocketCAN header: the frame is an FD frame.
const CAN_FDF: u8 = 0x04;
/// FD flag: bit rate switched.
const CAN_BRS: u8 = 0x01;
/// Bytes of a SocketCAN header before the data.
const CAN_HEADER: usize = 8;
/// Length of a whole FD frame's structure: old captures of FD have no flag, but this length.
const CAN_FD_STRUCTURE: usize = 72;

/// Bits of the flags option: which way a packet went.
const INBOUND: u32 = 1;
const OUTBOUND: u32 = 2;

/// Before the number in the name of an interface of ours.
const NAME_BEFORE: &str = "link";

/// Around the instant in a packet's comment.
const TAI_BEFORE: &str = "TAI ";
const TAI_AFTER: &str = " ns";

// pcapng -> packets: either byte order, any number of sections and interfaces, any units of stamps.

/// Most interfaces of one section.
const MOST_INTERFACES: usize = 1024;
/// Least length of a block: type and both lengths.
const EMPTY_BLOCK: u32 = 12;
const NS_PER_S: i128 = 1_000_000_000;

/// Reads blocks.
pub(in crate::capture) struct PcapngReader<R> {
    source: R,
    /// Bytes taken from the source.
    offset: u64,
    /// Place of the present block's start.
    begin: u64,
    is_big_endian: bool,
    interfaces: Vec<Interface>,
    body: Vec<u8>,
    /// Pieces of a long run of serial bytes.
    ready: VecDeque<CapturedPacket>,
    pub(in crate::capture) skipped: u64,
}

#[derive(Clone, Copy)]
struct Interface {
    link_type: u16,
    resolution: u8,
    offset_s: i64,
    /// Number for packets: the one in a name that this program wrote, else the place in the section.
    number: u8,
}

impl<R: Read> PcapngReader<R> {
    pub(in crate::capture) fn new(source: R) -> Self {
        Self {
            source,
            offset: 0,
            begin: 0,
            is_big_endian: false,
            interfaces: Vec::new(),
            body: Vec::new(),
            ready: VecDeque::new(),
            skipped: 0,
        }
    }

    /// The next packet; `None` at the end.
    pub(in crate::capture) fn next(&mut self) -> Result<Option<CapturedPacket>, CaptureError> {
        loop {
            if let Some(packet) = self.ready.pop_front() {
                return Ok(Some(packet));
            }
            self.begin = self.offset;
            let Some(kind) = self.block_kind()? else { return Ok(None) };
            match kind {
                SECTION => self.section()?,
                INTERFACE => self.interface()?,
                ENHANCED_PACKET => self.packet()?,
                kind => {
                    self.skipped += u64::from(matches!(kind, SIMPLE_PACKET | OBSOLETE_PACKET));
                    self.skip_block()?;
                }
            }
        }
    }

    fn refuse<T>(&self, why: impl Into<String>) -> Result<T, CaptureError> {
        Err(CaptureError::Block { offset: self.begin, why: why.into() })
    }

    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), CaptureError> {
        self.source.read_exact(bytes).map_err(|error| self.broken(error))?;
        self.offset += bytes.len() as u64;
        Ok(())
    }

    fn broken(&self, source: io::Error) -> CaptureError {
        if source.kind() == ErrorKind::UnexpectedEof {
            CaptureError::CutOff { place: format!("byte {}, inside a block", self.begin) }
        } else {
            CaptureError::Read { offset: self.offset, source }
        }
    }

    fn word(&self, bytes: [u8; 4]) -> u32 {
        if self.is_big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }

    fn half(&self, bytes: [u8; 2]) -> u16 {
        if self.is_big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
    }

    fn read_word(&mut self) -> Result<u32, CaptureError> {
        let mut bytes = [0; 4];
        self.fill(&mut bytes)?;
        Ok(self.word(bytes))
    }

    /// Returns the type of the next block; `None` at the end of the file.
    fn block_kind(&mut self) -> Result<Option<u32>, CaptureError> {
        let mut bytes = [0; 4];
        let mut got = 0;
        while got < bytes.len() {
            match self.source.read(&mut bytes[got..]) {
                Ok(0) if got == 0 => return Ok(None),
                Ok(0) => return Err(self.broken(ErrorKind::UnexpectedEof.into())),
                Ok(count) => got += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(self.broken(error)),
            }
        }
        self.offset += 4;
        Ok(Some(self.word(bytes)))
    }

    /// Returns a new section: its byte order holds from its own length on.
    fn section(&mut self) -> Result<(), CaptureError> {
        let (mut length, mut magic) = ([0; 4], [0; 4]);
        self.fill(&mut length)?;
        self.fill(&mut magic)?;
        self.is_big_endian = match magic {
            magic if u32::from_le_bytes(magic) == ORDER_MAGIC => false,
            magic if u32::from_be_bytes(magic) == ORDER_MAGIC => true,
            other => {
                return self
                    .refuse(format!("its byte order magic is {other:02X?}, wanted 1A 2B 3C 4D in either order"));
            }
        };
        self.interfaces.clear();
        let length = self.word(length);
        if length < EMPTY_BLOCK + 4 {
            return self.refuse(format!("a section header of {length} bytes"));
        }
        self.skip(u64::from(length - EMPTY_BLOCK - 4))?;
        self.check_end(length)
    }

    /// Returns the length of the block at hand.
    fn length(&mut self) -> Result<u32, CaptureError> {
        let length = self.read_word()?;
        if length < EMPTY_BLOCK || !length.is_multiple_of(4) {
            return self.refuse(format!("length {length}, wanted a multiple of 4 from {EMPTY_BLOCK}"));
        }
        Ok(length)
    }

    fn check_end(&mut self, length: u32) -> Result<(), CaptureError> {
        let again = self.read_word()?;
        if again != length {
            return self.refuse(format!("its length is {length} at its start and {again} at its end"));
        }
        Ok(())
    }

    fn skip(&mut self, count: u64) -> Result<(), CaptureError> {
        let skipped = io::copy(&mut self.source.by_ref().take(count), &mut io::sink());
        match skipped {
            Ok(skipped) if skipped == count => {
                self.offset += count;
                Ok(())
            }
            Ok(_) => Err(self.broken(ErrorKind::UnexpectedEof.into())),
            Err(error) => Err(self.broken(error)),
        }
    }

    fn skip_block(&mut self) -> Result<(), CaptureError> {
        let length = self.length()?;
        self.skip(u64::from(length - EMPTY_BLOCK))?;
        self.check_end(length)
    }

    /// Reads the body of the block at hand into `self.body`.
    fn take_body(&mut self, least: usize) -> Result<(), CaptureError> {
        let length = self.length()?;
        let count = (length - EMPTY_BLOCK) as usize;
        if count < least || count > BLOCK_MAX {
            return self.refuse(format!("a body of {count} bytes, wanted {least} to {BLOCK_MAX}"));
        }
        let mut body = core::mem::take(&mut self.body);
        body.resize(count, 0);
        let filled = self.fill(&mut body);
        self.body = body;
        filled?;
        self.check_end(length)
    }

    fn word_at(&self, place: usize) -> u32 {
        let bytes = self.body.get(place..place + 4).and_then(|bytes| bytes.try_into().ok());
        self.word(bytes.unwrap_or_default())
    }

    fn half_at(&self, place: usize) -> u16 {
        let bytes = self.body.get(place..place + 2).and_then(|bytes| bytes.try_into().ok());
        self.half(bytes.unwrap_or_default())
    }

    /// Returns the options from `place` on: code, and where the value lies. Damaged ones end the list.
    fn options(&self, mut place: usize) -> impl Iterator<Item = (u16, &[u8])> {
        core::iter::from_fn(move || {
            let (code, length) = (self.half_at(place), usize::from(self.half_at(place + 2)));
            let value = self.body.get(place + 4..place + 4 + length)?;
            place += 4 + length.next_multiple_of(4);
            (code != OPTION_END).then_some((code, value))
        })
    }

    fn interface(&mut self) -> Result<(), CaptureError> {
        self.take_body(8)?;
        if self.interfaces.len() >= MOST_INTERFACES {
            return self.refuse(format!("more than {MOST_INTERFACES} interfaces"));
        }
        let number = u8::try_from(self.interfaces.len()).unwrap_or(u8::MAX);
        let mut interface = Interface { link_type: self.half_at(0), resolution: 6, offset_s: 0, number };
        for (code, value) in self.options(8) {
            match (code, value) {
                (OPTION_NAME, name) => interface.number = number_of(name).unwrap_or(number),
                (OPTION_RESOLUTION, [resolution]) => interface.resolution = *resolution,
                (OPTION_OFFSET, value) => {
                    if let Ok(bytes) = <[u8; 8]>::try_from(value) {
                        let big = self.is_big_endian;
                        interface.offset_s = if big { i64::from_be_bytes(bytes) } else { i64::from_le_bytes(bytes) };
                    }
                }
                _ => {}
            }
        }
        self.interfaces.push(interface);
        Ok(())
    }

    fn packet(&mut self) -> Result<(), CaptureError> {
        const HEADER: usize = 20;
        self.take_body(HEADER)?;
        let number = self.word_at(0);
        let Some(interface) = self.interfaces.get(number as usize).copied() else {
            return self.refuse(format!("a packet of interface {number}, which was not described before"));
        };
        let ticks = (u64::from(self.word_at(4)) << 32) | u64::from(self.word_at(8));
        let length = self.word_at(12) as usize;
        if length > self.body.len() - HEADER {
            return self.refuse(format!("a packet of {length} bytes in a body of {}", self.body.len()));
        }
        let mut direction = Direction::Received;
        let mut instant = None;
        for (code, value) in self.options(HEADER + length.next_multiple_of(4)) {
            match (code, value) {
                (OPTION_FLAGS, [a, b, c, d]) if self.word([*a, *b, *c, *d]) & 3 == OUTBOUND => {
                    direction = Direction::Sent;
                }
                (OPTION_COMMENT, text) => instant = instant.or(tai_of(text)),
                _ => {}
            }
        }
        let at = match instant.or_else(|| unix_ns(ticks, &interface).map(Tai::from_unix_ns)) {
            Some(at) => at,
            None => {
                return self.refuse(format!("a stamp of {ticks} units (code {}): beyond 2262", interface.resolution));
            }
        };
        let (ready, data) = (&mut self.ready, &self.body[HEADER..HEADER + length]);
        let captured = |packet| CapturedPacket { at, direction, interface: interface.number, packet };
        match interface.link_type {
            LINK_CAN => match can_frame(data) {
                Some(frame) => ready.push_back(captured(Packet::Can(frame))),
                None => self.skipped += 1,
            },
            LINK_SERIAL => {
                let chunks = data.chunks(CHUNK_MAX).filter_map(SerialChunk::new);
                ready.extend(chunks.map(|chunk| captured(Packet::Serial(chunk))));
            }
            LINK_DATAGRAM => match Datagram::new(data) {
                Some(datagram) => ready.push_back(captured(Packet::Datagram(datagram))),
                None => self.skipped += 1,
            },
            _ => self.skipped += 1,
        }
        Ok(())
    }
}

/// Returns the number in an interface's name of ours.
fn number_of(name: &[u8]) -> Option<u8> {
    core::str::from_utf8(name).ok()?.strip_prefix(NAME_BEFORE)?.parse().ok()
}

/// Returns the instant in a comment of ours.
fn tai_of(comment: &[u8]) -> Option<Tai> {
    let text = core::str::from_utf8(comment).ok()?;
    text.strip_prefix(TAI_BEFORE)?.strip_suffix(TAI_AFTER)?.parse().ok().map(Tai::from_ns)
}

/// Returns a stamp as Unix time, ns; `None` beyond the range of nanoseconds in 64 bits.
fn unix_ns(ticks: u64, interface: &Interface) -> Option<i64> {
    let (ticks, power) = (i128::from(ticks), u32::from(interface.resolution & 0x7F));
    let ns = if interface.resolution & 0x80 == 0 {
        match power.checked_sub(9) {
            None => ticks.checked_mul(10_i128.pow(9 - power))?,
            Some(more) => ticks.checked_div(10_i128.checked_pow(more)?)?,
        }
    } else {
        ticks.checked_mul(NS_PER_S)?.checked_shr(power)?
    };
    i64::try_from(ns.checked_add(i128::from(interface.offset_s) * NS_PER_S)?).ok()
}

/// Returns the frame behind a SocketCAN header; `None` for one that has no form here.
fn can_frame(data: &[u8]) -> Option<CanFrame> {
    let (header, rest) = data.split_at_checked(CAN_HEADER)?;
    let id = u32::from_be_bytes(header[..4].try_into().ok()?);
    let length = usize::from(header[4]);
    let is_fd = header[5] & CAN_FDF != 0 || length > 8 || data.len() == CAN_FD_STRUCTURE;
    if id & CAN_NOT_DATA != 0 {
        return None;
    }
    let (id, data) = (CanId::from_flagged(id)?, rest.get(..length)?);
    if is_fd { CanFrame::fd(id, data) } else { CanFrame::classic(id, data) }
}

// Packets -> pcapng, little-endian.

/// Units of stamps: 10^-9 s.
const NANOSECONDS: u8 = 9;

/// Writes blocks; its buffers are made once.
pub(in crate::capture) struct PcapngWriter<W> {
    out: W,
    body: Vec<u8>,
    data: Vec<u8>,
    /// Number and link type of each interface that has been described, in this order.
    described: Vec<(u8, u16)>,
}

impl<W: Write> PcapngWriter<W> {
    /// Begins a section.
    pub(in crate::capture) fn new(out: W) -> Result<Self, io::Error> {
        let (body, data) = (Vec::with_capacity(256), Vec::with_capacity(128));
        let mut writer = Self { out, body, data, described: Vec::new() };
        writer.body.extend(ORDER_MAGIC.to_le_bytes());
        writer.body.extend([1, 0, 0, 0]); // version 1.0
        writer.body.extend(u64::MAX.to_le_bytes()); // length of the section: not given
        put_option(&mut writer.body, OPTION_PROGRAM, concat!("starloop ", env!("CARGO_PKG_VERSION")).as_bytes());
        put_option(&mut writer.body, OPTION_END, &[]);
        writer.finish_block(SECTION)?;
        Ok(writer)
    }

    pub(in crate::capture) fn out(&mut self) -> &mut W {
        &mut self.out
    }

    /// Writes one packet, and its interface before the first of its number and kind.
    pub(in crate::capture) fn write(&mut self, captured: &CapturedPacket) -> Result<(), io::Error> {
        let link_type = match captured.packet {
            Packet::Can(_) => LINK_CAN,
            Packet::Serial(_) => LINK_SERIAL,
            Packet::Datagram(_) => LINK_DATAGRAM,
        };
        let wanted = (captured.interface, link_type);
        let place = match self.described.iter().position(|described| *described == wanted) {
            Some(place) => place,
            None => self.describe_interface(wanted)?,
        };
        self.data.clear();
        match &captured.packet {
            Packet::Can(frame) => put_can(&mut self.data, frame),
            Packet::Serial(_) | Packet::Datagram(_) => self.data.extend(captured.packet.data()),
        }
        #[allow(clippy::cast_possible_truncation, reason = "768 interfaces at most")]
        self.put_packet(place as u32, captured);
        self.finish_block(ENHANCED_PACKET)
    }

    fn put_packet(&mut self, place: u32, captured: &CapturedPacket) {
        let body = &mut self.body;
        let unix_ns = captured.at.to_unix_ns().max(0).unsigned_abs();
        body.extend(place.to_le_bytes());
        // The upper half of the stamp comes first.
        body.extend(unix_ns.to_le_bytes()[4..].iter());
        body.extend(unix_ns.to_le_bytes()[..4].iter());
        #[allow(clippy::cast_possible_truncation, reason = "a packet has at most 512 bytes")]
        let length = (self.data.len() as u32).to_le_bytes();
        body.extend(length); // captured
        body.extend(length); // on the wire
        body.extend(&self.data);
        pad(body);
        let flags = if captured.direction == Direction::Sent { OUTBOUND } else { INBOUND };
        put_option(body, OPTION_FLAGS, &flags.to_le_bytes());
        let mut comment = [0; 40];
        let mut rest = &mut comment[..];
        let _ = write!(rest, "{TAI_BEFORE}{}{TAI_AFTER}", captured.at.ns()); // 40 bytes are enough
        let unused = rest.len();
        put_option(body, OPTION_COMMENT, &comment[..comment.len() - unused]);
        put_option(body, OPTION_END, &[]);
    }

    /// Describes an interface; returns its place in the section.
    fn describe_interface(&mut self, (number, link_type): (u8, u16)) -> Result<usize, io::Error> {
        self.body.extend(link_type.to_le_bytes());
        self.body.extend([0; 6]); // reserved; no limit to a packet's length
        put_option(&mut self.body, OPTION_NAME, format!("{NAME_BEFORE}{number}").as_bytes());
        put_option(&mut self.body, OPTION_RESOLUTION, &[NANOSECONDS]);
        put_option(&mut self.body, OPTION_END, &[]);
        self.finish_block(INTERFACE)?;
        self.described.push((number, link_type));
        Ok(self.described.len() - 1)
    }

    /// Writes the body with its type and its length on both sides.
    fn finish_block(&mut self, kind: u32) -> Result<(), io::Error> {
        #[allow(clippy::cast_possible_truncation, reason = "blocks of ours are below 1 KiB")]
        let length = (self.body.len() as u32 + 12).to_le_bytes();
        self.out.write_all(&kind.to_le_bytes())?;
        self.out.write_all(&length)?;
        self.out.write_all(&self.body)?;
        self.body.clear();
        self.out.write_all(&length)
    }
}

fn put_option(body: &mut Vec<u8>, code: u16, value: &[u8]) {
    body.extend(code.to_le_bytes());
    #[allow(clippy::cast_possible_truncation, reason = "options of ours are below 256 bytes")]
    body.extend((value.len() as u16).to_le_bytes());
    body.extend(value);
    pad(body);
}

fn pad(body: &mut Vec<u8>) {
    body.resize(body.len().next_multiple_of(4), 0);
}

/// Appends the SocketCAN header, big-endian, and the data.
fn put_can(data: &mut Vec<u8>, frame: &CanFrame) {
    data.extend(frame.id().flagged().to_be_bytes());
    #[allow(clippy::cast_possible_truncation, reason = "a frame has at most 64 bytes")]
    data.push(frame.data().len() as u8);
    data.push(if frame.is_fd() { CAN_FDF | CAN_BRS } else { 0 });
    data.extend([0, 0]);
    data.extend(frame.data());
}
