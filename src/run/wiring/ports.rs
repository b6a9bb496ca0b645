//! The links of a checked bench -> the stimulator's ports, and the far end's if it is simulated too.
//!
//! The GPIO lines of a bench -> chips to listen to, and heads that wait for their edges.
//!
//! A checked plain link -> its ends over UDP or TCP, and the address for external programs.

use crate::runtime::link_thread::TriggerChip;
use crate::runtime::{Head, Ledger};
use crate::wiring::{bench_parts, tracker_outs};
use anyhow::{Context, Result, bail};
use base::clock::{Clock, PairedReading};
use base::time::Span;
use config::{Bench, Carrier, Link, Plain, TriggerLine};
use firmware_protocol::can::IdMap;
use frames::camera_control::{CameraCommand, CommandSource, Commanded};
use link::gateway::{GatewayParams, Gateways};
use link::plain::{Encoding, PlainLayout};
use link::serial::{SerialLink, SerialParams};
use link::socketcan::{Receives, SocketCanLink, SocketCanParams};
use link::tcp::{Framing, IsMessage, TcpLink, TcpParams, TcpRole};
use link::udp::{UdpLink, UdpParams};
use link::{Link as LinkEnd, LinkError, Port, WireFormat};
use link::{gpio::GpioChip, pps::Pps, simulated::SimulatedBus};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An open cable.
pub struct Cable {
    /// The stimulator's ports; at least one.
    pub near: Vec<Port>,
    /// The simulated far end's port, until the far end takes it.
    pub far: Option<Port>,
    /// The simulated bus of the first link, where it is one.
    pub bus: Option<SimulatedBus>,
    /// Pulses of the flight computer's clock.
    pub pulses: Option<Pps>,
    /// Chips with lines that trigger cameras, until the run takes them.
    pub chips: Vec<TriggerChip>,
    /// Gateways to the simulated buses; they close when this is dropped.
    pub(super) gateways: Vec<Gateways>,
    /// Addresses of plain links for external simulators, in words.
    pub(super) notes: Vec<String>,
}

/// One end of one link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The stimulator's end of a link, counted from 0: the bench's link, then its extra links.
    Near(usize),
    /// The simulated flight computer's end of the first link.
    Far,
}

/// Wrapper between an end of a link and its port, such as faults or a capture.
pub type Tap<'a> = &'a mut dyn FnMut(End, Box<dyn LinkEnd>) -> Box<dyn LinkEnd>;

/// Opens every link of a bench; `tap` wraps every end before its port.
///
/// # Errors
/// When a link cannot be opened, with what to try.
pub(super) fn open_ports(bench: &Bench, clock: &Arc<dyn Clock>, tap: Tap<'_>) -> Result<Cable> {
    let wants_far = !bench.flight_computer.is_external;
    let first = open(&bench.link, 0, wants_far, clock, tap).context("[link]")?;
    let (gateways, near, pulses) = (Vec::new(), Vec::new(), None);
    let chips = open_chips(bench, &**clock)?;
    let mut cable = Cable { gateways, pulses, chips, near, far: first.far, bus: first.bus, notes: first.notes };
    cable.near.push(first.near);
    cable.gateways.extend(first.gateways);
    for (i, link) in bench.extra_links.iter().enumerate() {
        let opened = open(link, i + 1, false, clock, tap).with_context(|| format!("[[extra_link]] {i}"))?;
        let longer_us = link.latency_us - bench.link.latency_us;
        cable.near.push(opened.near.less_delay(Span::from_s(longer_us * 1e-6)));
        cable.gateways.extend(opened.gateways);
    }
    let source = core::iter::once(&bench.link).chain(&bench.extra_links).find_map(|link| link.pps.as_ref());
    cable.pulses = source.map(|path| Pps::open(path, PairedReading::take(&**clock))).transpose()?;
    Ok(cable)
}

/// One open link.
struct Opened {
    near: Port,
    far: Option<Port>,
    bus: Option<SimulatedBus>,
    gateways: Option<Gateways>,
    notes: Vec<String>,
}

/// Returns a port over an end of a link, with the link's identifiers and layout.
pub(super) fn port_over(end: Box<dyn LinkEnd>, link: &Link) -> Port {
    let port = Port::new(end, link.wire, link.ids);
    match &link.plain {
        Some(plain) => port.with_layout(plain.layout.clone()),
        None => port,
    }
}

fn open(link: &Link, number: usize, wants_far: bool, clock: &Arc<dyn Clock>, tap: Tap<'_>) -> Result<Opened> {
    let ids = link.ids;
    let params = bench_parts::bus_of(link);
    let near_end = End::Near(number);
    match &link.carrier {
        Carrier::Simulated(gateway_ports) => {
            let bus = SimulatedBus::new(params, clock);
            let near = port_over(tap(near_end, Box::new(bus.attach())), link);
            let far = wants_far.then(|| port_over(tap(End::Far, Box::new(bus.attach())), link));
            let gateways = gateways(gateway_ports, &bus, clock)?;
            Ok(Opened { near, far, bus: Some(bus), gateways, notes: Vec::new() })
        }
        Carrier::SocketCan { interface } => {
            let end = |receives| can_link(interface, ids, receives, link.wire, clock);
            let near = tap(near_end, Box::new(end(Receives::FlightComputer)?));
            let far = wants_far.then(|| end(Receives::Stimulator)).transpose()?;
            let far = far.map(|far| port_over(tap(End::Far, Box::new(far)), link));
            Ok(Opened { near: port_over(near, link), far, bus: None, gateways: None, notes: Vec::new() })
        }
        Carrier::SerialPort { port, far_port } => {
            let near = port_over(tap(near_end, Box::new(SerialLink::open(port.clone(), clock)?)), link);
            let far_port = far_port.as_ref().filter(|_| wants_far);
            let far_end = |path: &PathBuf| SerialLink::open(SerialParams { path: path.clone(), ..port.clone() }, clock);
            let far = far_port.map(far_end).transpose()?;
            let far = far.map(|far| port_over(tap(End::Far, Box::new(far)), link));
            Ok(Opened { near, far, bus: None, gateways: None, notes: Vec::new() })
        }
        Carrier::Udp { listen } => {
            let end = UdpLink::open(plain_udp(*listen, link), clock)?;
            let far = wants_far.then(|| plain_far_udp(end.address(), clock)).transpose()?;
            let notes = plain_notes("udp", end.address());
            let far = far.map(|far| port_over(tap(End::Far, Box::new(far)), link));
            Ok(Opened { near: port_over(tap(near_end, Box::new(end)), link), far, bus: None, gateways: None, notes })
        }
        Carrier::Tcp { address, connects } => {
            let near = plain_tcp(*address, *connects, link);
            let (mut end, far) = plain_open_tcp(near, wants_far, clock)?;
            if let Some(reader) = plain_reader(link) {
                end = end.with_reader(reader);
            }
            let notes = if *connects { Vec::new() } else { plain_notes("tcp", end.address()) };
            let far = far.map(|far| port_over(tap(End::Far, Box::new(far)), link));
            Ok(Opened { near: port_over(tap(near_end, Box::new(end)), link), far, bus: None, gateways: None, notes })
        }
    }
}

fn gateways(params: &GatewayParams, bus: &SimulatedBus, clock: &Arc<dyn Clock>) -> Result<Option<Gateways>, LinkError> {
    if *params == GatewayParams::default() {
        return Ok(None);
    }
    Gateways::start(bus, params, clock).map(Some)
}

fn can_link(
    interface: &str,
    ids: IdMap,
    receives: Receives,
    wire: WireFormat,
    clock: &Arc<dyn Clock>,
) -> Result<SocketCanLink, LinkError> {
    let fd = wire == WireFormat::CanFd;
    let params = SocketCanParams { interface: interface.into(), ids, receives, fd, bit_rate_switch: true };
    SocketCanLink::open(params, clock)
}

/// Returns the reason why a bench cannot be run on the virtual clock, if there is one.
pub fn needs_real_clock(bench: &Bench) -> Option<&'static str> {
    let has_gateways = |link: &Link| matches!(link.carrier, Carrier::Simulated(_)) && !link.has_no_gateway();
    let is_real = |link: &Link| !matches!(link.carrier, Carrier::Simulated(_));
    let any = |is: &dyn Fn(&Link) -> bool| core::iter::once(&bench.link).chain(&bench.extra_links).any(is);
    if any(&is_real) {
        Some("a real bus")
    } else if any(&has_gateways) {
        Some("gateways")
    } else if !bench.trigger_lines.is_empty() {
        Some("[[trigger_line]], a GPIO line")
    } else if !bench.tracker_ins.is_empty() {
        Some("[[tracker_in]], a star tracker outside")
    } else {
        tracker_outs::needs_real_clock(&bench.tracker_outs)
    }
}

/// Returns the reason why the spacecraft of a bench cannot be moved, if there is one: its plant is external, no bus
/// leads there, and the run is not controlled by a client that could send its attitudes.
pub fn is_unreachable(bench: &Bench, is_controlled: bool) -> Option<&'static str> {
    let why = "link.kind is \"simulated\" without gateways, and the plant is outside: no other program can reach a bus inside this \
               program; wanted slcan_tcp, slcan_pty or socketcand, or a real bus, or --control ADDRESS, whose client sends the \
               attitudes (lockstep with --clock virtual)";
    (bench.is_lockstep() && !is_controlled).then_some(why)
}

/// Opens each chip that a line names, with all its lines.
///
/// # Errors
/// When a chip or a line does not exist, or is in use by another program.
pub(super) fn open_chips(bench: &Bench, clock: &dyn Clock) -> Result<Vec<TriggerChip>> {
    let mut chips: Vec<&Path> = bench.trigger_lines.iter().map(|line| line.chip.as_path()).collect();
    chips.sort_unstable();
    chips.dedup();
    let open = |path: &Path| {
        let of_chip: Vec<&TriggerLine> = bench.trigger_lines.iter().filter(|line| line.chip == path).collect();
        let lines: Vec<_> = of_chip.iter().map(|line| line.line.clone()).collect();
        let chip = GpioChip::open(path, &lines, PairedReading::take(clock)).context("[[trigger_line]]")?;
        Ok(TriggerChip { chip, heads: of_chip.iter().map(|line| line.head).collect() })
    };
    chips.into_iter().map(open).collect()
}

/// Makes heads wait for the edges of their lines from the first exposure on.
///
/// # Errors
/// When a line triggers a head that the run does not have, or one that cannot be commanded.
pub(super) fn arm(bench: &Bench, heads: &mut [Head]) -> Result<()> {
    let count = heads.len();
    for (place, line) in bench.trigger_lines.iter().enumerate() {
        if let Some(head) = line.head.filter(|head| *head >= count) {
            bail!("trigger_line[{place}].head: got {head}, wanted a head of the run, 0 to {}", count - 1);
        }
        let is_of_line = |number: usize| line.head.is_none_or(|head| head == number);
        for head in heads.iter_mut().enumerate().filter(|(number, _)| is_of_line(*number)).map(|(_, head)| head) {
            let at = head.engine.params.first_exposure;
            let exposing = &mut head.engine.exposing;
            if exposing.range().is_none() {
                bail!(
                    "trigger_line[{place}]: a frame that is drawn for a display has no exposure to start; leave the line out"
                );
            }
            exposing.set_has_line();
            let commands = [CameraCommand::Mode(line.mode), CameraCommand::Triggered(true)];
            for command in commands.into_iter().take(if line.is_armed { 2 } else { 1 }) {
                let commanded = Commanded { command, at, from: CommandSource::Line };
                exposing.take(&commanded, &mut Ledger::default()).context("[[trigger_line]]")?;
            }
        }
    }
    Ok(())
}

/// Returns the stimulator's end over UDP: it learns its sender from messages of the layout.
pub(super) fn plain_udp(listen: SocketAddr, link: &Link) -> UdpParams {
    let Plain { layout, sender_timeout } = plain(link);
    let is_message = Box::new(move |bytes: &[u8]| layout.is_message(bytes));
    UdpParams { sender_timeout, is_message, ..UdpParams::new(listen) }
}

/// Returns the end of a simulated flight computer, on loopback.
pub(super) fn plain_far_udp(near: SocketAddr, clock: &Arc<dyn Clock>) -> Result<UdpLink, LinkError> {
    let peer = reachable(near);
    let own = SocketAddr::new(if peer.is_ipv4() { Ipv4Addr::LOCALHOST.into() } else { peer.ip() }, 0);
    Ok(UdpLink::open(UdpParams::new(own), clock)?.with_peer(peer))
}

/// Returns the stimulator's end over TCP.
pub(super) fn plain_tcp(address: SocketAddr, connects: bool, link: &Link) -> TcpParams {
    let layout = plain(link).layout;
    let framing = layout.record_bytes().map_or(Framing::Lines, Framing::Records);
    let role = if connects { TcpRole::Client(address) } else { TcpRole::Server(address) };
    TcpParams { role, framing, acknowledges: matches!(layout.encoding, Encoding::FortyTwo(_)) }
}

/// Returns what knows the messages of a link over TCP; `None` for lines of 42, where a message has several lines.
pub(super) fn plain_reader(link: &Link) -> Option<IsMessage> {
    let layout = plain(link).layout;
    let is_of_lines = matches!(layout.encoding, Encoding::FortyTwo(_));
    (!is_of_lines).then(|| -> IsMessage { Box::new(move |bytes| layout.is_message(bytes)) })
}

/// Opens the stimulator's end, and that of a simulated flight computer, which has the other role.
pub(super) fn plain_open_tcp(
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
pub(super) fn plain_notes(kind: &str, address: SocketAddr) -> Vec<String> {
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
