//! A link with faults on purpose: their kinds, their times, and how often each occurred.
//!
//! ```text
//! kinds and their times (here) -> link (outcome of a packet) -> damage (wrong bits, cut tails, babble)
//! ```
//!
//! Packets are spoilt where they are received, by their receive time, in order of the faults. Deterministic: the
//! outcome of a packet depends on the seed and on the packets before it only. Limits: a delayed packet is delivered
//! when the receiver next looks; on a real CAN bus the controllers refuse wrong bits and cut frames, so these faults
//! represent damage that passes the controllers; babble takes no time on the wire, so it delays no other packet. Tests:
//! `tests`.

mod damage;
mod link;
#[cfg(test)]
mod tests;

pub use link::FaultyLink;

use base::time::{Span, Tai};
use core::fmt;
use firmware_protocol::can::CanId;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A fault of a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LinkFault {
    /// A share of the packets is lost.
    Loss {
        /// Share of the packets, 0 to 1.
        share: f64,
    },
    /// All packets are lost.
    Silence,
    /// All packets arrive later.
    Delay {
        /// Constant part.
        by: Span,
        /// Added at random, uniform from 0 to this: packets may overtake each other.
        jitter: Span,
    },
    /// A share of the packets arrives twice.
    Duplicate {
        /// Share of the packets, 0 to 1.
        share: f64,
    },
    /// One bit is wrong in a share of the packets.
    WrongBits {
        /// Share of the packets, 0 to 1.
        share: f64,
    },
    /// A share of the packets is held back, so that later ones overtake them; they arrive, and are stamped, later.
    Reorder {
        /// Share of the packets, 0 to 1.
        share: f64,
        /// Time for which they are held back.
        by: Span,
    },
    /// A share of the packets loses its tail: fewer data bytes on CAN, the end of a chunk on serial.
    Truncate {
        /// Share of the packets, 0 to 1.
        share: f64,
    },
    /// A foreign sender transmits a packet of random content every period.
    Babble {
        /// CAN identifier; of no use on serial.
        id: CanId,
        /// Time from one packet to the next, above zero.
        period: Span,
        /// Bytes of content, cut to the most that the wire carries in one packet.
        bytes: u8,
    },
    /// The receiving side's clock is off by this while it lasts: so are the stamps. At the end it steps back.
    ClockStep {
        /// Added to each stamp; may be negative.
        by: Span,
    },
    /// The receiving side's clock drifts while it lasts; at the end it steps back.
    ClockDrift {
        /// Parts per million; above zero: fast.
        ppm: f64,
    },
    /// The controller is off the bus: nothing arrives, and sent packets are lost.
    Off,
}

/// Effect of a fault on the times at which packets arrive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// The times are unchanged.
    AsSent,
    /// Packets are late by up to this.
    Late(Span),
    /// The clock that stamps them is off by up to this.
    Misstamped(Span),
}

impl LinkFault {
    /// Returns its effect on the times at which packets come when it lasts so long.
    pub fn arrival(self, lasts: Span) -> Arrival {
        match self {
            Self::Delay { by, jitter } => Arrival::Late(by + jitter),
            Self::Reorder { by, .. } => Arrival::Late(by),
            Self::ClockStep { by } => Arrival::Misstamped(by),
            Self::ClockDrift { ppm } => Arrival::Misstamped(Span::from_s(lasts.s() * ppm * 1e-6)),
            Self::Loss { .. }
            | Self::Silence
            | Self::Duplicate { .. }
            | Self::WrongBits { .. }
            | Self::Truncate { .. }
            | Self::Babble { .. }
            | Self::Off => Arrival::AsSent,
        }
    }
}

impl fmt::Display for LinkFault {
    /// Returns how much of it there is; nothing when it takes everything.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |span: Span| span.s() * 1e3;
        match *self {
            Self::Loss { share } | Self::Duplicate { share } | Self::WrongBits { share } | Self::Truncate { share } => {
                write!(f, "{} % of the packets", share * 100.0)
            }
            Self::Delay { by, jitter } => write!(f, "{} ms, jitter {} ms", ms(by), ms(jitter)),
            Self::Reorder { share, by } => {
                write!(f, "{} % of the packets, held back {} ms", share * 100.0, ms(by))
            }
            Self::Babble { id, period, bytes } => {
                write!(f, "identifier 0x{id:X}, {bytes} bytes, each {} ms", ms(period))
            }
            Self::ClockStep { by } => write!(f, "{} ms", ms(by)),
            Self::ClockDrift { ppm } => write!(f, "{ppm} ppm"),
            Self::Silence | Self::Off => Ok(()),
        }
    }
}

/// A fault with its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedLinkFault {
    /// Begin.
    pub from: Tai,
    /// End, exclusive.
    pub until: Tai,
    /// The fault.
    pub fault: LinkFault,
    /// Packets hit so far: lost, changed, restamped; for babble, packets that were made.
    pub hits: u64,
}

impl TimedLinkFault {
    fn is_active(&self, at: Tai) -> bool {
        self.from <= at && at < self.until
    }

    /// Returns when the next packet of babble is due.
    fn babble_due(&self) -> Option<Tai> {
        let LinkFault::Babble { period, .. } = self.fault else { return None };
        let count = i64::try_from(self.hits).unwrap_or(i64::MAX);
        let due = self.from + Span::from_ns(period.ns().max(1).saturating_mul(count));
        (due < self.until).then_some(due)
    }
}

/// The list of faults, shared by a link and the code that commands it.
#[derive(Debug, Clone, Default)]
pub struct FaultControl {
    timed: Arc<Mutex<Vec<TimedLinkFault>>>,
}

impl FaultControl {
    fn lock(&self) -> MutexGuard<'_, Vec<TimedLinkFault>> {
        self.timed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a fault; the number under which [`Self::timed`] lists it.
    pub fn add(&self, from: Tai, until: Tai, fault: LinkFault) -> usize {
        let mut timed = self.lock();
        timed.push(TimedLinkFault { from, until, fault, hits: 0 });
        timed.len() - 1
    }

    /// Returns every fault, in the order in which they were added, with its hits.
    pub fn timed(&self) -> Vec<TimedLinkFault> {
        self.lock().clone()
    }
}
