//! Flies an assembled run to its end, on the clock that it has.

use crate::wiring::{assemble::Run, error::LoopError, run_clock::RunClock, run_end::RunEnd, stepped::SteppedRun};
use crate::{runtime::RunRecord, wiring::real};
use core::sync::atomic::{AtomicBool, Ordering};
use frames::sink::SentFrame;
use std::sync::Arc;

impl Run {
    /// Flies the run to its end, or until `stop` is set. `progress` is called after each frame with the number of its
    /// head, and must not block.
    ///
    /// # Errors
    /// When the run cannot start; the result states why a started run ended early.
    pub fn fly(
        self,
        stop: &Arc<AtomicBool>,
        progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
    ) -> Result<RunEnd, LoopError> {
        match self.clock.clone() {
            RunClock::Real(clock) => real::fly(self, &clock, stop, progress),
            RunClock::Virtual(_) => {
                let mut run = SteppedRun::of(self)?;
                let error = run.run_to_end(&mut |head, frame, record| {
                    progress(head, frame, record);
                    !stop.load(Ordering::Relaxed)
                });
                Ok(run.end(error.err()))
            }
        }
    }
}
