//! The planner: `LosPath` (or a path in pixels) and sources -> [`ExposurePlan`].
//!
//! During an exposure the image moves through poses that all stars share: rotation, roll, shift ([`pose`]). Every
//! method for motion is a list of weighted poses, drawn star by star or combined with the PSF; its error relative to
//! the true paths of a few probes is known before a single pixel is drawn ([`weigh`]). `starloop check` prints the
//! choice and its reasons.

mod choice;
pub mod correction;
pub mod cost;
pub mod cost_fit;
pub mod cut_off;
pub mod dense;
mod instrument;
pub mod line;
pub mod lists;
pub mod mean_field;
pub mod method;
pub mod moments;
pub mod motion;
pub mod node_error;
pub mod nodes;
pub mod pixel_path;
mod place;
mod place_block;
pub mod plan;
mod planned_star;
mod planned_target;
pub mod planner;
pub mod pose;
pub mod probes;
pub mod sampling;
pub mod share;
pub mod shape_change;
pub mod sky_path;
pub mod smear;
mod source;
pub mod spectrum;
pub mod target;
pub mod target_plan;
pub mod track;
mod trial;
pub mod weigh;
pub mod whole;

pub use base::drawn::Degradation;
pub use instrument::Instrument;
pub use method::{Method, MethodChoice};
pub use motion::{Motion, Shutter};
pub use pixel_path::{PixelPath, PixelPoint};
pub use plan::{Drawing, ExposurePlan, NodeList};
pub use planned_star::PlannedStar;
pub use planned_target::PlannedTarget;
pub use planner::Planner;
pub use sampling::PsfSampling;
pub use sky_path::SkyPath;
pub use source::{Source, SourcePlace};
pub use target::{LightCurve, Target, TargetCurve, TargetPath, TargetWay};
