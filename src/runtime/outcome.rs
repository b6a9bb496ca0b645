//! How a run ended.

use crate::runtime::error::RunError;
use crate::runtime::port_reading::PortReading;
use crate::runtime::record::RunRecord;
use crate::sink::SinkSummary;

/// Everything that is known after a run, whether it ended well or not.
pub struct RunOutcome {
    /// Counts, times and events.
    pub record: RunRecord,
    /// What each port counted.
    pub ports: Vec<PortReading>,
    /// What the sink wrote; `None` when it could not finish.
    pub sink: Option<SinkSummary>,
    /// Why the run ended early, if it did.
    pub error: Option<RunError>,
}
