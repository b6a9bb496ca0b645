//! Programs outside on a simulated bus: slcan over TCP and over a PTY, socketcand over TCP.
//!
//! ```text
//! python-can, can-utils, a terminal <-> slcan or socketcand <-> one end of the bus per client
//! ```
//!
//! Real clock only, and nothing real-time: threads that block, bounded queues, every loss and refusal counted. A
//! gateway listens on the configured address, which should be loopback: access is without a password. Web pages can
//! reach loopback too, so a TCP client that speaks HTTP or TLS is disconnected before any of its lines is obeyed
//! (`screen`), and a client that does not open the bus loses its place (`OPENING_WITHIN`, `GRACE`). A frame of a client
//! takes its place in the arbitration like any other; the frames of one client reach the others and not itself. Tests:
//! `hil_scripts/test_gateways.py` with python-can and with a browser, and those of the parsers beside their code.

mod address;
mod admission;
mod client;
mod counters;
#[cfg(test)]
mod end_tests;
mod hex;
mod outgoing;
#[cfg(test)]
mod parser_checks;
mod pty;
mod refusal;
pub(crate) mod screen;
/// The protocol of serial CAN adapters.
pub mod slcan;
/// The protocol of the daemon of that name.
pub mod socketcand;
mod tcp;
#[cfg(test)]
mod tests;

use crate::{LinkError, simulated::SimulatedBus};
use base::{clock::Clock, time::Span};
use client::{Dialogue, Scribe};
use core::sync::atomic::{AtomicBool, Ordering};
use counters::Tally;
use pty::Pty;
use refusal::system;
use std::path::{Path, PathBuf};
use std::{net::SocketAddr, sync::Arc, thread::JoinHandle};
use tcp::{Hall, Protocol};

pub use address::{GatewayAddress, NoTcpAddress, TcpAddress};
pub use admission::{GRACE, MALFORMED_MAX, OPENING_WITHIN};
pub use counters::GatewayCounters;
pub use pty::LinkedTerminal;
pub use screen::{Foreign, Screen};

/// Clients that socketcand serves at once.
pub const SOCKETCAND_CLIENTS_MAX: usize = 4;
/// Message to a second client of a serial line.
const LINE_IN_USE: &[u8] = b"\x07in use: one client at a time\r";
/// Message to a fifth client of socketcand.
const DAEMON_FULL: &[u8] = b"< error too many clients >";

/// Gateways that are configured.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GatewayParams {
    /// slcan over TCP here; port 0 takes a free one.
    pub slcan_tcp: Option<SocketAddr>,
    /// slcan over a PTY: a symbolic link to it is made here, and removed at the end.
    pub slcan_pty: Option<PathBuf>,
    /// socketcand here; port 0 takes a free one.
    pub socketcand: Option<SocketAddr>,
    /// Name under which socketcand knows the bus.
    pub bus_name: String,
    /// A client that has read nothing for so long while something waited for it is dropped.
    pub patience: Span,
    /// A TCP client that has not opened the bus within this time is dropped.
    pub opening_within: Span,
}

impl Default for GatewayParams {
    fn default() -> Self {
        let (slcan_tcp, slcan_pty, socketcand) = (None, None, None);
        let (patience, opening_within) = (Span::from_ms(2000), OPENING_WITHIN);
        Self { slcan_tcp, slcan_pty, socketcand, bus_name: "can0".into(), patience, opening_within }
    }
}

/// A kind of gateway.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GatewayKind {
    /// slcan over TCP.
    SlcanTcp,
    /// slcan over a PTY.
    SlcanPty,
    /// socketcand over TCP.
    Socketcand,
}

/// Gateways at work. Dropped, they hang up, leave the bus and take their link away.
pub struct Gateways {
    ended: Arc<AtomicBool>,
    listeners: Vec<JoinHandle<()>>,
    pty: Option<Pty>,
    at_work: Vec<(GatewayKind, GatewayAddress, Arc<Tally>)>,
}

impl Gateways {
    /// Starts those that are wanted.
    ///
    /// # Errors
    /// When the clock is virtual, the bus is a serial line, or the system refuses an address, a path or a thread.
    pub fn start(bus: &SimulatedBus, params: &GatewayParams, clock: &Arc<dyn Clock>) -> Result<Self, LinkError> {
        check(bus, clock)?;
        let ended = Arc::new(AtomicBool::new(false));
        let mut gateways = Self { ended, listeners: Vec::new(), pty: None, at_work: Vec::new() };
        if let Some(address) = params.slcan_tcp {
            let hall = gateways.hall("slcan over TCP", slcan_protocol(bus), bus, params, clock);
            gateways.listen(GatewayKind::SlcanTcp, hall, address)?;
        }
        if let Some(address) = params.socketcand {
            let hall = gateways.hall("socketcand", socketcand_protocol(params, clock), bus, params, clock);
            gateways.listen(GatewayKind::Socketcand, hall, address)?;
        }
        if let Some(path) = &params.slcan_pty {
            gateways.open_pty(path, bus, params, clock)?;
        }
        Ok(gateways)
    }

    fn hall(
        &self,
        name: &'static str,
        protocol: Protocol,
        bus: &SimulatedBus,
        params: &GatewayParams,
        clock: &Arc<dyn Clock>,
    ) -> Hall {
        let (bus, clock, ended) = (bus.clone(), Arc::clone(clock), Arc::clone(&self.ended));
        let (patience, opening_within) = (params.patience, params.opening_within);
        Hall { name, protocol, bus, clock, tally: Arc::default(), patience, opening_within, ended }
    }

    fn listen(&mut self, kind: GatewayKind, hall: Hall, address: SocketAddr) -> Result<(), LinkError> {
        let tally = Arc::clone(&hall.tally);
        let (address, listener) = tcp::listen(hall, address)?;
        self.listeners.push(listener);
        self.at_work.push((kind, GatewayAddress::Tcp(address), tally));
        Ok(())
    }

    fn open_pty(
        &mut self,
        path: &Path,
        bus: &SimulatedBus,
        params: &GatewayParams,
        clock: &Arc<dyn Clock>,
    ) -> Result<(), LinkError> {
        let tally = Arc::default();
        let pty = pty::open(path, bus, clock, &tally, params.patience, &self.ended)?;
        self.at_work.push((GatewayKind::SlcanPty, GatewayAddress::Pty(pty.link.path().to_path_buf()), tally));
        self.pty = Some(pty);
        Ok(())
    }

    /// Returns where each gateway is found.
    pub fn addresses(&self) -> Vec<(GatewayKind, GatewayAddress)> {
        self.at_work.iter().map(|(kind, address, _)| (*kind, address.clone())).collect()
    }

    /// Ends them; returns how many of their threads were lost. Once; dropping them does the same.
    pub fn finish(&mut self) -> u64 {
        self.ended.store(true, Ordering::Release);
        for listener in self.listeners.drain(..) {
            let _ = listener.join(); // one that panicked has counted itself
        }
        if let Some(pty) = &mut self.pty {
            pty.join();
        }
        self.counters().iter().map(|(_, counters)| counters.lost_threads).sum()
    }

    /// Returns the counters of each gateway.
    pub fn counters(&self) -> Vec<(GatewayKind, GatewayCounters)> {
        self.at_work.iter().map(|(kind, _, tally)| (*kind, tally.lock().clone())).collect()
    }
}

impl Drop for Gateways {
    fn drop(&mut self) {
        self.finish();
    }
}

fn slcan_protocol(bus: &SimulatedBus) -> Protocol {
    let timing = bus.params().timing;
    let new_client = Box::new(move || {
        let channel: Box<dyn Dialogue> = Box::new(slcan::Channel::new(&timing));
        (channel, pty::slcan_scribe())
    });
    Protocol { clients_max: 1, full: LINE_IN_USE, new_client }
}

fn socketcand_protocol(params: &GatewayParams, clock: &Arc<dyn Clock>) -> Protocol {
    let (name, tai_minus_utc_s) = (params.bus_name.clone(), socketcand::tai_minus_utc_s(clock.now()));
    let new_client = Box::new(move || {
        let session: Box<dyn Dialogue> = Box::new(socketcand::Session::new(&name));
        let scribe: Scribe = Box::new(move |packet, _, out| socketcand::element(packet, tai_minus_utc_s, out));
        (session, scribe)
    });
    Protocol { clients_max: SOCKETCAND_CLIENTS_MAX, full: DAEMON_FULL, new_client }
}

fn check(bus: &SimulatedBus, clock: &Arc<dyn Clock>) -> Result<(), LinkError> {
    let unsupported = |why: &str| std::io::Error::new(std::io::ErrorKind::Unsupported, why.to_owned());
    if !clock.is_real() {
        let advice = "; programs outside live on the real clock: use it";
        return Err(system("gateways", "serve clients", unsupported("the clock is virtual"), advice));
    }
    if !bus.params().timing.is_shared() {
        let advice = "; use a CAN wire";
        return Err(system("gateways", "serve clients", unsupported("the bus is a serial line"), advice));
    }
    Ok(())
}
