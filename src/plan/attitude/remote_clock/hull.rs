//! The lower convex hull of points that come in order of x, and the highest line below them all.
//!
//! Input: (remote time, local minus remote time). Output: the hull's edge over the middle of the points. Delays only
//! add, so all points lie above the line of offset and drift; of all lines below the points the edge over their mean is
//! nearest to them on the whole (Moon, Skelly and Towsley, "Estimation and removal of clock skew from network delay
//! measurements", INFOCOM 1999; kept as a hull by Zhang, Liu and Xia, INFOCOM 2002). Chain by Andrew (1979): a point
//! costs O(1) on the whole.
//!
//! *Error of the edge.* With `n` points of exponential delay of mean `s` over a time `T`, the points near the line are
//! a Poisson process and the edge's errors scale: its height over the middle is `1.83 s/n` too large on average and
//! scatters by `1.37 s/n`, its slope by `6.9 s/(n T)`. The three numbers are from 6000 draws of 300 points;
//! `the_edge_errs_as_stated` draws them again.

/// Mean height of the edge over the true line, in `s/n`.
pub(super) const HEIGHT_MEAN: f64 = 1.83;
/// Standard deviation of that height, in `s/n`.
pub(super) const HEIGHT_SIGMA: f64 = 1.37;
/// Standard deviation of the slope, in `s/(n T)`.
pub(super) const SLOPE_SIGMA: f64 = 6.9;
/// Largest number of vertices. Random delays need about 2 ln n; a clock whose drift only grows puts every point on the
/// hull.
const VERTICES_MAX: usize = 256;

/// A point: x in s, y in ns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Vertex {
    pub x_s: f64,
    pub y_ns: f64,
}

/// The line through an edge, as its height over `x_s` and its slope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Edge {
    pub x_s: f64,
    pub height_ns: f64,
    pub slope_ns_per_s: f64,
}

/// The present hull.
#[derive(Debug, Clone)]
pub(super) struct LowerHull {
    vertices: Vec<Vertex>,
    count: usize,
    first_x_s: f64,
    last_x_s: f64,
}

impl LowerHull {
    /// Returns an empty hull; all memory is allocated here.
    pub(super) fn new() -> Self {
        Self { vertices: Vec::with_capacity(VERTICES_MAX), count: 0, first_x_s: 0.0, last_x_s: 0.0 }
    }

    pub(super) fn clear(&mut self) {
        self.vertices.clear();
        self.count = 0;
    }

    /// Returns the number of points.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Returns the length from the first point to the last, s.
    pub(super) fn length_s(&self) -> f64 {
        if self.count == 0 { 0.0 } else { self.last_x_s - self.first_x_s }
    }

    /// Adds a point at or to the right of the last one.
    pub(super) fn push(&mut self, x_s: f64, y_ns: f64) {
        if self.count == 0 {
            self.first_x_s = x_s;
        }
        self.count += 1;
        self.last_x_s = x_s;
        let point = Vertex { x_s, y_ns };
        if let Some(last) = self.vertices.last()
            && last.x_s >= x_s
        {
            if last.y_ns <= y_ns {
                return;
            }
            self.vertices.pop();
        }
        while let [.., a, b] = self.vertices[..]
            && is_above_chord(a, b, point)
        {
            self.vertices.pop();
        }
        if self.vertices.len() >= VERTICES_MAX {
            self.thin();
        }
        self.vertices.push(point);
    }

    /// Removes the inner vertex whose chord rises least above it: at most a few ns for any clock.
    fn thin(&mut self) {
        let sagitta = |i: usize| {
            let [a, b, c] = [self.vertices[i - 1], self.vertices[i], self.vertices[i + 1]];
            a.y_ns + (c.y_ns - a.y_ns) * (b.x_s - a.x_s) / (c.x_s - a.x_s) - b.y_ns
        };
        if let Some(least) = (1..self.vertices.len() - 1).min_by(|&i, &j| sagitta(i).total_cmp(&sagitta(j))) {
            self.vertices.remove(least);
        }
    }

    /// Returns the edge over the middle of the points; a level line through the only vertex; `None` without points.
    pub(super) fn middle_edge(&self) -> Option<Edge> {
        let x_s = 0.5 * (self.first_x_s + self.last_x_s);
        let after = self.vertices.partition_point(|vertex| vertex.x_s <= x_s);
        let pair = (after.checked_sub(1).and_then(|i| self.vertices.get(i)), self.vertices.get(after));
        match pair {
            (Some(a), Some(b)) => {
                let slope_ns_per_s = (b.y_ns - a.y_ns) / (b.x_s - a.x_s);
                Some(Edge { x_s, height_ns: a.y_ns + slope_ns_per_s * (x_s - a.x_s), slope_ns_per_s })
            }
            (Some(only), None) | (None, Some(only)) => {
                Some(Edge { x_s: only.x_s, height_ns: only.y_ns, slope_ns_per_s: 0.0 })
            }
            (None, None) => None,
        }
    }
}

fn is_above_chord(a: Vertex, b: Vertex, c: Vertex) -> bool {
    (b.x_s - a.x_s) * (c.y_ns - a.y_ns) <= (b.y_ns - a.y_ns) * (c.x_s - a.x_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::random::{key, philox};
    use proptest::prelude::*;

    fn hull_of(points: &[(f64, f64)]) -> LowerHull {
        let mut hull = LowerHull::new();
        points.iter().for_each(|&(x_s, y_ns)| hull.push(x_s, y_ns));
        hull
    }

    #[test]
    fn the_edge_over_the_middle_is_below_all_points() {
        let hull = hull_of(&[(0.0, 10.0), (1.0, 5.0), (2.0, 90.0), (3.0, 7.0), (4.0, 30.0)]);
        assert_eq!(hull.middle_edge(), Some(Edge { x_s: 2.0, height_ns: 6.0, slope_ns_per_s: 1.0 }));
        assert_eq!((hull.count(), hull.length_s()), (5, 4.0));
    }

    #[test]
    fn one_point_and_points_at_one_place_give_a_level_line() {
        assert_eq!(LowerHull::new().middle_edge(), None);
        let level = Some(Edge { x_s: 2.0, height_ns: 3.0, slope_ns_per_s: 0.0 });
        assert_eq!(hull_of(&[(2.0, 3.0)]).middle_edge(), level);
        assert_eq!(hull_of(&[(2.0, 8.0), (2.0, 3.0), (2.0, 4.0)]).middle_edge(), level, "the lowest of them");
    }

    #[test]
    fn memory_is_bounded_when_every_point_is_a_vertex() {
        let mut hull = LowerHull::new();
        let space = hull.vertices.capacity();
        for i in 0..10_000 {
            let x_s = f64::from(i) * 0.01;
            hull.push(x_s, x_s * x_s);
        }
        assert_eq!(hull.vertices.capacity(), space);
        let edge = hull.middle_edge().expect("points");
        assert!((edge.height_ns - 2500.0).abs() < 10.0, "{edge:?}: x^2 at 50");
    }

    /// Tests the three numbers within their sampling scatter: 3 % of a deviation, 5 % of the slope's (its tails are
    /// long).
    #[test]
    fn the_edge_errs_as_stated() {
        const DRAWS: u32 = 3000;
        const POINTS: u32 = 300;
        let uniform = |word: u32| (f64::from(word) + 0.5) / 4_294_967_296.0;
        let (mut sum, mut squares, mut slopes) = (0.0, 0.0, 0.0);
        for draw in 0..DRAWS {
            let mut hull = LowerHull::new();
            for i in 0..POINTS {
                let word = philox([i, draw, 0, 0], key(7))[0];
                // Delays of mean n, so that s/n = 1 and T = 1.
                hull.push(f64::from(i) / f64::from(POINTS - 1), -uniform(word).ln() * f64::from(POINTS));
            }
            let edge = hull.middle_edge().expect("points");
            sum += edge.height_ns;
            squares += edge.height_ns * edge.height_ns;
            slopes += edge.slope_ns_per_s * edge.slope_ns_per_s;
        }
        let draws = f64::from(DRAWS);
        let mean = sum / draws;
        let (height_sigma, slope_sigma) = ((squares / draws - mean * mean).sqrt(), (slopes / draws).sqrt());
        assert!((mean / HEIGHT_MEAN - 1.0).abs() < 0.06, "{mean}");
        assert!((height_sigma / HEIGHT_SIGMA - 1.0).abs() < 0.06, "{height_sigma}");
        assert!((slope_sigma / SLOPE_SIGMA - 1.0).abs() < 0.12, "{slope_sigma}");
    }

    proptest! {
        #[test]
        fn no_point_lies_below_the_edge(ys in proptest::collection::vec(0.0..1e6, 2..200)) {
            let points: Vec<(f64, f64)> = ys.iter().enumerate().map(|(i, &y)| (i as f64, y)).collect();
            let edge = hull_of(&points).middle_edge().expect("points");
            for (x, y) in points {
                let line = edge.height_ns + edge.slope_ns_per_s * (x - edge.x_s);
                prop_assert!(y >= line - 1e-6, "{y} at {x} below {line}");
            }
        }
    }
}
