//! Plain messages of outside simulators: bytes of one datagram, record or line -> a [`PlainRecord`], and back.
//!
//! ```text
//! Datagram -> PlainCodec (PlainLayout) -> PlainRecord: time, attitude, jitter, observer in starloop's units and conventions
//! ```
//!
//! A simulator sends numbers and nothing else: no header, no checksum, no handshake. [`PlainLayout`] says which numbers
//! come in which order, in which form ([`Encoding`]), units and sense of the quaternion. With `f64` in bytes the order
//! of the layout is the order in the message; JSON is an object with the fields' names, or an array in their order;
//! text has them in their order between blanks or commas. A wrong byte order or type shows in the quaternion's norm,
//! which must be 1 within
//! [`WRITTEN_NORM_TOLERANCE`](base::axes::WRITTEN_NORM_TOLERANCE). Each refusal has a [`PlainReject`], which is counted. Messages of the simulator 42 are lines that end
//! with `[ENDMSG]` or `[EOF]` (`forty_two`). Limits: 512 bytes per message, 64 fields; times are `f64`, which resolves Unix
//! seconds to
//! 0.24 us; numbers in JSON are read to the last bit but one. Tests: `tests`, and the fuzz target `plain`.

mod forty_two;
mod layout;
mod reject;

pub use forty_two::{ACKNOWLEDGE, is_end_of_message};
pub use layout::{Encoding, FIELD_NAMES, Field, LayoutError, PlainLayout, QuaternionSense, TimeMeaning};
pub use reject::{PlainReject, PlainRejectCounters, RefusedMessage};

use self::forty_two::FortyTwo;
use crate::Datagram;

// Packets -> records, with the state from one to the next; and back.

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
        let values = layout::read(&self.layout, bytes)?;
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
        let bytes = layout::write(&self.layout, &values);
        let datagram = Datagram::new(&bytes).filter(|_| !bytes.is_empty())?;
        self.sent = self.sent.wrapping_add(1);
        Some(datagram)
    }
}

impl PlainLayout {
    /// Returns true if these bytes are a message of this layout, which identifies a sender.
    pub fn is_message(&self, bytes: &[u8]) -> bool {
        layout::read(self, bytes).and_then(|values| self.record(&values)).is_ok()
    }
}

// Numbers of messages: one that was received lately is refused.
//
// Any number that is not among the last [`KEPT`] is taken: a sender that starts again begins where it likes.

/// Numbers that are remembered.
const KEPT: usize = 64;

/// The last numbers.
#[derive(Debug, Clone)]
struct Sequence {
    last: [f64; KEPT],
    count: usize,
}

impl Default for Sequence {
    fn default() -> Self {
        Self { last: [f64::NAN; KEPT], count: 0 }
    }
}

impl Sequence {
    /// Takes a number.
    #[allow(clippy::float_cmp, reason = "numbers of messages are copied, not computed")]
    fn take(&mut self, number: f64) -> Result<(), PlainReject> {
        if self.last.contains(&number) {
            return Err(PlainReject::Repeated);
        }
        self.last[self.count % KEPT] = number;
        self.count = self.count.wrapping_add(1);
        Ok(())
    }
}

#[cfg(test)]
mod tests;

/// Most fields of a layout.
pub const FIELDS_MAX: usize = crate::DATAGRAM_MAX / size_of::<f64>();

/// When the values of a record hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlainTime {
    /// At the arrival of its message.
    Arrival,
    /// At this reading of the sender's clock, ns since any epoch.
    Tag(i64),
}

/// An attitude in starloop's conventions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlainAttitude {
    /// Body from ICRF, Hamilton, passive, scalar first; its norm is 1 within
    /// [`WRITTEN_NORM_TOLERANCE`](base::axes::WRITTEN_NORM_TOLERANCE).
    pub q_wxyz: [f64; 4],
    /// Angular rate with respect to ICRF, body axes, rad/s.
    pub rate_rad_s: [f64; 3],
    /// Angular acceleration, body axes, rad/s^2; zero where the layout has none.
    pub acceleration_rad_s2: [f64; 3],
}

/// Position and velocity about the centre of the observer's body, ICRF axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlainState {
    /// Position, km.
    pub position_km: [f64; 3],
    /// Velocity, km/s.
    pub velocity_km_s: [f64; 3],
}

/// One plain message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlainRecord {
    /// When its values hold.
    pub time: PlainTime,
    /// Attitude and rate, where the layout has them.
    pub attitude: Option<PlainAttitude>,
    /// Rotation vector of the line of sight, body axes, rad, where the layout has it.
    pub jitter_rad: Option<[f64; 3]>,
    /// State of the observer, where the layout has it.
    pub observer: Option<PlainState>,
}
