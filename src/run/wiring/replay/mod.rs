//! A captured run, kept and drawn again bit by bit.
//!
//! ```text
//! a run -> Recording -> DIR/{session.json, bus.pcapng or bus.log, frames.csv} -> replay_session -> the same images
//! ```
//!
//! What a frame is made of: the bench, the seed, the costs that the planner knew, the messages that had been taken in
//! before it was drawn, and the load under which it was planned. `session.json` holds the first three with every file
//! that the bench names; the capture holds the packets with their stamps; `frames.csv` holds, frame by frame, how many
//! messages had been taken in, the load as exact bits, and the CRC-32 of the image. A replay feeds the packets through
//! the same port and receiver in the same portions and compares each image. Limits: bits repeat on the same backend and
//! vector level; a capture that lost packets, messages or rows says so and may not repeat. A capture that does not hold the
//! packets, rows and frames that its end record states is refused (`completeness`).
//! [`replay_bus`] draws what a bench would have made of a capture of someone else's. Tests: `tests/closed_loop/replay.rs`.

mod completeness;
mod error;
mod playback;
mod recording;
mod rows;
mod session;

pub use completeness::RowCounts;
pub use error::ReplayError;
pub use playback::{Difference, ReplayOutcome, replay_bus, replay_session};
pub use recording::Recording;
pub use rows::{CapturedFate, FrameRow, RowReader};
pub use session::{Session, SessionEnd, SessionParams};

/// Name of the session's file.
pub const SESSION_FILE: &str = "session.json";
/// Name of the frames' file.
pub const FRAMES_FILE: &str = "frames.csv";
