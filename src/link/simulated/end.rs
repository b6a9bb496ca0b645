//! One controller on the bus: its packets to send, its received packets, its error counters.

use super::error_counters::{ErrorCounters, ErrorState};
use crate::{Departure, LinkCounters, Packet, Stamped};
use base::time::{Span, Tai};
use std::collections::VecDeque;

/// Number of departures that are remembered.
const DEPARTURES: usize = 64;
/// Sequences of 11 recessive bits that a controller sees before it is back from bus-off.
const RECOVERY_SEQUENCES: i64 = 128;

/// A packet that waits for the wire.
#[derive(Debug, Clone, Copy)]
pub(super) struct Queued {
    /// Number of packets that this end sent before it.
    pub(super) number: u64,
    /// Time at which it was sent.
    pub(super) at: Tai,
    pub(super) packet: Packet,
    /// Its time on the wire, interframe space included.
    pub(super) duration: Span,
}

/// Progress of a recovery from bus-off.
#[derive(Debug, Clone, Copy)]
struct Recovery {
    /// Time up to which the bus was watched; later than now while a fault holds the controller off.
    watched: Tai,
    /// Sequences still to see.
    left: i64,
}

/// One controller.
pub(super) struct End {
    pub(super) inbox: VecDeque<Stamped<Packet>>,
    pub(super) outbox: VecDeque<Queued>,
    pub(super) counters: LinkCounters,
    pub(super) errors: ErrorCounters,
    /// Earliest start of its next frame: the pause of an error-passive controller.
    pub(super) not_before: Tai,
    /// Whether its user is gone; packets that it queued still go out.
    pub(super) has_left: bool,
    /// Next to look at in the outbox, for estimates.
    pub(super) cursor: usize,
    sent: u64,
    /// Number of the packet that is on the wire.
    on_the_wire: Option<u64>,
    departures: VecDeque<(u64, Departure)>,
    recovery: Option<Recovery>,
}

impl End {
    pub(super) fn new(inbox_packets: usize, outbox_packets: usize) -> Self {
        Self {
            inbox: VecDeque::with_capacity(inbox_packets),
            // One more: a destroyed frame goes back to the head.
            outbox: VecDeque::with_capacity(outbox_packets + 1),
            counters: LinkCounters::default(),
            errors: ErrorCounters::default(),
            not_before: Tai::from_ns(i64::MIN),
            has_left: false,
            cursor: 0,
            sent: 0,
            on_the_wire: None,
            departures: VecDeque::with_capacity(DEPARTURES),
            recovery: None,
        }
    }

    /// Returns true if the end is not used any more and has nothing left to send.
    pub(super) fn is_free(&self) -> bool {
        self.has_left && self.outbox.is_empty() && self.on_the_wire.is_none()
    }

    pub(super) fn is_off(&self) -> bool {
        self.recovery.is_some()
    }

    /// Returns when the first packet that waits could start on an idle wire.
    pub(super) fn ready_at(&self) -> Option<Tai> {
        self.outbox.front().map(|first| first.at.max(self.not_before))
    }

    /// Queues a packet; false when the queue is full or the controller is off the bus: counted, and never sent.
    pub(super) fn queue(&mut self, packet: &Packet, at: Tai, duration: Span, space: usize) -> bool {
        let number = self.sent;
        self.sent += 1;
        if self.is_off() || self.outbox.len() >= space {
            self.give_up(number);
            return false;
        }
        self.outbox.push_back(Queued { number, at, packet: *packet, duration });
        true
    }

    /// Takes the first packet from the queue onto the wire.
    pub(super) fn start(&mut self) -> Option<Queued> {
        let frame = self.outbox.pop_front();
        self.on_the_wire = frame.map(|frame| frame.number);
        frame
    }

    fn give_up(&mut self, number: u64) {
        self.counters.unsent += 1;
        self.remember(number, Departure::Never);
    }

    fn remember(&mut self, number: u64, departure: Departure) {
        if self.departures.len() >= DEPARTURES {
            self.departures.pop_front();
        }
        self.departures.push_back((number, departure));
    }

    /// Returns the outcome of the packet before which `number` were sent.
    pub(super) fn departure(&self, number: u64) -> Departure {
        let known = self.departures.iter().rev().find(|(known, _)| *known == number);
        let waits = || self.outbox.iter().any(|queued| queued.number == number) || self.on_the_wire == Some(number);
        match known {
            Some((_, departure)) => *departure,
            None if waits() => Departure::Waiting,
            None => Departure::AsReported,
        }
    }

    /// Records that a frame of this end was transmitted.
    pub(super) fn left(&mut self, number: u64, at: Tai, passive_pause: Span) {
        self.on_the_wire = None;
        self.counters.sent += 1;
        self.remember(number, Departure::At(at));
        // Put off the bus meanwhile: the frame is let through, and the counters stay where they are.
        if !self.is_off() {
            self.errors.transmit_succeeded();
            self.pause_if_passive(at, passive_pause);
        }
    }

    /// Returns a destroyed frame of this end to the head of the queue, unless that was one error too many.
    pub(super) fn destroyed(&mut self, frame: Queued, at: Tai, passive_pause: Span) {
        self.on_the_wire = None;
        self.counters.errors += 1;
        if self.is_off() {
            self.give_up(frame.number);
            return;
        }
        self.errors.transmit_failed();
        self.outbox.push_front(frame);
        self.pause_if_passive(at, passive_pause);
        if self.errors.state() == ErrorState::BusOff {
            self.go_off(at);
        }
    }

    fn pause_if_passive(&mut self, at: Tai, pause: Span) {
        if self.errors.state() == ErrorState::Passive {
            self.not_before = at + pause;
        }
    }

    /// Leaves the bus, gives up waiting packets, and starts to watch for recovery at `watch_from`.
    pub(super) fn go_off(&mut self, watch_from: Tai) {
        if !self.is_off() {
            self.counters.bus_off += 1;
        }
        self.errors.force_off();
        while let Some(frame) = self.outbox.pop_front() {
            self.give_up(frame.number);
        }
        let watched = self.recovery.map_or(watch_from, |recovery| recovery.watched.max(watch_from));
        self.recovery = Some(Recovery { watched, left: RECOVERY_SEQUENCES });
    }

    /// Records that the wire was idle until `until`: every `sequence` of that counts towards bus-off recovery.
    pub(super) fn see_idle(&mut self, until: Tai, sequence: Span) {
        let Some(recovery) = &mut self.recovery else { return };
        let seen = ((until - recovery.watched).ns() / sequence.ns().max(1)).clamp(0, recovery.left);
        recovery.left -= seen;
        recovery.watched = recovery.watched + Span::from_ns(seen * sequence.ns());
        self.come_back_if_seen_enough();
    }

    /// Records that a frame or error frame ended at `done` with 11 recessive bits.
    pub(super) fn see_frame(&mut self, done: Tai) {
        let Some(recovery) = &mut self.recovery else { return };
        if recovery.watched < done {
            recovery.left -= 1;
            recovery.watched = done;
        }
        self.come_back_if_seen_enough();
    }

    fn come_back_if_seen_enough(&mut self) {
        if self.recovery.is_some_and(|recovery| recovery.left <= 0) {
            self.recovery = None;
            self.errors = ErrorCounters::default();
        }
    }

    /// Takes a frame that another end transmitted.
    pub(super) fn take(&mut self, packet: Stamped<Packet>, space: usize) {
        if self.is_off() || self.has_left {
            return;
        }
        self.errors.receive_succeeded();
        if self.inbox.len() >= space {
            self.counters.overflows += 1;
            return;
        }
        let place = self.inbox.partition_point(|earlier| earlier.at <= packet.at);
        self.inbox.insert(place, packet);
    }

    /// Counts a destroyed frame of another end.
    pub(super) fn saw_error(&mut self) {
        if !self.is_off() && !self.has_left {
            self.counters.errors += 1;
            self.errors.receive_failed();
        }
    }

    /// Returns the oldest packet that has arrived by `now`.
    pub(super) fn due_by(&mut self, now: Tai) -> Option<Stamped<Packet>> {
        let is_due = self.inbox.front().is_some_and(|first| first.at <= now);
        let packet = if is_due { self.inbox.pop_front() } else { None };
        self.counters.received += u64::from(is_due);
        packet
    }
}
