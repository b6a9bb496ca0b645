//! `[[event]]`: commands to the flight computer and faults, each at its time.
//!
//! A key that a word has no use for is refused: it would be given in vain. Tests: `event_tests`.

use crate::base::time::Span;
use crate::base::units::DEG;
use crate::config::check::{Checker, Rule};
use crate::config::document::Document;
use crate::config::error::ConfigError;
use crate::link::tap::LinkFault;
use crate::sink::FrameFault;
use glam::DVec3;
use serde::Deserialize;
use std::path::Path;

/// Direction and roll of a sensor, deg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pointing {
    /// Right ascension of the boresight.
    pub ra_deg: f64,
    /// Declination of the boresight.
    pub dec_deg: f64,
    /// Position angle of the image's up direction, east of north.
    pub roll_deg: f64,
}

/// A way a gyro fails.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GyroFaultKind {
    /// No reading.
    Dropout,
    /// The same reading again and again.
    Stuck,
    /// Its bias steps by this, rad/s.
    BiasJump(DVec3),
    /// Readings are off by this, rad/s, while it lasts.
    Spike(DVec3),
}

/// What happens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// Command: slew there and stay.
    Slew(Pointing),
    /// Command: safe mode.
    Safe,
    /// Command: back to pointing.
    Resume,
    /// Fault on the bus towards the stimulator.
    Bus(LinkFault),
    /// Fault on the bus towards the flight computer.
    BusBack(LinkFault),
    /// Fault of the frames of one head, or of all.
    Frame {
        /// Which head; `None`: all.
        head: Option<usize>,
        /// What happens to them.
        fault: FrameFault,
    },
    /// Fault of the gyro.
    Gyro(GyroFaultKind),
    /// One wheel fails for good.
    WheelFailure {
        /// Which, from 0.
        wheel: usize,
    },
    /// A tracker gives nothing.
    TrackerOff {
        /// Which head; `None`: all.
        head: Option<usize>,
    },
}

/// Something at its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// After the first exposure.
    pub at: Span,
    /// How long it lasts; zero for commands.
    pub lasts: Span,
    /// What it is.
    pub action: Action,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct EventKeys {
    at_s: Option<f64>,
    for_s: Option<f64>,
    #[serde(rename = "do")]
    action: Option<String>,
    ra_deg: Option<f64>,
    dec_deg: Option<f64>,
    roll_deg: Option<f64>,
    share: Option<f64>,
    delay_ms: Option<f64>,
    jitter_ms: Option<f64>,
    can_id: Option<i64>,
    period_ms: Option<f64>,
    bytes: Option<i64>,
    step_ms: Option<f64>,
    ppm: Option<f64>,
    late_ms: Option<f64>,
    e_per_s: Option<f64>,
    rate_deg_h: Option<[f64; 3]>,
    head: Option<i64>,
    wheel: Option<i64>,
}

/// Every word for `do`, and what it is.
const ACTIONS: [(&str, Kind); 27] = [
    ("slew", Kind::Slew),
    ("safe", Kind::Safe),
    ("resume", Kind::Resume),
    ("bus_loss", Kind::BusLoss),
    ("bus_silence", Kind::BusSilence),
    ("bus_delay", Kind::BusDelay),
    ("bus_duplicate", Kind::BusDuplicate),
    ("bus_wrong_bits", Kind::BusWrongBits),
    ("bus_reorder", Kind::BusReorder),
    ("bus_truncate", Kind::BusTruncate),
    ("bus_babble", Kind::BusBabble),
    ("bus_off", Kind::BusOff),
    ("clock_step", Kind::ClockStep),
    ("clock_drift", Kind::ClockDrift),
    ("bus_back_loss", Kind::BusBackLoss),
    ("frame_drop", Kind::FrameDrop),
    ("frame_duplicate", Kind::FrameDuplicate),
    ("frame_late", Kind::FrameLate),
    ("frame_torn", Kind::FrameTorn),
    ("frame_blank", Kind::FrameBlank),
    ("stray_light", Kind::StrayLight),
    ("gyro_dropout", Kind::GyroDropout),
    ("gyro_stuck", Kind::GyroStuck),
    ("gyro_bias_jump", Kind::GyroBiasJump),
    ("gyro_spike", Kind::GyroSpike),
    ("wheel_failure", Kind::WheelFailure),
    ("tracker_off", Kind::TrackerOff),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Slew,
    Safe,
    Resume,
    BusLoss,
    BusSilence,
    BusDelay,
    BusDuplicate,
    BusWrongBits,
    BusReorder,
    BusTruncate,
    BusBabble,
    BusOff,
    ClockStep,
    ClockDrift,
    BusBackLoss,
    FrameDrop,
    FrameDuplicate,
    FrameLate,
    FrameTorn,
    FrameBlank,
    StrayLight,
    GyroDropout,
    GyroStuck,
    GyroBiasJump,
    GyroSpike,
    WheelFailure,
    TrackerOff,
}

impl Event {
    /// Checks one event that comes from outside a file, with the keys of `[[event]]`; without `at_s` it is `now_s`.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn from_json(event: &serde_json::Map<String, serde_json::Value>, now_s: f64) -> Result<Self, ConfigError> {
        let place = Path::new("injected event");
        let text = toml::to_string(event).map_err(|error| ConfigError::Syntax {
            place: place.display().to_string(),
            why: format!("{error}; leave out what has no value"),
            text: serde_json::to_string(event).unwrap_or_default(),
        })?;
        let document = Document::from_text(&text, place);
        let mut keys: EventKeys = document.read_as()?;
        keys.at_s = keys.at_s.or(Some(now_s.max(0.0)));
        Self::check(&keys, 0, &mut Checker::new(&document))
    }

    /// Checks `keys`, the event number `place` of the document.
    pub(super) fn check(keys: &EventKeys, place: usize, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let key = |name: &str| format!("event[{place}].{name}");
        let after = "seconds after the first exposure";
        let at_s = check.required(&key("at_s"), keys.at_s, Rule::NotNegative, after)?;
        if keys.action.is_none() {
            let wanted = format!("one of {}", words(|_| true));
            return Err(check.invalid(&key("do"), "missing", wanted, "what happens"));
        }
        let advice = "what happens";
        let kind = check.choice(&key("do"), keys.action.as_deref(), &ACTIONS, advice)?;
        for (name, is_given) in keys.given() {
            if !kind.has_key(name) {
                check.unused(&key(name), is_given, &format!("do = {}", words(|kind| kind.has_key(name))))?;
            }
        }
        let action = Reader { keys, place, check }.action(kind)?;
        let lasts_s = if kind.has_key("for_s") {
            check.required(&key("for_s"), keys.for_s, Rule::Positive, "how many seconds it lasts")?
        } else {
            0.0
        };
        Ok(Self { at: Span::from_s(at_s), lasts: Span::from_s(lasts_s), action })
    }

    /// Every word for `do` with its keys, a line each; keys that may be left out stand in brackets.
    #[must_use]
    pub fn described_words() -> String {
        let mut text = String::new();
        for (word, kind) in ACTIONS {
            let (needed, optional) = kind.keys();
            let optional = optional.iter().map(|name| format!("[{name}]"));
            let keys: Vec<String> = needed.iter().map(|name| (*name).to_owned()).chain(optional).collect();
            text.push_str(format!("  {word:<15} {}", keys.join(", ")).trim_end());
            text.push('\n');
        }
        text
    }
}

impl EventKeys {
    /// Every key that belongs to some words only, and whether it is given.
    fn given(&self) -> [(&'static str, bool); 17] {
        [
            ("for_s", self.for_s.is_some()),
            ("ra_deg", self.ra_deg.is_some()),
            ("dec_deg", self.dec_deg.is_some()),
            ("roll_deg", self.roll_deg.is_some()),
            ("share", self.share.is_some()),
            ("delay_ms", self.delay_ms.is_some()),
            ("jitter_ms", self.jitter_ms.is_some()),
            ("can_id", self.can_id.is_some()),
            ("period_ms", self.period_ms.is_some()),
            ("bytes", self.bytes.is_some()),
            ("step_ms", self.step_ms.is_some()),
            ("ppm", self.ppm.is_some()),
            ("late_ms", self.late_ms.is_some()),
            ("e_per_s", self.e_per_s.is_some()),
            ("rate_deg_h", self.rate_deg_h.is_some()),
            ("head", self.head.is_some()),
            ("wheel", self.wheel.is_some()),
        ]
    }
}

/// The words whose kind is wanted, each in quotes.
fn words(is_wanted: impl Fn(Kind) -> bool) -> String {
    let wanted = ACTIONS.iter().filter(|(_, kind)| is_wanted(*kind));
    wanted.map(|(word, _)| format!("\"{word}\"")).collect::<Vec<_>>().join(", ")
}

impl Kind {
    /// The keys that go with it beside `at_s` and `do`: those it needs, and those that may be left out.
    fn keys(self) -> (&'static [&'static str], &'static [&'static str]) {
        match self {
            Self::Slew => (&["ra_deg", "dec_deg"], &["roll_deg"]),
            Self::Safe | Self::Resume => (&[], &[]),
            Self::BusLoss | Self::BusDuplicate | Self::BusWrongBits | Self::BusTruncate | Self::BusBackLoss => {
                (&["for_s", "share"], &[])
            }
            Self::BusReorder => (&["for_s", "share", "delay_ms"], &[]),
            Self::BusBabble => (&["for_s", "can_id", "period_ms"], &["bytes"]),
            Self::ClockStep => (&["for_s", "step_ms"], &[]),
            Self::ClockDrift => (&["for_s", "ppm"], &[]),
            Self::BusSilence | Self::BusOff | Self::GyroDropout | Self::GyroStuck => (&["for_s"], &[]),
            Self::BusDelay => (&["for_s", "delay_ms"], &["jitter_ms"]),
            Self::FrameDrop | Self::FrameDuplicate | Self::FrameTorn | Self::FrameBlank | Self::TrackerOff => {
                (&["for_s"], &["head"])
            }
            Self::FrameLate => (&["for_s", "late_ms"], &["head"]),
            Self::StrayLight => (&["for_s", "e_per_s"], &["head"]),
            Self::GyroBiasJump => (&["rate_deg_h"], &[]),
            Self::GyroSpike => (&["for_s", "rate_deg_h"], &[]),
            Self::WheelFailure => (&["wheel"], &[]),
        }
    }

    fn has_key(self, name: &str) -> bool {
        let (needed, optional) = self.keys();
        needed.contains(&name) || optional.contains(&name)
    }
}

/// Reads the keys of one event.
struct Reader<'a, 'd> {
    keys: &'a EventKeys,
    place: usize,
    check: &'a mut Checker<'d>,
}

impl Reader<'_, '_> {
    fn action(&self, kind: Kind) -> Result<Action, ConfigError> {
        let frame = |fault| Ok(Action::Frame { head: self.number("head", self.keys.head)?, fault });
        Ok(match kind {
            Kind::Slew => Action::Slew(self.pointing()?),
            Kind::Safe => Action::Safe,
            Kind::Resume => Action::Resume,
            Kind::BusLoss => Action::Bus(LinkFault::Loss { share: self.share()? }),
            Kind::BusSilence => Action::Bus(LinkFault::Silence),
            Kind::BusDelay => Action::Bus(LinkFault::Delay {
                by: self.milliseconds("delay_ms", self.keys.delay_ms)?,
                jitter: self.milliseconds("jitter_ms", Some(self.keys.jitter_ms.unwrap_or(0.0)))?,
            }),
            Kind::BusDuplicate => Action::Bus(LinkFault::Duplicate { share: self.share()? }),
            Kind::BusWrongBits => Action::Bus(LinkFault::WrongBits { share: self.share()? }),
            Kind::BusReorder => Action::Bus(LinkFault::Reorder {
                share: self.share()?,
                by: self.milliseconds("delay_ms", self.keys.delay_ms)?,
            }),
            Kind::BusTruncate => Action::Bus(LinkFault::Truncate { share: self.share()? }),
            Kind::BusBabble => Action::Bus(self.babble()?),
            Kind::BusOff => Action::Bus(LinkFault::Off),
            Kind::ClockStep => {
                let advice = "milliseconds, below zero for a clock that falls behind";
                let ms = self.required("step_ms", self.keys.step_ms, Rule::Within(-60_000.0, 60_000.0), advice)?;
                Action::Bus(LinkFault::ClockStep { by: Span::from_s(ms * 1e-3) })
            }
            Kind::ClockDrift => {
                let advice = "parts per million, below zero for a slow clock";
                let ppm = self.required("ppm", self.keys.ppm, Rule::Within(-10_000.0, 10_000.0), advice)?;
                Action::Bus(LinkFault::ClockDrift { ppm })
            }
            Kind::BusBackLoss => Action::BusBack(LinkFault::Loss { share: self.share()? }),
            Kind::FrameDrop => frame(FrameFault::Drop)?,
            Kind::FrameDuplicate => frame(FrameFault::Duplicate)?,
            Kind::FrameLate => frame(FrameFault::Late(self.milliseconds("late_ms", self.keys.late_ms)?))?,
            Kind::FrameTorn => frame(FrameFault::Torn)?,
            Kind::FrameBlank => frame(FrameFault::Blank)?,
            Kind::StrayLight => {
                let advice = "electrons per second in every pixel, such as 200000.0";
                let e_per_s = self.required("e_per_s", self.keys.e_per_s, Rule::PositiveUpTo(1e12), advice)?;
                frame(FrameFault::StrayLight { e_per_s })?
            }
            Kind::GyroDropout => Action::Gyro(GyroFaultKind::Dropout),
            Kind::GyroStuck => Action::Gyro(GyroFaultKind::Stuck),
            Kind::GyroBiasJump => Action::Gyro(GyroFaultKind::BiasJump(self.rate()?)),
            Kind::GyroSpike => Action::Gyro(GyroFaultKind::Spike(self.rate()?)),
            Kind::WheelFailure => {
                let missing = || self.check.invalid(&self.key("wheel"), "missing", "its number, from 0", "such as 2");
                Action::WheelFailure { wheel: self.number("wheel", self.keys.wheel)?.ok_or_else(missing)? }
            }
            Kind::TrackerOff => Action::TrackerOff { head: self.number("head", self.keys.head)? },
        })
    }

    fn key(&self, name: &str) -> String {
        format!("event[{}].{name}", self.place)
    }

    fn required(&self, name: &str, given: Option<f64>, rule: Rule, advice: &str) -> Result<f64, ConfigError> {
        self.check.required(&self.key(name), given, rule, advice)
    }

    fn babble(&self) -> Result<LinkFault, ConfigError> {
        let advice = "milliseconds from one packet to the next, such as 0.5";
        let period_ms = self.required("period_ms", self.keys.period_ms, Rule::Within(0.05, 60_000.0), advice)?;
        let id =
            self.whole("can_id", self.keys.can_id, 0x7FF, "an identifier of 11 bits, such as 0x123; no use on serial")?;
        let bytes = self.whole("bytes", Some(self.keys.bytes.unwrap_or(8)), 64, "bytes of content, 8 if left out")?;
        Ok(LinkFault::Babble { id, period: Span::from_s(period_ms * 1e-3), bytes })
    }

    fn whole<N: TryFrom<i64>>(
        &self,
        name: &str,
        given: Option<i64>,
        most: i64,
        advice: &str,
    ) -> Result<N, ConfigError> {
        let got = given.map_or_else(|| "missing".into(), |number| number.to_string());
        let fits = given.filter(|number| (0..=most).contains(number)).and_then(|number| N::try_from(number).ok());
        fits.ok_or_else(|| self.check.invalid(&self.key(name), got, format!("a whole number from 0 to {most}"), advice))
    }

    fn share(&self) -> Result<f64, ConfigError> {
        self.required("share", self.keys.share, Rule::Within(0.0, 1.0), "a share of the packets, 0 to 1")
    }

    fn milliseconds(&self, name: &str, given: Option<f64>) -> Result<Span, ConfigError> {
        let ms = self.required(name, given, Rule::Within(0.0, 60_000.0), "milliseconds")?;
        Ok(Span::from_s(ms * 1e-3))
    }

    fn rate(&self) -> Result<DVec3, ConfigError> {
        let advice = "degrees per hour about the body axes, such as [5.0, 0.0, 0.0]";
        let missing = || self.check.invalid(&self.key("rate_deg_h"), "missing", "three finite numbers", advice);
        let rate_deg_h = self.keys.rate_deg_h.ok_or_else(missing)?;
        for component in rate_deg_h {
            self.check.meets(&self.key("rate_deg_h"), component, Rule::Within(-1e6, 1e6), advice)?;
        }
        Ok(DVec3::from_array(rate_deg_h) * (DEG / 3600.0))
    }

    fn number(&self, name: &str, given: Option<i64>) -> Result<Option<usize>, ConfigError> {
        let Some(number) = given else { return Ok(None) };
        let refuse = || self.check.invalid(&self.key(name), number, "a number from 0 to 15", "counted from 0");
        usize::try_from(number).ok().filter(|number| *number < 16).map(Some).ok_or_else(refuse)
    }

    fn pointing(&self) -> Result<Pointing, ConfigError> {
        let key = |name: &str| self.key(name);
        Pointing::check([self.keys.ra_deg, self.keys.dec_deg, self.keys.roll_deg], key, self.check)
    }
}

impl Pointing {
    /// Three angles; roll may be left out.
    pub(super) fn check(
        given: [Option<f64>; 3],
        key: impl Fn(&str) -> String,
        check: &Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let [ra_deg, dec_deg, roll_deg] = given;
        let turn = Rule::Within(-360.0, 360.0);
        Ok(Self {
            ra_deg: check.required(&key("ra_deg"), ra_deg, turn, "degrees, not hours: 5h 30m is 82.5")?,
            dec_deg: check.required(&key("dec_deg"), dec_deg, Rule::Within(-90.0, 90.0), "degrees")?,
            roll_deg: check.required(&key("roll_deg"), Some(roll_deg.unwrap_or(0.0)), turn, "degrees")?,
        })
    }
}

#[cfg(test)]
#[path = "event_tests.rs"]
mod tests;
