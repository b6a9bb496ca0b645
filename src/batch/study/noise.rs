//! Pointing error at rest against latency, and the effect of wrong time tags in a turn.

use super::frequency::Latency;
use super::point::{LARGEST_ERROR, POINTING_ERROR, StudyPoint, TAG, TAG_ERROR};
use super::theory::{noise_of, taken_over};
use super::trial::{Injection, QUIET_S, Sample, Trace, at_rest, fly};
use super::{Study, rounded_to};
use base::time::Span;
use base::units::{ARCSEC, DEG};
use config::{Action, Event, Pointing};
use glam::DVec3;
use run::wiring::error::LoopError;

/// Tolerance of a pointing error, as a share: two axes of noise within about 0.05 Hz over one record of 600 s are 120
/// independent values, whose rms scatters by 6.5 %; three sigmas. Points share their seeds, and so their scatter.
pub const POINTING_SHARE: f64 = 0.2;
/// Tolerance of the estimate's lag in a turn, as a share: noise of the tracker (1 arcsec over a window of 20 s)
/// relative to 14 arcsec for 20 ms.
pub const TAG_SHARE: f64 = 0.05;

/// Time until the gyro's bias is known to the steady state, s.
const BIAS_SETTLING_S: f64 = 170.0;
/// Rate of the turn, rad/s: 0.25 pixels of 283 arcsec in an exposure of 0.1 s.
const TURN_RAD_S: f64 = 0.2 * DEG;
/// The turn, deg.
const TURN_DEG: f64 = 25.0;
/// Start of the turn, s after the first exposure.
const TURN_AT_S: f64 = 60.0;
/// Window at the end of the constant rate that is evaluated, s.
const TURN_WINDOW_S: f64 = 20.0;
/// Time in which a loop beyond its margin must have lost its target, s.
const LOSING_S: f64 = 400.0;

/// Measures the rms of the boresight's direction with this latency, all seeds together.
pub(super) fn pointing_error(study: &Study, latency: Latency) -> Result<Vec<StudyPoint>, LoopError> {
    let window_s = rounded_to(study.control_period_s, study.effort.noise_s);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some thousands")]
    let count = (window_s / study.control_period_s).round() as usize;
    let head = study.head();
    let (mut variance, mut nea_square) = (0.0, 0.0);
    for seed in 0..study.effort.seeds {
        let injection = Injection { seed, ..latency.injected() };
        let trace = fly(&at_rest(&study.scenario, QUIET_S + BIAS_SETTLING_S + window_s, window_s, &injection))?;
        variance += trace.last(count).map_or(f64::NAN, |samples| variance_across(samples, head));
        nea_square += trace.nea_rad.unwrap_or(f64::NAN).powi(2);
    }
    let seeds = study.effort.seeds as f64;
    let measured = (variance / seeds).sqrt();
    let mut vehicle = study.vehicle.clone();
    if let Latency::Tracker(s) = latency {
        vehicle.heads.iter_mut().for_each(|head| head.delay = Span::from_s(s));
    }
    let noise = noise_of(&vehicle, (nea_square / seeds).sqrt(), study.frame_period_s, study.frame_latency_s);
    let predicted = core::f64::consts::SQRT_2 * latency.on_paper(&study.paper).pointing_sigma_rad(&noise);
    let got = [measured / ARCSEC, predicted / ARCSEC];
    Ok(vec![StudyPoint::judged(POINTING_ERROR, latency.varied(), got, POINTING_SHARE * got[1])])
}

/// Returns the variance of the boresight's direction about its mean, two axes together, rad^2.
fn variance_across(samples: &[Sample], head: glam::DQuat) -> f64 {
    let count = samples.len() as f64;
    let seen = || samples.iter().map(|sample| (head * sample.error_rad).truncate());
    let mean = seen().sum::<glam::DVec2>() / count;
    seen().map(|error| (error - mean).length_squared()).sum::<f64>() / count
}

/// Measures the lag of the estimate in a steady turn caused by wrong time tags. The same turn with true tags is
/// subtracted, which removes the gyro's errors.
pub(super) fn tag_error(study: &Study, tag_s: f64) -> Result<Vec<StudyPoint>, LoopError> {
    let wrong = turning(study, tag_s)?;
    let right = turning(study, 0.0)?;
    let fastest = right.samples.iter().map(|sample| sample.rate_rad_s.length()).fold(0.0, f64::max);
    let is_steady = |sample: &&Sample| sample.rate_rad_s.length() > 0.995 * fastest;
    let end_s = right.samples.iter().rfind(is_steady).map_or(0.0, |sample| sample.t_s);
    let in_window = |sample: &Sample| sample.t_s > end_s - TURN_WINDOW_S && sample.t_s <= end_s;
    let (mut behind, mut rate, mut count) = (0.0, DVec3::ZERO, 0.0);
    for (wrong, right) in wrong.samples.iter().zip(&right.samples).filter(|(_, right)| in_window(right)) {
        let along = right.rate_rad_s.normalize_or_zero();
        behind -= (wrong.knowledge_rad - right.knowledge_rad).dot(along);
        rate += right.rate_rad_s;
        count += 1.0;
    }
    let nea_rad = right.nea_rad.unwrap_or(f64::NAN);
    let noise = noise_of(&study.vehicle, nea_rad, study.frame_period_s, study.frame_latency_s);
    let begun_s = end_s - TURN_AT_S - 0.5 * (TURN_WINDOW_S + TURN_RAD_S / study.slew_acceleration_rad_s2());
    let predicted = (rate / count).length() * tag_s * taken_over(&noise, begun_s);
    let got = [behind / count / ARCSEC, predicted / ARCSEC];
    Ok(vec![StudyPoint::judged(TAG_ERROR, (TAG, tag_s * 1e3), got, TAG_SHARE * got[1].abs())])
}

fn turning(study: &Study, tag_s: f64) -> Result<Trace, LoopError> {
    let injection = Injection { tag_error: Span::from_s(tag_s), ..Injection::NONE };
    let duration_s = TURN_AT_S + TURN_DEG * DEG / TURN_RAD_S;
    let mut scenario = at_rest(&study.scenario, duration_s, duration_s - TURN_AT_S, &injection);
    let vehicle = scenario.vehicle_mut().ok_or(LoopError::NothingFlown)?;
    vehicle.spacecraft.control.slew_rate_rad_s = TURN_RAD_S;
    let up = if vehicle.target.dec_deg > 0.0 { -TURN_DEG } else { TURN_DEG };
    let target = Pointing { dec_deg: vehicle.target.dec_deg + up, ..vehicle.target };
    scenario.events.push(Event {
        at: Span::from_s(TURN_AT_S),
        on_trigger: None,
        lasts: Span::ZERO,
        action: Action::Slew(target),
    });
    fly(&scenario)
}

/// Flies with a delay beyond the margin: the loop must leave fine pointing, which it does above a stated error.
pub(super) fn beyond(study: &Study, times_margin: f64) -> Result<Vec<StudyPoint>, LoopError> {
    let Some(margin_s) = study.paper.delay_margin_s() else { return Ok(Vec::new()) };
    let latency = Latency::Actuation(rounded_to(study.step_s, times_margin * margin_s));
    let trace = fly(&at_rest(&study.scenario, LOSING_S, LOSING_S, &latency.injected()))?;
    let largest = trace.samples.iter().map(|sample| (study.head() * sample.error_rad).truncate().length());
    let got = [largest.fold(0.0, f64::max), study.vehicle.acs.thresholds.fine_leave_rad].map(|rad| rad / ARCSEC);
    // The value is a limit that must be exceeded.
    let allowed = if got[0] > got[1] { f64::INFINITY } else { 0.0 };
    Ok(vec![StudyPoint::judged(LARGEST_ERROR, latency.varied(), got, allowed)])
}
