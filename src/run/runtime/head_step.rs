//! One slot of a camera head up to its exposure: triggers, faults, drawing. The same in a run and in its replay.
//!
//! In: a slot whose release has come, and all messages that arrived before. Out: the frame as it was exposed, and the
//! effects that its faults will have when it is finished ([`FrameFaults::spoil`]): the stimulator describes a frame
//! before it is damaged. Tests: `tests/closed_loop/imaging_faults.rs`, `triggers.rs` and `replay.rs`.

use crate::runtime::frame_faults::{Fate, FrameFaults};
use crate::runtime::{engine::FrameEngine, error::RunError, ledger::Ledger, receiver::Receiver, slot::Slot};
use frames::{report::StageTimes, sink::SentFrame};

/// One head, ready to draw a slot.
pub struct HeadStep<'a> {
    /// Draws frames.
    pub engine: &'a mut FrameEngine,
    /// Holds the messages that arrived.
    pub receiver: &'a mut Receiver,
    /// Damages frames; `None` without faults.
    pub faults: Option<&'a mut FrameFaults>,
    /// Receives the notes of triggers instead of the run's ledger, when another head has made the same notes.
    pub noted_already: Option<&'a mut Ledger>,
}

impl HeadStep<'_> {
    /// Draws a slot under the faults of its time. Returns the effects on the frame and the times of the stages, or
    /// `None` when no attitude is available and the policy is to send no frame.
    ///
    /// # Errors
    /// When the backend failed or the policy for a stopped stream is to stop.
    pub fn draw(
        &mut self,
        slot: Slot,
        ledger: &mut Ledger,
        frame: &mut SentFrame,
    ) -> Result<Option<(Fate, StageTimes)>, RunError> {
        let Self { engine, receiver, faults, noted_already } = self;
        let notes = noted_already.as_deref_mut().unwrap_or(&mut *ledger);
        receiver.fire_triggers(slot, notes, &mut |fired| {
            if let Some(faults) = faults.as_mut() {
                faults.fire_trigger(fired.number, fired.at);
            }
        });
        let fate = faults.as_mut().map_or(Fate::SEND, |faults| faults.begin(slot, engine, ledger));
        let exposed = engine.expose(slot, receiver, ledger, frame)?;
        Ok(exposed.map(|times| (fate, times)))
    }
}
