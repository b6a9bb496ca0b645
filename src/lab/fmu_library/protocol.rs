//! Messages between the library in a simulator's process and the program that runs the unit, over a pair of sockets.
//!
//! ```text
//! program: a reply for the start, then one for each request, in order
//! request: length u32 | operation u8 | content
//! reply:   length u32 | status u8 | length of the message u32 | message | content
//! ```
//!
//! Both ends are on one machine and of one version: bytes are in its order. A number is a word of eight bytes, an f64 or
//! an i64; a truth is 0 or 1; texts end with a zero each. Both crates compile this file, so that the library needs
//! nothing else.

use std::io::{self, Read, Write};

/// Longest message that is taken, bytes.
const LONGEST: usize = 1 << 26;

/// A kind of request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Operation {
    /// Enter initialisation: a word, the start in s.
    Enter,
    /// Leave initialisation.
    Exit,
    /// Take a step: words, from and length in s. The reply has a word: where the time is now, s.
    Step,
    /// End the run.
    Terminate,
    /// Begin again.
    Reset,
    /// Get variables: a [`selection`]. The reply has their values.
    Get,
    /// Set variables: a [`selection`], then their values.
    Set,
}

/// Types of variables on the way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// f64.
    Real,
    /// Whole numbers of any size.
    Whole,
    /// Truths.
    Boolean,
    /// Texts.
    Text,
}

/// How a call went: `fmi3Status`, and `fmi2Status` but for its pending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum Status {
    /// Done.
    Ok,
    /// Done, with something to know.
    Warning,
    /// Not done; the unit goes on as before.
    Discard,
    /// Not done.
    Error,
    /// The instance is lost.
    Fatal,
}

/// An answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Reply {
    /// How it went.
    pub status: Status,
    /// Why, for people; empty when all is well.
    pub message: String,
    /// Values that were asked for.
    pub content: Vec<u8>,
}

impl Reply {
    /// Returns an answer that is only a status and a reason.
    pub fn of(status: Status, message: impl Into<String>) -> Self {
        Self { status, message: message.into(), content: Vec::new() }
    }
}

const OPERATIONS: [Operation; 7] = [
    Operation::Enter,
    Operation::Exit,
    Operation::Step,
    Operation::Terminate,
    Operation::Reset,
    Operation::Get,
    Operation::Set,
];
const KINDS: [Kind; 4] = [Kind::Real, Kind::Whole, Kind::Boolean, Kind::Text];
const STATUSES: [Status; 5] = [Status::Ok, Status::Warning, Status::Discard, Status::Error, Status::Fatal];

/// Returns the start of a content that names variables: their type, how many, their references.
pub fn selection(kind: Kind, references: &[u32]) -> Vec<u8> {
    let mut out = vec![kind as u8];
    out.extend(u32::try_from(references.len()).unwrap_or(u32::MAX).to_ne_bytes());
    references.iter().for_each(|reference| out.extend(reference.to_ne_bytes()));
    out
}

/// Reads a selection; returns its type, its references, and what follows it.
pub fn read_selection(content: &[u8]) -> Option<(Kind, Vec<u32>, &[u8])> {
    let (kind, rest) = content.split_first()?;
    let (count, rest) = rest.split_first_chunk::<4>()?;
    let bytes = usize::try_from(u32::from_ne_bytes(*count)).ok()?.checked_mul(4)?;
    let (references, rest) = rest.split_at_checked(bytes)?;
    let references = references.as_chunks::<4>().0.iter().map(|word| u32::from_ne_bytes(*word)).collect();
    Some((*KINDS.get(usize::from(*kind))?, references, rest))
}

/// Returns the bytes of a request.
pub fn request(operation: Operation, content: &[u8]) -> Vec<u8> {
    framed(&[&[operation as u8], content])
}

/// Reads a request; `None` when the other end has gone.
///
/// # Errors
/// When a message ends early or makes no sense.
pub fn read_request(from: &mut impl Read) -> io::Result<Option<(Operation, Vec<u8>)>> {
    let Some(mut message) = read_message(from)? else { return Ok(None) };
    let code = message.first().copied().ok_or_else(garbled)?;
    let operation = *OPERATIONS.get(usize::from(code)).ok_or_else(garbled)?;
    Ok(Some((operation, message.split_off(1))))
}

/// Writes a reply.
///
/// # Errors
/// When the other end has gone.
pub fn write_reply(to: &mut impl Write, reply: &Reply) -> io::Result<()> {
    let length = u32::try_from(reply.message.len()).map_err(|_| garbled())?.to_ne_bytes();
    to.write_all(&framed(&[&[reply.status as u8], &length, reply.message.as_bytes(), &reply.content]))
}

/// Reads a reply; `None` when the other end has gone.
///
/// # Errors
/// When a message ends early or makes no sense.
pub fn read_reply(from: &mut impl Read) -> io::Result<Option<Reply>> {
    let Some(message) = read_message(from)? else { return Ok(None) };
    parsed_reply(&message).map(Some).ok_or_else(garbled)
}

fn parsed_reply(message: &[u8]) -> Option<Reply> {
    let (code, rest) = message.split_first()?;
    let (length, rest) = rest.split_first_chunk::<4>()?;
    let (text, content) = rest.split_at_checked(usize::try_from(u32::from_ne_bytes(*length)).ok()?)?;
    let message = String::from_utf8_lossy(text).into_owned();
    Some(Reply { status: *STATUSES.get(usize::from(*code))?, message, content: content.to_vec() })
}

fn framed(parts: &[&[u8]]) -> Vec<u8> {
    let length: usize = parts.iter().map(|part| part.len()).sum();
    let mut out = u32::try_from(length).unwrap_or(u32::MAX).to_ne_bytes().to_vec();
    parts.iter().for_each(|part| out.extend_from_slice(part));
    out
}

fn read_message(from: &mut impl Read) -> io::Result<Option<Vec<u8>>> {
    let mut length = [0; 4];
    match from.read_exact(&mut length) {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        Err(error) => return Err(error),
    }
    let length = usize::try_from(u32::from_ne_bytes(length)).map_err(|_| garbled())?;
    if length > LONGEST {
        return Err(garbled());
    }
    let mut message = vec![0; length];
    from.read_exact(&mut message)?;
    Ok(Some(message))
}

fn garbled() -> io::Error {
    io::Error::new(
        io::ErrorKind::InvalidData,
        "a message that makes no sense: the library and the program are not of one unit",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_and_replies_come_back() {
        let content = selection(Kind::Boolean, &[7, 70_000]);
        let bytes = [request(Operation::Get, &content), request(Operation::Reset, &[])].concat();
        let mut from = bytes.as_slice();
        assert_eq!(read_request(&mut from).unwrap(), Some((Operation::Get, content.clone())));
        assert_eq!(read_request(&mut from).unwrap(), Some((Operation::Reset, Vec::new())));
        assert_eq!(read_request(&mut from).unwrap(), None, "the other end has gone");
        let (kind, references, rest) = read_selection(&content).unwrap();
        assert_eq!((kind, references, rest), (Kind::Boolean, vec![7, 70_000], [].as_slice()));
        let (mut wire, reply) = (Vec::new(), Reply { content: vec![1, 2], ..Reply::of(Status::Warning, "lost 2") });
        write_reply(&mut wire, &reply).unwrap();
        assert_eq!(read_reply(&mut wire.as_slice()).unwrap(), Some(reply));
    }

    #[test]
    fn bytes_that_make_no_sense_are_refused() {
        let codes = [OPERATIONS.len() as u8, 255];
        assert!(OPERATIONS.iter().enumerate().all(|(code, operation)| *operation as usize == code));
        assert!(KINDS.iter().enumerate().all(|(code, kind)| *kind as usize == code));
        assert!(STATUSES.iter().enumerate().all(|(code, status)| *status as usize == code));
        for bytes in codes.map(|code| framed(&[&[code]])).iter().chain([&framed(&[]), &vec![255; 9]]) {
            assert!(read_request(&mut bytes.as_slice()).is_err(), "{bytes:?}");
        }
        assert!(read_request(&mut [3, 0, 0, 0, 5].as_slice()).is_err(), "it ends early");
        assert!(read_selection(&[0, 255, 255, 255, 255]).is_none(), "more references than bytes");
    }
}
