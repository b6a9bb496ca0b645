//! CAN and CAN FD through the kernel's raw sockets: frames of one interface, stamped by the kernel <-> `Link`.
//!
//! Stamps: the adapter's own where it gives any, the kernel's at the end of the receive interrupt otherwise
//! (`kernel_stamp`); both are placed on the bench clock when the frame is fetched. A virtual interface (`vcan`) has
//! neither bit times nor an adapter: its stamp is the instant of sending.
//!
//! * The kernel forwards only data frames with the identifiers that this side receives (`Receives`), and error
//!   frames. Error frames are counted and not delivered.
//! * The receive buffer is enlarged; frames that the kernel drops all the same are counted as overflow.
//! * A frame that finds the interface's queue full is given up and counted; nothing waits behind it.
//! * An interface that is taken down or unplugged is counted as lost, and looked for every `RETRY` until it is back.
//!   Frames to be sent meanwhile are given up and counted. At the start its absence is an error.
//! * Waiting is done in `poll`; nothing spins, and a frame costs no allocation.
//!
//! Sources: Linux `Documentation/networking/can.rst` (sockets, filters, error frames, FD), `timestamping.rst`.
//! Tests: `tests` here (layout, filters, error frames), `hil_scripts/tests/test_vcan.py` on a kernel with CAN.

mod hardware_clock;
mod link;
mod socket;

pub use link::SocketCanLink;
pub use socket::Receives;

use self::socket::{FD_BYTES, filters};
use crate::{LinkError, readiness};
use base::time::Span;
use firmware_protocol::can::IdMap;
use nix::sys::socket::sockopt::{RxqOvfl, SocketError, Timestamping};
use nix::sys::socket::{
    AddressFamily, SockFlag, SockProtocol, SockType, TimestampingFlag, getsockopt, setsockopt, socket,
};
use socketcan::id::ERR_MASK_ALL;
use socketcan::socket::{CAN_RAW_FD_FRAMES, SOL_CAN_RAW};
use socketcan::{CanAddr, CanFdSocket, Socket as _, SocketOptions as _};
use std::io;

// Name of an interface -> a bound socket with every option set, or the reason and advice.

const NO_CAN: &str = "; this kernel has no CAN: `modprobe can_raw`, and `modprobe vcan` for a virtual bus";
const NO_INTERFACE: &str = "; see `ip link show type can`, bring one up with `ip link set can0 up type can bitrate \
    500000`, or make a virtual one with `ip link add vcan0 type vcan && ip link set vcan0 mtu 72 up`";
const NOT_UP: &str = "; bring it up: `ip link set can0 up type can bitrate 500000` (for CAN FD add `dbitrate 2000000 fd \
    on`)";
const NOT_FD: &str = "; set it up for CAN FD while it is down: `ip link set can0 up type can bitrate 500000 dbitrate \
    2000000 fd on`, or `ip link set vcan0 mtu 72` for a virtual one; or use classic CAN";

/// Opens, configures and binds the socket; filters come before the binding, so that no frame gets past them.
fn open(params: &SocketCanParams) -> Result<CanFdSocket, LinkError> {
    let failed = |doing, source: io::Error, advice| {
        Err(LinkError::System { link: params.interface.clone(), doing, source, advice })
    };
    let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
    let socket = match socket(AddressFamily::Can, SockType::Raw, flags, SockProtocol::CanRaw) {
        Ok(descriptor) => CanFdSocket::from(descriptor),
        Err(error @ (nix::Error::EAFNOSUPPORT | nix::Error::EPROTONOSUPPORT)) => {
            return failed("open a CAN socket", error.into(), NO_CAN);
        }
        Err(error) => return failed("open a CAN socket", error.into(), ""),
    };
    if let Err(error) = set_options(&socket, params) {
        return failed("set the socket's options", error, "");
    }
    let address = match CanAddr::from_iface(&params.interface) {
        Ok(address) => address,
        Err(error) => return failed("find the interface", error, NO_INTERFACE),
    };
    if let Err(error) = socket.as_raw_socket().bind(&address.into_sock_addr()) {
        return failed("bind to the interface (is it a CAN interface?)", error, NO_INTERFACE);
    }
    // The kernel binds to an interface that is down, and says so in the socket's pending error.
    match getsockopt(&socket, SocketError) {
        Ok(0) => {}
        Ok(pending) => return failed("use the interface", io::Error::from_raw_os_error(pending), NOT_UP),
        Err(error) => return failed("use the interface", error.into(), ""),
    }
    match mtu(&params.interface) {
        Some(mtu) if params.fd && mtu < FD_BYTES => {
            let got = io::Error::other(format!("its MTU is {mtu}, wanted {FD_BYTES}"));
            failed("send CAN FD on the interface", got, NOT_FD)
        }
        _ => Ok(socket),
    }
}

fn set_options(socket: &CanFdSocket, params: &SocketCanParams) -> io::Result<()> {
    socket.set_filters(&filters(&params.ids, params.receives))?;
    socket.set_error_filter(ERR_MASK_ALL)?;
    // Other programs on this machine receive the sent frames; the socket itself does not.
    socket.set_loopback(true)?;
    socket.set_recv_own_msgs(false)?;
    socket.set_socket_option_int(SOL_CAN_RAW, CAN_RAW_FD_FRAMES, i32::from(params.fd))?;
    setsockopt(socket, Timestamping, &stamps_wanted())?;
    setsockopt(socket, RxqOvfl, &1)?;
    readiness::enlarge(socket)
}

/// Returns the adapter's raw stamp where there is one; the kernel's always.
fn stamps_wanted() -> TimestampingFlag {
    TimestampingFlag::SOF_TIMESTAMPING_RX_SOFTWARE
        | TimestampingFlag::SOF_TIMESTAMPING_SOFTWARE
        | TimestampingFlag::SOF_TIMESTAMPING_RX_HARDWARE
        | TimestampingFlag::SOF_TIMESTAMPING_RAW_HARDWARE
}

/// Returns the MTU of an interface; `None` where the system does not show it: then the first FD frame is refused.
fn mtu(interface: &str) -> Option<usize> {
    let text = std::fs::read_to_string(format!("/sys/class/net/{interface}/mtu")).ok()?;
    text.trim().parse().ok()
}

#[cfg(test)]
mod tests;

/// A lost interface is looked for this often.
pub const RETRY: Span = Span::from_ms(200);

/// Parameters of an interface.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SocketCanParams {
    /// Name of the interface, such as `can0`.
    pub interface: String,
    /// Identifiers of the node.
    pub ids: IdMap,
    /// Side whose messages the kernel forwards.
    pub receives: Receives,
    /// True for CAN FD: the interface must have an MTU of 72. Classic frames pass as well.
    pub fd: bool,
    /// FD frames switch to the data bit rate after arbitration. Without it they stay at the arbitration rate.
    pub bit_rate_switch: bool,
}
