//! A bus in memory: ends that come and go, bit-exact transmission times, arbitration, error frames and bus-off, bounded
//! queues, either clock.
//!
//! CAN: each end sends the packets of its queue in their order; of the heads of all queues the lowest identifier gets
//! the wire, and a frame on the wire is not interrupted. Frames queued at the very instant of a start take part. An
//! error destroys a frame at a random bit; an error frame follows, and the frame is sent again; error counters take a
//! controller to error passive and off the bus, and 128 times 11 recessive bits bring it back by itself. Serial: each
//! end has a wire of its own, without errors. Packets arrive at the end of their last bit plus a constant latency.
//!
//! Assumes: sender and receiver equally fast; a frame is acknowledged even when no other end is attached; a node that
//! queues a frame within the first bit of another's does not join in. On the virtual clock the result depends on
//! nothing but the order and the instants of calls that send, attach or leave. Tests: `tests.rs` (delays, order,
//! overflow, both clocks), `arbitration_tests.rs` (order of sending), `fault_tests.rs` (errors, bus-off, babbling).

#[cfg(test)]
mod arbitration_tests;
mod bus;
mod control;
mod end;
mod error_counters;
#[cfg(test)]
mod fault_tests;
mod medium;
mod stuffing;

pub use bus::{SimulatedBus, SimulatedLink, simulated_bus, simulated_pair};
pub use control::BusControl;
pub use error_counters::{ErrorCounters, ErrorState};
pub use stuffing::Stuffing;
pub use timing::BusTiming;

use base::time::{Span, Tai};
use firmware_protocol::can::CanId;

// Parameters of a bus and of the model of its controllers.

/// Parameters of a simulated bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BusParams {
    /// Name in messages.
    pub name: String,
    /// Kind and speed of the wire.
    pub timing: BusTiming,
    /// Time from the last bit on the wire to the receiver's stamp.
    pub latency: Span,
    /// Packets an end holds until they are received; more are lost and counted.
    pub queue_packets: usize,
}

/// Options of the model of the controllers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BusModel {
    /// Stuff bits of each frame.
    pub stuffing: Stuffing,
    /// Packets an end holds until they are on the wire; more are given up and counted as unsent.
    pub transmit_packets: usize,
    /// Seed of the places of bit errors.
    pub seed: u64,
}

impl Default for BusModel {
    fn default() -> Self {
        Self { stuffing: Stuffing::Worst, transmit_packets: 256, seed: 0 }
    }
}

// Statistics of the wire so far.

/// Traffic of one bus since it was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BusStatistics {
    /// When the bus was made.
    pub since: Tai,
    /// When this was asked.
    pub until: Tai,
    /// Time for which the wire was not idle, interframe spaces included; of serial lines the sum of both directions.
    pub busy: Span,
    /// Frames that went through, those of a babbling node included.
    pub frames: u64,
    /// Frames of a babbling node.
    pub babbled: u64,
    /// Frames destroyed by an error flag; those of ends are sent again.
    pub error_frames: u64,
    /// Ends attached now.
    pub ends: usize,
}

impl BusStatistics {
    /// Returns the share of the time for which the wire was not idle, 0 to 1.
    pub fn load(&self) -> f64 {
        share(self.busy, self.until - self.since)
    }

    /// Returns the same since `earlier`.
    pub fn load_since(&self, earlier: &Self) -> f64 {
        share(Span::from_ns(self.busy.ns() - earlier.busy.ns()), self.until - earlier.until)
    }
}

fn share(busy: Span, time: Span) -> f64 {
    if time.ns() > 0 { busy.ns() as f64 / time.ns() as f64 } else { 0.0 }
}

// Faults on the wire itself: bit errors, a babbling node, controllers put off the bus; timed and counted.

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
    next_at: Tai,
}

impl TimedBusFault {
    fn is_active(&self, at: Tai) -> bool {
        self.from <= at && at < self.until
    }
}

#[cfg(test)]
mod tests;
mod timing;
