//! A captured run, kept and drawn again bit by bit.
//!
//! ```text
//! a run -> Recording -> DIR/{session.json, data/, bus.pcapng or bus.log, frames.csv} -> replay_session -> the same images
//! ```
//!
//! What a frame is made of: the run file, the seed, the costs that the planner knew, the messages that had been taken in
//! before it was drawn, the load under which it was planned, and the faults of its time. `session.json` holds the first three
//! with every configuration that the run file names, and the events that came while the run went on; `data` has copies of its files of attitudes, orbits, jitter and maps; the capture holds the packets of
//! all links with their stamps; `frames.csv` holds, frame by frame and head by head, how many messages of each link had been
//! taken in, the load as exact bits, how a commanded camera exposed it, and the CRC-32 of the image that went out. A replay plays each head on its own: it feeds
//! the packets through the same ports and receiver in the same portions, places the same events, and compares each image.
//! In lockstep `samples.csv` has what the plant sent, and its samples are counted as messages of the first link.
//! Faults of the bus need nothing: the capture holds what arrived after them. Limits: bits repeat on the same backend and
//! vector level; a capture that lost packets, messages or rows says so and may not repeat; with several links messages are fed
//! in the order of their stamps, pulses per second are not captured. A capture that does not hold the packets, rows and
//! frames that its end record states is refused (`completeness`).
//! [`replay_bus`] draws what a run would have made of a capture of someone else's. Tests: `tests/closed_loop/replay.rs`.

mod captured_links;
mod completeness;
mod error;
mod exposed;
mod head_faults;
mod head_playback;
mod injected;
#[cfg(test)]
mod mutation_tests;
mod playback;
mod recording;
#[cfg(test)]
mod replay_tests;
mod row_reader;
mod row_writer;
mod rows;
#[cfg(test)]
mod rows_tests;
mod sample_table;
mod session;
mod table_lines;

pub use completeness::RowCounts;
pub use error::ReplayError;
pub use injected::{Injected, KeptEvent};
pub use playback::{Difference, HeadOutcome, ReplayOptions, ReplayOutcome, SinkOfHead, replay_bus, replay_session};
pub use recording::{Recording, SampleTap};
pub use row_reader::RowReader;
pub use rows::{CapturedFate, DrawnFrom, FrameRow, RowForm};
pub use sample_table::{CapturedSample, SampleReader};
pub use session::{Session, SessionEnd, SessionParams};

/// Name of the session's file.
pub const SESSION_FILE: &str = "session.json";
/// Name of the frames' file.
pub const FRAMES_FILE: &str = "frames.csv";
