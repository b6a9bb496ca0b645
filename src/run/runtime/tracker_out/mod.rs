//! Star trackers whose telemetry goes to clients: frames of a head -> attitudes -> packets of a protocol on a line.
//!
//! ```text
//! head's sinks -> TrackerTap -> bounded queue -> Telemeter { source, faults, device } -> Outlet
//!                                                      commands of clients <-
//! ```
//!
//! On the real clock each has a thread of its own; on the virtual clock the run's loop steps it to every instant at
//! which it has something to do, so that a run repeats. Never on the frame thread: a tap only copies into buffers of
//! fixed number, and what does not fit is lost and counted, as is every packet that a line does not take. Tests:
//! `hil_scripts/tests/test_tracker_out.py`; beside the code.

mod damage;
mod outlet;
mod shared;
mod source;
mod tap;
mod telemeter;

pub use outlet::{Outlet, OutletError, UdpParams};
pub use shared::{OutCounts, OutShared, OutThread};
pub use source::TrackerEyes;
pub use tap::{FRAMES_WAITING, Seen, TapParts, TrackerTap, tracker_tap};
pub use telemeter::{Telemeter, TelemeterParams};
