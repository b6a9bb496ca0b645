//! One camera head of a run, on either clock and in a replay.

use crate::runtime::frame_faults::{Fate, FrameFaults};
use crate::runtime::{engine::FrameEngine, error::RunError, ledger::Ledger, receiver::Receiver, slot::Slot};
use base::axes::{Body, Rotation, Sensor};
use frames::report::StageTimes;
use frames::sink::{NullSink, SentFrame, Sink, TapEnd};
use outputs::display::calibration::Calibration;

/// One camera head of a run.
pub struct Head {
    /// Draws frames.
    pub engine: FrameEngine,
    /// Damages frames.
    pub faults: FrameFaults,
    /// Takes the frames.
    pub sink: Box<dyn Sink>,
    /// Mounting of the camera, which may be drawn in other axes for a display.
    pub(crate) mounting: Rotation<Sensor, Body>,
    /// True when its frames leave the program: those drawn for an internal tracker beside a display do not.
    pub(crate) is_shown: bool,
    /// Calibration that it is drawn with, if it is drawn for a display.
    pub(crate) calibration: Option<Calibration>,
    /// The tracker's end of its tap, until the far side takes it.
    pub(crate) tracker: Option<TapEnd>,
}

impl Head {
    /// Returns a head without faults.
    pub fn new(engine: FrameEngine, sink: Box<dyn Sink>) -> Self {
        let mounting = engine.params().attitude.sensor_from_body;
        let faults = FrameFaults::default();
        Self { engine, faults, sink, mounting, is_shown: true, calibration: None, tracker: None }
    }

    /// Removes the sink, which goes to a thread of its own.
    pub(super) fn take_sink(&mut self) -> Box<dyn Sink> {
        core::mem::replace(&mut self.sink, Box::new(NullSink::new()))
    }

    /// Draws a slot whose release has come, under the triggers and faults of its time; all messages that arrived before
    /// are in the receiver. Returns the effects that the faults have on the finished frame ([`FrameFaults::spoil`]: a
    /// frame is described before it is damaged) and the times of the stages, or `None` when no attitude is available and
    /// the policy is to send no frame.
    ///
    /// # Errors
    /// When the backend failed or the policy for a stopped stream is to stop.
    pub fn draw(
        &mut self,
        slot: Slot,
        receiver: &mut Receiver,
        ledger: &mut Ledger,
        frame: &mut SentFrame,
    ) -> Result<Option<(Fate, StageTimes)>, RunError> {
        let Self { engine, faults, .. } = self;
        receiver.fire_triggers(engine.head(), slot, ledger, &mut |fired| {
            faults.fire_trigger(fired.number, fired.at);
        });
        let fate = faults.begin(slot, engine, ledger);
        let exposed = engine.expose(slot, receiver, ledger, frame)?;
        Ok(exposed.map(|times| (fate, times)))
    }
}
