//! Time correlation in two steps: SYNC marks an instant, TIME_FUP says which one it was.
//!
//! HEARTBEAT is the sign of life of the flight computer. The stimulator's is STATUS: two nodes must not send one identifier.

use crate::Reject;
use crate::bytes::{Reader, Writer};

/// `0x080`, 1 byte: the instant at which this frame ends on the bus is the mark.
///
/// | byte | field |
/// |---|---|
/// | 0 | counter |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sync {
    /// Counts up by one, wraps.
    pub counter: u8,
}

/// Spacecraft elapsed time: seconds and 2^-24 s (59.6 ns) since the sender's epoch.
///
/// The time tags of all messages are this time in microseconds, modulo 2^32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Scet {
    seconds: u32,
    fraction: u32,
}

/// `0x20n`, 8 bytes: when the SYNC with the same counter actually left.
///
/// | byte | field |
/// |---|---|
/// | 0..4 | SCET, s, u32 |
/// | 4..7 | SCET, 2^-24 s, u24 |
/// | 7 | counter of the SYNC |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimeFollowUp {
    /// Instant at which the SYNC left.
    pub scet: Scet,
    /// Counter of that SYNC.
    pub counter: u8,
}

const FRACTIONS_PER_S: u64 = 1 << 24;
const NS_PER_S: u64 = 1_000_000_000;

impl Scet {
    /// Returns the time of whole seconds and 2^-24 s; `None` when the fraction is a second or more.
    pub fn new(seconds: u32, fraction: u32) -> Option<Self> {
        (u64::from(fraction) < FRACTIONS_PER_S).then_some(Self { seconds, fraction })
    }

    /// Returns the latest SCET that is not after `ns`; seconds wrap after 136 years.
    #[allow(clippy::cast_possible_truncation, reason = "seconds wrap by definition; the fraction is below 2^24")]
    pub const fn from_ns(ns: u64) -> Self {
        let seconds = (ns / NS_PER_S) as u32;
        Self { seconds, fraction: (ns % NS_PER_S * FRACTIONS_PER_S / NS_PER_S) as u32 }
    }

    /// Returns nanoseconds since the sender's epoch, rounded to nearest.
    pub const fn ns(self) -> u64 {
        let fraction_ns = (self.fraction as u64 * NS_PER_S + FRACTIONS_PER_S / 2) / FRACTIONS_PER_S;
        self.seconds as u64 * NS_PER_S + fraction_ns
    }

    /// Returns the whole seconds.
    pub const fn seconds(self) -> u32 {
        self.seconds
    }

    /// Returns the rest, 2^-24 s.
    pub const fn fraction(self) -> u32 {
        self.fraction
    }
}

impl Sync {
    pub(crate) fn write(&self, to: &mut Writer) {
        to.u8(self.counter);
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        Ok(Self { counter: from.u8()? })
    }
}

impl TimeFollowUp {
    pub(crate) fn write(&self, to: &mut Writer) {
        to.u32(self.scet.seconds).u24(self.scet.fraction).u8(self.counter);
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let scet = Scet { seconds: from.u32()?, fraction: from.u24()? };
        Ok(Self { scet, counter: from.u8()? })
    }
}

/// `0x70n`, 2 bytes.
///
/// | byte | field |
/// |---|---|
/// | 0 | state |
/// | 1 | protocol major version |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Heartbeat {
    /// State of the sender.
    pub state: NodeState,
    /// Protocol major version of the sender.
    pub major: u8,
}

/// State of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum NodeState {
    /// Starting up.
    Starting = 0,
    /// Able to run.
    Ready = 1,
    /// Streaming or rendering.
    Running = 2,
    /// Not able to run.
    Fault = 3,
}

impl NodeState {
    const ALL: [Self; 4] = [Self::Starting, Self::Ready, Self::Running, Self::Fault];

    /// Returns the state of a code on the wire.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }
}

impl Heartbeat {
    pub(crate) fn write(&self, to: &mut Writer) {
        to.u8(self.state as u8).u8(self.major);
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let state = NodeState::from_code(from.u8()?).ok_or(Reject::UnknownValue)?;
        Ok(Self { state, major: from.u8()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half of 2^-24 s up, and the truncation of a whole 2^-24 s down.
    const RESOLUTION_NS: u64 = 60;

    #[test]
    fn nanoseconds_round_trip_to_the_resolution() {
        for ns in [0, 1, 59, 999_999_999, 1_000_000_000, 1_234_567_890_123, 86_400 * 365 * NS_PER_S + 7] {
            let back = Scet::from_ns(ns).ns();
            assert!(back.abs_diff(ns) <= RESOLUTION_NS, "{back} for {ns}");
        }
        assert_eq!(Scet::from_ns(1_500_000_000), Scet::new(1, 1 << 23).unwrap());
        assert_eq!(Scet::new(1, 1 << 24), None, "a fraction is below one second");
    }
}
