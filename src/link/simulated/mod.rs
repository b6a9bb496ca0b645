//! A bus in memory: two or more ends, bit-exact transmission times, bounded queues, either clock.
//!
//! Assumes: no bus errors, no arbitration loss (frames leave in the order of sending), sender and receiver equally
//! fast. Packets arrive at the end of their last bit plus a constant latency. On the virtual clock the result depends
//! on nothing but the order of calls. `tests.rs` holds delays, order, overflow and both clocks.

mod bus;
#[cfg(test)]
mod tests;
mod timing;

pub use bus::{BusParams, SimulatedLink, simulated_bus, simulated_pair};
pub use timing::BusTiming;
