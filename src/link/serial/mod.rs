//! Serial ports: runs of bytes, stamped when they were read <-> `Link`. UART, RS-422, RS-485, USB adapters, pseudo
//! terminals.
//!
//! A read returns the bytes that have arrived, at most `CHUNK_MAX` bytes, and is stamped at its return. Against the end
//! of the last bit on the wire the stamp is late by the adapter's latency (FTDI: its latency timer, 16 ms unless set to
//! 1 ms; a UART: up to 4 character times of its FIFO's timeout), the interrupt and the wake-up of the thread. The
//! kernel keeps no receive times for serial ports; where microseconds matter, use PPS or CAN.
//!
//! * The port is opened for this program alone. Settings are read back, and those that the driver did not take are an
//!   error: a pseudo terminal, for one, silently drops parity.
//! * A write never waits longer than two full chunks take on the line. Bytes that are not written by then are given up and
//!   counted; a packet cut off by that is ended with a delimiter before the next one, so that only it is lost.
//! * A port that is unplugged is counted as lost and opened again every `RETRY` until it is back.
//! * Bytes with parity or framing errors, and breaks, are counted and read as 0x00, the delimiter: their packet is rejected
//!   and the next one is whole. Overruns inside the driver are not reported (`/proc/tty/driver` shows them); their packets
//!   fail their CRC.
//! * RS-422 needs nothing special. On RS-485 with two wires the adapter or the driver must switch the direction.
//!
//! Settings go through `rustix`, because a port must be non-blocking to keep the promise about writes; ports are listed
//! by `serialport`. Tests: `tests` here, `tests/links` over pseudo terminals.

mod link;
mod pty;

pub use link::SerialLink;
pub use pty::PseudoTerminal;
pub use serialport::{FlowControl, Parity, StopBits};

use crate::LinkError;
use base::time::Span;
use rustix::fs::{FlockOperation, Mode, OFlags, flock, open};
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, InputModes, OptionalActions, QueueSelector, Termios, ioctl_tiocexcl, tcflush, tcgetattr, tcsetattr,
};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::{io, path::PathBuf};

// Settings -> the terminal's modes, read back and compared.

/// Both ends of an asynchronous line tolerate together 5 % in the last bit of a byte: 2 % is each end's share, with a
/// margin.
const BAUD_TOLERANCE: f64 = 0.02;

const LINE: ControlModes = ControlModes::CSIZE
    .union(ControlModes::PARENB)
    .union(ControlModes::PARODD)
    .union(ControlModes::CSTOPB)
    .union(ControlModes::CRTSCTS);

/// Sets a port, and refuses settings that the driver did not take. `Err` says wanted and got.
fn apply(fd: BorrowedFd<'_>, params: &SerialParams) -> io::Result<()> {
    if params.flow == FlowControl::Software {
        let why = "software flow control eats bytes 0x11 and 0x13, which packets contain; use hardware or none";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    }
    if params.baud == 0 {
        let why = "a baud rate of 0 hangs up; use that of the other end";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    }
    let mut wanted = tcgetattr(fd)?;
    write_modes(&mut wanted, params)?;
    tcsetattr(fd, OptionalActions::Now, &wanted)?;
    compare(params, &wanted, &tcgetattr(fd)?)
}

fn write_modes(modes: &mut Termios, params: &SerialParams) -> io::Result<()> {
    modes.make_raw();
    // Bytes with parity or framing errors, and breaks, are marked: `unmark` takes the marks out.
    modes.input_modes.insert(InputModes::INPCK | InputModes::PARMRK);
    modes.input_modes.remove(InputModes::IXOFF | InputModes::IXANY | InputModes::IGNPAR);
    modes.control_modes.remove(LINE);
    modes.control_modes.insert(ControlModes::CREAD | ControlModes::CLOCAL | line(params));
    modes.set_speed(params.baud).map_err(io::Error::from)
}

fn line(params: &SerialParams) -> ControlModes {
    let parity = match params.parity {
        Parity::None => ControlModes::empty(),
        Parity::Even => ControlModes::PARENB,
        Parity::Odd => ControlModes::PARENB | ControlModes::PARODD,
    };
    let stop = if params.stop_bits == StopBits::Two { ControlModes::CSTOPB } else { ControlModes::empty() };
    let flow = if params.flow == FlowControl::Hardware { ControlModes::CRTSCTS } else { ControlModes::empty() };
    ControlModes::CS8 | parity | stop | flow
}

fn compare(params: &SerialParams, wanted: &Termios, got: &Termios) -> io::Result<()> {
    let differs = |what: &str, wanted: String, got: String| {
        Err(io::Error::other(format!("the driver did not take the {what}: wanted {wanted}, got {got}")))
    };
    let baud = got.output_speed();
    let error = (f64::from(baud) - f64::from(params.baud)).abs();
    if error > BAUD_TOLERANCE * f64::from(params.baud) || got.input_speed() != baud {
        return differs("baud rate", params.baud.to_string(), baud.to_string());
    }
    if !got.input_modes.contains(InputModes::PARMRK) {
        return differs("marking of damaged bytes", "PARMRK".into(), "none".into());
    }
    let (wanted, got) = (wanted.control_modes & LINE, got.control_modes & LINE);
    let names = [
        ("data bits", ControlModes::CSIZE),
        ("parity", ControlModes::PARENB | ControlModes::PARODD),
        ("stop bits", ControlModes::CSTOPB),
        ("hardware flow control", ControlModes::CRTSCTS),
    ];
    match names.into_iter().find(|(_, mode)| wanted & *mode != got & *mode) {
        Some((what, mode)) => differs(what, format!("{:?}", wanted & mode), format!("{:?}", got & mode)),
        None => Ok(()),
    }
}

// Path of a port -> an open port with its settings, for this program alone, or the reason and advice.

const ABSENT: &str = "; check the cable and the name (names under /dev/serial/by-id survive replugging)";
const FORBIDDEN: &str = "; add the user to the group of the port: `usermod -aG dialout USER`, then log in again";
const BUSY: &str = "; another program has it open: `fuser -v` on the port shows which";
const NOT_A_PORT: &str = "; this is not a serial port: wanted a device such as /dev/ttyUSB0";
const NOT_TAKEN: &str = "; choose settings that the adapter has";

/// Opens without waiting for a carrier, non-blocking; input that arrived before is thrown away.
fn open_port(params: &SerialParams) -> Result<OwnedFd, LinkError> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let port = open(&params.path, flags, Mode::empty()).map_err(|error| refused(params, error))?;
    let failed = |doing, source, advice| LinkError::System { link: name(params), doing, source, advice };
    flock(&port, FlockOperation::NonBlockingLockExclusive)
        .and_then(|()| ioctl_tiocexcl(&port))
        .map_err(|error| failed("lock the port", error.into(), lock_advice(error)))?;
    apply(port.as_fd(), params).map_err(|error| failed("set the port", error, NOT_TAKEN))?;
    tcflush(&port, QueueSelector::IOFlush).map_err(|error| failed("empty the port", error.into(), ""))?;
    Ok(port)
}

/// Returns the name of a link, for messages.
fn name(params: &SerialParams) -> String {
    params.path.display().to_string()
}

/// Returns what to do when a port cannot be locked.
fn lock_advice(error: Errno) -> &'static str {
    match error {
        _ if is_busy(error) => BUSY,
        Errno::NOTTY => NOT_A_PORT,
        _ => "",
    }
}

fn is_busy(error: Errno) -> bool {
    matches!(error, Errno::BUSY | Errno::WOULDBLOCK)
}

fn refused(params: &SerialParams, error: Errno) -> LinkError {
    let advice = match error {
        Errno::NOENT | Errno::NODEV | Errno::NXIO | Errno::IO => ABSENT,
        Errno::ACCESS | Errno::PERM => FORBIDDEN,
        Errno::BUSY => BUSY,
        _ => "",
    };
    let system = io::Error::from(error);
    let source = io::Error::new(system.kind(), format!("{system} (ports here: {})", ports()));
    LinkError::System { link: name(params), doing: "open the port", source, advice }
}

/// Returns the ports of this machine, as text.
fn ports() -> String {
    let ports = serialport::available_ports().unwrap_or_default();
    let names: Vec<_> = ports.into_iter().map(|port| port.port_name).collect();
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

#[cfg(test)]
mod tests;

/// Byte that ends a packet.
const DELIMITER: u8 = 0;

/// A lost port is looked for this often.
pub const RETRY: Span = Span::from_ms(500);

/// A port and its settings. Always 8 data bits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SerialParams {
    /// Device, such as `/dev/ttyUSB0` or, better, a name under `/dev/serial/by-id`.
    pub path: PathBuf,
    /// Bits per second.
    pub baud: u32,
    /// Parity bit.
    pub parity: Parity,
    /// Stop bits.
    pub stop_bits: StopBits,
    /// Flow control. COBS bytes include XON and XOFF: software flow control is refused.
    pub flow: FlowControl,
}

impl SerialParams {
    /// 8 data bits, no parity, one stop bit, no flow control.
    pub fn new(path: impl Into<PathBuf>, baud: u32) -> Self {
        let (parity, stop_bits, flow) = (Parity::None, StopBits::One, FlowControl::None);
        Self { path: path.into(), baud, parity, stop_bits, flow }
    }

    /// Returns bits on the line per byte: start, 8 data, parity, stop.
    pub fn bits_per_byte(&self) -> i64 {
        let parity = i64::from(self.parity != Parity::None);
        let stop = if self.stop_bits == StopBits::Two { 2 } else { 1 };
        1 + 8 + parity + stop
    }
}
