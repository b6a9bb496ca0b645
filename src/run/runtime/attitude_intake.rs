//! Attitudes as they arrive -> the attitude history, its age, and the sender's time of an exposure.
//!
//! In: records of the flight computer with their instants, attitudes of an external plant. Out: samples in the history;
//! refused ones are events. The tags of the newest records are kept, because an exposure is reported to the flight
//! computer by the time that it wrote itself. Allocates nothing after the start. Tests: `receiver_tests`.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::plant_queue::PlantAttitude;
use crate::runtime::rate_check::{RateCheck, WINDOW};
use base::axes::{Rotation, WRITTEN_NORM_TOLERANCE};
use base::time::{Span, Tai};
use firmware_protocol::message::AttitudeRecord;
use firmware_protocol::ticks::{ticks_diff, wrapped};
use glam::DVec3;
use plan::attitude::{AttitudeHistory, AttitudeSample, HistoryLimits, RemoteClock};
use std::collections::VecDeque;

/// Tolerance of the norm of a quaternion that the protocol or a codec has already checked.
pub(super) const NORM_TOLERANCE: f64 = 2.0 * WRITTEN_NORM_TOLERANCE;

/// Number of attitude tags that are kept: more than arrive during an exposure and a readout.
const TAGS: usize = 256;

/// The attitudes of one body.
pub struct AttitudeIntake {
    /// The attitudes so far.
    pub history: AttitudeHistory,
    newest_epoch: Option<Tai>,
    newest_arrival: Option<Tai>,
    /// Tags of the newest attitudes with the instants they were converted to, by rising instant.
    tags: VecDeque<(u32, Tai)>,
    rates: RateCheck,
    /// Sequence number of the latest attitude of an external plant.
    plant_seq: u8,
}

impl AttitudeIntake {
    pub(super) fn new(limits: HistoryLimits) -> Self {
        Self {
            history: AttitudeHistory::new(limits),
            newest_epoch: None,
            newest_arrival: None,
            tags: VecDeque::with_capacity(TAGS),
            rates: RateCheck::default(),
            plant_seq: 0,
        }
    }

    /// Returns the age at `at` of the newest attitude accepted.
    pub fn age_at(&self, at: Tai) -> Option<Span> {
        self.newest_epoch.map(|epoch| at - epoch)
    }

    /// Returns the time from the arrival of the attitude accepted last to `at`.
    pub fn arrival_age_at(&self, at: Tai) -> Option<Span> {
        self.newest_arrival.map(|arrival| at - arrival)
    }

    /// Returns the flight computer's time of an instant, us modulo 2^32, by the tags of the nearest attitudes: the time
    /// by which they were converted, even if the clock's estimate has moved since. `None` before the first attitude.
    pub fn remote_us_at(&self, at: Tai, clock: &RemoteClock) -> Option<u32> {
        let after = self.tags.partition_point(|(_, epoch)| *epoch <= at);
        let (t_us, epoch) = *self.tags.get(after.saturating_sub(1))?;
        let since_ns = (at - epoch).ns();
        let ahead_ns = match self.tags.get(after).filter(|_| after > 0) {
            // Interpolate between two tags: the estimate may have moved between them.
            Some((later_us, later)) => {
                let (ticks_ns, span_ns) = (1000 * i64::from(ticks_diff(*later_us, t_us)), (*later - epoch).ns().max(1));
                Span::from_s(ticks_ns as f64 * 1e-9 * (since_ns as f64 / span_ns as f64)).ns()
            }
            None => since_ns - Span::from_s(since_ns as f64 * 1e-9 * clock.estimate()?.drift).ns(),
        };
        let remote_ns = i64::from(t_us) * 1000 + ahead_ns;
        Some(wrapped((remote_ns + 500).div_euclid(1000)))
    }

    pub(super) fn keep_tag(&mut self, t_us: u32, epoch: Tai) {
        if self.tags.len() >= TAGS {
            self.tags.pop_front();
        }
        let place = self.tags.partition_point(|(_, other)| *other <= epoch);
        self.tags.insert(place, (t_us, epoch));
    }

    /// Accepts a record of the flight computer that is valid at `epoch`, by its tag.
    pub(super) fn take_record(&mut self, record: &AttitudeRecord, epoch: Tai, at: Tai, ledger: &mut Ledger) {
        let sample = Rotation::from_wxyz(record.q_wxyz.map(f64::from), NORM_TOLERANCE).map(|body_from_icrf| {
            let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
            AttitudeSample {
                at: epoch,
                seq: record.seq,
                body_from_icrf,
                rate_rad_s: vector(record.rate_rad_s),
                acceleration_rad_s2: vector(record.acceleration_rad_s2),
            }
        });
        if sample.is_some_and(|sample| self.take(sample, at, record.flags.rate, ledger)) {
            self.keep_tag(record.t_us, epoch);
        } else {
            ledger.note(Event::new(EventKind::SampleRefused, at, None, at - epoch));
        }
    }

    /// Accepts an attitude of an external plant; returns false when it was refused.
    pub(super) fn take_plant(&mut self, at: Tai, attitude: &PlantAttitude, arrived: Tai, ledger: &mut Ledger) -> bool {
        let PlantAttitude { body_from_icrf, rate_rad_s, acceleration_rad_s2 } = *attitude;
        self.plant_seq = self.plant_seq.wrapping_add(1);
        let seq = self.plant_seq;
        self.take(AttitudeSample { at, seq, body_from_icrf, rate_rad_s, acceleration_rad_s2 }, arrived, true, ledger)
    }

    /// Accepts a sample, and compares its rate, if it is measured, with the attitudes before.
    fn take(&mut self, sample: AttitudeSample, arrived: Tai, has_rate: bool, ledger: &mut Ledger) -> bool {
        let is_taken = self.history.insert(sample, arrived).is_ok();
        if is_taken {
            if has_rate && self.rates.contradicts(&sample) {
                ledger.note(Event::new(EventKind::RatesContradict, sample.at, None, WINDOW));
            }
            self.newest_epoch = self.newest_epoch.max(Some(sample.at));
            self.newest_arrival = self.newest_arrival.max(Some(arrived));
        }
        is_taken
    }

    /// Discards the tags: those of two clocks cannot be ordered.
    pub(super) fn forget_tags(&mut self) {
        self.tags.clear();
    }

    /// Discards the attitudes of a sender that has restarted.
    pub(super) fn forget(&mut self) {
        self.history.clear();
        self.rates.clear();
        self.newest_epoch = None;
    }
}
