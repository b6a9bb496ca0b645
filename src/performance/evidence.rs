//! How much data a requirement needs that is not shown yet, where that can be computed: if the tracker stays as it was
//! measured, from how many trials or degrees of freedom on its interval meets the limit.

use crate::metric::{Interval, Metric};
use crate::settings::Settings;
use crate::statistics::{confidence_of, share};
use serde::Serialize;

/// Data that a requirement needs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Needs {
    /// So many are needed.
    pub needed: u64,
    /// So many were measured.
    pub measured: u64,
    /// Plural of the things that are counted.
    pub of: &'static str,
}

/// More than anybody measures.
const MOST: u64 = 1 << 40;

/// Returns the data from which on a metric meets its limit; `None` where more of the same would not, or that is not
/// known. `is_met` says whether an interval from `low` to `high` does.
pub(crate) fn needs(
    (metric, all): (&Metric, &[Metric]),
    settings: &Settings,
    is_met: impl Fn(f64, f64) -> bool,
) -> Option<Needs> {
    let tail = 0.5 * (1.0 - settings.confidence);
    let needed = match metric.interval {
        Interval::Share => fewest(metric, |trials| {
            let right = (metric.value * trials as f64).round();
            let found = share(whole(right), trials, settings.confidence);
            found.is_some_and(|found| is_met(found.low, found.high))
        }),
        Interval::Root => fewest(metric, |count| {
            let narrower = (metric.count / count as f64).sqrt();
            let [low, high] = [metric.low, metric.high.unwrap_or(f64::INFINITY)]
                .map(|end| metric.value + (end - metric.value) * narrower);
            is_met(low, high)
        }),
        // An upper end exists from the first count at which all values may be below the quantile.
        Interval::Quantile if metric.high.is_none() => {
            fewest(metric, |count| power(settings.probability, count) <= tail)
        }
        Interval::Median if metric.high.is_none() => fewest(metric, |count| power(0.5, count) <= tail),
        Interval::Confidence => {
            let found = all.iter().find(|other| other.id == "acquisition_probability" && other.case == metric.case)?;
            fewest(metric, |trials| {
                let failures = whole(((1.0 - found.value) * trials as f64).round());
                let confidence = confidence_of(settings.probability, failures, trials);
                is_met(confidence, confidence)
            })
        }
        Interval::Quantile | Interval::Median | Interval::Sweep | Interval::Counted => None,
    }?;
    Some(Needs { needed, measured: whole(metric.count), of: metric.counted })
}

fn power(base: f64, count: u64) -> f64 {
    (base.ln() * count as f64).exp()
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "counts of data, not negative")]
fn whole(count: f64) -> u64 {
    count.max(0.0) as u64
}

/// Returns the fewest data, more than there are, from which on something is so; `None` when it never is.
fn fewest(metric: &Metric, is_so: impl Fn(u64) -> bool) -> Option<u64> {
    let mut low = whole(metric.count).max(1);
    let mut high = low;
    while !is_so(high) {
        low = high;
        high = high.checked_mul(2).filter(|high| *high < MOST)?;
    }
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if is_so(middle) { high = middle } else { low = middle }
    }
    Some(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::availability::{ACQUISITION, ACQUISITION_CONFIDENCE};
    use crate::bias::OF_ATTITUDES;
    use crate::requirements::{Requirements, Verdict};
    use crate::statistics::{Estimate, mean};

    fn judged(metric: &str, limit: &str, metrics: &[Metric]) -> (Verdict, Option<Needs>) {
        let text = format!("[[requirement]]\nid = \"A\"\nmetric = \"{metric}\"\n{limit}\n");
        let judgement = Requirements::parse(&text, "r").unwrap().judge(metrics, &Settings::default()).remove(0);
        (judgement.verdict, judgement.needs)
    }

    #[test]
    fn a_share_needs_what_clopper_and_pearson_say() {
        let acquired = ACQUISITION.of("", None, share(1000, 1000, 0.95).unwrap());
        let (verdict, needs) = judged("acquisition_probability", "least = 0.997", &[acquired]);
        // By hand: 0.025^(1/n) >= 0.997 from n = ln 0.025 / ln 0.997 = 1227.8 on.
        let wanted = Needs { needed: 1228, measured: 1000, of: "attitudes" };
        assert_eq!((verdict, needs), (Verdict::NotShown, Some(wanted)));
        let enough = ACQUISITION.of("", None, share(1228, 1228, 0.95).unwrap());
        assert_eq!(judged("acquisition_probability", "least = 0.997", &[enough]), (Verdict::Met, None));
        // Where the share itself is below the limit, more of the same shows nothing.
        let failing = ACQUISITION.of("", None, share(996, 1000, 0.95).unwrap());
        assert_eq!(judged("acquisition_probability", "least = 0.997", &[failing]), (Verdict::NotShown, None));
    }

    #[test]
    fn a_confidence_that_is_not_reached_is_not_a_failure() {
        let of = |right: u64, trials: u64| {
            let value = confidence_of(0.997, trials - right, trials);
            let exact = Estimate { value, low: value, high: value, count: trials as f64 };
            let acquired = ACQUISITION.of("", None, share(right, trials, 0.95).unwrap());
            judged("acquisition_confidence", "least = 0.95", &[acquired, ACQUISITION_CONFIDENCE.of("", None, exact)])
        };
        let needs = Needs { needed: 997, measured: 500, of: "attitudes" };
        assert_eq!(of(500, 500), (Verdict::NotShown, Some(needs)));
        assert_eq!(of(997, 997).0, Verdict::Met);
        assert_eq!(of(960, 1000).0, Verdict::NotMet, "40 failures: below the probability with the same confidence");
    }

    #[test]
    fn a_mean_needs_more_with_the_square_of_its_width() {
        let values: Vec<f64> = (0..101).map(|i| 4.0 + f64::from(i % 2 * 2 - 1)).collect();
        let bias = OF_ATTITUDES.of("x", None, mean(&values, 0.95).unwrap());
        let half = bias.high.unwrap() - bias.value;
        let limit = bias.value + 0.25 * half;
        let (verdict, needs) = judged("bias.x", &format!("most = {limit}"), core::slice::from_ref(&bias));
        let needed = needs.unwrap().needed;
        assert!(verdict == Verdict::NotShown && (1600..=1601).contains(&needed), "16 times 100: {needed}");
        let beyond = format!("most = {}", bias.value - 0.25 * half);
        assert_eq!(judged("bias.x", &beyond, &[bias]), (Verdict::NotShown, None));
    }
}
