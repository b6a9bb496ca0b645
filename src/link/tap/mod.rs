//! Wrappers of a link that see or change what passes: each is a `Link` around a `Link`.

mod fault;
#[cfg(test)]
mod fault_tests;

pub use fault::{FaultControl, FaultyLink, LinkFault, TimedLinkFault};
