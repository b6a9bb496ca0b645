//! Bounds of the errors of a list of nodes.

/// Errors of a node list.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct NodeError {
    /// 5 x 5 centroid, px.
    pub centroid_px: f64,
    /// Largest pixel error relative to the star's peak.
    pub peak: f64,
}

impl NodeError {
    /// Returns the larger of each error.
    #[must_use]
    pub fn worst(self, other: Self) -> Self {
        Self { centroid_px: self.centroid_px.max(other.centroid_px), peak: self.peak.max(other.peak) }
    }

    /// Returns the smaller of each error: of two bounds of the same error, each is one.
    #[must_use]
    pub fn least(self, other: Self) -> Self {
        Self { centroid_px: self.centroid_px.min(other.centroid_px), peak: self.peak.min(other.peak) }
    }

    /// Returns the sum of each error.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self { centroid_px: self.centroid_px + other.centroid_px, peak: self.peak + other.peak }
    }
}
