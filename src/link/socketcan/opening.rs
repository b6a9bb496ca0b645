//! Name of an interface -> a bound socket with every option set, or the reason and advice.

use super::{SocketCanParams, filters::filters, raw_frame::FD_BYTES};
use crate::{LinkError, receive_buffer};
use nix::sys::socket::sockopt::{RxqOvfl, SocketError, Timestamping};
use nix::sys::socket::{
    AddressFamily, SockFlag, SockProtocol, SockType, TimestampingFlag, getsockopt, setsockopt, socket,
};
use socketcan::id::ERR_MASK_ALL;
use socketcan::socket::{CAN_RAW_FD_FRAMES, SOL_CAN_RAW};
use socketcan::{CanAddr, CanFdSocket, Socket as _, SocketOptions as _};
use std::io;

const NO_CAN: &str = "; this kernel has no CAN: `modprobe can_raw`, and `modprobe vcan` for a virtual bus";
const NO_INTERFACE: &str = "; see `ip link show type can`, bring one up with `ip link set can0 up type can bitrate \
    500000`, or make a virtual one with `ip link add vcan0 type vcan && ip link set vcan0 mtu 72 up`";
const NOT_UP: &str = "; bring it up: `ip link set can0 up type can bitrate 500000` (for CAN FD add `dbitrate 2000000 fd \
    on`)";
const NOT_FD: &str = "; set it up for CAN FD while it is down: `ip link set can0 up type can bitrate 500000 dbitrate \
    2000000 fd on`, or `ip link set vcan0 mtu 72` for a virtual one; or use classic CAN";

/// Opens, configures and binds the socket; filters come before the binding, so that no frame gets past them.
pub(super) fn open(params: &SocketCanParams) -> Result<CanFdSocket, LinkError> {
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
    receive_buffer::enlarge(socket)
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
