//! Frames and clients that the gateways forwarded, lost and refused.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Traffic of one gateway.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize)]
pub struct GatewayCounters {
    /// Clients so far.
    pub clients: u64,
    /// Clients now.
    pub connected: u64,
    /// Clients turned away because there were enough.
    pub refused: u64,
    /// Clients dropped because they did not read.
    pub stalled: u64,
    /// Frames from clients, put on the bus.
    pub from_clients: u64,
    /// Frames of the bus, written to clients.
    pub to_clients: u64,
    /// Frames of the bus that a client read too slowly for.
    pub dropped: u64,
    /// FD frames that the protocol cannot carry.
    pub withheld: u64,
    /// Number of refusals by reason.
    pub rejects: BTreeMap<&'static str, u64>,
    /// Threads of this gateway that ended by a panic.
    pub lost_threads: u64,
}

impl GatewayCounters {
    /// Returns everything refused, whatever the reason.
    pub fn rejected(&self) -> u64 {
        self.rejects.values().sum()
    }
}

/// The counters of one gateway, shared by its threads. Nothing real-time comes by here.
#[derive(Debug, Default)]
pub(super) struct Tally {
    counters: Mutex<GatewayCounters>,
}

impl Tally {
    pub(super) fn lock(&self) -> MutexGuard<'_, GatewayCounters> {
        self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn reject(&self, reason: &'static str) {
        *self.lock().rejects.entry(reason).or_default() += 1;
    }
}

/// Counts the thread that holds it as lost when it panics.
pub(super) struct CountsIfLost(pub(super) Arc<Tally>);

impl Drop for CountsIfLost {
    fn drop(&mut self) {
        self.0.lock().lost_threads += u64::from(std::thread::panicking());
    }
}
