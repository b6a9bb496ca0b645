//! One proton's track: where it enters and leaves -> electrons by pixel.
//!
//! Charge is the same along the path. The path is cut into steps of at most a quarter of a pixel; the charge of each
//! lies evenly over a square about its middle, shared exactly among the pixels it covers. What lies outside the image
//! is lost. Sum over pixels: the track's electrons to f32 rounding when it is inside (test below).

use crate::detector::outliers::Outlier;

/// Longest step along a path, px.
const STEP_PX: f64 = 0.25;

/// A track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProtonTrack {
    /// Place where it enters, px.
    pub start_px: [f64; 2],
    /// Place where it leaves the layer or the image, px.
    pub end_px: [f64; 2],
    /// Electrons between the two.
    pub electrons: f64,
}

impl ProtonTrack {
    /// Returns the part on the image, with its share of the electrons. The start must be on it.
    #[must_use]
    pub fn clipped(self, size_px: [f64; 2]) -> Self {
        let mut share = 1.0_f64;
        for axis in 0..2 {
            let (from, step) = (self.start_px[axis], self.end_px[axis] - self.start_px[axis]);
            let wall = if step > 0.0 { size_px[axis] - 0.5 } else { -0.5 };
            if step != 0.0 {
                share = share.min((wall - from) / step);
            }
        }
        let share = share.clamp(0.0, 1.0);
        let end = |axis: usize| self.start_px[axis] + share * (self.end_px[axis] - self.start_px[axis]);
        Self { start_px: self.start_px, end_px: [end(0), end(1)], electrons: self.electrons * share }
    }
}

/// Adds a track's charge to `out`, in no order; returns false and adds nothing when it does not fit.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a number of steps and pixels, not negative"
)]
pub fn spread(track: &ProtonTrack, width_px: f64, size_px: [usize; 2], out: &mut Vec<Outlier>) -> bool {
    let [dx, dy] = [0, 1].map(|axis| track.end_px[axis] - track.start_px[axis]);
    let steps = ((dx * dx + dy * dy).sqrt() / STEP_PX).ceil().max(1.0);
    let before = out.len();
    let each_e = track.electrons / steps;
    for step in 0..steps as usize {
        let along = (step as f64 + 0.5) / steps;
        let middle = [track.start_px[0] + along * dx, track.start_px[1] + along * dy];
        if !spread_square(middle, width_px, each_e, size_px, before, out) {
            out.truncate(before);
            return false;
        }
    }
    true
}

/// Shares electrons that lie evenly over a square among its pixels. Pixels from `first` of the list on are this
/// track's.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of an image below 2^32")]
fn spread_square(
    middle_px: [f64; 2],
    side_px: f64,
    electrons: f64,
    [width, height]: [usize; 2],
    first: usize,
    out: &mut Vec<Outlier>,
) -> bool {
    let low = middle_px.map(|m| m - 0.5 * side_px);
    let high = middle_px.map(|m| m + 0.5 * side_px);
    let pixels = |axis: usize, side: usize| {
        let begin = (low[axis] + 0.5).floor().max(0.0) as usize;
        let end = ((high[axis] + 0.5).ceil().max(0.0) as usize).min(side);
        begin..end
    };
    let share = |axis: usize, at: usize| {
        let (left, right) = (at as f64 - 0.5, at as f64 + 0.5);
        (high[axis].min(right) - low[axis].max(left)).max(0.0) / side_px
    };
    for y in pixels(1, height) {
        for x in pixels(0, width) {
            let charge_e = (electrons * share(0, x) * share(1, y)) as f32;
            let pixel = (y * width + x) as u32;
            // The last few entries are those of the step before: most steps stay in their pixels.
            let recent = out.len().saturating_sub(12).max(first);
            if let Some(known) = out[recent..].iter_mut().find(|known| known.pixel == pixel) {
                known.charge_e += charge_e;
            } else if out.len() < out.capacity() {
                out.push(Outlier { charge_e, ..Outlier::none(pixel) });
            } else {
                return false;
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [64, 48];

    fn charge(track: &ProtonTrack, width_px: f64) -> Vec<Outlier> {
        let mut out = Vec::with_capacity(4096);
        assert!(spread(track, width_px, SIZE, &mut out), "it fits");
        out
    }

    fn sum(list: &[Outlier]) -> f64 {
        list.iter().map(|o| f64::from(o.charge_e)).sum()
    }

    /// Returns the mean place of the charge.
    fn centroid(list: &[Outlier]) -> [f64; 2] {
        let weighted = |of: fn(u32) -> u32| {
            list.iter().map(|o| f64::from(of(o.pixel)) * f64::from(o.charge_e)).sum::<f64>() / sum(list)
        };
        [weighted(|pixel| pixel % 64), weighted(|pixel| pixel / 64)]
    }

    #[test]
    fn all_charge_arrives_about_the_middle_of_the_path() {
        for (end_px, width_px) in [([10.2, 9.7], 1.0), ([40.0, 30.5], 1.0), ([3.0, 9.7], 0.3), ([12.0, 20.0], 2.5)] {
            let track = ProtonTrack { start_px: [10.2, 9.7], end_px, electrons: 5000.0 };
            let list = charge(&track, width_px);
            assert!((sum(&list) / 5000.0 - 1.0).abs() < 1e-6, "{}", sum(&list));
            if (width_px - 1.0).abs() < 1e-9 || width_px > 2.0 {
                // A square of whole pixels is linear in its place: the centroid is exact up to the pixels' own size.
                let wanted = [0, 1].map(|axis| 0.5 * (track.start_px[axis] + end_px[axis]));
                let got = centroid(&list);
                let error = (got[0] - wanted[0]).hypot(got[1] - wanted[1]);
                assert!(error < 0.06, "{got:?} {wanted:?}");
            }
        }
    }

    #[test]
    fn a_track_straight_along_a_row() {
        let track = ProtonTrack { start_px: [4.5, 7.0], end_px: [14.5, 7.0], electrons: 1000.0 };
        let list = charge(&track, 1.0);
        let at = |x: u32, y: u32| list.iter().filter(|o| o.pixel == y * 64 + x).map(|o| o.charge_e).sum::<f32>();
        for x in 6..14 {
            assert!((at(x, 7) - 100.0).abs() < 1e-3, "{x}: {}", at(x, 7));
        }
        assert!((at(4, 7) + at(5, 7) - 100.0).abs() < 1e-3, "the end is spread by the width");
        assert_eq!(at(8, 6) + at(8, 8), 0.0, "rows beside it have none");
    }

    #[test]
    fn tracks_end_at_the_image() {
        let track = ProtonTrack { start_px: [60.5, 20.0], end_px: [66.5, 26.0], electrons: 600.0 };
        let inside = track.clipped([64.0, 48.0]);
        assert!((inside.electrons - 300.0).abs() < 1e-9, "{inside:?}");
        assert!((inside.end_px[0] - 63.5).abs() < 1e-9 && (inside.end_px[1] - 23.0).abs() < 1e-9, "{inside:?}");
        assert_eq!(ProtonTrack { end_px: [61.0, 20.0], ..track }.clipped([64.0, 48.0]).electrons, 600.0);
    }

    #[test]
    fn no_space_leaves_the_list_as_it_was() {
        let mut few = Vec::with_capacity(8);
        few.push(Outlier::none(1));
        let track = ProtonTrack { start_px: [4.5, 7.0], end_px: [50.0, 40.0], electrons: 1000.0 };
        assert!(!spread(&track, 1.0, SIZE, &mut few));
        assert_eq!(few.len(), 1);
    }
}
