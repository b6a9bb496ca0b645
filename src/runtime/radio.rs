//! The receiving thread of the bench clock: a port and a bounded queue each way.
//!
//! In: a port. Out: messages stamped where they arrived. When the queue is full, messages are lost and counted: the thread
//! waits for nobody.

use crate::base::clock::Clock;
use crate::base::time::Span;
use crate::link::{Port, Stamped};
use crate::runtime::error::RunError;
use crate::runtime::hygiene::{Hygiene, Role};
use crate::runtime::record::LinkReport;
use core::sync::atomic::{AtomicBool, Ordering};
use crossbeam_channel::{Receiver as Queue, Sender, bounded};
use firmware_protocol::Message;
use std::sync::Arc;
use std::thread::JoinHandle;

/// Messages between the receiving thread and the frame thread: 4 s of a full CAN FD attitude and jitter stream.
const RECEIVE_QUEUE: usize = 4096;
/// Messages to the flight computer.
const SEND_QUEUE: usize = 64;
/// The receiving thread looks for something to send this often.
const SEND_POLL: Span = Span::from_ms(2);

/// The receiving thread and its queues.
pub(super) struct Radio {
    /// What has arrived.
    pub(super) received: Queue<Stamped<Message>>,
    /// What is to go out.
    pub(super) to_send: Sender<Message>,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<LinkReport, RunError>>,
}

impl Radio {
    /// Starts the thread.
    ///
    /// # Errors
    /// When it cannot be started.
    pub(super) fn start(
        mut port: Port,
        clock: &Arc<dyn Clock>,
        hygiene: Option<&Arc<Hygiene>>,
    ) -> Result<Self, RunError> {
        let (arrived, received) = bounded(RECEIVE_QUEUE);
        let (to_send, outgoing) = bounded::<Message>(SEND_QUEUE);
        let stop = Arc::new(AtomicBool::new(false));
        let (stopped, clock) = (Arc::clone(&stop), Arc::clone(clock));
        let hygiene = hygiene.map(Arc::clone);
        let thread = std::thread::Builder::new()
            .name("link".into())
            .spawn(move || {
                if let Some(hygiene) = hygiene {
                    hygiene.enter(Role::Link);
                }
                let mut overflows = 0;
                while !stopped.load(Ordering::Relaxed) {
                    for message in outgoing.try_iter() {
                        port.send(&message)?;
                    }
                    if let Some(message) = port.receive(clock.now() + SEND_POLL)? {
                        overflows += u64::from(arrived.try_send(message).is_err());
                    }
                }
                Ok(LinkReport::of(&port, overflows))
            })
            .map_err(|source| RunError::Thread { name: "link", source })?;
        Ok(Self { received, to_send, stop, thread })
    }

    /// True when the thread has ended early.
    pub(super) fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }

    /// Counters of the port, or why the thread ended early.
    pub(super) fn finish(self) -> (Option<LinkReport>, Option<RunError>) {
        self.stop.store(true, Ordering::Relaxed);
        match self.thread.join() {
            Ok(Ok(report)) => (Some(report), None),
            Ok(Err(error)) => (None, Some(error)),
            Err(_panicked) => (None, Some(RunError::ThreadLost { name: "link" })),
        }
    }
}
