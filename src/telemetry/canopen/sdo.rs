//! SDO transfers of CiA 301: expedited ones, up to four bytes in one request and one answer, and texts that are read in
//! segments of seven bytes. Nothing else is longer in the dictionary.

use super::dictionary::{Access, Entry, PdoMap};

/// Reasons to abort a transfer, by the codes of CiA 301.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Abort {
    /// A segment was asked for twice, or one was left out.
    Toggle = 0x0503_0000,
    /// The command is not known, such as one of a block transfer.
    BadCommand = 0x0504_0001,
    /// It can only be written.
    WriteOnly = 0x0601_0001,
    /// It can only be read.
    ReadOnly = 0x0601_0002,
    /// The dictionary lacks the object.
    NoObject = 0x0602_0000,
    /// The value has another length than the object.
    BadLength = 0x0607_0010,
    /// The object has no such part.
    NoSub = 0x0609_0011,
    /// The value is out of its range.
    BadValue = 0x0609_0030,
    /// The device cannot do it now.
    NotNow = 0x0800_0022,
}

/// A request that is whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Read.
    Read(Entry),
    /// Read the next segment of a text, with this toggle bit.
    Segment(bool),
    /// Write these bytes, of the object's length, padded with zeros.
    Write(Entry, [u8; 4]),
    /// The client gives up.
    Abort,
}

/// Reads a request to a dictionary with this map; an abort goes back with index and sub-index.
///
/// # Errors
/// The reason to abort the transfer.
pub fn read(data: [u8; 8], map: &PdoMap) -> Result<Request, Abort> {
    let [command, low, high, sub, value @ ..] = data;
    let entry = || {
        let index = u16::from_le_bytes([low, high]);
        map.find(index, sub).ok_or(if map.has_index(index) { Abort::NoSub } else { Abort::NoObject })
    };
    match command >> 5 {
        1 if command & 0x02 != 0 => {
            let entry = entry()?;
            if matches!(entry.access, Access::ReadOnly | Access::Constant) {
                return Err(Abort::ReadOnly);
            }
            // Without a size, it is as long as the object.
            let bytes = if command & 0x01 != 0 { 4 - ((command >> 2) & 0x03) } else { entry.kind.bytes() };
            if bytes == entry.kind.bytes() { Ok(Request::Write(entry, value)) } else { Err(Abort::BadLength) }
        }
        2 => {
            let entry = entry()?;
            if entry.access == Access::WriteOnly { Err(Abort::WriteOnly) } else { Ok(Request::Read(entry)) }
        }
        3 => Ok(Request::Segment(command & 0x10 != 0)),
        4 => Ok(Request::Abort),
        _written_in_segments_or_blocks => Err(Abort::BadCommand),
    }
}

/// The answer to a read.
pub fn value(entry: &Entry, value: [u8; 4]) -> [u8; 8] {
    let command = 0x43 | ((4 - entry.kind.bytes()) << 2);
    with_place(command, entry.index, entry.sub, value)
}

/// A text under way to a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Text {
    rest: &'static [u8],
    toggle: bool,
}

impl Text {
    /// Begins with a text; the answer to the read has its length.
    pub fn begin(entry: &Entry, text: &'static str) -> (Self, [u8; 8]) {
        let length = u32::try_from(text.len()).unwrap_or(u32::MAX);
        let answer = with_place(0x41, entry.index, entry.sub, length.to_le_bytes());
        (Self { rest: text.as_bytes(), toggle: false }, answer)
    }

    /// Returns the next segment, and what is left after it: nothing after the last one.
    ///
    /// # Errors
    /// With the other toggle bit than that of this segment.
    pub fn next(self, toggle: bool) -> Result<([u8; 8], Option<Self>), Abort> {
        if toggle != self.toggle {
            return Err(Abort::Toggle);
        }
        let mut answer = [0; 8];
        let (now, rest) = self.rest.split_at(self.rest.len().min(SEGMENT));
        answer[1..=now.len()].copy_from_slice(now);
        let unused = u8::try_from(SEGMENT - now.len()).unwrap_or_default();
        answer[0] = u8::from(toggle) << 4 | unused << 1 | u8::from(rest.is_empty());
        Ok((answer, (!rest.is_empty()).then_some(Self { rest, toggle: !toggle })))
    }
}

/// Bytes of one segment.
const SEGMENT: usize = 7;

/// The answer to a write.
pub fn written(entry: &Entry) -> [u8; 8] {
    with_place(0x60, entry.index, entry.sub, [0; 4])
}

/// The answer to a request that is aborted.
pub fn aborted(request: [u8; 8], abort: Abort) -> [u8; 8] {
    let [_, low, high, sub, ..] = request;
    with_place(0x80, u16::from_le_bytes([low, high]), sub, (abort as u32).to_le_bytes())
}

fn with_place(command: u8, index: u16, sub: u8, [a, b, c, d]: [u8; 4]) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    [command, low, high, sub, a, b, c, d]
}

#[cfg(test)]
mod tests {
    use super::super::dictionary::STARLOOP;
    use super::*;

    fn find(index: u16, sub: u8) -> Option<Entry> {
        STARLOOP.find(index, sub)
    }

    fn read(data: [u8; 8]) -> Result<Request, Abort> {
        super::read(data, &STARLOOP)
    }

    #[test]
    fn a_text_goes_out_in_segments_of_seven_bytes() {
        let entry = find(0x1008, 0).unwrap();
        let (text, answer) = Text::begin(&entry, "starloop!");
        assert_eq!(answer, [0x41, 0x08, 0x10, 0, 9, 0, 0, 0]);
        assert_eq!(text.next(true), Err(Abort::Toggle));
        let (first, rest) = text.next(false).unwrap();
        assert_eq!(&first, b"\x00starloo");
        assert_eq!(rest.unwrap().next(false), Err(Abort::Toggle), "control");
        let (last, rest) = rest.unwrap().next(true).unwrap();
        assert_eq!((&last, rest), (b"\x1bp!\0\0\0\0\0", None));
        assert_eq!(read([0x70, 0, 0, 0, 0, 0, 0, 0]), Ok(Request::Segment(true)));
        assert_eq!(read([0x23, 0x08, 0x10, 0, 0, 0, 0, 0]), Err(Abort::ReadOnly));
    }

    #[test]
    fn requests_are_read_as_the_standard_has_them() {
        let heartbeat = find(0x1017, 0).unwrap();
        assert_eq!(read([0x40, 0x17, 0x10, 0, 0, 0, 0, 0]), Ok(Request::Read(heartbeat)));
        assert_eq!(read([0x2B, 0x17, 0x10, 0, 0xF4, 1, 0, 0]), Ok(Request::Write(heartbeat, [0xF4, 1, 0, 0])));
        assert_eq!(
            read([0x22, 0x17, 0x10, 0, 0xF4, 1, 0, 0]),
            Ok(Request::Write(heartbeat, [0xF4, 1, 0, 0])),
            "no size"
        );
        assert_eq!(value(&heartbeat, [0xF4, 1, 0, 0]), [0x4B, 0x17, 0x10, 0, 0xF4, 1, 0, 0]);
        assert_eq!(value(&find(0x1001, 0).unwrap(), [0; 4])[0], 0x4F);
        assert_eq!(value(&find(0x1000, 0).unwrap(), [0; 4])[0], 0x43);
        for (request, abort) in [
            ([0x40, 0x00, 0x50, 0, 0, 0, 0, 0], Abort::NoObject),
            ([0x40, 0x02, 0x40, 9, 0, 0, 0, 0], Abort::NoSub),
            ([0x23, 0x00, 0x10, 0, 0, 0, 0, 0], Abort::ReadOnly),
            ([0x23, 0x17, 0x10, 0, 0, 0, 0, 0], Abort::BadLength),
            ([0x40, 0x07, 0x40, 0, 0, 0, 0, 0], Abort::WriteOnly),
            ([0x21, 0x17, 0x10, 0, 9, 0, 0, 0], Abort::BadCommand),
            ([0xA0, 0x17, 0x10, 0, 0, 0, 0, 0], Abort::BadCommand),
        ] {
            assert_eq!(read(request), Err(abort), "{request:02x?}");
            assert_eq!(aborted(request, abort)[..4], [0x80, request[1], request[2], request[3]]);
        }
    }
}
