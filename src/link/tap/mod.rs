//! Wrappers of a link that see or change what passes: each is a `Link` around a `Link`.

mod capture;
#[cfg(test)]
mod capture_tests;
mod fault;
#[cfg(test)]
mod fault_tests;

pub use capture::{Capture, CaptureOutcome, CapturingLink};
pub use fault::{FaultControl, FaultyLink, LinkFault, TimedLinkFault};
