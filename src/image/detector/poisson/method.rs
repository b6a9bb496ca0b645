//! The methods of shot noise by name, with domain, promise, error bound and cost.
//!
//! Errors are Kolmogorov distances: the largest difference between the distribution function that is drawn and
//! Poisson's. [`crate::detector::poisson::distance`] measures them; `tests/physics/poisson_methods.rs` holds measured
//! <= bound <= promise over every domain, and measured > promise outside.

use crate::detector::poisson::{cornish_fisher, inversion, ptrs, rounded_normal};
use base::refused::Refused;
use core::{fmt, ops::RangeInclusive, str::FromStr};

/// Largest mean for which f32 keeps the promises, electrons.
const MOST_MEAN: f64 = 1e6;
/// Mean from which `auto` takes Cornish-Fisher.
const LIMIT: f64 = inversion::INVERSION_LIMIT as f64;

base::words! {
    /// Method of drawing counted electrons from their mean.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
    pub enum PoissonMethod {
        /// Inversion below 20 electrons, Cornish-Fisher above.
        #[default]
        Auto = "auto",
        /// Inversion of the distribution function. Domain: means to 20.
        Inversion = "inversion",
        /// Cornish-Fisher expansion on a normal quantile. Domain: means from 20.
        CornishFisher = "cornish-fisher",
        /// Transformed rejection, as good as exact. Domain: means from 10.
        Ptrs = "ptrs",
        /// A rounded normal deviate, without the skewness. Domain: means from 1000.
        RoundedNormal = "rounded-normal",
    }
}

impl PoissonMethod {
    /// Returns the means, electrons, for which the error bound is guaranteed.
    pub fn domain(self) -> RangeInclusive<f64> {
        match self {
            Self::Auto => 0.0..=MOST_MEAN,
            Self::Inversion => 0.0..=LIMIT,
            Self::CornishFisher => LIMIT..=MOST_MEAN,
            Self::Ptrs => f64::from(ptrs::LEAST_MEAN)..=MOST_MEAN,
            Self::RoundedNormal => f64::from(rounded_normal::LEAST_MEAN)..=MOST_MEAN,
        }
    }

    /// Returns the Kolmogorov distance that the method promises within its domain.
    pub fn promise(self) -> f64 {
        match self {
            Self::Inversion | Self::Ptrs => 1e-5,
            Self::Auto | Self::CornishFisher => 1e-4,
            Self::RoundedNormal => 2.15e-3,
        }
    }

    /// Returns the bound on the Kolmogorov distance at mean `lambda`, known before anything is drawn; 1 where nothing
    /// is promised.
    pub fn error_bound(self, lambda: f64) -> f64 {
        match self {
            Self::Auto if lambda < LIMIT => inversion::error_bound(lambda),
            Self::Inversion => inversion::error_bound(lambda),
            Self::Auto | Self::CornishFisher => cornish_fisher::error_bound(lambda),
            Self::Ptrs => ptrs::error_bound(lambda),
            Self::RoundedNormal => rounded_normal::error_bound(lambda),
        }
    }

    /// Returns nanoseconds per pixel on one thread, words and conversion to DN included, where the method is given to a
    /// detector. Measured by `cargo bench --bench poisson` on a two-core AVX-512 machine; a factor of two on others.
    pub fn cost_ns(self, lambda: f64) -> f64 {
        match self {
            Self::Auto if lambda < LIMIT => Self::Inversion.cost_ns(lambda),
            // Steps to the count; bright pixels are drawn as the limit.
            Self::Inversion => 2.2 + 0.17 * lambda.min(LIMIT),
            Self::Auto | Self::CornishFisher => 3.5,
            // Small means are accepted without a logarithm less often.
            Self::Ptrs => 28.0 + 320.0 / lambda.max(f64::from(ptrs::LEAST_MEAN)),
            // The pass over pixels below its domain included.
            Self::RoundedNormal => 4.3,
        }
    }

    /// Returns true if the bound at mean `lambda` is within the guaranteed error.
    pub fn is_within_domain(self, lambda: f64) -> bool {
        self.domain().contains(&lambda)
    }
}

impl fmt::Display for PoissonMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PoissonMethod {
    type Err = Refused;
    fn from_str(text: &str) -> Result<Self, Refused> {
        Self::ALL.into_iter().find(|method| method.name() == text).ok_or_else(|| {
            Refused(format!(
                "Poisson method \"{text}\": wanted auto, inversion, cornish-fisher, ptrs or rounded-normal"
            ))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_and_nonsense_is_refused_with_the_list() {
        for method in PoissonMethod::ALL {
            assert_eq!(method.to_string().parse(), Ok(method));
            let error = "knuth".parse::<PoissonMethod>().unwrap_err().to_string();
            assert!(error.contains(method.name()), "{error}");
        }
        assert_eq!(PoissonMethod::default(), PoissonMethod::Auto);
        assert!("Auto".parse::<PoissonMethod>().is_err() && "".parse::<PoissonMethod>().is_err());
    }

    #[test]
    fn bounds_keep_the_promise_within_the_domain_and_break_it_outside() {
        for method in PoissonMethod::ALL {
            for step in -40..=40 {
                let lambda = 1e3 * 10_f64.powf(f64::from(step) * 0.1);
                let is_kept = method.error_bound(lambda) <= method.promise();
                assert!(is_kept || !method.is_within_domain(lambda), "{method} at {lambda}");
            }
            let (first, last) = (*method.domain().start(), *method.domain().end());
            assert!(method.error_bound(last) <= method.promise(), "{method} at its end");
            assert!(first <= 0.0 || method.error_bound(0.85 * first) > method.promise(), "{method} before its start");
            assert!(!method.is_within_domain(1.01 * last), "{method} after its end");
        }
    }
}
