//! One suite for every link: checks the promises of `Link` on two ends of it on the real clock.
//!
//! Input: a maker of fresh, connected pairs of ends. Output: a `Report`, or the first promise that was broken. The
//! suite does not depend on how a link works; on serial links the borders of chunks mean nothing, and bytes are
//! compared. `tests/links` runs it on simulated buses and pseudo terminals, and on links broken on purpose, each of
//! which it must refuse; `starloop link-check` runs it on real interfaces and ports.

mod exchange;
mod filters;
mod plain;
mod protocol;
mod raw;
mod suite;

use super::{LinkError, WireFormat};
use base::clock::Clock;
use std::sync::Arc;
use suite::Suite;

pub use filters::check_filters;
pub use suite::Ends;

/// The result of the suite when every promise is kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Name of the link.
    pub link: String,
    /// Format of messages on its wire.
    pub format: WireFormat,
    /// Every check, in the order in which they were made.
    pub checks: Vec<Check>,
}

/// One check that held.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    /// The promise that was checked.
    pub promise: &'static str,
    /// Measurements that show it.
    pub seen: String,
}

/// Checks everything; `make` gives a fresh pair each time, `clock` is the one that the links have.
///
/// # Errors
/// The first promise that was broken, and how. Also when a pair cannot be made.
pub fn check_link(
    link: &str,
    format: WireFormat,
    clock: &Arc<dyn Clock>,
    make: impl FnMut() -> Result<Ends, LinkError>,
) -> Result<Report, String> {
    check_lengths(link, format, exchange::all_lengths(format), clock, make)
}

/// Returns the same for a link that carries plain records of one length.
///
/// # Errors
/// Checks a link as [`check_link`] does.
pub fn check_records(
    link: &str,
    length: usize,
    clock: &Arc<dyn Clock>,
    make: impl FnMut() -> Result<Ends, LinkError>,
) -> Result<Report, String> {
    check_lengths(link, WireFormat::Plain, vec![length], clock, make)
}

fn check_lengths(
    link: &str,
    format: WireFormat,
    lengths: Vec<usize>,
    clock: &Arc<dyn Clock>,
    mut make: impl FnMut() -> Result<Ends, LinkError>,
) -> Result<Report, String> {
    type Step = (&'static str, fn(&mut Suite<'_>) -> Result<String, String>);
    let steps: [Step; 9] = [
        ("bytes of every length arrive whole and in order, both ways", raw::lengths_and_order),
        ("stamps lie between sending and receiving, and never go back", raw::stamps),
        ("a wait ends at its limit, and not before", raw::timeouts),
        ("a waiting packet is given at once, whatever the limit", raw::waiting_packet),
        ("packets of another kind are refused", raw::wrong_kind),
        ("a burst arrives without loss; counters are exact", raw::burst),
        ("an echo on another thread comes back", raw::echo),
        ("every message arrives as it was, both ways", protocol::messages),
        ("damage is rejected by reason, and nothing of it accepted", protocol::damage),
    ];
    if !clock.is_real() {
        return Err("the suite needs a real clock: it waits".into());
    }
    let mut suite = Suite { format, lengths, clock, make: &mut make };
    let mut checks = Vec::new();
    for (promise, step) in steps {
        let seen = step(&mut suite).map_err(|broken| format!("{link}: not so: {promise}: {broken}"))?;
        checks.push(Check { promise, seen });
    }
    Ok(Report { link: link.into(), format, checks })
}
