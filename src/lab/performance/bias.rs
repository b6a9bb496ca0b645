//! Errors that stay: the bias, and errors that depend on places on the detector.
//!
//! Bias: the part of the error that is the same wherever the sensor looks and whenever (ECSS: alignment measurement
//! error and its stability). The mean over attitudes, or, of one run, over stretches of time.

use crate::metric::{AXES, AXES_AND_DIRECTIONAL, Kind, Metric, Reading};
use crate::record::{JudgedCase, Use, directional};
use crate::statistics::{Estimate, chi_square_quantile, f_quantile, mean};
use base::units::ARCSEC;
use glam::DVec3;

pub(crate) const OF_ATTITUDES: Kind = Kind {
    id: "bias",
    reading: Reading::Ensemble,
    how: "mean of the means of attitudes; Student's t over attitudes",
    parts: AXES_AND_DIRECTIONAL,
    uses: &[Use::Inertial, Use::FovGrid],
    ..Kind::USUAL
};
pub(crate) const OF_TIME: Kind = Kind {
    id: "bias",
    reading: Reading::Temporal,
    how: "mean of the means of stretches of time; Student's t over stretches",
    parts: AXES_AND_DIRECTIONAL,
    uses: &[Use::Run],
    ..Kind::USUAL
};

/// Stretches into which one run is cut.
const STRETCHES: usize = 20;
/// Fewest attitudes or stretches.
const FEWEST: usize = 5;

/// Returns the bias per axis and across the boresight, of attitudes where cases are flown for it, else of a run.
pub fn bias(cases: &[JudgedCase], confidence: f64) -> Vec<Metric> {
    let of = |wanted: &[Use]| cases.iter().filter(|case| wanted.contains(&case.purpose)).collect::<Vec<_>>();
    // Directions of a grid share the field's error: they count without attitudes over the sky.
    for purpose in [Use::Inertial, Use::FovGrid] {
        let groups: Vec<DVec3> = of(&[purpose]).into_iter().flat_map(group_means).collect();
        if groups.len() >= FEWEST {
            return of_means(&groups, &OF_ATTITUDES, confidence);
        }
    }
    let stretches: Vec<DVec3> = of(&[Use::Run]).into_iter().flat_map(|case| stretch_means(case, STRETCHES)).collect();
    if stretches.len() >= FEWEST { of_means(&stretches, &OF_TIME, confidence) } else { Vec::new() }
}

fn of_means(means: &[DVec3], kind: &Kind, confidence: f64) -> Vec<Metric> {
    let axis = |axis: usize| mean(&means.iter().map(|mean| mean[axis]).collect::<Vec<_>>(), confidence);
    of_axes(kind, [0, 1, 2].map(axis))
}

/// Returns a metric of each axis, and of both across the boresight together; nothing where one of them is not known.
pub(crate) fn of_axes(kind: &Kind, axes_rad: [Option<Estimate>; 3]) -> Vec<Metric> {
    let [Some(x), Some(y), Some(z)] = axes_rad else { return Vec::new() };
    let all = AXES.into_iter().zip([x, y, z]).chain([("directional", across(x, y))]);
    all.map(|(name, axis)| kind.of(name, None, axis.scaled(1.0 / ARCSEC))).collect()
}

/// The length of a vector of two estimates; no length inside the box of both intervals is farther from it than its
/// diagonal.
fn across(x: Estimate, y: Estimate) -> Estimate {
    let value = directional(DVec3::new(x.value, y.value, 0.0));
    let half = |axis: Estimate| 0.5 * (axis.high - axis.low);
    let diagonal = half(x).hypot(half(y));
    Estimate { value, low: (value - diagonal).max(0.0), high: value + diagonal, count: x.count }
}

/// Returns the mean error of each attitude of a case.
pub fn group_means(case: &JudgedCase) -> Vec<DVec3> {
    groups(case).into_iter().map(|errors| errors.iter().sum::<DVec3>() / errors.len() as f64).collect()
}

/// Returns the errors of each attitude of a case; attitudes without a solution are left out.
pub fn groups(case: &JudgedCase) -> Vec<Vec<DVec3>> {
    let mut found: Vec<(u32, Vec<DVec3>)> = Vec::new();
    for frame in &case.frames {
        let Some(error) = frame.error_rad() else { continue };
        match found.last_mut().filter(|(group, _)| *group == frame.truth.group) {
            Some((_, errors)) => errors.push(error),
            None => found.push((frame.truth.group, vec![error])),
        }
    }
    found.into_iter().map(|(_, errors)| errors).collect()
}

/// Returns the mean error of each of so many stretches of time of equal numbers of solutions.
pub fn stretch_means(case: &JudgedCase, stretches: usize) -> Vec<DVec3> {
    stretches_of(case, stretches).into_iter().map(|(_, error)| error).collect()
}

/// Returns the mean time, s from the first frame, and mean error of each stretch.
pub fn stretches_of(case: &JudgedCase, stretches: usize) -> Vec<(f64, DVec3)> {
    let zero_ns = case.frames.first().map_or(0, |frame| frame.truth.mid_ns);
    let t_s = |at_ns: i64| (at_ns - zero_ns) as f64 * 1e-9;
    let right = case.frames.iter().filter_map(|frame| Some((t_s(frame.truth.mid_ns), frame.error_rad()?)));
    let right: Vec<(f64, DVec3)> = right.collect();
    let each = (right.len() / stretches.max(1)).max(1);
    let mean = |part: &[(f64, DVec3)]| {
        let n = part.len() as f64;
        (part.iter().map(|(t_s, _)| t_s).sum::<f64>() / n, part.iter().map(|(_, error)| *error).sum::<DVec3>() / n)
    };
    right.chunks_exact(each).map(mean).collect()
}

// Errors that depend on where stars are on the detector: of the period of a pixel, and of the whole field.
//
// Each attitude of a grid is averaged over its frames. The variance between attitudes, less what noise leaves of it,
// is that of the spatial error; its interval is that of Williams (1962) and Tukey (1951) for variance components.

pub(crate) const PIXEL: Kind = Kind {
    id: "pixel_spatial_error",
    reading: Reading::Ensemble,
    how: "1 sigma between shifts by parts of a pixel, less noise; Williams and Tukey",
    parts: &AXES,
    uses: &[Use::PixelGrid],
    ..Kind::USUAL
};
pub(crate) const FOV: Kind = Kind {
    id: "fov_spatial_error",
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
mod bias_tests {
    use super::*;
    use crate::synthetic::{Dice, Frame, judged};

    fn metric<'a>(metrics: &'a [Metric], id: &str) -> &'a Metric {
        metrics.iter().find(|metric| metric.id == id).unwrap()
    }

    fn holds(metric: &Metric, truth: f64) -> bool {
        (metric.low..=metric.high.unwrap()).contains(&truth)
    }

    #[test]
    fn a_bias_comes_back_and_another_does_not() {
        let mut dice = Dice::new(3);
        let injected = DVec3::new(7.0, -4.0, 30.0);
        let frames: Vec<Frame> = (0..60)
            .flat_map(|group| {
                let spatial = 2.0 * dice.normals();
                let noise: Vec<DVec3> = (0..6).map(|_| dice.normals()).collect();
                noise.into_iter().enumerate().map(move |(i, noise)| {
                    let t_s = f64::from(group) * 10.0 + i as f64;
                    Frame::still(t_s, group, injected + spatial + noise)
                })
            })
            .collect();
        let found = bias(&[judged(Use::Inertial, &frames)], 0.99);
        for (id, truth) in
            [("bias.x", 7.0), ("bias.y", -4.0), ("bias.rotational", 30.0), ("bias.directional", 65_f64.sqrt())]
        {
            assert!(holds(metric(&found, id), truth), "{:?}", metric(&found, id));
        }
        // Controls: a wrong sign, swapped axes.
        assert!(!holds(metric(&found, "bias.x"), -7.0) && !holds(metric(&found, "bias.y"), 7.0));
        // The interval is that of 60 attitudes, not of 360 frames.
        let width = metric(&found, "bias.x").high.unwrap() - metric(&found, "bias.x").low;
        let wanted = 2.0 * 2.66 * (4.0_f64 + 1.0 / 6.0).sqrt() / 60_f64.sqrt();
        assert!((width / wanted - 1.0).abs() < 0.35, "{width} {wanted}");
    }

    #[test]
    fn a_run_is_cut_into_stretches_and_four_attitudes_are_too_few() {
        let frames: Vec<Frame> = (0..200).map(|i| Frame::still(f64::from(i), 0, DVec3::new(1.0, 2.0, 3.0))).collect();
        let found = bias(&[judged(Use::Run, &frames)], 0.95);
        assert!((metric(&found, "bias.y").value - 2.0).abs() < 1e-6);
        assert_eq!(metric(&found, "bias.y").reading, Reading::Temporal);
        let few: Vec<Frame> = (0..4).map(|i| Frame::still(f64::from(i), i, DVec3::ONE)).collect();
        assert!(bias(&[judged(Use::Inertial, &few)], 0.95).is_empty());
    }
}

#[cfg(test)]
mod spatial_tests {
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
