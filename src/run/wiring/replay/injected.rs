//! Events of a captured run that are not in its file, as `session.json` stores them.
//!
//! Numbers with a fraction are stored as text, as everywhere in that file. A fault changes which earlier frames are
//! kept (`torn` and `duplicate` need them), and a trigger starts the faults that wait at that time: a replay therefore
//! places an injected event when it came, not before.
//!
//! Numbers of `session.json`, which are stored as text, and the refusal of a value there.

use super::{ReplayError, Result, SESSION_FILE};
use base::time::Span;
use config::Event;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::path::Path;

/// The key whose text is a word and not a number.
const WORD: &str = "do";

/// An event by the keys of `[[event]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct KeptEvent {
    keys: Map<String, Value>,
}

impl KeptEvent {
    /// Returns the stored form of an event.
    pub(super) fn new(event: &Event) -> Self {
        Self { keys: event.to_json().iter().map(|(key, value)| (key.clone(), as_text(value))).collect() }
    }

    /// Returns the event.
    pub(super) fn event(&self) -> Result<Event> {
        let mut keys = Map::new();
        for (key, value) in &self.keys {
            let value = if key == WORD { value.clone() } else { as_number(key, value)? };
            keys.insert(key.clone(), value);
        }
        // Times are given in seconds, so no frame period is needed.
        Ok(Event::from_json(&keys, 0.0, Span::ZERO)?)
    }
}

/// An event that was injected during a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Injected {
    /// Time of injection, s after the first exposure.
    came_s: String,
    /// The event.
    event: KeptEvent,
}

impl Injected {
    /// Returns an event that was injected this long after the first exposure.
    pub(super) fn new(event: &Event, came: Span) -> Self {
        Self { came_s: exact(came.s()), event: KeptEvent::new(event) }
    }

    /// Returns the time of injection after the first exposure, and the event.
    pub(super) fn event(&self) -> Result<(Span, Event)> {
        Ok((Span::from_s(number("injected.came_s", &self.came_s)?), self.event.event()?))
    }
}

/// Converts the numbers with a fraction in a value to text.
fn as_text(value: &Value) -> Value {
    match value {
        Value::Number(given) if given.is_f64() => given.as_f64().map(exact).into(),
        Value::Array(values) => values.iter().map(as_text).collect(),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) | Value::Object(_) => value.clone(),
    }
}

/// Converts the text in a value to numbers.
fn as_number(key: &str, value: &Value) -> Result<Value> {
    Ok(match value {
        Value::String(text) => number(key, text)?.into(),
        Value::Array(values) => values.iter().map(|value| as_number(key, value)).collect::<Result<_, _>>()?,
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::Object(_) => value.clone(),
    })
}

/// Returns the text of a number: the fewest digits that give the same bits again.
pub(super) fn exact(value: f64) -> String {
    format!("{value:?}")
}

/// Returns the finite number that a text is.
pub(super) fn number(name: &str, text: &str) -> Result<f64> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| wrong(name, text, "a finite number"))
}

/// Returns the refusal of a value.
pub(super) fn wrong(name: &str, got: &str, wanted: &str) -> ReplayError {
    ReplayError::at(Path::new(SESSION_FILE), format!("{name} is \"{got}\", wanted {wanted}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::Action;
    use frames::sink::{FrameFault, ImageFault, SendingFault};
    use testbed::vehicle::VehicleFault;

    #[test]
    fn event_comes_back_bit_by_bit_with_the_time_at_which_it_came() {
        let came = Span::from_ns(2_500_000_001);
        for action in [
            Action::Frame { head: Some(1), fault: FrameFault::Image(ImageFault::StrayLight { e_per_s: 0.1 + 0.2 }) },
            Action::Frame { head: None, fault: FrameFault::Sending(SendingFault::Late(Span::from_ns(1_234_567))) },
            Action::Aboard(VehicleFault::GyroDropout),
        ] {
            let event = Event { at: came, on_trigger: None, lasts: Span::from_ns(1_000_000_007), action };
            let text = serde_json::to_string_pretty(&Injected::new(&event, came)).unwrap();
            let read: Injected = serde_json::from_str(&text).unwrap();
            assert_eq!(read.event().unwrap(), (came, event), "{text}");
            let other: Injected = serde_json::from_str(&text.replace("000001", "000002")).unwrap();
            assert_ne!(other.event().unwrap(), (came, event), "control");
        }
    }

    #[test]
    fn damage_is_refused_with_the_key() {
        for (event, part) in [
            (
                r#"{"do": "stray_light", "at_s": 1, "for_s": "soon", "e_per_s": 1}"#,
                "for_s is \"soon\", wanted a finite",
            ),
            (r#"{"do": "stray_light", "at_s": 1, "for_s": 1}"#, "e_per_s"),
            (r#"{"do": "no_such_thing", "at_s": 1, "for_s": 1}"#, "no_such_thing"),
        ] {
            let kept: KeptEvent = serde_json::from_str(event).unwrap();
            let error = kept.event().unwrap_err().to_string();
            assert!(error.contains(part), "{event}: {error}");
        }
    }
}
