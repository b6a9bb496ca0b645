//! Messages -> time correlation, attitude history, jitter history, triggers, answers to commands.
//!
//! Data that a receiver keeps for one head: its jitter, in the axes of its sensor, and inputs that every head takes by itself.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::plant_queue::{PlantAttitude, PlantSample};
use crate::runtime::rate_check::{RateCheck, TagRate, WINDOW};
use crate::runtime::session::{PerHead, Session};
use crate::runtime::{error::Result, jitter_tables, params::AttitudeParams, slot::Slot, triggers::FiredTrigger};
use base::axes::{Body, Rotation, Sensor, WRITTEN_NORM_TOLERANCE};
use base::time::{Span, Tai};
use base::units::{ARCSEC, RPM};
use config::SessionParams;
use firmware_protocol::message::{AttitudeRecord, Command, JitterBurst, JitterPair, Request, TimeFollowUp, Wheels};
use firmware_protocol::ticks::{ticks_diff, wrapped};
use firmware_protocol::{Message, handshake::Did};
use glam::DVec3;
use link::Stamped;
use plan::attitude::{
    AttitudeHistory, AttitudeSample, ClockEstimate, JitterHistory, JitterPoint, Observed, ObservedPps, RemoteClock,
};
use sky::observer::BarycentricState;
use std::collections::VecDeque;

/// Period of classic jitter pairs' samples.
const PAIR_PERIOD: Span = Span::from_ms(1);
/// Tolerance of the norm of a quaternion that the protocol has already checked.
const NORM_TOLERANCE: f64 = 2.0 * WRITTEN_NORM_TOLERANCE;

/// Number of attitude tags that are kept: more than arrive during an exposure and a readout.
const TAGS: usize = 256;
/// Number of ports whose time marks and messages are counted separately.
pub const PORTS_MAX: usize = 8;
/// Shortest interval between two tables that are put into effect.
const APPLY_PERIOD: Span = Span::from_ms(50);

/// Results of the pulses per second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PulseCounts {
    /// Pulses used as whole seconds of the flight computer's clock.
    pub used: u64,
    /// Pulses refused: before the first mark, or too far from a whole second.
    pub refused: u64,
}

/// The receiving half of the stimulator: one for all heads of a run, each with its [`Mounting`].
pub struct Receiver {
    /// The parameters.
    pub params: AttitudeParams,
    /// The time correlation.
    pub clock: RemoteClock,
    /// The attitudes so far.
    pub history: AttitudeHistory,
    mountings: PerHead<Mounting>,
    /// The conversation with the flight computer.
    pub session: Session,
    /// The last SYNC of each port that has not been reported.
    syncs: [Option<(u8, Tai)>; PORTS_MAX],
    /// The counts of pulses per second so far.
    pub pulses: PulseCounts,
    applied: Option<Tai>,
    newest_epoch: Option<Tai>,
    /// Tags of the newest attitudes with the instants they were converted to, by rising instant.
    tags: VecDeque<(u32, Tai)>,
    newest_arrival: Option<Tai>,
    /// Messages taken in by each port.
    messages: [u64; PORTS_MAX],
    /// Times of the last plain message and of the newest one, by their sender's clock.
    plain_tags: Option<(i64, i64)>,
    tag_rate: TagRate,
    /// Sequence number of the latest attitude of an external plant.
    plant_seq: u8,
    rates: RateCheck,
}

impl Receiver {
    /// Returns a receiver that has received nothing, for one head.
    ///
    /// # Errors
    /// When a jitter line is not finite.
    pub fn new(params: AttitudeParams) -> Result<Self> {
        Ok(Self {
            clock: RemoteClock::new(params.settings.clock),
            history: AttitudeHistory::new(params.settings.history),
            mountings: PerHead::new(Mounting::new(&params)?),
            session: Session::new(SessionParams::default()),
            syncs: [None; PORTS_MAX],
            pulses: PulseCounts::default(),
            applied: None,
            newest_epoch: None,
            tags: VecDeque::with_capacity(TAGS),
            newest_arrival: None,
            messages: [0; PORTS_MAX],
            plain_tags: None,
            tag_rate: TagRate::default(),
            plant_seq: 0,
            rates: RateCheck::default(),
            params,
        })
    }

    /// Returns the receiver with other session parameters than the default; call before heads are added and anything is
    /// received.
    #[must_use]
    pub fn with_session(mut self, params: SessionParams) -> Self {
        self.session = Session::new(params);
        self
    }

    /// Adds the next head; of its parameters the mounting and the jitter are its own.
    ///
    /// # Errors
    /// When a jitter line is not finite.
    pub fn add_head(&mut self, params: &AttitudeParams) -> Result<()> {
        self.mountings.push(Mounting::new(params)?);
        self.session.add_head();
        Ok(())
    }

    /// Returns what it keeps for a head.
    pub fn mounting(&self, head: usize) -> &Mounting {
        self.mountings.of(head)
    }

    /// Returns what it keeps for a head, for the one that draws it.
    pub fn mounting_mut(&mut self, head: usize) -> &mut Mounting {
        self.mountings.of_mut(head)
    }

    /// Accepts triggers of this number from now on, because a fault or an event of the run waits for it.
    pub fn expect_trigger(&mut self, number: u16) {
        self.session.expect_trigger(number);
    }

    /// Returns the flight computer's triggers that act at or before `up_to`, by rising time, each once for each head.
    /// Triggers that are not taken from the iterator remain. Allocates nothing.
    pub fn take_triggers(&mut self, head: usize, up_to: Tai) -> impl Iterator<Item = FiredTrigger> + use<'_> {
        let triggers = self.session.triggers_mut(head);
        core::iter::from_fn(move || triggers.next(up_to))
    }

    /// Passes the triggers that act by the end of a slot's exposure to `fire`; the first head's are recorded.
    pub fn fire_triggers(&mut self, head: usize, slot: Slot, ledger: &mut Ledger, fire: &mut dyn FnMut(FiredTrigger)) {
        for fired in self.take_triggers(head, slot.exposure_end) {
            if head == 0 {
                let ahead = slot.exposure_end - fired.at;
                ledger.note(Event::new(EventKind::TriggerFired, fired.at, Some(slot.number), ahead));
            }
            fire(fired);
        }
    }

    /// Detects heartbeats that have stopped.
    pub fn watch(&mut self, now: Tai, ledger: &mut Ledger) {
        self.session.watch(now, ledger);
    }

    /// Returns the number of messages taken in, all kinds.
    pub fn messages(&self) -> u64 {
        self.messages.iter().sum()
    }

    /// Returns the number of messages taken in by each port, all kinds; ports beyond the last one share its counter.
    pub fn messages_by_port(&self) -> [u64; PORTS_MAX] {
        self.messages
    }

    /// Returns the age at `at` of the newest attitude accepted.
    pub fn age_at(&self, at: Tai) -> Option<Span> {
        self.newest_epoch.map(|epoch| at - epoch)
    }

    /// Returns the time from the arrival of the attitude accepted last to `at`.
    pub fn arrival_age_at(&self, at: Tai) -> Option<Span> {
        self.newest_arrival.map(|arrival| at - arrival)
    }

    /// Accepts one message of the first port; returns an answer to send, if it needs one.
    pub fn accept(&mut self, message: &Stamped<Message>, ledger: &mut Ledger) -> Option<Message> {
        self.accept_from(0, message, ledger)
    }

    /// Accepts one message; returns an answer to send by the same port, if it needs one. Ports beyond the first
    /// `PORTS_MAX` share one place for time marks.
    pub fn accept_from(&mut self, port: usize, message: &Stamped<Message>, ledger: &mut Ledger) -> Option<Message> {
        let at = message.at;
        let port = port.min(PORTS_MAX - 1);
        self.messages[port] += 1;
        match &message.value {
            Message::Sync(sync) => self.syncs[port] = Some((sync.counter, at)),
            Message::TimeFollowUp(follow_up) => self.correlate(port, follow_up, at, ledger),
            Message::Attitude(record) => self.take_attitude(record, at, ledger),
            Message::Jitter(burst) => self.take_burst(burst, at, ledger),
            Message::JitterPair(pair) => self.take_pair(pair, at, ledger),
            Message::Command(command) => return self.answer(command, at, ledger),
            Message::Wheels(wheels) => self.take_wheels(wheels, at, ledger),
            Message::Table(cell) => self.session.put(cell),
            Message::Heartbeat(heartbeat) => self.session.take_in(heartbeat, at, ledger),
            // Answers of a stimulator: our own, or another one's on the same bus.
            Message::Exposure(_) | Message::Status(_) | Message::Camera(_) | Message::Response(_) => {}
        }
        None
    }

    /// Returns the answer to a command; `None` for an APPLY that follows another too soon: noise takes a millisecond to
    /// be made, and a client without an answer asks again.
    fn answer(&mut self, command: &Command, at: Tai, ledger: &mut Ledger) -> Option<Message> {
        let is_apply = matches!(command.request, Request::Apply { .. });
        if is_apply && self.applied.is_some_and(|last| at - last < APPLY_PERIOD) {
            ledger.note(Event::new(EventKind::CommandDeferred, at, None, Span::ZERO));
            return None;
        }
        if is_apply {
            self.applied = Some(at);
        }
        let answer = self.session.answer(command, at, self.clock.estimate().as_ref(), ledger);
        if let Some(Did::Applied(table)) = answer.did {
            let tables = &self.session.tables;
            let apply =
                |head: &mut Mounting| jitter_tables::apply(table, tables, head.sensor_from_body, &mut head.jitter);
            let applied = self.mountings.each(apply);
            let kind = if applied.is_ok() { EventKind::TableApplied } else { EventKind::SampleRefused };
            ledger.note(Event::new(kind, at, None, Span::ZERO));
        }
        Some(Message::Response(answer.response))
    }

    /// Accepts wheel speeds; they have no time tag and are valid at the time their message was sent.
    fn take_wheels(&mut self, wheels: &Wheels, at: Tai, ledger: &mut Ledger) {
        let rad_s = wheels.speed_rpm.map(|rpm| f64::from(rpm) * RPM);
        let sent = at - self.params.settings.clock.constant_delay;
        if self.mountings.each(|head| head.jitter.wheel_speeds(rad_s, sent)).is_err() {
            ledger.note(Event::new(EventKind::SampleRefused, at, None, Span::ZERO));
        }
    }

    /// Returns the flight computer's time of an instant, us modulo 2^32, by the tags of the nearest attitudes: the time
    /// by which they were converted, even if the clock's estimate has moved since. `None` before the first attitude.
    pub fn remote_us_at(&self, at: Tai) -> Option<u32> {
        let after = self.tags.partition_point(|(_, epoch)| *epoch <= at);
        let (t_us, epoch) = *self.tags.get(after.saturating_sub(1))?;
        let since_ns = (at - epoch).ns();
        let ahead_ns = match self.tags.get(after).filter(|_| after > 0) {
            // Interpolate between two tags: the estimate may have moved between them.
            Some((later_us, later)) => {
                let (ticks_ns, span_ns) = (1000 * i64::from(ticks_diff(*later_us, t_us)), (*later - epoch).ns().max(1));
                Span::from_s(ticks_ns as f64 * 1e-9 * (since_ns as f64 / span_ns as f64)).ns()
            }
            None => since_ns - Span::from_s(since_ns as f64 * 1e-9 * self.clock.estimate()?.drift).ns(),
        };
        let remote_ns = i64::from(t_us) * 1000 + ahead_ns;
        Some(wrapped((remote_ns + 500).div_euclid(1000)))
    }

    fn keep_tag(&mut self, t_us: u32, epoch: Tai) {
        if self.tags.len() >= TAGS {
            self.tags.pop_front();
        }
        let place = self.tags.partition_point(|(_, other)| *other <= epoch);
        self.tags.insert(place, (t_us, epoch));
    }

    /// Accepts a pulse at a whole second of the flight computer's clock.
    pub fn accept_pulse(&mut self, at: Tai) {
        match self.clock.observe_pps(at) {
            ObservedPps::Used => self.pulses.used += 1,
            ObservedPps::Odd | ObservedPps::Ambiguous | ObservedPps::NoTimeYet => self.pulses.refused += 1,
        }
        self.follow_clock();
    }

    fn correlate(&mut self, port: usize, follow_up: &TimeFollowUp, now: Tai, ledger: &mut Ledger) {
        let scet_ns = i64::try_from(follow_up.scet.ns()).unwrap_or(i64::MAX);
        if let Some((counter, at)) = self.syncs[port]
            && counter == follow_up.counter
        {
            self.syncs[port] = None;
            let before = self.clock.estimate();
            let observed = self.clock.observe(scet_ns, at);
            if let (Observed::Restarted, Some(before)) = (observed, before) {
                self.take_step(&before, scet_ns, at, now, ledger);
            }
            self.follow_clock();
        }
    }

    /// Follows a step of the flight computer's clock, which reads `scet_ns` at `sync_at`. A clock that reads less than
    /// half of the expected value has restarted: attitudes, jitter and dated triggers of the previous session are then
    /// discarded. After any other step the attitudes received so far keep their instants.
    fn take_step(&mut self, before: &ClockEstimate, scet_ns: i64, sync_at: Tai, now: Tai, ledger: &mut Ledger) {
        let expected_ns = before.to_remote_ns(sync_at);
        let step = Span::from_ns(scet_ns.saturating_sub(expected_ns));
        // Tags of two clocks cannot be ordered.
        self.tags.clear();
        if scet_ns < expected_ns / 2 {
            ledger.note(Event::new(EventKind::ClockRestarted, now, None, step));
            self.history.clear();
            self.rates.clear();
            self.mountings.each(|head| head.jitter.clear_points());
            self.newest_epoch = None;
            self.session.forget_dated_triggers(now, ledger);
        } else {
            ledger.note(Event::new(EventKind::ClockStepped, now, None, step));
            if let Some(estimate) = self.clock.estimate() {
                self.session.step_triggers(&estimate, now, ledger);
            }
        }
    }

    /// Passes the clock's estimate to uploaded jitter and triggers, which run by the flight computer's clock.
    fn follow_clock(&mut self) {
        if let Some(estimate) = self.clock.estimate() {
            self.mountings.each(|head| head.jitter.follow_clock(&estimate));
            self.session.follow_clock(&estimate);
        }
    }

    fn take_attitude(&mut self, record: &AttitudeRecord, at: Tai, ledger: &mut Ledger) {
        let Some(epoch) = self.clock.to_tai(record.t_us, at) else {
            ledger.note(Event::new(EventKind::NoTimeYet, at, None, Span::ZERO));
            return;
        };
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
        if let Some(sample) = sample.filter(|sample| self.history.insert(*sample, at).is_ok()) {
            if record.flags.rate {
                self.check_rate(&sample, ledger);
            }
            self.keep_tag(record.t_us, epoch);
            self.newest_epoch = self.newest_epoch.max(Some(epoch));
            self.newest_arrival = self.newest_arrival.max(Some(at));
        } else {
            ledger.note(Event::new(EventKind::SampleRefused, at, None, at - epoch));
        }
    }

    /// Accepts the state of an external plant at one instant; `arrived` is its arrival time. Returns false when a part
    /// of it was refused, which the ledger counts. Jitter is taken as single samples: a stream of them has no period,
    /// and no frame waits for it. Does not allocate.
    pub fn take_plant(&mut self, sample: &PlantSample, arrived: Tai, ledger: &mut Ledger) -> bool {
        let at = sample.at;
        let attitude = sample.attitude.is_none_or(|attitude| self.take_plant_attitude(at, &attitude, arrived, ledger));
        let heads = &mut self.mountings;
        let jitter =
            sample.jitter_rad.is_none_or(|body_rad| heads.each(|head| head.take_jitter(at, body_rad, arrived)));
        let observer = sample.observer.is_none_or(|state| heads.each(|head| head.take_observer(at, state)));
        for _ in [attitude, jitter, observer].into_iter().filter(|is_taken| !is_taken) {
            ledger.note(Event::new(EventKind::SampleRefused, arrived, None, arrived - at));
        }
        attitude && jitter && observer
    }

    /// Accepts a sample that did not come over a port, and counts it as a message of the first one.
    pub fn take_sample(&mut self, sample: &PlantSample, arrived: Tai, ledger: &mut Ledger) {
        self.messages[0] += 1;
        self.take_plant(sample, arrived, ledger);
    }

    /// Compares the rate of an accepted attitude with the attitudes before.
    fn check_rate(&mut self, sample: &AttitudeSample, ledger: &mut Ledger) {
        if self.rates.contradicts(sample) {
            ledger.note(Event::new(EventKind::RatesContradict, sample.at, None, WINDOW));
        }
    }

    fn take_plant_attitude(&mut self, at: Tai, attitude: &PlantAttitude, arrived: Tai, ledger: &mut Ledger) -> bool {
        let PlantAttitude { body_from_icrf, rate_rad_s, acceleration_rad_s2 } = *attitude;
        self.plant_seq = self.plant_seq.wrapping_add(1);
        let seq = self.plant_seq;
        let sample = AttitudeSample { at, seq, body_from_icrf, rate_rad_s, acceleration_rad_s2 };
        let is_taken = self.history.insert(sample, arrived).is_ok();
        if is_taken {
            self.check_rate(&sample, ledger);
            self.newest_epoch = self.newest_epoch.max(Some(at));
            self.newest_arrival = self.newest_arrival.max(Some(arrived));
        }
        is_taken
    }

    fn take_burst(&mut self, burst: &JitterBurst, at: Tai, ledger: &mut Ledger) {
        let period = Span::from_ns(i64::from(burst.period_us) * 1000);
        match self.clock.to_tai(burst.t_first_us, at) {
            Some(first) => self.take_jitter(first, period, burst.samples_arcsec(), at, ledger),
            None => ledger.note(Event::new(EventKind::NoTimeYet, at, None, Span::ZERO)),
        }
    }

    /// Accepts a classic pair. It gives its remote time only modulo 256 slots of 2 ms: the nearest candidate is used.
    fn take_pair(&mut self, pair: &JitterPair, at: Tai, ledger: &mut Ledger) {
        let Some(estimate) = self.clock.estimate() else {
            ledger.note(Event::new(EventKind::NoTimeYet, at, None, Span::ZERO));
            return;
        };
        const SLOT_NS: i64 = 2_000_000;
        let now_slot = estimate.to_remote_ns(at).div_euclid(SLOT_NS);
        let behind = (now_slot - i64::from(pair.slot)).rem_euclid(256);
        let behind = if behind > 128 { behind - 256 } else { behind };
        let first = estimate.to_tai((now_slot - behind) * SLOT_NS);
        self.take_jitter(first, PAIR_PERIOD, &pair.samples_arcsec, at, ledger);
    }

    /// Accepts jitter samples, which on the wire are rotations about body X and Y.
    fn take_jitter(&mut self, first: Tai, period: Span, samples_arcsec: &[[f32; 2]], at: Tai, ledger: &mut Ledger) {
        self.mountings.each(|head| head.expect_stream(first, period, at));
        for (i, [x, y]) in (0_i64..).zip(samples_arcsec) {
            let body_rad = DVec3::new(f64::from(*x), f64::from(*y), 0.0) * ARCSEC;
            let epoch = first + Span::from_ns(period.ns() * i);
            if !self.mountings.each(|head| head.take_jitter(epoch, body_rad, at)) {
                ledger.note(Event::new(EventKind::SampleRefused, at, None, at - epoch));
            }
        }
    }
}

#[path = "plain_intake.rs"]
mod plain_intake;
pub use plain_intake::plain_sample;

/// Capacity for observer states that wait for an exposure: 10 s of 100 Hz.
const OBSERVERS: usize = 1024;

/// Data that a receiver keeps for one head.
#[derive(Debug)]
pub struct Mounting {
    /// Rotation to the axes of its sensor.
    pub sensor_from_body: Rotation<Sensor, Body>,
    /// The jitter so far.
    pub jitter: JitterHistory,
    /// End of the newest exposure that was drawn.
    drawn_until: Option<Tai>,
    /// Jitter samples that arrived after the exposure they belong to was drawn.
    pub late_jitter: u64,
    /// States of the observer for the next exposure.
    observers: VecDeque<(Tai, BarycentricState)>,
}

impl Mounting {
    pub(super) fn new(params: &AttitudeParams) -> Result<Self> {
        let mut jitter = JitterHistory::new(params.settings.jitter_history, params.settings.jitter_max_gap);
        jitter.set_lines(&params.jitter_lines, params.jitter_epoch)?;
        if let Some(record) = &params.jitter_record {
            jitter.set_record(record.clone());
        }
        let (sensor_from_body, observers) = (params.sensor_from_body, VecDeque::with_capacity(OBSERVERS));
        Ok(Self { sensor_from_body, jitter, drawn_until: None, late_jitter: 0, observers })
    }

    /// Records that an exposure that ends at `until` is drawn: samples of it that arrive from now on are late.
    pub fn note_drawn(&mut self, until: Tai) {
        self.drawn_until = self.drawn_until.max(Some(until));
    }

    /// Returns the states of the observer that came since the last call, by arrival, each once.
    pub fn take_observers(&mut self) -> impl Iterator<Item = (Tai, BarycentricState)> + use<'_> {
        core::iter::from_fn(|| self.observers.pop_front())
    }

    /// Accepts a rotation about the body axes; returns false when it was refused.
    pub(super) fn take_jitter(&mut self, at: Tai, body_rad: DVec3, arrived: Tai) -> bool {
        let rotation_rad = self.sensor_from_body.apply(body_rad);
        let is_taken = self.jitter.insert(JitterPoint { at, rotation_rad }, arrived).is_ok();
        self.late_jitter += u64::from(is_taken && self.drawn_until.is_some_and(|until| at <= until));
        is_taken
    }

    /// Accepts a state of the observer; returns false when too many wait.
    pub(super) fn take_observer(&mut self, at: Tai, state: BarycentricState) -> bool {
        let has_place = self.observers.len() < OBSERVERS;
        if has_place {
            self.observers.push_back((at, state));
        }
        has_place
    }

    /// Expects samples from `first` on.
    pub(super) fn expect_stream(&mut self, first: Tai, period: Span, arrived: Tai) {
        self.jitter.note_stream(first, period, arrived);
    }
}

#[cfg(test)]
#[path = "receiver_tests.rs"]
mod tests;
