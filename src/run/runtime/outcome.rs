//! How a run ended.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::{error::RunError, port_reading::PortReading, record::RunRecord};
use base::time::{Span, Tai};
use frames::report::Losses;
use frames::sink::{SinkLine, SinkSummary};

/// Result of a run, whether it ended well or not.
pub struct RunOutcome {
    /// Counts, times and events.
    pub record: RunRecord,
    /// Counters of each port.
    pub ports: Vec<PortReading>,
    /// Summary written by the sink of each head; `None` when it could not finish.
    pub summaries: Vec<Option<SinkSummary>>,
    /// Result of each sink of each head, failures included: on the real clock they do not end a run.
    pub sinks: Vec<SinkLine>,
    /// Threads beside the run that ended before it did: pulses, gateways, the live view.
    pub lost_threads: Vec<&'static str>,
    /// Why the run ended early, if it did.
    pub error: Option<RunError>,
}

impl RunOutcome {
    /// Lists all losses: frames that a sink dropped or refused, sinks that could not be finished or failed, threads.
    pub fn losses(&self) -> Losses {
        let mut losses = Losses::of_sinks(&self.sinks);
        self.lost_threads.iter().for_each(|name| losses.note_thread(name));
        note_lost_reader(&mut losses, &self.record.ledger);
        losses
    }

    /// Records a thread that ended before the run did; `at` is when this was noticed.
    pub fn note_lost_thread(&mut self, name: &'static str, at: Tai) {
        self.lost_threads.push(name);
        self.record.ledger.note(Event { what: name, ..Event::new(EventKind::ThreadLost, at, None, Span::ZERO) });
    }
}

/// Adds the thread that reads tiles of stars, if the ledger records its loss.
pub fn note_lost_reader(losses: &mut Losses, ledger: &Ledger) {
    if ledger.count(EventKind::StarReaderLost) > 0 {
        losses.note_thread("tiles");
    }
}

/// Returns the lines of one head's sinks; with several heads their places contain the head's number.
pub fn lines_of_head(head: usize, heads: usize, lines: Vec<SinkLine>) -> impl Iterator<Item = SinkLine> {
    let named = move |line: SinkLine| match heads {
        0 | 1 => line,
        _ => SinkLine { place: format!("head{head} {}", line.place), ..line },
    };
    lines.into_iter().map(named)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_reader_of_stars_is_a_loss_of_the_run() {
        let mut record = RunRecord::default();
        let outcome = |record| RunOutcome {
            record,
            ports: Vec::new(),
            summaries: Vec::new(),
            sinks: Vec::new(),
            lost_threads: Vec::new(),
            error: None,
        };
        assert!(outcome(RunRecord::default()).losses().is_empty(), "control: nothing was lost");
        record.ledger.note(Event::new(EventKind::StarReaderLost, Tai::from_ns(0), Some(1), Span::ZERO));
        assert_eq!(outcome(record).losses().to_string(), "lost: tiles: the thread ended before the run did");
    }
}
