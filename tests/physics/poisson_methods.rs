//! The Poisson methods against Poisson's law: what they draw is within their bound, and the bound within the promise,
//! over the whole domain; outside it the promise is broken, and the domain says so.
//!
//! Distances are computed from the drawn distributions, not sampled; chi-square in frames checks that the detector
//! draws what was computed, at the false-alarm rates of [`crate::noise`].

use crate::noise::{STANDARD_ERRORS, chi_square, counts_by, moment_errors, shot_only};
use image::detector::DetectorParams;
use image::detector::PoissonMethod::{self, Auto, CornishFisher, Inversion, Ptrs, RoundedNormal};
use image::detector::poisson::distance::{departure, distance};
use image::detector::poisson::law::{Departure, Law};
use run::runtime::Imager;

/// Means on both sides of every edge of a domain.
const EDGES: [f64; 8] = [9.9, 10.0, 19.99, 20.0, 20.01, 999.0, 1000.0, 1e6];
/// Error of a method's mean within its domain, sigma: at mean 1e6, where a unit of f32 is 1/16.
const MEAN_SIGMA: f64 = 5e-5;
/// Error of a method's variance, share: rounding adds 1/12 to a rounded normal's, 8.3e-5 of it at mean 1000.
const VARIANCE_REL: f64 = 1e-4;

/// Returns three means a decade from 0.1 to 1e6, and the edges.
fn lambdas() -> impl Iterator<Item = f64> {
    (-3..=18).map(|third| 10_f64.powf(f64::from(third) / 3.0)).chain(EDGES)
}

fn measured(method: PoissonMethod, lambda: f64) -> Departure {
    departure(method, lambda).expect("a mean within the table's range")
}

#[test]
fn errors_are_within_bounds_and_bounds_within_promises() {
    for method in PoissonMethod::ALL {
        // A third of a decade may pass 1e6 by rounding.
        for lambda in lambdas().map(|lambda| lambda.min(1e6)).filter(|lambda| method.is_within_domain(*lambda)) {
            let found = measured(method, lambda);
            let (bound, promise) = (method.error_bound(lambda), method.promise());
            println!(
                "{method:15} at {lambda:9.2}: distance {:.2e} <= {bound:.2e} <= {promise:.2e}, mean {:+.1e} sigma, \
                 variance {:+.1e}",
                found.kolmogorov, found.mean_sigma, found.variance_rel
            );
            assert!(found.kolmogorov <= bound, "{method} at {lambda}: {found:?}, bound {bound:e}");
            assert!(bound <= promise, "{method} at {lambda}: bound {bound:e}, promise {promise:e}");
            assert!(found.mean_sigma.abs() < MEAN_SIGMA, "{method} at {lambda}: {found:?}");
            assert!(found.variance_rel.abs() < VARIANCE_REL, "{method} at {lambda}: {found:?}");
        }
    }
}

#[test]
fn outside_its_domain_a_method_breaks_its_promise() {
    // Bounds have a margin, so promises break a little way outside. The upper ends of `ptrs` and `rounded-normal` are
    // where these tests end.
    let outside = [
        (Inversion, 20.1),
        (Inversion, 100.0),
        (CornishFisher, 18.0),
        (CornishFisher, 5.0),
        (CornishFisher, 0.1),
        (CornishFisher, 1e7),
        (Ptrs, 8.0),
        (Ptrs, 1.0),
        (Ptrs, 0.5),
        (RoundedNormal, 900.0),
        (RoundedNormal, 20.0),
        (Auto, 1e7),
    ];
    for (method, lambda) in outside {
        let (found, promise) = (measured(method, lambda).kolmogorov, method.promise());
        println!("{method:15} at {lambda:9.2}: distance {found:.2e} > {promise:.2e}");
        assert!(found > promise, "{method} at {lambda}: {found:e} keeps {promise:e}");
        assert!(found <= method.error_bound(lambda), "{method} at {lambda}: the bound holds, or is 1");
        assert!(method.error_bound(lambda) > promise, "{method} at {lambda}: the bound is above it");
        assert!(!method.is_within_domain(lambda), "{method} at {lambda}: the domain refuses it");
    }
}

#[test]
fn auto_takes_inversion_below_twenty_and_cornish_fisher_from_there() {
    for (lambda, own, other) in [(19.99, Inversion, CornishFisher), (20.0, CornishFisher, Inversion)] {
        let found = distance(Auto, lambda);
        assert_eq!(found, distance(own, lambda), "at {lambda}");
        assert_ne!(found, distance(other, lambda), "at {lambda}");
    }
}

#[test]
fn the_measure_sees_another_law() {
    for lambda in [20.0, 1e3, 1e6] {
        // A thousandth of a sigma of mean moves the distribution function by 4e-4.
        let truth = Law::poisson(lambda);
        let other = Law::poisson(lambda + 1e-3 * lambda.sqrt());
        assert_eq!(other.first, truth.first, "the same counts");
        let found = other.departure(&truth, lambda);
        assert!((found.kolmogorov - 4e-4).abs() < 4e-5, "at {lambda}: {found:?}");
        assert!(found.kolmogorov > Auto.promise() && (found.mean_sigma - 1e-3).abs() < 1e-6, "at {lambda}: {found:?}");
    }
}

#[test]
fn frames_are_drawn_by_the_method_they_are_given() {
    for lambda in [10.0, 50.0, 1e3, 1e5] {
        let counts = counts_by(Ptrs, lambda, 2);
        let (chi2, limit) = chi_square(&counts, lambda);
        let errors = moment_errors(&counts, lambda);
        println!("ptrs at {lambda}: chi-square {chi2:.0} < {limit:.0}, moments off by {errors:.1?} standard errors");
        assert!(chi2 < limit, "ptrs at {lambda}: chi-square {chi2}, wanted below {limit}");
        assert!(errors.iter().all(|e| e.abs() < STANDARD_ERRORS), "ptrs at {lambda}: {errors:?} standard errors");
        let [mean, _] = moment_errors(&counts, lambda + 0.01 * lambda.sqrt());
        assert!(mean.abs() > STANDARD_ERRORS, "a hundredth of a sigma of mean is seen");
    }
    // The skewness that a rounded normal leaves out shows in a million pixels.
    let (chi2, limit) = chi_square(&counts_by(RoundedNormal, 1000.0, 4), 1000.0);
    assert!(chi2 > limit, "rounded normal at 1000: chi-square {chi2}, limit {limit}");
    assert_eq!(counts_by(RoundedNormal, 999.0, 1), counts_by(Auto, 999.0, 1), "below its domain");
    assert_eq!(counts_by(Ptrs, 9.99, 1), counts_by(Auto, 9.99, 1), "below its domain");
    assert_ne!(counts_by(Ptrs, 10.0, 1), counts_by(Auto, 10.0, 1), "within");
}

#[test]
fn a_method_of_the_cpu_is_drawn_there_or_refused() {
    let imager = |choice, poisson| Imager::new(choice, DetectorParams { poisson, ..shot_only() }, [64, 64], 1);
    // With a GPU or without: never drawn as `auto` without a word.
    assert!(imager(config::Backend::Gpu, Ptrs).is_err(), "a GPU knows auto only");
    let left_to_us = imager(config::Backend::Auto, Ptrs).expect("the CPU");
    assert_eq!(left_to_us.name(), imager(config::Backend::Cpu, Auto).expect("the CPU").name());
    assert!(left_to_us.note.as_ref().is_some_and(|note| note.contains("ptrs")), "{:?}", left_to_us.note);
}
