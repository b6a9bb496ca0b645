//! Whom frames and messages may be sent to.

use super::Device;
use std::net::{Ipv4Addr, SocketAddrV4};

impl Device {
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
}

/// Returns true for a multicast group that may carry frames: 224.0.0.0/24 is for the network's own use.
fn is_group(address: Ipv4Addr) -> bool {
    address.is_multicast() && address.octets()[..3] != [224, 0, 0]
}
