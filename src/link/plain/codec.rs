//! Packets -> records, with the state from one to the next; and back.

use super::layout::{Encoding, PlainLayout};
use super::{PlainRecord, PlainReject, PlainRejectCounters, RefusedMessage, numbers};
use super::{forty_two::FortyTwo, sequence::Sequence};
use crate::Datagram;

/// Reads and writes the plain messages of one link.
#[derive(Debug, Clone)]
pub struct PlainCodec {
    layout: PlainLayout,
    sequence: Sequence,
    forty_two: FortyTwo,
    rejects: PlainRejectCounters,
    first_refused: Option<RefusedMessage>,
    sent: u32,
}

impl PlainCodec {
    /// Returns a codec that has read nothing.
    pub fn new(layout: PlainLayout) -> Self {
        let (sequence, rejects) = (Sequence::default(), PlainRejectCounters::default());
        Self { layout, sequence, forty_two: FortyTwo::default(), rejects, first_refused: None, sent: 0 }
    }

    /// Returns which numbers it reads.
    pub fn layout(&self) -> &PlainLayout {
        &self.layout
    }

    /// Returns how often and why messages were refused.
    pub fn rejects(&self) -> &PlainRejectCounters {
        &self.rejects
    }

    /// Returns the first message, or line of 42, that was refused.
    pub fn first_refused(&self) -> Option<RefusedMessage> {
        self.first_refused
    }

    /// Reads a message; `None` for one that is refused and counted, and for a line of 42 before the last of its
    /// message.
    pub fn read(&mut self, bytes: &[u8]) -> Option<PlainRecord> {
        let record = match self.layout.encoding {
            Encoding::FortyTwo(spacecraft) => self.forty_two.take(bytes, spacecraft, self.layout.time),
            Encoding::F64Le | Encoding::F64Be | Encoding::Json | Encoding::Text => {
                self.read_message(bytes).map(Some).map_err(|reject| RefusedMessage::new(reject, bytes))
            }
        };
        record.unwrap_or_else(|refused| {
            self.rejects.count(refused.reason);
            self.first_refused.get_or_insert(refused);
            None
        })
    }

    fn read_message(&mut self, bytes: &[u8]) -> Result<PlainRecord, PlainReject> {
        let values = numbers::read(&self.layout, bytes)?;
        let record = self.layout.record(&values)?;
        if let Some(number) = values.sequence {
            self.sequence.take(number)?;
        }
        Ok(record)
    }

    /// Writes the message of a record; `None` where the form is not written (42), or it would be too long.
    #[must_use]
    pub fn write(&mut self, record: &PlainRecord) -> Option<Datagram> {
        let values = self.layout.values(record, self.sent);
        let bytes = numbers::write(&self.layout, &values);
        let datagram = Datagram::new(&bytes).filter(|_| !bytes.is_empty())?;
        self.sent = self.sent.wrapping_add(1);
        Some(datagram)
    }
}

impl PlainLayout {
    /// Returns true if these bytes are a message of this layout, which identifies a sender.
    pub fn is_message(&self, bytes: &[u8]) -> bool {
        numbers::read(self, bytes).and_then(|values| self.record(&values)).is_ok()
    }
}
