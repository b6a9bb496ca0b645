//! Clients that may read and write, and addresses that frames and messages may be sent to.

use super::{Answer, DO_NOT_FRAGMENT};
use crate::network_camera::control::{Control, LastChange};
use crate::network_camera::features::at;
use crate::network_camera::gvsp::IP_UDP_BYTES;
use crate::network_camera::params::{DeviceParams, PACKET_BYTES_MIN, Params};
use crate::network_camera::{counters::Tally, gvcp::Status, proof::Proof, registers::Memory};
use base::time::Tai;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::Arc;

/// The longest heartbeat time that a client may ask for, ms.
const HEARTBEAT_MOST_MS: u32 = 600_000;
/// The same when other machines reach the camera: a client that is gone, or was forged, blocks others no longer.
const HEARTBEAT_MOST_EXPOSED_MS: u32 = 30_000;
/// Bit of the packet size register that sends a test packet.
const FIRE_TEST: u32 = 0x8000_0000;

pub(super) struct Access {
    pub(super) control: Control,
    pub(super) proof: Proof,
    pub(super) last_change: LastChange,
    pub(super) place: DeviceParams,
    allow_other_receivers: bool,
    tally: Arc<Tally>,
}

impl Access {
    pub(super) fn new(params: &Params, place: DeviceParams, tally: Arc<Tally>) -> Self {
        let allow_other_receivers = params.allow_other_receivers;
        let (control, proof, last_change) = (Control::default(), Proof::default(), LastChange::default());
        Self { control, proof, last_change, place, allow_other_receivers, tally }
    }

    pub(super) fn is_neighbour(&self, other: Ipv4Addr) -> bool {
        let mask = self.place.mask.to_bits();
        self.place.address.to_bits() & mask == other.to_bits() & mask
    }

    /// Returns true if frames may go to `receiver`. A few bytes of commands cause many bytes of frames, so frames go to
    /// the sender of the commands, and the camera cannot be turned against a third party; when the bench allows others,
    /// to one neighbour or a multicast group, never to all.
    pub(super) fn may_receive(&self, receiver: Ipv4Addr, controller: SocketAddrV4) -> bool {
        let host_bits = !self.place.mask.to_bits();
        let is_all = receiver.is_broadcast() || host_bits > 1 && receiver.to_bits() & host_bits == host_bits;
        let is_other = self.is_neighbour(receiver) && !is_all || is_group(receiver);
        let is_allowed = self.allow_other_receivers && is_other;
        is_allowed || receiver == *controller.ip()
    }

    pub(super) fn is_controller_proven(&self) -> bool {
        self.control.controller().is_some_and(|controller| self.proof.is_proven(controller))
    }

    /// Refuses what changes frames or sends more than was received, as long as the controller's address is not proven.
    pub(super) fn must_be_proven(&self) -> Result<(), Status> {
        self.unless_unproven(self.is_controller_proven())
    }

    /// Refuses an answer that is longer than its request once a client without a proof has received many.
    pub(super) fn may_reply_at_length(&mut self, from: SocketAddrV4, now: Tai) -> Result<(), Status> {
        let may_reply = self.proof.may_reply_at_length(from, now);
        self.unless_unproven(may_reply)
    }

    fn unless_unproven(&self, is_proven: bool) -> Result<(), Status> {
        if is_proven {
            return Ok(());
        }
        self.tally.unproven_refused.one();
        Err(Status::AccessDenied)
    }

    pub(super) fn heartbeat_most_ms(&self) -> u32 {
        if self.place.address.is_loopback() { HEARTBEAT_MOST_MS } else { HEARTBEAT_MOST_EXPOSED_MS }
    }

    /// Sets the packet size within the limit of the interface. A test packet is sent only at a size that can get
    /// through, and only to a client that has proven its address.
    pub(super) fn set_packet_size(&self, value: u32, memory: &mut Memory, out: &mut Answer) -> Result<(), Status> {
        if value & FIRE_TEST != 0 {
            self.must_be_proven()?;
        }
        let (asked, most) = (value & 0xFFFF, self.place.packet_bytes_max);
        let size = asked.min(most).max(PACKET_BYTES_MIN) & !3;
        memory.set(at::PACKET_SIZE, value & DO_NOT_FRAGMENT | size);
        let port = u16::try_from(memory.word(at::STREAM_PORT)).unwrap_or_default();
        let to = SocketAddrV4::new(Ipv4Addr::from_bits(memory.word(at::STREAM_ADDRESS)), port);
        if value & FIRE_TEST != 0 && asked <= most && port != 0 && !to.ip().is_unspecified() {
            let bytes = usize::try_from(asked).unwrap_or_default().saturating_sub(IP_UDP_BYTES);
            out.test_packet = Some((to, bytes));
        }
        Ok(())
    }

    /// Refuses a change of the machine's address; asking for the present one does no harm.
    pub(super) fn force_address(&self, mac: [u8; 6], address: Ipv4Addr, mask: Ipv4Addr) -> Result<(), Status> {
        if mac != self.place.mac || (address, mask) == (self.place.address, self.place.mask) {
            return Ok(());
        }
        let is_taken = self.control.controller().is_some();
        Err(if is_taken { Status::AccessDenied } else { Status::NotImplemented })
    }
}

/// Returns true for a multicast group that may carry frames: 224.0.0.0/24 is for the network's own use.
fn is_group(address: Ipv4Addr) -> bool {
    address.is_multicast() && address.octets()[..3] != [224, 0, 0]
}
