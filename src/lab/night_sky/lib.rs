//! Real frames of the night sky, compared with drawn ones.
//!
//! In: image files and the file of the camera that took them. Out: attitude, the camera as it was fitted, the same
//! field drawn by starloop, and the differences star by star.
//!
//! Tour: [`read`] (TIFF, PNG, FITS) -> [`detect`] -> [`solve`] (attitude from nothing) -> [`geometry`] with the terms that the
//! stars call for, [`psf_fit`], [`light_fit`], `response` (the camera: `fit`), with places and light of stars by [`measure`] ->
//! [`camera_text`] (the fitted file) -> [`draw`] -> [`figures`], [`outliers`] -> [`result`] (limits, what one frame fails, and by
//! `limiting` why) -> [`report`] (verdict, text, JSON), [`html`]. [`compare`] puts them together.
//!
//! *Limits.* One PSF for all stars and colours; no planets; the air's refraction as a linear stretch; exposures at rest.
//! *Validation.* `tests/night_sky`: drawn fields with known attitude and camera come back.

pub mod camera_text;
pub mod compare;
pub mod detect;
pub mod draw;
mod fit;
pub mod figures;
pub mod geometry;
pub mod html;
pub mod light_fit;
mod limiting;
pub mod measure;
mod newton;
pub mod outliers;
pub mod picture;
pub mod psf_fit;
pub mod read;
pub mod report;
mod response;
pub mod result;
pub mod sky_stars;
pub mod solve;

pub use compare::{Compared, Comparer, Options};
pub use picture::Picture;
pub use result::Comparison;
