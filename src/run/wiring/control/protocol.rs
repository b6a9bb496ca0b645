//! Lines of JSON -> requests, and replies -> JSON. Version 2: the first request of a connection is a hello with the
//! token.
//!
//! ```text
//! {"id": 1, "request": "hello", "token": "..."}      the token that the program has printed; first
//! {"request": "step", "s": 0.5}                    or "frames": 3, or "until_s": 12.0
//! {"request": "inject", "event": {"do": "gyro_dropout", "for_s": 2.0}}
//! {"request": "trigger", "number": 7, "at_s": 12.5}   at_s may be left out: at once
//! {"request": "truth", "at_s": 11.9}               at_s may be left out
//! {"request": "state"}                             counts so far, on either clock
//! {"request": "estimate"}
//! {"request": "frame", "head": 0, "path": "f.fits"}    a new file below the run's output folder;
//!                                                  path may be left out: pixels come as base64
//! {"request": "summary"}
//! {"request": "finish"}
//! {"request": "attitude", "samples": [[0.01, 1, 0, 0, 0, 0, 0, 0]]}   of a plant outside: see `samples`
//! {"request": "observer", "samples": [[0, 7000, 0, 0, 0, 7.5, 0]], "unit": "km"}
//! {"request": "jitter", "samples": [[0.001, 0.2, -0.1, 0]], "unit": "arcsec"}
//! {"request": "tracker", "head": 0}                output of the built-in star tracker for its newest frame
//! {"request": "control", "by": "outside"}          who drives the wheels of a spacecraft inside; see `reaction`
//! {"request": "wheels", "torques_n_m": [0.01, 0, 0, 0]}
//! {"request": "torque", "torque_n_m": [0.1, 0, 0], "for_s": 2.0}
//! {"request": "tracker_attitude", "at_s": 1.05, "body_from_icrf": [1, 0, 0, 0], "sigma_arcsec": 10}
//! {"request": "event", "event": {...}}             the same as inject
//! {"request": "camera", "head": 0, "exposure_us": 50000, "gain_db": 6}   settings of the next exposures; see `camera`
//! {"request": "camera_trigger", "head": 0}         starts an exposure, where the camera waits for triggers
//! ```
//!
//! Requests are added within a version: the answer to hello lists them.
//!
//! Times are seconds after the first exposure. An event has the keys of `[[event]]` in a scenario file; without `at_s`
//! it begins now.

use crate::wiring::control::camera::{self, CameraRequest};
use crate::wiring::control::reaction::Reaction;
use crate::wiring::control::samples::{SampleList, Subject};
use serde_json::{Map, Value, json};

/// Version of the protocol: a client that finds another version should stop.
pub const PROTOCOL_VERSION: u32 = 2;

/// Longest line of a request, bytes without its end.
pub const LINE_BYTES_MAX: usize = 64 * 1024;

/// A request of a client.
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// Get scenario, protocol and clock.
    Hello {
        /// Token that the program has printed; required in the first request of a connection.
        token: Option<String>,
    },
    /// Advance the clock.
    Step(StepBy),
    /// Add an event with the keys of `[[event]]`.
    Inject(Map<String, Value>),
    /// Make the flight computer fire a trigger over the bus.
    Trigger {
        /// Number of the trigger.
        number: u16,
        /// When it acts; `None`: at once.
        at_s: Option<f64>,
    },
    /// Get the true attitude.
    Truth {
        /// Time; `None`: now.
        at_s: Option<f64>,
    },
    /// Get counts so far.
    State,
    /// Get the flight computer's estimate.
    Estimate,
    /// Get the newest frame.
    Frame {
        /// Number of the head.
        head: usize,
        /// FITS file to write below the output folder; `None`: pixels in the reply, or nowhere.
        path: Option<String>,
        /// True when pixels are requested without a path.
        pixels: bool,
    },
    /// Take samples of an external plant.
    Plant(SampleList),
    /// Count samples that cannot be read; with the reason.
    BadSamples(String),
    /// Action of an external controller or tracker on an internal spacecraft.
    React(Reaction),
    /// Get the built-in star tracker's output for its newest frame.
    Tracker {
        /// Number of the head.
        head: usize,
    },
    /// Settings of a head's camera, or a trigger that starts an exposure.
    Camera(CameraRequest),
    /// Get the report so far.
    Summary,
    /// End the run.
    Finish,
}

/// Length of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepBy {
    /// Number of seconds.
    Seconds(f64),
    /// Until this many more frames of the first head have gone out.
    Frames(u64),
    /// Until this time.
    Until(f64),
}

/// Every request by name, with the keys that it accepts.
pub(super) const REQUESTS: [(&str, &[&str]); 21] = [
    ("hello", &["token"]),
    ("state", &[]),
    ("step", &["s", "frames", "until_s"]),
    ("inject", &["event"]),
    ("trigger", &["number", "at_s"]),
    ("truth", &["at_s"]),
    ("estimate", &[]),
    ("frame", &["head", "path", "pixels"]),
    ("summary", &[]),
    ("finish", &[]),
    ("attitude", &["samples"]),
    ("observer", &["samples", "unit"]),
    ("jitter", &["samples", "unit"]),
    ("event", &["event"]),
    ("tracker", &["head"]),
    ("control", &["by", "trackers"]),
    ("wheels", &["torques_n_m", "at_s"]),
    ("torque", &["torque_n_m", "at_s", "for_s"]),
    ("tracker_attitude", &["at_s", "body_from_icrf", "sigma_arcsec"]),
    ("camera", camera::KEYS),
    ("camera_trigger", &["head", "at_s"]),
];

/// Reads one line; returns the request's id, if it has one, and the request or the reason why it is invalid.
pub fn parse(line: &str) -> (Option<Value>, Result<Request, String>) {
    let value: Value = match serde_json::from_str(line) {
        Ok(value) => value,
        Err(error) => return (None, Err(format!("the line is not JSON: {error}; wanted {EXAMPLE}"))),
    };
    let Value::Object(keys) = value else {
        return (None, Err(format!("the line is {}; wanted an object such as {EXAMPLE}", kind(&value))));
    };
    let id = keys.get("id").cloned();
    (id, Keys { keys }.request())
}

/// Returns a reply with an error message.
pub fn refused(id: Option<Value>, why: &str) -> Value {
    let mut reply = json!({ "ok": false, "error": why });
    echo(id, &mut reply);
    reply
}

/// Returns a reply with an answer, which must be an object.
pub fn reported(id: Option<Value>, answer: Value) -> Value {
    let mut reply = answer;
    reply["ok"] = Value::Bool(true);
    echo(id, &mut reply);
    reply
}

fn echo(id: Option<Value>, reply: &mut Value) {
    if let Some(id) = id {
        reply["id"] = id;
    }
}

const EXAMPLE: &str = "{\"request\": \"step\", \"s\": 0.5}";

/// Keys of one request.
struct Keys {
    keys: Map<String, Value>,
}

impl Keys {
    fn request(mut self) -> Result<Request, String> {
        let names = || REQUESTS.map(|(name, _)| name).join(", ");
        let name = match self.keys.remove("request") {
            Some(Value::String(name)) => name,
            Some(other) => return Err(format!("request is {}; wanted one of: {}", shown(&other), names())),
            None => return Err(format!("request is missing; wanted one of: {}", names())),
        };
        let found = REQUESTS.iter().find(|(known, _)| *known == name);
        let (_, takes) = found.ok_or_else(|| format!("request is \"{name}\"; wanted one of: {}", names()))?;
        if let Some(key) = self.keys.keys().find(|key| *key != "id" && !takes.contains(&key.as_str())) {
            let known = if takes.is_empty() { "nothing else".to_owned() } else { takes.join(", ") };
            return Err(format!("unknown key \"{key}\" in {name}; wanted {known}"));
        }
        Ok(match name.as_str() {
            "hello" => Request::Hello { token: self.token()? },
            "step" => Request::Step(self.step()?),
            "inject" | "event" => Request::Inject(self.event()?),
            "trigger" => Request::Trigger { number: self.trigger_number()?, at_s: self.number("at_s")? },
            "truth" => Request::Truth { at_s: self.number("at_s")? },
            "state" => Request::State,
            "estimate" => Request::Estimate,
            "frame" => Request::Frame { head: self.head()?, path: self.path()?, pixels: self.pixels()? },
            "attitude" => self.samples(Subject::Attitude),
            "observer" => self.samples(Subject::Observer),
            "jitter" => self.samples(Subject::Jitter),
            "tracker" => Request::Tracker { head: self.head()? },
            "control" | "wheels" | "torque" | "tracker_attitude" => Request::React(Reaction::read(&name, &self.keys)?),
            "camera" => Request::Camera(CameraRequest::read(self.head()?, self.number("at_s")?, &self.keys)?),
            "camera_trigger" => Request::Camera(CameraRequest::trigger(self.head()?, self.number("at_s")?)),
            "summary" => Request::Summary,
            _ => Request::Finish,
        })
    }

    /// Reads the token. Its value is not repeated in the message: it may be a secret with a typing error.
    fn token(&self) -> Result<Option<String>, String> {
        match self.keys.get("token") {
            None => Ok(None),
            Some(Value::String(token)) => Ok(Some(token.clone())),
            Some(other) => Err(format!("token is {}; wanted a string", kind(other))),
        }
    }

    fn step(&self) -> Result<StepBy, String> {
        let given = ["s", "frames", "until_s"].iter().filter(|key| self.keys.contains_key(**key)).count();
        if given != 1 {
            return Err(format!("step has {given} of s, frames and until_s; wanted exactly one"));
        }
        if let Some(s) = self.number("s")? {
            let is_ahead = s > 0.0;
            return if is_ahead { Ok(StepBy::Seconds(s)) } else { Err(format!("s is {s}; wanted seconds above 0")) };
        }
        if let Some(frames) = self.keys.get("frames") {
            let count = frames.as_u64().filter(|count| *count > 0);
            let refuse = || format!("frames is {}; wanted a whole number above 0", shown(frames));
            return count.map(StepBy::Frames).ok_or_else(refuse);
        }
        self.number("until_s")?.map(StepBy::Until).ok_or_else(|| "until_s is missing".into())
    }

    fn event(&mut self) -> Result<Map<String, Value>, String> {
        let example = "an object with the keys of [[event]], such as {\"do\": \"gyro_dropout\", \"for_s\": 2.0}";
        match self.keys.remove("event") {
            Some(Value::Object(event)) => Ok(event),
            Some(other) => Err(format!("event is {}; wanted {example}", shown(&other))),
            None => Err(format!("event is missing; wanted {example}")),
        }
    }

    fn trigger_number(&self) -> Result<u16, String> {
        let number = self.keys.get("number").ok_or("number is missing; wanted the trigger's, 0 to 65535")?;
        let whole = number.as_u64().and_then(|number| u16::try_from(number).ok());
        whole.ok_or_else(|| format!("number is {}; wanted a whole number from 0 to 65535", shown(number)))
    }

    fn head(&self) -> Result<usize, String> {
        let Some(head) = self.keys.get("head") else { return Ok(0) };
        let number = head.as_u64().and_then(|head| usize::try_from(head).ok());
        number.ok_or_else(|| format!("head is {}; wanted its number, counted from 0", shown(head)))
    }

    fn path(&self) -> Result<Option<String>, String> {
        match self.keys.get("path") {
            None => Ok(None),
            Some(Value::String(path)) if !path.is_empty() => Ok(Some(path.clone())),
            Some(other) => Err(format!("path is {}; wanted the path of a FITS file to write", shown(other))),
        }
    }

    fn samples(&self, subject: Subject) -> Request {
        SampleList::read(subject, &self.keys).map_or_else(Request::BadSamples, Request::Plant)
    }

    fn pixels(&self) -> Result<bool, String> {
        match self.keys.get("pixels") {
            None => Ok(true),
            Some(Value::Bool(pixels)) => Ok(*pixels),
            Some(other) => Err(format!("pixels is {}; wanted true or false", shown(other))),
        }
    }

    /// Reads a number; JSON has no infinite numbers, so every number is finite.
    fn number(&self, key: &str) -> Result<Option<f64>, String> {
        let Some(value) = self.keys.get(key) else { return Ok(None) };
        value.as_f64().map(Some).ok_or_else(|| format!("{key} is {}; wanted a number", shown(value)))
    }
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}

/// Returns a value for a message: itself when short, else its type.
fn shown(value: &Value) -> String {
    let text = value.to_string();
    if text.len() <= 60 { text } else { kind(value).into() }
}
