//! Measured output bandwidth: sines of the line of sight, and how much of them the output follows.
//!
//! At each frequency `c + a sin(2 pi f t) + b cos(2 pi f t)` is fitted by least squares to the true and to the measured
//! turn about the axis of the motion. The ratio of the amplitudes falls with the frequency; where it crosses 1 / sqrt 2,
//! by a straight line between two frequencies, is the bandwidth. Frequencies above half of the frame rate are folded,
//! but known: they can be fitted unless they are a multiple of half of the frame rate. An exposure of `T` alone gives
//! `|sin(pi f T) / (pi f T)|`, and a bandwidth of `0.443 / T`.

use crate::attitude_error::attitude_error;
use crate::metric::{Interval, Kind, Metric, Reading};
use crate::record::{JudgedCase, Use};
use crate::statistics::{Estimate, t_quantile};
use core::f64::consts::{FRAC_1_SQRT_2, TAU};
use glam::{DMat3, DVec3};

/// Key of the frequency among the conditions of a case.
pub const SINE: &str = "sine_hz";

pub(crate) const RATIO: Kind = Kind {
    id: "amplitude_ratio",
    unit: "share",
    reading: Reading::Temporal,
    how: "amplitude of the output over that of the line of sight; least squares, Student's t",
    case_uses: &[Use::Bandwidth],
    ..Kind::USUAL
};
pub(crate) const BANDWIDTH: Kind = Kind {
    id: "output_bandwidth",
    unit: "Hz",
    reading: Reading::Temporal,
    how: "frequency at which the amplitude ratio falls below 1/sqrt(2) (-3 dB); a straight line between two frequencies",
    uses: &[Use::Bandwidth],
    interval: Interval::Sweep,
    counted: "frequencies",
    ..Kind::USUAL
};

/// Fewest attitudes of a fit.
const FEWEST: usize = 8;
/// Least determinant of the normal equations, in units of that of independent terms: below it sine and cosine are folded
/// onto one another.
const LEAST_DETERMINANT: f64 = 0.01;

/// Returns the bandwidth of the cases that are flown for it.
pub fn bandwidth(cases: &[JudgedCase], confidence: f64) -> Vec<Metric> {
    let of = cases.iter().filter_map(|case| Some((frequency_hz(case)?, ratio(case, confidence)?)));
    let mut ratios: Vec<(f64, Estimate)> = of.collect();
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    let curve =
        |take: fn(&Estimate) -> f64| -> Vec<[f64; 2]> { ratios.iter().map(|(hz, ratio)| [*hz, take(ratio)]).collect() };
    let Some([_, _]) = ratios.first().zip(ratios.get(1)).map(|(a, b)| [a, b]) else { return Vec::new() };
    let [value, low, high] = [curve(|r| r.value), curve(|r| r.low), curve(|r| r.high)].map(|curve| crossing(&curve));
    let (first, last) = (ratios[0].0, ratios[ratios.len() - 1].0);
    let found = Estimate {
        value: value.hz(first, last),
        low: if low == Crossing::Before { 0.0 } else { low.hz(first, last) },
        high: if high == Crossing::Beyond { f64::INFINITY } else { high.hz(first, last) },
        count: ratios.len() as f64,
    };
    vec![BANDWIDTH.of("", None, found)]
}

/// Returns the amplitude ratio of one case that is flown for it.
pub fn ratio_of_case(case: &JudgedCase, confidence: f64) -> Option<Metric> {
    ratio(case, confidence).map(|ratio| RATIO.of("", Some(&case.name), ratio))
}

fn frequency_hz(case: &JudgedCase) -> Option<f64> {
    case.conditions.get(SINE).copied().filter(|hz| case.purpose == Use::Bandwidth && *hz > 0.0)
}

fn ratio(case: &JudgedCase, confidence: f64) -> Option<Estimate> {
    let hz = frequency_hz(case)?;
    let first = case.frames.first()?.truth;
    let t_s = |ns: i64| (ns - first.mid_ns) as f64 * 1e-9;
    let moved = |frame: &crate::record::Judged| attitude_error(frame.truth.attitude, first.attitude);
    let true_turns: Vec<(f64, DVec3)> =
        case.frames.iter().map(|frame| (t_s(frame.truth.mid_ns), moved(frame))).collect();
    let axis = axis_of(&true_turns, hz)?;
    let along =
        |turns: &[(f64, DVec3)]| -> Vec<[f64; 2]> { turns.iter().map(|(t_s, turn)| [*t_s, turn.dot(axis)]).collect() };
    let measured: Vec<(f64, DVec3)> = case
        .frames
        .iter()
        .filter_map(|frame| {
            // The error is against the true attitude at the stated time.
            let tag_s = frame.tag_error_s.unwrap_or(0.0);
            let stated = moved(frame) + frame.truth.rate_rad_s * tag_s;
            Some((t_s(frame.truth.mid_ns) + tag_s, stated + frame.error_rad()?))
        })
        .collect();
    let [whole, output] =
        [amplitude(&along(&true_turns), hz, confidence)?, amplitude(&along(&measured), hz, confidence)?];
    (whole.value > 0.0).then(|| Estimate { low: output.low.max(0.0), ..output }.scaled(1.0 / whole.value))
}

/// The axis of a motion about one axis: that of its largest turn from the mean.
fn axis_of(turns: &[(f64, DVec3)], hz: f64) -> Option<DVec3> {
    let mean = turns.iter().map(|(_, turn)| *turn).sum::<DVec3>() / turns.len() as f64;
    let far = turns.iter().map(|(_, turn)| *turn - mean).max_by(|a, b| a.length().total_cmp(&b.length()))?;
    far.try_normalize().filter(|_| hz > 0.0)
}

/// The amplitude of a sine through points of time and value.
fn amplitude(points: &[[f64; 2]], hz: f64, confidence: f64) -> Option<Estimate> {
    let n = points.len() as f64;
    if points.len() < FEWEST {
        return None;
    }
    let terms = |t_s: f64| {
        let (sine, cosine) = (TAU * hz * t_s).sin_cos();
        DVec3::new(1.0, sine, cosine)
    };
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for [t_s, value] in points {
        let row = terms(*t_s);
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        right += row * *value;
    }
    if normal.determinant() < LEAST_DETERMINANT * 0.25 * n * n * n {
        return None;
    }
    let inverse = normal.inverse();
    let fitted = inverse * right;
    let squares: f64 = points.iter().map(|[t_s, value]| (value - terms(*t_s).dot(fitted)).powi(2)).sum();
    let (dof, value) = (n - 3.0, fitted.y.hypot(fitted.z));
    let along = DVec3::new(0.0, fitted.y, fitted.z) / value.max(f64::MIN_POSITIVE);
    let half = t_quantile(confidence, dof)? * (squares / dof * along.dot(inverse * along)).sqrt();
    Some(Estimate { value, low: value - half, high: value + half, count: dof })
}

/// Where a falling curve crosses 1 / sqrt 2.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Crossing {
    /// It is below from the first point on.
    Before,
    /// Between two points.
    At(f64),
    /// It is above to the last point.
    Beyond,
}

impl Crossing {
    fn hz(self, first: f64, last: f64) -> f64 {
        match self {
            Self::Before => first,
            Self::At(hz) => hz,
            Self::Beyond => last,
        }
    }
}

fn crossing(curve: &[[f64; 2]]) -> Crossing {
    let is_above = |point: &[f64; 2]| point[1] >= FRAC_1_SQRT_2;
    match curve.iter().position(|point| !is_above(point)) {
        Some(0) => Crossing::Before,
        Some(after) => {
            let ([a, above], [b, below]) = (curve[after - 1], curve[after]);
            Crossing::At(a + (b - a) * (above - FRAC_1_SQRT_2) / (above - below))
        }
        None => Crossing::Beyond,
    }
}

#[cfg(test)]
#[path = "bandwidth_tests.rs"]
mod tests;
