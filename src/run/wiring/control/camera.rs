//! The requests `camera` and `camera_trigger`: settings of the next exposures, and triggers that start them.
//!
//! ```text
//! {"request": "camera", "head": 0, "exposure_us": 50000, "gain_db": 6}
//! {"request": "camera", "regions": [[100, 80, 32, 32], [400, 300, 32, 32]]}    left, top, width, height, image pixels
//! {"request": "camera", "trigger_mode": true, "trigger_delay_us": 100, "trigger_overlap": "read_out"}
//! {"request": "camera_trigger", "head": 0}         now, or at "at_s"
//! ```
//!
//! The answer has the settings of the next exposure. All settings of a request act at one instant, or none when one is
//! bad.

use crate::runtime::{exposing::Exposing, ledger::Ledger, shutter::NextSlot};
use base::time::{Span, Tai};
use frames::camera_control::{
    AutoMode, CameraCommand, CameraRange, CommandSource, Commanded, ExposureMode, Region, Regions, TriggerOverlap,
    TriggerSource, TriggerSources,
};
use serde_json::{Map, Value, json};

/// Keys of `camera`, in addition to `head` and `at_s`.
pub(super) const KEYS: &[&str] = &[
    "head",
    "at_s",
    "exposure_us",
    "gain_db",
    "black_level_dn",
    "frame_rate_hz",
    "regions",
    "trigger_mode",
    "trigger_source",
    "trigger_delay_us",
    "trigger_overlap",
    "burst",
    "exposure_mode",
    "exposure_auto",
    "gain_auto",
];

/// A camera request of a client.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraRequest {
    /// Number of the head.
    pub head: usize,
    /// When it acts; `None`: now.
    pub at_s: Option<f64>,
    /// Settings, or one trigger.
    pub commands: Vec<CameraCommand>,
}

/// Modes by name.
const AUTO: [(&str, AutoMode); 3] =
    [("off", AutoMode::Off), ("once", AutoMode::Once), ("continuous", AutoMode::Continuous)];
const OVERLAP: [(&str, TriggerOverlap); 3] = [
    ("off", TriggerOverlap::Off),
    ("read_out", TriggerOverlap::ReadOut),
    ("previous_frame", TriggerOverlap::PreviousFrame),
];
const MODE: [(&str, ExposureMode); 2] = [("timed", ExposureMode::Timed), ("trigger_width", ExposureMode::TriggerWidth)];

impl CameraRequest {
    /// Reads the keys of `camera`.
    ///
    /// # Errors
    /// The first key whose value is wrong, with what is wanted.
    pub(super) fn read(head: usize, at_s: Option<f64>, keys: &Map<String, Value>) -> Result<Self, String> {
        let mut commands = Vec::new();
        for (key, value) in keys {
            let command = match key.as_str() {
                "exposure_us" => CameraCommand::Exposure(micros(key, value)?),
                "gain_db" => CameraCommand::GainDb(number(key, value)?),
                "black_level_dn" => CameraCommand::BlackLevelDn(number(key, value)?),
                "frame_rate_hz" => CameraCommand::Period(period(key, value)?),
                "regions" => CameraCommand::Regions(regions(value)?),
                "trigger_mode" => CameraCommand::Triggered(flag(key, value)?),
                "trigger_source" => CameraCommand::Sources(sources(key, value)?),
                "trigger_delay_us" => CameraCommand::Delay(micros(key, value)?),
                "trigger_overlap" => CameraCommand::Overlap(word(key, value, &OVERLAP)?),
                "burst" => CameraCommand::Burst(whole(key, value)?),
                "exposure_mode" => CameraCommand::Mode(word(key, value, &MODE)?),
                "exposure_auto" => CameraCommand::AutoExposure(word(key, value, &AUTO)?),
                "gain_auto" => CameraCommand::AutoGain(word(key, value, &AUTO)?),
                _other => continue,
            };
            commands.push(command);
        }
        // The range of other settings depends on the regions.
        commands.sort_by_key(|command| !matches!(command, CameraCommand::Regions(_)));
        Ok(Self { head, at_s, commands })
    }

    /// Returns a request for a trigger.
    pub(super) fn trigger(head: usize, at_s: Option<f64>) -> Self {
        let command = CameraCommand::Trigger { source: TriggerSource::Control, is_rising: true };
        Self { head, at_s, commands: vec![command] }
    }

    /// Sends all commands to the camera, and answers with the settings of the next exposure.
    ///
    /// # Errors
    /// When the camera cannot do it; then nothing is changed.
    pub(super) fn act(
        &self,
        exposing: &mut Exposing,
        ledger: &mut Ledger,
        zero: Tai,
        now: Tai,
    ) -> Result<Value, String> {
        let at = self.at_s.map_or(now, |at_s| zero + Span::from_s(at_s));
        if at < now {
            let now_s = (now - zero).s();
            return Err(format!(
                "at_s is {} and has passed (it is {now_s} s now); leave it out for now",
                (at - zero).s()
            ));
        }
        let range = match self.commands.first() {
            Some(CameraCommand::Regions(regions)) => exposing.range_reading(regions),
            _ => exposing.range().copied(),
        };
        let range = &range.ok_or("this head is drawn for a display, which has no exposure to command")?;
        for command in &self.commands {
            range.check(command).map_err(|why| {
                let [got, wanted] = described(command, range);
                format!("{got} is {why}; wanted {wanted}")
            })?;
        }
        for command in &self.commands {
            let commanded = Commanded { command: *command, at, from: CommandSource::Control };
            exposing.take(&commanded, ledger).map_err(|why| why.to_string())?;
        }
        Ok(answer(exposing, zero))
    }
}

fn answer(exposing: &Exposing, zero: Tai) -> Value {
    let settings = exposing.next_settings();
    let regions: Vec<Value> = settings
        .regions
        .as_slice()
        .iter()
        .map(|region| json!([region.left_px, region.top_px, region.width_px, region.height_px]))
        .collect();
    let mut next = json!({
        "exposure_us": settings.exposure.s() * 1e6,
        "gain_db": settings.gain_db,
        "black_level_dn": settings.black_level_dn,
        "regions": regions,
    });
    match exposing.next() {
        NextSlot::Slot(slot) => {
            next["frame"] = slot.number.into();
            next["start_s"] = (slot.exposure_start - zero).s().into();
        }
        NextSlot::Waiting(_) if !exposing.start().is_triggered => {
            next["waits_for"] = "command: no exposure fits into the run with these settings".into();
        }
        NextSlot::Waiting(_) => next["waits_for"] = "trigger".into(),
        NextSlot::Over => next["waits_for"] = "nothing: no exposure fits into the run any more".into(),
    }
    json!({ "next": next })
}

/// Returns a command as key and value, and the range that the camera accepts instead.
fn described(command: &CameraCommand, range: &CameraRange) -> [String; 2] {
    let us = |span: Span| span.s() * 1e6;
    match command {
        CameraCommand::Exposure(exposure) => {
            let [least, most] = range.exposure.map(us);
            [format!("exposure_us = {}", us(*exposure)), format!("{least} to {most} us")]
        }
        CameraCommand::GainDb(gain_db) => {
            let [least, most] = range.gain_db;
            [format!("gain_db = {gain_db}"), format!("{least} to {most} dB")]
        }
        CameraCommand::BlackLevelDn(level_dn) => {
            let [least, most] = range.black_level_dn;
            [format!("black_level_dn = {level_dn}"), format!("{least} to {most} DN")]
        }
        CameraCommand::Regions(regions) => {
            let [width, height] = range.size_px;
            [format!("regions = {regions:?}"), format!("parts of an image of {width} x {height} pixels")]
        }
        CameraCommand::Period(period) => {
            let rate_hz = period.map_or(f64::NAN, |period| 1.0 / period.s());
            [
                format!("frame_rate_hz = {rate_hz}"),
                format!("at most {} Hz, by the readout time", range.frame_rate_max_hz),
            ]
        }
        CameraCommand::Delay(delay) => {
            [format!("trigger_delay_us = {}", us(*delay)), format!("0 to {} us", us(range.delay_max))]
        }
        CameraCommand::Burst(frames) => [format!("burst = {frames}"), "1 or more frames".into()],
        CameraCommand::Triggered(_)
        | CameraCommand::Sources(_)
        | CameraCommand::Overlap(_)
        | CameraCommand::Mode(_)
        | CameraCommand::AutoExposure(_)
        | CameraCommand::AutoGain(_)
        | CameraCommand::Trigger { .. } => [format!("{command:?}"), "a value of the list in the guide".into()],
    }
}

fn number(key: &str, value: &Value) -> Result<f64, String> {
    value.as_f64().ok_or_else(|| format!("{key} is {value}; wanted a number"))
}

fn micros(key: &str, value: &Value) -> Result<Span, String> {
    Ok(Span::from_s(number(key, value)?.clamp(-1e12, 1e12) * 1e-6))
}

/// Reads a period; `null` means as fast as exposure and readout allow.
fn period(key: &str, value: &Value) -> Result<Option<Span>, String> {
    if value.is_null() {
        return Ok(None);
    }
    let rate_hz = number(key, value)?;
    if rate_hz > 1e-4 {
        Ok(Some(Span::from_s(1.0 / rate_hz)))
    } else {
        Err(format!("{key} is {rate_hz}; wanted more than 0"))
    }
}

fn flag(key: &str, value: &Value) -> Result<bool, String> {
    value.as_bool().ok_or_else(|| format!("{key} is {value}; wanted true or false"))
}

fn whole(key: &str, value: &Value) -> Result<u32, String> {
    let number = value.as_u64().and_then(|number| u32::try_from(number).ok());
    number.ok_or_else(|| format!("{key} is {value}; wanted a whole number"))
}

fn word<T: Copy>(key: &str, value: &Value, words: &[(&str, T)]) -> Result<T, String> {
    let found = value.as_str().and_then(|text| words.iter().find(|(name, _)| *name == text));
    let names = || words.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    found.map(|(_, meant)| *meant).ok_or_else(|| format!("{key} is {value}; wanted one of: {}", names()))
}

fn sources(key: &str, value: &Value) -> Result<TriggerSources, String> {
    if value.as_str() == Some("any") {
        return Ok(TriggerSources::ALL);
    }
    word(key, value, &TriggerSource::NAMED).map(TriggerSources::only)
}

fn regions(value: &Value) -> Result<Regions, String> {
    let wanted = "wanted a list of at most 32 lists [left, top, width, height] in image pixels; [] for the whole image";
    let list: Vec<[u32; 4]> =
        serde_json::from_value(value.clone()).map_err(|error| format!("regions: {error}; {wanted}"))?;
    let of = |[left_px, top_px, width_px, height_px]: [u32; 4]| Region { left_px, top_px, width_px, height_px };
    let regions: Vec<Region> = list.into_iter().map(of).collect();
    Regions::of(&regions).ok_or_else(|| format!("regions has {} parts; {wanted}", regions.len()))
}
