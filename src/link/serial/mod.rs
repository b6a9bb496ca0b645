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
mod opening;
mod pty;
mod settings;
#[cfg(test)]
mod tests;
mod unmark;

use base::time::Span;
use std::path::PathBuf;

pub use link::SerialLink;
pub use pty::PseudoTerminal;
pub use serialport::{FlowControl, Parity, StopBits};

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
