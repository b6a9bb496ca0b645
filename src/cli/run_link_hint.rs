//! The sentence at the end of a run about a TCP connection that was refused or closed.

use config::{Carrier, Link};
use frames::report::RunSummary;

/// Returns the sentence about a link over TCP that could not connect, or whose connection was lost, when no attitude came
/// over it; `None` for other links, and where all is well.
pub(super) fn connection_hint(link: &Link, summary: &RunSummary) -> Option<String> {
    let Carrier::Tcp { address, connects: true } = &link.carrier else { return None };
    let count = |name: &str| summary.link.counters.get(name).copied().unwrap_or(0);
    let (failed, lost) = (count("connections_failed"), count("link_lost"));
    let is_bad = failed + lost > 0 && (count("attitudes_accepted") == 0 || lost > 0);
    is_bad.then(|| {
        format!(
            "tcp: {address}: {failed} tries to connect failed, and the other end closed {lost} connections; check that it \
             listens there, and takes another client"
        )
    })
}
