//! The events of a captured run, placed as in the run, for one head: frames are hit as they were.
//!
//! In: the run file's events and those that were injected. Out: the faults of the head's frames, with the numbers that they
//! have in the list of all faults. Faults of the bus and aboard the vehicle take their numbers there and do nothing else: the
//! capture holds what arrived after them.

use crate::runtime::frame_faults::FrameFaults;
use crate::runtime::receiver::Receiver;
use crate::runtime::{FrameEngine, RunError};
use crate::wiring::faults::{FaultLog, Places};
use base::axes::{Body, Rotation, Sensor};
use base::time::{Span, Tai};
use config::{Action, Event};
use link::tap::FaultControl;
use std::collections::VecDeque;

/// The faults of one head of several.
pub(super) struct HeadFaults {
    log: FaultLog,
    /// Of every head; only those of the head at hand are made ready.
    of_heads: Vec<FrameFaults>,
    head: usize,
    /// From where the times of events count.
    zero: Tai,
    mounting: Rotation<Sensor, Body>,
    /// Events that came while the run went on, and when.
    injected: VecDeque<(Tai, Event)>,
}

impl HeadFaults {
    /// Of head number `head` of so many, before any event.
    pub(super) fn new(head: usize, heads: usize, zero: Tai, mounting: Rotation<Sensor, Body>) -> Self {
        let of_heads = (0..heads.max(head + 1)).map(|_| FrameFaults::default()).collect();
        Self { log: FaultLog::default(), of_heads, head, zero, mounting, injected: VecDeque::new() }
    }

    /// Adds an event that came so long after the first exposure; those that came later are added later.
    pub(super) fn add_injected(&mut self, came: Span, event: Event) {
        self.injected.push_back((self.zero + came, event));
    }

    /// The faults of the head.
    pub(super) fn own(&mut self) -> Option<&mut FrameFaults> {
        self.of_heads.get_mut(self.head)
    }

    /// Whether a frame may show what the one before was.
    pub(super) fn has_any(&self) -> bool {
        !self.injected.is_empty() || self.of_heads.get(self.head).is_some_and(|faults| !faults.timed().is_empty())
    }

    /// Places the events of the run file: a trigger finds those that wait for it.
    pub(super) fn place_all(
        &mut self,
        events: &[Event],
        receiver: &mut Receiver,
        engine: &mut FrameEngine,
    ) -> Result<(), RunError> {
        let is_trigger = |event: &&Event| matches!(event.action, Action::Trigger { .. });
        let triggers = events.iter().filter(is_trigger);
        for event in events.iter().filter(|event| !is_trigger(event)).chain(triggers) {
            self.place(event, receiver, engine)?;
        }
        Ok(())
    }

    /// Places the events that came before `at`, when a frame is drawn.
    pub(super) fn place_injected_before(
        &mut self,
        at: Tai,
        receiver: &mut Receiver,
        engine: &mut FrameEngine,
    ) -> Result<(), RunError> {
        while let Some((_, event)) = self.injected.front().copied().filter(|(came, _)| *came < at) {
            self.injected.pop_front();
            self.place(&event, receiver, engine)?;
        }
        Ok(())
    }

    fn place(&mut self, event: &Event, receiver: &mut Receiver, engine: &mut FrameEngine) -> Result<(), RunError> {
        let nothing_acts_there = FaultControl::default();
        let mut places = Places {
            to_stimulator: &nothing_acts_there,
            to_computer: &nothing_acts_there,
            frames: self.of_heads.iter_mut().collect(),
        };
        self.log.place(event, self.zero, &self.mounting, &mut places, &mut Vec::new());
        event.on_trigger.into_iter().for_each(|number| receiver.expect_trigger(number));
        self.own().map_or(Ok(()), |faults| faults.prepare(engine))
    }
}
