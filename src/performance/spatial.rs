//! Errors that depend on where stars are on the detector: of the period of a pixel, and of the whole field.
//!
//! Each attitude of a grid is averaged over its frames. The variance between attitudes, less what noise leaves of it,
//! is that of the spatial error; its interval is that of Williams (1962) and Tukey (1951) for variance components.

use crate::bias::groups;
use crate::metric::{AXES, Kind, Metric, Reading};
use crate::record::{JudgedCase, Use};
use crate::statistics::{Estimate, chi_square_quantile, f_quantile};
use base::units::ARCSEC;
use glam::DVec3;

pub(crate) const PIXEL: Kind = Kind {
    id: "pixel_spatial_error",
    unit: "arcsec",
    reading: Reading::Ensemble,
    how: "1 sigma between shifts by parts of a pixel, less noise; Williams and Tukey",
    parts: &AXES,
    uses: &[Use::PixelGrid],
    ..Kind::USUAL
};
pub(crate) const FOV: Kind = Kind {
    id: "fov_spatial_error",
    unit: "arcsec",
    reading: Reading::Ensemble,
    how: "1 sigma between directions over the field, less noise and the pixel's part",
    parts: &AXES,
    uses: &[Use::FovGrid],
    ..Kind::USUAL
};

/// Returns both spatial errors per axis, of the cases that are flown for them.
pub fn spatial_errors(cases: &[JudgedCase], confidence: f64) -> Vec<Metric> {
    let mut found = Vec::new();
    for (axis, name) in AXES.iter().enumerate() {
        let between = |purpose: Use| {
            let all = cases.iter().filter(|case| case.purpose == purpose).flat_map(groups);
            variance_between(&all.collect::<Vec<_>>(), axis, confidence)
        };
        let pixel = between(Use::PixelGrid);
        found.extend(pixel.map(|pixel| PIXEL.of(name, None, rooted(pixel))));
        let fov = between(Use::FovGrid).map(|whole| pixel.map_or(whole, |pixel| less(whole, pixel)));
        found.extend(fov.map(|fov| FOV.of(name, None, rooted(fov))));
    }
    found
}

fn rooted(variance: Estimate) -> Estimate {
    let root = |value: f64| value.max(0.0).sqrt() / ARCSEC;
    Estimate { value: root(variance.value), low: root(variance.low), high: root(variance.high), count: variance.count }
}

/// A variance less a part of it; the interval takes the worst of both.
fn less(whole: Estimate, part: Estimate) -> Estimate {
    let positive = |value: f64| value.max(0.0);
    Estimate {
        value: positive(whole.value - part.value),
        low: positive(whole.low - part.high),
        high: positive(whole.high - positive(part.low)),
        count: whole.count,
    }
}

/// Variance between groups of one axis.
fn variance_between(groups: &[Vec<DVec3>], axis: usize, confidence: f64) -> Option<Estimate> {
    let groups: Vec<&Vec<DVec3>> = groups.iter().filter(|group| group.len() >= 2).collect();
    let (g, total) = (groups.len() as f64, groups.iter().map(|group| group.len()).sum::<usize>() as f64);
    if groups.len() < 4 {
        return None;
    }
    let mean = |group: &[DVec3]| group.iter().map(|error| error[axis]).sum::<f64>() / group.len() as f64;
    let all = groups.iter().map(|group| mean(group) * group.len() as f64).sum::<f64>() / total;
    let squares_of = |group: &[DVec3], about: f64| group.iter().map(|e| (e[axis] - about).powi(2)).sum::<f64>();
    let within = groups.iter().map(|group| squares_of(group, mean(group))).sum::<f64>();
    let between = groups.iter().map(|group| group.len() as f64 * (mean(group) - all).powi(2)).sum::<f64>();
    let (dof_between, dof_within) = (g - 1.0, total - g);
    let (s_between, s_within) = (between / dof_between, within / dof_within);
    // Frames per group, where groups differ (Searle 1971).
    let each = (total - groups.iter().map(|group| (group.len() as f64).powi(2)).sum::<f64>() / total) / (g - 1.0);
    let tail = 0.5 * (1.0 - confidence);
    let bound = |p: f64| {
        let (f, chi) = (f_quantile(p, dof_between, dof_within)?, chi_square_quantile(p, dof_between)?);
        Some((dof_between * (s_between - s_within * f) / (each * chi)).max(0.0))
    };
    Some(Estimate {
        value: ((s_between - s_within) / each).max(0.0),
        low: bound(1.0 - tail)?,
        high: bound(tail)?,
        count: dof_between,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Dice, Frame, judged};

    /// Attitudes whose mean error scatters by `spatial`, with noise from frame to frame.
    fn grid(purpose: Use, spatial: [f64; 2], seed: u64) -> JudgedCase {
        let mut dice = Dice::new(seed);
        let mut frames = Vec::new();
        for group in 0..150 {
            let error: f64 = spatial.iter().map(|sigma| sigma * dice.normal()).sum();
            for i in 0..8 {
                let t_s = f64::from(group) * 10.0 + f64::from(i);
                frames.push(Frame::still(t_s, group, DVec3::new(error, 0.0, 0.0) + 3.0 * dice.normals()));
            }
        }
        judged(purpose, &frames)
    }

    fn find<'a>(metrics: &'a [Metric], id: &str) -> &'a Metric {
        metrics.iter().find(|metric| metric.id == id).unwrap()
    }

    #[test]
    fn both_errors_come_back_one_without_the_other() {
        let cases = [grid(Use::PixelGrid, [1.2, 0.0], 2), grid(Use::FovGrid, [1.2, 2.5], 3)];
        let found = spatial_errors(&cases, 0.99);
        for (id, truth) in [("pixel_spatial_error.x", 1.2), ("fov_spatial_error.x", 2.5)] {
            let metric = find(&found, id);
            assert!((metric.low..=metric.high.unwrap()).contains(&truth), "{metric:?}");
        }
        let none = find(&found, "pixel_spatial_error.y");
        assert!(none.low == 0.0 && none.high.unwrap() < 0.9, "noise of 3 arcsec over 8 frames is taken off: {none:?}");
        let wrong = find(&found, "fov_spatial_error.x");
        assert!(wrong.low > 1.2, "control: it is not the pixel's");
    }

    #[test]
    fn the_interval_holds_as_often_as_it_says() {
        let held = (0..100).filter(|seed| {
            let found = spatial_errors(&[grid(Use::PixelGrid, [2.0, 0.0], 100 + seed)], 0.9);
            let metric = find(&found, "pixel_spatial_error.x");
            (metric.low..=metric.high.unwrap()).contains(&2.0)
        });
        let held = held.count();
        assert!((80..=99).contains(&held), "{held} of 100 at 90 %");
    }
}
