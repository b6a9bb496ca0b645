//! One slot of a camera head up to its exposure: triggers, faults, drawing. The same in a run and in its replay.
//!
//! In: a slot whose release has come, and all messages that arrived before. Out: the frame as it was exposed, and what its
//! faults still do to it when it is finished ([`FrameFaults::spoil`]): what the stimulator says of a frame it says before
//! that. Tests: `tests/closed_loop/imaging_faults.rs`, `triggers.rs` and `replay.rs`.

use crate::runtime::engine::FrameEngine;
use crate::runtime::error::RunError;
use crate::runtime::frame_faults::{Fate, FrameFaults};
use crate::runtime::ledger::Ledger;
use crate::runtime::receiver::Receiver;
use crate::runtime::slot::Slot;
use frames::report::StageTimes;
use frames::sink::SentFrame;

/// One head, to draw a slot of it.
pub struct HeadStep<'a> {
    /// Draws.
    pub engine: &'a mut FrameEngine,
    /// Holds what arrived.
    pub receiver: &'a mut Receiver,
    /// Spoils frames; `None`: nothing does.
    pub faults: Option<&'a mut FrameFaults>,
    /// Takes the notes of triggers in the place of the run's ledger, where another head has made the same notes.
    pub noted_already: Option<&'a mut Ledger>,
}

impl HeadStep<'_> {
    /// Draws a slot under the faults of its time. Returns what becomes of the frame and the times of the stages, or `None`
    /// when there is no attitude and the policy is to send no frame.
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
