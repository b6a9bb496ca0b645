//! pcapng -> packets: either byte order, any number of sections and interfaces, any units of stamps.

use super::{
    CAN_FD_STRUCTURE, CAN_FDF, CAN_HEADER, CAN_NOT_DATA, ENHANCED_PACKET, INTERFACE, LINK_CAN, LINK_DATAGRAM,
    LINK_SERIAL, NAME_BEFORE, OBSOLETE_PACKET, OPTION_COMMENT, OPTION_END, OPTION_FLAGS, OPTION_NAME, OPTION_OFFSET,
    OPTION_RESOLUTION, ORDER_MAGIC, OUTBOUND, SECTION, SIMPLE_PACKET, TAI_AFTER, TAI_BEFORE,
};
use crate::capture::{BLOCK_MAX, CaptureError, CapturedPacket, Direction};
use crate::{CHUNK_MAX, Datagram, Packet, SerialChunk};
use base::time::Tai;
use firmware_protocol::can::{CanFrame, CanId};
use std::collections::VecDeque;
use std::io::{ErrorKind, Read};

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

    fn broken(&self, source: std::io::Error) -> CaptureError {
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
        let skipped = std::io::copy(&mut self.source.by_ref().take(count), &mut std::io::sink());
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
