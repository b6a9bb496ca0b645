//! Whether there is an attitude, and from which angle to a bright body on.
//!
//! Whether there is an attitude: acquisition, tracking, false solutions, loss and recovery.

use crate::metric::{Interval, Kind, Metric, Reading, Settings};
use crate::noise::noise_of_case;
use crate::record::{Fate, Judged, JudgedCase, Use};
use crate::statistics::{Estimate, confidence_of, quantile, share};

/// Cases in which nothing disturbs.
const CALM: &[Use] = &[Use::Run, Use::Inertial, Use::Drift, Use::FovGrid, Use::PixelGrid, Use::ThermoElastic];

pub(crate) const ACQUISITION: Kind = Kind {
    id: "acquisition_probability",
    unit: "share",
    reading: Reading::Ensemble,
    how: "attitudes that were found, and rightly at first, over attitudes; Clopper and Pearson",
    uses: &[Use::LostInSpace, Use::Run],
    interval: Interval::Share,
    counted: "attitudes",
    ..Kind::USUAL
};
pub(crate) const ACQUISITION_CONFIDENCE: Kind = Kind {
    id: "acquisition_confidence",
    unit: "share",
    reading: Reading::Ensemble,
    how: "confidence that the probability of acquisition is at least the report's: L = I_(1-P)(n_fail + 1, n_sim - n_fail + 1)",
    uses: &[Use::LostInSpace, Use::Run],
    interval: Interval::Confidence,
    counted: "attitudes",
    ..Kind::USUAL
};
pub(crate) const ACQUISITION_TIME: Kind = Kind {
    id: "acquisition_time",
    unit: "s",
    reading: Reading::Ensemble,
    how: "start of the first exposure to the first right attitude, where it was found, at the report's probability; order statistics",
    parts: &["at_probability"],
    uses: &[Use::LostInSpace, Use::Run],
    interval: Interval::Quantile,
    counted: "attitudes",
    ..Kind::USUAL
};
pub(crate) const ACQUISITION_MEDIAN: Kind = Kind {
    how: "the same time, that half of the attitudes need; order statistics",
    parts: &["median"],
    interval: Interval::Median,
    ..ACQUISITION_TIME
};
pub(crate) const TRACKING: Kind = Kind {
    id: "tracking_probability",
    unit: "share",
    how: "right attitudes over frames from the first right one on; Clopper and Pearson",
    uses: CALM,
    case_uses: Use::EACH_FOR_ITSELF,
    interval: Interval::Share,
    counted: "frames",
    ..Kind::USUAL
};
pub(crate) const FALSE: Kind = Kind {
    id: "false_solution_probability",
    unit: "share",
    how: "attitudes beyond the limits of a false one, over frames; Clopper and Pearson",
    uses: &Use::ALL,
    interval: Interval::Share,
    counted: "frames",
    ..Kind::USUAL
};
pub(crate) const FALSE_COUNT: Kind = Kind {
    id: "false_solutions",
    unit: "count",
    how: "attitudes beyond the limits of a false one",
    uses: &Use::ALL,
    case_uses: Use::EACH_FOR_ITSELF,
    interval: Interval::Counted,
    counted: "frames",
    ..Kind::USUAL
};
pub(crate) const LOSSES: Kind = Kind {
    id: "losses",
    unit: "count",
    reading: Reading::Temporal,
    how: "times that attitudes ceased after the first right one",
    case_uses: Use::EACH_FOR_ITSELF,
    interval: Interval::Counted,
    ..Kind::USUAL
};
pub(crate) const RECOVERY: Kind = Kind {
    id: "recovery_time",
    unit: "s",
    reading: Reading::Temporal,
    how: "length of the longest loss: from the last right attitude before it to the first after it",
    case_uses: Use::EACH_FOR_ITSELF,
    interval: Interval::Counted,
    ..Kind::USUAL
};

/// Returns acquisition of attitudes lost in space, else of the beginning of a run.
pub fn acquisition(cases: &[JudgedCase], confidence: f64, probability: f64) -> Vec<Metric> {
    let has_lost = cases.iter().any(|case| case.purpose == Use::LostInSpace);
    let wanted = if has_lost { Use::LostInSpace } else { Use::Run };
    let mut times_s = Vec::new();
    let (mut found, mut all) = (0, 0);
    for group in cases.iter().filter(|case| case.purpose == wanted).flat_map(attitudes) {
        all += 1;
        let first = group.iter().find(|frame| !matches!(frame.fate, Fate::Nothing));
        if let Some(first) = first.filter(|frame| frame.is_right()) {
            found += 1;
            times_s.push(since_start_s(&group[0], first));
        }
    }
    let mut metrics = Vec::new();
    metrics.extend(share(found, all, confidence).map(|share| ACQUISITION.of("", None, share)));
    if all > 0 {
        let value = confidence_of(probability, all - found, all);
        let exact = Estimate { value, low: value, high: value, count: all as f64 };
        metrics.push(ACQUISITION_CONFIDENCE.of("", None, exact));
    }
    for (kind, name, p) in [(ACQUISITION_MEDIAN, "median", 0.5), (ACQUISITION_TIME, "at_probability", probability)] {
        metrics.extend(quantile(&times_s, p, confidence).map(|time| kind.of(name, None, time)));
    }
    metrics
}

/// Frames of each attitude.
fn attitudes(case: &JudgedCase) -> impl Iterator<Item = &[Judged]> {
    case.frames.chunk_by(|a, b| a.truth.group == b.truth.group)
}

fn since_start_s(first: &Judged, solved: &Judged) -> f64 {
    let between_s = (solved.truth.mid_ns - first.truth.mid_ns) as f64 * 1e-9;
    between_s
        + 0.5 * (first.truth.exposure_s - solved.truth.exposure_s)
        + solved.latency_s.unwrap_or(0.5 * solved.truth.exposure_s + 0.5 * solved.truth.exposure_s)
}

/// Returns tracking of all undisturbed cases together, and false solutions of all cases.
pub fn tracking(cases: &[JudgedCase], confidence: f64) -> Vec<Metric> {
    let counts = cases.iter().filter(|case| CALM.contains(&case.purpose)).map(tracked);
    let (right, all) = counts.fold((0, 0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
    let mut found: Vec<Metric> =
        share(right, all, confidence).map(|share| TRACKING.of("", None, share)).into_iter().collect();
    let frames = cases.iter().flat_map(|case| &case.frames);
    let false_ones = frames.clone().filter(|frame| matches!(frame.fate, Fate::False(_))).count() as u64;
    found.push(FALSE_COUNT.of("", None, exactly(false_ones)));
    found.extend(share(false_ones, frames.count() as u64, confidence).map(|share| FALSE.of("", None, share)));
    found
}

/// Returns tracking, losses and recovery of one case.
pub fn tracking_of_case(case: &JudgedCase, confidence: f64) -> Vec<Metric> {
    let name = Some(case.name.as_str());
    let (right, all) = tracked(case);
    let mut found: Vec<Metric> =
        share(right, all, confidence).map(|share| TRACKING.of("", name, share)).into_iter().collect();
    let gaps = gaps_s(case);
    found.push(LOSSES.of("", name, exactly(gaps.len() as u64)));
    let longest = gaps.iter().flatten().copied().reduce(f64::max);
    found.extend(longest.map(|value| RECOVERY.of("", name, Estimate { value, low: value, high: value, count: 1.0 })));
    let false_ones = case.frames.iter().filter(|frame| matches!(frame.fate, Fate::False(_))).count() as u64;
    found.push(FALSE_COUNT.of("", name, exactly(false_ones)));
    found
}

fn exactly(count: u64) -> Estimate {
    let value = count as f64;
    Estimate { value, low: value, high: value, count: value }
}

/// Right attitudes and frames from the first right one of each attitude on; all frames where there is none.
pub(crate) fn tracked(case: &JudgedCase) -> (u64, u64) {
    let mut sum = (0, 0);
    for group in attitudes(case) {
        let first = group.iter().position(Judged::is_right);
        let from = &group[first.unwrap_or(0)..];
        sum.0 += from.iter().filter(|frame| frame.is_right()).count() as u64;
        sum.1 += from.len() as u64;
    }
    sum
}

/// Lengths of the times without a right attitude after the first one; `None`: it did not end.
fn gaps_s(case: &JudgedCase) -> Vec<Option<f64>> {
    let mut gaps = Vec::new();
    for group in attitudes(case) {
        let mut last: Option<&Judged> = None;
        let mut is_lost = false;
        for frame in group {
            match (frame.is_right(), last) {
                (true, Some(before)) if is_lost => {
                    gaps.push(Some((frame.truth.mid_ns - before.truth.mid_ns) as f64 * 1e-9));
                    is_lost = false;
                    last = Some(frame);
                }
                (true, _) => last = Some(frame),
                (false, Some(_)) => is_lost = true,
                (false, None) => {}
            }
        }
        if is_lost {
            gaps.push(None);
        }
    }
    gaps
}

// Exclusion angles of Sun, Moon and Earth: the smallest swept angle from which on the performance is met.
//
// Met at an angle: attitudes are acquired and kept with the report's probability, none is false, and the temporal noise
// per axis across the boresight is at most the one that the plan allows. The angle itself is between the largest one at
// which that is not so and the next: these two are the interval.

/// Key of the angle from the boresight to the Sun's centre among the conditions of a case.
pub const SUN_ANGLE: &str = "sun_angle_deg";
/// Key of the angle from the boresight to the Moon's centre.
pub const MOON_ANGLE: &str = "moon_angle_deg";
/// Key of the angle from the boresight to the Earth's limb.
pub const EARTH_LIMB_ANGLE: &str = "earth_limb_angle_deg";

/// Fewest angles of a sweep.
const FEWEST: usize = 2;

const HOW: &str = "smallest swept angle from which on the share of frames with an attitude is at least the report's probability, \
                   none is false, and the noise is at most the plan's: of the frames flown, not by an interval of confidence; \
                   low is the largest angle that fails";

const fn kind(id: &'static str) -> Kind {
    let (interval, counted) = (Interval::Sweep, "angles");
    Kind { id, unit: "deg", how: HOW, uses: &[Use::Stress], interval, counted, ..Kind::USUAL }
}

/// Bodies by the key of their angle.
pub(crate) const KINDS: [(&str, Kind); 3] = [
    (SUN_ANGLE, kind("sun_exclusion_angle")),
    (MOON_ANGLE, kind("moon_exclusion_angle")),
    (EARTH_LIMB_ANGLE, kind("earth_exclusion_angle")),
];

/// Returns the exclusion angles of the bodies whose angles were swept: Sun and Moon from their centres, the Earth from
/// its limb.
pub fn exclusion_angles(cases: &[JudgedCase], settings: &Settings) -> Vec<Metric> {
    let of = |(key, kind): &(&str, Kind)| {
        let swept = cases.iter().filter(|case| case.purpose == Use::Stress);
        let mut swept: Vec<(f64, &JudgedCase)> =
            swept.filter_map(|case| Some((*case.conditions.get(*key)?, case))).collect();
        swept.sort_by(|a, b| a.0.total_cmp(&b.0));
        Some(kind.of("", None, smallest(&swept, settings)?))
    };
    KINDS.iter().filter_map(of).collect()
}

/// The smallest angle from which on all are met; no upper end where the largest is not.
fn smallest(swept: &[(f64, &JudgedCase)], settings: &Settings) -> Option<Estimate> {
    let (largest, _) = swept.last().filter(|_| swept.len() >= FEWEST)?;
    let failing = swept.iter().rposition(|(_, case)| !is_met(case, settings));
    let low = failing.map_or(0.0, |place| swept[place].0);
    let from = swept.get(failing.map_or(0, |place| place + 1)).map(|(angle, _)| *angle);
    let count = swept.len() as f64;
    Some(match from {
        Some(value) => Estimate { value, low, high: value, count },
        None => Estimate { value: *largest, low, high: f64::INFINITY, count },
    })
}

fn is_met(case: &JudgedCase, settings: &Settings) -> bool {
    let (right, all) = tracked(case);
    let is_kept = all > 0 && right as f64 >= settings.probability * all as f64;
    let has_false = case.frames.iter().any(|frame| matches!(frame.fate, Fate::False(_)));
    let is_quiet =
        settings.exclusion_noise_arcsec.is_none_or(|most| noise(case, settings).is_some_and(|it| it <= most));
    is_kept && !has_false && is_quiet
}

fn noise(case: &JudgedCase, settings: &Settings) -> Option<f64> {
    let found = noise_of_case(case, settings.confidence);
    found.iter().find(|metric| metric.id == "temporal_noise.directional_per_axis").map(|metric| metric.value)
}

#[cfg(test)]
mod availability_tests {
    use super::*;
    use crate::synthetic::{Frame, judged};
    use glam::DVec3;

    /// A letter for each frame: r right, f false, - nothing; a blank begins another attitude.
    fn frames(letters: &str) -> Vec<Frame> {
        let mut group = 0;
        let mut frames = Vec::new();
        for (i, letter) in letters.chars().enumerate() {
            let error = match letter {
                'r' => Some(DVec3::ONE),
                'f' => Some(DVec3::X * 5000.0),
                '-' => None,
                _ => {
                    group += 1;
                    continue;
                }
            };
            let rate_rad_s = DVec3::ZERO;
            frames.push(Frame { t_s: 0.5 * i as f64, group, rate_rad_s, error_arcsec: error, tag_s: 0.0 });
        }
        frames
    }

    fn value(metrics: &[Metric], id: &str) -> f64 {
        metrics.iter().find(|metric| metric.id == id).unwrap().value
    }

    #[test]
    fn an_attitude_is_acquired_when_its_first_answer_is_right() {
        let case = judged(Use::LostInSpace, &frames("r -r --r fr --- rr"));
        let found = acquisition(&[case], 0.95, 0.9);
        assert!((value(&found, "acquisition_probability") - 4.0 / 6.0).abs() < 1e-12);
        // By hand: more than two failures in seven trials at 10 %.
        let few: f64 = (0..=2).map(|k| [1.0, 7.0, 21.0][k] * 0.1_f64.powi(k as i32) * 0.9_f64.powi(7 - k as i32)).sum();
        assert!((value(&found, "acquisition_confidence") - (1.0 - few)).abs() < 1e-9);
        // 0.3 s after the start of its exposure, and 0, 0, 1 or 2 frames of 0.5 s later.
        assert!((value(&found, "acquisition_time.median") - 0.3).abs() < 1e-9);
        assert!((value(&found, "acquisition_time.at_probability") - 1.3).abs() < 1e-9);
    }

    #[test]
    fn tracking_counts_from_the_first_right_attitude() {
        let cases = [judged(Use::Inertial, &frames("--rr-r r--- ---"))];
        let found = tracking(&cases, 0.95);
        assert!((value(&found, "tracking_probability") - 4.0 / 11.0).abs() < 1e-12, "{found:?}");
        assert_eq!(value(&found, "false_solutions"), 0.0);
        let with_false = tracking(&[judged(Use::Stress, &frames("rrfrf"))], 0.95);
        assert_eq!(value(&with_false, "false_solutions"), 2.0);
        assert!((value(&with_false, "false_solution_probability") - 0.4).abs() < 1e-12);
    }

    #[test]
    fn losses_and_the_longest_recovery_are_found() {
        let found = tracking_of_case(&judged(Use::Stress, &frames("-rr-rr----rr--")), 0.95);
        assert_eq!(value(&found, "losses"), 3.0, "the last one does not end");
        assert!((value(&found, "recovery_time") - 2.5).abs() < 1e-9);
        let calm = tracking_of_case(&judged(Use::Stress, &frames("rrrr")), 0.95);
        assert_eq!(value(&calm, "losses"), 0.0);
        assert!(calm.iter().all(|metric| metric.id != "recovery_time"));
    }
}

#[cfg(test)]
mod exclusion_tests {
    use super::*;
    use crate::synthetic::{Dice, Frame, judged};
    use glam::DVec3;

    /// A case of three attitudes at an angle, with this noise and so many frames without an attitude.
    fn at(key: &str, angle_deg: f64, noise: f64, missing: usize) -> JudgedCase {
        let mut dice = Dice::new(angle_deg.to_bits());
        let mut frames: Vec<Frame> =
            (0..60).map(|i| Frame::still(f64::from(i), i / 20, noise * dice.normals())).collect();
        frames.iter_mut().skip(5).take(missing).for_each(|frame| frame.error_arcsec = None);
        let mut case = judged(Use::Stress, &frames);
        case.conditions.insert(key.into(), angle_deg);
        case
    }

    fn angle(cases: &[JudgedCase], id: &str) -> Option<[Option<f64>; 3]> {
        let settings = Settings { exclusion_noise_arcsec: Some(2.0), ..Settings::default() };
        let found = exclusion_angles(cases, &settings);
        found.iter().find(|m| m.id == id).map(|m| [Some(m.low), Some(m.value), m.high])
    }

    #[test]
    fn the_angle_is_between_the_last_that_fails_and_the_next() {
        let sweep = |key: &str, bad: [(f64, usize); 4]| -> Vec<JudgedCase> {
            let angles = [40.0, 10.0, 30.0, 20.0];
            angles.iter().zip(bad).map(|(angle, (noise, missing))| at(key, *angle, noise, missing)).collect()
        };
        let good = (1.0, 0);
        let lost = sweep(SUN_ANGLE, [good, (1.0, 3), good, (1.0, 1)]);
        assert_eq!(angle(&lost, "sun_exclusion_angle"), Some([Some(20.0), Some(30.0), Some(30.0)]));
        let noisy = sweep(MOON_ANGLE, [good, (5.0, 0), (4.0, 0), good]);
        let wanted = Some([Some(30.0), Some(40.0), Some(40.0)]);
        assert_eq!(angle(&noisy, "moon_exclusion_angle"), wanted, "a smaller angle that passes does not count");
        let never = sweep(EARTH_LIMB_ANGLE, [(1.0, 9), good, good, good]);
        assert_eq!(angle(&never, "earth_exclusion_angle"), Some([Some(40.0), Some(40.0), None]), "not bounded");
        let unlimited = exclusion_angles(&noisy, &Settings::default());
        assert_eq!(unlimited[0].low, 0.0, "without a limit noise does not count");
        let always = sweep(SUN_ANGLE, [good; 4]);
        assert_eq!(angle(&always, "sun_exclusion_angle"), Some([Some(0.0), Some(10.0), Some(10.0)]));
        // Controls: another body, another use, and one angle only.
        assert_eq!(angle(&always, "moon_exclusion_angle"), None);
        let mut other = sweep(SUN_ANGLE, [good; 4]);
        other.iter_mut().for_each(|case| case.purpose = Use::Inertial);
        assert_eq!(angle(&other, "sun_exclusion_angle"), None);
        assert_eq!(angle(&[at(SUN_ANGLE, 30.0, 1.0, 0)], "sun_exclusion_angle"), None);
    }

    #[test]
    fn a_false_attitude_breaks_an_angle() {
        let mut cases = vec![at(SUN_ANGLE, 20.0, 1.0, 0), at(SUN_ANGLE, 30.0, 1.0, 0)];
        cases[0].frames[7].fate = Fate::False(DVec3::X);
        // Of 60 frames one is not right: the probability is not kept either; at 90 % only the false one counts.
        let settings = Settings { probability: 0.9, ..Settings::default() };
        assert_eq!(exclusion_angles(&cases, &settings)[0].low, 20.0);
        cases[0].frames[7].fate = Fate::Nothing;
        assert_eq!(exclusion_angles(&cases, &settings)[0].low, 0.0);
    }
}
