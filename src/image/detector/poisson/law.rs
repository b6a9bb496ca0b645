//! Distributions of counts in double precision: Poisson's law, and how far another law is from it.
//!
//! Poisson's probabilities come from `lgamma` at the mode and the recurrence `p(k + 1) = p(k) mean/(k + 1)` to both
//! sides; nothing here is shared with the code that draws. Error of the distribution function: 1e-8 at mean 1e6
//! (`lgamma` near 1.3e7), less below. Tests: below.

/// Half-width of the counts that are looked at: this many sigma and [`MARGIN`] beyond (1e-18 of the law lies outside).
const SIGMAS: f64 = 9.0;
const MARGIN: f64 = 30.0;

/// A law of whole counts by its distribution function; below `first` it is 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Law {
    /// First count.
    pub first: f64,
    /// Probability of at most `first + i`.
    pub cumulative: Vec<f64>,
}

/// Differences of a law from Poisson's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Departure {
    /// Largest difference of the distribution functions (Kolmogorov).
    pub kolmogorov: f64,
    /// Error of the mean, sigma.
    pub mean_sigma: f64,
    /// Error of the variance, share of it.
    pub variance_rel: f64,
}

impl Law {
    /// Returns Poisson's law over all counts that matter at mean `lambda` (positive).
    pub fn poisson(lambda: f64) -> Self {
        let spread = SIGMAS * lambda.sqrt() + MARGIN;
        let first = (lambda - spread).floor().max(0.0);
        let mode = lambda.floor();
        let peak = (mode * lambda.ln() - lambda - libm::lgamma(mode + 1.0)).exp();
        let mut below = Vec::new();
        let (mut k, mut p) = (mode, peak);
        while k > first {
            p *= k / lambda;
            k -= 1.0;
            below.push(p);
        }
        let mut sum = 0.0;
        let mut cumulative: Vec<f64> = Vec::new();
        let mut add = |p: f64| {
            sum += p;
            cumulative.push(sum);
        };
        below.iter().rev().for_each(|p| add(*p));
        (k, p) = (mode, peak);
        while k <= lambda + spread {
            add(p);
            k += 1.0;
            p *= lambda / k;
        }
        Self { first, cumulative }
    }

    /// Returns counts of the table.
    pub fn counts(&self) -> impl Iterator<Item = f64> + use<> {
        let first = self.first;
        (0..self.cumulative.len()).map(move |i| first + i as f64)
    }

    /// Returns the mean and variance about `centre`.
    fn moments(&self, centre: f64) -> [f64; 2] {
        let mut below = 0.0;
        let (mut mean, mut square) = (0.0, 0.0);
        for (k, at_most) in self.counts().zip(&self.cumulative) {
            let (p, d) = (at_most - below, k - centre);
            mean += p * d;
            square += p * d * d;
            below = *at_most;
        }
        [mean, square - mean * mean]
    }

    /// Returns how far this law is from `truth` of mean `lambda`, over the same counts.
    pub fn departure(&self, truth: &Self, lambda: f64) -> Departure {
        let differences = self.cumulative.iter().zip(&truth.cumulative).map(|(a, b)| (a - b).abs());
        let [mean, variance] = self.moments(lambda);
        Departure {
            kolmogorov: differences.fold(0.0, f64::max),
            mean_sigma: mean / lambda.sqrt(),
            variance_rel: variance / lambda - 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAMBDAS: [f64; 6] = [0.1, 1.0, 20.0, 1e3, 3.3e4, 1e6];

    #[test]
    fn poissons_law_is_whole_and_has_its_moments() {
        for lambda in LAMBDAS {
            let law = Law::poisson(lambda);
            let last = law.cumulative.last().copied().unwrap_or_default();
            assert!((last - 1.0).abs() < 1e-8, "sum at {lambda}: {last}");
            let itself = law.departure(&law, lambda);
            assert!(itself.mean_sigma.abs() < 1e-6 && itself.variance_rel.abs() < 1e-6, "{lambda}: {itself:?}");
        }
        let half = Law::poisson(2.0).cumulative[2];
        assert!((half - 5.0 * (-2.0_f64).exp()).abs() < 1e-14, "at most 2 of mean 2: {half}");
    }

    #[test]
    fn another_mean_and_a_shift_are_seen() {
        for lambda in LAMBDAS {
            let truth = Law::poisson(lambda);
            let other = Law::poisson(lambda + 1e-4 * lambda.sqrt());
            assert_eq!(other.first, truth.first, "the same counts");
            let seen = other.departure(&truth, lambda).kolmogorov;
            assert!(seen > 2e-5 && seen < 1e-4, "1e-4 sigma at {lambda}: {seen:e}");
            let mut late = truth.cumulative.clone();
            late.rotate_right(1);
            late[0] = 0.0;
            let late = Law { first: truth.first, cumulative: late }.departure(&truth, lambda);
            assert!(late.kolmogorov > 0.9 * 0.39 / (lambda + 1.0).sqrt(), "one count at {lambda}: {late:?}");
        }
    }
}
