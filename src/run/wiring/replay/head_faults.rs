//! The events of a captured run, placed as in the run, for one head: frames are hit as they were.
//!
//! In: the run file's events and the injected ones. Out: the faults of the head's frames, with their numbers in the
//! list of all faults. Faults of the bus and aboard the vehicle only take their numbers: the capture contains packets
//! that arrived after those faults acted.

use super::ReplayError;
use crate::runtime::{Head, frame_faults::FrameFaults, receiver::Receiver};
use crate::wiring::fault_desk::{FaultDesk, in_order_of_placing, make_ready};
use base::time::{Span, Tai};
use config::Event;
use std::collections::VecDeque;

/// The faults of one head of several.
pub(super) struct HeadFaults {
    desk: FaultDesk,
    /// Faults of the other heads, which are not prepared; those of the replayed head are its own.
    of_heads: Vec<FrameFaults>,
    head: usize,
    /// Time zero of events.
    zero: Tai,
    /// Events that were injected during the run, with their times.
    injected: VecDeque<(Tai, Event)>,
}

impl HeadFaults {
    /// Returns the faults of head number `head` of `heads`, before any event.
    pub(super) fn new(desk: FaultDesk, zero: Tai, head: usize, heads: usize) -> Self {
        let of_heads = (0..heads).map(|_| FrameFaults::default()).collect();
        Self { desk, of_heads, head, zero, injected: VecDeque::new() }
    }

    /// Adds an event injected this long after the first exposure; call in order of time.
    pub(super) fn add_injected(&mut self, came: Span, event: Event) {
        self.injected.push_back((self.zero + came, event));
    }

    /// Returns true when a frame may show the previous one.
    pub(super) fn has_any(&self, head: &Head) -> bool {
        !self.injected.is_empty() || !head.faults.timed().is_empty()
    }

    /// Places the events of the run file, at the start of the run.
    pub(super) fn place_all(
        &mut self,
        events: &[Event],
        start: Tai,
        head: &mut Head,
        receiver: &mut Receiver,
    ) -> Result<(), ReplayError> {
        in_order_of_placing(events).try_for_each(|event| self.place(event, start, head, receiver))
    }

    /// Places the events that came before `at`, when a frame is drawn.
    pub(super) fn place_injected_before(
        &mut self,
        at: Tai,
        head: &mut Head,
        receiver: &mut Receiver,
    ) -> Result<(), ReplayError> {
        while let Some((came, event)) = self.injected.front().copied().filter(|(came, _)| *came < at) {
            self.injected.pop_front();
            self.place(&event, came, head, receiver)?;
        }
        Ok(())
    }

    fn place(&mut self, event: &Event, now: Tai, head: &mut Head, receiver: &mut Receiver) -> Result<(), ReplayError> {
        self.desk.check(event).map_err(|error| ReplayError::Parts(error.to_string()))?;
        let mut frames: Vec<&mut FrameFaults> = self.of_heads.iter_mut().collect();
        frames[self.head] = &mut head.faults;
        self.desk.place(event, now, frames);
        Ok(make_ready(event, core::iter::once(head), receiver)?)
    }
}
