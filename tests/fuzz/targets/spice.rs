//! SPICE kernels: attitudes and orbits that can be evaluated, or an error that names the file; no byte makes a panic.

#![no_main]

use histories::HistoryError;
use histories::spice::{KernelFile, attitudes, orbit};
use libfuzzer_sys::fuzz_target;
use starloop_fuzz::{Input, control};

/// Memory for a byte, and beside: an interval of a CK with one row (48 bytes) makes a segment and its part of the time.
const MEMORY_PER_BYTE: u64 = 400;
const MEMORY_BESIDE: u64 = 1 << 17;
/// A clock of instrument -7 and spacecraft -7.
const CLOCK: &[u8] = b"KPL/SCLK\n\\begindata\nSCLK_DATA_TYPE_7 = ( 1 )\nSCLK01_TIME_SYSTEM_7 = ( 2 )\n\
    SCLK01_MODULI_7 = ( 4294967296 100 )\nSCLK01_COEFFICIENTS_7 = ( 0.0E+00 1.0D+03 1.0E+00 )\n\\begintext\n";

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    let kind = input.u8() % 3;
    let rest = input.rest();
    let file = |bytes| KernelFile { file: "k", bytes };
    let memory = allocation_counter::measure(|| match kind {
        0 => read_attitudes(rest, &[file(CLOCK)]),
        1 => read_orbit(rest),
        // A text kernel of any kind, beside a file that is none.
        _ => read_attitudes(CLOCK, &[file(rest), file(CLOCK)]),
    });
    let most = MEMORY_PER_BYTE * rest.len() as u64 + MEMORY_BESIDE;
    assert!(memory.bytes_max < most, "{} bytes of memory for {}", memory.bytes_max, rest.len());
});

fn read_attitudes(bytes: &[u8], texts: &[KernelFile<'_>]) {
    match attitudes(KernelFile { file: "k", bytes }, texts, None) {
        Ok(history) => {
            let [first_ns, last_ns] = history.span_ns();
            for t_ns in [first_ns, first_ns / 2 + last_ns / 2, last_ns] {
                if let Some(motion) = history.at_ns(t_ns) {
                    let norm = motion.body_from_icrf.quat().length();
                    assert!((norm - 1.0).abs() < 1e-9, "{norm}");
                }
            }
        }
        Err(error) => refused(&error),
    }
}

fn read_orbit(bytes: &[u8]) {
    match orbit(KernelFile { file: "k", bytes }, &[], None) {
        Ok(orbit) => {
            let [first_ns, last_ns] = orbit.span_ns();
            assert!(first_ns <= last_ns && orbit.at_ns(first_ns).is_some());
        }
        Err(error) => refused(&error),
    }
}

/// Checks the error of a refused file. Broken: a file that names its kind must have a byte order.
fn refused(error: &HistoryError) {
    let error = error.to_string();
    assert!(error.starts_with('k'), "{error}");
    assert!(!control::is_broken() || !error.contains("byte order"), "{error}");
}
