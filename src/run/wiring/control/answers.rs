//! Answers of a closed loop to each request: times in seconds after the first exposure, angles in deg or rad as named.

use crate::wiring::control::protocol::{PROTOCOL_VERSION, REQUESTS, StepBy};
use crate::wiring::{assessment::mode_name, control::samples::SampleList, error::LoopError, stepped::SteppedRun};
use crate::{runtime::TrackerOutput, runtime::engine::origin_name};
use base::axes::{Body, Icrf, Rotation, Sensor, ra_dec_roll};
use base::time::{Span, Tai};
use config::{Event, Scenario};
use frames::report::RunNumbers;
use serde_json::{Map, Value, json};
use testbed::acs::Mode;
use testbed::tracker::{Mode as TrackerMode, Outcome, Solution};
use testbed::vehicle::{HeadReport, Vehicle};

/// Goal of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Goal {
    /// Up to this instant.
    Time(Tai),
    /// Until the first head has sent this many frames in total.
    Frames(u64),
}

/// The instants of a run under way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Instants {
    pub(super) zero: Tai,
    pub(super) now: Tai,
    pub(super) end: Tai,
}

impl Instants {
    /// Returns the instants of a run on the virtual clock.
    pub(super) fn of(going: &SteppedRun) -> Self {
        Self { zero: going.zero(), now: going.now(), end: going.end_at() }
    }

    /// Returns seconds after the first exposure.
    pub(super) fn s(&self, at: Tai) -> f64 {
        (at - self.zero).s()
    }

    pub(super) fn now_s(&self) -> f64 {
        self.s(self.now)
    }
}

/// Returns the answer to hello: scenario, protocol and clock of the run.
pub(super) fn hello(scenario: &Scenario, instants: &Instants, clock: &str) -> Value {
    let (camera, timing) = (&scenario.bench.camera, &scenario.bench.timing);
    let sensor_px = [camera.detector.width_px, camera.detector.height_px].map(|side| side as usize);
    let [width, height] = camera.detector.params.spatial.output(sensor_px).size_px;
    json!({
        "protocol": PROTOCOL_VERSION,
        "scenario": scenario.name,
        "clock": clock,
        "seed": scenario.bench.seed,
        "zero_utc": instants.zero.to_rfc3339(),
        "now_s": instants.now_s(),
        "duration_s": instants.s(instants.end),
        "frames": timing.frames(),
        "frame_rate_hz": timing.frame_rate_hz,
        "camera": camera.name,
        "width": width,
        "height": height,
        "heads": scenario.bench.head_count(),
        "requests": REQUESTS.map(|(name, _)| name),
    })
}

/// Returns counts so far; `mode` is that of the flight computer if a spacecraft is flown.
pub(super) fn state(numbers: &RunNumbers, instants: &Instants, mode: Option<Mode>, is_finished: bool) -> Value {
    let frames = numbers.frames;
    let events: Map<String, Value> = numbers
        .events
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| (name.into(), count.into()))
        .collect();
    json!({
        "now_s": instants.now_s(),
        "finished": is_finished,
        "verdict": numbers.word,
        "mode": mode.map(mode_name),
        "frames": {
            "scheduled": frames.scheduled,
            "rendered": frames.rendered,
            "delivered": frames.delivered,
            "late": frames.late,
            "held": frames.held,
            "dropped": frames.dropped,
            "blank": frames.blank,
        },
        "events": events,
    })
}

/// Returns the goal of a step, if it is ahead and not past the end.
pub(super) fn step_goal(by: StepBy, going: &SteppedRun, frames_out: u64) -> Result<Goal, String> {
    let (now, end_s) = (going.now(), (going.end_at() - going.zero()).s());
    if going.is_finished() {
        return Err(format!("the run has reached its end at {end_s} s; wanted summary or finish"));
    }
    let (at, asked) = match by {
        StepBy::Seconds(s) => (now + Span::from_s(s), format!("s is {s}")),
        StepBy::Until(until_s) => (going.zero() + Span::from_s(until_s), format!("until_s is {until_s}")),
        StepBy::Frames(frames) => {
            let left = going.frames_at_most().saturating_sub(frames_out);
            let goal = Goal::Frames(frames_out.saturating_add(frames));
            let refuse = || format!("frames is {frames}; wanted at most the {left} that are left");
            return (frames <= left).then_some(goal).ok_or_else(refuse);
        }
    };
    // At the end, frames in flight go out by themselves: a run is over at its last readout.
    if at > going.end_at() {
        return Err(format!("{asked}, past the end; wanted at most until_s {end_s}, it is {} s now", now_s(going)));
    }
    if at <= now {
        return Err(format!("{asked}; wanted a time after now, which is {} s", now_s(going)));
    }
    Ok(Goal::Time(at))
}

pub(super) fn stepped(going: &SteppedRun, frames_out: u64) -> Value {
    json!({
        "now_s": now_s(going),
        "frames_out": frames_out,
        "frames_delivered": going.record().frames.delivered,
        "mode": going.with_vehicle(|vehicle| mode_name(vehicle.mode())),
        "finished": going.is_finished(),
    })
}

pub(super) fn inject(keys: &Map<String, Value>, going: &mut SteppedRun) -> Result<Value, String> {
    let event = Event::from_json(keys, now_s(going), going.frame_period()).map_err(|error| error.to_string())?;
    going.inject(&event).map_err(|error| error.to_string())?;
    let from_s = event.at.s().max(now_s(going));
    Ok(json!({ "event": event.action.word(), "from_s": from_s, "for_s": event.lasts.s() }))
}

/// Queues samples of an external plant until their instants.
pub(super) fn plant(samples: &SampleList, going: &mut SteppedRun) -> Result<Value, String> {
    let samples = samples.since(going.zero());
    going.take_plant(&samples).map_err(|error| error.to_string())?;
    let (waiting, attitude_until) = going.plant_waiting();
    let attitude_until_s = attitude_until.map(|at| s(at, going));
    Ok(json!({ "taken": samples.len(), "waiting": waiting, "attitude_until_s": attitude_until_s }))
}

/// Returns the attitude that frames of the first head are drawn with, according to the samples of an external plant.
pub(super) fn received_truth(at_s: Option<f64>, going: &SteppedRun) -> Result<Value, String> {
    let at = at_s.map_or(going.now(), |at_s| going.zero() + Span::from_s(at_s));
    if at > going.now() {
        let (asked, now_s) = (s(at, going), now_s(going));
        return Err(format!("at_s is {asked} s; wanted a time not after now, which is {now_s} s"));
    }
    let refuse = |error: LoopError| format!("at_s is {}: {error}", s(at, going));
    let estimated = going.attitude_at(at).map_err(refuse)?;
    let mut answer = attitude(&(going.mounting() * estimated.state.body_from_icrf));
    answer["at_s"] = s(at, going).into();
    answer["body_rate_rad_s"] = estimated.state.rate_rad_s.to_array().to_vec().into();
    answer["origin"] = origin_name(estimated.origin).into();
    Ok(answer)
}

/// Returns the output of a head's built-in tracker for the newest frame that it has processed.
pub(super) fn tracker(head: usize, going: &SteppedRun) -> Result<Value, String> {
    let output = going.tracker_output(head).map_err(|error| error.to_string())?;
    let Some(TrackerOutput { frame, mid_exposure, outcome }) = output else {
        return Ok(json!({ "valid": false, "stars": 0, "reason": "no frame yet" }));
    };
    let mut answer = match outcome {
        Outcome::Solved(solution) => {
            let mut answer = solved(&solution);
            let body_from_sensor = going.mounting_of(head).inverse();
            answer["body_from_icrf"] = (body_from_sensor * solution.sensor_from_icrf).wxyz().into();
            answer["valid"] = true.into();
            answer
        }
        Outcome::NoSolution(reason) => json!({ "valid": false, "stars": 0, "reason": reason.to_string() }),
    };
    answer["frame"] = frame.into();
    answer["mid_exposure_s"] = s(mid_exposure, going).into();
    Ok(answer)
}

/// Returns an attitude that a tracker has found.
fn solved(solution: &Solution) -> Value {
    let mut answer = attitude(&solution.sensor_from_icrf);
    answer["stars"] = solution.stars.into();
    answer["residual_rms_px"] = solution.residual_rms_px.into();
    answer["found_by"] = match solution.mode {
        TrackerMode::LostInSpace => "lost_in_space".into(),
        TrackerMode::Tracking => "tracking".into(),
    };
    answer
}

/// Sends a trigger over the bus; the events in the report show whether the stimulator accepts it.
pub(super) fn trigger(number: u16, at_s: Option<f64>, going: &mut SteppedRun) -> Result<Value, String> {
    let at = at_s.map(|at_s| going.zero() + Span::from_s(at_s));
    going.send_trigger(number, at).map_err(|error| error.to_string())?;
    Ok(json!({ "number": number, "at_s": at_s.unwrap_or_else(|| now_s(going)) }))
}

/// Returns the true attitude of the first head, at most two seconds ago.
pub(super) fn truth(
    at_s: Option<f64>,
    vehicle: Option<&Vehicle>,
    mounting: Rotation<Sensor, Body>,
    instants: &Instants,
) -> Result<Value, String> {
    let vehicle = vehicle.ok_or("nothing is flown inside: its truth is with whoever flies it")?;
    let flown = vehicle.flown_until().min(instants.now);
    let at = at_s.map_or(flown, |at_s| instants.zero + Span::from_s(at_s));
    if at > instants.now {
        let (asked, now_s) = (instants.s(at), instants.now_s());
        return Err(format!("at_s is {asked} s; wanted a time not after now, which is {now_s} s"));
    }
    let truth = vehicle.flown_truth(at).map_err(|_| {
        let (asked, last) = (instants.s(at), instants.s(flown));
        format!("at_s is {asked}; wanted a time from {} to {last}: the last two seconds", last - 2.0)
    })?;
    let mut answer = attitude(&(mounting * truth.body_from_icrf));
    answer["at_s"] = instants.s(at).into();
    answer["body_rate_rad_s"] = truth.rate_rad_s.to_array().to_vec().into();
    answer["wheel_speeds_rad_s"] = vehicle.wheel_speeds_rad_s().to_vec().into();
    Ok(answer)
}

/// Returns the estimate of the internal flight computer; an empty answer without one.
pub(super) fn estimate(vehicle: Option<&Vehicle>, mounting: Rotation<Sensor, Body>, instants: &Instants) -> Value {
    let Some(vehicle) = vehicle else { return json!({}) };
    let heads: Vec<Value> = vehicle.head_reports().map(|report| head(report, instants)).collect();
    let estimate = vehicle.estimate().map(|estimate| attitude(&(mounting * estimate)));
    json!({
        "at_s": instants.s(vehicle.estimate_at()),
        "estimate": estimate,
        "sigma_rad": vehicle.estimate_sigma_rad().to_array(),
        "mode": mode_name(vehicle.mode()),
        "heads": heads,
    })
}

/// Returns the last report of a tracker.
fn head(report: &HeadReport, instants: &Instants) -> Value {
    let mut answer = match report.last {
        None => json!({ "outcome": "no_frame_yet" }),
        Some(Outcome::NoSolution(reason)) => json!({ "outcome": "no_attitude", "reason": reason.to_string() }),
        Some(Outcome::Solved(solution)) => {
            let mut answer = solved(&solution);
            answer["outcome"] = "attitude".into();
            answer["at_s"] = instants.s(solution.at).into();
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

fn now_s(going: &SteppedRun) -> f64 {
    s(going.now(), going)
}

fn s(at: Tai, going: &SteppedRun) -> f64 {
    (at - going.zero()).s()
}
