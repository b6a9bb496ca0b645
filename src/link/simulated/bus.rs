//! The bus and its ends.

use super::BusTiming;
use crate::base::clock::Clock;
use crate::base::time::{Span, Tai};
use crate::link::{Link, LinkCounters, LinkError, Packet, Stamped};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// What a simulated bus is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BusParams {
    /// Name in messages.
    pub name: String,
    /// Kind and speed of the wire.
    pub timing: BusTiming,
    /// Time from the last bit on the wire to the receiver's stamp.
    pub latency: Span,
    /// Packets an end holds until they are received; more are lost and counted.
    pub queue_packets: usize,
}

/// One end of a simulated bus. Packets of one end reach every other end.
pub struct SimulatedLink {
    bus: Arc<Bus>,
    end: usize,
}

struct Bus {
    params: BusParams,
    clock: Arc<dyn Clock>,
    state: Mutex<State>,
    arrived: Condvar,
}

struct State {
    ends: Vec<End>,
    /// When each wire is free again: one per end, all the same on a shared wire.
    wire_free: Vec<Tai>,
}

struct End {
    inbox: VecDeque<Stamped<Packet>>,
    counters: LinkCounters,
}

/// The two ends of a bus.
#[must_use]
pub fn simulated_pair(params: BusParams, clock: &Arc<dyn Clock>) -> (SimulatedLink, SimulatedLink) {
    let bus = Bus::new(params, clock, 2);
    (SimulatedLink { bus: Arc::clone(&bus), end: 0 }, SimulatedLink { bus, end: 1 })
}

/// A bus with `ends` ends.
#[must_use]
pub fn simulated_bus(params: BusParams, clock: &Arc<dyn Clock>, ends: usize) -> Vec<SimulatedLink> {
    let bus = Bus::new(params, clock, ends);
    (0..ends).map(|end| SimulatedLink { bus: Arc::clone(&bus), end }).collect()
}

impl Bus {
    fn new(params: BusParams, clock: &Arc<dyn Clock>, ends: usize) -> Arc<Self> {
        let inbox = || VecDeque::with_capacity(params.queue_packets);
        let state = State {
            ends: (0..ends).map(|_| End { inbox: inbox(), counters: LinkCounters::default() }).collect(),
            wire_free: vec![Tai::from_ns(i64::MIN); ends],
        };
        Arc::new(Self { params, clock: Arc::clone(clock), state: Mutex::new(state), arrived: Condvar::new() })
    }

    /// A thread that panicked while it held the lock left counters and queues whole.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State>, span: Span) -> MutexGuard<'a, State> {
        let limit = Duration::from_nanos(span.ns().unsigned_abs());
        self.arrived.wait_timeout(state, limit).unwrap_or_else(PoisonError::into_inner).0
    }
}

impl State {
    /// Occupies the sender's wire from `now` or when it is free; the end of the last bit.
    fn occupy(&mut self, end: usize, now: Tai, duration: Span, shared: bool) -> Tai {
        let done = self.wire_free[end].max(now) + duration;
        if shared {
            self.wire_free.fill(done);
        } else {
            self.wire_free[end] = done;
        }
        done
    }

    /// Puts a packet in the inbox of every other end, in the order of arrival.
    fn deliver(&mut self, from: usize, packet: Stamped<Packet>, queue_packets: usize) {
        self.ends[from].counters.sent += 1;
        for (end, receiver) in self.ends.iter_mut().enumerate() {
            if end != from {
                receiver.take(packet, queue_packets);
            }
        }
    }
}

impl End {
    fn take(&mut self, packet: Stamped<Packet>, queue_packets: usize) {
        if self.inbox.len() >= queue_packets {
            self.counters.overflows += 1;
            return;
        }
        let place = self.inbox.partition_point(|earlier| earlier.at <= packet.at);
        self.inbox.insert(place, packet);
    }

    fn due_by(&mut self, now: Tai) -> Option<Stamped<Packet>> {
        let is_due = self.inbox.front().is_some_and(|first| first.at <= now);
        let packet = if is_due { self.inbox.pop_front() } else { None };
        self.counters.received += u64::from(is_due);
        packet
    }
}

impl Link for SimulatedLink {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        let mut state = self.bus.lock();
        loop {
            let now = self.bus.clock.now();
            let inbox = &mut state.ends[self.end];
            if let Some(packet) = inbox.due_by(now) {
                return Ok(Some(packet));
            }
            if !self.bus.clock.is_real() || now >= until {
                return Ok(None);
            }
            let wake = inbox.inbox.front().map_or(until, |first| first.at.min(until));
            state = self.bus.wait(state, wake - now);
        }
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        let params = &self.bus.params;
        let Some(duration) = params.timing.duration(packet) else {
            let (link, wanted, got) = (params.name.clone(), params.timing.kind(), packet.kind());
            return Err(LinkError::WrongPacket { link, wanted, got });
        };
        let mut state = self.bus.lock();
        let done = state.occupy(self.end, self.bus.clock.now(), duration, params.timing.is_shared());
        let arrival = Stamped { at: done + params.latency, value: *packet };
        state.deliver(self.end, arrival, params.queue_packets);
        drop(state);
        self.bus.arrived.notify_all();
        Ok(done)
    }

    fn counters(&self) -> LinkCounters {
        self.bus.lock().ends[self.end].counters
    }
}
