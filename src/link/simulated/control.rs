//! Commands the faults on the wire while the bus runs.

use super::bus::{Bus, SimulatedBus};
use super::{BusFault, TimedBusFault};
use base::time::Tai;
use std::sync::Arc;

/// Commands the faults of one bus; clones command the same bus.
///
/// A fault acts on the frames that start within its time. A fault that is added before its start acts the same whenever
/// the bus is read.
#[derive(Clone)]
pub struct BusControl {
    bus: Arc<Bus>,
}

impl SimulatedBus {
    /// Returns what commands its faults.
    pub fn control(&self) -> BusControl {
        BusControl { bus: Arc::clone(&self.bus) }
    }
}

impl BusControl {
    /// Adds a fault; the number under which [`Self::timed`] lists it.
    pub fn add(&self, from: Tai, until: Tai, fault: BusFault) -> usize {
        let mut medium = self.bus.settled();
        medium.faults.push(TimedBusFault { from, until, fault, hits: 0, next_at: from });
        let number = medium.faults.len() - 1;
        drop(medium);
        // Threads that wait on the real clock look again: a babbling node is something to wait for.
        self.bus.notify();
        number
    }

    /// Returns every fault, in the order in which they were added, with its hits.
    pub fn timed(&self) -> Vec<TimedBusFault> {
        self.bus.settled().faults.clone()
    }
}
