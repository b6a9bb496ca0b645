//! The camera heads of a loop and the camera commands of the flight computer: what each head can do goes to the first
//! head's receiver, and the commands that it accepts to their heads.

use crate::runtime::{exposing::Exposing, ledger::Ledger, receiver::Receiver};
use firmware_protocol::{Message, message::Request};
use link::Input;

/// Common interface of the camera heads of both loops.
pub(super) trait CameraHead {
    /// Returns the exposures of the head.
    fn exposing_mut(&mut self) -> &mut Exposing;
    /// Returns the receiver of the head.
    fn receiver_mut(&mut self) -> &mut Receiver;
}

/// Passes the capabilities of every head to the first head's receiver, which answers, if the message concerns cameras.
pub(super) fn show(heads: &mut [impl CameraHead], input: &Input) {
    let Input::Message(Message::Command(command)) = input else { return };
    if !matches!(command.request, Request::Camera(_) | Request::CameraTrigger(_)) {
        return;
    }
    for number in 0..heads.len() {
        let view = heads[number].exposing_mut().view();
        if let Some(first) = heads.first_mut() {
            first.receiver_mut().cameras_mut().see(number, view);
        }
    }
}

/// Passes the commands that the first head's receiver accepted to their heads.
pub(super) fn give(heads: &mut [impl CameraHead], ledger: &mut Ledger) {
    while let Some((number, commanded)) = heads.first_mut().and_then(|first| first.receiver_mut().cameras_mut().take())
    {
        if let Some(head) = heads.get_mut(number) {
            // The same range was checked before; a refusal here is still recorded as an event.
            let _noted = head.exposing_mut().take(&commanded, ledger);
        }
    }
}
