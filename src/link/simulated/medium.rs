//! The wire: order of sending, destroyed frames, delivery to the ends.
//!
//! Lazy: nothing runs by itself. [`Medium::settle`] brings the wire up to an instant, event by event, and is called
//! before anything is asked or changed. A start is decided only when its instant has passed, so that a frame that is
//! queued before then still takes part in the arbitration; the result does not depend on when the bus is read.

use super::end::{End, Queued};
use super::{BusFault, BusModel, BusParams, BusStatistics, TimedBusFault};
use crate::{Packet, Stamped};
use base::time::{Span, Tai};
use firmware_protocol::can::{CanFrame, CanId};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Bits of an error frame and the interframe space after it: 6 of a flag alone, 12 of flags that answer each other, 8
/// of delimiter, 3 of space (ISO 11898-1:2015, 10.4.4).
const ERROR_FRAME_BITS: core::ops::RangeInclusive<i64> = 17..=23;
/// Bits for which an error-passive controller waits after a frame of its own.
const SUSPEND_BITS: i64 = 8;
/// Recessive bits that count once for the way back from bus-off.
const RECESSIVE_BITS: i64 = 11;

/// The wire, its ends and its faults.
pub(super) struct Medium {
    pub(super) params: BusParams,
    pub(super) model: BusModel,
    pub(super) ends: Vec<End>,
    pub(super) faults: Vec<TimedBusFault>,
    /// One on CAN; on serial one per end.
    wires: Vec<Wire>,
    dice: StdRng,
    bit: Span,
    since: Tai,
    busy: Span,
    frames: u64,
    babbled: u64,
    error_frames: u64,
}

struct Wire {
    free_at: Tai,
    current: Option<Transmission>,
}

/// A frame on the wire.
#[derive(Clone, Copy)]
struct Transmission {
    sender: Sender,
    frame: Queued,
    begun: Tai,
    /// End of the frame and its interframe space, or of the error frame that destroyed it.
    done: Tai,
    is_destroyed: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Sender {
    End(usize),
    /// Number of the fault.
    Babbler(usize),
}

/// Priority in the arbitration: the lower value wins, bit by bit on the wire; the order of identifiers is that of the
/// bus. Of one identifier a classic frame is dominant where an FD frame is recessive (FDF). Two ends with one identifier,
/// which no real bus allows: the one with the lower number.
type Priority = (CanId, bool);

/// Priority of a sender without a frame.
const NONE: Priority = (CanId::LAST, true);

impl Wire {
    fn idle() -> Self {
        Self { free_at: Tai::from_ns(i64::MIN), current: None }
    }
}

fn priority(packet: &Packet) -> Priority {
    match packet {
        Packet::Can(frame) => (frame.id(), frame.is_fd()),
        Packet::Serial(_) | Packet::Datagram(_) => (CanId::default(), false),
    }
}

impl Medium {
    pub(super) fn new(params: BusParams, model: BusModel, since: Tai) -> Self {
        let wires = if params.timing.is_shared() { vec![Wire::idle()] } else { Vec::new() };
        let (bit, dice) = (params.timing.bit_time(), StdRng::seed_from_u64(model.seed));
        let (ends, faults) = (Vec::new(), Vec::new());
        let busy = Span::ZERO;
        Self { params, model, ends, faults, wires, dice, bit, since, busy, frames: 0, babbled: 0, error_frames: 0 }
    }

    /// Returns a place for one more end: that of one that left, or a new one.
    pub(super) fn attach(&mut self) -> usize {
        let end = End::new(self.params.queue_packets, self.model.transmit_packets);
        if let Some(place) = self.ends.iter().position(End::is_free) {
            self.ends[place] = end;
            return place;
        }
        self.ends.push(end);
        if !self.params.timing.is_shared() {
            self.wires.push(Wire::idle());
        }
        self.ends.len() - 1
    }

    fn bits(&self, bits: i64) -> Span {
        Span::from_ns(bits * self.bit.ns())
    }

    fn wire_of(&self, end: usize) -> usize {
        if self.params.timing.is_shared() { 0 } else { end }
    }

    /// Ends that send on a wire.
    fn senders(&self, wire: usize) -> core::ops::Range<usize> {
        if self.params.timing.is_shared() { 0..self.ends.len() } else { wire..wire + 1 }
    }

    // --- time passes -------------------------------------------------------------------------------------------------

    /// Processes everything that happens by `now`.
    pub(super) fn settle(&mut self, now: Tai) {
        for wire in 0..self.wires.len() {
            self.settle_wire(wire, now);
        }
        if self.params.timing.is_shared() {
            self.put_off(now);
            if self.wires[0].current.is_none() {
                self.see_idle(now);
            }
        }
    }

    fn settle_wire(&mut self, wire: usize, now: Tai) {
        loop {
            if let Some(current) = self.wires[wire].current {
                if current.done > now {
                    return;
                }
                // In the order of time, whenever the bus is read.
                self.put_off(current.done);
                self.finish(wire, &current);
            }
            match self.next_start(wire) {
                // Someone was put off before the start: another may be next.
                Some((start, _)) if start < now && self.put_off(start) => {}
                Some((start, sender)) if start < now => self.begin(wire, start, sender),
                _ => return,
            }
        }
    }

    /// Returns the start and the sender of the next frame, from the present queues.
    fn next_start(&self, wire: usize) -> Option<(Tai, Sender)> {
        let ends = self.senders(wire).filter_map(|end| self.ends[end].ready_at().map(|at| (at, Sender::End(end))));
        let babblers =
            (0..self.faults.len()).filter_map(|fault| Some((self.babble_at(fault)?, Sender::Babbler(fault))));
        let ready = || ends.clone().chain(babblers.clone());
        let start = ready().map(|(at, _)| at).min()?.max(self.wires[wire].free_at);
        // `min_by_key` takes the first of equals: the end with the lower number, and ends before babblers.
        let winner = ready().filter(|(at, _)| *at <= start).min_by_key(|(_, sender)| self.priority_of(*sender));
        winner.map(|(_, sender)| (start, sender))
    }

    fn priority_of(&self, sender: Sender) -> Priority {
        match sender {
            Sender::End(end) => self.ends[end].outbox.front().map_or(NONE, |first| priority(&first.packet)),
            Sender::Babbler(fault) => match self.faults[fault].fault {
                BusFault::Babble { id, .. } => (id, false),
                BusFault::BitErrors { .. } | BusFault::BusOff { .. } => NONE,
            },
        }
    }

    /// Returns when a babbling node has its next frame ready.
    fn babble_at(&self, fault: usize) -> Option<Tai> {
        let timed = &self.faults[fault];
        let babbles = matches!(timed.fault, BusFault::Babble { share_of_bandwidth, .. } if share_of_bandwidth > 0.0);
        (babbles && self.params.timing.is_shared() && timed.next_at < timed.until).then_some(timed.next_at)
    }

    fn begin(&mut self, wire: usize, start: Tai, sender: Sender) {
        self.see_idle(start);
        let frame = match sender {
            Sender::End(end) => self.ends[end].start(),
            Sender::Babbler(fault) => self.babbled_frame(fault, start),
        };
        let Some(frame) = frame else { return };
        let cut = self.destroyed_after(start, frame.duration);
        let done = start + cut.unwrap_or(frame.duration);
        let is_destroyed = cut.is_some();
        self.wires[wire].current = Some(Transmission { sender, frame, begun: start, done, is_destroyed });
    }

    fn babbled_frame(&mut self, fault: usize, start: Tai) -> Option<Queued> {
        let BusFault::Babble { id, share_of_bandwidth } = self.faults[fault].fault else { return None };
        let packet = Packet::Can(CanFrame::classic(id, &[0; 8])?);
        let duration = self.duration(&packet)?;
        let timed = &mut self.faults[fault];
        timed.next_at = start + Span::from_s(duration.s() / share_of_bandwidth.min(1.0));
        if share_of_bandwidth >= 1.0 {
            timed.next_at = start + duration;
        }
        timed.hits += 1;
        Some(Queued { number: 0, at: start, packet, duration })
    }

    /// Returns whether bit errors destroy a frame that starts at `start`: the time from there to the end of the error
    /// frame.
    fn destroyed_after(&mut self, start: Tai, duration: Span) -> Option<Span> {
        let shared = self.params.timing.is_shared();
        let dice = &mut self.dice;
        let mut is_hit = false;
        for timed in self.faults.iter_mut().filter(|timed| shared && timed.is_active(start)) {
            if let BusFault::BitErrors { share } = timed.fault
                && dice.random::<f64>() < share
            {
                timed.hits += 1;
                is_hit = true;
            }
        }
        is_hit.then(|| {
            let frame = (duration.ns() - 3 * self.bit.ns()).max(1);
            let struck = Span::from_ns(self.dice.random_range(1..=frame));
            let flags = self.dice.random_range(ERROR_FRAME_BITS);
            struck + self.bits(flags)
        })
    }

    fn finish(&mut self, wire: usize, current: &Transmission) {
        let Transmission { sender, frame, begun, done, is_destroyed } = *current;
        self.wires[wire] = Wire { free_at: done, current: None };
        self.busy = self.busy + (done - begun);
        if is_destroyed {
            self.destroy(sender, frame, done);
        } else {
            self.deliver(sender, &frame, done);
        }
        // Last: a controller that comes back with the end of this frame has not received it.
        self.ends.iter_mut().for_each(|end| end.see_frame(done));
    }

    fn destroy(&mut self, sender: Sender, frame: Queued, done: Tai) {
        self.error_frames += 1;
        self.others(sender).for_each(End::saw_error);
        let pause = self.bits(SUSPEND_BITS);
        if let Sender::End(end) = sender {
            self.ends[end].destroyed(frame, done, pause);
        }
    }

    fn deliver(&mut self, sender: Sender, frame: &Queued, done: Tai) {
        self.frames += 1;
        self.babbled += u64::from(matches!(sender, Sender::Babbler(_)));
        let arrival = Stamped { at: done + self.params.latency, value: frame.packet };
        let space = self.params.queue_packets;
        self.others(sender).for_each(|end| end.take(arrival, space));
        if let Sender::End(end) = sender {
            let pause = self.bits(SUSPEND_BITS);
            self.ends[end].left(frame.number, done, pause);
        }
    }

    fn others(&mut self, sender: Sender) -> impl Iterator<Item = &mut End> {
        let ends = self.ends.iter_mut().enumerate();
        ends.filter(move |(number, _)| sender != Sender::End(*number)).map(|(_, end)| end)
    }

    /// Ends that a fault puts off the bus by `at`; true when there was one.
    fn put_off(&mut self, at: Tai) -> bool {
        let mut any = false;
        if !self.params.timing.is_shared() {
            return any;
        }
        for timed in &mut self.faults {
            let BusFault::BusOff { end } = timed.fault else { continue };
            if timed.hits == 0 && timed.from <= at {
                timed.hits = u64::from(end < self.ends.len());
                if let Some(end) = self.ends.get_mut(end) {
                    end.go_off(timed.until);
                    any = true;
                }
            }
        }
        any
    }

    fn see_idle(&mut self, until: Tai) {
        let sequence = self.bits(RECESSIVE_BITS);
        self.ends.iter_mut().for_each(|end| end.see_idle(until, sequence));
    }

    // --- what the ends ask -------------------------------------------------------------------------------------------

    /// Returns the time on the wire; `None` when this wire does not carry such packets.
    pub(super) fn duration(&self, packet: &Packet) -> Option<Span> {
        self.params.timing.duration_with(packet, self.model.stuffing)
    }

    /// Queues a packet at `now` and returns when it leaves if no other end sends and no fault occurs, or `now` when it
    /// never will.
    pub(super) fn queue(&mut self, end: usize, packet: &Packet, duration: Span, now: Tai) -> Tai {
        if !self.ends[end].queue(packet, now, duration, self.model.transmit_packets) {
            return now;
        }
        self.estimate(end, now)
    }

    /// Returns when the last packet in the queue of `end` leaves, from the present queues.
    fn estimate(&mut self, end: usize, now: Tai) -> Tai {
        let wire = self.wire_of(end);
        let mut at = self.wires[wire].current.map_or(self.wires[wire].free_at.max(now), |current| current.done);
        self.ends.iter_mut().for_each(|end| end.cursor = 0);
        while self.ends[end].cursor < self.ends[end].outbox.len() {
            let heads = self.senders(wire).filter_map(|end| {
                let first = self.ends[end].outbox.get(self.ends[end].cursor)?;
                Some((priority(&first.packet), end, first.duration))
            });
            let Some((_, next, duration)) = heads.min_by_key(|(priority, ..)| *priority) else { break };
            at = at + duration;
            self.ends[next].cursor += 1;
        }
        at
    }

    /// Returns when something may next arrive anywhere, from the present queues: an end that waits need not look
    /// before.
    pub(super) fn next_arrival(&self) -> Option<Tai> {
        let per_wire = |wire: usize| match self.wires[wire].current {
            Some(current) => Some(current.done),
            None => {
                let (start, sender) = self.next_start(wire)?;
                let duration = match sender {
                    Sender::End(end) => self.ends[end].outbox.front()?.duration,
                    Sender::Babbler(_) => Span::from_ns(1),
                };
                Some(start + duration)
            }
        };
        (0..self.wires.len()).filter_map(per_wire).min().map(|done| done + self.params.latency)
    }

    pub(super) fn statistics(&self, now: Tai) -> BusStatistics {
        let on_the_wire = self.wires.iter().filter_map(|wire| wire.current).map(|current| now - current.begun);
        BusStatistics {
            since: self.since,
            until: now,
            busy: on_the_wire.fold(self.busy, |sum, part| sum + part),
            frames: self.frames,
            babbled: self.babbled,
            error_frames: self.error_frames,
            ends: self.ends.iter().filter(|end| !end.has_left).count(),
        }
    }
}
