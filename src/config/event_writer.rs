//! An event -> the keys of `[[event]]` that make it again: for captures, which keep what a file does not say.
//!
//! Numbers come back bit by bit, except rates of a gyro, which are written in degrees per hour.

use crate::event::Event;
use base::{time::Span, units::DEG};
use firmware_protocol::can::CanId;
use frames::sink::{DefectSpots, FaultPixels};
use glam::DVec3;
use serde_json::{Map, Value};

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
mod tests {
    use super::*;
    use crate::{event::Action, event::tests::given_in_full, event_word::ACTIONS};
    use frames::sink::{FrameFault, PixelFault};
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
        let light = FrameFault::StrayLight { e_per_s: 1e5 / 3.0 };
        let none = FaultPixels { at: None, random: 0 };
        let spots = DefectSpots { pixels: none, column: None, row: Some(7) };
        for (on_trigger, fault) in [
            (None, light),
            (Some(9), FrameFault::Torn),
            (None, FrameFault::Pixels { spots, fault: PixelFault::Stuck { dn: 3 } }),
            (None, FrameFault::FalseStars { pixels: FaultPixels { at: Some([3, 4]), random: 0 }, mag: 0.1 }),
            (None, FrameFault::Late(Span::from_ns(123_456_789))),
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
