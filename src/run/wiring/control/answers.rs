//! What a closed loop answers to each request: times in seconds after the first exposure, angles in deg or rad as named.

use crate::wiring::assessment::mode_name;
use crate::wiring::closed_loop::ClosedLoop;
use crate::wiring::control::protocol::{PROTOCOL_VERSION, StepBy};
use base::axes::{Icrf, Rotation, Sensor, ra_dec_roll};
use base::time::{Span, Tai};
use config::{Event, Scenario};
use serde_json::{Map, Value, json};
use testbed::tracker::{Mode, Outcome};
use testbed::vehicle::{HeadReport, Vehicle};

/// Where a step goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Goal {
    /// To this instant.
    Time(Tai),
    /// Until the first head has sent so many frames in all.
    Frames(u64),
}

pub(super) fn hello(scenario: &Scenario, going: &ClosedLoop) -> Value {
    let (camera, timing) = (&scenario.bench.camera, &scenario.bench.timing);
    let sensor_px = [camera.detector.width_px, camera.detector.height_px].map(|side| side as usize);
    let [width, height] = camera.detector.spatial.output(sensor_px).size_px;
    json!({
        "protocol": PROTOCOL_VERSION,
        "scenario": scenario.name,
        "seed": scenario.bench.seed,
        "zero_utc": going.zero().to_rfc3339(),
        "now_s": now_s(going),
        "duration_s": (going.end() - going.zero()).s(),
        "frames": going.frames_per_head(),
        "frame_rate_hz": timing.frame_rate_hz,
        "camera": camera.name,
        "width": width,
        "height": height,
        "heads": scenario.heads.len(),
    })
}

/// Where a step goes, when it goes forward and not past the end.
pub(super) fn step_goal(by: StepBy, going: &ClosedLoop, frames_out: u64) -> Result<Goal, String> {
    let (now, end_s) = (going.now(), (going.end() - going.zero()).s());
    if going.is_finished() {
        return Err(format!("the run has reached its end at {end_s} s; wanted summary or finish"));
    }
    let (at, asked) = match by {
        StepBy::Seconds(s) => (now + Span::from_s(s), format!("s is {s}")),
        StepBy::Until(until_s) => (going.zero() + Span::from_s(until_s), format!("until_s is {until_s}")),
        StepBy::Frames(frames) => {
            let left = u64::from(going.frames_per_head()) - frames_out.min(u64::from(going.frames_per_head()));
            let goal = Goal::Frames(frames_out.saturating_add(frames));
            let refuse = || format!("frames is {frames}; wanted at most the {left} that are left");
            return (frames <= left).then_some(goal).ok_or_else(refuse);
        }
    };
    // At the end, what is on its way goes out by itself: a run is over at its last readout.
    if at > going.end() {
        return Err(format!("{asked}, past the end; wanted at most until_s {end_s}, it is {} s now", now_s(going)));
    }
    if at <= now {
        return Err(format!("{asked}; wanted a time after now, which is {} s", now_s(going)));
    }
    Ok(Goal::Time(at))
}

pub(super) fn stepped(going: &ClosedLoop, frames_out: u64) -> Value {
    json!({
        "now_s": now_s(going),
        "frames_out": frames_out,
        "frames_delivered": going.record().frames.delivered,
        "mode": going.with_vehicle(|vehicle| mode_name(vehicle.mode())),
        "finished": going.is_finished(),
    })
}

pub(super) fn inject(keys: &Map<String, Value>, going: &mut ClosedLoop) -> Result<Value, String> {
    let event = Event::from_json(keys, now_s(going), going.frame_period()).map_err(|error| error.to_string())?;
    going.inject(&event).map_err(|error| error.to_string())?;
    let from_s = event.at.s().max(now_s(going));
    Ok(json!({ "event": event.action.word(), "from_s": from_s, "for_s": event.lasts.s() }))
}

/// A trigger goes over the bus: whether the stimulator takes it, the events in its report tell.
pub(super) fn trigger(number: u16, at_s: Option<f64>, going: &mut ClosedLoop) -> Result<Value, String> {
    let at = at_s.map(|at_s| going.zero() + Span::from_s(at_s));
    going.send_trigger(number, at).map_err(|error| error.to_string())?;
    Ok(json!({ "number": number, "at_s": at_s.unwrap_or_else(|| now_s(going)) }))
}

pub(super) fn truth(at_s: Option<f64>, going: &ClosedLoop) -> Result<Value, String> {
    let flown = going.with_vehicle(Vehicle::flown_until).map_or(going.now(), |flown| flown.min(going.now()));
    let at = at_s.map_or(flown, |at_s| going.zero() + Span::from_s(at_s));
    if at > going.now() {
        return Err(format!("at_s is {} s; wanted a time not after now, which is {} s", s(at, going), now_s(going)));
    }
    let (sensor_from_icrf, rate_rad_s) = going.truth(at).map_err(|_| {
        let (asked, last) = (s(at, going), s(flown, going));
        format!("at_s is {asked}; wanted a time from {} to {last}: the last two seconds", last - 2.0)
    })?;
    let wheels = going.with_vehicle(|vehicle| vehicle.wheel_speeds_rad_s().to_vec());
    let mut answer = attitude(&sensor_from_icrf);
    answer["at_s"] = s(at, going).into();
    answer["body_rate_rad_s"] = rate_rad_s.to_array().to_vec().into();
    answer["wheel_speeds_rad_s"] = wheels.into();
    Ok(answer)
}

pub(super) fn estimate(going: &ClosedLoop) -> Value {
    let mounting = going.mounting();
    let looked = going.with_vehicle(|vehicle| {
        let heads: Vec<Value> = vehicle.head_reports().map(|report| head(report, going)).collect();
        let estimate = vehicle.estimate().map(|estimate| attitude(&(mounting * estimate)));
        json!({
            "at_s": s(vehicle.estimate_at(), going),
            "estimate": estimate,
            "sigma_rad": vehicle.estimate_sigma_rad().to_array(),
            "mode": mode_name(vehicle.mode()),
            "heads": heads,
        })
    });
    looked.unwrap_or_else(|| json!({}))
}

/// What a tracker said last.
fn head(report: &HeadReport, going: &ClosedLoop) -> Value {
    let mut answer = match report.last {
        None => json!({ "outcome": "no_frame_yet" }),
        Some(Outcome::NoSolution(reason)) => json!({ "outcome": "no_attitude", "reason": reason.to_string() }),
        Some(Outcome::Solved(solution)) => {
            let mut answer = attitude(&solution.sensor_from_icrf);
            answer["outcome"] = "attitude".into();
            answer["at_s"] = s(solution.at, going).into();
            answer["stars"] = solution.stars.into();
            answer["residual_rms_px"] = solution.residual_rms_px.into();
            answer["found_by"] = match solution.mode {
                Mode::LostInSpace => "lost_in_space".into(),
                Mode::Tracking => "tracking".into(),
            };
            answer
        }
    };
    answer["untagged_frames"] = report.untagged.into();
    answer["ignored_frames"] = report.ignored.into();
    answer
}

fn attitude(sensor_from_icrf: &Rotation<Sensor, Icrf>) -> Value {
    let [ra_deg, dec_deg, roll_deg] = ra_dec_roll(sensor_from_icrf).map(f64::to_degrees);
    json!({
        "sensor_from_icrf": sensor_from_icrf.wxyz(),
        "ra_deg": ra_deg,
        "dec_deg": dec_deg,
        "roll_deg": roll_deg,
    })
}

fn now_s(going: &ClosedLoop) -> f64 {
    s(going.now(), going)
}

fn s(at: Tai, going: &ClosedLoop) -> f64 {
    (at - going.zero()).s()
}
