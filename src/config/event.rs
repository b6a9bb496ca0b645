//! `[[event]]`: commands to the flight computer and faults, each at its time.
//!
//! A key that a word has no use for is refused: it would be given in vain. Words: `event_word`; their values:
//! `event_reader`. Tests: `event_tests`.

use crate::event_word::{ACTIONS, EventKeys, OF_ALL, words};
use crate::key::{Given, Section};
use crate::{check::Checker, document::Document, error::Result, event_reader::Reader};
use base::time::Span;
use frames::sink::FrameFault;
use link::tap::LinkFault;
use std::path::Path;
use testbed::vehicle::VehicleFault;

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

/// A command or fault with its values.
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
    /// A share of what is on the bus towards the flight computer is lost.
    BusBackLoss {
        /// 0 to 1.
        share: f64,
    },
    /// Fault of the frames of one head, or of all.
    Frame {
        /// Which head; `None`: all.
        head: Option<usize>,
        /// Fault of these frames.
        fault: FrameFault,
    },
    /// Fault aboard a spacecraft that is flown inside the program.
    Aboard(VehicleFault),
    /// A trigger is fired: faults that wait for it begin.
    Trigger {
        /// Which.
        number: u16,
    },
}

impl Action {
    /// Returns whether it acts aboard a spacecraft that is flown inside the program.
    pub fn is_aboard(&self) -> bool {
        match self {
            Self::Slew(_) | Self::Safe | Self::Resume | Self::Aboard(_) => true,
            Self::Bus(_) | Self::BusBackLoss { .. } | Self::Frame { .. } | Self::Trigger { .. } => false,
        }
    }
}

/// Something at its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// After the first exposure; after the trigger, when it waits for one.
    pub at: Span,
    /// The trigger it waits for.
    pub on_trigger: Option<u16>,
    /// How long it lasts; zero for commands.
    pub lasts: Span,
    /// The command or fault.
    pub action: Action,
}

impl Event {
    /// Checks one event that comes from outside a file, with the keys of `[[event]]`; without a time it is `now_s`.
    /// Frames are `frame_period` apart.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn from_json(
        event: &serde_json::Map<String, serde_json::Value>,
        now_s: f64,
        frame_period: Span,
    ) -> Result<Self> {
        let document = Document::of_json(event, Path::new("injected event"))?;
        let keys = document.read_as::<EventKeys>()?.begun_by(now_s.max(0.0));
        Self::check(&keys, 0, frame_period, &mut Checker::new(&document))
    }

    /// Checks `keys`, the event number `place` of the document.
    pub(super) fn check(keys: &EventKeys, place: usize, frame_period: Span, check: &mut Checker<'_>) -> Result<Self> {
        let keys = keys.at(&format!("event[{place}]"));
        if !keys.r#do().is_given() {
            return Err(keys.r#do().missing(format!("one of {}", words(|_| true)), check));
        }
        let row = keys.r#do().check(check)?;
        for (name, _) in keys.given().iter().filter(|(name, _)| !OF_ALL.contains(name) && !row.has_key(name)) {
            keys.refuse(&[name], &format!("do = {}", words(|row| row.has_key(name))), check)?;
        }
        if !row.lasts() {
            keys.refuse(&["for_frames"], "events that last", check)?;
        }
        let mut reader = Reader { keys: &keys, check };
        let (at, on_trigger) = reader.begin(&row, frame_period)?;
        let action = (row.read)(&mut reader)?;
        let lasts = if row.lasts() { reader.lasts(frame_period)? } else { Span::ZERO };
        Ok(Self { at, on_trigger, lasts, action })
    }

    /// Returns every word for `do` with its keys, a line each; optional keys are in brackets.
    pub fn described_words() -> String {
        let mut text = String::new();
        for (word, row) in ACTIONS {
            let [needed, optional] = row.keys();
            let optional = optional.iter().map(|name| format!("[{name}]"));
            let keys: Vec<String> = needed.iter().map(|name| (*name).to_owned()).chain(optional).collect();
            text.push_str(format!("  {word:<20} {}", keys.join(", ")).trim_end());
            text.push('\n');
        }
        text
    }
}

impl Pointing {
    /// Reads right ascension, declination and roll, which may be left out.
    pub(super) fn check(angles: [Given<'_, f64>; 3], check: &mut Checker<'_>) -> Result<Self> {
        let [ra, dec, roll] = angles;
        Ok(Self { ra_deg: ra.check(check)?, dec_deg: dec.check(check)?, roll_deg: roll.check(check)? })
    }
}

#[cfg(test)]
#[path = "event_tests.rs"]
pub(crate) mod tests;
