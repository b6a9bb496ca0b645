//! A point of light as passed to the planner.

use glam::DVec3;

/// A source to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Source {
    /// Identifier.
    pub id: u32,
    /// Electrons into the whole image plane during the exposure, for a source on the axis of an instrument without
    /// vignetting.
    pub electrons: f64,
    /// Magnitude in the instrument's band, for the truth table (NaN: not a star of a catalog).
    pub mag: f32,
    /// Place of the source.
    pub place: SourcePlace,
}

/// Place of a source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SourcePlace {
    /// Apparent direction, ICRF axes, unit.
    Icrf(DVec3),
    /// Place on the detector at mid-exposure, px.
    Pixel([f64; 2]),
}
