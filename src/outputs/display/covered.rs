//! The part of a display that a map was fitted to: the area within the outermost dots.
//!
//! The convex hull of the dots' places, display px (Andrew 1979, Inf. Process. Lett. 9, 216: lower and upper chain of
//! the sorted points). Within it the map is held by dots on all sides; beyond it, it is a guess. Limit: holes in the
//! middle do not show. Tests below.

/// Distance beyond the line of the outermost dots at which a place still counts as on it, display px.
const ON_THE_LINE_PX: f64 = 1e-6;

/// Corners of the covered area, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Covered {
    corners_px: Vec<[f64; 2]>,
}

/// Returns twice the area of the triangle, positive for a turn from +x to +y.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Returns one chain of the hull, without its last point.
fn chain(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut chain: Vec<[f64; 2]> = Vec::new();
    for point in points {
        while chain.len() >= 2 && turn(chain[chain.len() - 2], chain[chain.len() - 1], point) <= 0.0 {
            chain.pop();
        }
        chain.push(point);
    }
    chain.pop();
    chain
}

impl Covered {
    /// Returns the area within points; `None` when they are on one line, fewer than three, or not finite.
    pub fn within(points_px: &[[f64; 2]]) -> Option<Self> {
        let mut sorted = points_px.to_vec();
        sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let mut corners_px = chain(sorted.iter().copied());
        corners_px.extend(chain(sorted.iter().rev().copied()));
        let is_finite = points_px.iter().flatten().all(|v| v.is_finite());
        (is_finite && corners_px.len() >= 3).then_some(Self { corners_px })
    }

    /// Returns the corners.
    pub fn corners_px(&self) -> &[[f64; 2]] {
        &self.corners_px
    }

    /// Returns true if a place is within the outermost dots.
    pub fn contains(&self, px: [f64; 2]) -> bool {
        let next = self.corners_px.iter().cycle().skip(1);
        self.corners_px.iter().zip(next).all(|(a, b)| {
            let side = (b[0] - a[0]).hypot(b[1] - a[1]);
            turn(*a, *b, px) >= -ON_THE_LINE_PX * side
        })
    }

    /// Returns the smallest and largest column, smallest and largest row.
    pub fn range_px(&self) -> [f64; 4] {
        let start = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        self.corners_px.iter().fold(start, |[l, r, t, b], [x, y]| [l.min(*x), r.max(*x), t.min(*y), b.max(*y)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_has_four_corners_and_two_sides_of_each_edge() {
        let grid: Vec<[f64; 2]> =
            (0..5).flat_map(|i| (0..4).map(move |j| [10.0 + 20.0 * f64::from(i), 5.0 + 10.0 * f64::from(j)])).collect();
        let covered = Covered::within(&grid).unwrap();
        assert_eq!(covered.corners_px(), [[10.0, 5.0], [90.0, 5.0], [90.0, 35.0], [10.0, 35.0]]);
        assert_eq!(covered.range_px(), [10.0, 90.0, 5.0, 35.0]);
        assert!(grid.iter().all(|px| covered.contains(*px)), "the dots themselves");
        for (px, wanted) in [([9.9, 20.0], false), ([10.1, 20.0], true), ([50.0, 35.1], false), ([50.0, 34.9], true)] {
            assert_eq!(covered.contains(px), wanted, "{px:?}");
        }
        assert_eq!(Covered::within(covered.corners_px()), Some(covered.clone()), "corners are their own hull");
    }

    #[test]
    fn a_slanted_edge_is_not_its_bounding_box() {
        let covered = Covered::within(&[[0.0, 0.0], [100.0, 0.0], [0.0, 100.0], [20.0, 20.0]]).unwrap();
        assert!(covered.contains([49.0, 49.0]) && !covered.contains([51.0, 51.0]));
    }

    #[test]
    fn points_without_area_give_none() {
        let line: Vec<[f64; 2]> = (0..9).map(|i| [f64::from(i), 2.0 * f64::from(i)]).collect();
        assert_eq!(Covered::within(&line), None);
        assert_eq!(Covered::within(&[]), None);
        assert_eq!(Covered::within(&[[3.0, 3.0]; 7]), None);
        assert_eq!(Covered::within(&[[0.0, 0.0], [1.0, 0.0], [0.0, f64::NAN]]), None);
    }
}
