//! Temporal noise, and the bandwidth of the output.
//!
//! Temporal noise: what changes from frame to frame, and the noise equivalent angle.
//!
//! Of inertial attitudes: the variance within attitudes. Of runs in motion: half of the mean square of successive
//! differences (von Neumann et al. 1941), which slow errors hardly touch.

use crate::bias::groups;
use crate::metric::{AXES, Interval, Kind, Metric, Reading};
use crate::record::{JudgedCase, Use, attitude_error};
use crate::statistics::{Estimate, normal_quantile, sigma, t_quantile};
use base::units::ARCSEC;
use core::f64::consts::{FRAC_1_SQRT_2, TAU};
use glam::{DMat3, DVec3};

/// Parts of the identifiers: the axes, and the root mean square of both across the boresight.
const PARTS: &[&str] = &["x", "y", "rotational", "directional_per_axis"];
/// Cases of attitudes at rest, several frames each.
const STILL: &[Use] = &[Use::Inertial, Use::FovGrid, Use::PixelGrid];

pub(crate) const INERTIAL: Kind = Kind {
    id: "temporal_noise",
    how: "1 sigma: variance within attitudes, all attitudes together; chi-square",
    parts: PARTS,
    uses: STILL,
    ..Kind::USUAL
};
pub(crate) const SUCCESSIVE: Kind = Kind {
    id: "temporal_noise",
    reading: Reading::Temporal,
    how: "1 sigma: mean square of successive differences over 2; chi-square",
    parts: PARTS,
    uses: &[Use::Run, Use::Drift],
    case_uses: Use::EACH_FOR_ITSELF,
    ..Kind::USUAL
};
pub(crate) const NEA: Kind = Kind {
    id: "noise_equivalent_angle",
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

// Measured output bandwidth: sines of the line of sight, and how much of them the output follows.
//
// At each frequency `c + a sin(2 pi f t) + b cos(2 pi f t)` is fitted by least squares to the true and to the measured
// turn about the axis of the motion. The ratio of the amplitudes falls with the frequency; where it crosses 1 / sqrt 2,
// by a straight line between two frequencies, is the bandwidth. Frequencies above half of the frame rate are folded,
// but known: they can be fitted unless they are a multiple of half of the frame rate. An exposure of `T` alone gives
// `|sin(pi f T) / (pi f T)|`, and a bandwidth of `0.443 / T`.

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
mod noise_tests {
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

#[cfg(test)]
mod bandwidth_tests {
    use super::*;
    use crate::record::turned;
    use crate::synthetic::{Dice, Frame, judged};
    use base::units::ARCSEC;
    use core::f64::consts::PI;

    const EXPOSURE_S: f64 = 0.1;
    const FRAME_S: f64 = 0.2;

    fn sinc(x: f64) -> f64 {
        (PI * x).sin() / (PI * x)
    }

    /// A tracker behind an exposure: `response` of the sine and noise, at each frequency.
    fn flown(response: impl Fn(f64) -> f64, noise: f64, frequencies: &[f64]) -> Vec<JudgedCase> {
        let mut dice = Dice::new(6);
        let axis = DVec3::new(0.8, 0.6, 0.0);
        let amplitude = 60.0;
        let of = |hz: &f64| {
            let sine = |i: u32| amplitude * (TAU * hz * FRAME_S * f64::from(i)).sin();
            let frames: Vec<Frame> = (0..80)
                .map(|i| {
                    let error = axis * sine(i) * (response(*hz) - 1.0) + noise * dice.normals();
                    Frame::still(FRAME_S * f64::from(i), 0, error)
                })
                .collect();
            let mut case = judged(Use::Bandwidth, &frames);
            // The truth moves; errors are as they were.
            let still = case.frames[0].truth.attitude;
            for (i, frame) in (0..).zip(&mut case.frames) {
                frame.truth.attitude = turned(still, axis * (sine(i) * ARCSEC));
            }
            case.name = format!("sine {hz}");
            case.conditions.insert(SINE.into(), *hz);
            case
        };
        frequencies.iter().map(of).collect()
    }

    const FREQUENCIES: [f64; 8] = [6.3, 1.1, 2.3, 3.1, 3.9, 4.3, 4.7, 5.3];

    fn found(cases: &[JudgedCase]) -> Metric {
        bandwidth(cases, 0.99).pop().unwrap()
    }

    #[test]
    fn an_exposure_alone_gives_its_sinc() {
        let cases = flown(|hz| sinc(hz * EXPOSURE_S), 1.0, &FREQUENCIES);
        let metric = found(&cases);
        assert!((metric.low..=metric.high.unwrap()).contains(&(0.443 / EXPOSURE_S)), "{metric:?}");
        assert!((metric.value - 4.43).abs() < 0.1, "{metric:?}");
        for case in &cases {
            let (ratio, wanted) = (ratio_of_case(case, 0.999).unwrap(), sinc(case.conditions[SINE] * EXPOSURE_S));
            assert!((ratio.low..=ratio.high.unwrap()).contains(&wanted), "{wanted}: {ratio:?}");
        }
        // Controls: an exposure of half the length, and a tracker that follows everything.
        let shorter = found(&flown(|hz| sinc(0.5 * hz * EXPOSURE_S), 1.0, &FREQUENCIES));
        assert!(shorter.value == 6.3 && shorter.high.is_none(), "{shorter:?}");
        assert!(found(&flown(|_| 1.0, 1.0, &FREQUENCIES)).high.is_none());
    }

    /// Error of straight lines between the frequencies, which remains without noise.
    #[test]
    fn a_straight_line_between_frequencies_is_good_to_a_hundredth() {
        let metric = found(&flown(|hz| sinc(hz * EXPOSURE_S), 1e-6, &FREQUENCIES));
        assert!((metric.value - 4.4295).abs() < 0.01, "{metric:?}");
        let coarse = found(&flown(|hz| sinc(hz * EXPOSURE_S), 1e-6, &[1.1, 8.1]));
        assert!((coarse.value - 4.4295).abs() > 0.1, "beyond it, on a coarse grid: {coarse:?}");
    }

    #[test]
    fn a_sine_that_is_folded_onto_nothing_is_left_out() {
        // Multiples of half of the frame rate of 5 Hz.
        assert!(ratio_of_case(&flown(|_| 1.0, 1.0, &[5.0])[0], 0.95).is_none());
        assert!(ratio_of_case(&flown(|_| 1.0, 1.0, &[2.5])[0], 0.95).is_none());
        let mut other = flown(|_| 1.0, 1.0, &[2.3]);
        assert!(ratio_of_case(&other[0], 0.95).is_some());
        other[0].purpose = Use::Stress;
        assert!(ratio_of_case(&other[0], 0.95).is_none(), "flown for something else");
    }

    #[test]
    fn a_curve_that_begins_below_has_no_lower_end() {
        let metric = found(&flown(|_| 0.5, 0.5, &[1.1, 2.3, 3.1]));
        assert!(metric.low == 0.0 && metric.value == 1.1, "{metric:?}");
    }
}
