//! A straight line through points with weights: `y = offset + slope x`. Source: normal equations of weighted least
//! squares, about the weighted mean of x, which keeps the digits.

/// A straight line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Value at x = 0.
    pub offset: f64,
    /// Rise per unit of x.
    pub slope: f64,
}

impl Line {
    /// Returns the line nearest to `[x, y, weight]`; its slope is 0 when all x are equal.
    pub fn through(points: impl Iterator<Item = [f64; 3]> + Clone) -> Self {
        let sums = points
            .clone()
            .fold([0.0; 3], |[w, wx, wy], [x, y, weight]| [w + weight, weight.mul_add(x, wx), weight.mul_add(y, wy)]);
        let (mean_x, mean_y) = (sums[1] / sums[0], sums[2] / sums[0]);
        let [xx, xy] = points.fold([0.0; 2], |[xx, xy], [x, y, weight]| {
            let dx = x - mean_x;
            [xx + weight * dx * dx, xy + weight * dx * (y - mean_y)]
        });
        let slope = if xx > 0.0 { xy / xx } else { 0.0 };
        Self { offset: mean_y - slope * mean_x, slope }
    }

    /// Returns the value at `x`.
    pub fn at(&self, x: f64) -> f64 {
        self.slope.mul_add(x, self.offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_and_weights_count() {
        let points = [[1.0, 5.0, 1.0], [2.0, 7.0, 3.0], [4.0, 11.0, 0.5]];
        let line = Line::through(points.into_iter());
        assert!((line.slope - 2.0).abs() < 1e-12 && (line.offset - 3.0).abs() < 1e-12, "{line:?}");
        let outlier = |weight| Line::through(points.into_iter().chain([[5.0, 100.0, weight]])).slope;
        assert!((outlier(0.0) - 2.0).abs() < 1e-12 && outlier(1.0) > 5.0, "a weight of nothing counts nothing");
        let level = Line::through([[1.0, 2.0, 1.0], [1.0, 4.0, 1.0]].into_iter());
        assert_eq!((level.slope, level.at(9.0)), (0.0, 3.0));
    }
}
