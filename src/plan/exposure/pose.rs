//! Position of the image at one instant of an exposure, relative to its middle: the motion that all stars share.
//!
//! A pose is thirteen numbers: the rotation of the sensor axes as `R - I` (row-major), the roll of a commanded image
//! path as `sin` and `cos - 1`, and its shift in px. A star's displacement follows from them exactly
//! ([`crate::exposure::track::StarTrack`]); differences from the identity keep their precision in f32. Lists of poses
//! may be averaged and shifted: displacement is linear in them to first order, and [`crate::exposure::probes`] measures
//! the remaining error.

use glam::DQuat;

/// Number of values of a pose.
pub const POSE: usize = 13;
/// Index of the sine of the roll; the cosine minus one follows.
pub const ROLL: usize = 9;
/// Index of the shift along x, px; that along y follows.
pub const SHIFT: usize = 11;

/// Rotation (`R - I`, 0 to 8), roll (9, 10) and shift (11, 12).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose(pub [f64; POSE]);

/// One node of a method: a weight and the pose there. The weights of a list sum to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathNode {
    /// Share of the exposure that this node represents.
    pub weight: f64,
    /// Pose at the node.
    pub pose: Pose,
}

impl Default for Pose {
    fn default() -> Self {
        Self::STILL
    }
}

impl Pose {
    /// The pose at mid-exposure.
    pub const STILL: Self = Self([0.0; POSE]);

    /// Returns the pose of a rotation of directions by `q`, then a roll about the principal point, then a shift.
    pub fn new(q: DQuat, roll_rad: f64, shift_px: [f64; 2]) -> Self {
        let DQuat { x, y, z, w } = q;
        let half = (0.5 * roll_rad).sin();
        // Both for rotation and roll, cos - 1 is computed without cancellation.
        Self([
            -2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
            2.0 * (x * y + w * z),
            -2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            -2.0 * (x * x + y * y),
            roll_rad.sin(),
            -2.0 * half * half,
            shift_px[0],
            shift_px[1],
        ])
    }

    /// Returns the shift alone.
    pub fn only_shift(&self) -> Self {
        let mut pose = Self::STILL;
        pose.0[SHIFT..].copy_from_slice(&self.0[SHIFT..]);
        pose
    }

    /// Returns `self + share * other`, value by value.
    pub fn plus(&self, share: f64, other: &Self) -> Self {
        Self(core::array::from_fn(|i| self.0[i] + share * other.0[i]))
    }

    /// Returns the pose at a share `s` of the distance to `next`, along a straight line.
    pub fn towards(&self, next: &Self, s: f64) -> Self {
        Self(core::array::from_fn(|i| self.0[i] + s * (next.0[i] - self.0[i])))
    }
}

/// Returns the weighted mean of a list.
pub fn mean_pose(nodes: &[PathNode]) -> Pose {
    nodes.iter().fold(Pose::STILL, |mean, node| mean.plus(node.weight, &node.pose))
}

/// Shifts all nodes together so that their mean is `mean`.
pub fn recentre(nodes: &mut [PathNode], mean: &Pose) {
    let off = mean.plus(-1.0, &mean_pose(nodes));
    for node in nodes {
        node.pose = node.pose.plus(1.0, &off);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    #[test]
    fn a_turn_is_the_rotation_matrix_less_one_to_the_last_digit_for_small_angles() {
        let angle = DVec3::new(1e-9, -2e-9, 3e-9);
        let pose = Pose::new(DQuat::from_scaled_axis(angle), 1e-9, [0.0; 2]);
        assert!((pose.0[1] + angle.z).abs() < 1e-17 && (pose.0[5] + angle.x).abs() < 1e-17, "{pose:?}");
        assert!((pose.0[10] + 0.5e-18).abs() < 1e-30, "cos - 1 of 1e-9 rad: {}", pose.0[10]);
        let q = DQuat::from_scaled_axis(DVec3::new(0.3, -0.2, 0.5));
        let (pose, matrix) = (Pose::new(q, 0.0, [0.0; 2]), DMat3::from_quat(q));
        for row in 0..3 {
            for column in 0..3 {
                let identity = if row == column { 1.0 } else { 0.0 };
                let got = pose.0[3 * row + column] + identity;
                assert!((got - matrix.col(column)[row]).abs() < 1e-15, "row {row} column {column}");
            }
        }
    }

    #[test]
    fn recentred_nodes_have_the_mean_asked_for() {
        let node = |weight, x| PathNode { weight, pose: Pose::new(DQuat::IDENTITY, 0.0, [x, 0.0]) };
        let mut nodes = [node(0.25, 1.0), node(0.75, 3.0)];
        recentre(&mut nodes, &Pose::new(DQuat::IDENTITY, 0.0, [7.0, 1.0]));
        assert_eq!(mean_pose(&nodes).0[SHIFT..], [7.0, 1.0]);
    }
}
