//! An event that came from outside while a captured run went on, as `session.json` has it.
//!
//! Numbers with a fraction stand as text, as everywhere in that file. A fault changes what is remembered of the frames
//! before it (`torn` and `duplicate` need them), and a trigger begins the faults that wait at that time: a replay therefore
//! adds an event when it came, not before.

use super::ReplayError;
use super::session::{exact, number};
use base::time::Span;
use config::Event;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// The key whose text is a word and no number.
const WORD: &str = "do";

/// An event from outside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Injected {
    /// When it came, s after the first exposure.
    came_s: String,
    /// What came: the keys of `[[event]]`.
    event: Map<String, Value>,
}

impl Injected {
    /// An event that came so many seconds after the first exposure.
    pub(super) fn new(event: &Map<String, Value>, came_s: f64) -> Self {
        let event = event.iter().map(|(key, value)| (key.clone(), as_text(value))).collect();
        Self { came_s: exact(came_s), event }
    }

    /// When it came, after the first exposure, and the event; one whose time was over begins when it came.
    pub(super) fn event(&self, frame_period: Span) -> Result<(Span, Event), ReplayError> {
        let came_s = number("injected.came_s", &self.came_s)?;
        let mut keys = Map::new();
        for (key, value) in &self.event {
            let value = if key == WORD { value.clone() } else { as_number(key, value)? };
            keys.insert(key.clone(), value);
        }
        let (came, mut event) = (Span::from_s(came_s), Event::from_json(&keys, came_s, frame_period)?);
        if event.on_trigger.is_none() {
            event.at = event.at.max(came);
        }
        Ok((came, event))
    }
}

/// The value, its numbers with a fraction as text.
fn as_text(value: &Value) -> Value {
    match value {
        Value::Number(given) if given.is_f64() => given.as_f64().map(exact).into(),
        Value::Array(values) => values.iter().map(as_text).collect(),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) | Value::Object(_) => value.clone(),
    }
}

/// The value, its text as numbers.
fn as_number(key: &str, value: &Value) -> Result<Value, ReplayError> {
    Ok(match value {
        Value::String(text) => number(key, text)?.into(),
        Value::Array(values) => values.iter().map(|value| as_number(key, value)).collect::<Result<_, _>>()?,
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::Object(_) => value.clone(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::Action;
    use frames::sink::FrameFault;
    use serde_json::json;

    const PERIOD: Span = Span::from_ms(100);

    /// The event after it was written and read.
    fn again(event: &Value, came_s: f64) -> Result<(Span, Event), ReplayError> {
        let injected = Injected::new(event.as_object().unwrap(), came_s);
        let text = serde_json::to_string_pretty(&injected).unwrap();
        let read: Injected = serde_json::from_str(&text).unwrap();
        assert_eq!(read, injected);
        read.event(PERIOD)
    }

    #[test]
    fn event_comes_back_bit_by_bit_and_not_before_it_came() {
        let e_per_s = 0.1 + 0.2;
        let stray = json!({"do": "stray_light", "for_s": 0.25, "e_per_s": e_per_s, "head": 1});
        let (came, event) = again(&stray, 2.5).unwrap();
        let fault = FrameFault::StrayLight { e_per_s };
        assert_eq!(event.action, Action::Frame { head: Some(1), fault });
        assert_eq!((came, event.at, event.lasts), (Span::from_ms(2500), Span::from_ms(2500), Span::from_ms(250)));
        let at = |event: &Value| again(event, 2.5).unwrap().1.at;
        assert_eq!(at(&json!({"do": "frame_blank", "for_s": 1, "at_s": 1.5})), Span::from_ms(2500), "it is over");
        assert_eq!(at(&json!({"do": "frame_blank", "for_s": 1, "at_s": 4})), Span::from_ms(4000));
        assert_eq!(at(&json!({"do": "frame_blank", "for_s": 1, "at_frame": 50})), Span::from_ms(5000));
        let waits = json!({"do": "frame_blank", "for_s": 1, "on_trigger": 7});
        assert_eq!((at(&waits), again(&waits, 2.5).unwrap().1.on_trigger), (Span::ZERO, Some(7)));
        let spike = json!({"do": "gyro_spike", "for_s": 1, "rate_deg_h": [1.5, 2, -0.1]});
        assert!(matches!(again(&spike, 0.0).unwrap().1.action, Action::Gyro(_)));
    }

    #[test]
    fn damage_is_refused_with_the_key() {
        for (event, part) in [
            (json!({"do": "stray_light", "for_s": "soon", "e_per_s": 1}), "for_s is \"soon\", wanted a finite number"),
            (json!({"do": "stray_light", "for_s": 1}), "e_per_s"),
            (json!({"do": "no_such_thing", "for_s": 1}), "no_such_thing"),
        ] {
            let error = again(&event, 0.0).unwrap_err().to_string();
            assert!(error.contains(part), "{event}: {error}");
        }
    }
}
