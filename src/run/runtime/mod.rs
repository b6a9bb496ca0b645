//! Wiring: receiver, frame engine, deadlines, ledger, delivery; one loop per clock.
//!
//! In: a port and parameters. Out: frames in sinks and a run's record. On the monotonic clock: one receiving thread,
//! one frame thread, one sink thread, bounded queues between them. On the virtual clock: one thread, bit-identical.
//! Nothing here parses, formats or draws.

pub mod attitude_intake;
pub mod calibrate;
pub mod clock_intake;
pub mod conditions;
pub mod cost_cache;
pub mod delivery;
mod describe;
pub mod drawer;
pub mod engine;
pub mod error;
pub mod camera_intake;
pub mod exposing;
pub mod frame_faults;
pub mod head;
pub mod hygiene;
pub mod imager;
pub mod jitter_tables;
pub mod ledger;
pub mod load;
pub mod marks;
pub mod mounting;
pub mod outside_tracker;
pub mod params;
pub mod plant_queue;
pub mod pointing;
pub mod port_reading;
pub mod link_thread;
pub mod real_head;
pub mod real_time;
mod rate_check;
pub mod receiver;
pub mod record;
pub mod reply;
pub mod session;
pub mod shutter;
mod slot;
pub mod tracker_in;
pub mod tracker_out;
pub mod triggers;
pub mod virtual_time;

pub use engine::FrameEngine;
pub use error::RunError;
pub use exposing::Exposed;
pub use head::Head;
pub use hygiene::{Hygiene, HygieneParams};
pub use imager::Imager;
pub use ledger::{EventKind, Ledger};
pub use marks::{FrameMark, FrameMarks, FrameMarksEnd, frame_marks};
pub use mounting::Mounting;
pub use outside_tracker::{OutsideTracker, TrackerOutput};
pub use params::RunParams;
pub use plant_queue::{PlantAttitude, PlantSample};
pub use port_reading::PortReading;
pub use receiver::plain_sample;
pub use record::{RunOutcome, RunRecord, lines_of_head, note_lost_reader};
pub use session::Session;
pub use slot::{Slot, Started};
pub use triggers::FiredTrigger;
