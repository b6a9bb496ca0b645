//! The flight computer's side of the session: HELLO, INFO, RUN, each said again until it is answered.
//!
//! In: time and responses. Out: commands when due. A refusal ends the talk: nothing is said any more. Limits: one talk per
//! boot, begun with the stream. Tests: below, and `tests/closed_loop/session.rs`.

use firmware_protocol::message::{Command, Reply, Request, Response};
use firmware_protocol::version;

/// A command that is not answered is said again after this, us.
const RETRY_US: u64 = 500_000;

/// What is said, in this order.
const WORDS: [Request; 3] = [Request::Hello(version::CURRENT), Request::Info { page: 0 }, Request::Run];

/// The first word comes this long after the stream's begin, behind the first time mark, us.
pub(super) const BEGIN_US: u64 = 5_000;

/// How far the talk is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Talk {
    /// Word that is to be said or waits for its answer.
    word: usize,
    due_us: u64,
    is_refused: bool,
}

impl Talk {
    /// A talk that begins at `start_us`.
    pub(super) fn new(start_us: u64) -> Self {
        Self { word: 0, due_us: start_us, is_refused: false }
    }

    /// When the next word is due; `u64::MAX` when all is said.
    pub(super) fn next_us(&self) -> u64 {
        if self.is_refused || self.word >= WORDS.len() { u64::MAX } else { self.due_us }
    }

    /// The word that is due, to be said now.
    pub(super) fn take(&mut self, now_us: u64) -> Option<Command> {
        if self.next_us() > now_us {
            return None;
        }
        self.due_us = now_us + RETRY_US;
        let request = *WORDS.get(self.word)?;
        Some(Command { token: self.token(), request })
    }

    /// Takes an answer in; the next word is due at once.
    pub(super) fn hear(&mut self, response: &Response, now_us: u64) {
        if self.word >= WORDS.len() || response.token != self.token() {
            return;
        }
        match response.reply {
            Reply::Refused { .. } => self.is_refused = true,
            _ => (self.word, self.due_us) = (self.word + 1, now_us),
        }
    }

    /// True when RUN was accepted.
    pub(super) fn is_running(&self) -> bool {
        self.word >= WORDS.len()
    }

    fn token(&self) -> u8 {
        u8::try_from(self.word + 1).unwrap_or(u8::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_protocol::message::Refusal;

    fn answer(talk: &mut Talk, token: u8, reply: Reply, now_us: u64) {
        talk.hear(&Response { token, reply }, now_us);
    }

    #[test]
    fn each_word_is_said_until_its_own_answer_comes() {
        let mut talk = Talk::new(1000);
        assert_eq!(talk.take(999), None);
        let hello = talk.take(1000).unwrap();
        assert_eq!(hello, Command { token: 1, request: Request::Hello(version::CURRENT) });
        assert_eq!(talk.take(2000), None, "waits");
        assert_eq!(talk.take(1000 + RETRY_US), Some(hello), "the same token: a retry");
        answer(&mut talk, 7, Reply::Stop, 600_000);
        assert_eq!(talk.token(), 1, "the answer to something else");
        for (token, reply) in [(1, Reply::Run), (2, Reply::Run), (3, Reply::Run)] {
            assert!(!talk.is_running());
            answer(&mut talk, token, reply, 600_000);
        }
        assert!(talk.is_running());
        assert_eq!((talk.next_us(), talk.take(u64::MAX - 1)), (u64::MAX, None), "all is said");
    }

    #[test]
    fn who_is_refused_says_no_more() {
        let mut talk = Talk::new(0);
        talk.take(0);
        answer(&mut talk, 1, Reply::Refused { opcode: 1, reason: Refusal::WrongMajor }, 10);
        assert_eq!((talk.next_us(), talk.is_running()), (u64::MAX, false));
    }
}
