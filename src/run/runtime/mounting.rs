//! Data that a receiver keeps for one head: its jitter, in the axes of its sensor, and inputs that every head takes by itself.

use crate::runtime::{error::RunError, params::AttitudeParams};
use base::axes::{Body, Rotation, Sensor};
use base::time::{Span, Tai};
use glam::DVec3;
use plan::attitude::{JitterHistory, JitterPoint};
use sky::observer::BarycentricState;
use std::collections::VecDeque;

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
    late_jitter: u64,
    /// States of the observer for the next exposure.
    observers: VecDeque<(Tai, BarycentricState)>,
}

impl Mounting {
    pub(super) fn new(params: &AttitudeParams) -> Result<Self, RunError> {
        let mut jitter = JitterHistory::new(params.jitter_history, params.jitter_max_gap);
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

    /// Returns the number of jitter samples that arrived after the exposure they belong to was drawn.
    pub fn late_jitter(&self) -> u64 {
        self.late_jitter
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
