//! One sink on a thread of its own, behind a fixed number of buffers that go round.
//!
//! Input: frames, copied into a free buffer. Output: the sink's own output, and counts. A buffer is made once, at
//! the start; copying into it allocates nothing unless a frame is larger than any before. A buffer comes back with the
//! outcome of its frame, so every loss is reported with the number of its own frame. A sink that fails on a frame is
//! given the next one: a disk that is full now may have space later. A sink that panics is not called again.
//!
//! Dropping a branch, also without [`Branch::finish`], lets its sink finish the frames it was given, and waits for that
//! as long as frames come back: a sink that blocks is given up after [`patience::END_PATIENCE`], and its thread is left
//! behind. Where every frame is waited for, a sink that blocks is given up after [`patience::STALL_PATIENCE`] in the
//! middle of a run. Tests: `fan_tests.rs`.

use crate::report::SinkLine;
use crate::sink::line::{Loss, LossKind};
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary};
use base::patience::{self, LOOK, Patience, QUEUE_LOOK};
use base::{clock::Stopwatch, refused::Refused, time::Span};
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::thread::JoinHandle;

/// Losses that are kept until they are read; further ones are only counted in the line.
const LOSSES_KEPT: usize = 4096;

/// Rate of a slow disk or encoder, by which large frames add to the patience.
const SLOW_BYTES_PER_S: f64 = 10e6;

/// A sink that is to get a thread.
pub struct BranchParams {
    /// Place in the bench that names it, for the summary.
    pub place: String,
    /// The sink.
    pub sink: Box<dyn Sink>,
    /// Frames that it may be behind, the one it is busy with included; at least 1.
    pub buffers: usize,
}

/// A frame on its way through a branch, and back.
struct Held {
    frame: SentFrame,
    since: Stopwatch,
    failure: Option<SinkError>,
    /// The sink broke down on this frame.
    broke_down: bool,
}

/// The sender's end of a branch.
pub(super) struct Branch {
    name: &'static str,
    line: SinkLine,
    full: Option<Sender<Held>>,
    back: Receiver<Held>,
    /// Losses that the sink itself reports, also of frames that it took before.
    reported: Receiver<Loss>,
    free: Vec<Held>,
    thread: Option<JoinHandle<Ended>>,
    /// Frames that were offered.
    offered: u64,
    /// Numbers of these that were taken and refused, as far as their buffers have come back.
    returned: [u64; 2],
    /// Number of the newest frame.
    newest: u32,
    /// Time that a frame takes on a slow disk, by which it may finish nothing for longer.
    slow_frame: Span,
    is_given_up: bool,
    /// Losses that are not yet reported.
    losses: Vec<Loss>,
}

/// Result of a branch's thread.
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
        let (sent, back) = bounded(buffers);
        let (report, reported) = bounded(LOSSES_KEPT);
        let held = || {
            let frame = prototype.touched_copy();
            Held { frame, since: Stopwatch::start(), failure: None, broke_down: false }
        };
        let free = core::iter::repeat_with(held).take(buffers).collect();
        let name = sink.name();
        let line = SinkLine { place, kind: name, ..SinkLine::default() };
        let carrier = Carrier { sink: Some(sink), line: line.clone(), delays: Span::ZERO, report };
        let thread = std::thread::Builder::new()
            .name(name.into())
            .spawn(move || carrier.carry(&to_send, &sent))
            .map_err(|error| {
                let advice = "try fewer sinks, or a higher limit of threads";
                Refused(format!("the thread of the {name} sink cannot be started: {error}; {advice}"))
            })?;
        let (full, thread) = (Some(full), Some(thread));
        let bytes = 2.0 * (prototype.image.width() * prototype.image.height()) as f64;
        let slow_frame = Span::from_s(bytes / SLOW_BYTES_PER_S);
        let (offered, returned, newest, losses) = (0, [0; 2], 0, Vec::new());
        let is_given_up = false;
        Ok(Self {
            name,
            line,
            full,
            back,
            reported,
            free,
            thread,
            offered,
            returned,
            newest,
            slow_frame,
            is_given_up,
            losses,
        })
    }

    /// Hands a copy of a frame over when a buffer is free now; else the branch goes without it, which is counted.
    pub(super) fn offer(&mut self, frame: &SentFrame) {
        self.collect();
        let free = self.free.pop();
        let _ = self.put(free, frame); // `put` reports a loss itself
    }

    /// Hands a copy of a frame over as soon as there is a buffer.
    pub(super) fn hand(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let free = self.free.pop().or_else(|| self.back.recv().ok());
        if self.put(free, frame) { Ok(()) } else { Err(SinkError::Lost { sink: self.name }) }
    }

    /// Waits for the outcome of the oldest frame that was handed over. A sink that blocks is given up.
    pub(super) fn settle(&mut self) -> Result<(), SinkError> {
        let limit = patience::stall() + self.slow_frame;
        let mut patience = Patience::new(limit);
        loop {
            match self.back.recv_timeout(QUEUE_LOOK) {
                Ok(held) => return self.take_back(held),
                Err(RecvTimeoutError::Disconnected) => return Err(SinkError::Lost { sink: self.name }),
                Err(RecvTimeoutError::Timeout) if patience.is_over() => return Err(self.give_up(limit)),
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Returns true when the sink was given up: frames go past it.
    pub(super) fn is_given_up(&self) -> bool {
        self.is_given_up
    }

    /// Counts a frame for a sink that was given up.
    pub(super) fn pass(&mut self, frame: &SentFrame) {
        self.put(None, frame);
        self.line.dropped += 1;
    }

    /// Puts a frame into the queue: there are as many places as buffers, so this waits for nothing. False when there is
    /// no buffer, or no thread any more.
    fn put(&mut self, free: Option<Held>, frame: &SentFrame) -> bool {
        self.offered += 1;
        self.newest = frame.meta.number;
        let is_put = free.zip(self.full.as_ref()).is_some_and(|(mut held, full)| {
            held.frame.copy_from(frame);
            held.since = Stopwatch::start();
            full.send(held).is_ok()
        });
        if !is_put {
            self.lose(LossKind::Dropped, frame.meta.number);
        }
        is_put
    }

    /// Takes back the buffers that have come, and the losses that the sink reports.
    fn collect(&mut self) {
        while let Ok(held) = self.back.try_recv() {
            let _ = self.take_back(held); // a failure is kept as a loss
        }
        while let Ok(Loss { kind, frame }) = self.reported.try_recv() {
            self.lose(kind, frame);
        }
    }

    /// Returns true when buffers have come back since the last look.
    fn has_moved(&mut self) -> bool {
        let before = self.free.len();
        self.collect();
        self.free.len() > before
    }

    fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Frees a buffer and counts the outcome of its frame.
    fn take_back(&mut self, mut held: Held) -> Result<(), SinkError> {
        let number = held.frame.meta.number;
        if core::mem::take(&mut held.broke_down) {
            self.lose(LossKind::SinkLost, number);
        }
        let failure = held.failure.take();
        self.free.push(held);
        let Some(error) = failure else {
            self.returned[0] += 1;
            return Ok(());
        };
        let is_lost = matches!(error, SinkError::Lost { .. });
        self.returned[1] += u64::from(!is_lost);
        self.lose(if is_lost { LossKind::Dropped } else { LossKind::Refused }, number);
        Err(error)
    }

    fn lose(&mut self, kind: LossKind, frame: u32) {
        if self.losses.len() < LOSSES_KEPT {
            self.losses.push(Loss { kind, frame });
        }
    }

    /// Buffers that are not free.
    #[cfg(test)]
    pub(super) fn lag(&self) -> usize {
        self.back.capacity().unwrap_or_default() - self.back.len() - self.free.len()
    }

    /// Reports the losses since the last call.
    pub(super) fn take_losses(&mut self, announce: &mut dyn FnMut(Loss)) {
        self.collect();
        self.losses.drain(..).for_each(announce);
    }

    /// Closes the queue: no more frames come.
    pub(super) fn hang_up(&mut self) {
        self.full = None;
    }

    /// Ends the thread of a sink that has finished its frames, for which [`wait_for`] waits; a sink that has not is
    /// given up. Once.
    pub(super) fn finish(&mut self) -> Result<Option<SinkSummary>, SinkError> {
        self.hang_up();
        let Some(thread) = self.thread.take() else { return Ok(None) };
        if !thread.is_finished() {
            return Err(self.give_up(patience::end() + self.slow_frame));
        }
        let joined = thread.join();
        self.collect();
        let Ok(ended) = joined else {
            self.line.is_lost = true;
            self.line.dropped = self.offered;
            return Err(SinkError::Lost { sink: self.name });
        };
        self.line = ended.line;
        self.line.dropped = self.offered - self.line.frames - self.line.refused;
        ended.finished.transpose()
    }

    /// Leaves a sink behind, with its thread, that has finished nothing for `patience`.
    fn give_up(&mut self, patience: Span) -> SinkError {
        self.is_given_up = true;
        self.hang_up();
        self.thread = None;
        self.collect();
        let error = SinkError::Stuck { sink: self.name, patience };
        let [frames, refused] = self.returned;
        let dropped = self.offered - frames - refused;
        self.line = SinkLine { frames, refused, dropped, is_lost: true, ..core::mem::take(&mut self.line) };
        self.line.first_error.get_or_insert_with(|| error.to_string());
        self.lose(LossKind::SinkLost, self.newest);
        error
    }

    /// Returns the counts of the sink; complete after [`Self::finish`].
    pub(super) fn line(&self) -> &SinkLine {
        &self.line
    }
}

impl Drop for Branch {
    fn drop(&mut self) {
        wait_for(core::slice::from_mut(self));
        let _ = self.finish(); // no caller is left to report to
    }
}

/// Waits until every sink has finished what it was handed, or until none of them has finished anything for the patience
/// of the most patient.
pub(super) fn wait_for(branches: &mut [Branch]) {
    branches.iter_mut().for_each(Branch::hang_up);
    let slowest = branches.iter().map(|branch| branch.slow_frame).max().unwrap_or(Span::ZERO);
    let mut patience = Patience::new(patience::end() + slowest);
    while !patience.is_over() && !branches.iter().all(Branch::has_ended) {
        std::thread::sleep(LOOK);
        if branches.iter_mut().fold(false, |any, branch| branch.has_moved() | any) {
            patience.restart();
        }
    }
}

/// The thread's own state.
struct Carrier {
    /// `None`: it broke down.
    sink: Option<Box<dyn Sink>>,
    line: SinkLine,
    delays: Span,
    report: Sender<Loss>,
}

impl Carrier {
    fn carry(mut self, to_send: &Receiver<Held>, sent: &Sender<Held>) -> Ended {
        for mut held in to_send {
            self.send(&mut held);
            let _ = sent.send(held); // no receiver: the caller has ended
        }
        self.finish()
    }

    fn send(&mut self, held: &mut Held) {
        let Some(sink) = &mut self.sink else {
            held.failure = Some(SinkError::Lost { sink: self.line.kind });
            return;
        };
        let report = &self.report;
        let send = || {
            let outcome = sink.send(&held.frame);
            pass_on_losses(&mut **sink, report);
            outcome
        };
        match catch_unwind(AssertUnwindSafe(send)) {
            Ok(outcome) => self.count(outcome, held),
            Err(panic) => {
                self.line.is_lost = true;
                self.line.first_error.get_or_insert_with(|| words_of(&*panic));
                held.failure = Some(SinkError::Lost { sink: self.line.kind });
                held.broke_down = true;
                let broken = self.sink.take();
                let _ = catch_unwind(AssertUnwindSafe(|| drop(broken))); // dropping a broken sink may panic again
            }
        }
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
        let Some(mut sink) = self.sink.take() else { return Ended { line: self.line, finished: None } };
        let report = self.report;
        let finished = catch_unwind(AssertUnwindSafe(|| {
            let finished = sink.finish();
            pass_on_losses(&mut *sink, &report);
            (finished, sink.counts())
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
        // The branch's own counts add up with the frames offered, whatever a sink reports about itself.
        (self.line.frames, self.line.refused) = (frames, refused);
        Ended { line: self.line, finished: Some(finished) }
    }
}

/// Passes on the losses that a sink itself reports; those that find no place are only counted by it.
fn pass_on_losses(sink: &mut dyn Sink, report: &Sender<Loss>) {
    sink.take_losses(&mut |loss| {
        let _ = report.try_send(loss); // full: the sink counts it
    });
}

/// Returns the text of a panic.
fn words_of(panic: &(dyn core::any::Any + Send)) -> String {
    let said = panic.downcast_ref::<&str>().map(ToString::to_string);
    let said = said.or_else(|| panic.downcast_ref::<String>().cloned());
    format!("broke down: {}", said.unwrap_or_else(|| "no reason given".into()))
}
