//! An event -> the keys of `[[event]]` that make it again: for captures, which keep what a file does not say.
//!
//! Numbers come back bit by bit, except rates of a gyro, which are written in degrees per hour.

use crate::event::{Action, Event, GyroFaultKind, Pointing};
use base::time::Span;
use base::units::DEG;
use frames::sink::{DefectSpots, FaultPixels, FrameFault, PixelFault, ProtonStorm};
use glam::DVec3;
use link::tap::LinkFault;
use serde_json::{Map, Value};

/// Keys with their values.
type Keys = Vec<(&'static str, Value)>;

impl Event {
    /// Returns the keys of `[[event]]` that make this event again ([`Self::from_json`]).
    #[must_use]
    pub fn to_json(&self) -> Map<String, Value> {
        let mut keys: Keys = vec![("do", self.action.word().into()), ("at_s", self.at.s().into())];
        keys.extend(self.on_trigger.map(|number| ("on_trigger", number.into())));
        if self.lasts > Span::ZERO {
            keys.push(("for_s", self.lasts.s().into()));
        }
        keys.extend(action_keys(&self.action));
        keys.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    }
}

fn action_keys(action: &Action) -> Keys {
    match *action {
        Action::Slew(Pointing { ra_deg, dec_deg, roll_deg }) => {
            vec![("ra_deg", ra_deg.into()), ("dec_deg", dec_deg.into()), ("roll_deg", roll_deg.into())]
        }
        Action::Safe | Action::Resume => Vec::new(),
        Action::Bus(fault) | Action::BusBack(fault) => link_keys(&fault),
        Action::Frame { head, fault } => head_key(head).chain(frame_keys(&fault)).collect(),
        Action::Gyro(GyroFaultKind::Dropout | GyroFaultKind::Stuck) => Vec::new(),
        Action::Gyro(GyroFaultKind::BiasJump(rate) | GyroFaultKind::Spike(rate)) => vec![rate_key(rate)],
        Action::WheelFailure { wheel } => vec![("wheel", wheel.into())],
        Action::TrackerOff { head } => head_key(head).collect(),
        Action::Trigger { number } => vec![("number", number.into())],
    }
}

fn head_key(head: Option<usize>) -> impl Iterator<Item = (&'static str, Value)> {
    head.map(|head| ("head", head.into())).into_iter()
}

fn rate_key(rate_rad_s: DVec3) -> (&'static str, Value) {
    let rate_deg_h = rate_rad_s.to_array().map(|rate| Value::from(rate / (DEG / 3600.0)));
    ("rate_deg_h", rate_deg_h.to_vec().into())
}

fn ms(span: Span) -> Value {
    span.ms().into()
}

fn link_keys(fault: &LinkFault) -> Keys {
    match *fault {
        LinkFault::Loss { share }
        | LinkFault::Duplicate { share }
        | LinkFault::WrongBits { share }
        | LinkFault::Truncate { share } => vec![("share", share.into())],
        LinkFault::Silence | LinkFault::Off => Vec::new(),
        LinkFault::Delay { by, jitter } => vec![("delay_ms", ms(by)), ("jitter_ms", ms(jitter))],
        LinkFault::Reorder { share, by } => vec![("share", share.into()), ("delay_ms", ms(by))],
        LinkFault::Babble { id, period, bytes } => {
            vec![("can_id", id.into()), ("period_ms", ms(period)), ("bytes", bytes.into())]
        }
        LinkFault::ClockStep { by } => vec![("step_ms", ms(by))],
        LinkFault::ClockDrift { ppm } => vec![("ppm", ppm.into())],
    }
}

fn frame_keys(fault: &FrameFault) -> Keys {
    match *fault {
        FrameFault::Drop | FrameFault::Duplicate | FrameFault::Torn | FrameFault::Blank => Vec::new(),
        FrameFault::Late(by) => vec![("late_ms", ms(by))],
        FrameFault::BitFlip { bit, pixels } => [vec![("bit", bit.into())], pixel_keys(pixels)].concat(),
        FrameFault::StrayLight { e_per_s } => vec![("e_per_s", e_per_s.into())],
        FrameFault::StrayLightRamp { from_e_per_s, to_e_per_s } => {
            vec![("from_e_per_s", from_e_per_s.into()), ("to_e_per_s", to_e_per_s.into())]
        }
        FrameFault::Defocus { sigma_px } => vec![("sigma_px", sigma_px.into())],
        FrameFault::Contamination { from_share, to_share } => {
            vec![("throughput", from_share.into()), ("to_throughput", to_share.into())]
        }
        FrameFault::TemperatureStep { by_k } => vec![("by_k", by_k.into())],
        FrameFault::Saturation { full_wells } => vec![("full_wells", full_wells.into())],
        FrameFault::FalseStars { pixels, mag } => [vec![("mag", mag.into())], pixel_keys(pixels)].concat(),
        FrameFault::MissingStars { share } => vec![("share", share.into())],
        FrameFault::MissingBrightStars { count } => vec![("count", count.into())],
        FrameFault::Pixels { spots, fault } => [spot_keys(spots), defect_keys(fault)].concat(),
        FrameFault::Protons(storm) => storm_keys(&storm),
    }
}

fn pixel_keys(FaultPixels { at, random }: FaultPixels) -> Keys {
    let mut keys: Keys = vec![("count", random.into())];
    keys.extend(at.map(|px| ("px", px.to_vec().into())));
    keys
}

fn spot_keys(DefectSpots { pixels, column, row }: DefectSpots) -> Keys {
    let mut keys = pixel_keys(pixels);
    keys.extend(column.map(|column| ("column", column.into())));
    keys.extend(row.map(|row| ("row", row.into())));
    keys
}

fn defect_keys(fault: PixelFault) -> Keys {
    match fault {
        PixelFault::Hot { e_per_s } => vec![("e_per_s", e_per_s.into())],
        PixelFault::Dead { response } => vec![("response", response.into())],
        PixelFault::Rts { e_per_s, high_s, low_s } => {
            vec![("e_per_s", e_per_s.into()), ("high_s", high_s.into()), ("low_s", low_s.into())]
        }
        PixelFault::Stuck { dn } => vec![("dn", dn.into())],
    }
}

fn storm_keys(ProtonStorm { per_cm2_s, energy_mev, beam_deg }: &ProtonStorm) -> Keys {
    let mut keys: Keys = vec![("per_cm2_s", (*per_cm2_s).into()), ("energy_mev", (*energy_mev).into())];
    if let Some([incidence_deg, azimuth_deg]) = *beam_deg {
        keys.extend([("incidence_deg", incidence_deg.into()), ("azimuth_deg", azimuth_deg.into())]);
    }
    keys
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::tests::given_in_full;
    use crate::event_word::ACTIONS;

    fn again(event: &Event) -> Event {
        Event::from_json(&event.to_json(), 0.0, Span::from_ms(100)).expect("an event of ours")
    }

    #[test]
    fn every_event_comes_back_from_its_keys() {
        for (word, kind) in ACTIONS {
            let event = given_in_full(word, kind);
            let got = again(&event);
            if let (Action::Gyro(given), Action::Gyro(got)) = (event.action, got.action) {
                let of = |kind: GyroFaultKind| match kind {
                    GyroFaultKind::BiasJump(rate) | GyroFaultKind::Spike(rate) => rate,
                    GyroFaultKind::Dropout | GyroFaultKind::Stuck => DVec3::ZERO,
                };
                assert!((of(given) - of(got)).length() < 1e-15, "{word}");
                assert_eq!(core::mem::discriminant(&given), core::mem::discriminant(&got), "{word}");
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
    }
}
