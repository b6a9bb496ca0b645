//! A star tracker under test, compared with the truth of runs: the metrics of ECSS-E-ST-60-20C, test plans, reports.
//!
//! In: frames with their true attitudes, the tracker's log. Out: metrics with confidence intervals, verdicts of
//! requirements, a report as HTML, JSON and JUnit. No run needs this crate.
//!
//! ```text
//! plan -> fly (frames, tracker) -> frames.csv + tracker_log.csv -> record -> metrics -> requirements -> report
//! ```
//!
//! Tour: `log`, `log_form`, `captured` (a tracker's answers) -> `record` (truth and log, matched; the error of one solution) ->
//! `statistics` (intervals) -> `metric` -> `bias`, `noise` (and bandwidth), `spatial`, `slopes` (also over temperature),
//! `availability` (and exclusion angles): the metrics -> `assess` (all of them, with names and units) -> `requirements` (and
//! what data they lack) -> `report`; `plan`, `attitudes`, `poses`, `model_figures`, `tracker_inside`, `images`, `fly` (test plans).
//!
//! Conventions: sensor axes; the error is the small turn of the measured frame from the true one, rad, about x, y
//! (across the boresight: directional) and z (about it: rotational).

pub mod assess;
pub mod attitudes;
pub mod availability;
pub mod bias;
mod captured;
pub mod case_folder;
pub mod find_axes;
pub mod fly;
pub mod images;
pub mod log;
pub mod log_form;
pub mod metric;
pub mod model_figures;
pub mod noise;
pub mod plan;
mod poses;
pub mod provenance;
pub mod record;
pub mod report;
pub mod requirements;
pub mod slopes;
pub mod statistics;
#[cfg(test)]
mod synthetic;
mod tracker_inside;
