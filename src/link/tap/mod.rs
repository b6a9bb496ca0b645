//! Wrappers of a link that see or change the packets that pass: each is a `Link` around a `Link`.

mod capture;
#[cfg(test)]
mod capture_tests;
mod fault;

pub use capture::{Capture, CaptureOutcome, CapturingLink};
pub use fault::{Arrival, FaultControl, FaultyLink, LinkFault, TimedLinkFault};
