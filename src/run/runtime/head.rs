//! One camera head of a run, on either clock and in a replay.
//!
//! The camera heads of a loop and the camera commands of the flight computer: what each head can do goes to the receiver,
//! and the commands that it accepts to their heads.

use crate::runtime::frame_faults::{Fate, FrameFaults};
use crate::runtime::{
    engine::FrameEngine, error::Result, exposing::Exposing, ledger::Ledger, receiver::Receiver, slot::Slot,
};
use base::axes::{Body, Rotation, Sensor};
use firmware_protocol::{Message, message::Request};
use frames::report::StageTimes;
use frames::sink::{NullSink, SentFrame, Sink, TapEnd};
use link::Input;
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
        let mounting = engine.params.attitude.sensor_from_body;
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
    ) -> Result<Option<(Fate, StageTimes)>> {
        let Self { engine, faults, .. } = self;
        receiver.session.fire_triggers(engine.head, slot, ledger, &mut |fired| {
            faults.fire_trigger(fired.number, fired.at);
        });
        let fate = faults.begin(slot, engine, ledger);
        let exposed = engine.expose(slot, receiver, ledger, frame)?;
        Ok(exposed.map(|times| (fate, times)))
    }
}

/// Passes the capabilities of every head to the receiver, if the message concerns cameras.
pub(super) fn show_cameras<'a>(heads: impl Iterator<Item = &'a Exposing>, receiver: &mut Receiver, input: &Input) {
    let Input::Message(Message::Command(command)) = input else { return };
    if matches!(command.request, Request::Camera(_) | Request::CameraTrigger(_)) {
        heads.enumerate().for_each(|(number, exposing)| receiver.session.cameras.see(number, exposing.view()));
    }
}

/// Passes the commands that the receiver accepted to their heads; `exposing` returns the exposures of a head.
pub(super) fn give_commands<H>(
    heads: &mut [H],
    exposing: impl Fn(&mut H) -> &mut Exposing,
    receiver: &mut Receiver,
    ledger: &mut Ledger,
) {
    while let Some((number, commanded)) = receiver.session.cameras.take() {
        if let Some(head) = heads.get_mut(number) {
            // The same range was checked before; a refusal here is still recorded as an event.
            let _noted = exposing(head).take(&commanded, ledger);
        }
    }
}
