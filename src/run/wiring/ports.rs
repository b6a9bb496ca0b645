//! The links of a checked bench -> the stimulator's ports, and the far end's if it is simulated too.

use crate::wiring::{bench_parts, plain_ends, tracker_outs};
use crate::{runtime::edge_thread::TriggerChip, wiring::trigger_lines::open_chips};
use anyhow::{Context, Result};
use base::clock::{Clock, PairedReading};
use base::time::Span;
use config::{self, Bench, Carrier, GatewayPorts, Link, Wire};
use firmware_protocol::can::IdMap;
use link::gateway::{GatewayParams, Gateways};
use link::serial::{FlowControl, Parity, SerialLink, SerialParams, StopBits};
use link::socketcan::{Receives, SocketCanLink, SocketCanParams};
use link::{Link as LinkEnd, LinkError, Port};
use link::{pps::Pps, simulated::SimulatedBus, udp::UdpLink};
use std::{path::Path, sync::Arc};

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
    let (_, format) = bench_parts::bus_of(link);
    let port = Port::new(end, format, link.ids);
    match &link.plain {
        Some(plain) => port.with_layout(plain.layout.clone()),
        None => port,
    }
}

fn open(link: &Link, number: usize, wants_far: bool, clock: &Arc<dyn Clock>, tap: Tap<'_>) -> Result<Opened> {
    let ids = link.ids;
    let (params, _) = bench_parts::bus_of(link);
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
        Carrier::SerialPort(settings) => {
            let end = |path: &Path| SerialLink::open(serial_params(settings, path, link.bit_rate), clock);
            let near = port_over(tap(near_end, Box::new(end(&settings.port)?)), link);
            let far_port = settings.far_port.as_deref().filter(|_| wants_far);
            let far = far_port.map(end).transpose()?;
            let far = far.map(|far| port_over(tap(End::Far, Box::new(far)), link));
            Ok(Opened { near, far, bus: None, gateways: None, notes: Vec::new() })
        }
        Carrier::Udp { listen } => {
            let end = UdpLink::open(plain_ends::udp(*listen, link), clock)?;
            let far = wants_far.then(|| plain_ends::far_udp(end.address(), clock)).transpose()?;
            let notes = plain_ends::notes("udp", end.address());
            let far = far.map(|far| port_over(tap(End::Far, Box::new(far)), link));
            Ok(Opened { near: port_over(tap(near_end, Box::new(end)), link), far, bus: None, gateways: None, notes })
        }
        Carrier::Tcp { address, connects } => {
            let near = plain_ends::tcp(*address, *connects, link);
            let (mut end, far) = plain_ends::open_tcp(near, wants_far, clock)?;
            if let Some(reader) = plain_ends::reader(link) {
                end = end.with_reader(reader);
            }
            let notes = if *connects { Vec::new() } else { plain_ends::notes("tcp", end.address()) };
            let far = far.map(|far| port_over(tap(End::Far, Box::new(far)), link));
            Ok(Opened { near: port_over(tap(near_end, Box::new(end)), link), far, bus: None, gateways: None, notes })
        }
    }
}

fn gateways(
    gateway_ports: &GatewayPorts,
    bus: &SimulatedBus,
    clock: &Arc<dyn Clock>,
) -> Result<Option<Gateways>, LinkError> {
    if *gateway_ports == GatewayPorts::default() {
        return Ok(None);
    }
    let GatewayPorts { slcan_tcp, slcan_pty, socketcand } = gateway_ports.clone();
    let params = GatewayParams { slcan_tcp, slcan_pty, socketcand, ..GatewayParams::default() };
    Gateways::start(bus, &params, clock).map(Some)
}

fn can_link(
    interface: &str,
    ids: IdMap,
    receives: Receives,
    wire: Wire,
    clock: &Arc<dyn Clock>,
) -> Result<SocketCanLink, LinkError> {
    let fd = wire == Wire::CanFd;
    let params = SocketCanParams { interface: interface.into(), ids, receives, fd, bit_rate_switch: true };
    SocketCanLink::open(params, clock)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the config's rates are checked")]
fn serial_params(settings: &config::SerialPort, path: &Path, bit_rate: f64) -> SerialParams {
    SerialParams {
        path: path.to_path_buf(),
        baud: bit_rate as u32,
        parity: match settings.parity {
            config::Parity::None => Parity::None,
            config::Parity::Even => Parity::Even,
            config::Parity::Odd => Parity::Odd,
        },
        stop_bits: if settings.stop_bits == 2 { StopBits::Two } else { StopBits::One },
        flow: match settings.flow_control {
            config::FlowControl::None => FlowControl::None,
            config::FlowControl::Hardware => FlowControl::Hardware,
        },
    }
}

/// Returns the reason why a bench cannot be run on the virtual clock, if there is one.
pub fn needs_real_clock(bench: &Bench) -> Option<&'static str> {
    let has_gateways = |link: &Link| matches!(&link.carrier, Carrier::Simulated(gateway_ports) if *gateway_ports != GatewayPorts::default());
    let is_real = |link: &Link| !matches!(link.carrier, Carrier::Simulated(_));
    let any = |is: &dyn Fn(&Link) -> bool| core::iter::once(&bench.link).chain(&bench.extra_links).any(is);
    if any(&is_real) {
        Some("a real bus")
    } else if any(&has_gateways) {
        Some("gateways")
    } else if !bench.trigger_lines.is_empty() {
        Some("[[trigger_line]], a GPIO line")
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
