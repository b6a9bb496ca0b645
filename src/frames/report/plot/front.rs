//! The points that nothing beats.

/// Returns the indices of the points that no other point beats in both coordinates, by ascending x. Of equal points the
/// first counts; points that are not finite are left out.
pub fn pareto_front(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).filter(|i| points[*i].iter().all(|v| v.is_finite())).collect();
    order.sort_by(|a, b| {
        let ([ax, ay], [bx, by]) = (points[*a], points[*b]);
        ax.total_cmp(&bx).then(ay.total_cmp(&by)).then(a.cmp(b))
    });
    let mut lowest = f64::INFINITY;
    order.retain(|i| {
        let is_lower = points[*i][1] < lowest;
        lowest = lowest.min(points[*i][1]);
        is_lower
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let points = [[3.0, 1.0], [1.0, 5.0], [2.0, 2.0], [2.5, 2.0], [2.0, 2.0], [4.0, 0.9], [0.5, f64::NAN]];
        assert_eq!(pareto_front(&points), [1, 2, 0, 5]);
        assert!(pareto_front(&[]).is_empty());
    }

    #[test]
    fn it_agrees_with_comparing_all_pairs() {
        // A fixed scramble along a falling diagonal.
        let point = |i: u32| [f64::from(i * 37 % 101), f64::from(100 + i * 59 % 103) - f64::from(i * 37 % 101)];
        let points: Vec<[f64; 2]> = (0..60).map(point).collect();
        let is_beaten = |p: &[f64; 2]| points.iter().any(|q| q != p && q[0] <= p[0] && q[1] <= p[1]);
        let mut wanted: Vec<usize> = (0..points.len()).filter(|i| !is_beaten(&points[*i])).collect();
        wanted.sort_by(|a, b| points[*a][0].total_cmp(&points[*b][0]));
        assert_eq!(pareto_front(&points), wanted);
        assert!(wanted.len() > 2 && wanted.len() < points.len(), "a front, and points behind it");
    }
}
