//! Answers about a run on the real clock, which goes on while they are made.
//!
//! Not available: `step`, because the real clock cannot be paused, and `summary`, because the report is made when the
//! run ends: it comes with the answer to `finish`.

use crate::wiring::control::answers::{self, Instants};
use crate::wiring::{control::protocol::Request, control::samples::SampleList, error::LoopError, steering::Steering};
use crate::{runtime::RunRecord, runtime::real_parts::HeadParts};
use base::time::{Span, Tai};
use config::{Event, Plant, Scenario};
use core::time::Duration;
use serde_json::{Value, json};
use testbed::vehicle::Vehicle;

/// Longest time that an early client waits for the run to start.
const BEGINS_WITHIN: Duration = Duration::from_secs(30);
/// Interval at which the start is checked.
const LOOK: Duration = Duration::from_millis(10);

pub(super) fn hello(scenario: &Scenario, steering: &Steering) -> Result<Value, String> {
    let mut waited = Duration::ZERO;
    while !steering.has_begun() && waited < BEGINS_WITHIN {
        std::thread::sleep(LOOK);
        waited += LOOK;
    }
    Ok(answers::hello(scenario, &instants(steering)?, "real"))
}

/// Answers one request, or returns why it cannot.
pub(super) fn answer(request: &Request, scenario: &Scenario, steering: &Steering) -> Result<Value, String> {
    let mounting = scenario.bench.sensor_from_body;
    match request {
        Request::Hello { .. } => hello(scenario, steering),
        Request::Step(_) => {
            Err("the real clock cannot be held: ask for state, or run with --clock virtual to step".into())
        }
        Request::Summary => Err("the report is made when the run ends: ask for state, or send finish".into()),
        Request::State => state(steering),
        Request::Inject(keys) => {
            let now_s = instants(steering)?.now_s();
            let frame_period = Span::from_s(1.0 / scenario.bench.timing.frame_rate_hz);
            let event = Event::from_json(keys, now_s, frame_period).map_err(|error| error.to_string())?;
            let placed = steering.inject(&event).map_err(|error| error.to_string())?;
            Ok(json!({ "event": event.action.word(), "from_s": placed.at.s(), "for_s": event.lasts.s() }))
        }
        Request::Trigger { number, at_s } => {
            let instants = instants(steering)?;
            let at = at_s.map(|at_s| instants.zero + Span::from_s(at_s));
            let is_outside = scenario.plant == Plant::Outside;
            steering.trigger(*number, at, is_outside).map_err(|error| error.to_string())?;
            Ok(json!({ "number": number, "at_s": at_s.unwrap_or_else(|| instants.now_s()) }))
        }
        Request::Truth { at_s } => {
            let (at_s, instants) = (*at_s, instants(steering)?);
            let look = move |far: &mut crate::wiring::far_side::FarSide| {
                answers::truth(at_s, far.vehicle(), mounting, &instants)
            };
            steering.on_far_end(look).map_err(|error| error.to_string())?
        }
        Request::Estimate => {
            let instants = instants(steering)?;
            let look =
                move |far: &mut crate::wiring::far_side::FarSide| answers::estimate(far.vehicle(), mounting, &instants);
            steering.on_far_end(look).map_err(|error| error.to_string())
        }
        Request::React(reaction) => {
            let (reaction, instants) = (reaction.clone(), instants(steering)?);
            let act = move |far: &mut crate::wiring::far_side::FarSide| {
                let vehicle = far.vehicle_mut().ok_or_else(|| LoopError::NothingFlown.to_string())?;
                reaction.act(vehicle, instants.zero, instants.now)
            };
            steering.on_far_end(act).map_err(|error| error.to_string())?
        }
        Request::Camera(camera) => {
            let (camera, instants) = (camera.clone(), instants(steering)?);
            let heads = scenario.bench.head_count();
            let act = move |parts: &mut [HeadParts<'_>], record: &mut RunRecord, _release: Tai| {
                let no_head = || format!("head is {}; there are {heads}, counted from 0", camera.head);
                let head = parts.get_mut(camera.head).ok_or_else(no_head)?;
                camera.act(head.engine.exposing_mut(), &mut record.ledger, instants.zero, instants.now)
            };
            steering.on_frame_thread(act).map_err(|error| error.to_string())?
        }
        Request::Tracker { .. } => {
            Err("the real clock goes on meanwhile: ask for estimate, or run with --clock virtual".into())
        }
        Request::Plant(samples) => plant(samples, scenario, steering),
        Request::BadSamples(why) => {
            steering.note_bad_samples().map_err(|error| error.to_string())?;
            Err(why.clone())
        }
        Request::Frame { head, path, pixels } => {
            let ended = steering.ended().map(|(times, _)| times.zero);
            let zero = ended.map_or_else(|| instants(steering).map(|instants| instants.zero), Ok)?;
            steering.newest().answer(*head, path.as_deref(), *pixels, zero)
        }
        Request::Finish => Ok(Value::Null),
    }
}

/// Passes on samples of an external plant; each is used when it comes, by its own instant.
fn plant(samples: &SampleList, scenario: &Scenario, steering: &Steering) -> Result<Value, String> {
    if !scenario.bench.is_lockstep() {
        let why = "the attitudes of this bench come by its link, or from inside; wanted plant.kind = \"outside\" with a \
                   simulated link without gateways to send samples here";
        return Err(why.into());
    }
    let instants = instants(steering)?;
    let samples = samples.since(instants.zero);
    let waiting = steering.send_samples(&samples).map_err(|error| error.to_string())?;
    let attitudes = samples.iter().filter(|sample| sample.attitude.is_some());
    let attitude_until_s = attitudes.map(|sample| sample.at).max().map(|at| instants.s(at));
    Ok(json!({
        "taken": samples.len(), "waiting": waiting, "attitude_until_s": attitude_until_s, "now_s": instants.now_s(),
    }))
}

fn instants(steering: &Steering) -> Result<Instants, String> {
    let (times, now) = steering.now().map_err(|error| error.to_string())?;
    Ok(Instants { zero: times.zero, now, end: times.end })
}

fn state(steering: &Steering) -> Result<Value, String> {
    if let Some((times, numbers)) = steering.ended() {
        let instants = Instants { zero: times.zero, now: times.end, end: times.end };
        return Ok(answers::state(&numbers, &instants, None, true));
    }
    let instants = instants(steering)?;
    let numbers = steering.numbers().map_err(|error| error.to_string())?;
    let mode = steering.on_far_end(|far| far.vehicle().map(Vehicle::mode)).map_err(|error| error.to_string())?;
    Ok(answers::state(&numbers, &instants, mode, false))
}
