//! Errors in proportion to rate, displacement, time and temperature.
//!
//! Errors in proportion to something: to the rate (measurement date error), to the displacement by aberration, to time
//! (drift).

use crate::bias::{group_means, of_axes, stretches_of};
use crate::metric::{AXES, AXES_AND_DIRECTIONAL, Kind, Metric, Reading};
use crate::record::{Judged, JudgedCase, Use};
use crate::statistics::{Estimate, line, mean};
use base::{time::Tai, units::ARCSEC};
use glam::DVec3;
use testbed::tracker::{earth_beta, uncorrected_turn};

pub(crate) const DATE: Kind = Kind {
    id: "measurement_date_error",
    unit: "ms",
    how: "stated time less the time at which the attitude was true: slope of the error across the boresight over the rate",
    uses: &[Use::Slew, Use::Run, Use::Stress],
    ..Kind::USUAL
};
pub(crate) const TAG: Kind = Kind {
    id: "time_tag_error",
    unit: "ms",
    reading: Reading::Temporal,
    how: "mean of stated time less mid-exposure, of right attitudes",
    uses: &[Use::Slew, Use::Run, Use::Stress],
    ..Kind::USUAL
};
pub(crate) const ABERRATION: Kind = Kind {
    id: "aberration_residual",
    reading: Reading::Ensemble,
    how: "part of the largest displacement by the Earth's velocity that is left: slope of the error over the displacement",
    uses: &[Use::LostInSpace, Use::Inertial, Use::Run],
    ..Kind::USUAL
};
pub(crate) const DRIFT: Kind = Kind {
    id: "drift",
    unit: "arcsec/h",
    reading: Reading::Temporal,
    how: "slope of the means of stretches of time over time",
    parts: &AXES,
    uses: &[Use::Drift, Use::Run],
    ..Kind::USUAL
};
pub(crate) const MDE: Kind = Kind {
    id: "mean_drift_error",
    reading: Reading::Temporal,
    how: "MDE: mean over the last quarter less mean over the first",
    parts: &AXES,
    uses: &[Use::Drift, Use::Run],
    ..Kind::USUAL
};

/// Stretches of time for slopes over time.
const STRETCHES: usize = 40;
/// Frames of a motion that give one point.
const STRETCH_FRAMES: usize = 10;
/// Least spread of rates, rad/s rms, that a date error needs: 0.01 deg/s.
const LEAST_RATE_RAD_S: f64 = 1.7e-4;
/// Least spread of displacements by aberration, rad rms.
const LEAST_DISPLACEMENT_RAD: f64 = 2.0 * ARCSEC;

/// Returns the date error, of slews or of a run that turns; and the mean error of time tags.
pub fn date_error(cases: &[JudgedCase], confidence: f64) -> Vec<Metric> {
    let of: Vec<&JudgedCase> =
        cases.iter().filter(|case| matches!(case.purpose, Use::Slew | Use::Run | Use::Stress)).collect();
    let mut found = Vec::new();
    let points = demeaned(&of, |frame, axis| Some([frame.truth.rate_rad_s[axis], frame.error_rad()?[axis]]));
    if let Some(line) = (spread(&points) > LEAST_RATE_RAD_S).then(|| line(&points, confidence)).flatten() {
        let slope = line.slope;
        // An attitude that was true before its stated time lags behind: the error is against the motion.
        let date = Estimate { value: -slope.value, low: -slope.high, high: -slope.low, count: slope.count };
        found.push(DATE.of("", None, date.scaled(1e3)));
    }
    let right = of.iter().flat_map(|case| case.frames.iter().filter(|frame| frame.is_right()));
    let tags: Vec<f64> = right.filter_map(|frame| frame.tag_error_s).collect();
    found.extend(mean(&tags, confidence).map(|tag| TAG.of("", None, tag.scaled(1e3))));
    found
}

/// Returns what is left of aberration, over attitudes all over the sky.
pub fn aberration_residual(cases: &[JudgedCase], confidence: f64) -> Vec<Metric> {
    let of: Vec<&JudgedCase> =
        cases.iter().filter(|case| matches!(case.purpose, Use::LostInSpace | Use::Inertial | Use::Run)).collect();
    let points = demeaned(&of, |frame, axis| Some([uncorrected(frame)[axis], frame.error_rad()?[axis]]));
    if spread(&points) < LEAST_DISPLACEMENT_RAD {
        return Vec::new();
    }
    let first = of.iter().find_map(|case| case.frames.first());
    let largest_rad = first.map_or(0.0, |frame| earth_beta(Tai::from_ns(frame.truth.mid_ns)).length());
    let slope = line(&points, confidence).map(|line| line.slope.scaled(largest_rad / ARCSEC));
    slope.map(|slope| ABERRATION.of("", None, slope)).into_iter().collect()
}

/// The error of a tracker that knows nothing of aberration, rad, about x and y of the sensor.
fn uncorrected(frame: &Judged) -> DVec3 {
    uncorrected_turn(frame.truth.attitude * earth_beta(Tai::from_ns(frame.truth.mid_ns)))
}

/// Points of both axes across the boresight, without the mean of each axis. Errors of one attitude, or of a short
/// stretch of a motion, are not independent: each gives one point.
fn demeaned(cases: &[&JudgedCase], point: impl Fn(&Judged, usize) -> Option<[f64; 2]>) -> Vec<[f64; 2]> {
    let mut all = Vec::new();
    for axis in 0..2 {
        let parts = cases.iter().flat_map(|case| case.frames.chunk_by(|a, b| a.truth.group == b.truth.group));
        let parts = parts.flat_map(|group| group.chunks(if is_still(group) { group.len() } else { STRETCH_FRAMES }));
        let points: Vec<[f64; 2]> = parts
            .filter_map(|part| {
                let some: Vec<[f64; 2]> = part.iter().filter_map(|frame| point(frame, axis)).collect();
                (!some.is_empty()).then(|| mean_of(&some))
            })
            .collect();
        let mean = mean_of(&points);
        all.extend(points.iter().map(|point| [point[0] - mean[0], point[1] - mean[1]]));
    }
    all
}

fn is_still(group: &[Judged]) -> bool {
    group.iter().all(|frame| frame.truth.rate_rad_s.length() < LEAST_RATE_RAD_S)
}

fn mean_of(points: &[[f64; 2]]) -> [f64; 2] {
    let n = points.len().max(1) as f64;
    [0, 1].map(|axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / n)
}

fn spread(points: &[[f64; 2]]) -> f64 {
    (points.iter().map(|point| point[0] * point[0]).sum::<f64>() / points.len().max(1) as f64).sqrt()
}

/// Returns drift per axis, of the cases that are flown for it, else of a run.
pub fn drift(cases: &[JudgedCase], confidence: f64) -> Vec<Metric> {
    let of = |purpose: Use| cases.iter().find(|case| case.purpose == purpose);
    let Some(case) = of(Use::Drift).or_else(|| of(Use::Run)) else { return Vec::new() };
    let stretches = stretches_of(case, STRETCHES);
    let mut found = Vec::new();
    for (axis, name) in AXES.iter().enumerate() {
        let points: Vec<[f64; 2]> = stretches.iter().map(|(t_s, error)| [*t_s, error[axis] / ARCSEC]).collect();
        let slope = line(&points, confidence).map(|line| line.slope.scaled(3600.0));
        found.extend(slope.map(|slope| DRIFT.of(name, None, slope)));
        let quarter = stretches.len() / 4;
        let values =
            |part: &[(f64, DVec3)]| mean(&part.iter().map(|(_, e)| e[axis] / ARCSEC).collect::<Vec<_>>(), confidence);
        let [first, last] = [values(&stretches[..quarter]), values(&stretches[stretches.len() - quarter..])];
        found.extend(first.zip(last).map(|(first, last)| MDE.of(name, None, difference(last, first))));
    }
    found
}

/// A difference of two independent estimates.
pub(crate) fn difference(a: Estimate, b: Estimate) -> Estimate {
    let half = (0.5 * (a.high - a.low)).hypot(0.5 * (b.high - b.low));
    let value = a.value - b.value;
    Estimate { value, low: value - half, high: value + half, count: a.count + b.count }
}

// Thermo-elastic error: the drift of the bias with the temperatures of an orbit, as the mean drift error (MDE) over the
// observation: mean over its last fifth less mean over its first.
//
// Each attitude gives one mean: the spatial errors of attitudes all over the sky are averaged as the noise is, and are
// in the interval.

pub(crate) const THERMO_ELASTIC: Kind = Kind {
    id: "thermo_elastic_error",
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
    of_axes(&THERMO_ELASTIC, [0, 1, 2].map(change))
}

#[cfg(test)]
mod slopes_tests {
    use super::*;
    use crate::synthetic::{Dice, Frame, judged};
    use base::units::DEG;
    use glam::DQuat;

    fn find<'a>(metrics: &'a [Metric], id: &str) -> &'a Metric {
        metrics.iter().find(|metric| metric.id == id).unwrap_or_else(|| panic!("{id} in {metrics:?}"))
    }

    fn holds(metrics: &[Metric], id: &str, truth: f64) -> bool {
        let metric = find(metrics, id);
        (metric.low..=metric.high.unwrap()).contains(&truth)
    }

    /// Slews at several rates; the attitude is that of `late_s` before the stated time; `tag_s` of that is in the tag.
    fn slews(late_s: f64, tag_s: f64) -> JudgedCase {
        let mut dice = Dice::new(9);
        let mut frames = Vec::new();
        for (group, rate_deg_s) in [-1.0, -0.3, 0.0, 0.5, 1.0].into_iter().enumerate() {
            let rate_rad_s = DVec3::new(0.3, 1.0, 0.2) * rate_deg_s * DEG;
            for i in 0..60 {
                let lag = rate_rad_s * (late_s - tag_s) / ARCSEC;
                let error = DVec3::new(3.0, -8.0, 0.0) - lag + 2.0 * dice.normals();
                let t_s = group as f64 * 100.0 + 0.1 * f64::from(i);
                frames.push(Frame { t_s, group: group as u32, rate_rad_s, error_arcsec: Some(error), tag_s });
            }
        }
        judged(Use::Slew, &frames)
    }

    #[test]
    fn a_date_error_comes_back_from_tags_and_from_attitudes_alike() {
        for (late_s, tag_s) in [(0.004, 0.0), (0.004, 0.004), (-0.003, 0.0)] {
            let found = date_error(&[slews(late_s, tag_s)], 0.99);
            assert!(holds(&found, "measurement_date_error", 1e3 * late_s), "{late_s} {tag_s}: {found:?}");
            assert!(!holds(&found, "measurement_date_error", -1e3 * late_s), "the sign counts");
            assert!((find(&found, "time_tag_error").value - 1e3 * tag_s).abs() < 1e-3);
        }
    }

    #[test]
    fn without_motion_nothing_is_said_of_dates() {
        let frames: Vec<Frame> = (0..50).map(|i| Frame::still(f64::from(i), 0, DVec3::ONE)).collect();
        let found = date_error(&[judged(Use::Run, &frames)], 0.95);
        assert!(found.iter().all(|metric| metric.id != "measurement_date_error"), "{found:?}");
    }

    #[test]
    fn a_tracker_that_knows_no_aberration_is_found() {
        let mut dice = Dice::new(4);
        let noise: Vec<DVec3> = (0..200).map(|_| 3.0 * dice.normals()).collect();
        let plain: Vec<Frame> =
            noise.iter().enumerate().map(|(i, noise)| Frame::still(10.0 * i as f64, i as u32, *noise)).collect();
        let mut case = judged(Use::LostInSpace, &plain);
        assert!(holds(&aberration_residual(std::slice::from_ref(&case), 0.99), "aberration_residual", 0.0));
        // Written afresh: the frame that sees apparent directions s + beta across s where the catalog's are.
        for frame in &mut case.frames {
            let beta = earth_beta(Tai::from_ns(frame.truth.mid_ns));
            let attitude = frame.truth.attitude;
            let boresight = attitude.conjugate() * DVec3::Z;
            let apparent = (boresight + beta).normalize();
            let turn = DQuat::from_rotation_arc(attitude * boresight, attitude * apparent);
            let measured = turn * attitude;
            let error = crate::record::attitude_error(measured, attitude);
            let noise = frame.error_rad().unwrap();
            frame.fate = crate::record::Fate::Right(error + noise);
        }
        let found = aberration_residual(&[case], 0.99);
        assert!(holds(&found, "aberration_residual", 20.5), "{found:?}");
        assert!(!holds(&found, "aberration_residual", 0.0) && !holds(&found, "aberration_residual", -20.5));
    }

    #[test]
    fn drift_comes_back_with_its_mean_error() {
        let mut dice = Dice::new(8);
        let frame = |i: u32| {
            let t_s = f64::from(i);
            Frame::still(t_s, 0, DVec3::new(12.0, 0.0, -60.0) * t_s / 3600.0 + 1.5 * dice.normals())
        };
        let frames: Vec<Frame> = (0..3600).map(frame).collect();
        let found = drift(&[judged(Use::Drift, &frames)], 0.99);
        assert!(
            holds(&found, "drift.x", 12.0) && holds(&found, "drift.y", 0.0) && holds(&found, "drift.rotational", -60.0),
            "{found:?}"
        );
        assert!(!holds(&found, "drift.x", -12.0) && !holds(&found, "drift.y", 12.0));
        // From the middle of the first quarter to that of the last: three quarters of the time.
        assert!((find(&found, "mean_drift_error.x").value - 9.0).abs() < 0.5);
    }
}

#[cfg(test)]
mod thermo_elastic_tests {
    use super::*;
    use crate::poses::MountingDrift;
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
