//! Exclusion angles of Sun, Moon and Earth: the smallest swept angle from which on the performance is met.
//!
//! Met at an angle: attitudes are acquired and kept with the report's probability, none is false, and the temporal noise
//! per axis across the boresight is at most the one that the plan allows. The angle itself is between the largest one at
//! which that is not so and the next: these two are the interval.

use crate::metric::{Interval, Kind, Metric};
use crate::record::{Fate, JudgedCase, Use};
use crate::{availability::tracked, noise::noise_of_case, settings::Settings, statistics::Estimate};

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
mod tests {
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
