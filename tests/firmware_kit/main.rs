//! The firmware kit holds together: Rust crate, DBC, C sources, vectors and INTERFACE.md say the same.

#![allow(clippy::wildcard_enum_match_arm, reason = "a test looks for one kind among all")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may stop at the first surprise and says what it was")]

mod c_codec;
mod c_program;
mod compilers;
mod dbc;
mod dbc_signals;
mod documents;
mod flat;
mod rust_codec;
mod samples;
mod vectors;

use std::path::PathBuf;

/// Returns the folder of the kit.
fn kit() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Returns a text file of the kit.
fn text(path: &str) -> String {
    std::fs::read_to_string(kit().join(path)).unwrap_or_else(|error| panic!("firmware_protocol/{path}: {error}"))
}
