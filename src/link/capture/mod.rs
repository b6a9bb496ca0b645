//! Captured packets in files: candump log text and pcapng, written and read.
//!
//! ```text
//! CapturedPacket -> CaptureWriter -> bus.log, bus.pcapng -> CaptureReader -> CapturedPacket
//! ```
//!
//! In and out: packets with the instant and the direction in which they passed, and the number of the interface. One
//! file holds several interfaces: pcapng blocks named link0, link1, ..., the interface column can0, can1, ... of a
//! candump log. In files of other programs the number is taken from the name, or from the place of the interface in its
//! section. Stamps are Unix time to the nanosecond in both formats; pcapng keeps the instant (TAI) beside it, a candump
//! log does not distinguish a leap second from the second after it. A candump log holds CAN only; pcapng holds CAN
//! (link type 227, SocketCAN), serial bytes (link type 147, USER0) and plain datagrams (link type 148, USER1). Readers
//! accept any bytes: errors are reported with line or offset, a file that was cut off is read up to the cut, and memory
//! is bounded by `BLOCK_MAX` and `LINE_MAX` whatever lengths a file states. Frames that have no [`Packet`] (remote and
//! error frames) are skipped and counted. Sources: candump's log format as written by
//! can-utils; pcapng, IETF draft-ietf-opsawg-pcapng; LINKTYPE_CAN_SOCKETCAN as registered by tcpdump.org. Tests:
//! `tests`, and `hil_scripts` against can-utils, python-can and tshark.

mod candump;
mod pcapng;

pub use candump::{Line, parse_line};

use self::pcapng::{PcapngReader, PcapngWriter, SECTION};
use crate::Packet;
use base::time::{Span, Tai};
use std::io::{BufRead, BufReader, Chain, Cursor, Read, Write};

// Why a capture file cannot be written or read.

/// A capture file that cannot be written, or not read any further.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The system refused to write.
    #[error("capture cannot be written: {0}")]
    Write(#[source] std::io::Error),
    /// A packet that the format has no form for.
    #[error(
        "capture: got a packet of a serial line or of a plain link, wanted CAN: a candump log holds CAN only; use pcapng"
    )]
    NotCan,
    /// The system refused to read.
    #[error("capture cannot be read at byte {offset}: {source}")]
    Read {
        /// Bytes read before.
        offset: u64,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The thread that writes broke down.
    #[error("capture: the thread that writes it broke down; the file ends somewhere before the run did")]
    WriterLost,
    /// The thread that writes blocks.
    #[error(
        "{file} cannot be written: nothing was written for {:.1} s and the rest was given up: is the disk still there?",
        patience.s()
    )]
    GivenUp {
        /// Name of the file of the capture.
        file: &'static str,
        /// Time that was waited.
        patience: Span,
    },
    /// The file is empty.
    #[error("capture: got an empty file, wanted a candump log or pcapng")]
    Empty,
    /// The older format.
    #[error("capture: got a classic pcap file, wanted pcapng or a candump log; convert it: editcap -F pcapng IN OUT")]
    ClassicPcap,
    /// A line that is not a line of a candump log.
    #[error("capture line {line}: {why}; got \"{text}\", wanted such as (1772366400.123456789) can0 123#DEADBEEF")]
    Line {
        /// Line, from 1.
        line: u64,
        /// Fault of the line.
        why: &'static str,
        /// Its beginning.
        text: String,
    },
    /// A pcapng block that is damaged.
    #[error("capture block at byte {offset}: {why}")]
    Block {
        /// Place of the block's start.
        offset: u64,
        /// Fault of the block, with what was wanted and got.
        why: String,
    },
    /// The file ends inside a line or block, as after a power cut: everything before it was read.
    #[error("capture is cut off at {place}: everything before it was read")]
    CutOff {
        /// Line or byte.
        place: String,
    },
}

// A capture file of either format -> packets, one at a time.

/// First words of classic pcap files, in microseconds and nanoseconds, in either byte order.
const CLASSIC_PCAP: [u32; 4] = [0xA1B2_C3D4, 0xD4C3_B2A1, 0xA1B2_3C4D, 0x4D3C_B2A1];
/// Characters of a refused line that are reported.
const REPORTED: usize = 60;

/// Reads packets; after an error or the end there are no more.
pub struct CaptureReader<R: Read> {
    form: Form<R>,
    is_over: bool,
}

enum Form<R: Read> {
    Candump(LineReader<Chain<Cursor<Vec<u8>>, BufReader<R>>>),
    Pcapng(PcapngReader<Chain<Cursor<Vec<u8>>, BufReader<R>>>),
}

impl<R: Read> CaptureReader<R> {
    /// Opens a capture; the first bytes decide the format.
    ///
    /// # Errors
    /// When they cannot be read, are missing, or belong to an unknown format.
    pub fn new(source: R) -> Result<Self, CaptureError> {
        let mut source = BufReader::new(source);
        let mut first = Vec::new();
        let read = |error| CaptureError::Read { offset: 0, source: error };
        source.by_ref().take(4).read_to_end(&mut first).map_err(read)?;
        let magic = <[u8; 4]>::try_from(first.as_slice()).map_or(0, u32::from_le_bytes);
        if first.is_empty() {
            return Err(CaptureError::Empty);
        }
        if CLASSIC_PCAP.contains(&magic) {
            return Err(CaptureError::ClassicPcap);
        }
        let source = Cursor::new(first).chain(source);
        let form = if magic == SECTION {
            Form::Pcapng(PcapngReader::new(source))
        } else {
            Form::Candump(LineReader { source, text: Vec::with_capacity(LINE_MAX), line: 0, skipped: 0 })
        };
        Ok(Self { form, is_over: false })
    }

    /// Returns which format it is.
    pub fn format(&self) -> CaptureFormat {
        match self.form {
            Form::Candump(_) => CaptureFormat::Candump,
            Form::Pcapng(_) => CaptureFormat::Pcapng,
        }
    }

    /// Returns frames so far that have no form here: remote and error frames, other link types.
    pub fn skipped(&self) -> u64 {
        match &self.form {
            Form::Candump(reader) => reader.skipped,
            Form::Pcapng(reader) => reader.skipped,
        }
    }

    /// Returns the next packet; `None` at the end and after an error.
    ///
    /// # Errors
    /// When the file is damaged or cut off here.
    pub fn read(&mut self) -> Result<Option<CapturedPacket>, CaptureError> {
        if self.is_over {
            return Ok(None);
        }
        let packet = match &mut self.form {
            Form::Candump(reader) => reader.next(),
            Form::Pcapng(reader) => reader.next(),
        };
        self.is_over = !matches!(packet, Ok(Some(_)));
        packet
    }
}

/// Reads lines of bounded length.
struct LineReader<R> {
    source: R,
    text: Vec<u8>,
    line: u64,
    skipped: u64,
}

impl<R: BufRead> LineReader<R> {
    fn next(&mut self) -> Result<Option<CapturedPacket>, CaptureError> {
        loop {
            self.line += 1;
            self.text.clear();
            let limit = LINE_MAX as u64 + 1;
            match self.source.by_ref().take(limit).read_until(b'\n', &mut self.text) {
                Ok(0) => return Ok(None),
                Ok(_) => {}
                Err(source) => return Err(CaptureError::Read { offset: 0, source }),
            }
            let is_whole = self.text.last() == Some(&b'\n');
            if !is_whole && self.text.len() > LINE_MAX {
                return Err(self.refuse("longer than 1024 bytes"));
            }
            match parse_line(&self.text) {
                Ok(Line::Packet(packet)) if is_whole => return Ok(Some(packet)),
                Ok(Line::Skipped) => self.skipped += 1,
                Ok(Line::Blank) => {}
                // Digits may be missing even where the remaining text reads as a frame.
                _ if !is_whole => return Err(CaptureError::CutOff { place: format!("line {}", self.line) }),
                Ok(Line::Packet(_)) => {}
                Err(why) => return Err(self.refuse(why)),
            }
        }
    }

    fn refuse(&self, why: &'static str) -> CaptureError {
        let reported = String::from_utf8_lossy(&self.text);
        let text = reported.trim().chars().take(REPORTED).map(|c| if c.is_control() { '.' } else { c }).collect();
        CaptureError::Line { line: self.line, why, text }
    }
}

// Packets -> a capture file.

/// Writes packets in a format of choice. The output should be buffered.
pub struct CaptureWriter<W: Write> {
    form: Output<W>,
}

enum Output<W: Write> {
    Candump(W),
    Pcapng(PcapngWriter<W>),
}

impl<W: Write> CaptureWriter<W> {
    /// Begins a capture.
    ///
    /// # Errors
    /// When its beginning cannot be written.
    pub fn new(out: W, format: CaptureFormat) -> Result<Self, CaptureError> {
        let form = match format {
            CaptureFormat::Candump => Output::Candump(out),
            CaptureFormat::Pcapng => Output::Pcapng(PcapngWriter::new(out).map_err(CaptureError::Write)?),
        };
        Ok(Self { form })
    }

    /// Writes one packet.
    ///
    /// # Errors
    /// When the format has no form for it, or it cannot be written.
    pub fn write(&mut self, captured: &CapturedPacket) -> Result<(), CaptureError> {
        match (&mut self.form, &captured.packet) {
            (Output::Candump(out), Packet::Can(frame)) => {
                candump::write_line(out, captured, frame).map_err(CaptureError::Write)
            }
            (Output::Candump(_), Packet::Serial(_) | Packet::Datagram(_)) => Err(CaptureError::NotCan),
            (Output::Pcapng(writer), _) => writer.write(captured).map_err(CaptureError::Write),
        }
    }

    /// Hands everything to the system.
    ///
    /// # Errors
    /// When it does not take it.
    pub fn flush(&mut self) -> Result<(), CaptureError> {
        let out: &mut dyn Write = match &mut self.form {
            Output::Candump(out) => out,
            Output::Pcapng(writer) => writer.out(),
        };
        out.flush().map_err(CaptureError::Write)
    }
}

#[cfg(test)]
mod tests;

/// Longest line of a candump log, bytes.
pub const LINE_MAX: usize = 1024;
/// Longest pcapng block that is read, bytes; blocks of other kinds are skipped whatever their length.
pub const BLOCK_MAX: usize = 256 * 1024;

/// Form of a capture file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum CaptureFormat {
    /// candump's log text: CAN only.
    Candump,
    /// pcapng: CAN, serial and plain datagrams.
    #[default]
    Pcapng,
}

/// Direction of a packet, as the capturing side saw it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// The packet was received.
    Received,
    /// The packet was sent.
    Sent,
}

/// A packet that passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CapturedPacket {
    /// Receive stamp, or the instant at which it left.
    pub at: Tai,
    /// Direction of the packet.
    pub direction: Direction,
    /// Number of the interface it passed, from 0; the last number is used for all beyond it.
    pub interface: u8,
    /// The packet itself.
    pub packet: Packet,
}
