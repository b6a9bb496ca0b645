//! Temporal noise: what changes from frame to frame, and the noise equivalent angle.
//!
//! Of inertial attitudes: the variance within attitudes. Of runs in motion: half of the mean square of successive
//! differences (von Neumann et al. 1941), which slow errors hardly touch.

use crate::bias::groups;
use crate::metric::{AXES, Kind, Metric, Reading};
use crate::record::{JudgedCase, Use};
use crate::statistics::{Estimate, normal_quantile, sigma};
use base::units::ARCSEC;
use glam::DVec3;

/// Parts of the identifiers: the axes, and the root mean square of both across the boresight.
const PARTS: &[&str] = &["x", "y", "rotational", "directional_per_axis"];
/// Cases of attitudes at rest, several frames each.
const STILL: &[Use] = &[Use::Inertial, Use::FovGrid, Use::PixelGrid];

pub(crate) const INERTIAL: Kind = Kind {
    id: "temporal_noise",
    unit: "arcsec",
    reading: Reading::Mixed,
    how: "1 sigma: variance within attitudes, all attitudes together; chi-square",
    parts: PARTS,
    uses: STILL,
    ..Kind::USUAL
};
pub(crate) const SUCCESSIVE: Kind = Kind {
    id: "temporal_noise",
    unit: "arcsec",
    reading: Reading::Temporal,
    how: "1 sigma: mean square of successive differences over 2; chi-square",
    parts: PARTS,
    uses: &[Use::Run, Use::Drift],
    case_uses: Use::EACH_FOR_ITSELF,
    ..Kind::USUAL
};
pub(crate) const NEA: Kind = Kind {
    id: "noise_equivalent_angle",
    unit: "arcsec",
    reading: Reading::Mixed,
    how: "temporal noise times the normal distribution's two-sided factor at the report's probability",
    parts: PARTS,
    uses: &[Use::Inertial, Use::FovGrid, Use::PixelGrid, Use::Run, Use::Drift],
    ..Kind::USUAL
};

/// Sums of squares per axis.
#[derive(Debug, Clone, Copy, Default)]
struct Squares {
    sum: DVec3,
    dof: f64,
}

/// Returns the noise of all inertial cases together, else of a run; and the noise equivalent angle.
pub fn temporal_noise(cases: &[JudgedCase], confidence: f64, probability: f64) -> Vec<Metric> {
    let squares = |of: &[Use], take: fn(&JudgedCase) -> Squares| {
        let parts = cases.iter().filter(|case| of.contains(&case.purpose)).map(take);
        parts.fold(Squares::default(), |all, part| Squares { sum: all.sum + part.sum, dof: all.dof + part.dof })
    };
    let within = squares(STILL, within_groups);
    let (squares, kind) =
        if within.dof >= 4.0 { (within, INERTIAL) } else { (squares(&[Use::Run, Use::Drift], successive), SUCCESSIVE) };
    let mut found = of_squares(squares, &kind, None, confidence);
    let factor = normal_quantile(0.5 * (1.0 + probability));
    let nea: Vec<Metric> = estimates(squares, confidence)
        .into_iter()
        .map(|(name, estimate)| NEA.of(name, None, estimate.scaled(factor / ARCSEC)))
        .collect();
    found.extend(nea);
    found
}

/// Returns the noise of one case by successive differences.
pub fn noise_of_case(case: &JudgedCase, confidence: f64) -> Vec<Metric> {
    of_squares(successive(case), &SUCCESSIVE, Some(&case.name), confidence)
}

fn of_squares(squares: Squares, kind: &Kind, case: Option<&str>, confidence: f64) -> Vec<Metric> {
    let found = estimates(squares, confidence).into_iter();
    found.map(|(name, estimate)| kind.of(name, case, estimate.scaled(1.0 / ARCSEC))).collect()
}

fn estimates(squares: Squares, confidence: f64) -> Vec<(&'static str, Estimate)> {
    let Squares { sum, dof } = squares;
    let axes = AXES.into_iter().enumerate();
    let mut found: Vec<_> = axes.filter_map(|(i, name)| Some((name, sigma(sum[i] / dof, dof, confidence)?))).collect();
    // Root mean square of the two axes.
    let both = sigma(0.5 * (sum.x + sum.y) / dof, 2.0 * dof, confidence);
    found.extend(both.map(|both| ("directional_per_axis", both)));
    found
}

fn within_groups(case: &JudgedCase) -> Squares {
    let mut all = Squares::default();
    for errors in groups(case).iter().filter(|errors| errors.len() >= 2) {
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<DVec3>() / n;
        all.sum += errors.iter().map(|error| (*error - mean).powf(2.0)).sum::<DVec3>();
        all.dof += n - 1.0;
    }
    all
}

fn successive(case: &JudgedCase) -> Squares {
    let pairs = case.frames.windows(2).filter(|pair| pair[0].truth.group == pair[1].truth.group);
    let differences: Vec<DVec3> = pairs.filter_map(|pair| Some(pair[1].error_rad()? - pair[0].error_rad()?)).collect();
    let m = differences.len() as f64;
    if differences.len() < 4 {
        return Squares::default();
    }
    // Neighbouring differences share a frame: the equivalent degrees of freedom of white noise.
    let dof = 2.0 * m * m / (3.0 * m - 1.0);
    let mean_square = differences.iter().map(|difference| difference.powf(2.0)).sum::<DVec3>() / m;
    Squares { sum: 0.5 * mean_square * dof, dof }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Dice, Frame, judged};

    fn frames(seed: u64, drift_arcsec_s: f64) -> Vec<Frame> {
        let mut dice = Dice::new(seed);
        let sigma = DVec3::new(1.5, 2.5, 20.0);
        let frame = |i: u32| {
            let group = i / 20;
            let t_s = 0.1 * f64::from(i);
            Frame::still(
                t_s,
                group,
                DVec3::splat(5.0 * f64::from(group) + drift_arcsec_s * t_s) + sigma * dice.normals(),
            )
        };
        (0..800).map(frame).collect()
    }

    fn holds(metrics: &[Metric], id: &str, truth: f64) -> bool {
        let metric = metrics.iter().find(|metric| metric.id == id).unwrap();
        (metric.low..=metric.high.unwrap()).contains(&truth)
    }

    #[test]
    fn noise_comes_back_whatever_is_between_attitudes() {
        let found = temporal_noise(&[judged(Use::Inertial, &frames(5, 0.0))], 0.99, 0.997);
        assert!(holds(&found, "temporal_noise.x", 1.5) && holds(&found, "temporal_noise.y", 2.5), "{found:?}");
        assert!(holds(&found, "temporal_noise.rotational", 20.0));
        assert!(holds(&found, "temporal_noise.directional_per_axis", (0.5_f64 * (1.5 * 1.5 + 2.5 * 2.5)).sqrt()));
        assert!(holds(&found, "noise_equivalent_angle.x", 2.967_738 * 1.5), "two-sided 99.7 %");
        assert!(!holds(&found, "temporal_noise.x", 2.5), "axes are not swapped");
    }

    #[test]
    fn slow_errors_hardly_touch_successive_differences() {
        let found = temporal_noise(&[judged(Use::Run, &frames(6, 1.0))], 0.99, 0.997);
        assert!(holds(&found, "temporal_noise.x", 1.5), "{found:?}");
        // Control: the plain standard deviation of the same errors is far off.
        let errors: Vec<f64> = frames(6, 1.0).iter().map(|frame| frame.error_arcsec.unwrap().x).collect();
        assert!(crate::statistics::moments(&errors).unwrap().1.sqrt() > 20.0);
    }
}
