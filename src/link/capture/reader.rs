//! A capture file of either format -> packets, one at a time.

use super::pcapng::{PcapngReader, SECTION};
use super::{CaptureError, CaptureFormat, CapturedPacket, LINE_MAX, Line, parse_line};
use std::io::{BufRead, BufReader, Chain, Cursor, Read};

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
