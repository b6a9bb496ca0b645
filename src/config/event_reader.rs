//! Keys of one event -> its values, and when and for how long it happens.

use crate::event_row::{Row, Timing};
use crate::key::{Given, Section, taken};
use crate::key_type::{KeyType, Raw, Shape, Whole};
use crate::{check::Checker, error::ConfigError, event_word::EventKeys};
use base::{time::Span, units::DEG};
use core::fmt;
use firmware_protocol::can::CanId;
use frames::sink::{DefectSpots, FaultPixels};
use glam::DVec3;
use serde::Deserialize;

/// Reads the keys of one event.
pub(super) struct Reader<'a, 'd> {
    pub(super) keys: &'a EventKeys,
    pub(super) check: &'a mut Checker<'d>,
}

/// A value of an action that one key makes.
pub(super) trait Taken<T: KeyType>: Sized {
    fn taken(given: Given<'_, T>, check: &mut Checker<'_>) -> Result<Self, ConfigError>;
}

impl Taken<f64> for f64 {
    fn taken(given: Given<'_, f64>, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        given.check(check)
    }
}

impl<N: TryFrom<i64>> Taken<Whole<N>> for N {
    fn taken(given: Given<'_, Whole<N>>, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        given.check(check)
    }
}

/// Which head; `None`: all.
impl Taken<Whole<usize>> for Option<usize> {
    fn taken(given: Given<'_, Whole<usize>>, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        given.optional(check)
    }
}

/// Milliseconds.
impl Taken<f64> for Span {
    fn taken(given: Given<'_, f64>, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        given.ms(check)
    }
}

/// A CAN identifier as a file gives it: a number is one of 11 bits, a text of 8 hexadecimal digits one of 29, as log files
/// have them.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub(super) enum Identifier {
    Number(i64),
    Digits(String),
}

impl Identifier {
    pub(super) fn shape() -> Shape {
        Shape::either(Shape::Whole(0..=0x7FF), Shape::Text("8 hexadecimal digits"))
    }

    fn id(&self) -> Option<CanId> {
        match self {
            Self::Number(number) => u16::try_from(*number).ok().and_then(CanId::standard),
            Self::Digits(digits) => {
                let is_long = digits.len() == 8 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
                u32::from_str_radix(digits, 16).ok().filter(|_| is_long).and_then(CanId::extended)
            }
        }
    }
}

impl fmt::Display for Identifier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Digits(digits) => write!(f, "\"{digits}\""),
        }
    }
}

impl Taken<Raw<Identifier>> for CanId {
    fn taken(given: Given<'_, Raw<Identifier>>, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let wanted = "a whole number from 0 to 2047, or 8 hexadecimal digits in quotes up to \"1FFFFFFF\"";
        let Some(raw) = given.raw() else { return Err(given.missing(wanted, check)) };
        raw.id().ok_or_else(|| given.invalid(raw, wanted, check))
    }
}

/// A rate in degrees per hour.
impl Taken<[f64; 3]> for DVec3 {
    fn taken(given: Given<'_, [f64; 3]>, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        Ok(Self::from_array(given.check(check)?) * (DEG / 3600.0))
    }
}

impl Reader<'_, '_> {
    /// Returns a pixel that is given and a number of random ones; one at random when neither is said.
    pub(super) fn pixels(&self, most: i64) -> Result<FaultPixels, ConfigError> {
        let px = self.keys.px();
        let along = |given: i64| {
            let fits = u32::try_from(given).ok().filter(|given| *given <= 65_535);
            fits.ok_or_else(|| px.invalid(given, "a whole number from 0 to 65535", self.check))
        };
        let at = px.raw().map(|[x, y]| Ok([along(*x)?, along(*y)?])).transpose()?;
        let random = self.keys.count().within(0..=most).optional(self.check)?;
        Ok(FaultPixels { at, random: random.unwrap_or(u32::from(at.is_none())) })
    }

    /// Returns places of defects; one pixel at random when none is said.
    pub(super) fn spots(&self) -> Result<DefectSpots, ConfigError> {
        let column = self.keys.column().optional(self.check)?;
        let row = self.keys.row().optional(self.check)?;
        let pixels = self.pixels(256)?;
        let only_lines = !self.keys.count().is_given() && (column.is_some() || row.is_some());
        let random = if only_lines { 0 } else { pixels.random };
        Ok(DefectSpots { pixels: FaultPixels { random, ..pixels }, column, row })
    }

    /// Returns where protons come from; from all sides when neither angle is given.
    pub(super) fn beam_deg(&mut self) -> Result<Option<[f64; 2]>, ConfigError> {
        let keys = self.keys;
        let is_beam = keys.incidence_deg().is_given() || keys.azimuth_deg().is_given();
        taken!(self.check, keys => incidence_deg, azimuth_deg);
        Ok(is_beam.then_some([incidence_deg, azimuth_deg]))
    }

    /// Returns which wheel.
    pub(super) fn wheel(&self) -> Result<usize, ConfigError> {
        let wheel = || self.keys.wheel();
        wheel()
            .optional(self.check)?
            .ok_or_else(|| wheel().advised("such as 2").missing("its number, from 0", self.check))
    }

    /// Returns when it happens: `at_s`, `at_frame`, or after a trigger; frames are `frame_period` apart.
    pub(super) fn begin(&mut self, row: &Row, frame_period: Span) -> Result<(Span, Option<u16>), ConfigError> {
        let keys = self.keys;
        if let Some(trigger) = keys.on_trigger().optional(self.check)? {
            keys.refuse(&["at_frame"], "events without on_trigger", self.check)?;
            if row.timing != Timing::Waits {
                let advice = "faults of frames and of imaging wait for triggers; give at_s or at_frame";
                return Err(keys.on_trigger().advised(advice).invalid("given", "no on_trigger here", self.check));
            }
            let delay = keys.at_s().or_silently(0.0).advised("seconds after the trigger; at once if left out");
            return Ok((Span::from_s(delay.check(self.check)?), Some(trigger)));
        }
        if !keys.at_frame().is_given() {
            return Ok((Span::from_s(keys.at_s().check(self.check)?), None));
        }
        keys.refuse(&["at_s"], "events without at_frame", self.check)?;
        let frame = keys.at_frame().check(self.check)?;
        // Just after the exposure's begin: the frame before has ended by then, however long it is exposed.
        Ok((Span::from_ns(frame_period.ns() * i64::from(frame) + 1), None))
    }

    /// Returns how long it lasts: `for_s`, or `for_frames`.
    pub(super) fn lasts(&mut self, frame_period: Span) -> Result<Span, ConfigError> {
        let keys = self.keys;
        if !keys.for_frames().is_given() {
            return Ok(Span::from_s(keys.for_s().check(self.check)?));
        }
        keys.refuse(&["for_s"], "events without for_frames", self.check)?;
        let frames = keys.for_frames().check(self.check)?;
        Ok(Span::from_ns(frame_period.ns() * i64::from(frames)))
    }
}
