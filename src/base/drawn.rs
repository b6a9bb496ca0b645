//! How a frame was drawn: the method for its motion, its degradation, and the origin of its attitude.
//!
//! Degradations are losses accepted, in order, when the cheapest plan inside the accuracy budget does not fit the time
//! budget. `starloop check` announces the level; every frame states its own.

use crate::accuracy::AccuracyBudget;
use core::fmt;

crate::words! {
    /// Origin of the attitude of an exposure.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum PathOrigin {
        /// Between two received samples.
        Interpolated = "interpolated",
        /// Beyond the last received sample, by its rate and acceleration.
        Predicted = "predicted",
        /// The stream stopped: last attitude held by policy.
        Held = "held",
        /// Given by the user (`render`), not by a bus.
        Commanded = "commanded",
        /// Nothing received yet: no attitude at all.
        Absent = "none",
        /// A test pattern took the place of the image.
        TestPattern = "test_pattern",
    }
}

crate::words! {
    /// A method without its parameter.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
    pub enum MethodName {
        /// The PSF at the mean position.
        Static = "static",
        /// PSF convolved with a Gaussian of the path's covariance.
        Gaussian = "gaussian",
        /// Gauss-Legendre nodes in time, per star.
        GaussLegendre = "gauss-legendre",
        /// Straight segments of equal time, per star.
        Segments = "segments",
        /// Gauss-Legendre nodes in time between the corners of a path, per star.
        Corners = "corners",
        /// Samples in time, per star.
        Samples = "samples",
        /// PSF convolved with the path once per frame.
        EffectivePsf = "effective-psf",
        /// PSF convolved with the path at the corners of a grid of zones.
        ZonalPsf = "zonal-psf",
    }
}

impl MethodName {
    /// Returns true when a number of nodes (of segments, for segments) can be specified.
    pub fn takes_number(self) -> bool {
        !matches!(self, Self::Static | Self::Gaussian)
    }
}

/// How the motion in a frame was drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameMethod {
    /// Nothing was drawn yet.
    None,
    /// The reference integrated the exact motion.
    Exact,
    /// By the planned method.
    Planned(MethodName),
}

impl FrameMethod {
    /// Returns the name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Exact => "exact",
            Self::Planned(method) => method.name(),
        }
    }
}

crate::words! {
    /// Degradation of a frame.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
    pub enum Degradation {
        /// No degradation.
        #[default]
        Full = "full",
        /// Stars whose light stays below half a sigma of the noise in every pixel are left out.
        FaintStarsOut = "faint-stars-out",
        /// Errors may be three times the budget.
        Budget3 = "budget-x3",
        /// Errors may be ten times the budget.
        Budget10 = "budget-x10",
        /// Every star is drawn at its mean position: motion in the exposure is given up.
        MotionOut = "motion-out",
        /// Only as many of the brightest stars as fit the time.
        BrightStarsOnly = "bright-stars-only",
    }
}

impl Degradation {
    /// The default limit: levels beyond it leave out motion, or stars that are visible.
    pub const LAST_BY_DEFAULT: Self = Self::Budget10;

    /// Describes in words the loss of this level.
    pub fn gives_up(self) -> &'static str {
        match self {
            Self::Full => "nothing: every star that can be seen, inside the accuracy budget",
            Self::FaintStarsOut => "stars that stay below half a sigma of the noise in every pixel",
            Self::Budget3 => "accuracy: errors up to 3 times the budget",
            Self::Budget10 => "more accuracy: errors up to 10 times the budget",
            Self::MotionOut => "motion in the exposure: every star at its mean position",
            Self::BrightStarsOnly => "all but the brightest stars that fit the time (32 at least)",
        }
    }

    /// Returns the next worse level; `None` at the end.
    #[must_use]
    pub fn next(self) -> Option<Self> {
        let at = Self::ALL.iter().position(|degradation| *degradation == self)?;
        Self::ALL.get(at + 1).copied()
    }

    /// Returns the accuracy budget of this level.
    pub fn loosened(self, budget: &AccuracyBudget) -> AccuracyBudget {
        let times = match self {
            Self::Full | Self::FaintStarsOut => 1.0,
            Self::Budget3 => 3.0,
            Self::Budget10 | Self::MotionOut | Self::BrightStarsOnly => 10.0,
        };
        AccuracyBudget { centroid_px: budget.centroid_px * times, pixel_sigma: budget.pixel_sigma * times, ..*budget }
    }

    /// Returns the share of the noise below which stars are left out.
    pub fn cut_off_sigma(self, budget: &AccuracyBudget) -> f64 {
        const SHARE_OF_BUDGET: f64 = 0.2;
        const DEGRADED: f64 = 0.5;
        if self == Self::Full { SHARE_OF_BUDGET * budget.pixel_sigma } else { DEGRADED }
    }
}

impl fmt::Display for Degradation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degradations_are_taken_in_order_and_only_ever_give_up_more() {
        let budget = AccuracyBudget::default();
        let mut degradation = Degradation::Full;
        while let Some(next) = degradation.next() {
            assert!(next > degradation);
            assert!(next.loosened(&budget).centroid_px >= degradation.loosened(&budget).centroid_px, "{next}");
            assert!(next.cut_off_sigma(&budget) >= degradation.cut_off_sigma(&budget), "{next}");
            degradation = next;
        }
        assert_eq!(degradation, Degradation::BrightStarsOnly);
    }
}
