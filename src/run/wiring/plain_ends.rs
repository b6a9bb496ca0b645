//! A checked plain link -> its ends over UDP or TCP, and the address for external programs.

use base::{clock::Clock, time::Span};
use config::{Link, Plain};
use link::LinkError;
use link::plain::{Encoding, PlainLayout};
use link::tcp::{Framing, IsMessage, TcpLink, TcpParams, TcpRole};
use link::udp::{UdpLink, UdpParams};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;

/// Returns the stimulator's end over UDP: it learns its sender from messages of the layout.
pub(super) fn udp(listen: SocketAddr, link: &Link) -> UdpParams {
    let Plain { layout, sender_timeout } = plain(link);
    let is_message = Box::new(move |bytes: &[u8]| layout.is_message(bytes));
    UdpParams { sender_timeout, is_message, ..UdpParams::new(listen) }
}

/// Returns the end of a simulated flight computer, on loopback.
pub(super) fn far_udp(near: SocketAddr, clock: &Arc<dyn Clock>) -> Result<UdpLink, LinkError> {
    let peer = reachable(near);
    let own = SocketAddr::new(if peer.is_ipv4() { Ipv4Addr::LOCALHOST.into() } else { peer.ip() }, 0);
    Ok(UdpLink::open(UdpParams::new(own), clock)?.with_peer(peer))
}

/// Returns the stimulator's end over TCP.
pub(super) fn tcp(address: SocketAddr, connects: bool, link: &Link) -> TcpParams {
    let layout = plain(link).layout;
    let framing = layout.record_bytes().map_or(Framing::Lines, Framing::Records);
    let role = if connects { TcpRole::Client(address) } else { TcpRole::Server(address) };
    TcpParams { role, framing, acknowledges: matches!(layout.encoding, Encoding::FortyTwo(_)) }
}

/// Returns what knows the messages of a link over TCP; `None` for lines of 42, where a message has several lines.
pub(super) fn reader(link: &Link) -> Option<IsMessage> {
    let layout = plain(link).layout;
    let is_of_lines = matches!(layout.encoding, Encoding::FortyTwo(_));
    (!is_of_lines).then(|| -> IsMessage { Box::new(move |bytes| layout.is_message(bytes)) })
}

/// Opens the stimulator's end, and that of a simulated flight computer, which has the other role.
pub(super) fn open_tcp(
    near: TcpParams,
    wants_far: bool,
    clock: &Arc<dyn Clock>,
) -> Result<(TcpLink, Option<TcpLink>), LinkError> {
    let far = |role| TcpLink::open(TcpParams { role, ..near }, clock);
    match near.role {
        TcpRole::Client(address) => {
            let far = wants_far.then(|| far(TcpRole::Server(address))).transpose()?;
            Ok((TcpLink::open(near, clock)?, far))
        }
        TcpRole::Server(_) => {
            let end = TcpLink::open(near, clock)?;
            let far = wants_far.then(|| far(TcpRole::Client(reachable(end.address())))).transpose()?;
            Ok((end, far))
        }
    }
}

/// Returns the address of a plain link, and whether other machines can reach it.
pub(super) fn notes(kind: &str, address: SocketAddr) -> Vec<String> {
    let place = format!("link: {kind} at {address}");
    let is_exposed = !address.ip().is_loopback();
    let exposed =
        || format!("starloop: {kind} at {address} can be reached from other machines, and asks for no password");
    core::iter::once(place).chain(is_exposed.then(exposed)).collect()
}

/// Returns an address at which this machine reaches one that may be any of its own.
fn reachable(address: SocketAddr) -> SocketAddr {
    let any = address.ip().is_unspecified();
    SocketAddr::new(if any { IpAddr::V4(Ipv4Addr::LOCALHOST) } else { address.ip() }, address.port())
}

/// Returns the layout of a plain link, which the configuration has checked; the default if there is none.
fn plain(link: &Link) -> Plain {
    let usual = || Plain { layout: PlainLayout::default(), sender_timeout: Span::from_ms(2000) };
    link.plain.clone().unwrap_or_else(usual)
}
