//! Estimates with confidence intervals: means (Student's t), standard deviations (chi-square), shares (Clopper and
//! Pearson), slopes (Student's t), and the confidence of a probability from trials (incomplete beta function).

use statrs::distribution::{Beta, ChiSquared, ContinuousCDF, FisherSnedecor, Normal, StudentsT};
use statrs::function::beta::beta_reg;

/// An estimate and the two-sided interval that holds the true value with the confidence asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Degrees of freedom, or trials.
    pub count: f64,
}

impl Estimate {
    /// Returns the estimate times a positive number: a change of unit.
    #[must_use]
    pub fn scaled(self, by: f64) -> Self {
        let [a, b] = [self.low * by, self.high * by];
        Self { value: self.value * by, low: a.min(b), high: a.max(b), count: self.count }
    }
}

/// Returns the mean of independent values; `None` with fewer than two.
pub fn mean(values: &[f64], confidence: f64) -> Option<Estimate> {
    let (value, variance) = moments(values)?;
    let dof = values.len() as f64 - 1.0;
    let half = t_quantile(confidence, dof)? * (variance / values.len() as f64).sqrt();
    Some(Estimate { value, low: value - half, high: value + half, count: dof })
}

/// Returns mean and variance (divided by n - 1); `None` with fewer than two values.
pub fn moments(values: &[f64]) -> Option<(f64, f64)> {
    if values.len() < 2 {
        return None;
    }
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    Some((mean, squares / (n - 1.0)))
}

/// Returns the standard deviation of a variance known with `dof` degrees of freedom.
pub fn sigma(variance: f64, dof: f64, confidence: f64) -> Option<Estimate> {
    if !(dof > 0.0 && variance >= 0.0) {
        return None;
    }
    let tail = 0.5 * (1.0 - confidence);
    let [few, many] = [chi_square_quantile(tail, dof)?, chi_square_quantile(1.0 - tail, dof)?];
    let [low, high] = [many, few].map(|quantile| (dof * variance / quantile).sqrt());
    Some(Estimate { value: variance.sqrt(), low, high, count: dof })
}

/// Returns a share of successes with its exact interval (Clopper and Pearson, 1934); `None` without trials.
pub fn share(successes: u64, trials: u64, confidence: f64) -> Option<Estimate> {
    if trials == 0 || successes > trials {
        return None;
    }
    let (k, n, tail) = (successes as f64, trials as f64, 0.5 * (1.0 - confidence));
    let low = if successes == 0 { 0.0 } else { Beta::new(k, n - k + 1.0).ok()?.inverse_cdf(tail) };
    let high = if successes == trials { 1.0 } else { Beta::new(k + 1.0, n - k).ok()?.inverse_cdf(1.0 - tail) };
    Some(Estimate { value: k / n, low, high, count: n })
}

/// Returns the confidence that the probability of success is at least `probability`, by ECSS-E-ST-60-20C annex E:
/// `L = I_(1-P)(n_fail + 1, n_sim - n_fail + 1)`.
pub fn confidence_of(probability: f64, failures: u64, trials: u64) -> f64 {
    if trials < failures || !(0.0..1.0).contains(&probability) {
        return 0.0;
    }
    beta_reg(failures as f64 + 1.0, (trials - failures) as f64 + 1.0, 1.0 - probability)
}

/// Returns the fewest trials without a failure that show `probability` with `confidence`.
#[cfg(test)]
pub(crate) fn fewest_trials(probability: f64, confidence: f64) -> u64 {
    (0..10_000_000).find(|trials| confidence_of(probability, 0, *trials) >= confidence).unwrap_or(u64::MAX)
}

/// A straight line through points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Change of y with x.
    pub slope: Estimate,
    /// y where x is 0.
    pub at_zero: f64,
}

/// Fits a line by least squares; `None` with fewer than three points or no spread of x.
pub fn line(points: &[[f64; 2]], confidence: f64) -> Option<Line> {
    let n = points.len() as f64;
    if points.len() < 3 {
        return None;
    }
    let [mean_x, mean_y] = [0, 1].map(|axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / n);
    let spread = points.iter().map(|point| (point[0] - mean_x).powi(2)).sum::<f64>();
    if spread <= 0.0 {
        return None;
    }
    let slope = points.iter().map(|point| (point[0] - mean_x) * (point[1] - mean_y)).sum::<f64>() / spread;
    let at_zero = mean_y - slope * mean_x;
    let squares = points.iter().map(|point| (point[1] - at_zero - slope * point[0]).powi(2)).sum::<f64>();
    let half = t_quantile(confidence, n - 2.0)? * (squares / (n - 2.0) / spread).sqrt();
    Some(Line { slope: Estimate { value: slope, low: slope - half, high: slope + half, count: n - 2.0 }, at_zero })
}

/// Returns a quantile of values with the interval of order statistics; `None` without values.
pub fn quantile(values: &[f64], probability: f64, confidence: f64) -> Option<Estimate> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    let last = n.checked_sub(1)?;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and the number of values")]
    let place = |p: f64| ((p * n as f64).ceil() as usize).clamp(1, n) - 1;
    // Number of values below the quantile: binomial; its own quantiles are places in the order.
    let tail = 0.5 * (1.0 - confidence);
    let below = |rank: usize| binomial_below(rank as u64, n as u64, probability);
    let low = (0..n).rev().find(|rank| below(rank + 1) <= tail).unwrap_or(0);
    let high = (0..n).find(|rank| below(rank + 1) >= 1.0 - tail);
    Some(Estimate {
        value: sorted[place(probability).min(last)],
        low: sorted[low],
        high: high.map_or(f64::INFINITY, |rank| sorted[rank.min(last)]),
        count: n as f64,
    })
}

/// Probability that fewer than `rank` of `n` trials succeed.
fn binomial_below(rank: u64, n: u64, probability: f64) -> f64 {
    if rank == 0 {
        return 0.0;
    }
    if rank > n {
        return 1.0;
    }
    1.0 - beta_reg(rank as f64, (n - rank) as f64 + 1.0, probability)
}

/// Returns the two-sided factor of Student's distribution; `None` without degrees of freedom.
pub fn t_quantile(confidence: f64, dof: f64) -> Option<f64> {
    let distribution = StudentsT::new(0.0, 1.0, dof).ok()?;
    Some(distribution.inverse_cdf(0.5 * (1.0 + confidence)))
}

/// Returns a quantile of chi-square.
pub fn chi_square_quantile(probability: f64, dof: f64) -> Option<f64> {
    Some(ChiSquared::new(dof).ok()?.inverse_cdf(probability))
}

/// Returns a quantile of the ratio of two variances with these degrees of freedom (Fisher and Snedecor).
pub fn f_quantile(probability: f64, dof: f64, dof_below: f64) -> Option<f64> {
    Some(FisherSnedecor::new(dof, dof_below).ok()?.inverse_cdf(probability))
}

/// Returns a quantile of the standard normal distribution.
pub fn normal_quantile(probability: f64) -> f64 {
    Normal::standard().inverse_cdf(probability)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(got: f64, wanted: f64, within: f64) {
        assert!((got - wanted).abs() <= within, "got {got}, wanted {wanted}");
    }

    #[test]
    fn no_failure_in_997_trials_shows_997_permille_with_95_percent() {
        // Without failures L = 1 - P^(n + 1), written out.
        for n in [10_u64, 500, 996, 997, 2000] {
            close(confidence_of(0.997, 0, n), 1.0 - 0.997_f64.powf(n as f64 + 1.0), 1e-12);
        }
        assert_eq!(fewest_trials(0.997, 0.95), 997);
        assert!(confidence_of(0.997, 1, 997) < 0.95, "one failure is too many");
        assert!(confidence_of(0.997, 0, 996) < 0.95, "one trial less is too few");
    }

    #[test]
    fn failures_count_as_the_binomial_sum_says() {
        // I_(1-P)(k+1, n-k+1) is the chance of more than k failures in n + 1 trials: summed term by term.
        let (p, n, k) = (0.9_f64, 40_u64, 3_u64);
        let mut chance = 0.0;
        let mut term = p.powi(41);
        for i in 0..=k {
            chance += term;
            term *= (n + 1 - i) as f64 / (i + 1) as f64 * (1.0 - p) / p;
        }
        close(confidence_of(p, k, n), 1.0 - chance, 1e-12);
    }

    #[test]
    fn tables_of_student_and_chi_square_are_met() {
        close(t_quantile(0.95, 10.0).unwrap(), 2.228_139, 1e-5);
        close(t_quantile(0.99, 4.0).unwrap(), 4.604_095, 1e-5);
        let sigma = sigma(4.0, 10.0, 0.95).unwrap();
        // Chi-square of 10 degrees of freedom: 3.246973 and 20.483177.
        close(sigma.low, (40.0_f64 / 20.483_177).sqrt(), 1e-5);
        close(sigma.high, (40.0_f64 / 3.246_973).sqrt(), 1e-5);
    }

    #[test]
    fn shares_have_the_exact_interval() {
        let none = share(0, 20, 0.95).unwrap();
        close(none.high, 1.0 - 0.025_f64.powf(1.0 / 20.0), 1e-9);
        let all = share(20, 20, 0.95).unwrap();
        close(all.low, 0.025_f64.powf(1.0 / 20.0), 1e-9);
        assert_eq!((none.low, all.high), (0.0, 1.0));
        let half = share(8, 10, 0.95).unwrap();
        close(half.low, 0.443_904, 1e-5);
        close(half.high, 0.974_789, 1e-5);
        assert!(share(1, 0, 0.95).is_none());
    }

    #[test]
    fn a_line_without_scatter_is_found_and_one_point_less_is_none() {
        let points: Vec<[f64; 2]> = (0..5).map(|i| [f64::from(i), 2.0 - 3.0 * f64::from(i)]).collect();
        let found = line(&points, 0.95).unwrap();
        close(found.slope.value, -3.0, 1e-12);
        close(found.at_zero, 2.0, 1e-12);
        assert!(line(&points[..2], 0.95).is_none() && line(&[[1.0, 2.0]; 5], 0.95).is_none());
    }

    #[test]
    fn intervals_hold_the_truth_as_often_as_they_say() {
        let mut dice = crate::synthetic::Dice::new(11);
        let mut held = [0_u32; 4];
        for _ in 0..400 {
            let values: Vec<f64> = (0..25).map(|_| 3.0 + 2.0 * dice.normal()).collect();
            let (_, variance) = moments(&values).unwrap();
            let points: Vec<[f64; 2]> =
                values.iter().enumerate().map(|(i, v)| [i as f64, v + 0.5 * i as f64]).collect();
            let found = [
                (mean(&values, 0.9).unwrap(), 3.0),
                (sigma(variance, 24.0, 0.9).unwrap(), 2.0),
                (line(&points, 0.9).unwrap().slope, 0.5),
                (quantile(&values, 0.5, 0.9).unwrap(), 3.0),
            ];
            for (count, (estimate, truth)) in held.iter_mut().zip(found) {
                *count += u32::from((estimate.low..=estimate.high).contains(&truth));
            }
        }
        // 400 trials at 90 %: 360, sigma 6; the median's interval is conservative.
        assert!(held[..3].iter().all(|count| (336..=384).contains(count)), "{held:?}");
        assert!(held[3] >= 340, "{held:?}");
    }
}
