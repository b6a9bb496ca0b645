//! The receiving threads of the bench clock: one per port with a bounded queue each way, one for pulses, one per GPIO
//! chip.
//!
//! In: ports. Out: messages stamped where they arrived, with the port they came by. When a queue is full, messages are
//! lost and counted: the threads never block on a full queue. Counters of a port are published after each packet.
//!
//! Messages of the receiving threads to the frame thread.
//!
//! The thread that listens to the trigger lines of one GPIO chip.
//!
//! In: the lines, and the heads that they trigger. Out: edges with their instants in the queue of the receiving
//! threads, so that an edge wakes the frame thread as a message does. When the queue is full an edge is lost and
//! counted; so are those that the kernel dropped. Tests: `hil_scripts/tests/test_triggers.py`.

use crate::runtime::error::{Result, RunError};
use crate::runtime::hygiene::{Hygiene, Role};
use crate::runtime::plant_queue::PlantSample;
use crate::runtime::port_reading::{PortReading, SharedReading};
use base::clock::{Clock, PairedReading};
use base::time::{Span, Tai};
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use crossbeam_channel::{Receiver as Queue, RecvTimeoutError, Sender, bounded, select};
use firmware_protocol::Message;
use link::{Input, Polled, Port, Stamped};
use link::{gpio::GpioChip, pps::Pps};
use std::{sync::Arc, thread::JoinHandle, time::Duration};

/// Messages between the receiving threads and the frame thread: 0.3 s of a full 1 Mbit/s bus and a full 3 Mbaud line.
const RECEIVE_QUEUE: usize = 4096;
/// Capacity of the queue of messages to the flight computer.
const SEND_QUEUE: usize = 64;
/// Interval at which a receiving thread looks for messages to send.
const SEND_POLL: Span = Span::from_ms(2);

/// Interval at which the pulse thread looks for pulses, which come once a second.
const PULSE_POLL: Span = Span::from_ms(100);

/// Threads that receive, and their queues.
pub(super) struct LinkThreads {
    received: Queue<Received>,
    /// Samples of an external plant; `None` when no socket delivers any.
    samples: Option<Queue<Stamped<PlantSample>>>,
    stations: Vec<Station>,
    pulses: Option<InputThread<()>>,
    chips: Vec<EdgeThread>,
}

/// A thread that brings input; it ends when this is dropped, so that a run that could not start leaves none behind.
struct InputThread<T> {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<T>>,
}

impl<T: Send + 'static> InputThread<T> {
    /// Starts a thread that runs `listen` until its argument is true.
    fn start(
        name: &'static str,
        hygiene: Option<Arc<Hygiene>>,
        listen: impl FnOnce(&AtomicBool) -> T + Send + 'static,
    ) -> Result<Self> {
        let stop = Arc::<AtomicBool>::default();
        let stopped = Arc::clone(&stop);
        let run = move || {
            if let Some(hygiene) = hygiene {
                hygiene.enter(Role::Link);
            }
            listen(&stopped)
        };
        let thread = std::thread::Builder::new().name(name.into()).spawn(run);
        Ok(Self { stop, thread: Some(thread.map_err(|source| RunError::Thread { name, source })?) })
    }
}

impl<T> InputThread<T> {
    /// Returns true when the thread has ended by itself: otherwise it runs until this is dropped.
    fn is_lost(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Ends the thread and returns its result; `None` when it was ended before.
    fn finish(&mut self) -> Option<std::thread::Result<T>> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().map(JoinHandle::join)
    }
}

impl<T> Drop for InputThread<T> {
    fn drop(&mut self) {
        let _no_one_asks = self.finish();
    }
}

/// One port's thread.
struct Station {
    thread: InputThread<Result<PortReading>>,
    to_send: Sender<Message>,
    send_overflows: AtomicU64,
    shared: Arc<SharedReading>,
}

impl LinkThreads {
    /// Starts one thread per port, one per chip with trigger lines, and one for pulses where there is a source.
    ///
    /// # Errors
    /// When one cannot be started; those started before it are ended.
    pub(super) fn start(
        ports: Vec<Port>,
        pulses: Option<Pps>,
        samples: Option<Queue<Stamped<PlantSample>>>,
        chips: Vec<TriggerChip>,
        clock: &Arc<dyn Clock>,
        hygiene: Option<&Arc<Hygiene>>,
    ) -> Result<Self> {
        let (arrived, received) = bounded(RECEIVE_QUEUE);
        let pulses = pulses.map(|pulses| look_for_pulses(pulses, arrived.clone(), clock)).transpose()?;
        let edges = |chip| EdgeThread::start(chip, arrived.clone(), clock, hygiene.map(Arc::clone));
        let chips = chips.into_iter().map(edges).collect::<Result<_, _>>()?;
        let mut link_thread = Self { received, samples, stations: Vec::with_capacity(ports.len()), pulses, chips };
        for (number, port) in ports.into_iter().enumerate() {
            let own = Own { number, port, arrived: arrived.clone(), clock: Arc::clone(clock) };
            link_thread.stations.push(Station::start(own, hygiene.map(Arc::clone))?);
        }
        Ok(link_thread)
    }

    /// Returns the items that have arrived, without waiting; of those that come meanwhile no more than the queue holds.
    pub(super) fn arrived(&self) -> impl Iterator<Item = Received> {
        let samples = self.samples.iter().flat_map(Queue::try_iter);
        self.received.try_iter().take(RECEIVE_QUEUE).chain(samples.map(Received::Sample))
    }

    /// Waits for an item, at most this long.
    pub(super) fn wait(&self, at_most: Duration) -> Option<Received> {
        if let Some(samples) = &self.samples {
            return select! {
                recv(self.received) -> got => got.ok(),
                recv(samples) -> sample => sample.ok().map(Received::Sample),
                default(at_most) => None,
            };
        }
        match self.received.recv_timeout(at_most) {
            Ok(got) => Some(got),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => {
                std::thread::sleep(at_most);
                None
            }
        }
    }

    /// Queues a message for a port; never waits, even when the queue is full.
    pub(super) fn send(&self, port: usize, message: Message) {
        if let Some(station) = self.stations.get(port)
            && station.to_send.try_send(message).is_err()
        {
            station.send_overflows.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Returns the counters of each port.
    pub(super) fn readings(&self) -> impl Iterator<Item = PortReading> + '_ {
        self.stations.iter().map(Station::reading)
    }

    /// Returns whether a thread has ended early.
    pub(super) fn is_finished(&self) -> bool {
        self.stations.iter().any(|station| station.thread.is_lost())
    }

    /// Returns true when the thread that looks for pulses has ended early.
    pub(super) fn has_lost_pulses(&self) -> bool {
        self.pulses.as_ref().is_some_and(InputThread::is_lost)
    }

    /// Returns true when a thread that listens to trigger lines has ended early.
    pub(super) fn has_lost_chips(&self) -> bool {
        self.chips.iter().any(|chip| chip.thread.is_lost())
    }

    /// Returns edges of trigger lines that were lost so far.
    pub(super) fn lost_edges(&self) -> u64 {
        self.chips.iter().map(|chip| chip.lost.load(Ordering::Relaxed)).sum()
    }

    /// Returns how often the numbers of trigger lines went back so far.
    pub(super) fn line_restarts(&self) -> u64 {
        self.chips.iter().map(|chip| chip.restarts.load(Ordering::Relaxed)).sum()
    }

    /// Ends the threads; returns the counters of the ports, and why a thread ended early.
    pub(super) fn finish(mut self) -> (Vec<PortReading>, Option<RunError>) {
        let mut failure = None;
        let mut readings = Vec::new();
        for station in &mut self.stations {
            match station.finish() {
                Ok(reading) => {
                    let send_overflows = station.reading().send_overflows;
                    readings.push(PortReading { send_overflows, ..reading });
                }
                Err(error) => {
                    readings.push(station.reading());
                    failure = failure.or(Some(error));
                }
            }
        }
        (readings, failure)
    }
}

impl Station {
    fn start(own: Own, hygiene: Option<Arc<Hygiene>>) -> Result<Self> {
        let (to_send, outgoing) = bounded::<Message>(SEND_QUEUE);
        let shared = Arc::<SharedReading>::default();
        let published = Arc::clone(&shared);
        let thread = InputThread::start("link", hygiene, move |stop| own.listen(&outgoing, stop, &published))?;
        Ok(Self { thread, to_send, send_overflows: AtomicU64::new(0), shared })
    }

    fn reading(&self) -> PortReading {
        PortReading { send_overflows: self.send_overflows.load(Ordering::Relaxed), ..self.shared.read() }
    }

    fn finish(&mut self) -> Result<PortReading> {
        let lost = || RunError::ThreadLost { name: "link" };
        self.thread.finish().ok_or_else(lost)?.map_err(|_panicked| lost())?
    }
}

/// Data owned by the thread of a port.
struct Own {
    number: usize,
    port: Port,
    arrived: Sender<Received>,
    clock: Arc<dyn Clock>,
}

impl Own {
    fn listen(mut self, outgoing: &Queue<Message>, stop: &AtomicBool, shared: &SharedReading) -> Result<PortReading> {
        let mut overflows = 0;
        while !stop.load(Ordering::Relaxed) {
            for message in outgoing.try_iter() {
                self.port.send(&message)?;
            }
            let polled = self.port.poll(self.clock.now() + SEND_POLL)?;
            if let Polled::Input(message) = polled {
                overflows +=
                    u64::from(self.arrived.try_send(Received::Message { port: self.number, message }).is_err());
            }
            shared.publish(&PortReading::of(&self.port, overflows));
        }
        // Send the messages that are still queued.
        for message in outgoing.try_iter() {
            self.port.send(&message)?;
        }
        Ok(PortReading::of(&self.port, overflows))
    }
}

/// Starts the thread that looks for pulses.
fn look_for_pulses(mut pulses: Pps, arrived: Sender<Received>, clock: &Arc<dyn Clock>) -> Result<InputThread<()>> {
    let clock = Arc::clone(clock);
    InputThread::start("pps", None, move |stop| {
        while !stop.load(Ordering::Relaxed) {
            clock.sleep_until(clock.now() + PULSE_POLL);
            if let Some(at) = pulses.poll(PairedReading::take(&*clock)) {
                let _a_pulse_lost_is_followed_by_another = arrived.try_send(Received::Pulse(at));
            }
        }
    })
}

/// Items that the receiving threads deliver.
#[derive(Debug, Clone, Copy)]
pub(super) enum Received {
    /// A message.
    Message {
        /// Number of the port by which it came, from 0.
        port: usize,
        /// The message.
        message: Stamped<Input>,
    },
    /// A pulse of the flight computer's clock at one of its whole seconds.
    Pulse(Tai),
    /// A sample that an external program sent over the control socket, and its arrival time.
    Sample(Stamped<PlantSample>),
    /// An edge of a trigger line.
    Edge {
        /// Number of the addressed head; `None`: all of them.
        head: Option<usize>,
        /// Time of the edge.
        at: Tai,
        /// True when the line became active.
        is_active: bool,
    },
}

/// The thread notices the end of the run within this time.
const STOP_POLL: Span = Span::from_ms(50);

/// One GPIO chip with lines that trigger heads.
#[derive(Debug)]
pub struct TriggerChip {
    /// The open chip.
    pub chip: GpioChip,
    /// Number of the head that each of its lines triggers; `None`: all of them.
    pub heads: Vec<Option<usize>>,
}

/// The thread that listens to one chip, with the edges that were lost and how often the numbers of a line went back.
struct EdgeThread {
    thread: InputThread<()>,
    lost: Arc<AtomicU64>,
    restarts: Arc<AtomicU64>,
}

impl EdgeThread {
    fn start(
        chip: TriggerChip,
        arrived: Sender<Received>,
        clock: &Arc<dyn Clock>,
        hygiene: Option<Arc<Hygiene>>,
    ) -> Result<Self> {
        let [lost, restarts] = [0, 0].map(|none| Arc::new(AtomicU64::new(none)));
        let (clock, counted) = (Arc::clone(clock), [Arc::clone(&lost), Arc::clone(&restarts)]);
        let listen = move |stop: &AtomicBool| listen(chip, &arrived, &*clock, stop, &counted);
        Ok(Self { thread: InputThread::start("gpio", hygiene, listen)?, lost, restarts })
    }
}

/// Listens until the run is over or the chip is gone; in the latter case the end of the thread is reported.
fn listen(
    TriggerChip { mut chip, heads }: TriggerChip,
    arrived: &Sender<Received>,
    clock: &dyn Clock,
    stop: &AtomicBool,
    [lost, restarts]: &[Arc<AtomicU64>; 2],
) {
    let mut overflows = 0;
    while !stop.load(Ordering::Relaxed) {
        let Ok(edge) = chip.wait(STOP_POLL, clock) else { return };
        if let Some(edge) = edge {
            let head = heads.get(edge.line).copied().flatten();
            let got = Received::Edge { head, at: edge.at, is_active: edge.is_active };
            overflows += u64::from(arrived.try_send(got).is_err());
            lost.store(chip.counters().lost + overflows, Ordering::Relaxed);
            restarts.store(chip.counters().restarts, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link_thread_with(look: impl FnOnce() + Send + 'static) -> LinkThreads {
        let (_arrived, received) = bounded(1);
        let thread = std::thread::Builder::new().name("pps".into()).spawn(look).unwrap();
        let pulses = InputThread { stop: Arc::default(), thread: Some(thread) };
        LinkThreads { received, samples: None, stations: Vec::new(), pulses: Some(pulses), chips: Vec::new() }
    }

    #[test]
    fn pulse_thread_that_panics_is_reported_as_lost() {
        let (gate, opened) = bounded::<()>(0);
        let waiting = link_thread_with(move || {
            let _ = opened.recv();
        });
        assert!(!waiting.has_lost_pulses(), "control: at work");
        drop(gate);
        let broken = link_thread_with(|| panic!("as the test wants it"));
        while !broken.pulses.as_ref().unwrap().thread.as_ref().unwrap().is_finished() {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(broken.has_lost_pulses());
    }
}
