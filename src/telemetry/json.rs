//! Plain JSON: one object per datagram or line, for whoever wants to read a tracker with a few lines of a script.
//!
//! A report has `utc` (middle of the exposure), `sent_utc`, `q_wxyz` in the sense that was chosen, `rate_deg_s`,
//! `sigma_arcsec`, `stars`, `mode`, `valid`. A client may send objects, one to a line or datagram: `{"command":
//! "ping"}`, `"operate"`, `"standby"`, `"reset"`, and `{"command": "exposure", "exposure_ms": 40}`; each is answered by
//! an object with `reply`, `ok` and, where it is refused, `error`.

use crate::device::Continuity;
use crate::{Answered, Device, Limits, Mode, Order, Report, Sense, Wire};
use base::{time::Tai, units::ARCSEC};
use serde_json::{Value, json};

/// Longest command, bytes.
pub const LINE_MAX: usize = 512;

/// A tracker that speaks JSON.
#[derive(Debug)]
pub struct JsonDevice {
    head: usize,
    sense: Sense,
    limits: Limits,
    counter: u64,
    continuity: Continuity,
    line: Vec<u8>,
    skips: bool,
    answered: Answered,
}

/// Name of a mode in messages.
fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Standby => "standby",
        Mode::Acquisition => "acquisition",
        Mode::Tracking => "tracking",
    }
}

impl JsonDevice {
    /// Returns the tracker of a head.
    pub fn new(head: usize, sense: Sense, limits: Limits) -> Self {
        let (counter, continuity, answered) = (0, Continuity::default(), Answered::default());
        Self { head, sense, limits, counter, continuity, line: Vec::new(), skips: false, answered }
    }

    fn obey(&mut self, line: &[u8], now: Tai, orders: &mut Vec<Order>) -> Value {
        let (name, outcome) = self.order(line);
        let sent_utc = now.to_rfc3339();
        match outcome {
            Ok(order) => {
                self.answered.commands += 1;
                orders.extend(order);
                json!({"reply": name, "ok": true, "sent_utc": sent_utc})
            }
            Err(error) => {
                self.answered.refused += 1;
                json!({"reply": name, "ok": false, "error": error, "sent_utc": sent_utc})
            }
        }
    }

    /// Returns the name of a command with its order, or with what is wrong.
    fn order(&self, line: &[u8]) -> (String, Result<Option<Order>, String>) {
        let Ok(Value::Object(object)) = serde_json::from_slice::<Value>(line) else {
            return (
                String::new(),
                Err("got no JSON object; wanted {\"command\": \"ping\"} or another command".into()),
            );
        };
        let Some(name) = object.get("command").and_then(Value::as_str) else {
            return (String::new(), Err("got no \"command\"; wanted its name as text".into()));
        };
        let order = match name {
            "ping" => Ok(None),
            "operate" => Ok(Some(Order::Operate)),
            "standby" => Ok(Some(Order::Pause)),
            "reset" => Ok(Some(Order::Reset)),
            "exposure" => match object.get("exposure_ms").and_then(Value::as_f64) {
                Some(ms) => self.limits.exposure(ms * 1e-3).map(Some).ok_or_else(|| self.out_of_range(ms)),
                None => Err("got no \"exposure_ms\"; wanted milliseconds".into()),
            },
            other => Err(format!("got \"{other}\"; wanted ping, operate, standby, reset or exposure")),
        };
        (name.into(), order)
    }

    fn out_of_range(&self, ms: f64) -> String {
        match self.limits.exposure_s {
            Some([least, most]) => format!("exposure_ms is {ms}; wanted {} to {}", least * 1e3, most * 1e3),
            None => "the exposure of this tracker cannot be commanded".into(),
        }
    }
}

fn line_of(value: &Value) -> Wire {
    let mut bytes = value.to_string().into_bytes();
    bytes.push(b'\n');
    Wire::Bytes(bytes)
}

impl Device for JsonDevice {
    fn report(&mut self, report: &Report, now: Tai, out: &mut Vec<Wire>) {
        let q = report.attitude_wxyz.map(|q| self.sense.of(self.continuity.next(q)));
        let finite = |value: f64| value.is_finite().then_some(value);
        out.push(line_of(&json!({
            "tracker": self.head,
            "counter": self.counter,
            "frame": report.frame,
            "utc": report.time_tag.to_rfc3339(),
            "tai_ns": report.time_tag.ns(),
            "sent_utc": now.to_rfc3339(),
            "sent_tai_ns": now.ns(),
            "valid": q.is_some(),
            "mode": mode_name(report.mode),
            "q_wxyz": q,
            "rate_deg_s": report.rate_rad_s.map(|rate| rate.map(f64::to_degrees)),
            "sigma_arcsec": report.sigma_rad.map(|sigma| sigma / ARCSEC),
            "stars": report.stars,
            "exposure_ms": report.exposure_s * 1e3,
            "background_dn": finite(report.background_dn),
            "temperature_c": finite(report.temperature_c),
        })));
        self.counter += 1;
    }

    fn take(&mut self, wire: &Wire, now: Tai, out: &mut Vec<Wire>, orders: &mut Vec<Order>) {
        let Wire::Bytes(bytes) = wire else { return };
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => {
                    let line = core::mem::take(&mut self.line);
                    if !core::mem::take(&mut self.skips) && !line.iter().all(u8::is_ascii_whitespace) {
                        let reply = self.obey(&line, now, orders);
                        out.push(line_of(&reply));
                    }
                }
                _ if self.skips => {}
                _ if self.line.len() >= LINE_MAX => {
                    (self.skips, self.answered.refused) = (true, self.answered.refused + 1);
                    self.line.clear();
                }
                _ => self.line.push(*byte),
            }
        }
    }

    fn answered(&self) -> Answered {
        self.answered
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{lost, report};
    use base::time::Span;

    fn device() -> JsonDevice {
        JsonDevice::new(2, Sense::Starloop, Limits { exposure_s: Some([0.001, 0.08]) })
    }

    fn value(wire: &Wire) -> Value {
        serde_json::from_slice(wire.data()).unwrap()
    }

    #[test]
    fn report_has_attitude_time_and_age() {
        let (mut device, mut out) = (device(), Vec::new());
        let sent = report().time_tag + Span::from_ms(90);
        device.report(&report(), sent, &mut out);
        device.report(&lost(), sent, &mut out);
        let (first, second) = (value(&out[0]), value(&out[1]));
        assert_eq!(first["utc"], "2026-03-01T12:00:00.250000Z");
        assert_eq!(first["sent_utc"], "2026-03-01T12:00:00.340000Z");
        assert_eq!(first["q_wxyz"][1].as_f64(), Some(-0.1_f64.sin()), "all digits of a double");
        assert_eq!((&first["valid"], &first["mode"], &first["tracker"]), (&json!(true), &json!("tracking"), &json!(2)));
        assert_eq!((&second["valid"], &second["q_wxyz"]), (&json!(false), &Value::Null), "control: lost");
    }

    #[test]
    fn commands_are_obeyed_or_refused_with_the_reason() {
        let (mut device, mut out, mut orders) = (device(), Vec::new(), Vec::new());
        let text = "{\"command\": \"ping\"}\n{\"command\": \"standby\"}\n{\"command\": \"exposure\", \"exposure_ms\": 40}\n\
                    {\"command\": \"exposure\", \"exposure_ms\": 400}\n{\"command\": \"dance\"}\nhello\n";
        let (front, back) = text.as_bytes().split_at(30);
        for bytes in [front, back] {
            device.take(&Wire::Bytes(bytes.to_vec()), report().time_tag, &mut out, &mut orders);
        }
        assert_eq!(orders, [Order::Pause, Order::Exposure(Span::from_ms(40))]);
        let replies: Vec<Value> = out.iter().map(value).collect();
        let oks: Vec<_> = replies.iter().map(|reply| reply["ok"] == json!(true)).collect();
        assert_eq!(oks, [true, true, true, false, false, false]);
        assert!(replies[3]["error"].as_str().unwrap().contains("1 to 80"), "{}", replies[3]);
        assert_eq!(device.answered(), Answered { commands: 3, refused: 3 });
    }

    #[test]
    fn endless_line_is_refused_once_and_skipped() {
        let (mut device, mut out, mut orders) = (device(), Vec::new(), Vec::new());
        device.take(&Wire::Bytes(vec![b'{'; 5 * LINE_MAX]), report().time_tag, &mut out, &mut orders);
        device.take(&Wire::Bytes(b"\n{\"command\": \"reset\"}\n".to_vec()), report().time_tag, &mut out, &mut orders);
        assert_eq!((device.answered(), orders), (Answered { commands: 1, refused: 1 }, vec![Order::Reset]));
    }
}
