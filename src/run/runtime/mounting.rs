//! State of one head in a receiver: its jitter, in the axes of its sensor, and inputs that every head takes by itself.
//!
//! In: jitter messages and wheel speeds, about the body's axes. Out: points in the jitter history of every head; refused
//! ones are events. Allocates nothing after the start. Tests: `receiver_tests`, `tests/closed_loop/late_jitter.rs`.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::{error::Result, params::AttitudeParams, session::PerHead};
use base::axes::{Body, Rotation, Sensor};
use base::time::{Span, Tai};
use base::units::{ARCSEC, RPM};
use firmware_protocol::message::{JitterBurst, JitterPair, Wheels};
use glam::DVec3;
use plan::attitude::{JitterHistory, JitterPoint, RemoteClock};
use sky::observer::BarycentricState;
use std::collections::VecDeque;

/// Period of classic jitter pairs' samples.
const PAIR_PERIOD: Span = Span::from_ms(1);
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
    pub(super) fn note_drawn(&mut self, until: Tai) {
        self.drawn_until = self.drawn_until.max(Some(until));
    }

    /// Returns the states of the observer that came since the last call, by arrival, each once.
    pub(super) fn take_observers(&mut self) -> impl Iterator<Item = (Tai, BarycentricState)> + use<'_> {
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
}

impl PerHead<Mounting> {
    /// Accepts wheel speeds; they have no time tag and are valid at the time their message was sent.
    pub(super) fn take_wheels(&mut self, wheels: &Wheels, sent: Tai, at: Tai, ledger: &mut Ledger) {
        let rad_s = wheels.speed_rpm.map(|rpm| f64::from(rpm) * RPM);
        if self.each(|head| head.jitter.wheel_speeds(rad_s, sent)).is_err() {
            ledger.note(Event::new(EventKind::SampleRefused, at, None, Span::ZERO));
        }
    }

    /// Accepts a burst of samples.
    pub(super) fn take_burst(&mut self, burst: &JitterBurst, clock: &RemoteClock, at: Tai, ledger: &mut Ledger) {
        let period = Span::from_ns(i64::from(burst.period_us) * 1000);
        match clock.to_tai(burst.t_first_us, at) {
            Some(first) => self.take_samples(first, period, burst.samples_arcsec(), at, ledger),
            None => ledger.note(Event::new(EventKind::NoTimeYet, at, None, Span::ZERO)),
        }
    }

    /// Accepts a classic pair. It gives its remote time only modulo 256 slots of 2 ms: the nearest candidate is used.
    pub(super) fn take_pair(&mut self, pair: &JitterPair, clock: &RemoteClock, at: Tai, ledger: &mut Ledger) {
        let Some(estimate) = clock.estimate() else {
            ledger.note(Event::new(EventKind::NoTimeYet, at, None, Span::ZERO));
            return;
        };
        const SLOT_NS: i64 = 2_000_000;
        let now_slot = estimate.to_remote_ns(at).div_euclid(SLOT_NS);
        let behind = (now_slot - i64::from(pair.slot)).rem_euclid(256);
        let behind = if behind > 128 { behind - 256 } else { behind };
        let first = estimate.to_tai((now_slot - behind) * SLOT_NS);
        self.take_samples(first, PAIR_PERIOD, &pair.samples_arcsec, at, ledger);
    }

    /// Accepts jitter samples, which on the wire are rotations about body X and Y.
    fn take_samples(&mut self, first: Tai, period: Span, samples_arcsec: &[[f32; 2]], at: Tai, ledger: &mut Ledger) {
        self.each(|head| head.jitter.note_stream(first, period, at));
        for (i, [x, y]) in (0_i64..).zip(samples_arcsec) {
            let body_rad = DVec3::new(f64::from(*x), f64::from(*y), 0.0) * ARCSEC;
            let epoch = first + Span::from_ns(period.ns() * i);
            if !self.each(|head| head.take_jitter(epoch, body_rad, at)) {
                ledger.note(Event::new(EventKind::SampleRefused, at, None, at - epoch));
            }
        }
    }
}
