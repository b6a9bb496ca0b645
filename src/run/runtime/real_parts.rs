//! Inputs of a run on the bench clock: its environment, its camera heads, its sources, and the form of orders.

use crate::runtime::{
    edge_thread::TriggerChip, engine::FrameEngine, frame_faults::FrameFaults, hygiene::Hygiene,
    plant_sample::PlantSample, receiver::Receiver, record::RunRecord,
};
use base::{clock::Clock, time::Tai};
use core::sync::atomic::AtomicBool;
use crossbeam_channel::Receiver as Queue;
use frames::{report::RunLimits, sink::Sink};
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

/// An order that the frame thread executes before the slot that is released at the given instant, with all heads. It
/// may take long and allocate: frames that it delays are counted as late.
pub type FrameOrder = Box<dyn FnOnce(&mut [HeadParts<'_>], &mut RunRecord, Tai) + Send>;

/// The parts of a head that an order may change.
pub struct HeadParts<'a> {
    /// Draws frames.
    pub engine: &'a mut FrameEngine,
    /// Receives messages.
    pub receiver: &'a mut Receiver,
    /// Damages frames; `None` without faults.
    pub faults: Option<&'a mut FrameFaults>,
}

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

/// One camera head: what draws its frames, its receiver, the sink of its frames, and its faults.
pub struct Head<'a> {
    /// Draws frames.
    pub engine: &'a mut FrameEngine,
    /// Receives messages.
    pub receiver: &'a mut Receiver,
    /// Takes the frames, in a thread of its own.
    pub sink: Box<dyn Sink>,
    /// Damages frames; `None` without faults.
    pub faults: Option<&'a mut FrameFaults>,
}
