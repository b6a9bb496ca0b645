//! Parameters of a bus and of the model of its controllers.

use super::{BusTiming, Stuffing};
use base::time::Span;

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
