//! One sink on a thread of its own, behind a fixed number of buffers that go round.
//!
//! Input: frames, copied into a free buffer. Output: what the sink makes of them, and counts. A buffer is made once, at
//! the start; copying into it allocates nothing unless a frame is larger than any before. A sink that fails on a frame is
//! given the next one: a disk that is full now may have room later. A sink that panics is not called again.
//! Tests: `fan_tests.rs`.

use crate::base::clock::Stopwatch;
use crate::base::time::Span;
use crate::sink::line::{Losses, SinkLine};
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary};
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use crossbeam_channel::{Receiver, Sender, bounded};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;

/// A sink that is to get a thread.
pub struct BranchParams {
    /// Where the bench names it, for the summary.
    pub place: String,
    /// The sink.
    pub sink: Box<dyn Sink>,
    /// Frames that it may be behind, the one it is busy with included; at least 1.
    pub buffers: usize,
}

/// A frame on its way through a branch.
struct Held {
    frame: SentFrame,
    since: Stopwatch,
    failure: Option<SinkError>,
}

/// What a branch tells while it goes on.
#[derive(Default)]
struct Live {
    refused: AtomicU64,
    is_lost: AtomicBool,
}

/// The sender's end of a branch.
pub(super) struct Branch {
    name: &'static str,
    line: SinkLine,
    full: Option<Sender<Held>>,
    empty: Receiver<Held>,
    /// A buffer that has been waited for.
    spare: Option<Held>,
    live: Arc<Live>,
    thread: Option<JoinHandle<Ended>>,
    /// Frames that were offered.
    offered: u64,
    dropped: u64,
}

/// What a branch's thread comes back with.
struct Ended {
    line: SinkLine,
    finished: Option<Result<SinkSummary, SinkError>>,
}

impl Branch {
    /// Starts the thread. Buffers are copies of `prototype`, with all their memory touched.
    pub(super) fn start(params: BranchParams, prototype: &SentFrame) -> Result<Self, SinkError> {
        let BranchParams { place, sink, buffers } = params;
        let buffers = buffers.max(1);
        let (full, to_send) = bounded(buffers);
        let (sent, empty) = bounded(buffers);
        for _ in 0..buffers {
            let held = Held { frame: prototype.touched_copy(), since: Stopwatch::start(), failure: None };
            let _there_is_room_for_all = sent.try_send(held);
        }
        let (name, live) = (sink.name(), Arc::<Live>::default());
        let line = SinkLine { place, kind: name, ..SinkLine::default() };
        let carrier = Carrier { sink, line: line.clone(), live: Arc::clone(&live), delays: Span::ZERO };
        let thread = std::thread::Builder::new()
            .name(name.into())
            .spawn(move || carrier.carry(&to_send, &sent))
            .map_err(|source| SinkError::Thread { sink: name, source })?;
        Ok(Self {
            name,
            line,
            full: Some(full),
            empty,
            spare: None,
            live,
            thread: Some(thread),
            offered: 0,
            dropped: 0,
        })
    }

    /// Hands a copy of a frame over when a buffer is free now; else the branch goes without it, which is counted.
    pub(super) fn offer(&mut self, frame: &SentFrame) {
        self.offered += 1;
        let taken = self.empty.try_recv().is_ok_and(|held| self.put(held, frame));
        self.dropped += u64::from(!taken);
    }

    /// Hands a copy of a frame over as soon as there is a buffer.
    pub(super) fn hand(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.offered += 1;
        let spare = self.spare.take().or_else(|| self.empty.recv().ok());
        let taken = spare.is_some_and(|held| self.put(held, frame));
        self.dropped += u64::from(!taken);
        if taken { Ok(()) } else { Err(SinkError::Lost { sink: self.name }) }
    }

    /// Waits for the oldest frame that was handed over: what became of it.
    pub(super) fn settle(&mut self) -> Result<(), SinkError> {
        let mut held = self.empty.recv().map_err(|_| SinkError::Lost { sink: self.name })?;
        let failure = held.failure.take();
        self.spare = Some(held);
        failure.map_or(Ok(()), Err)
    }

    fn put(&self, mut held: Held, frame: &SentFrame) -> bool {
        held.frame.copy_from(frame);
        held.since = Stopwatch::start();
        held.failure = None;
        // There are as many places as buffers: this waits for nothing, and fails when the thread has ended.
        self.full.as_ref().is_some_and(|full| full.send(held).is_ok())
    }

    /// Buffers that are not free.
    #[cfg(test)]
    pub(super) fn lag(&self) -> usize {
        self.empty.capacity().unwrap_or_default() - self.empty.len()
    }

    /// Frames lost so far.
    pub(super) fn losses(&self) -> Losses {
        let lost_sinks = u64::from(self.live.is_lost.load(Ordering::Relaxed));
        Losses { dropped: self.dropped, refused: self.live.refused.load(Ordering::Relaxed), lost_sinks }
    }

    /// Lets the sink finish what it has been handed, and ends the thread. Once.
    pub(super) fn finish(&mut self) -> Result<Option<SinkSummary>, SinkError> {
        drop((self.full.take(), self.spare.take()));
        let Some(thread) = self.thread.take() else { return Ok(None) };
        let Ok(ended) = thread.join() else {
            self.line.is_lost = true;
            self.line.dropped = self.offered;
            return Err(SinkError::Lost { sink: self.name });
        };
        self.line = ended.line;
        self.line.dropped = self.offered - self.line.frames - self.line.refused;
        // What was in the queue of a sink that broke down is known only now.
        self.dropped = self.line.dropped;
        ended.finished.transpose()
    }

    /// What the sink did; whole after [`Self::finish`].
    pub(super) fn line(&self) -> &SinkLine {
        &self.line
    }
}

/// The thread's own state.
struct Carrier {
    sink: Box<dyn Sink>,
    line: SinkLine,
    live: Arc<Live>,
    delays: Span,
}

impl Carrier {
    fn carry(mut self, to_send: &Receiver<Held>, sent: &Sender<Held>) -> Ended {
        for mut held in to_send {
            match catch_unwind(AssertUnwindSafe(|| self.sink.send(&held.frame))) {
                Ok(outcome) => self.count(outcome, &mut held),
                Err(panic) => {
                    self.line.is_lost = true;
                    self.line.first_error.get_or_insert_with(|| words_of(&*panic));
                    self.live.is_lost.store(true, Ordering::Relaxed);
                    return Ended { line: self.line, finished: None };
                }
            }
            let _whoever_waited_has_ended = sent.send(held);
        }
        self.finish()
    }

    fn count(&mut self, outcome: Result<(), SinkError>, held: &mut Held) {
        let delay = held.since.lap();
        match outcome {
            Ok(()) => {
                self.line.frames += 1;
                self.delays = self.delays + delay;
                self.line.longest_delay = self.line.longest_delay.max(delay);
            }
            Err(error) => {
                self.line.refused += 1;
                self.live.refused.fetch_add(1, Ordering::Relaxed);
                self.line.first_error.get_or_insert_with(|| error.to_string());
                held.failure = Some(error);
            }
        }
    }

    fn finish(mut self) -> Ended {
        let (frames, refused) = (self.line.frames, self.line.refused);
        if let Ok(taken) = i64::try_from(frames.max(1)) {
            self.line.mean_delay = Span::from_ns(self.delays.ns() / taken);
        }
        let finished = catch_unwind(AssertUnwindSafe(|| {
            let finished = self.sink.finish();
            (finished, self.sink.counts())
        }));
        let finished = match finished {
            Ok((finished, counts)) => {
                self.line.counts = counts;
                finished
            }
            Err(_panic) => Err(SinkError::Lost { sink: self.line.kind }),
        };
        match &finished {
            Ok(summary) => self.line.take_summary(summary),
            Err(error) => {
                self.line.first_error.get_or_insert_with(|| error.to_string());
            }
        }
        // What was counted here adds up with what was offered, whatever a sink says of itself.
        (self.line.frames, self.line.refused) = (frames, refused);
        Ended { line: self.line, finished: Some(finished) }
    }
}

/// What a panic said.
fn words_of(panic: &(dyn core::any::Any + Send)) -> String {
    let said = panic.downcast_ref::<&str>().map(ToString::to_string);
    let said = said.or_else(|| panic.downcast_ref::<String>().cloned());
    format!("broke down: {}", said.unwrap_or_else(|| "no reason given".into()))
}
