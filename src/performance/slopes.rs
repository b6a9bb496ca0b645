//! Errors in proportion to something: to the rate (measurement date error), to the displacement by aberration, to time
//! (drift).

use crate::bias::stretches_of;
use crate::metric::{AXES, Kind, Metric, Reading};
use crate::record::{Judged, JudgedCase, Use};
use crate::statistics::{Estimate, line, mean};
use base::{time::Tai, units::ARCSEC};
use glam::DVec3;
use testbed::tracker::{earth_beta, uncorrected_turn};

pub(crate) const DATE: Kind = Kind {
    id: "measurement_date_error",
    unit: "ms",
    reading: Reading::Mixed,
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
    unit: "arcsec",
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
    unit: "arcsec",
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

#[cfg(test)]
#[path = "slopes_tests.rs"]
mod tests;
