//! Messages between the library in a simulator's process and the program that runs the unit, over a pair of sockets.
//!
//! ```text
//! program: a reply for the start, then one for each request, in order
//! message: length of the rest u32 | code u8 | length of the head u32 | head | content
//! request: code: its operation; head: references of variables, u32 each; content: values for them, or times
//! reply:   code: its status; head: the reason, a text; content: values that were asked for
//! ```
//!
//! Both ends are on one machine and of one version: bytes are in its order. A number is a word of eight bytes, an f64 or
//! an i64; a truth is 0 or 1; texts end with a zero each. Both crates compile this file, so that the library needs
//! nothing else.

use core::ffi::CStr;
use std::io::{self, Read};

/// Types of variables on the way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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

/// A kind of request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
    /// Get variables of a type. The reply has their values.
    Get(Kind),
    /// Set variables of a type.
    Set(Kind),
}

/// How a call went: `fmi3Status` and `fmi2Status`, without those that no call ends with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum Status {
    /// Done.
    Ok = 0,
    /// Done, with something to know.
    Warning = 1,
    /// Not done.
    Error = 3,
    /// The instance is lost.
    Fatal = 4,
}

/// Values that travel as their place in a list.
pub trait Coded: Copy + PartialEq + 'static {
    /// The list.
    const ALL: &'static [Self];
}

impl Coded for Operation {
    const ALL: &'static [Self] = &[
        Self::Enter,
        Self::Exit,
        Self::Step,
        Self::Terminate,
        Self::Reset,
        Self::Get(Kind::Real),
        Self::Get(Kind::Whole),
        Self::Get(Kind::Boolean),
        Self::Get(Kind::Text),
        Self::Set(Kind::Real),
        Self::Set(Kind::Whole),
        Self::Set(Kind::Boolean),
        Self::Set(Kind::Text),
    ];
}

impl Coded for Status {
    const ALL: &'static [Self] = &[Self::Ok, Self::Warning, Self::Error, Self::Fatal];
}

/// A request or a reply.
#[derive(Debug, Clone, PartialEq)]
pub struct Message<Code> {
    /// Its operation or its status.
    pub code: Code,
    /// References, or a text for people that is empty when all is well.
    pub head: Vec<u8>,
    /// Values.
    pub content: Vec<u8>,
}

/// From the library to the program.
pub type Request = Message<Operation>;
/// From the program to the library.
pub type Reply = Message<Status>;

impl<Code: Coded> Message<Code> {
    /// Returns its bytes on the socket.
    pub fn bytes(&self) -> Vec<u8> {
        let place = Code::ALL.iter().position(|code| *code == self.code).unwrap_or(Code::ALL.len());
        let length = |bytes: usize| u32::try_from(bytes).unwrap_or(u32::MAX).to_ne_bytes();
        let (whole, head) = (length(5 + self.head.len() + self.content.len()), length(self.head.len()));
        [&whole[..], &[place as u8], &head, &self.head, &self.content].concat()
    }

    /// Reads the next one.
    ///
    /// # Errors
    /// `UnexpectedEof` when the other end has gone, `InvalidData` for what makes no sense.
    pub fn read(from: &mut impl Read) -> io::Result<Self> {
        let mut length = [0; 4];
        from.read_exact(&mut length)?;
        let mut bytes = vec![0; u32::from_ne_bytes(length) as usize];
        from.read_exact(&mut bytes)?;
        Self::parsed(&bytes).ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, GARBLED))
    }

    fn parsed(bytes: &[u8]) -> Option<Self> {
        let (place, rest) = bytes.split_first()?;
        let (length, rest) = rest.split_first_chunk()?;
        let (head, content) = rest.split_at_checked(u32::from_ne_bytes(*length) as usize)?;
        let code = *Code::ALL.get(usize::from(*place))?;
        Some(Self { code, head: head.into(), content: content.into() })
    }
}

impl Reply {
    /// Returns an answer that is only a status and a reason.
    pub fn of(code: Status, why: &str) -> Self {
        Self { code, head: why.into(), content: Vec::new() }
    }
}

/// Returns numbers as words.
pub fn words(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_ne_bytes()).collect()
}

/// Takes the word at the front of values; `None` where there are fewer bytes.
pub fn next_word(rest: &mut &[u8]) -> Option<[u8; 8]> {
    let (word, others) = rest.split_first_chunk()?;
    *rest = others;
    Some(*word)
}

/// Takes the text at the front of values; `None` where none ends.
pub fn next_text<'a>(rest: &mut &'a [u8]) -> Option<&'a CStr> {
    let text = CStr::from_bytes_until_nul(rest).ok()?;
    *rest = rest.get(text.count_bytes() + 1..)?;
    Some(text)
}

const GARBLED: &str = "a message that makes no sense: the library and the program are not of one unit";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_and_replies_come_back() {
        let request = |code| Request { code, head: vec![7, 0, 0, 0], content: words(&[0.5]) };
        let sent: Vec<_> = Operation::ALL.iter().map(|code| request(*code)).collect();
        let bytes: Vec<u8> = sent.iter().flat_map(Request::bytes).collect();
        let mut from = bytes.as_slice();
        let back: Vec<_> = sent.iter().map(|_| Request::read(&mut from).unwrap()).collect();
        assert_eq!(back, sent);
        let gone = Request::read(&mut from).unwrap_err();
        assert_eq!(gone.kind(), io::ErrorKind::UnexpectedEof, "the other end has gone");
        for code in [Status::Ok, Status::Warning, Status::Error, Status::Fatal] {
            let reply = Reply { content: vec![1, 2], ..Reply::of(code, "lost 2") };
            assert_eq!(Reply::read(&mut reply.bytes().as_slice()).unwrap(), reply);
        }
    }

    #[test]
    fn bytes_that_make_no_sense_are_refused() {
        let good = Request { code: Operation::Exit, head: vec![1, 2, 3, 4], content: vec![5] }.bytes();
        assert!(Request::read(&mut good.as_slice()).is_ok(), "control");
        for (place, byte) in [(4, 200), (5, 200), (0, 2)] {
            let mut bad = good.clone();
            bad[place] = byte;
            assert_eq!(Request::read(&mut bad.as_slice()).unwrap_err().kind(), io::ErrorKind::InvalidData, "{place}");
        }
        assert!(Request::read(&mut &good[..8]).is_err(), "it ends early");
    }
}
