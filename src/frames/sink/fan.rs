//! Several sinks at once, each on a thread of its own.
//!
//! Input: frames. Output: the same frames in every sink. The action when one of them is slow or fails is set by
//! [`OnFull`]: on the real clock ([`OnFull::Drop`]) a frame goes past a sink that has no free buffer, a failure is
//! counted, and the other sinks do not notice; `send` copies the frame once per sink and waits for nothing. On the
//! virtual clock ([`OnFull::Wait`]) `send` returns when every sink is done with the frame, or with the first failure of
//! one, so that a run gives the same bits on every machine, also one that ends early. Only a sink that blocks for
//! [`STALL_PATIENCE`](base::patience::STALL_PATIENCE) is given up and counted as lost; the others go on.
//!
//! Limits: `finish` waits for what is still queued as long as a sink finishes something within
//! [`END_PATIENCE`](base::patience::END_PATIENCE); after that a sink that blocks is given up, counted as lost, and its
//! thread is left behind. Dropping a fan waits in the same way, so that nothing of a sink that works outlives it, also
//! when a run never began. Memory: buffers times (2 bytes a pixel and the truth table) per sink, all of it at the
//! start. Tests: `fan_tests.rs`, `tests/closed_loop/sinks.rs`.

use crate::report::SinkLine;
use crate::sink::branch::{Branch, BranchParams, wait_for};
use crate::sink::line::{Loss, Tally};
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary};

/// Action for a frame when a sink has no free buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OnFull {
    /// The frame passes that sink, and is counted.
    Drop,
    /// The frame waits, and so does everything else.
    Wait,
}

/// Sinks with a thread each.
pub struct Fan {
    branches: Vec<Branch>,
    on_full: OnFull,
    tally: Tally,
    /// Failures and outputs, when it is over.
    finished: Option<SinkSummary>,
}

impl Fan {
    /// Starts a thread per sink. `prototype` is copied into every buffer; frames of its size are copied without
    /// allocation.
    ///
    /// # Errors
    /// When a thread cannot be started.
    pub fn start(
        sinks: impl IntoIterator<Item = BranchParams>,
        prototype: &SentFrame,
        on_full: OnFull,
    ) -> Result<Self, SinkError> {
        let branch = |params: BranchParams| {
            // A frame is waited for before the next is handed over: more than one buffer would never be used.
            let buffers = if on_full == OnFull::Wait { 1 } else { params.buffers };
            Branch::start(BranchParams { buffers, ..params }, prototype)
        };
        let branches = sinks.into_iter().map(branch).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { branches, on_full, tally: Tally::default(), finished: None })
    }

    /// Returns frames that a sink has been handed and is not done with.
    #[cfg(test)]
    pub(super) fn lag(&self, sink: usize) -> usize {
        self.branches[sink].lag()
    }

    /// Sends the frame to every sink and returns the first failure. A sink that blocks does not fail the others: its
    /// line says that it is lost.
    fn send_to_all(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let mut failure = None;
        let mut handed = Vec::with_capacity(self.branches.len());
        for branch in &mut self.branches {
            if branch.is_given_up() {
                branch.pass(frame);
                continue;
            }
            match branch.hand(frame) {
                Ok(()) => handed.push(branch),
                Err(error) => {
                    failure.get_or_insert(error);
                }
            }
        }
        for branch in handed {
            if let Some(error) = branch.settle().err().filter(|error| !is_given_up(error)) {
                failure.get_or_insert(error);
            }
        }
        failure.map_or(Ok(()), Err)
    }
}

/// Returns true for a sink that was given up: its line says so.
fn is_given_up(error: &SinkError) -> bool {
    matches!(error, SinkError::Stuck { .. })
}

impl Sink for Fan {
    /// Returns the name of the first sink.
    fn name(&self) -> &'static str {
        self.branches.first().map_or("nothing", |branch| branch.line().kind)
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let name = self.name();
        self.tally.check(name, frame)?;
        match self.on_full {
            OnFull::Drop => self.branches.iter_mut().for_each(|branch| branch.offer(frame)),
            OnFull::Wait => {
                if let Err(error) = self.send_to_all(frame) {
                    self.tally.refuse();
                    return Err(error);
                }
            }
        }
        self.tally.take(name, frame)
    }

    /// Counts the frames that were given to the sinks; [`Self::lines`] says which of them each took.
    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        let mut failure = None;
        let mut bytes = 0;
        // All at the same time: each may take its own time for its remaining frames.
        wait_for(&mut self.branches);
        for branch in &mut self.branches {
            match branch.finish() {
                Ok(summary) => bytes += summary.map_or(0, |summary| summary.bytes),
                Err(error) => {
                    failure.get_or_insert(error);
                }
            }
        }
        let mut summary = self.tally.finish(self.name());
        if let Some(finished) = &self.finished {
            return Ok(SinkSummary { refused: summary.refused, ..finished.clone() });
        }
        summary.bytes = bytes;
        summary.output = self.branches.iter().find_map(|branch| branch.line().output.clone()).map(Into::into);
        match failure.filter(|error| self.on_full == OnFull::Wait && !is_given_up(error)) {
            Some(error) => Err(error),
            None => Ok(self.finished.insert(summary).clone()),
        }
    }

    fn take_losses(&mut self, announce: &mut dyn FnMut(Loss)) {
        self.branches.iter_mut().for_each(|branch| branch.take_losses(announce));
    }

    fn lines(&self) -> Vec<SinkLine> {
        self.branches.iter().map(|branch| branch.line().clone()).collect()
    }
}
