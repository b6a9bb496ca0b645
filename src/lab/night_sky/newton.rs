//! Least squares of a nonlinear model: Levenberg and Marquardt's method with differences as derivatives.
//!
//! Limits: some ten parameters; a column that changes nothing is refused. Test below.

/// A solution.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fitted {
    /// The parameters.
    pub values: Vec<f64>,
    /// Their standard errors, for residuals in units of their own standard deviation.
    pub errors: Vec<f64>,
    /// Sum of squared residuals.
    pub chi2: f64,
}

/// Most damping before a fit is given up.
const MOST_DAMPING: f64 = 1e12;
/// Steps of the search.
const MOST_STEPS: usize = 40;
/// Relative gain below which a fit has come to its end.
const LEAST_GAIN: f64 = 1e-10;

/// Returns the parameters of least squares near `start`; `steps` are those of the differences.
pub(crate) fn fit(start: &[f64], steps: &[f64], residuals: impl Fn(&[f64]) -> Vec<f64>) -> Option<Fitted> {
    let (mut values, mut damping) = (start.to_vec(), 1e-3);
    let mut now = residuals(&values);
    let mut chi2 = dot(&now, &now);
    for _ in 0..MOST_STEPS {
        let (normal, gradient) = equations(&values, steps, &now, &residuals);
        let mut gained = 0.0;
        while damping < MOST_DAMPING {
            let mut damped = normal.clone();
            (0..values.len()).for_each(|i| damped[i][i] *= 1.0 + damping);
            let step = solve(&damped, &gradient)?;
            let tried: Vec<f64> = values.iter().zip(&step).map(|(value, step)| value - step).collect();
            let then = residuals(&tried);
            let then_chi2 = dot(&then, &then);
            if then_chi2 < chi2 {
                gained = chi2 - then_chi2;
                (values, now, chi2) = (tried, then, then_chi2);
                damping *= 0.1;
                break;
            }
            damping *= 10.0;
        }
        if gained <= LEAST_GAIN * chi2 {
            break;
        }
    }
    let (normal, _) = equations(&values, steps, &now, &residuals);
    let errors = errors_of(&normal)?;
    chi2.is_finite().then_some(Fitted { values, errors, chi2 })
}

/// Returns the normal matrix and the gradient.
fn equations(
    values: &[f64],
    steps: &[f64],
    now: &[f64],
    residuals: &impl Fn(&[f64]) -> Vec<f64>,
) -> (Vec<Vec<f64>>, Vec<f64>) {
    let column = |i: usize| {
        let at = |side: f64| {
            let mut moved = values.to_vec();
            moved[i] += side * steps[i];
            residuals(&moved)
        };
        let (after, before) = (at(1.0), at(-1.0));
        after.iter().zip(&before).map(|(a, b)| (a - b) / (2.0 * steps[i])).collect::<Vec<f64>>()
    };
    let columns: Vec<Vec<f64>> = (0..values.len()).map(column).collect();
    let normal = columns.iter().map(|a| columns.iter().map(|b| dot(a, b)).collect()).collect();
    (normal, columns.iter().map(|column| dot(column, now)).collect())
}

/// Returns the standard errors of the parameters: roots of the diagonal of the normal matrix's inverse.
fn errors_of(normal: &[Vec<f64>]) -> Option<Vec<f64>> {
    let error = |i: usize| {
        let unit: Vec<f64> = (0..normal.len()).map(|k| if k == i { 1.0 } else { 0.0 }).collect();
        solve(normal, &unit).map(|column| column[i].max(0.0).sqrt())
    };
    (0..normal.len()).map(error).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns the solution of a symmetric positive definite system (Cholesky), scaled by its diagonal.
fn solve(matrix: &[Vec<f64>], right: &[f64]) -> Option<Vec<f64>> {
    let count = right.len();
    let scale: Vec<f64> = (0..count).map(|i| matrix[i][i].sqrt()).collect();
    if scale.iter().any(|value| !(value.is_finite() && *value > 0.0)) {
        return None;
    }
    let mut lower = vec![vec![0.0; count]; count];
    for i in 0..count {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let value = matrix[i][j] / (scale[i] * scale[j]) - sum;
            if i == j {
                if value <= 1e-14 {
                    return None;
                }
                lower[i][i] = value.sqrt();
            } else {
                lower[i][j] = value / lower[j][j];
            }
        }
    }
    let mut solution = vec![0.0; count];
    for i in 0..count {
        let sum: f64 = (0..i).map(|k| lower[i][k] * solution[k]).sum();
        solution[i] = (right[i] / scale[i] - sum) / lower[i][i];
    }
    for i in (0..count).rev() {
        let sum: f64 = (i + 1..count).map(|k| lower[k][i] * solution[k]).sum();
        solution[i] = (solution[i] - sum) / lower[i][i];
    }
    Some(solution.iter().zip(&scale).map(|(value, scale)| value / scale).collect())
}

/// Returns coefficients of `columns` (rows of equal length) nearest to `values` by weighted least squares, with errors.
pub(crate) fn linear(rows: &[Vec<f64>], values: &[f64], weights: &[f64]) -> Option<Fitted> {
    let count = rows.first()?.len();
    let sum = |i: usize, k: usize| rows.iter().zip(weights).map(|(row, w)| w * row[i] * row[k]).sum::<f64>();
    let normal: Vec<Vec<f64>> = (0..count).map(|i| (0..count).map(|k| sum(i, k)).collect()).collect();
    let right: Vec<f64> =
        (0..count).map(|i| rows.iter().zip(values).zip(weights).map(|((row, v), w)| w * row[i] * v).sum()).collect();
    let solution = solve(&normal, &right)?;
    let errors = errors_of(&normal)?;
    let left = rows.iter().zip(values).zip(weights).map(|((row, v), w)| w * (v - dot(row, &solution)).powi(2));
    Some(Fitted { chi2: left.sum(), errors, values: solution })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_curve_comes_back_with_its_errors() {
        let truth = [2.0, 0.5, -1.0];
        let x = |i: usize| i as f64 * 0.05;
        let curve = |p: &[f64], x: f64| p[0] * (-p[1] * x).exp() + p[2];
        let sigma = 0.01;
        let noise = |i: usize| if i.is_multiple_of(2) { sigma } else { -sigma };
        let data: Vec<f64> = (0..200).map(|i| curve(&truth, x(i)) + noise(i)).collect();
        let residuals = |p: &[f64]| (0..200).map(|i| (curve(p, x(i)) - data[i]) / sigma).collect();
        let fitted = fit(&[1.0, 1.0, 0.0], &[1e-5; 3], residuals).unwrap();
        for (i, wanted) in truth.iter().enumerate() {
            assert!((fitted.values[i] - wanted).abs() < 3.0 * fitted.errors[i], "{fitted:?}");
        }
        assert!((fitted.chi2 / 200.0 - 1.0).abs() < 0.1);
        assert_eq!(fit(&[1.0, 0.0], &[1e-5; 2], |p| vec![p[0], 2.0 * p[0]]), None, "a parameter without effect");
    }

    #[test]
    fn a_plane_is_found_by_linear_least_squares() {
        let rows: Vec<Vec<f64>> = (0..30).map(|i| vec![1.0, f64::from(i), f64::from(i * i % 7)]).collect();
        let values: Vec<f64> = rows.iter().map(|row| 3.0 - 0.5 * row[1] + 2.0 * row[2]).collect();
        let fitted = linear(&rows, &values, &[1.0; 30]).unwrap();
        for (got, wanted) in fitted.values.iter().zip([3.0, -0.5, 2.0]) {
            assert!((got - wanted).abs() < 1e-9, "{fitted:?}");
        }
    }
}
