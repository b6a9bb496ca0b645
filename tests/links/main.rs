//! The conformance suite on links that need no hardware, and on links broken on purpose.
#![allow(clippy::wildcard_enum_match_arm, reason = "a test looks for one kind among all")]
#![allow(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod broken;
mod ends;
mod plain;
mod simulated;
mod terminal;
