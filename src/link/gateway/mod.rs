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
//! `hil_scripts/tests/test_gateways.py` with python-can and with a browser, and those of the parsers beside their code.

mod address;
mod client;
#[cfg(test)]
mod end_tests;
#[cfg(test)]
mod parser_checks;
mod pty;
pub(crate) mod screen;

pub use address::{GatewayAddress, NoTcpAddress, TcpAddress};
pub use pty::LinkedTerminal;
pub use screen::{Foreign, GRACE, MALFORMED_MAX, OPENING_WITHIN, Screen};

use crate::{LinkError, simulated::SimulatedBus};
use base::{clock::Clock, time::Span};
use client::{Dialogue, Scribe};
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use firmware_protocol::can::CanId;
use pty::Pty;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::{collections::BTreeMap, net::SocketAddr, thread::JoinHandle};
use tcp::{Hall, Protocol};

/// The protocol of serial CAN adapters.
pub mod slcan;
/// The protocol of the daemon of that name.
pub mod socketcand;
mod tcp;

// Errors of the system for a gateway.

/// Returns the error of a link that could not do something.
fn system(link: &str, doing: &'static str, source: std::io::Error, advice: &'static str) -> LinkError {
    LinkError::System { link: link.into(), doing, source, advice }
}

// Hexadecimal digits, without allocation.

/// Returns the value of one digit, in either case.
fn digit(character: u8) -> Option<u8> {
    char::from(character).to_digit(16).and_then(|value| u8::try_from(value).ok())
}

/// Returns the value of one to eight digits.
fn digits(text: &[u8]) -> Option<u32> {
    if text.is_empty() || text.len() > 8 {
        return None;
    }
    text.iter().try_fold(0_u32, |value, character| Some(value << 4 | u32::from(digit(*character)?)))
}

/// Adds `count` upper-case digits of `value`, the highest first.
fn put_digits(out: &mut Vec<u8>, value: u32, count: u32) {
    for place in (0..count).rev() {
        let digit = char::from_digit(value >> (4 * place) & 0xF, 16).unwrap_or('0');
        out.push(digit.to_ascii_uppercase() as u8);
    }
}

/// Adds 3 digits of an identifier of 11 bits, 8 of one with 29.
fn put_id(out: &mut Vec<u8>, id: CanId) {
    put_digits(out, id.number(), if id.is_extended() { 8 } else { 3 });
}

/// Adds two digits per byte.
fn put_bytes(out: &mut Vec<u8>, bytes: &[u8]) {
    bytes.iter().for_each(|byte| put_digits(out, u32::from(*byte), 2));
}

// Frames and clients that the gateways forwarded, lost and refused.

/// Traffic of one gateway.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize)]
pub struct GatewayCounters {
    /// Clients so far.
    pub clients: u64,
    /// Clients now.
    pub connected: u64,
    /// Clients turned away because there were enough.
    pub refused: u64,
    /// Clients dropped because they did not read.
    pub stalled: u64,
    /// Frames from clients, put on the bus.
    pub from_clients: u64,
    /// Frames of the bus, written to clients.
    pub to_clients: u64,
    /// Frames of the bus that a client read too slowly for.
    pub dropped: u64,
    /// FD frames that the protocol cannot carry.
    pub withheld: u64,
    /// Number of refusals by reason.
    pub rejects: BTreeMap<&'static str, u64>,
    /// Threads of this gateway that ended by a panic.
    pub lost_threads: u64,
}

impl GatewayCounters {
    /// Returns everything refused, whatever the reason.
    pub fn rejected(&self) -> u64 {
        self.rejects.values().sum()
    }
}

/// The counters of one gateway, shared by its threads. Nothing real-time comes by here.
#[derive(Debug, Default)]
struct Tally {
    /// Without the frames dropped.
    counters: Mutex<GatewayCounters>,
    /// Frames dropped, which a loop that takes no lock may read.
    dropped: AtomicU64,
}

impl Tally {
    fn lock(&self) -> MutexGuard<'_, GatewayCounters> {
        self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    fn reject(&self, reason: &'static str) {
        *self.lock().rejects.entry(reason).or_default() += 1;
    }
}

/// Counts the thread that holds it as lost when it panics.
struct CountsIfLost(pub(super) Arc<Tally>);

impl Drop for CountsIfLost {
    fn drop(&mut self) {
        self.0.lock().lost_threads += u64::from(std::thread::panicking());
    }
}

#[cfg(test)]
mod tests;

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

/// Frames of the bus that clients of gateways read too slowly for, while they are at work.
#[derive(Debug, Clone, Default)]
pub struct DroppedFrames(Vec<Arc<Tally>>);

impl DroppedFrames {
    /// Watches gateways.
    pub fn of(gateways: &[Gateways]) -> Self {
        Self(gateways.iter().flat_map(|of_bus| &of_bus.at_work).map(|(_, _, tally)| Arc::clone(tally)).collect())
    }

    /// Returns the number of frames so far. Takes no lock.
    pub fn total(&self) -> u64 {
        self.0.iter().map(|tally| tally.dropped()).sum()
    }
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
        let counters = |tally: &Tally| GatewayCounters { dropped: tally.dropped(), ..tally.lock().clone() };
        self.at_work.iter().map(|(kind, _, tally)| (*kind, counters(tally))).collect()
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
