//! The fuzz targets as functions, over the committed corpora: what a fuzzer once found stays repaired, with no fuzzer.
//!
//! `hil_scripts/fuzz.sh` builds the same files with coverage counters and looks for more.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test stops at the first surprise")]
#![allow(unused_attributes, reason = "`no_main` is for the fuzzer's programs")]
#![allow(unreachable_pub, reason = "the parts are public for the fuzzer's programs")]

// The names under which the targets import their macro and their parts.
extern crate self as libfuzzer_sys;
extern crate self as starloop_fuzz;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

#[path = "../fuzz/src/lib.rs"]
mod parts;
pub use parts::*;

/// The macro is in a module: a name in the text's scope would hide the targets' own import of it.
mod function {
    /// Makes a function of a target, where libFuzzer's macro makes a program.
    macro_rules! fuzz_target {
        (|$bytes:ident: &[u8]| $body:block) => {
            pub(crate) fn run($bytes: &[u8]) {
                $body
            }
        };
    }
    pub(crate) use fuzz_target;
}
pub(crate) use function::fuzz_target;

#[path = "../fuzz/targets/can_decode.rs"]
mod can_decode;
#[path = "../fuzz/targets/captures.rs"]
mod captures;
#[path = "../fuzz/targets/elements.rs"]
mod elements;
#[path = "../fuzz/targets/histories.rs"]
mod histories;
#[path = "../fuzz/targets/jitter_table.rs"]
mod jitter_table;
#[path = "../fuzz/targets/layer.rs"]
mod layer;
#[path = "../fuzz/targets/network_camera.rs"]
mod network_camera;
#[path = "../fuzz/targets/plain.rs"]
mod plain;
#[path = "../fuzz/targets/serial_resync.rs"]
mod serial_resync;
#[path = "../fuzz/targets/session.rs"]
mod session;
#[path = "../fuzz/targets/slcan.rs"]
mod slcan;
#[path = "../fuzz/targets/socketcand.rs"]
mod socketcand;
#[path = "../fuzz/targets/spice.rs"]
mod spice;
#[path = "../fuzz/targets/star_lines.rs"]
mod star_lines;
#[path = "../fuzz/targets/tracker_commands.rs"]
mod tracker_commands;
#[path = "../fuzz/targets/tracker_telemetry.rs"]
mod tracker_telemetry;

/// A target: it is given bytes, and panics where the program is wrong.
type Target = fn(&[u8]);

/// Name and function of each target.
const TARGETS: [(&str, Target); 16] = [
    ("can_decode", can_decode::run),
    ("captures", captures::run),
    ("elements", elements::run),
    ("histories", histories::run),
    ("jitter_table", jitter_table::run),
    ("layer", layer::run),
    ("network_camera", network_camera::run),
    ("plain", plain::run),
    ("serial_resync", serial_resync::run),
    ("session", session::run),
    ("slcan", slcan::run),
    ("socketcand", socketcand::run),
    ("spice", spice::run),
    ("star_lines", star_lines::run),
    ("tracker_commands", tracker_commands::run),
    ("tracker_telemetry", tracker_telemetry::run),
];

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz").join(name)
}

/// Returns the files of a folder, or its folders, by name.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

#[test]
fn every_input_of_the_corpora_is_judged_as_its_target_says() {
    for (name, run) in TARGETS {
        let files = entries(&folder("corpus").join(name));
        assert!(!files.is_empty(), "{name}");
        for file in &files {
            // Printed when a target panics.
            println!("{}", file.display());
            run(&std::fs::read(file).unwrap());
        }
        println!("{name}: {} inputs", files.len());
    }
}

#[test]
fn a_target_that_finds_a_fault_panics() {
    // Each target does one thing wrong then (`control`); some inputs of the corpora show it.
    let broken = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "every_input_of_the_corpora_is_judged_as_its_target_says"])
        .env("STARLOOP_FUZZ_BROKEN", "1")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&broken.stdout);
    assert!(!broken.status.success() && text.contains("panicked"), "{text}");
}

#[test]
fn every_target_of_the_fuzzer_is_run() {
    let of_here: BTreeSet<String> = TARGETS.iter().map(|(name, _)| (*name).to_owned()).collect();
    let names = |name: &str| -> BTreeSet<String> {
        let stem = |path: &PathBuf| path.file_stem().unwrap().to_str().unwrap().to_owned();
        entries(&folder(name)).iter().map(stem).collect()
    };
    assert_eq!(names("targets"), of_here);
    assert_eq!(names("corpus"), of_here);
}
