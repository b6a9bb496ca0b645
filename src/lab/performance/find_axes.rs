//! The constant turn between a tracker's axes and the sensor's, from its answers and the truth.
//!
//! Each solution gives a turn `sensor_from_icrf * icrf_from_tracker`. The found one is the turn with which most
//! others agree, then the mean of these: within the limits of a false solution, and within five
//! deviations of their own spread, so that wrong identifications have no part. It is constant where more than half of all
//! solutions agree, by a one-sided test of their share (Clopper and Pearson). Solutions at one attitude, or about one
//! axis, agree with wrong senses and signs too: they are refused.

use crate::log_form::Axes;
use crate::record::{FalseLimit, Judged, JudgedCase, attitude_error, directional, turned};
use crate::statistics::share;
use anyhow::{Result, bail};
use base::units::{ARCSEC, DEG};
use glam::{DQuat, DVec3};

/// Most candidates for the turn that is nearest to the others, and most turns that each is compared with.
const CANDIDATES: usize = 100;
const COMPARED: usize = 1000;
/// Standard deviations beyond which a turn has no part in the mean.
const CLIP: f64 = 5.0;
/// The standard deviation of normal numbers over the median of their magnitude.
const SIGMA_OF_MEDIAN: f64 = 1.4826;
/// Rounds of clipping; the mean stays after a few.
const ROUNDS: usize = 10;
/// Share of the solutions that must be shown to agree.
const LEAST_SHARE: f64 = 0.5;
/// Least difference of the attitudes, about one axis and across it, deg.
const LEAST_VARIED_DEG: f64 = 1.0;

/// A constant turn that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundAxes {
    /// The turn.
    pub axes: Axes,
    /// Solutions, and those that agree with it.
    pub solutions: usize,
    /// Those that agree with it.
    pub agreeing: usize,
    /// Robust standard deviation of those about the sensor's axes, arcsec.
    pub spread_arcsec: DVec3,
    /// The signed map of axes that is nearest to it.
    pub map: String,
    /// Angle between the two, arcsec.
    pub off_map_arcsec: f64,
    /// The map is within the limits of a false solution.
    pub is_map: bool,
}

/// A turn, and the error of each solution's turn from it.
struct Fit {
    turn: DQuat,
    errors: Vec<DVec3>,
    agreeing: Vec<DVec3>,
    is_shown: bool,
}

/// Finds the turn of cases whose logs are in the tracker's own axes; `confidence` is that of the test.
///
/// # Errors
/// When it is not constant, or the attitudes do not show it.
pub fn find_axes(cases: &[JudgedCase], limit: &FalseLimit, confidence: f64) -> Result<FoundAxes> {
    let solved = cases.iter().flat_map(|case| &case.frames).filter_map(solved);
    let (truths, turns): (Vec<DQuat>, Vec<DQuat>) = solved.unzip();
    if turns.is_empty() {
        bail!("axes: no frame has a solution; wanted some");
    }
    let fit = Fit::of(&turns, limit, confidence);
    if !fit.is_shown {
        let half_deg = median(fit.errors.iter().map(|error| error.length()).collect()) / DEG;
        // The conjugate of each answer: truth * (truth^-1 * turn)^-1 has the tracker's quaternion on the other side.
        let conjugates: Vec<DQuat> =
            truths.iter().zip(&turns).map(|(truth, turn)| *truth * turn.conjugate() * *truth).collect();
        let advice = if Fit::of(&conjugates, limit, confidence).is_shown {
            "the conjugates of its quaternions do: write # sense: icrf_from_sensor before the rows"
        } else {
            "check the sense of its quaternions, the convention of its roll, the numbers of frames and its false solutions"
        };
        bail!(
            "axes: the turn is not constant: {} of {} solutions agree within {} arcsec across the boresight and {} about it, \
             wanted more than half with a confidence of {confidence}; half of them are {half_deg:.3} deg and more off; {advice}",
            fit.agreeing.len(),
            turns.len(),
            limit.directional_arcsec,
            limit.rotational_arcsec,
        );
    }
    check_variety(&truths)?;
    let spread = |axis: usize| robust_sigma(&fit.agreeing, axis) / ARCSEC;
    let off = |axes: &Axes| attitude_error(fit.turn, axes.quat());
    let maps = Axes::maps().min_by(|(_, one), (_, other)| off(one).length().total_cmp(&off(other).length()));
    let (map, axes) = maps.unwrap_or_else(|| (String::new(), Axes::of(DQuat::IDENTITY)));
    Ok(FoundAxes {
        axes: Axes::of(fit.turn),
        solutions: turns.len(),
        agreeing: fit.agreeing.len(),
        spread_arcsec: DVec3::new(spread(0), spread(1), spread(2)),
        map,
        off_map_arcsec: off(&axes).length() / ARCSEC,
        is_map: is_within(off(&axes), limit),
    })
}

/// The true attitude at the time that a solution states, and its turn from the tracker's axes.
fn solved(frame: &Judged) -> Option<(DQuat, DQuat)> {
    let error = frame.any_error_rad().filter(|error| error.is_finite())?;
    let stated = turned(frame.truth.attitude, frame.truth.rate_rad_s * frame.tag_error_s.unwrap_or(0.0));
    let tracker_from_icrf = turned(stated, error);
    Some((stated, (stated * tracker_from_icrf.conjugate()).normalize()))
}

impl Fit {
    fn of(turns: &[DQuat], limit: &FalseLimit, confidence: f64) -> Self {
        let some = |most: usize| turns.iter().step_by(turns.len().div_ceil(most));
        let rated = some(CANDIDATES).map(|turn| {
            let errors: Vec<DVec3> = some(COMPARED).map(|other| attitude_error(*other, *turn)).collect();
            let off = median(errors.iter().map(|error| error.length()).collect());
            (Self::near(&errors, limit).len(), off, *turn)
        });
        // Most of them agree, or, where none does, the half of them is nearest.
        let central = rated.max_by(|one, other| one.0.cmp(&other.0).then(other.1.total_cmp(&one.1)));
        let mut turn = central.map_or(DQuat::IDENTITY, |(_, _, turn)| turn);
        for _ in 0..ROUNDS {
            let near = Self::near(&Self::errors(turns, turn), limit);
            let sigma = [0, 1, 2].map(|axis| robust_sigma(&near, axis).max(1e-12));
            let is_kept =
                |error: &&DVec3| sigma.iter().enumerate().all(|(axis, sigma)| error[axis].abs() <= CLIP * sigma);
            let kept: Vec<DVec3> = near.iter().filter(is_kept).copied().collect();
            if kept.is_empty() {
                break;
            }
            turn = turned(turn, kept.iter().sum::<DVec3>() / kept.len() as f64);
        }
        let errors = Self::errors(turns, turn);
        let agreeing = Self::near(&errors, limit);
        // One side only: the tail that `share` halves is the whole of it.
        let low = share(agreeing.len() as u64, errors.len() as u64, 2.0 * confidence - 1.0).map(|share| share.low);
        Self { turn, is_shown: low.is_some_and(|low| low > LEAST_SHARE), errors, agreeing }
    }

    fn errors(turns: &[DQuat], from: DQuat) -> Vec<DVec3> {
        turns.iter().map(|turn| attitude_error(*turn, from)).collect()
    }

    fn near(errors: &[DVec3], limit: &FalseLimit) -> Vec<DVec3> {
        errors.iter().filter(|error| is_within(**error, limit)).copied().collect()
    }
}

fn is_within(error: DVec3, limit: &FalseLimit) -> bool {
    directional(error) <= limit.directional_arcsec * ARCSEC && error.z.abs() <= limit.rotational_arcsec * ARCSEC
}

/// Refuses attitudes that differ about one axis only, or not at all.
fn check_variety(truths: &[DQuat]) -> Result<()> {
    let first = truths.first().copied().unwrap_or_default();
    let turns: Vec<DVec3> = truths.iter().map(|truth| attitude_error(*truth, first)).collect();
    let longest =
        turns.iter().copied().max_by(|one, other| one.length().total_cmp(&other.length())).unwrap_or_default();
    let along = longest.normalize_or_zero();
    let across = turns.iter().map(|turn| turn.reject_from_normalized(along).length()).fold(0.0, f64::max);
    let [about_one_deg, across_deg] = [longest.length() / DEG, across / DEG];
    if about_one_deg < LEAST_VARIED_DEG || across_deg < LEAST_VARIED_DEG {
        bail!(
            "axes: the attitudes differ by {about_one_deg:.3} deg about one axis and {across_deg:.3} deg across it, wanted \
             {LEAST_VARIED_DEG} deg each: a wrong sense or sign can look constant otherwise; take a run or plan with more attitudes"
        );
    }
    Ok(())
}

fn robust_sigma(errors: &[DVec3], axis: usize) -> f64 {
    SIGMA_OF_MEDIAN * median(errors.iter().map(|error| error[axis].abs()).collect())
}

/// The middle one of values in their order; 0 without any.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Case, Use};
    use crate::synthetic::{Dice, Frame, LIMIT, case};

    const SIGMA_ARCSEC: f64 = 10.0;
    const CONFIDENCE: f64 = 0.95;

    /// Sixty attitudes with noise, `false_ones` of them wrong.
    fn noisy(false_ones: u32) -> Case {
        let mut dice = Dice::new(7);
        let frame = |number: u32| {
            let far = if number % 60 < false_ones { 1e5 * f64::from(number + 1) } else { 0.0 };
            Frame::still(f64::from(number), number, dice.normals() * SIGMA_ARCSEC + DVec3::new(far, 0.3 * far, 0.0))
        };
        let mut made = case(Use::LostInSpace, &(0..60).map(frame).collect::<Vec<_>>());
        // Attitudes of the made-up case turn about one axis: let every second one be tilted.
        for (number, (truth, row)) in made.truth.iter_mut().zip(&mut made.log).enumerate() {
            let tilt = DQuat::from_rotation_x(if number % 2 == 0 { 0.0 } else { 0.3 });
            row.attitude = row.attitude.map(|attitude| attitude * truth.attitude.conjugate() * tilt * truth.attitude);
            truth.attitude = tilt * truth.attitude;
        }
        made
    }

    fn found(case: &Case) -> Result<FoundAxes> {
        find_axes(&[case.judged(&LIMIT)], &LIMIT, CONFIDENCE)
    }

    fn with(mut case: Case, change: impl Fn(DQuat) -> DQuat) -> Case {
        case.log.iter_mut().for_each(|row| row.attitude = row.attitude.map(&change));
        case
    }

    #[test]
    fn the_turn_of_a_tracker_with_own_axes_is_found_among_false_solutions() {
        for false_ones in [0, 15] {
            let axes: Axes = "-y -z x".parse().unwrap();
            let bias = DVec3::new(40.0, -25.0, 300.0) * ARCSEC;
            let turn = turned(axes.quat(), bias);
            let got = found(&with(noisy(false_ones), |q| turn.conjugate() * q)).unwrap();
            let off = attitude_error(got.axes.quat(), turn) / ARCSEC;
            assert!(off.length() < 5.0 * SIGMA_ARCSEC / 45_f64.sqrt(), "{false_ones}: {off}");
            assert_eq!((got.map.as_str(), got.is_map), ("-y -z x", true));
            assert!((got.off_map_arcsec - bias.length() / ARCSEC).abs() < 10.0, "{}", got.off_map_arcsec);
            assert_eq!((got.solutions, got.agreeing), (60, 60 - false_ones as usize));
            let spread = got.spread_arcsec / SIGMA_ARCSEC;
            assert!(spread.min_element() > 0.6 && spread.max_element() < 1.5, "{spread}");
        }
    }

    #[test]
    fn a_turn_that_is_not_constant_is_refused_with_its_spread() {
        let refused = |case: Case| found(&case).unwrap_err().to_string();
        let conjugate = refused(with(noisy(0), DQuat::conjugate));
        assert!(conjugate.contains("not constant") && conjugate.contains("# sense: icrf_from_sensor"), "{conjugate}");
        let mostly_false = refused(noisy(40));
        assert!(
            mostly_false.contains("20 of 60 solutions agree") && mostly_false.contains("false solutions"),
            "{mostly_false}"
        );
        // Half and a few: not shown by so few.
        assert!(refused(noisy(27)).contains("33 of 60"));
        let mut few = noisy(0);
        few.log.truncate(4);
        assert!(refused(few).contains("4 of 4"), "four cannot show it");
    }

    #[test]
    fn attitudes_about_one_axis_are_refused() {
        let still: Vec<Frame> = (0..9).map(|number| Frame::still(f64::from(number), 0, DVec3::ZERO)).collect();
        let refused = found(&case(Use::Run, &still)).unwrap_err().to_string();
        assert!(refused.contains("0.000 deg about one axis"), "{refused}");
        let about_one: Vec<Frame> = (0..9).map(|number| Frame::still(f64::from(number), number, DVec3::ZERO)).collect();
        assert!(found(&case(Use::Run, &about_one)).unwrap_err().to_string().contains("0.000 deg across it"));
        assert!(found(&noisy(0)).is_ok(), "control");
    }
}
