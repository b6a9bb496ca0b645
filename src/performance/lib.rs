//! A star tracker under test, compared with the truth of runs: the metrics of ECSS-E-ST-60-20C, test plans, reports.
//!
//! In: frames with their true attitudes, the tracker's log. Out: metrics with confidence intervals, verdicts of
//! requirements, a report as HTML, JSON and JUnit. No run needs this crate.
//!
//! ```text
//! plan -> fly (frames, tracker) -> frames.csv + tracker_log.csv -> record -> metrics -> requirements -> report
//! ```
//!
//! Tour: `attitude_error` (one solution) -> `log`, `captured` (a tracker's answers) -> `record` (truth and log, matched) -> `statistics` (intervals) -> `metric` ->
//! `bias`, `noise`, `spatial`, `slopes`, `availability`, `thermo_elastic`, `bandwidth`, `exclusion` (the metrics) -> `assess` (all of them), `metric_list` (names and units) ->
//! `requirements`, `evidence` -> `report`; `plan`, `attitudes`, `bright_bodies`, `mounting`, `poses`, `tracker_inside`, `fly` (test plans).
//!
//! Conventions: sensor axes; the error is the small turn of the measured frame from the true one, rad, about x, y
//! (across the boresight: directional) and z (about it: rotational).

pub mod assess;
pub mod attitude_error;
pub mod attitudes;
pub mod availability;
pub mod bandwidth;
pub mod bias;
mod bright_bodies;
mod captured;
pub mod case_folder;
pub mod evidence;
pub mod exclusion;
pub mod fly;
pub mod log;
pub mod metric;
pub mod metric_list;
pub mod model_figures;
pub mod mounting;
pub mod noise;
pub mod paperwork;
pub mod plan;
mod poses;
pub mod provenance;
pub mod record;
pub mod report;
pub mod requirements;
pub mod settings;
pub mod slopes;
pub mod spatial;
pub mod statistics;
#[cfg(test)]
mod synthetic;
pub mod thermo_elastic;
mod tracker_inside;
