//! Points of light: as passed to the planner, and as a plan has them: their light, their place, and the list they are
//! drawn with.

use crate::exposure::target::{Smear, Target};
use crate::exposure::track::StarPlace;
use core::ops::Range;
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

/// One target of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedTarget {
    /// The target with its light after all losses.
    pub target: Target,
    /// Electrons it sends into the whole image plane during the exposure.
    pub electrons: f64,
    /// Electrons of it that land on the detector within the footprint.
    pub electrons_on_detector: f64,
    /// Mean place of its light, px.
    pub mean_px: [f64; 2],
    /// Place at the middle of its light, without the camera's motion within the exposure.
    pub place: StarPlace,
    /// Smear of its own motion.
    pub smear: Smear,
    /// Its nodes among [`ExposurePlan::stars`](crate::exposure::ExposurePlan::stars).
    pub nodes: Range<usize>,
    /// True when it would need more nodes than a target may have.
    pub is_coarse: bool,
}
