//! The thread that listens to the trigger lines of one GPIO chip.
//!
//! In: the lines, and the heads that they trigger. Out: edges with their instants in the queue of the receiving
//! threads, so that an edge wakes the frame thread as a message does. When the queue is full an edge is lost and
//! counted; so are those that the kernel dropped. Tests: `hil_scripts/test_triggers.py`.

use crate::runtime::hygiene::{Hygiene, Role};
use crate::runtime::{error::RunError, received::Received};
use base::{clock::Clock, time::Span};
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use crossbeam_channel::Sender;
use link::gpio::GpioChip;
use std::{sync::Arc, thread::JoinHandle};

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

/// A thread that listens to one chip; it ends when this is dropped.
pub(super) struct EdgeThread {
    stop: Arc<AtomicBool>,
    lost: Arc<AtomicU64>,
    restarts: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl EdgeThread {
    pub(super) fn start(
        chip: TriggerChip,
        arrived: Sender<Received>,
        clock: &Arc<dyn Clock>,
        hygiene: Option<Arc<Hygiene>>,
    ) -> Result<Self, RunError> {
        let stop = Arc::new(AtomicBool::new(false));
        let [lost, restarts] = [0, 0].map(|none| Arc::new(AtomicU64::new(none)));
        let (stopped, clock) = (Arc::clone(&stop), Arc::clone(clock));
        let counted = [Arc::clone(&lost), Arc::clone(&restarts)];
        let listen = move || {
            if let Some(hygiene) = hygiene {
                hygiene.enter(Role::Link);
            }
            listen(chip, &arrived, &*clock, &stopped, &counted);
        };
        let thread = std::thread::Builder::new().name("gpio".into()).spawn(listen);
        let thread = Some(thread.map_err(|source| RunError::Thread { name: "gpio", source })?);
        Ok(Self { stop, lost, restarts, thread })
    }

    /// Returns the number of edges lost so far.
    pub(super) fn lost_edges(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    /// Returns how often the numbers of a line went back so far.
    pub(super) fn restarts(&self) -> u64 {
        self.restarts.load(Ordering::Relaxed)
    }

    /// Returns true when the thread has ended by itself because its chip is gone.
    pub(super) fn is_lost(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for EdgeThread {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _no_one_asks = thread.join();
        }
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
