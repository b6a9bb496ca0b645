//! The suite on simulated buses, on the real clock.

use crate::ends::{FORMATS, clock, simulated};
use base::clock::{Clock, Virtual};
use base::time::Tai;
use starloop_link::conformance::check_link;
use std::sync::Arc;

#[test]
fn simulated_buses_keep_every_promise() {
    let clock = clock();
    for format in FORMATS {
        let report = check_link("simulated", format, &clock, || simulated(format, &clock)).unwrap();
        for check in &report.checks {
            println!("{format:?}: {}: {}", check.promise, check.seen);
        }
    }
}

#[test]
fn the_suite_needs_a_clock_that_runs() {
    let clock: Arc<dyn Clock> = Arc::new(Virtual::new(Tai::from_ns(0)));
    let error = check_link("simulated", FORMATS[0], &clock, || simulated(FORMATS[0], &clock)).unwrap_err();
    assert!(error.contains("real clock"), "{error}");
}
