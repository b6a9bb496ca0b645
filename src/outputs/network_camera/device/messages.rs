//! The message channel's registers, and events on their way to the client.

use super::Device;
use crate::network_camera::gvcp::Status;
use crate::network_camera::messages::{Channel, EVENTS};
use crate::network_camera::registers::{at, own};
use base::time::{Span, Tai};
use std::net::{Ipv4Addr, SocketAddrV4};

/// Longest wait for an answer, ms, and most repetitions: bounds on the cost of a client that is gone.
const TIMEOUT_MOST_MS: u32 = 10_000;
const RETRIES_MOST: u32 = 20;

impl Device {
    /// Returns where messages go; `None` as long as the client has not said, or has not proven its address.
    fn message_receiver(&self) -> Option<SocketAddrV4> {
        let port = u16::try_from(self.memory.word(at::MESSAGE_PORT) & 0xFFFF).ok().filter(|port| *port != 0)?;
        let address = Ipv4Addr::from_bits(self.memory.word(at::MESSAGE_ADDRESS));
        let is_known = !address.is_unspecified() && self.is_controller_proven();
        is_known.then(|| SocketAddrV4::new(address, port))
    }

    /// True when events are wanted: the control thread then looks for them often.
    pub(in crate::network_camera) fn has_messages(&self) -> bool {
        self.messages.is_open() && self.message_receiver().is_some()
    }

    /// Writes the message that is to be sent now into `out`; its receiver, `None` for none.
    pub fn message(&mut self, now: Tai, out: &mut Vec<u8>) -> Option<SocketAddrV4> {
        let receiver = self.message_receiver()?;
        let timeout = Span::from_ms(self.memory.word(at::MESSAGE_TIMEOUT).into());
        let channel = Channel { timeout, retries: self.memory.word(at::MESSAGE_RETRIES) };
        self.messages.next(channel, now, &self.shared.tally, out).then_some(receiver)
    }

    /// Takes a datagram from the port that messages are sent from.
    pub fn answer_to_message(&mut self, from: SocketAddrV4, bytes: &[u8]) {
        if self.message_receiver().is_some_and(|receiver| receiver.ip() == from.ip()) {
            self.messages.acknowledge(bytes);
        }
    }

    pub(super) fn write_message_channel(&mut self, address: u32, value: u32, from: SocketAddrV4) -> Result<(), Status> {
        match address {
            at::MESSAGE_PORT => self.memory.set(address, value & 0xFFFF),
            at::MESSAGE_ADDRESS if value == 0 || self.may_receive(Ipv4Addr::from_bits(value), from) => {
                self.memory.set(address, value);
            }
            at::MESSAGE_ADDRESS => return Err(Status::InvalidParameter),
            at::MESSAGE_TIMEOUT => self.memory.set(address, value.min(TIMEOUT_MOST_MS)),
            at::MESSAGE_RETRIES => self.memory.set(address, value.min(RETRIES_MOST)),
            _ => return self.memory.read(address, 4).and(Err(Status::WriteProtect)),
        }
        Ok(())
    }

    pub(super) fn write_event(&mut self, address: u32, value: u32) -> Result<(), Status> {
        if self.commands.is_none() {
            return Err(Status::WriteProtect);
        }
        let most = if address == own::EVENT_SELECTOR { EVENTS.len() as u32 - 1 } else { 1 };
        if value > most {
            return Err(Status::InvalidParameter);
        }
        if address == own::EVENT_NOTIFICATION {
            self.messages.want(self.memory.word(own::EVENT_SELECTOR), value == 1);
        }
        self.memory.set(address, value);
        let selected = self.memory.word(own::EVENT_SELECTOR);
        self.memory.set(own::EVENT_NOTIFICATION, self.messages.is_wanted(selected));
        Ok(())
    }
}
