//! The guided calibration of a display in front of a tracker.
//!
//! A plan (which display, which tracker, which images) -> images to show -> what the tracker measured (CSV, or frames
//! in which spots are found) -> map, response, flat field, magnitudes -> a dated file with a check sum, which is
//! refused when it is damaged, too old, or of something else. Light only: nothing here opens a window.
//!
//! Tour: `identity`, `pattern`, `plan` (images to show) -> `measurement`, `spots` (measurements) ->
//! `fit_map`, `fit` (results) -> `file`, `report` (stored and printed). Proved end to end by
//! `tests/physics/display_calibration` on a simulated display, collimator and camera that share no code with this
//! module: the map to 0.02 display px.

pub mod error;
pub mod file;
pub mod fit;
pub mod fit_map;
pub mod identity;
pub mod measurement;
pub mod pattern;
pub mod plan;
pub mod report;
pub mod spots;

pub use file::{Calibrated, Calibration, Light, Residuals};
pub use fit::{Fitted, Tracker, fit};
pub use identity::{DisplayIdentity, TrackerIdentity};
pub use measurement::Sight;
pub use pattern::{Grid, Pattern};
pub use plan::Plan;
