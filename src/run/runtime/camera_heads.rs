//! The camera heads of a loop and the camera commands of the flight computer: what each head can do goes to the receiver,
//! and the commands that it accepts to their heads.

use crate::runtime::{exposing::Exposing, ledger::Ledger, receiver::Receiver};
use firmware_protocol::{Message, message::Request};
use link::Input;

/// Passes the capabilities of every head to the receiver, if the message concerns cameras.
pub(super) fn show<'a>(heads: impl Iterator<Item = &'a Exposing>, receiver: &mut Receiver, input: &Input) {
    let Input::Message(Message::Command(command)) = input else { return };
    if matches!(command.request, Request::Camera(_) | Request::CameraTrigger(_)) {
        heads.enumerate().for_each(|(number, exposing)| receiver.cameras_mut().see(number, exposing.view()));
    }
}

/// Passes the commands that the receiver accepted to their heads; `exposing` returns the exposures of a head.
pub(super) fn give<H>(
    heads: &mut [H],
    exposing: impl Fn(&mut H) -> &mut Exposing,
    receiver: &mut Receiver,
    ledger: &mut Ledger,
) {
    while let Some((number, commanded)) = receiver.cameras_mut().take() {
        if let Some(head) = heads.get_mut(number) {
            // The same range was checked before; a refusal here is still recorded as an event.
            let _noted = exposing(head).take(&commanded, ledger);
        }
    }
}
