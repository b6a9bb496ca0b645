//! How a run ended.

use crate::runtime::error::RunError;
use crate::runtime::record::{LinkReport, RunRecord};
use crate::sink::SinkSummary;

/// Everything that is known after a run, whether it ended well or not.
pub struct RunOutcome {
    /// Counts, times and events.
    pub record: RunRecord,
    /// What the receiving side counted; `None` when its thread was lost.
    pub link: Option<LinkReport>,
    /// What the sink wrote; `None` when it could not finish.
    pub sink: Option<SinkSummary>,
    /// Why the run ended early, if it did.
    pub error: Option<RunError>,
}
