//! Motion of the image during one exposure, and the times at which each row of the detector is exposed;
//! the instrument as the planner sees it.

use crate::exposure::pose::{PixelPath, PixelPoint, Pose};
use crate::optics::{Illumination, PsfModel};
use crate::{attitude::LosPath, exposure::sampling::PsfSampling};
use glam::{DQuat, DVec3};
use sky::astrometry::CameraGeometry;

/// How the rows of the detector are exposed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Shutter {
    /// All rows together.
    #[default]
    Global,
    /// Row after row from the top, `line_s` apart; the exposure named by a frame is that of the middle of the image.
    Rolling {
        /// Time from one row's exposure to the next, s.
        line_s: f64,
    },
}

/// Steps of a pose without lines of jitter.
const POSE_STEPS: usize = 4;
/// Lines of jitter that take a step together.
const LINES_PER_STEP: usize = 4;

/// Smooth rotation and jitter of the line of sight; a commanded image path, when given, replaces the jitter.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Line of sight about mid-exposure.
    pub los: LosPath,
    /// Commanded displacement of the image on the detector.
    pub image_path: Option<PixelPath>,
}

impl Shutter {
    /// Returns the time from one row's exposure to the next, s (0: all together).
    pub fn line_s(self) -> f64 {
        match self {
            Self::Global => 0.0,
            Self::Rolling { line_s } => line_s,
        }
    }

    /// Returns the delay of the row at `y_px` after the middle of an image of `height_px` rows, s.
    pub fn delay_s(self, y_px: f64, height_px: usize) -> f64 {
        self.line_s() * (y_px - 0.5 * (height_px as f64 - 1.0))
    }
}

impl Motion {
    /// Returns the smooth rotation vector `t_s` after mid-exposure, sensor axes, rad.
    pub fn smooth_rotation_rad(&self, t_s: f64) -> DVec3 {
        self.los.smooth_rotation_rad(t_s)
    }

    /// Returns true when only smooth rotation moves the image.
    pub fn is_smooth(&self) -> bool {
        self.image_path.is_none() && self.los.jitter.is_still()
    }

    /// Returns true when nothing moves.
    pub fn is_still(&self) -> bool {
        self.is_smooth() && self.los.rate_rad_s == DVec3::ZERO && self.los.acceleration_rad_s2 == DVec3::ZERO
    }

    /// Returns the pose at `tau` in [-1/2, 1/2] of an exposure that is `delay_s` later than the frame's own.
    pub fn pose_at(&self, tau: f64, delay_s: f64) -> Pose {
        let t_s = tau * self.los.exposure_s + delay_s;
        let smooth = DQuat::from_scaled_axis(-self.smooth_rotation_rad(t_s));
        match &self.image_path {
            None if self.los.jitter.is_still() => Pose::new(smooth, 0.0, [0.0; 2]),
            None => {
                let jitter = DQuat::from_scaled_axis(-self.los.jitter_rotation_rad(t_s));
                Pose::new(jitter * smooth, 0.0, [0.0; 2])
            }
            Some(path) => {
                // Listed positions are the same for all rows; a path in time is not.
                let listed = matches!(path, PixelPath::Samples(_));
                let at = if listed { tau } else { t_s / self.los.exposure_s };
                let point = point_at(path, at, self.los.exposure_s);
                self.pose_on_path(t_s, &point)
            }
        }
    }

    /// Returns the steps that the pose at an instant takes (see `cost`): the sines of jitter's lines are most of it.
    pub(super) fn pose_steps(&self) -> usize {
        POSE_STEPS + if self.image_path.is_some() { 0 } else { self.los.jitter.lines.len() / LINES_PER_STEP }
    }

    /// Returns the instants at which the path has corners, in order, as shares of an exposure that is `delay_s` later than
    /// the frame's own (-1/2 to 1/2 inside it): jitter's points, or the rows of a path in time.
    pub fn corners(&self, delay_s: f64) -> impl Iterator<Item = f64> {
        let (exposure_s, mid) = (self.los.exposure_s, self.los.mid_exposure());
        let (jitter, rows) = match &self.image_path {
            None => (&self.los.jitter.points[..], &[][..]),
            Some(PixelPath::Line(rows)) => (&[][..], &rows[..]),
            Some(PixelPath::Samples(_)) => (&[][..], &[][..]),
        };
        let of_jitter = jitter.iter().map(move |point| (point.at - mid).s());
        let of_rows = rows.iter().map(move |row| row.t_s - 0.5 * exposure_s);
        of_jitter.chain(of_rows).map(move |t_s| (t_s - delay_s) / exposure_s)
    }

    /// Returns the start and the length of each stretch between corners, as shares of the exposure; one where it has no
    /// corner inside.
    pub fn stretches(&self, delay_s: f64) -> impl Iterator<Item = (f64, f64)> {
        let between = |from: &mut f64, to: f64| {
            let begin = *from;
            *from = to.clamp(begin, 0.5);
            Some((begin, *from - begin))
        };
        self.corners(delay_s).chain([0.5]).scan(-0.5, between).filter(|(_, length)| *length > 0.0)
    }

    /// Returns the pose `t_s` after mid-exposure at a given point of the image path.
    pub fn pose_on_path(&self, t_s: f64, point: &PixelPoint) -> Pose {
        let smooth = DQuat::from_scaled_axis(-self.smooth_rotation_rad(t_s));
        Pose::new(smooth, point.roll_rad, [point.dx_px, point.dy_px])
    }
}

/// Returns the position of a path at `tau`, constant beyond its ends.
pub fn point_at(path: &PixelPath, tau: f64, exposure_s: f64) -> PixelPoint {
    let points = path.points();
    let still = PixelPoint { t_s: 0.0, dx_px: 0.0, dy_px: 0.0, roll_rad: 0.0 };
    match path {
        PixelPath::Samples(_) => {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the list")]
            let i = ((tau + 0.5) * points.len() as f64).clamp(0.0, points.len() as f64 - 1.0) as usize;
            points.get(i).copied().unwrap_or(still)
        }
        PixelPath::Line(_) => {
            let t_s = (tau + 0.5) * exposure_s;
            let after = first_after(points, t_s);
            match (after.checked_sub(1).and_then(|i| points.get(i)), points.get(after)) {
                (Some(a), Some(b)) => a.towards(b, (t_s - a.t_s) / (b.t_s - a.t_s)),
                (Some(only), None) | (None, Some(only)) => *only,
                (None, None) => still,
            }
        }
    }
}

/// Returns the index of the first row after `t_s`: tried where it is when rows are evenly spaced, then searched for.
fn first_after(points: &[PixelPoint], t_s: f64) -> usize {
    if let [first, .., last] = points {
        let steps = (t_s - first.t_s) / (last.t_s - first.t_s) * (points.len() - 1) as f64;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the list")]
        let guess = steps.clamp(0.0, points.len() as f64 - 2.0) as usize;
        let found = points[guess..].iter().take(3).position(|point| point.t_s > t_s);
        if let Some(found) = found.filter(|found| *found > 0) {
            return guess + found;
        }
    }
    points.partition_point(|point| point.t_s <= t_s)
}

/// The instrument as the planner sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct Instrument {
    /// Projection and distortion.
    pub camera: CameraGeometry,
    /// How its rows are exposed.
    pub shutter: Shutter,
    /// PSF.
    pub psf: PsfModel,
    /// Method to compute pixel values from the PSF.
    pub sampling: PsfSampling,
    /// Relative illumination of the image plane: sources are multiplied by its value at their mid-exposure position.
    pub illumination: Illumination,
    /// Electrons at which a pixel saturates: errors above it are invisible.
    pub full_well_e: f64,
    /// Noise floor of a pixel, e-.
    pub read_noise_e_rms: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_row_after_an_instant_is_the_one_that_a_search_finds() {
        let at = |t_s: f64| PixelPoint { t_s, dx_px: 0.0, dy_px: 0.0, roll_rad: 0.0 };
        let even: Vec<_> = (0..101).map(|i| at(f64::from(i) * 1e-3)).collect();
        let uneven: Vec<_> = (0..101).map(|i| at(1e-5 * f64::from(i * i))).collect();
        let twice = vec![at(0.0), at(0.0), at(0.05), at(0.05), at(0.05), at(0.1), at(0.1)];
        for points in [even, uneven, twice, vec![at(0.02)], vec![at(0.01), at(0.01)], vec![]] {
            for i in -20..=1200 {
                let t_s = f64::from(i) * 1e-4;
                let wanted = points.partition_point(|point| point.t_s <= t_s);
                assert_eq!(first_after(&points, t_s), wanted, "{} rows, {t_s} s", points.len());
            }
        }
    }
}
