//! Captures a run and draws it again bit by bit.
//!
//! ```text
//! a run -> Recording -> DIR/{session.json, data/, bus.pcapng or bus.log, frames.csv} -> replay_session -> the same images
//! ```
//!
//! A frame depends on the run file, the seed, the planner's costs, the messages received before it was drawn, the load
//! under which it was planned, and the faults of its time. `session.json` contains the first three with every
//! configuration that the run file names, and the events that were injected; `data` has copies of its files of
//! attitudes, orbits, jitter and maps; the capture contains the packets of all links with their stamps; `frames.csv`
//! contains, frame by frame and head by head, how many messages of each link were received before, the load as exact
//! bits, the exposure of a commanded camera, and the CRC-32 of the image that went out. A replay plays each head
//! separately: it feeds the packets through the same ports and receiver in the same portions, places the same events,
//! and compares each image. In lockstep `samples.csv` has the samples of the plant, which are counted as messages of
//! the first link. Faults of the bus need no replay: the capture contains what arrived after them. Limits: bits repeat
//! on the same backend and vector level; a capture that lost packets, messages or rows reports this and may not repeat;
//! with several links messages are fed in the order of their stamps; pulses per second are not captured. A capture that
//! differs from its end record in packets, rows or frames is refused (`completeness`). [`replay_bus`] draws the frames
//! that a run file makes of a capture by another program. Tests: `tests/closed_loop/replay.rs`.

mod captured_links;
mod completeness;
mod error;
mod head_playback;
mod injected;
#[cfg(test)]
mod mutation_tests;
mod playback;
mod recording;
#[cfg(test)]
mod replay_tests;
mod row_writer;
mod rows;
#[cfg(test)]
mod rows_tests;
mod sample_table;
mod session;
mod table_lines;

pub use error::ReplayError;
use error::Result;
pub use head_playback::{Difference, HeadOutcome};
pub use injected::{Injected, KeptEvent};
pub use playback::{ReplayOptions, ReplayOutcome, SinkOfHead, replay_bus, replay_session};
pub use recording::{Recording, SampleTap};
pub use rows::{CapturedFate, DrawnFrom, FrameRow, RowCounts, RowForm, RowReader};
pub use sample_table::{CapturedSample, SampleReader};
pub use session::{Session, SessionEnd, SessionParams};

/// Name of the session's file.
pub const SESSION_FILE: &str = "session.json";
/// Name of the frames' file.
pub const FRAMES_FILE: &str = "frames.csv";
