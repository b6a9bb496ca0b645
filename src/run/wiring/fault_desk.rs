//! Checks and places the events of a run, before and during the run; the same on both clocks.
//!
//! In: an event, and the faults of each head's frames. Out: actions and expectations for the far side ([`Placed`]).
//! Faults of the bus go to the links' own lists. Tests: of `faults`, and `tests/closed_loop`.

use crate::runtime::{Head, RunError, frame_faults::FrameFaults, ledger::Event as LedgerEvent, receiver::Receiver};
use crate::wiring::error::LoopError;
use crate::wiring::faults::{Aboard, FaultLine, FaultLog, Inventory, LoggedFault, Places, PlacesRead, check_places};
use base::axes::{Body, Rotation, Sensor};
use base::time::Tai;
use config::{Action, Event};
use link::tap::FaultControl;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The faults of a run, and where they act.
#[derive(Debug)]
pub(super) struct FaultDesk {
    log: FaultLog,
    to_stimulator: FaultControl,
    to_computer: FaultControl,
    zero: Tai,
    mounting: Rotation<Sensor, Body>,
    there: Inventory,
}

/// An event that was placed: actions and expectations for the far side.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Placed {
    /// The event.
    pub(super) event: Event,
    /// Actions aboard with their times.
    pub(super) aboard: Vec<(Tai, Aboard)>,
    /// Start and end of disturbances of pointing or frames.
    pub(super) disturbances: Vec<(Tai, Tai)>,
    /// Ledger event; `None` for faults of frames, which write it themselves.
    pub(super) note: Option<LedgerEvent>,
}

impl FaultDesk {
    /// Returns the faults of a run whose first exposure is at `zero`; `mounting` is that of the first head.
    pub(super) fn new(
        zero: Tai,
        mounting: Rotation<Sensor, Body>,
        there: Inventory,
        [to_stimulator, to_computer]: [FaultControl; 2],
    ) -> Self {
        Self { log: FaultLog::default(), to_stimulator, to_computer, zero, mounting, there }
    }

    /// Refuses an event that names a head, wheel or pixel that does not exist, or needs a spacecraft that is not flown.
    ///
    /// # Errors
    /// When the event is invalid, with the reason.
    pub(super) fn check(&self, event: &Event) -> Result<(), LoopError> {
        check_places(event, &self.there).map_err(|why| LoopError::Event { what: event.action.word(), why })
    }

    /// Places an event where it acts. An event whose time is before `now` starts at once.
    pub(super) fn place(&mut self, event: &Event, now: Tai, frames: Vec<&mut FrameFaults>) -> Placed {
        let mut event = *event;
        if event.on_trigger.is_none() {
            event.at = event.at.max(now - self.zero);
        }
        let (before, mut aboard) = (self.log.faults().len(), Vec::new());
        let mut places = Places { to_stimulator: &self.to_stimulator, to_computer: &self.to_computer, frames };
        self.log.place(&event, self.zero, &self.mounting, &mut places, &mut aboard);
        let mut disturbances = Vec::new();
        if let Action::Trigger { number } = event.action {
            disturbances.extend(self.log.triggered_by(number));
        }
        let fault = self.log.faults().get(before);
        disturbances.extend(fault.filter(|_| event.on_trigger.is_none()).map(|fault| (fault.from, fault.until)));
        Placed { event, aboard, disturbances, note: fault.and_then(LoggedFault::ledger_event) }
    }

    /// Returns every fault so far with its hits; `aboard` returns the hits of a fault aboard by its number.
    pub(super) fn lines(&self, frames: Vec<&FrameFaults>, aboard: &dyn Fn(usize) -> u64) -> Vec<FaultLine> {
        let (to_stimulator, to_computer) = (&self.to_stimulator, &self.to_computer);
        self.log.lines(self.zero, &PlacesRead { to_stimulator, to_computer, frames, aboard })
    }
}

/// Returns events in the order in which they are placed: a trigger must find the faults that wait for it.
pub(super) fn in_order_of_placing(events: &[Event]) -> impl Iterator<Item = &Event> {
    let is_trigger = |event: &&Event| matches!(event.action, Action::Trigger { .. });
    events.iter().filter(move |event| !is_trigger(event)).chain(events.iter().filter(is_trigger))
}

/// Prepares what an event needs in the heads and their receiver, so that no frame waits for it later.
///
/// # Errors
/// When the tables of other optics cannot be made.
pub(super) fn make_ready<'a>(
    event: &Event,
    mut heads: impl Iterator<Item = &'a mut Head>,
    receiver: &mut Receiver,
) -> Result<(), RunError> {
    event.on_trigger.into_iter().for_each(|number| receiver.expect_trigger(number));
    heads.try_for_each(|Head { engine, faults, .. }| faults.prepare(engine))
}

/// Locks what threads share, also after one of them has panicked.
pub(super) fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}
