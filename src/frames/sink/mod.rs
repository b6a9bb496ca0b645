//! Frames -> the outside: the trait `Sink` and its implementations.
//!
//! Input: `SentFrame`, one finished exposure with its truth and its bookkeeping, owned by the sink thread while it
//! is being sent and then handed back for reuse. Output: files (`recorder::Recorder`) or nothing but a count and a
//! checksum (`tee::NullSink`).
//!
//! Promises, checked by the compliance suite that runs against every sink:
//! * a frame that `send` accepted is counted once, one it refused is not;
//! * `finish` may be called more than once; a frame sent after it is refused;
//! * a full disk, a missing directory or a wrong frame number is a `SinkError`, never a panic, and whatever was
//!   complete before stays complete: every file gets its final name only when all of its bytes are written.
//!
//! Tour: `frame` (what is sent) -> `facts` (by which names outputs have it) -> `fits`, `png`, `ser`, `truth`,
//! `frame_log` (its forms on disk) -> `atomic` (how a file appears) -> `recorder`, `shared_memory`, `iceoryx`,
//! `tap`, `tee` (the sinks) -> `alone`, `branch`, `fan` (one or several) -> `line` (what each of them did).

mod alone;
pub mod atomic;
mod branch;
pub mod compliance;
pub mod crc32;
mod error;
pub mod facts;
pub mod fan;
#[cfg(test)]
mod fan_tests;
pub mod fault_pixels;
pub mod fits;
pub mod frame;
pub mod frame_fault;
pub mod frame_log;
#[cfg(feature = "iceoryx2")]
pub mod iceoryx;
pub mod line;
pub mod png;
pub mod recorder;
pub mod sample;
pub mod ser;
pub mod shared_memory;
pub mod tap;
pub mod target_table;
pub mod tee;
pub mod truth;
pub mod wcs;

pub use crate::report::SinkLine;
pub use alone::Alone;
pub use atomic::{replace_own_file, write_file_atomically, write_new_file};
pub use branch::BranchParams;
pub use error::SinkError;
pub use fan::{Fan, OnFull};
pub use fault_pixels::{DefectSpots, FaultPixels};
pub use frame::{CameraFacts, FrameMeta, SentFrame, TruthKind, TruthStar};
pub use frame_fault::{
    ActiveFault, ActiveFaults, Amount, CameraFault, FaultFlags, FrameFault, ImageFault, PixelFault, PixelsOf,
    ProtonStorm, SendingFault,
};
pub use line::{Loss, LossKind, sink_lines};
pub use recorder::{Recorder, RecorderOptions};
pub use tap::{Tap, TapEnd, tap};
pub use target_table::TargetRow;
pub use tee::{NullSink, Tee};
pub use wcs::{MOST_SIP_ORDER, QUADRATIC, Sip, SipTerm, Wcs};

use std::path::PathBuf;

/// Destination of finished frames. One sink is owned by one thread.
pub trait Sink: Send {
    /// Returns the short name for messages and the run summary.
    fn name(&self) -> &'static str;

    /// Sends one frame; returns when its buffers may be reused.
    ///
    /// # Errors
    /// When the frame did not get out; frames sent before are not affected and the next may be tried.
    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError>;

    /// Ends the run: everything accepted is out when this returns. May be called again, with the same answer.
    ///
    /// # Errors
    /// When something accepted could not be brought out.
    fn finish(&mut self) -> Result<SinkSummary, SinkError>;

    /// Returns numbers of its own for the run summary, beside those that every sink has.
    fn counts(&self) -> Vec<(&'static str, u64)> {
        Vec::new()
    }

    /// Reports the frames lost since the last call: those that `send` took, or that one of several sinks did not take.
    fn take_losses(&mut self, _announce: &mut dyn FnMut(Loss)) {}

    /// Returns the result of each, when this is several sinks; complete after `finish`.
    fn lines(&self) -> Vec<SinkLine> {
        Vec::new()
    }
}

/// The result of a sink in one run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SinkSummary {
    /// The sink's name.
    pub sink: &'static str,
    /// Frames accepted.
    pub frames: u64,
    /// Frames that `send` refused.
    pub refused: u64,
    /// Bytes brought out in all accepted frames (files or packets), 0 where nothing leaves.
    pub bytes: u64,
    /// CRC-32 over the number and the pixel CRC-32 of each accepted frame, in order: equal for equal runs.
    pub run_crc32: u32,
    /// Directory or address the frames went to.
    pub output: Option<PathBuf>,
}
