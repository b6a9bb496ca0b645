//! The planner: `LosPath` (or a path in pixels) and sources -> [`ExposurePlan`].
//!
//! During an exposure a star moves on the detector by `response * phi(t)`: six path features `phi` shared by all
//! stars (linear and quadratic time, up to four components of jitter or of a commanded image path) and a 2 x 6
//! response of its own. Every method for motion is a list of weighted nodes in `phi`, so its moments, and with them
//! its error, are known before a single pixel is drawn. `starloop check` prints what was chosen and why.

pub mod cost;
pub mod features;
pub mod method;
pub mod moments;
pub mod motion;
pub mod nodes;
pub mod pixel_path;
pub mod plan;
pub mod planner;
pub mod share;
pub mod spectrum;
pub mod track;

pub use method::{Method, MethodChoice};
pub use motion::Motion;
pub use pixel_path::{PixelPath, PixelPoint};
pub use plan::{ExposurePlan, PlannedStar};
pub use planner::{Instrument, Planner, Source, SourcePlace};
