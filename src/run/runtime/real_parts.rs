//! Inputs of a run on the bench clock: its environment, its sources, and the form of orders.

use crate::runtime::{
    edge_thread::TriggerChip, head::Head, hygiene::Hygiene, plant_sample::PlantSample, receiver::Receiver,
    record::RunRecord,
};
use base::{clock::Clock, time::Tai};
use core::sync::atomic::AtomicBool;
use crossbeam_channel::Receiver as Queue;
use frames::report::RunLimits;
use link::pps::Pps;
use link::{Port, Stamped};
use std::sync::Arc;

/// Environment of a run on the bench clock.
pub struct Setting<'a> {
    /// The bench clock.
    pub clock: &'a Arc<dyn Clock>,
    /// Set to true when the run is to end.
    pub stop: &'a Arc<AtomicBool>,
    /// Requests to the operating system; `None`: no requests.
    pub hygiene: Option<&'a Arc<Hygiene>>,
    /// Number of frames whose times are kept individually.
    pub ring_frames: usize,
    /// Limits of `[expect]`.
    pub limits: RunLimits,
    /// Orders for the frame thread, which executes them between two slots; `None`: no orders.
    pub orders: Option<&'a Queue<FrameOrder>>,
}

/// An order that the frame thread executes before the slot that is released at the given instant, with all heads and their
/// receiver. It may take long and allocate: frames that it delays are counted as late.
pub type FrameOrder = Box<dyn FnOnce(&mut [&mut Head], &mut Receiver, &mut RunRecord, Tai) + Send>;

/// Sources of a run on the bench clock: everything that brings input.
pub struct Sources {
    /// Ports of the bench; frames are reported on the first one.
    pub ports: Vec<Port>,
    /// Pulses of the flight computer's clock.
    pub pulses: Option<Pps>,
    /// Samples that an external program sends over the control socket; `None` without them.
    pub samples: Option<Queue<Stamped<PlantSample>>>,
    /// Chips with lines that trigger cameras.
    pub chips: Vec<TriggerChip>,
}

impl From<Port> for Sources {
    fn from(port: Port) -> Self {
        Self { ports: vec![port], pulses: None, samples: None, chips: Vec::new() }
    }
}
