//! A target in a plan.

use crate::exposure::target::{Smear, Target};
use crate::exposure::track::StarPlace;
use core::ops::Range;

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
