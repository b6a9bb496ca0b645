//! Messages of the receiving threads to the frame thread.

use crate::runtime::plant_sample::PlantSample;
use base::time::Tai;
use link::{Input, Stamped};

/// Items that the receiving threads deliver.
#[derive(Debug, Clone, Copy)]
pub(super) enum Received {
    /// A message.
    Message {
        /// Number of the port by which it came, from 0.
        port: usize,
        /// The message.
        message: Stamped<Input>,
    },
    /// A pulse of the flight computer's clock at one of its whole seconds.
    Pulse(Tai),
    /// A sample that an external program sent over the control socket, and its arrival time.
    Sample(Stamped<PlantSample>),
    /// An edge of a trigger line.
    Edge {
        /// Number of the addressed head; `None`: all of them.
        head: Option<usize>,
        /// Time of the edge.
        at: Tai,
        /// True when the line became active.
        is_active: bool,
    },
}
