//! One star of a plan: its light, its place, and the list it is drawn with.

use crate::exposure::track::StarPlace;

/// One star of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedStar {
    /// Identifier of the source.
    pub id: u32,
    /// Magnitude in the instrument's band (NaN: not a star of a catalog).
    pub mag: f32,
    /// Electrons the star sends into the whole image plane during the exposure.
    pub electrons: f64,
    /// Electrons drawn by a backend that gives all rows of a star one exposure: [`Self::electrons`] times the effect of
    /// a rolling shutter on a star that moves along its rows. The reference exposes row by row instead.
    pub drawn_e: f64,
    /// Electrons of it that land on the detector within the footprint.
    pub electrons_on_detector: f64,
    /// Place at mid-exposure.
    pub place: StarPlace,
    /// Exposure-averaged position: the star's true centroid, px.
    pub mean_px: [f64; 2],
    /// Index in [`crate::exposure::ExposurePlan::lists`] of the list it is drawn with.
    pub list: u32,
}
