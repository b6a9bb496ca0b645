//! Linear least squares by an orthogonal basis: columns and values -> coefficients, and each row's leverage.
//!
//! Gram and Schmidt, each column made orthogonal twice ("twice is enough": Kahan, in Parlett, The Symmetric Eigenvalue
//! Problem, 1980), after scaling every column to length one. Limits: columns within 1e-10 of each other's span are
//! refused. Tests below: coefficients against known ones, leverage against leaving rows out.

/// Largest remainder of a column of length one that counts as a combination of the others.
const DEPENDENT: f64 = 1e-10;

/// An orthogonal basis of a matrix's columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Basis {
    /// Orthonormal columns.
    q: Vec<Vec<f64>>,
    /// Upper triangle: column j of the scaled matrix is the sum of `r[j][k] q[k]`.
    r: Vec<Vec<f64>>,
    lengths: Vec<f64>,
}

impl Basis {
    /// Returns the basis of columns of equal length; `None` when one depends on the others, or there are more columns
    /// than rows.
    pub fn of(columns: Vec<Vec<f64>>) -> Option<Self> {
        let mut basis = Self { q: Vec::new(), r: Vec::new(), lengths: Vec::new() };
        for mut column in columns {
            let length = dot(&column, &column).sqrt();
            if !(length.is_finite() && length > 0.0) || basis.q.len() >= column.len() {
                return None;
            }
            column.iter_mut().for_each(|v| *v /= length);
            let row = basis.orthogonal(&mut column)?;
            basis.q.push(column);
            basis.r.push(row);
            basis.lengths.push(length);
        }
        Some(basis)
    }

    /// Takes out of `column` what the basis holds, scales the rest to length one; gives the column of the triangle.
    fn orthogonal(&self, column: &mut [f64]) -> Option<Vec<f64>> {
        let mut shares = vec![0.0; self.q.len()];
        for _ in 0..2 {
            for (share, q) in shares.iter_mut().zip(&self.q) {
                let along = dot(q, column);
                column.iter_mut().zip(q).for_each(|(v, q)| *v -= along * q);
                *share += along;
            }
        }
        let rest = dot(column, column).sqrt();
        column.iter_mut().for_each(|v| *v /= rest);
        shares.push(rest);
        (rest > DEPENDENT).then_some(shares)
    }

    /// Returns coefficients of the columns whose sum is nearest to `values`.
    pub fn solve(&self, values: &[f64]) -> Vec<f64> {
        let count = self.q.len();
        let mut rest = values.to_vec();
        let mut coefficients: Vec<f64> = Vec::with_capacity(count);
        for q in &self.q {
            let along = dot(q, &rest);
            rest.iter_mut().zip(q).for_each(|(v, q)| *v -= along * q);
            coefficients.push(along);
        }
        for j in (0..count).rev() {
            coefficients[j] /= self.r[j][j];
            let found = coefficients[j];
            (0..j).for_each(|k| coefficients[k] -= self.r[j][k] * found);
        }
        coefficients.iter().zip(&self.lengths).map(|(c, length)| c / length).collect()
    }

    /// Returns how far a row decides its own fitted value, 0 to 1: a residual over one less this is what it would be
    /// without the row.
    pub fn leverage(&self, row: usize) -> f64 {
        self.q.iter().map(|q| q[row] * q[row]).sum()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns the middle value; of an even number the upper of the two middle ones. Not a number of nothing.
#[must_use]
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Returns the root of the mean square; 0 of nothing.
pub fn rms(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count().max(1) as f64;
    (values.map(|v| v * v).sum::<f64>() / count).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Powers of badly scaled places.
    fn columns(places: &[f64]) -> Vec<Vec<f64>> {
        (0..4).map(|power| places.iter().map(|x| x.powi(power)).collect()).collect()
    }

    fn places() -> Vec<f64> {
        (0..40).map(|i| 1e-3 * (f64::from(i) - 13.0)).collect()
    }

    #[test]
    fn known_coefficients_are_found() {
        let wanted = [3.0, -20.0, 1e4, 5e6];
        let values: Vec<f64> =
            places().iter().map(|x| wanted.iter().enumerate().map(|(n, c)| c * x.powi(n as i32)).sum()).collect();
        let found = Basis::of(columns(&places())).unwrap().solve(&values);
        for (found, wanted) in found.iter().zip(wanted) {
            assert!((found / wanted - 1.0).abs() < 1e-9, "{found} for {wanted}");
        }
        let mut changed = values.clone();
        changed[5] += 1.0;
        let spoiled = Basis::of(columns(&places())).unwrap().solve(&changed);
        assert!((spoiled[0] / wanted[0] - 1.0).abs() > 1e-3, "the comparison can fail");
    }

    #[test]
    fn leverage_is_what_leaving_out_shows() {
        let values: Vec<f64> = places().iter().map(|x| (900.0 * x).sin()).collect();
        let at = |coefficients: &[f64], x: f64| -> f64 {
            coefficients.iter().enumerate().map(|(n, c)| c * x.powi(n as i32)).sum()
        };
        let basis = Basis::of(columns(&places())).unwrap();
        let whole = basis.solve(&values);
        for left_out in [0, 7, 39] {
            let (mut some_places, mut some_values) = (places(), values.clone());
            let x = some_places.remove(left_out);
            let value = some_values.remove(left_out);
            let without = Basis::of(columns(&some_places)).unwrap().solve(&some_values);
            let predicted = (value - at(&whole, x)) / (1.0 - basis.leverage(left_out));
            assert!((predicted - (value - at(&without, x))).abs() < 1e-9, "row {left_out}");
        }
    }

    #[test]
    fn dependent_columns_are_refused() {
        let x: Vec<f64> = places();
        let twice = x.iter().map(|x| 2.0 * x).collect();
        assert_eq!(Basis::of(vec![x.clone(), twice]), None);
        assert_eq!(Basis::of(vec![vec![0.0; 5]]), None, "an empty column");
        assert_eq!(Basis::of(vec![vec![1.0], vec![2.0]]), None, "two columns, one row");
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert!(median(&mut []).is_nan());
    }
}
