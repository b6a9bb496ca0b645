//! The negative control: with `STARLOOP_FUZZ_BROKEN` set, each target does one thing wrong, which the fuzzer must find.
//!
//! `hil_scripts/fuzz.sh --control` runs every target so. What is broken is said at each use.

use std::sync::LazyLock;

static BROKEN: LazyLock<bool> = LazyLock::new(|| std::env::var_os("STARLOOP_FUZZ_BROKEN").is_some());

/// Returns whether the target is to do its one thing wrong.
pub fn is_broken() -> bool {
    *BROKEN
}
