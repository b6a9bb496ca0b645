//! Faults on the wire itself: bit errors, a babbling node, controllers put off the bus; timed and counted.

use base::time::Tai;
use firmware_protocol::can::CanId;

/// A fault on the wire. CAN only: a serial line has no such faults.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BusFault {
    /// A share of the frames is destroyed by an error flag, and sent again.
    BitErrors {
        /// 0 to 1.
        share: f64,
    },
    /// A foreign node sends 8 zero bytes under one identifier, over and over.
    Babble {
        /// Identifier of its frames.
        id: CanId,
        /// Share of the time that its frames would take on a wire of their own: 1 is back to back.
        share_of_bandwidth: f64,
    },
    /// A controller is put off the bus, and comes back 128 times 11 recessive bits after the end of the fault.
    BusOff {
        /// Number of the end, as `SimulatedLink::end` returns it.
        end: usize,
    },
}

/// A fault with its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedBusFault {
    /// Begin.
    pub from: Tai,
    /// End, exclusive.
    pub until: Tai,
    /// The fault.
    pub fault: BusFault,
    /// Frames destroyed, frames babbled, or times a controller was put off the bus.
    pub hits: u64,
    /// When a babbling node sends next.
    pub(super) next_at: Tai,
}

impl TimedBusFault {
    pub(super) fn is_active(&self, at: Tai) -> bool {
        self.from <= at && at < self.until
    }
}
