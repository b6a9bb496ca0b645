//! Position of the image at one instant of an exposure, relative to its middle: the motion that all stars share.
//!
//! A pose is thirteen numbers: the rotation of the sensor axes as `R - I` (row-major), the roll of a commanded image
//! path as `sin` and `cos - 1`, and its shift in px. A star's displacement follows from them exactly
//! ([`crate::exposure::track::StarTrack`]); differences from the identity keep their precision in f32. Lists of poses
//! may be averaged and shifted: displacement is linear in them to first order, and [`crate::exposure::probes`] measures
//! the remaining error.
//!
//! [`PixelPath`]: a commanded displacement of the image on the detector during the exposure (`render --los`). It is in
//! px, the same everywhere; roll turns the image about the principal point, from +x towards +y.

use base::refused::Refused;
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

/// One row of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelPoint {
    /// Time since the exposure started, s (0 and ignored in a list of samples).
    pub t_s: f64,
    /// Displacement to the right, px.
    pub dx_px: f64,
    /// Displacement downwards, px.
    pub dy_px: f64,
    /// Roll of the image from +x towards +y, rad.
    pub roll_rad: f64,
}

/// A commanded image path.
#[derive(Debug, Clone, PartialEq)]
pub enum PixelPath {
    /// Linear between rows in time order; constant before the first and after the last.
    Line(Vec<PixelPoint>),
    /// Equal weights, in time order.
    Samples(Vec<PixelPoint>),
}

/// Largest displacement, px: no detector is as large.
const LARGEST_PX: f64 = 1e6;
/// Tolerance for rounded times in files: this share of the exposure beyond its ends is accepted.
const TIME_SLACK: f64 = 1e-9;

impl PixelPath {
    /// Returns a path that is linear between rows.
    ///
    /// # Errors
    /// When the list is empty, a number is not finite, or the times are not ascending within the exposure.
    pub fn line(points: Vec<PixelPoint>, exposure_s: f64) -> Result<Self, Refused> {
        check_finite(&points)?;
        let mut earliest = -TIME_SLACK * exposure_s;
        for (i, point) in points.iter().enumerate() {
            if point.t_s < earliest || point.t_s > exposure_s * (1.0 + TIME_SLACK) {
                return Err(Refused(format!(
                    "row {row}: got t_s = {t_s}, wanted a time not before the row above and within 0..{exposure_s} s",
                    row = i + 1,
                    t_s = point.t_s
                )));
            }
            earliest = point.t_s;
        }
        Ok(Self::Line(points))
    }

    /// Returns a list of equally weighted positions.
    ///
    /// # Errors
    /// When the list is empty or a number is not finite.
    pub fn samples(points: Vec<PixelPoint>) -> Result<Self, Refused> {
        check_finite(&points)?;
        Ok(Self::Samples(points))
    }

    /// Returns an upper bound of the length of the path of any star within `radius_px` of the principal point, px.
    pub fn length_px(&self, radius_px: f64) -> f64 {
        self.points().windows(2).map(|pair| pair[0].distance_px(&pair[1], radius_px)).sum()
    }

    /// Returns the rows of the path.
    pub fn points(&self) -> &[PixelPoint] {
        match self {
            Self::Line(points) | Self::Samples(points) => points,
        }
    }
}

impl PixelPoint {
    /// Returns the point at a share `s` of the distance to `next`.
    pub fn towards(&self, next: &Self, s: f64) -> Self {
        let mix = |a: f64, b: f64| a + s * (b - a);
        Self {
            t_s: mix(self.t_s, next.t_s),
            dx_px: mix(self.dx_px, next.dx_px),
            dy_px: mix(self.dy_px, next.dy_px),
            roll_rad: mix(self.roll_rad, next.roll_rad),
        }
    }

    /// Returns an upper bound of the distance that any star within `radius_px` of the principal point moves to `next`,
    /// px.
    pub fn distance_px(&self, next: &Self, radius_px: f64) -> f64 {
        let (x, y) = (next.dx_px - self.dx_px, next.dy_px - self.dy_px);
        (x * x + y * y).sqrt() + (next.roll_rad - self.roll_rad).abs() * radius_px
    }
}

fn check_finite(points: &[PixelPoint]) -> Result<(), Refused> {
    let finite = |p: &PixelPoint| [p.t_s, p.dx_px, p.dy_px, p.roll_rad].iter().all(|v| v.is_finite());
    let far = |p: &PixelPoint| p.dx_px.abs().max(p.dy_px.abs());
    if let Some((i, point)) = points.iter().enumerate().find(|(_, point)| far(point) > LARGEST_PX) {
        return Err(Refused(format!(
            "row {row}: got a displacement of {px:e} px, wanted at most {LARGEST_PX:e} px",
            row = i + 1,
            px = far(point)
        )));
    }
    match points.iter().position(|point| !finite(point)) {
        Some(i) => Err(Refused(format!("row {row}: got a number that is not finite", row = i + 1))),
        None if points.is_empty() => Err(Refused("no rows: wanted at least one".to_owned())),
        None => Ok(()),
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

#[cfg(test)]
mod pixel_path_tests {
    use super::*;

    fn at(t_s: f64) -> PixelPoint {
        PixelPoint { t_s, dx_px: 0.0, dy_px: 0.0, roll_rad: 0.0 }
    }

    #[test]
    fn rows_out_of_order_or_outside_are_refused_with_their_row() {
        let error = PixelPath::line(vec![at(0.0), at(0.2), at(0.1)], 0.3).expect_err("backwards");
        let wanted = "wanted a time not before the row above and within 0..0.3 s";
        assert_eq!(error.to_string(), format!("row 3: got t_s = 0.1, {wanted}"));
        let error = PixelPath::line(vec![at(0.0), at(0.4)], 0.3).expect_err("too late");
        assert_eq!(error.to_string(), format!("row 2: got t_s = 0.4, {wanted}"));
        assert_eq!(PixelPath::samples(vec![]), Err(Refused("no rows: wanted at least one".to_owned())));
        assert_eq!(
            PixelPath::samples(vec![at(0.0), at(f64::NAN)]),
            Err(Refused("row 2: got a number that is not finite".to_owned()))
        );
    }

    #[test]
    fn a_displacement_beyond_all_detectors_is_refused() {
        let far = PixelPoint { dx_px: 1e12, ..at(0.0) };
        assert_eq!(
            PixelPath::samples(vec![at(0.0), far]),
            Err(Refused("row 2: got a displacement of 1e12 px, wanted at most 1e6 px".to_owned()))
        );
    }
}
