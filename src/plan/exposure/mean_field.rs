//! Computes mean positions of stars over the exposure, anywhere on the detector, from a few exact ones.
//!
//! A star's mean displacement is that of the mean pose plus a small correction (perspective and distortion are not
//! linear), which is a smooth function of the field: it is exact at the nine probes and quadratic between them. With a
//! rolling shutter the mean pose follows the row: exact at `rows` rows, quadratic through the nearest three.
//! [`Probes::mean_error_px`] measures the remaining error.
//!
//! [`Correction`]: a small displacement that varies smoothly over the field: given at the nine probes, quadratic
//! between them.

use crate::exposure::motion::{Motion, Shutter};
use crate::exposure::probes::{Probes, SIDE};
use crate::exposure::{pose::Pose, track::StarTrack};
use crate::optics::quadrature::gauss_legendre_node;
use sky::astrometry::CameraGeometry;

/// Number of midpoints in time for a row's mean pose when there is jitter.
const ROW_SAMPLES: usize = 256;
/// Gauss-Legendre nodes in time for smooth motion.
const SMOOTH_NODES: usize = 5;
/// Number of rows at which the mean pose of a rolling shutter is computed.
const ROLLING_ROWS: usize = 33;

/// Largest downward motion of a star from one row to the next for which its light is computed, px.
const MOST_PER_ROW: f64 = 0.9;

/// Mean positions over one exposure.
#[derive(Debug)]
pub struct MeanField {
    size_px: [f64; 2],
    /// Mean poses at equally spaced rows (one: the same for all rows).
    poses: Vec<Pose>,
    correction: Correction,
    moves: bool,
}

impl MeanField {
    /// Returns a field for a detector of this size.
    pub fn new(camera: &CameraGeometry) -> Self {
        Self {
            size_px: [camera.width_px(), camera.height_px()].map(|side| (side as f64 - 1.0).max(1.0)),
            poses: Vec::with_capacity(ROLLING_ROWS),
            correction: Correction::none(),
            moves: false,
        }
    }

    /// Computes the field from measured probes.
    pub fn measure(&mut self, motion: &Motion, shutter: Shutter, probes: &Probes) {
        self.moves = !motion.is_still();
        self.poses.clear();
        match shutter {
            Shutter::Global => self.poses.push(probes.mean()),
            Shutter::Rolling { .. } if !self.moves => self.poses.push(Pose::STILL),
            Shutter::Rolling { .. } => {
                let height = self.size_px[1];
                let delay_s = |row: usize| shutter.line_s() * height * (row as f64 / (ROLLING_ROWS - 1) as f64 - 0.5);
                self.poses.extend((0..ROLLING_ROWS).map(|row| row_mean(motion, delay_s(row))));
            }
        }
        let mut off = [[0.0; 2]; SIDE * SIDE];
        for (off, probe) in off.iter_mut().zip(&probes.probes) {
            let [x, y] = probe.track.displacement_px(&self.pose_at(probe.track.place.mid_px[1]));
            *off = [probe.mean_px[0] - x, probe.mean_px[1] - y];
        }
        self.correction = Correction::through(self.size_px, off);
    }

    /// Returns true when every star keeps its mid-exposure position.
    pub fn is_still(&self) -> bool {
        !self.moves
    }

    /// Returns the mean pose and correction, if all rows have the same.
    pub fn same_for_all_rows(&self) -> Option<(Pose, Correction)> {
        match self.poses.as_slice() {
            _ if !self.moves => Some((Pose::STILL, Correction::none())),
            [pose] => Some((*pose, self.correction)),
            _ => None,
        }
    }

    /// Returns the mean pose of the exposure of the row at `y_px`.
    pub fn pose_at(&self, y_px: f64) -> Pose {
        let Some(last) = self.poses.len().checked_sub(1) else { return Pose::STILL };
        if last < 2 {
            return self.poses[0];
        }
        let at = (y_px / self.size_px[1]).clamp(-0.5, 1.5) * last as f64;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the rows")]
        let middle = at.round().clamp(1.0, last as f64 - 1.0) as usize;
        let [a, b, c] = quadratic(at - middle as f64);
        let mut pose = Pose(self.poses[middle - 1].0.map(|v| a * v));
        pose = pose.plus(b, &self.poses[middle]);
        pose.plus(c, &self.poses[middle + 1])
    }

    /// Returns the mean displacement of a star, px.
    #[inline]
    pub fn displacement_px(&self, track: &StarTrack) -> [f64; 2] {
        if !self.moves {
            return [0.0; 2];
        }
        let y_px = track.place.mid_px[1];
        let mut moved;
        if let [pose] = self.poses.as_slice() {
            moved = track.displacement_px(pose);
        } else {
            moved = track.displacement_px(&self.pose_at(y_px));
            // Use the row in which the star spends its exposure, not the row of its mid-exposure position.
            moved = track.displacement_px(&self.pose_at(y_px + moved[1]));
            moved = track.displacement_px(&self.pose_at(y_px + moved[1]));
        }
        let [cx, cy] = self.correction.at(track.place.mid_px);
        [moved[0] + cx, moved[1] + cy]
    }

    /// Returns the factor of a star's light by a rolling shutter: a star that moves by `v` px down from row to row is
    /// exposed for `1 / (1 - v)` times the rows (with a global shutter: 1).
    pub fn rolling_gain(&self, track: &StarTrack) -> f64 {
        if !self.moves || self.poses.len() < 2 {
            return 1.0;
        }
        let row_px = track.place.mid_px[1] + self.displacement_px(track)[1];
        let down_px = |row_px: f64| track.displacement_px(&self.pose_at(row_px))[1];
        let per_row = down_px(row_px + 0.5) - down_px(row_px - 0.5);
        // A star that moves as fast as the rows cannot be drawn.
        1.0 / (1.0 - per_row.min(MOST_PER_ROW))
    }
}

/// Returns the mean pose of an exposure that is `delay_s` late.
fn row_mean(motion: &Motion, delay_s: f64) -> Pose {
    if motion.is_smooth() {
        let nodes = (0..SMOOTH_NODES).map(|i| gauss_legendre_node(SMOOTH_NODES, i));
        nodes.fold(Pose::STILL, |mean, node| mean.plus(node.weight, &motion.pose_at(node.x, delay_s)))
    } else {
        let share = 1.0 / ROW_SAMPLES as f64;
        let taus = (0..ROW_SAMPLES).map(|i| (i as f64 + 0.5) * share - 0.5);
        taus.fold(Pose::STILL, |mean, tau| mean.plus(share, &motion.pose_at(tau, delay_s)))
    }
}

/// Corrections below this are neglected, px.
const NOTHING_PX: f64 = 1e-9;

/// Displacements at the probes, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    size_px: [f64; 2],
    values: [[f64; 2]; SIDE * SIDE],
    is_nothing: bool,
}

impl Correction {
    /// Returns the correction through `values` at the probes (row by row) of a detector whose last pixel is at
    /// `size_px`.
    pub fn through(size_px: [f64; 2], values: [[f64; 2]; SIDE * SIDE]) -> Self {
        let is_nothing = values.iter().flatten().all(|v| v.abs() <= NOTHING_PX);
        Self { size_px, values, is_nothing }
    }

    /// Returns a correction of zero.
    pub fn none() -> Self {
        Self { size_px: [1.0; 2], values: [[0.0; 2]; SIDE * SIDE], is_nothing: true }
    }

    /// Returns the displacement at `px`.
    #[inline]
    pub fn at(&self, px: [f64; 2]) -> [f64; 2] {
        if self.is_nothing {
            return [0.0; 2];
        }
        let weights = |axis: usize| quadratic(2.0 * (px[axis] / self.size_px[axis]).clamp(-0.5, 1.5) - 1.0);
        let (across, down) = (weights(0), weights(1));
        let mut sum = [0.0; 2];
        for (row, wy) in self.values.chunks_exact(SIDE).zip(down) {
            for (value, wx) in row.iter().zip(across) {
                sum[0] += wx * wy * value[0];
                sum[1] += wx * wy * value[1];
            }
        }
        sum
    }
}

impl Correction {
    /// Adds the displacements at eight places to eight values, by component.
    #[inline(always)]
    pub(super) fn add_to_eight(&self, px: &[[f64; 8]; 2], to: &mut [[f64; 8]; 2]) {
        if self.is_nothing {
            return;
        }
        for k in 0..8 {
            let t = |axis: usize| 2.0 * (px[axis][k] / self.size_px[axis]).clamp(-0.5, 1.5) - 1.0;
            let (across, down) = (quadratic(t(0)), quadratic(t(1)));
            let mut sum = [0.0; 2];
            for row in 0..SIDE {
                for column in 0..SIDE {
                    let [x, y] = self.values[SIDE * row + column];
                    let weight = across[column] * down[row];
                    sum[0] += weight * x;
                    sum[1] += weight * y;
                }
            }
            to[0][k] += sum[0];
            to[1][k] += sum[1];
        }
    }
}

/// Returns the Lagrange weights at `t` for points at -1, 0, 1.
#[inline(always)]
pub fn quadratic(t: f64) -> [f64; 3] {
    [0.5 * t * (t - 1.0), 1.0 - t * t, 0.5 * t * (t + 1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadratic_fields_come_back_exactly() {
        let field = |x: f64, y: f64| [1e-3 * x * x - 2e-3 * x * y, 3e-4 * y * y + 0.1];
        let values = core::array::from_fn(|i| field(50.0 * (i % 3) as f64, 40.0 * (i / 3) as f64));
        let correction = Correction::through([100.0, 80.0], values);
        let ([x, y], wanted) = (correction.at([17.0, 66.0]), field(17.0, 66.0));
        assert!((x - wanted[0]).abs() < 1e-12 && (y - wanted[1]).abs() < 1e-12, "{x} {y} {wanted:?}");
        assert_eq!(Correction::none().at([3.0, 4.0]), [0.0; 2]);
    }
}
