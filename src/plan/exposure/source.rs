//! A point of light as it is handed to the planner.

use glam::DVec3;

/// A source to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Source {
    /// Identifier.
    pub id: u32,
    /// Electrons into the whole image plane during the exposure, were it on the axis of an instrument that blocks nothing.
    pub electrons: f64,
    /// Magnitude in the instrument's band, for the truth table (NaN: not a star of a catalog).
    pub mag: f32,
    /// Where it is.
    pub place: SourcePlace,
}

/// Where a source is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SourcePlace {
    /// Apparent direction, ICRF axes, unit.
    Icrf(DVec3),
    /// Place on the detector at mid-exposure, px.
    Pixel([f64; 2]),
}
