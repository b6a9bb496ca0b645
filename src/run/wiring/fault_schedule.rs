//! A random schedule of faults and commands, decided by a seed.
//!
//! In: seed, start and end, number of wheels. Out: events in order of time. Kinds are drawn with equal weight; gaps are
//! uniform from 5 to 400 s, so that some faults overlap and some leave the loop time to recover. Durations, shares and
//! sizes are drawn within the limits written here: from what a loop rides through to what takes its attitude away.

use base::{time::Span, units::DEG};
use config::{Action, Event, Pointing};
use firmware_protocol::can::CanId;
use frames::sink::{FrameFault, ImageFault, SendingFault};
use glam::DVec3;
use link::tap::LinkFault;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use testbed::vehicle::VehicleFault;

/// Limits of a random schedule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScheduleLimits {
    /// First event, s after the first exposure.
    pub from_s: f64,
    /// Time after which no event is active, s.
    pub until_s: f64,
    /// Wheels of the spacecraft: at most one fails, and only of four or more.
    pub wheels: usize,
}

/// Shortest and longest gap between the starts of two events, s.
const GAPS_S: (f64, f64) = (5.0, 400.0);

/// Largest share of packets with a wrong bit that passed the bus's own checksum, which is the only one of time marks.
/// Beyond it equally damaged marks outnumber the good ones of a window, and no receiver could separate them.
const MOST_WRONG: f64 = 0.2;

/// Largest share of packets without their tail.
const MOST_CUT: f64 = 0.3;

/// Identifiers of babble: the attitude's own, which has a checksum, and an unused one. Time marks have no checksum:
/// babble under their identifiers that is as frequent as they are would be indistinguishable from them.
const BABBLED: [CanId; 2] = [standard(0x300), standard(0x7FF)];

const fn standard(number: u16) -> CanId {
    match CanId::standard(number) {
        Some(id) => id,
        None => CanId::LAST,
    }
}

/// Returns the events of `seed`.
pub fn fault_schedule(seed: u64, limits: &ScheduleLimits) -> Vec<Event> {
    let mut draw = Draw { dice: StdRng::seed_from_u64(seed), wheels: limits.wheels, wheel_has_failed: false };
    let mut events = Vec::new();
    let mut at_s = limits.from_s;
    loop {
        at_s += draw.between(GAPS_S.0, GAPS_S.1);
        let (action, lasts_s) = draw.action();
        if at_s + lasts_s >= limits.until_s {
            return events;
        }
        // Whole milliseconds keep a schedule readable and exact in a file.
        let whole = |s: f64| Span::from_s((s * 1e3).round() * 1e-3);
        events.push(Event { at: whole(at_s), on_trigger: None, lasts: whole(lasts_s), action });
    }
}

struct Draw {
    dice: StdRng,
    wheels: usize,
    wheel_has_failed: bool,
}

impl Draw {
    fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * self.dice.random::<f64>()
    }

    /// Returns a size that is uniform in its logarithm.
    fn scale(&mut self, least: f64, most: f64) -> f64 {
        self.between(least.ln(), most.ln()).exp()
    }

    fn rate(&mut self, most_rad_s: f64) -> DVec3 {
        DVec3::new(
            self.between(-most_rad_s, most_rad_s),
            self.between(-most_rad_s, most_rad_s),
            self.between(-most_rad_s, most_rad_s),
        )
    }

    /// Returns an action and its duration, s.
    fn action(&mut self) -> (Action, f64) {
        let frame = |fault| Action::Frame { head: None, fault };
        match self.dice.random_range(0..24_u32) {
            0 => (Action::Bus(LinkFault::Loss { share: self.between(0.1, 0.9) }), self.between(2.0, 60.0)),
            1 => (Action::Bus(LinkFault::Silence), self.between(1.0, 30.0)),
            2 => {
                let by = Span::from_s(self.scale(0.002, 0.15));
                let jitter = Span::from_s(self.scale(0.001, 0.05));
                (Action::Bus(LinkFault::Delay { by, jitter }), self.between(2.0, 60.0))
            }
            3 => (Action::Bus(LinkFault::Duplicate { share: self.between(0.1, 1.0) }), self.between(2.0, 60.0)),
            4 => (Action::Bus(LinkFault::WrongBits { share: self.between(0.02, MOST_WRONG) }), self.between(2.0, 60.0)),
            5 => (Action::BusBackLoss { share: self.between(0.2, 1.0) }, self.between(2.0, 60.0)),
            6 => (frame(FrameFault::Sending(SendingFault::Drop)), self.between(2.0, 60.0)),
            7 => (frame(FrameFault::Sending(SendingFault::Duplicate)), self.between(2.0, 30.0)),
            8 => (
                frame(FrameFault::Sending(SendingFault::Late(Span::from_s(self.scale(0.05, 1.5))))),
                self.between(2.0, 60.0),
            ),
            9 => (frame(FrameFault::Sending(SendingFault::Torn)), self.between(2.0, 60.0)),
            10 => (frame(FrameFault::Image(ImageFault::Blank)), self.between(2.0, 60.0)),
            11 => (
                frame(FrameFault::Image(ImageFault::StrayLight { e_per_s: self.scale(1e3, 1e7) })),
                self.between(2.0, 120.0),
            ),
            12 => (Action::Aboard(VehicleFault::GyroDropout), self.between(1.0, 10.0)),
            13 => (Action::Aboard(VehicleFault::GyroStuck), self.between(1.0, 5.0)),
            14 => (Action::Aboard(VehicleFault::GyroBiasJump(self.rate(20.0 * DEG / 3600.0))), 0.0),
            15 => (Action::Aboard(VehicleFault::GyroSpike(self.rate(0.02 * DEG))), self.between(1.0, 3.0)),
            16 => (Action::Aboard(VehicleFault::TrackerOff(None)), self.between(5.0, 200.0)),
            17..23 => self.bus_or_clock(),
            _ => self.wheel_or_slew(),
        }
    }

    fn bus_or_clock(&mut self) -> (Action, f64) {
        let fault = match self.dice.random_range(0..6_u32) {
            0 => LinkFault::Reorder { share: self.between(0.05, 0.5), by: Span::from_s(self.scale(0.005, 0.1)) },
            1 => LinkFault::Truncate { share: self.between(0.02, MOST_CUT) },
            2 => {
                let id = BABBLED[self.dice.random_range(0..BABBLED.len())];
                LinkFault::Babble { id, period: Span::from_s(self.scale(0.001, 0.02)), bytes: 48 }
            }
            3 => return (Action::Bus(LinkFault::Off), self.between(1.0, 30.0)),
            4 => LinkFault::ClockStep { by: Span::from_s(self.either_way(0.001, 0.05)) },
            _ => LinkFault::ClockDrift { ppm: self.either_way(10.0, 200.0) },
        };
        (Action::Bus(fault), self.between(2.0, 60.0))
    }

    /// Returns a size of random sign that is uniform in its logarithm.
    fn either_way(&mut self, least: f64, most: f64) -> f64 {
        let size = self.scale(least, most);
        if self.dice.random::<bool>() { size } else { -size }
    }

    fn wheel_or_slew(&mut self) -> (Action, f64) {
        if self.wheels >= 4 && !self.wheel_has_failed && self.dice.random::<f64>() < 0.2 {
            self.wheel_has_failed = true;
            return (Action::Aboard(VehicleFault::WheelFailure(self.dice.random_range(0..self.wheels))), 0.0);
        }
        // Uniform over the sphere.
        let pointing = Pointing {
            ra_deg: self.between(0.0, 360.0),
            dec_deg: self.between(-1.0, 1.0).asin() / DEG,
            roll_deg: self.between(-180.0, 180.0),
        };
        (Action::Slew(pointing), 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: ScheduleLimits = ScheduleLimits { from_s: 600.0, until_s: 3_000_000.0, wheels: 4 };

    #[test]
    fn the_seed_decides() {
        let short = ScheduleLimits { until_s: 36_000.0, ..LIMITS };
        assert_eq!(fault_schedule(5, &short), fault_schedule(5, &short));
        assert_ne!(fault_schedule(5, &short), fault_schedule(6, &short));
    }

    #[test]
    fn events_keep_their_time_and_every_kind_comes() {
        let events = fault_schedule(1, &LIMITS);
        assert!(events.iter().all(|event| event.at >= Span::from_s(600.0)));
        assert!(events.iter().all(|event| event.at + event.lasts < Span::from_s(3_000_000.0)));
        assert!(events.is_sorted_by_key(|event| event.at));
        let mut names: Vec<_> = events.iter().map(|event| event.action.word()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), 25, "{names:?}");
        let failures =
            events.iter().filter(|event| matches!(event.action, Action::Aboard(VehicleFault::WheelFailure(_)))).count();
        assert_eq!(failures, 1, "three wheels still control all axes");
    }
}
