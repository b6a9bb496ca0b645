//! The conformance suite on links that need no hardware, and on links broken on purpose.
#![allow(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod broken;
mod ends;
mod simulated;
mod terminal;
