//! Replayed sequence numbers: the only place that refuses them.
//!
//! A sender that restarts begins to count again. It is recognised by a number further behind than the window, by a
//! HELLO, and by a SCET that runs backwards by a second or more: from there on every number is new.

use crate::message::Request;
use crate::{Message, Reject};

/// How far behind the newest a sequence number counts as replayed. Further behind, the sender has restarted.
pub const REPLAY_WINDOW: u8 = 16;

#[derive(Debug, Clone, Copy, Default)]
struct Sequence {
    newest: Option<u8>,
}

impl Sequence {
    fn admit(&mut self, seq: u8) -> Result<(), Reject> {
        if self.newest.is_some_and(|newest| newest.wrapping_sub(seq) < REPLAY_WINDOW) {
            return Err(Reject::ReplayedSequence);
        }
        self.newest = Some(seq);
        Ok(())
    }
}

/// The newest sequence number of each stream that has one.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sequences {
    attitude: Sequence,
    jitter: Sequence,
    jitter_pair: Sequence,
    /// Whole seconds of the newest SCET; 0 before the first.
    scet_s: u32,
}

impl Sequences {
    /// Passes a message on unless its sequence number was received already.
    pub(crate) fn admit(&mut self, message: Message) -> Result<Message, Reject> {
        match &message {
            Message::TimeFollowUp(follow_up) => self.follow_scet(follow_up.scet.seconds()),
            Message::Command(command) if matches!(command.request, Request::Hello(_)) => {
                *self = Self { scet_s: self.scet_s, ..Self::default() };
            }
            Message::Attitude(record) => self.attitude.admit(record.seq)?,
            Message::Jitter(burst) => self.jitter.admit(burst.seq)?,
            Message::JitterPair(pair) => self.jitter_pair.admit(pair.slot)?,
            Message::Sync(_)
            | Message::Wheels(_)
            | Message::Table(_)
            | Message::Exposure(_)
            | Message::Status(_)
            | Message::Camera(_)
            | Message::Command(_)
            | Message::Response(_)
            | Message::Heartbeat(_) => {}
        }
        Ok(message)
    }

    fn follow_scet(&mut self, scet_s: u32) {
        if scet_s < self.scet_s {
            *self = Self::default();
        }
        self.scet_s = scet_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{Command, JitterPair, Scet, TimeFollowUp};
    use crate::version::CURRENT;

    #[test]
    fn replays_are_refused_gaps_wraps_and_restarts_are_not() {
        let mut sequence = Sequence::default();
        let refused = Err(Reject::ReplayedSequence);
        for (seq, wanted) in
            [(250, Ok(())), (250, refused), (249, refused), (255, Ok(())), (3, Ok(())), (251, refused), (200, Ok(()))]
        {
            assert_eq!(sequence.admit(seq), wanted, "sequence number {seq}");
        }
    }

    fn pair(slot: u8) -> Message {
        Message::JitterPair(JitterPair { slot, samples_arcsec: [[0.0; 2]; 2] })
    }

    fn time(seconds: u32) -> Message {
        Message::TimeFollowUp(TimeFollowUp { scet: Scet::new(seconds, 0).unwrap(), counter: 0 })
    }

    /// The numbers 5 and then 0: a replay, unless what lies between them shows a restart.
    #[test]
    fn restart_is_shown_by_hello_or_by_a_scet_that_runs_backwards() {
        let hello = Message::Command(Command { token: 1, request: Request::Hello(CURRENT) });
        let run = Message::Command(Command { token: 1, request: Request::Run });
        for (between, is_new) in
            [(time(101), false), (time(100), false), (run, false), (hello, true), (time(99), true), (time(0), true)]
        {
            let mut sequences = Sequences::default();
            for message in [time(100), pair(5), between] {
                assert_eq!(sequences.admit(message), Ok(message));
            }
            assert_eq!(sequences.admit(pair(0)).is_ok(), is_new, "after {between:?}");
            assert_eq!(sequences.admit(pair(0)), Err(Reject::ReplayedSequence), "and counted from there on");
        }
    }
}
