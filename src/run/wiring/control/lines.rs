//! Lines over TCP: bounded lines, other protocols recognised, and checks for Ctrl-C while waiting.

use crate::wiring::control::protocol::LINE_BYTES_MAX;
use core::{fmt, str::FromStr, time::Duration};
use link::gateway::{Foreign, Screen};
use serde_json::Value;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};

/// Interval at which a wait checks for Ctrl-C.
pub(super) const LOOK: Duration = Duration::from_millis(50);
/// A client that does not take a reply for this long counts as gone.
const TAKES_WITHIN: Duration = Duration::from_secs(60);

/// A loopback address and port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ControlAddress {
    address: SocketAddr,
}

impl ControlAddress {
    /// Returns the address if it is a loopback address.
    pub fn of(address: SocketAddr) -> Option<Self> {
        address.ip().is_loopback().then_some(Self { address })
    }

    pub(super) fn socket(self) -> SocketAddr {
        self.address
    }
}

impl fmt::Display for ControlAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.address.fmt(f)
    }
}

impl FromStr for ControlAddress {
    type Err = String;

    /// Reads `127.0.0.1:PORT`, `[::1]:PORT` or `localhost:PORT`.
    fn from_str(text: &str) -> Result<Self, String> {
        let address = match text.strip_prefix("localhost:") {
            Some(port) => port.parse().ok().map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port))),
            None => text.parse().ok(),
        };
        let address = address.ok_or_else(|| "wanted an address and port such as 127.0.0.1:0".to_owned())?;
        Self::of(address).ok_or_else(|| {
            let ip = address.ip();
            format!("{ip} is not a loopback address: wanted 127.0.0.1 or [::1]; who can connect controls the run")
        })
    }
}

/// Input from a client.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Incoming {
    /// A line without its end.
    Line(String),
    /// A line that cannot be a request, and why.
    Unusable(String),
    /// The client speaks another protocol: further input is not read.
    Foreign(Foreign),
    /// The client closed the connection.
    Gone,
    /// The caller waits no longer: Ctrl-C, or the run is over.
    Stopped,
}

/// A connected client.
#[derive(Debug)]
pub(super) struct LineSocket {
    stream: TcpStream,
    screen: Screen,
    foreign: Option<Foreign>,
    received: Vec<u8>,
    /// Number of received bytes that were searched without finding the end of a line.
    searched: usize,
    /// True while a line that is too long is being skipped.
    is_skipping: bool,
    is_gone: bool,
}

impl LineSocket {
    pub(super) fn new(stream: TcpStream) -> std::io::Result<Self> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(LOOK))?;
        stream.set_write_timeout(Some(TAKES_WITHIN))?;
        Ok(Self {
            stream,
            screen: Screen::default(),
            foreign: None,
            received: Vec::new(),
            searched: 0,
            is_skipping: false,
            is_gone: false,
        })
    }

    /// Returns the next line that is not empty, or [`Incoming::Stopped`] once `is_over` says so.
    pub(super) fn read_line(&mut self, is_over: &dyn Fn() -> bool) -> Incoming {
        loop {
            match self.look() {
                Some(incoming) => return incoming,
                None if is_over() => return Incoming::Stopped,
                None => {}
            }
        }
    }

    /// Returns the next line that is not empty, if there is one within [`LOOK`]. Reads once at most: a client that sends
    /// byte after byte and no line does not keep the caller here.
    pub(super) fn look(&mut self) -> Option<Incoming> {
        let mut chunk = [0; 4096];
        let mut may_read = true;
        loop {
            if let Some(end) = self.received[self.searched..].iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.received.drain(..=self.searched + end).collect();
                self.searched = 0;
                if let Some(incoming) = self.usable(&line) {
                    return Some(incoming);
                }
                continue;
            }
            self.searched = self.received.len();
            if self.searched > LINE_BYTES_MAX {
                // Its end has not arrived yet: discard the start.
                (self.is_skipping, self.searched) = (true, 0);
                self.received.clear();
            }
            if let Some(foreign) = self.foreign {
                return Some(Incoming::Foreign(foreign));
            }
            if self.is_gone {
                return Some(Incoming::Gone);
            }
            if !core::mem::take(&mut may_read) {
                return None;
            }
            match self.stream.read(&mut chunk) {
                Ok(0) => return Some(Incoming::Gone),
                Ok(count) => self.take(&chunk[..count]),
                Err(error) if is_wait(error.kind()) => return None,
                Err(_broken) => return Some(Incoming::Gone),
            }
        }
    }

    /// Keeps the lines before the first foreign line.
    fn take(&mut self, bytes: &[u8]) {
        let foreign = self.screen.look(bytes);
        self.foreign = foreign.map(|(_, foreign)| foreign);
        let ours = foreign.map_or(bytes, |(start, _)| &bytes[..start]);
        self.received.extend_from_slice(ours);
    }

    /// Returns one line with its end; `None` for an empty line, which is not a request.
    fn usable(&mut self, line: &[u8]) -> Option<Incoming> {
        if core::mem::take(&mut self.is_skipping) || line.len() > LINE_BYTES_MAX + 1 {
            let why = format!("the line is longer than {LINE_BYTES_MAX} bytes; wanted one request a line");
            return Some(Incoming::Unusable(why));
        }
        match core::str::from_utf8(line).map(str::trim) {
            Ok("") => None,
            Ok(line) => Some(Incoming::Line(line.into())),
            Err(error) => {
                let at = error.valid_up_to();
                Some(Incoming::Unusable(format!("the line is not UTF-8 from byte {at} on; wanted JSON text")))
            }
        }
    }

    /// Sends one reply. If the client does not take it, the next read returns [`Incoming::Gone`].
    pub(super) fn send(&mut self, reply: &Value) {
        let mut line = reply.to_string();
        line.push('\n');
        self.is_gone |= self.stream.write_all(line.as_bytes()).is_err();
    }
}

fn is_wait(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}
