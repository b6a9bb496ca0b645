//! Plain JSON: one object per datagram or line, for whoever wants to read a tracker with a few lines of a script.
//!
//! A report has `utc` (middle of the exposure), `sent_utc`, `q_wxyz` in the sense that was chosen, `rate_deg_s`,
//! `sigma_arcsec`, `stars`, `mode`, `valid`. A client may send objects, one to a line or datagram: `{"command":
//! "ping"}`, `"operate"`, `"standby"`, `"reset"`, and `{"command": "exposure", "exposure_ms": 40}`; each is answered by
//! an object with `reply`, `ok` and, where it is refused, `error`.
//!
//! The other direction, [`JsonReader`]: an object with `q_wxyz` (`null`: no attitude) is an answer to the frame that it
//! names by `frame`, by `tai_ns` (middle of the exposure), or both; `stars` and all other keys may be there.

use crate::device::Continuity;
use crate::reading::{Measured, Reader, unit};
use crate::{Answered, Device, Limits, Mode, Order, Report, Sense, Wire};
use base::{time::Tai, units::ARCSEC};
use serde_json::{Value, json};

/// Longest command, bytes.
pub const LINE_MAX: usize = 512;
/// Longest report that is read, bytes.
const REPORT_MAX: usize = 4096;

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

/// Reads reports, one object to a line.
#[derive(Debug, Default)]
pub struct JsonReader {
    sense: Sense,
    line: Vec<u8>,
    skips: bool,
    damaged: u64,
}

impl JsonReader {
    /// Returns a reader of quaternions of this sense.
    pub fn new(sense: Sense) -> Self {
        Self { sense, ..Self::default() }
    }

    /// Returns what a line says; `None` of one without an attitude, such as the reply to a command.
    fn measured(&self, line: &[u8], at: Tai) -> Option<Result<Measured, ()>> {
        let Ok(Value::Object(object)) = serde_json::from_slice::<Value>(line) else { return Some(Err(())) };
        let q = object.get("q_wxyz")?;
        let given = |key: &str| object.get(key).filter(|value| !value.is_null());
        let read = || {
            let q: Option<[f64; 4]> = serde_json::from_value(q.clone()).ok()?;
            let is_valid = given("valid") != Some(&Value::Bool(false));
            let attitude_wxyz = match q.filter(|_| is_valid) {
                Some(q) => Some(self.sense.of(unit(q)?)),
                None => None,
            };
            let frame = given("frame").map(|frame| u32::try_from(frame.as_u64()?).ok());
            let stars = given("stars").map(|stars| u16::try_from(stars.as_u64()?).ok());
            let tai_ns = given("tai_ns").map(Value::as_i64);
            let (frame, time_tag, stars) = (all(frame)?, all(tai_ns)?.map(Tai::from_ns), all(stars)?);
            Some(Measured { at, time_tag, frame, attitude_wxyz, stars })
        };
        Some(read().ok_or(()))
    }
}

/// Returns a value that may be left out; `None` of one that is there and cannot be read.
fn all<T>(value: Option<Option<T>>) -> Option<Option<T>> {
    value.map_or(Some(None), |value| value.map(Some))
}

impl Reader for JsonReader {
    fn take(&mut self, wire: &Wire, at: Tai, out: &mut Vec<Measured>) {
        let Wire::Bytes(bytes) = wire else { return };
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => {
                    let line = core::mem::take(&mut self.line);
                    if core::mem::take(&mut self.skips) || line.iter().all(u8::is_ascii_whitespace) {
                        continue;
                    }
                    match self.measured(&line, at) {
                        Some(Ok(measured)) => out.push(measured),
                        Some(Err(())) => self.damaged += 1,
                        None => {}
                    }
                }
                _ if self.skips => {}
                _ if self.line.len() >= REPORT_MAX => {
                    (self.skips, self.damaged) = (true, self.damaged + 1);
                    self.line.clear();
                }
                _ => self.line.push(*byte),
            }
        }
    }

    fn damaged(&self) -> u64 {
        self.damaged
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
    fn an_answer_names_its_frame_by_number_or_time_and_a_bad_one_is_counted() {
        let at = report().time_tag;
        let read = |text: &str| {
            let (mut reader, mut out) = (JsonReader::default(), Vec::new());
            reader.take(&Wire::Bytes(format!("{text}\n").into_bytes()), at, &mut out);
            (out.first().copied(), reader.damaged())
        };
        let whole = read(r#"{"frame": 7, "tai_ns": 99, "q_wxyz": [0.6, 0, 0.8, 0], "stars": 9}"#).0.unwrap();
        assert_eq!((whole.frame, whole.time_tag, whole.stars), (Some(7), Some(Tai::from_ns(99)), Some(9)));
        assert_eq!(whole.attitude_wxyz, Some([0.6, 0.0, 0.8, 0.0]));
        for lost in [r#"{"frame": 7, "q_wxyz": null}"#, r#"{"frame": 7, "valid": false, "q_wxyz": [1, 0, 0, 0]}"#] {
            assert_eq!(read(lost).0.map(|measured| measured.attitude_wxyz), Some(None), "{lost}");
        }
        for bad in ["{", r#"{"q_wxyz": [1, 1, 0, 0]}"#, r#"{"q_wxyz": [1, 0]}"#, r#"{"frame": -1, "q_wxyz": null}"#] {
            assert_eq!(read(bad), (None, 1), "{bad}");
        }
        assert_eq!(read(r#"{"reply": "ping"}"#), (None, 0), "control: passed over");
    }

    #[test]
    fn endless_line_is_refused_once_and_skipped() {
        let (mut device, mut out, mut orders) = (device(), Vec::new(), Vec::new());
        device.take(&Wire::Bytes(vec![b'{'; 5 * LINE_MAX]), report().time_tag, &mut out, &mut orders);
        device.take(&Wire::Bytes(b"\n{\"command\": \"reset\"}\n".to_vec()), report().time_tag, &mut out, &mut orders);
        assert_eq!((device.answered(), orders), (Answered { commands: 1, refused: 1 }, vec![Order::Reset]));
    }
}
