//! Thermo-elastic error: the drift of the bias with the temperatures of an orbit, as the mean drift error (MDE) over the
//! observation: mean over its last fifth less mean over its first.
//!
//! Each attitude gives one mean: the spatial errors of attitudes all over the sky are averaged as the noise is, and are
//! in the interval.

use crate::bias::{across, group_means};
use crate::metric::{AXES, AXES_AND_DIRECTIONAL, Kind, Metric, Reading};
use crate::record::{JudgedCase, Use};
use crate::slopes::difference;
use crate::statistics::{Estimate, mean};
use base::units::ARCSEC;
use glam::DVec3;

pub(crate) const THERMO_ELASTIC: Kind = Kind {
    id: "thermo_elastic_error",
    unit: "arcsec",
    reading: Reading::Mixed,
    how: "MDE of a drifting mounting: mean over the last fifth of the attitudes less mean over the first; Student's t over attitudes",
    parts: AXES_AND_DIRECTIONAL,
    uses: &[Use::ThermoElastic],
    ..Kind::USUAL
};

/// Intervals into which the observation is cut; the first and the last are compared.
const INTERVALS: usize = 5;
/// Fewest attitudes of an interval.
const FEWEST: usize = 5;

/// Returns the error per axis and across the boresight, of the case that is flown for it.
pub fn thermo_elastic(cases: &[JudgedCase], confidence: f64) -> Vec<Metric> {
    let Some(case) = cases.iter().find(|case| case.purpose == Use::ThermoElastic) else { return Vec::new() };
    let means = group_means(case);
    let each = means.len() / INTERVALS;
    if each < FEWEST {
        return Vec::new();
    }
    let of = |part: &[DVec3], axis: usize| mean(&part.iter().map(|m| m[axis]).collect::<Vec<_>>(), confidence);
    let change = |axis: usize| -> Option<Estimate> {
        let [first, last] = [of(&means[..each], axis)?, of(&means[means.len() - each..], axis)?];
        Some(difference(last, first))
    };
    let [Some(x), Some(y), Some(z)] = [change(0), change(1), change(2)] else { return Vec::new() };
    let metric = |name: &str, estimate: Estimate| THERMO_ELASTIC.of(name, None, estimate.scaled(1.0 / ARCSEC));
    let mut found: Vec<Metric> = AXES.iter().zip([x, y, z]).map(|(name, axis)| metric(name, axis)).collect();
    found.push(metric("directional", across(x, y)));
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mounting::MountingDrift;
    use crate::synthetic::{Dice, Frame, judged};

    /// 100 attitudes of 4 frames over half an orbit, with spatial errors and noise.
    fn flown(arcsec: [f64; 3], seed: u64) -> Vec<Metric> {
        let mut dice = Dice::new(seed);
        let drift = MountingDrift { arcsec, period_s: 800.0 };
        let mut frames = Vec::new();
        for group in 0..100 {
            let spatial = DVec3::new(1.0, 1.0, 6.0) * dice.normals();
            for i in 0..4 {
                let t_s = f64::from(4 * group + i);
                let error = drift.turn_rad(t_s) / ARCSEC + spatial + DVec3::new(1.0, 1.0, 8.0) * dice.normals();
                frames.push(Frame::still(t_s, group, error));
            }
        }
        thermo_elastic(&[judged(Use::ThermoElastic, &frames)], 0.99)
    }

    fn holds(metrics: &[Metric], part: &str, truth: f64) -> bool {
        let metric = metrics.iter().find(|m| m.id == format!("thermo_elastic_error.{part}")).unwrap();
        (metric.low..=metric.high.unwrap()).contains(&truth)
    }

    #[test]
    fn an_injected_drift_comes_back_and_none_is_none() {
        // By hand: the mean of sin^2 from 0 to pi / 10, and the same short of 1 at the end.
        use core::f64::consts::PI;
        let begin = 0.5 - 2.5 / PI * (PI / 5.0).sin();
        let change = 1.0 - 2.0 * begin;
        let found = flown([20.0, -10.0, 60.0], 7);
        for (part, largest) in [("x", 20.0), ("y", -10.0), ("rotational", 60.0), ("directional", 500_f64.sqrt())] {
            assert!(holds(&found, part, change * largest), "{part} {change}: {found:?}");
        }
        assert!(!holds(&found, "x", -change * 20.0) && !holds(&found, "x", -change * 10.0), "sign and axis count");
        let none = flown([0.0; 3], 8);
        assert!(holds(&none, "x", 0.0) && holds(&none, "rotational", 0.0) && !holds(&none, "x", change * 20.0));
    }

    #[test]
    fn few_attitudes_say_nothing() {
        let frames: Vec<Frame> = (0..20).map(|i| Frame::still(f64::from(i), i, DVec3::ONE)).collect();
        assert!(thermo_elastic(&[judged(Use::ThermoElastic, &frames)], 0.95).is_empty());
    }
}
