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

mod codec;
mod field;
mod forty_two;
mod layout;
mod numbers;
mod reject;
mod sequence;
#[cfg(test)]
mod tests;

pub use codec::PlainCodec;
pub use field::{FIELD_NAMES, Field};
pub(crate) use forty_two::{ACKNOWLEDGE, is_end_of_message};
pub use layout::{Encoding, LayoutError, PlainLayout, QuaternionSense, TimeMeaning};
pub use reject::{PlainReject, PlainRejectCounters, RefusedMessage};

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
