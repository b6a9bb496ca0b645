//! Replayed sequence numbers.

use crate::{Message, Reject};

/// How far behind the newest a sequence number counts as replayed. Further behind, the sender has restarted.
const REPLAY_WINDOW: u8 = 16;

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
}

impl Sequences {
    /// Passes a message on unless its sequence number was received already.
    pub(crate) fn admit(&mut self, message: Message) -> Result<Message, Reject> {
        match &message {
            Message::Attitude(record) => self.attitude.admit(record.seq)?,
            Message::Jitter(burst) => self.jitter.admit(burst.seq)?,
            Message::JitterPair(pair) => self.jitter_pair.admit(pair.slot)?,
            _ => {}
        }
        Ok(message)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
