//! What a run says about itself: timing quantiles, counts, a JSON summary, a table and a line of progress.
//!
//! Input: plain numbers from the runtime, frame by frame (`stages::StageTimes`) and at the end
//! (`summary::RunSummary`). Output: text. Nothing here reads a clock or knows another room.
//!
//! Tour: `stages` (where the time of a frame goes) -> `histogram` (quantiles, without allocation while running)
//! -> `summary` and `machine` (JSON) -> `table` (the same for people) and `progress` (while it runs). Apart from a run:
//! `plot` (charts as SVG).

pub mod histogram;
pub mod machine;
pub mod plot;
pub mod progress;
pub mod stages;
pub mod summary;
pub mod table;

pub use histogram::{CountHistogram, CountSpread, Quantiles, StageHistogram};
pub use machine::Machine;
pub use plot::{Chart, pareto_front, to_svg};
pub use progress::{Progress, progress_line, step_line};
pub use stages::{Stage, StageHistograms, StageTimes};
pub use summary::{EventLine, FrameCounts, LinkCounts, RunSummary};
pub use table::summary_table;

/// A report that could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The summary does not go into JSON.
    #[error("the run summary cannot be written as JSON: {0}; the frames and their log are not affected")]
    Json(#[from] serde_json::Error),
}
