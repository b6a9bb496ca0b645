//! Keys of one event -> its values, and when and for how long it happens.
//!
//! An event -> the keys of `[[event]]` that make it again: for captures, which keep what a file does not say.
//!
//! Numbers come back bit by bit, except rates of a gyro, which are written in degrees per hour.

use crate::event_word::{EventKeys, Row, Timing};
use crate::key::{Given, Section, taken};
use crate::key_type::{KeyType, Raw, Shape, Whole};
use crate::{check::Checker, error::Result, event::Event};
use base::{time::Span, units::DEG};
use core::fmt;
use firmware_protocol::can::CanId;
use frames::sink::{DefectSpots, FaultPixels};
use glam::DVec3;
use serde::Deserialize;
use serde_json::{Map, Value};

/// Reads the keys of one event.
pub(super) struct Reader<'a, 'd> {
    pub(super) keys: &'a EventKeys,
    pub(super) check: &'a mut Checker<'d>,
}

/// A value of an action that one key makes.
pub(super) trait Taken<T: KeyType>: Sized {
    fn taken(given: Given<'_, T>, check: &mut Checker<'_>) -> Result<Self>;
}

impl Taken<f64> for f64 {
    fn taken(given: Given<'_, f64>, check: &mut Checker<'_>) -> Result<Self> {
        given.check(check)
    }
}

impl<N: TryFrom<i64>> Taken<Whole<N>> for N {
    fn taken(given: Given<'_, Whole<N>>, check: &mut Checker<'_>) -> Result<Self> {
        given.check(check)
    }
}

/// Which head; `None`: all.
impl Taken<Whole<usize>> for Option<usize> {
    fn taken(given: Given<'_, Whole<usize>>, check: &mut Checker<'_>) -> Result<Self> {
        given.optional(check)
    }
}

/// Milliseconds.
impl Taken<f64> for Span {
    fn taken(given: Given<'_, f64>, check: &mut Checker<'_>) -> Result<Self> {
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
    fn taken(given: Given<'_, Raw<Identifier>>, check: &mut Checker<'_>) -> Result<Self> {
        let wanted = "a whole number from 0 to 2047, or 8 hexadecimal digits in quotes up to \"1FFFFFFF\"";
        let Some(raw) = given.raw() else { return Err(given.missing(wanted, check)) };
        raw.id().ok_or_else(|| given.invalid(raw, wanted, check))
    }
}

/// A rate in degrees per hour.
impl Taken<[f64; 3]> for DVec3 {
    fn taken(given: Given<'_, [f64; 3]>, check: &mut Checker<'_>) -> Result<Self> {
        Ok(Self::from_array(given.check(check)?) * (DEG / 3600.0))
    }
}

impl Reader<'_, '_> {
    /// Returns a pixel that is given and a number of random ones; one at random when neither is said.
    pub(super) fn pixels(&self, most: i64) -> Result<FaultPixels> {
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
    pub(super) fn spots(&self) -> Result<DefectSpots> {
        let column = self.keys.column().optional(self.check)?;
        let row = self.keys.row().optional(self.check)?;
        let pixels = self.pixels(256)?;
        let only_lines = !self.keys.count().is_given() && (column.is_some() || row.is_some());
        let random = if only_lines { 0 } else { pixels.random };
        Ok(DefectSpots { pixels: FaultPixels { random, ..pixels }, column, row })
    }

    /// Returns where protons come from; from all sides when neither angle is given.
    pub(super) fn beam_deg(&mut self) -> Result<Option<[f64; 2]>> {
        let keys = self.keys;
        let is_beam = keys.incidence_deg().is_given() || keys.azimuth_deg().is_given();
        taken!(self.check, keys => incidence_deg, azimuth_deg);
        Ok(is_beam.then_some([incidence_deg, azimuth_deg]))
    }

    /// Returns which wheel.
    pub(super) fn wheel(&self) -> Result<usize> {
        let wheel = || self.keys.wheel();
        wheel()
            .optional(self.check)?
            .ok_or_else(|| wheel().advised("such as 2").missing("its number, from 0", self.check))
    }

    /// Returns when it happens: `at_s`, `at_frame`, or after a trigger; frames are `frame_period` apart.
    pub(super) fn begin(&mut self, row: &Row, frame_period: Span) -> Result<(Span, Option<u16>)> {
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
    pub(super) fn lasts(&mut self, frame_period: Span) -> Result<Span> {
        let keys = self.keys;
        if !keys.for_frames().is_given() {
            return Ok(Span::from_s(keys.for_s().check(self.check)?));
        }
        keys.refuse(&["for_s"], "events without for_frames", self.check)?;
        let frames = keys.for_frames().check(self.check)?;
        Ok(Span::from_ns(frame_period.ns() * i64::from(frames)))
    }
}

/// Keys with their values.
pub(super) type Keys = Vec<(&'static str, Value)>;

impl Event {
    /// Returns the keys of `[[event]]` that make this event again ([`Self::from_json`]).
    pub fn to_json(&self) -> Map<String, Value> {
        let mut keys: Keys = vec![("do", self.action.word().into()), ("at_s", self.at.s().into())];
        keys.extend(self.on_trigger.map(|number| ("on_trigger", number.into())));
        if self.lasts > Span::ZERO {
            keys.push(("for_s", self.lasts.s().into()));
        }
        keys.extend(self.action.keys());
        keys.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    }
}

/// A value of an action that writes its keys.
pub(super) trait Written {
    fn write(self, name: &'static str, keys: &mut Keys);
}

macro_rules! plain {
    ($($type:ty),+) => { $(
        impl Written for $type {
            fn write(self, name: &'static str, keys: &mut Keys) {
                keys.push((name, self.into()));
            }
        }
    )+ };
}

plain!(f64, u8, u16, u32, usize);

impl Written for Option<usize> {
    fn write(self, name: &'static str, keys: &mut Keys) {
        keys.extend(self.map(|number| (name, number.into())));
    }
}

impl Written for Span {
    fn write(self, name: &'static str, keys: &mut Keys) {
        keys.push((name, self.ms().into()));
    }
}

impl Written for CanId {
    fn write(self, name: &'static str, keys: &mut Keys) {
        let value = if self.is_extended() { format!("{self:X}").into() } else { self.number().into() };
        keys.push((name, value));
    }
}

impl Written for DVec3 {
    fn write(self, name: &'static str, keys: &mut Keys) {
        let rate_deg_h = self.to_array().map(|rate| Value::from(rate / (DEG / 3600.0)));
        keys.push((name, rate_deg_h.to_vec().into()));
    }
}

impl Written for FaultPixels {
    fn write(self, _name: &'static str, keys: &mut Keys) {
        keys.push(("count", self.random.into()));
        keys.extend(self.at.map(|px| ("px", px.to_vec().into())));
    }
}

impl Written for DefectSpots {
    fn write(self, name: &'static str, keys: &mut Keys) {
        self.pixels.write(name, keys);
        keys.extend(self.column.map(|column| ("column", column.into())));
        keys.extend(self.row.map(|row| ("row", row.into())));
    }
}

/// A beam of protons.
impl Written for Option<[f64; 2]> {
    fn write(self, _name: &'static str, keys: &mut Keys) {
        let beam = self.map(|angles_deg| ["incidence_deg", "azimuth_deg"].into_iter().zip(angles_deg.map(Value::from)));
        keys.extend(beam.into_iter().flatten());
    }
}

#[cfg(test)]
mod event_writer_tests {
    use super::*;
    use crate::{event::Action, event::tests::given_in_full, event_word::ACTIONS};
    use frames::sink::{CameraFault, FrameFault, ImageFault, PixelFault, SendingFault};
    use link::tap::LinkFault;
    use testbed::vehicle::VehicleFault;

    fn again(event: &Event) -> Event {
        Event::from_json(&event.to_json(), 0.0, Span::from_ms(100)).expect("an event of ours")
    }

    /// Returns the rate that is written in other units.
    fn rate(action: Action) -> Option<DVec3> {
        let Action::Aboard(VehicleFault::GyroBiasJump(rate) | VehicleFault::GyroSpike(rate)) = action else {
            return None;
        };
        Some(rate)
    }

    #[test]
    fn every_event_comes_back_from_its_keys() {
        for (word, kind) in ACTIONS {
            let event = given_in_full(word, kind);
            let got = again(&event);
            if let (Some(given), Some(got)) = (rate(event.action), rate(got.action)) {
                assert!((given - got).length() < 1e-15, "{word}");
                assert_eq!(again(&event).action.word(), *word);
                continue;
            }
            assert_eq!(got, event, "{word}");
        }
    }

    #[test]
    fn times_triggers_and_places_come_back_bit_by_bit() {
        let frame = |fault| Action::Frame { head: None, fault };
        let at = Span::from_ns(86_400_123_456_789);
        let lasts = Span::from_ns(1);
        let light = FrameFault::Image(ImageFault::StrayLight { e_per_s: 1e5 / 3.0 });
        let none = FaultPixels { at: None, random: 0 };
        let spots = DefectSpots { pixels: none, column: None, row: Some(7) };
        for (on_trigger, fault) in [
            (None, light),
            (Some(9), FrameFault::Sending(SendingFault::Torn)),
            (None, FrameFault::Camera(CameraFault::Pixels { spots, fault: PixelFault::Stuck { dn: 3 } })),
            (
                None,
                FrameFault::Image(ImageFault::FalseStars {
                    pixels: FaultPixels { at: Some([3, 4]), random: 0 },
                    mag: 0.1,
                }),
            ),
            (None, FrameFault::Sending(SendingFault::Late(Span::from_ns(123_456_789)))),
        ] {
            let event = Event { at, on_trigger, lasts, action: frame(fault) };
            assert_eq!(again(&event), event);
            assert_ne!(again(&Event { at: at + lasts, ..event }), event, "control");
        }
        let ids = [CanId::standard(0x123), CanId::extended(0x123), CanId::extended(0x1FFF_FFFF)].map(Option::unwrap);
        let babble = |id| Action::Bus(LinkFault::Babble { id, period: Span::from_ms(1), bytes: 8 });
        let events = ids.map(|id| Event { at, on_trigger: None, lasts, action: babble(id) });
        assert_eq!(events.map(|event| again(&event)), events, "11 and 29 bits of one number");
    }
}
