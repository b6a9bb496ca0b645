//! A reference star tracker that sees only pixels: DN image, time, velocity -> attitude with covariance.
//!
//! The other end of the cable for the images: what a real tracker would make of them. It knows what a real one knows,
//! the figures of `TrackerParams` and a catalog, and shares no code with what draws the images.
//!
//! ```text
//! image -> background -> detect -> centroid -> identify -> adjust -> Solution      lost in space
//! image, last attitude, rate -> guide -> track (windows, centroid) -> adjust -> Solution      tracking
//! ```
//!
//! It may command its camera: windows around the stars that it follows, an exposure time by their signal
//! (`CameraWish`).
//!
//! Units: px with the first pixel's centre at (0, 0), DN and electrons, rad in sensor axes (+Z boresight, +X image
//! right, +Y image down). Limits: round Gaussian spots drawn out along straight trails; parallax, light deflection and
//! colour are left out. Tests: `tests`, and those each file names.

mod adjust;
mod background;
mod centroid;
mod command;
mod detect;
mod geometry;
mod guide;
mod head;
mod identify;
mod params;
mod star_noise;
mod track;

pub use adjust::MatchedStar;
pub use centroid::Spot;
pub use command::{CameraOrders, CameraWish, Exposed};
pub use geometry::Geometry;
pub use guide::{GuideStar, GuideStars, apparent, earth_beta, uncorrected_turn};
pub use head::{Mode, Outcome, Solution, Tracker, TrackerCounts};
pub use params::{DetectorFigures, Reason, TrackerParams};
pub use star_noise::{AttitudePair, ErrorTerms, ExposedLight, FieldNoise, StarNoise, error_terms, predicted_nea_rad};

#[cfg(test)]
mod tests;
