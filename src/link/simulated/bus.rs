//! The bus, its ends, and the waiting of their threads.

use super::{BusModel, BusParams, BusStatistics, error_counters::ErrorCounters, medium::Medium};
use crate::{Departure, Link, LinkCounters, LinkError, Packet, Stamped};
use base::clock::Clock;
use base::time::{Span, Tai};
use core::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A bus in memory. Clones are the same bus.
#[derive(Clone)]
pub struct SimulatedBus {
    pub(super) bus: Arc<Bus>,
}

/// One end of a simulated bus. Packets of one end reach every other end. Dropped, it leaves the bus: packets that it
/// has queued still goes out, and it receives nothing.
pub struct SimulatedLink {
    bus: Arc<Bus>,
    end: usize,
}

pub(super) struct Bus {
    params: BusParams,
    clock: Arc<dyn Clock>,
    medium: Mutex<Medium>,
    changed: Condvar,
}

/// Makes a bus and returns its two ends.
pub fn simulated_pair(params: BusParams, clock: &Arc<dyn Clock>) -> (SimulatedLink, SimulatedLink) {
    let bus = SimulatedBus::new(params, clock);
    (bus.attach(), bus.attach())
}

/// Returns a bus with `ends` ends.
pub fn simulated_bus(params: BusParams, clock: &Arc<dyn Clock>, ends: usize) -> Vec<SimulatedLink> {
    let bus = SimulatedBus::new(params, clock);
    (0..ends).map(|_| bus.attach()).collect()
}

impl SimulatedBus {
    /// Returns a bus without ends. The capacity to receive is the capacity to send as well.
    pub fn new(params: BusParams, clock: &Arc<dyn Clock>) -> Self {
        let usual = BusModel::default();
        let transmit_packets = usual.transmit_packets.max(params.queue_packets);
        Self::with_model(params, BusModel { transmit_packets, ..usual }, clock)
    }

    /// Returns the same, modelled otherwise than by default.
    pub fn with_model(params: BusParams, model: BusModel, clock: &Arc<dyn Clock>) -> Self {
        let medium = Mutex::new(Medium::new(params.clone(), model, clock.now()));
        Self { bus: Arc::new(Bus { params, clock: Arc::clone(clock), medium, changed: Condvar::new() }) }
    }

    /// Returns one more end, at any time. The number of an end that has left is given again.
    pub fn attach(&self) -> SimulatedLink {
        let end = self.bus.settled().attach();
        SimulatedLink { bus: Arc::clone(&self.bus), end }
    }

    /// Returns the parameters of the bus.
    pub fn params(&self) -> &BusParams {
        &self.bus.params
    }

    /// Returns the statistics of the bus so far.
    pub fn statistics(&self) -> BusStatistics {
        let now = self.bus.clock.now();
        let mut medium = self.bus.lock();
        medium.settle(now);
        medium.statistics(now)
    }
}

impl Bus {
    /// Locks the medium. A thread that panicked while it held the lock left counters and queues valid.
    fn lock(&self) -> MutexGuard<'_, Medium> {
        self.medium.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the wire as it is now.
    pub(super) fn settled(&self) -> MutexGuard<'_, Medium> {
        let mut medium = self.lock();
        medium.settle(self.clock.now());
        medium
    }

    pub(super) fn notify(&self) {
        self.changed.notify_all();
    }

    fn wait<'a>(&self, medium: MutexGuard<'a, Medium>, span: Span) -> MutexGuard<'a, Medium> {
        let limit = Duration::from_nanos(span.ns().unsigned_abs());
        self.changed.wait_timeout(medium, limit).unwrap_or_else(PoisonError::into_inner).0
    }
}

impl SimulatedLink {
    /// Returns the number of this end on its bus, from 0 in the order of attaching.
    pub fn end(&self) -> usize {
        self.end
    }

    /// Returns the error counters of its controller.
    pub fn error_counters(&self) -> ErrorCounters {
        self.bus.settled().ends[self.end].errors
    }

    /// Returns the number of packets that [`Link::send`] would still queue.
    pub fn space(&self) -> usize {
        let medium = self.bus.settled();
        medium.model.transmit_packets.saturating_sub(medium.ends[self.end].outbox.len())
    }

    /// Receives as [`Link::receive`], for an end that several threads share.
    pub fn take(&self, until: Tai) -> Option<Stamped<Packet>> {
        self.take_unless(until, &AtomicBool::new(false))
    }

    /// Receives as [`Self::take`]; stops waiting once `is_over` is set and [`Self::wake`] was called after that.
    pub fn take_unless(&self, until: Tai, is_over: &AtomicBool) -> Option<Stamped<Packet>> {
        let mut medium = self.bus.lock();
        loop {
            let now = self.bus.clock.now();
            medium.settle(now);
            let end = &mut medium.ends[self.end];
            if let Some(packet) = end.due_by(now) {
                return Some(packet);
            }
            if !self.bus.clock.is_real() || now >= until || is_over.load(Ordering::Acquire) {
                return None;
            }
            let here = end.inbox.front().map(|first| first.at);
            let wake = here.into_iter().chain(medium.next_arrival()).fold(until, Tai::min);
            // At an instant, nothing has begun that begins at it: at least a nanosecond of waiting.
            medium = self.bus.wait(medium, (wake - now).max(Span::from_ns(1)));
        }
    }

    /// Lets every thread that waits in [`Self::take_unless`] look again.
    pub fn wake(&self) {
        // A thread that has the lock has either not looked yet, or waits.
        drop(self.bus.lock());
        self.bus.notify();
    }

    /// Sends as [`Link::send`], for an end that several threads share.
    ///
    /// # Errors
    /// When the bus does not carry such packets.
    pub fn put(&self, packet: &Packet) -> Result<Tai, LinkError> {
        let now = self.bus.clock.now();
        let mut medium = self.bus.lock();
        medium.settle(now);
        let Some(duration) = medium.duration(packet) else {
            let params = &self.bus.params;
            let (link, wanted, got) = (params.name.clone(), params.timing.kind(), packet.kind());
            return Err(LinkError::WrongPacket { link, wanted, got });
        };
        let done = medium.queue(self.end, packet, duration, now);
        drop(medium);
        self.bus.notify();
        Ok(done)
    }
}

impl Drop for SimulatedLink {
    fn drop(&mut self) {
        self.bus.settled().ends[self.end].has_left = true;
    }
}

impl Link for SimulatedLink {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        Ok(self.take(until))
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        self.put(packet)
    }

    fn counters(&self) -> LinkCounters {
        self.bus.settled().ends[self.end].counters
    }

    fn departure(&mut self, sent: u64) -> Departure {
        self.bus.settled().ends[self.end].departure(sent)
    }
}
