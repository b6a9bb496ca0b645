//! The interface behind an address: its subnet, its MTU, its hardware address; and sockets on it.
//!
//! On loopback every address of 127.0.0.0/8 is there, so that several cameras share one machine.

use crate::network_camera::params::{PACKET_BYTES_MAX, PACKET_BYTES_MIN};
use base::refused::Refused;
use nix::ifaddrs::{InterfaceAddress, getifaddrs};
use nix::sys::socket::{ControlMessageOwned, MsgFlags, SockaddrIn, SockaddrStorage, recvmsg, setsockopt, sockopt};
use rustix::net::sockopt::{
    Ipv4PathMtuDiscovery, set_ip_mtu_discover, set_socket_broadcast, set_socket_reuseaddr, set_socket_send_buffer_size,
    set_socket_timeout,
};
use rustix::net::{AddressFamily, SocketType, bind, socket};
use std::io::{self, IoSliceMut};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::AsRawFd;

/// MTU where the system reports none: Ethernet's.
const USUAL_MTU: u32 = 1500;
/// Bytes that the system may hold for the stream: pacing, not a queue, decides when packets leave.
const SEND_BUFFER_BYTES: usize = 1 << 20;
/// Longest time that one packet may wait for the system.
const SEND_PATIENCE: core::time::Duration = core::time::Duration::from_millis(100);

/// The data of an interface at an address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Interface {
    pub(super) name: String,
    pub(super) address: Ipv4Addr,
    pub(super) mask: Ipv4Addr,
    pub(super) mac: [u8; 6],
    pub(super) mtu: u32,
}

impl Interface {
    /// Returns the interface that has `address`.
    pub(super) fn of(address: Ipv4Addr) -> Result<Self, Refused> {
        let all: Vec<InterfaceAddress> =
            getifaddrs().map_err(|error| system(address, "list the interfaces", error.into(), ""))?.collect();
        let found = all.iter().find_map(|entry| {
            let (own, mask) = (ipv4(entry.address.as_ref())?, ipv4(entry.netmask.as_ref())?);
            let is_here = own == address || own.is_loopback() && address.is_loopback();
            is_here.then(|| (base_name(&entry.interface_name).to_owned(), mask))
        });
        let known = || {
            let own: Vec<String> =
                all.iter().filter_map(|entry| ipv4(entry.address.as_ref())).map(|own| own.to_string()).collect();
            own.join(", ")
        };
        let (name, mask) = found.ok_or_else(|| Refused(format!("network camera at {address}: no interface has this address; wanted one of: {known}; try 127.0.0.1, or give the \
         interface the address", known = known())))?;
        let of_it = || all.iter().filter(|entry| base_name(&entry.interface_name) == name);
        // Several addresses are several cameras: only the first has the interface's own hardware address.
        let is_first = of_it().find_map(|entry| ipv4(entry.address.as_ref())) == Some(address);
        let mac = of_it().find_map(hardware_address).filter(|_| is_first);
        Ok(Self { mac: mac.unwrap_or_else(|| made_of(address)), mtu: mtu(&name), name, address, mask })
    }

    /// Returns the most bytes of a packet, a whole number of words.
    pub(super) fn packet_bytes_max(&self) -> Result<u32, Refused> {
        if self.mtu < PACKET_BYTES_MIN {
            let (address, name, mtu) = (self.address, self.name.clone(), self.mtu);
            return Err(Refused(format!(
                "network camera at {address}: packets on {name} have at most {mtu} bytes (its MTU); wanted 576 or more; raise the \
         MTU, or take the address of another interface"
            )));
        }
        Ok(self.mtu.min(PACKET_BYTES_MAX) & !3)
    }

    /// Returns the address that reaches everybody in the subnet.
    pub(super) fn broadcast(&self) -> Ipv4Addr {
        Ipv4Addr::from_bits(self.address.to_bits() | !self.mask.to_bits())
    }
}

/// Returns the interface that a label such as `eth0:1` belongs to.
fn base_name(name: &str) -> &str {
    name.split_once(':').map_or(name, |(base, _)| base)
}

fn ipv4(address: Option<&SockaddrStorage>) -> Option<Ipv4Addr> {
    address?.as_sockaddr_in().map(SockaddrIn::ip)
}

fn hardware_address(entry: &InterfaceAddress) -> Option<[u8; 6]> {
    let mac = entry.address.as_ref()?.as_link_addr()?.addr()?;
    (mac != [0; 6]).then_some(mac)
}

/// Returns a locally administered address, for an interface without one, or whose own is already used for another
/// address.
fn made_of(address: Ipv4Addr) -> [u8; 6] {
    let [a, b, c, d] = address.octets();
    [2, 0, a, b, c, d]
}

fn mtu(name: &str) -> u32 {
    let reported = std::fs::read_to_string(format!("/sys/class/net/{name}/mtu"));
    reported.ok().and_then(|text| text.trim().parse().ok()).unwrap_or(USUAL_MTU)
}

/// Returns the control port. Without sharing: a second camera on the same address is refused by the system.
pub(super) fn control_socket(address: Ipv4Addr, port: u16) -> Result<UdpSocket, Refused> {
    let advice = "; another camera may have it: take another address (127.0.0.2, ...) or port";
    let open = || {
        let socket = UdpSocket::bind((address, port))?;
        socket.set_nonblocking(true)?;
        Ok(socket)
    };
    open().map_err(|source| system(address, "open the control port", source, advice))
}

/// Returns the port that messages come from.
pub(super) fn message_socket(address: Ipv4Addr) -> Result<UdpSocket, Refused> {
    let open = || {
        let socket = UdpSocket::bind((address, 0))?;
        socket.set_nonblocking(true)?;
        Ok(socket)
    };
    open().map_err(|source| system(address, "open the message port", source, ""))
}

/// Returns a socket that receives broadcasts to a port, beside other cameras that receive the same.
pub(super) fn broadcast_socket(broadcast: Ipv4Addr, port: u16) -> io::Result<UdpSocket> {
    let socket = socket(AddressFamily::INET, SocketType::DGRAM, None)?;
    set_socket_reuseaddr(&socket, true)?;
    set_socket_broadcast(&socket, true)?;
    bind(&socket, &SocketAddrV4::new(broadcast, port))?;
    let socket = UdpSocket::from(socket);
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// Returns the port that packets come from. They are never fragmented.
pub(super) fn stream_socket(address: Ipv4Addr) -> Result<UdpSocket, Refused> {
    let open = || {
        let socket = UdpSocket::bind((address, 0))?;
        set_ip_mtu_discover(&socket, Ipv4PathMtuDiscovery::DO)?;
        // Without this a socket that is not connected never gets the error that no program receives its packets.
        setsockopt(&socket, sockopt::Ipv4RecvErr, &true)?;
        set_socket_send_buffer_size(&socket, SEND_BUFFER_BYTES)?;
        set_socket_timeout(&socket, rustix::net::sockopt::Timeout::Send, Some(SEND_PATIENCE))?;
        Ok(socket)
    };
    open().map_err(|source| system(address, "open the stream's port", source, ""))
}

pub(super) fn system(address: Ipv4Addr, doing: &'static str, source: io::Error, advice: &'static str) -> Refused {
    Refused(format!("network camera at {address}: cannot {doing} ({source}){advice}"))
}

// Reads the network's answers to sent packets: "destination unreachable" (ICMP type 3).
//
// Linux keeps such answers in the socket's error queue, each with the address that the packet went to (`man 7 ip`,
// IP_RECVERR). Only answers from the network count, not errors of this machine, and "fragmentation needed" is not an
// absent receiver. Proven by `outputs::network_camera::tests`.

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_has_many_addresses_and_others_are_refused_with_those_there_are() {
        let interface = Interface::of(Ipv4Addr::new(127, 0, 0, 3)).unwrap();
        assert_eq!((interface.mask, interface.mac), (Ipv4Addr::new(255, 0, 0, 0), [2, 0, 127, 0, 0, 3]));
        assert_eq!(interface.broadcast(), Ipv4Addr::new(127, 255, 255, 255));
        assert!(interface.mtu >= 1500, "{interface:?}");
        let error = Interface::of(Ipv4Addr::new(203, 0, 113, 9)).unwrap_err().to_string();
        assert!(error.contains("203.0.113.9") && error.contains("127.0.0.1"), "{error}");
    }

    #[test]
    fn labels_belong_to_their_interface() {
        assert_eq!(["eth0", "eth0:1", "lo:a:b"].map(base_name), ["eth0", "eth0", "lo"]);
        assert_eq!(mtu(base_name("lo:camera")), mtu("lo"));
    }

    #[test]
    fn an_interface_whose_packets_are_too_small_is_refused() {
        let of = |mtu| {
            let address = Ipv4Addr::new(10, 0, 0, 1);
            let mask = Ipv4Addr::new(255, 255, 255, 0);
            Interface { name: "tun0".into(), address, mask, mac: [0; 6], mtu }.packet_bytes_max()
        };
        assert_eq!((of(576).unwrap(), of(1502).unwrap(), of(65_536).unwrap()), (576, 1500, 65_532));
        let reported = of(575).unwrap_err().to_string();
        assert!(reported.contains("tun0") && reported.contains("575") && reported.contains("576"), "{reported}");
    }

    #[test]
    fn a_port_that_is_taken_is_reported() {
        let first = control_socket(Ipv4Addr::LOCALHOST, 0).unwrap();
        let error = control_socket(Ipv4Addr::LOCALHOST, first.local_addr().unwrap().port()).unwrap_err();
        assert!(error.to_string().contains("another camera"), "{error}");
    }
}
