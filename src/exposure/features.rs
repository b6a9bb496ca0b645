//! Path features: what all stars share of the motion in one exposure.

/// Number of path features.
pub const FEATURES: usize = 6;

/// Feature values at one instant: `[tau, tau^2, s0, s1, s2, s3]`, with `tau` in [-1/2, 1/2] the share of the
/// exposure since its middle and `s` the shared displacement: a jitter rotation vector (rad, s3 = 0), or a commanded
/// image path `[dx_px, dy_px, sin(roll), cos(roll) - 1]`.
pub type Features = [f64; FEATURES];

/// One node of a method: a weight and the features there. The weights of a list sum to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathNode {
    /// Share of the exposure this node stands for.
    pub weight: f64,
    /// Features at the node.
    pub phi: Features,
}

/// Features at `tau` with shared displacement `s`.
#[must_use]
pub fn features(tau: f64, s: [f64; 4]) -> Features {
    [tau, tau * tau, s[0], s[1], s[2], s[3]]
}
