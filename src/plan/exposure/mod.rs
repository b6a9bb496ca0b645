//! The planner: `LosPath` (or a path in pixels) and sources -> [`ExposurePlan`].
//!
//! During an exposure the image moves through poses that all stars share: rotation, roll, shift ([`pose`]). Every
//! method for motion is a list of weighted poses, drawn star by star or combined with the PSF; its error relative to
//! the true paths of a few probes is known before a single pixel is drawn ([`weigh`]). `starloop check` prints the
//! choice and its reasons.

mod choice;
pub mod cost;
pub mod cut_off;
pub mod line;
pub mod lists;
pub mod mean_field;
pub mod method;
pub mod moments;
pub mod motion;
pub mod nodes;
mod place;
pub mod plan;
pub mod planner;
pub mod pose;
pub mod probes;
pub mod sampling;
pub mod share;
pub mod shape_change;
pub mod sky_path;
pub mod smear;
mod source;
pub mod target;
pub mod target_plan;
pub mod track;
mod trial;
pub mod weigh;
pub mod whole;

pub use base::drawn::Degradation;
pub use method::{Method, MethodChoice};
pub use motion::{Instrument, Motion, Shutter};
pub use plan::{Drawing, ExposurePlan, NodeList};
pub use planner::Planner;
pub use pose::{PixelPath, PixelPoint};
pub use sampling::PsfSampling;
pub use sky_path::SkyPath;
pub use source::{PlannedStar, PlannedTarget, Source, SourcePlace};
pub use target::{LightCurve, Target, TargetCurve, TargetPath, TargetWay};
