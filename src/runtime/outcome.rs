//! How a run ended.

use crate::report::Losses;
use crate::runtime::error::RunError;
use crate::runtime::port_reading::PortReading;
use crate::runtime::record::{RunRecord, sink_rows};
use crate::sink::{SinkLine, SinkSummary};

/// Everything that is known after a run, whether it ended well or not.
pub struct RunOutcome {
    /// Counts, times and events.
    pub record: RunRecord,
    /// What each port counted.
    pub ports: Vec<PortReading>,
    /// What the sink of each head wrote; `None` when it could not finish.
    pub summaries: Vec<Option<SinkSummary>>,
    /// What each sink of each head did, failures included: on the real clock they do not end a run.
    pub sinks: Vec<SinkLine>,
    /// Why the run ended early, if it did.
    pub error: Option<RunError>,
}

impl RunOutcome {
    /// Lists what the sinks lost: frames dropped or refused, sinks that could not be finished or broke down.
    #[must_use]
    pub fn losses(&self) -> Losses {
        Losses::of_sinks(&sink_rows(&self.sinks))
    }
}

/// The lines of one head's sinks; with several heads their places say which.
pub fn lines_of_head(head: usize, heads: usize, lines: Vec<SinkLine>) -> impl Iterator<Item = SinkLine> {
    let named = move |line: SinkLine| match heads {
        0 | 1 => line,
        _ => SinkLine { place: format!("head{head} {}", line.place), ..line },
    };
    lines.into_iter().map(named)
}
