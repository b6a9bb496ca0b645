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
mod fault;
#[cfg(test)]
mod fault_tests;
mod medium;
mod params;
mod statistics;
mod stuffing;
#[cfg(test)]
mod tests;
mod timing;

pub use bus::{SimulatedBus, SimulatedLink, simulated_bus, simulated_pair};
pub use control::BusControl;
pub use error_counters::{ErrorCounters, ErrorState};
pub use fault::{BusFault, TimedBusFault};
pub use params::{BusModel, BusParams};
pub use statistics::BusStatistics;
pub use stuffing::Stuffing;
pub use timing::BusTiming;
