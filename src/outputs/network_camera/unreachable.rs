//! Reads the network's answers to sent packets: "destination unreachable" (ICMP type 3).
//!
//! Linux keeps such answers in the socket's error queue, each with the address that the packet went to (`man 7 ip`,
//! IP_RECVERR). Only answers from the network count, not errors of this machine, and "fragmentation needed" is not an
//! absent receiver. Proven by `outputs::network_camera::tests`.

use nix::sys::socket::{ControlMessageOwned, MsgFlags, SockaddrIn, recvmsg};
use std::net::{SocketAddrV4, UdpSocket};
use std::{io::IoSliceMut, os::fd::AsRawFd};

/// `SO_EE_ORIGIN_ICMP` of linux/errqueue.h.
const ORIGIN_ICMP: u8 = 2;
/// ICMP type and code of RFC 792.
const DESTINATION_UNREACHABLE: u8 = 3;
const FRAGMENTATION_NEEDED: u8 = 4;
/// Answers that are read in a row.
const IN_A_ROW: usize = 64;

/// Empties the socket's error queue. Returns true when one answer is about packets to `receiver`.
pub(super) fn take_answers(socket: &UdpSocket, receiver: SocketAddrV4) -> bool {
    let mut is_about_receiver = false;
    let mut control = nix::cmsg_space!(nix::libc::sock_extended_err, nix::libc::sockaddr_in);
    for _ in 0..IN_A_ROW {
        // The packet that the answer quotes is of no interest.
        let mut quoted = [0; 0];
        let mut parts = [IoSliceMut::new(&mut quoted)];
        let flags = MsgFlags::MSG_ERRQUEUE | MsgFlags::MSG_DONTWAIT;
        let Ok(message) = recvmsg::<SockaddrIn>(socket.as_raw_fd(), &mut parts, Some(&mut control), flags) else {
            break;
        };
        let is_to_receiver = message.address.is_some_and(|to| SocketAddrV4::from(to) == receiver);
        let Ok(mut controls) = message.cmsgs() else { continue };
        is_about_receiver |= is_to_receiver && controls.any(|control| is_unreachable(&control));
    }
    is_about_receiver
}

fn is_unreachable(control: &ControlMessageOwned) -> bool {
    let ControlMessageOwned::Ipv4RecvErr(error, _) = control else { return false };
    error.ee_origin == ORIGIN_ICMP && error.ee_type == DESTINATION_UNREACHABLE && error.ee_code != FRAGMENTATION_NEEDED
}
