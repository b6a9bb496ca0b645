//! Plain messages of an external simulator -> samples by the bench's clock.
//!
//! In: a [`PlainRecord`] with its arrival. Out: a [`PlantSample`]. A tag of any clock (Unix time too: the bench's clock
//! may play another day) is also a time mark, so the offset and drift of that clock are estimated like those of a
//! flight computer on the bus, and its steps and restarts are the same events. Without a time, values are valid when
//! they arrive. Values that are too old, too new or repeated are refused by the histories: an attitude is never drawn
//! at another instant than its own. Tests: `plain_intake_tests`, `hil_scripts/tests/test_plain_links.py`.

use super::{PORTS_MAX, Receiver};
use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::plant_queue::{PlantAttitude, PlantSample};
use base::axes::{Rotation, WRITTEN_NORM_TOLERANCE};
use base::time::{Span, Tai};
use firmware_protocol::Message;
use glam::DVec3;
use link::plain::{PlainAttitude, PlainRecord, PlainState, PlainTime};
use link::{Input, Stamped};
use plan::attitude::Observed;
use sky::observer::BarycentricState;

impl Receiver {
    /// Accepts a message of either kind; returns an answer to send by the same port, if it needs one. Plain messages
    /// need none.
    pub fn accept_input(&mut self, port: usize, input: &Stamped<Input>, ledger: &mut Ledger) -> Option<Message> {
        match input.value {
            Input::Message(value) => self.accept_from(port, &Stamped { at: input.at, value }, ledger),
            Input::Plain(record) => {
                self.messages[port.min(PORTS_MAX - 1)] += 1;
                self.accept_plain(&record, input.at, ledger);
                None
            }
        }
    }

    fn accept_plain(&mut self, record: &PlainRecord, arrived: Tai, ledger: &mut Ledger) {
        if self.is_repeated(record.time) {
            // Do not use it as a mark either: the clock of a sender that hangs would seem to step back again and again.
            ledger.note(Event::new(EventKind::SampleRefused, arrived, None, Span::ZERO));
            return;
        }
        let Some(at) = self.plain_instant(record.time, arrived, ledger) else {
            ledger.note(Event::new(EventKind::NoTimeYet, arrived, None, Span::ZERO));
            return;
        };
        let attitude = record.attitude.as_ref().map(plant_attitude);
        if attitude == Some(None) {
            ledger.note(Event::new(EventKind::SampleRefused, arrived, None, arrived - at));
            return;
        }
        let sample = PlantSample {
            attitude: attitude.flatten(),
            jitter_rad: record.jitter_rad.map(DVec3::from_array),
            observer: record.observer.as_ref().map(observer_state),
            ..PlantSample::at(at)
        };
        self.take_plant(&sample, arrived, ledger);
    }

    /// Returns true when the sender's clock shows the same reading as before.
    fn is_repeated(&self, time: PlainTime) -> bool {
        match time {
            PlainTime::Arrival => false,
            PlainTime::Tag(tag_ns) => self.plain_tags.is_some_and(|(last_ns, _)| last_ns == tag_ns),
        }
    }

    /// Returns the instant of a record. `None` before a clock of any epoch is known.
    fn plain_instant(&mut self, time: PlainTime, arrived: Tai, ledger: &mut Ledger) -> Option<Tai> {
        match time {
            PlainTime::Arrival => Some(arrived - self.params.settings.clock.constant_delay),
            PlainTime::Tag(tag_ns) => {
                self.take_tag(tag_ns, arrived, ledger);
                self.clock.estimate().map(|estimate| estimate.to_tai(tag_ns))
            }
        }
    }

    /// Uses a tag as a mark of the sender's clock, which is read when the message is sent. A tag slightly older than
    /// the newest one belongs to a message that was overtaken, and is not used: the clock did not step back.
    fn take_tag(&mut self, tag_ns: i64, arrived: Tai, ledger: &mut Ledger) {
        let newest_ns = self.plain_tags.map_or(tag_ns, |(_, newest_ns)| newest_ns);
        let behind = Span::from_ns(newest_ns.saturating_sub(tag_ns));
        if behind > Span::ZERO && behind < self.params.settings.clock.step {
            self.plain_tags = Some((tag_ns, newest_ns));
            return;
        }
        self.plain_tags = Some((tag_ns, tag_ns));
        if let Some(change) = self.tag_rate.take(tag_ns, arrived, self.params.settings.clock.most_drift) {
            ledger.note(Event::new(EventKind::ClockRunsOff, arrived, None, change));
        }
        let before = self.clock.estimate();
        match self.clock.observe(tag_ns, arrived) {
            Observed::Used => self.follow_clock(),
            Observed::Restarted => {
                if let Some(before) = before {
                    self.take_step(&before, tag_ns, arrived, arrived, ledger);
                }
                self.follow_clock();
            }
            Observed::Late | Observed::Outlier => {}
        }
    }
}

/// Returns `None` for an invalid quaternion, which the codec has already refused.
fn plant_attitude(attitude: &PlainAttitude) -> Option<PlantAttitude> {
    Some(PlantAttitude {
        body_from_icrf: Rotation::from_wxyz(attitude.q_wxyz, 2.0 * WRITTEN_NORM_TOLERANCE)?,
        rate_rad_s: DVec3::from_array(attitude.rate_rad_s),
        acceleration_rad_s2: DVec3::from_array(attitude.acceleration_rad_s2),
    })
}

fn observer_state(state: &PlainState) -> BarycentricState {
    BarycentricState {
        position_km: DVec3::from_array(state.position_km),
        velocity_km_s: DVec3::from_array(state.velocity_km_s),
    }
}

#[cfg(test)]
#[path = "plain_intake_tests.rs"]
mod tests;
