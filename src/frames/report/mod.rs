//! The report of a run about itself: timing quantiles, counts, a JSON summary, a table and a line of progress.
//!
//! Input: plain numbers from the runtime, frame by frame (`stages::StageTimes`) and at the end
//! (`summary::RunSummary`). Output: text. Nothing here reads a clock or uses the other modules.
//!
//! Tour: `stages` (where the time of a frame goes) -> `histogram` (quantiles, without allocation while running)
//! -> `account` and `verdict` (one word with its reasons), `summary`, `losses` and `machine` (JSON) -> `table` (the same
//! for people), `progress_numbers` (while it runs). Apart from a run: `plot` (charts as SVG),
//! `page` (HTML that needs no other file).
//!
//! Frame by frame: `frame_record` (one frame's times, fate and cause) -> `frame_ring` (the last frames, counts of all)
//! -> `budget` (verdict per line) -> `junit`, `timeline`.

use base::refused::Refused;
use serde::Serialize;

pub mod account;
pub mod budget;
pub mod frame_record;
pub mod frame_ring;
pub mod histogram;
pub mod junit;
pub mod losses;
pub mod machine;
pub mod page;
pub mod plot;
pub mod progress_numbers;
pub mod stages;
pub mod sink_line;
pub mod summary;
pub mod table;
pub mod time_tally;
pub mod timeline;
pub mod verdict;

pub use account::{FrameAccount, FrameEnd, Tally};
pub use budget::{
    BudgetLimits, BudgetLine, BudgetReport, HygieneLine, LineVerdict, answer_lines, budget_lines, budget_table,
};
pub use frame_record::{Fate, FrameRecord, MissCause, frames_csv};
pub use frame_ring::{FrameRing, Latency};
pub use histogram::{CountHistogram, CountSpread, Quantiles, StageHistogram};
pub use junit::to_junit;
pub use losses::{LossLine, Losses, LostPart};
pub use machine::Machine;
pub use page::Page;
pub use plot::{Chart, pareto_front, to_svg};
pub use progress_numbers::{
    EVENTS_MAX, NAMES_MAX, NamedCounts, PortCounts, Progress, RunNumbers, progress_line, step_line,
};
pub use sink_line::SinkLine;
pub use stages::{Stage, StageHistograms, StageTimes};
pub use summary::{AnswerRow, EventLine, FrameCounts, GatewayRow, LinkCounts, RunSummary};
pub use table::{NEWEST_MAX, NewestEvent, NewestEvents, OF_OTHER_NODES, short_table, summary_table};
pub use time_tally::TimeTally;
pub use timeline::timeline_svg;
pub use verdict::{Reason, RunLimits, RunVerdict, RunWord};

/// Returns a report as JSON for people and programs, which ends in a line break. Numbers that are not finite become
/// `null`.
fn json_pretty(report: &impl Serialize) -> Result<String, Refused> {
    let text = serde_json::to_string_pretty(report).map_err(|why| {
        Refused(format!("the run summary cannot be written as JSON: {why}; the frames and their log are not affected"))
    })?;
    Ok(text + "\n")
}
