//! The lines that telemetry goes out on and commands come in on, and those of trackers outside: datagrams, a TCP
//! server, serial ports, pseudo-terminals, CAN, and a file.
//!
//! Nothing waits: what a line does not take at once is lost, and the caller counts it. A file is made when it is opened
//! and has a line for each packet: UTC, TAI nanoseconds, identifier of a CAN frame or `-`, bytes in hexadecimal.

use base::clock::Clock;
use base::time::{Span, Tai};
use core::fmt::Write as _;
use firmware_protocol::can::{CanFrame, IdMap};
use link::gateway::{GatewayParams, Gateways, LinkedTerminal, Screen};
use link::serial::{SerialLink, SerialParams};
use link::simulated::{BusParams, BusTiming, SimulatedBus, SimulatedLink};
use link::socketcan::{Receives, SocketCanLink, SocketCanParams};
use link::tcp::{Seat, SeatChange, keep_alive};
use link::{CHUNK_MAX, Link, LinkError, Packet, SerialChunk};
use std::io::{BufWriter, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::{collections::VecDeque, fs::File, path::Path, sync::Arc};
use telemetry::Wire;

/// Longest piece that is read at once.
const READ_MAX: usize = 2048;
/// Packets that a bus of its own holds for a client.
const BUS_PACKETS: usize = 256;
/// Datagrams of other senders that are passed over at one look.
const FOREIGN_MAX: u32 = 256;
/// A sender of answers that has been silent for so long gives way to another one.
const SENDER_TIMEOUT: Span = Span::from_ms(2000);
/// Node of starloop's own messages; none of them is received here.
const NO_NODE: u8 = 0;

/// Why a line cannot be opened, or a packet is lost.
#[derive(Debug, thiserror::Error)]
pub enum OutletError {
    /// A socket, port or file.
    #[error("{line}: cannot {doing}: {source}{advice}")]
    System {
        /// The line.
        line: String,
        /// The action.
        doing: &'static str,
        /// The error of the system.
        source: std::io::Error,
        /// Advice, after a semicolon; or nothing.
        advice: &'static str,
    },
    /// A link of the bus.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Not read: without a client, or with one that does not read.
    #[error("{line}: {why}")]
    Unread {
        /// The line.
        line: String,
        /// Why.
        why: &'static str,
    },
}

/// Where datagrams go, and where commands come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UdpParams {
    /// Whom they go to.
    pub to: SocketAddr,
    /// Where commands are taken.
    pub listen: Option<SocketAddr>,
    /// Commands are taken; not on the virtual clock, where they would have no time.
    pub has_clients: bool,
    /// A datagram is a line: its end is added where it has none.
    pub are_lines: bool,
}

/// A line.
pub struct Outlet {
    lines: Lines,
    name: String,
    /// Parts that last as long as the line: gateways of a bus of its own, the link and the other end of a
    /// pseudo-terminal.
    #[allow(dead_code, reason = "kept for its drop")]
    kept: Option<Box<dyn core::any::Any + Send>>,
    /// Packets that were read and not taken yet.
    read: VecDeque<(Wire, Option<SocketAddr>)>,
}

/// Kinds of lines.
#[allow(clippy::large_enum_variant, reason = "one for each [[tracker_out]]")]
enum Lines {
    /// Datagrams.
    Udp(UdpSocket, UdpParams),
    /// Datagrams of a tracker outside.
    Answers(Answers),
    /// A server with one client.
    Tcp(TcpListener, Seat, Option<(TcpStream, Screen)>),
    /// A serial port.
    Serial(SerialLink),
    /// The master of a pseudo-terminal.
    Terminal(File),
    /// A CAN interface.
    SocketCan(SocketCanLink),
    /// An end of a simulated bus.
    Bus(SimulatedLink),
    /// A file.
    File(BufWriter<File>),
}

fn system(line: &str, doing: &'static str, advice: &'static str) -> impl FnOnce(std::io::Error) -> OutletError {
    let line = line.to_owned();
    move |source| OutletError::System { line, doing, source, advice }
}

/// Datagrams of one sender.
struct Answers {
    socket: UdpSocket,
    /// A datagram is a line: its end is added.
    are_lines: bool,
    /// The sender, and when its last datagram came.
    sender: Option<(SocketAddr, Tai)>,
    looked: Tai,
    /// Datagrams of others.
    foreign: u64,
}

impl Answers {
    /// Frees the line of a sender that is silent.
    fn look(&mut self, now: Tai) {
        self.looked = now;
        self.sender = self.sender.filter(|(_, last)| now - *last < SENDER_TIMEOUT);
    }

    fn receive(&mut self, bytes: &mut [u8]) -> Option<(Wire, Option<SocketAddr>)> {
        for _ in 0..FOREIGN_MAX {
            let (length, from) = self.socket.recv_from(bytes).ok()?;
            if self.sender.is_none_or(|(sender, _)| sender == from) {
                self.sender = Some((from, self.looked));
                let end: &[u8] = if self.are_lines { b"\n" } else { b"" };
                return Some((Wire::Bytes([bytes.get(..length)?, end].concat()), Some(from)));
            }
            self.foreign += 1;
        }
        None
    }
}

impl Outlet {
    fn new(lines: Lines, name: String) -> Self {
        Self { lines, name, kept: None, read: VecDeque::new() }
    }

    /// Opens a socket for datagrams.
    ///
    /// # Errors
    /// When the address is unavailable.
    pub fn udp(params: UdpParams) -> Result<Self, OutletError> {
        let any: SocketAddr = if params.to.ip().is_loopback() {
            (params.to.ip(), 0).into()
        } else if params.to.is_ipv4() {
            ([0, 0, 0, 0], 0).into()
        } else {
            ([0_u16; 8], 0).into()
        };
        let at = params.listen.unwrap_or(any);
        let line = format!("udp {}", params.to);
        let open = UdpSocket::bind(at).and_then(|socket| socket.set_nonblocking(true).map(|()| socket));
        let socket = open.map_err(system(&line, "open a socket", "; is another program at this port?"))?;
        let own = socket.local_addr().map_or_else(|_| String::new(), |own| format!(", commands at {own}"));
        Ok(Self::new(Lines::Udp(socket, params), line + &own))
    }

    /// Opens a socket for the answers of a tracker outside.
    ///
    /// # Errors
    /// When the address is unavailable.
    pub fn answers(listen: SocketAddr, are_lines: bool) -> Result<Self, OutletError> {
        let line = format!("udp {listen}");
        let open = UdpSocket::bind(listen).and_then(|socket| socket.set_nonblocking(true).map(|()| socket));
        let socket = open.map_err(system(&line, "listen", "; is another program at this port?"))?;
        let name = socket.local_addr().map_or(line, |own| format!("udp {own}"));
        let answers = Answers { socket, are_lines, sender: None, looked: Tai::from_ns(0), foreign: 0 };
        Ok(Self::new(Lines::Answers(answers), name))
    }

    /// Returns the datagrams of others than the sender that has the line.
    pub fn foreign(&self) -> u64 {
        if let Lines::Answers(answers) = &self.lines { answers.foreign } else { 0 }
    }

    /// Opens a server; `must_speak`: its client gets nothing before it asks.
    ///
    /// # Errors
    /// When the address is unavailable.
    pub fn tcp(listen: SocketAddr, must_speak: bool) -> Result<Self, OutletError> {
        let line = format!("tcp {listen}");
        let open = TcpListener::bind(listen).and_then(|listener| listener.set_nonblocking(true).map(|()| listener));
        let listener = open.map_err(system(&line, "listen", "; is another program at this port?"))?;
        let name = listener.local_addr().map_or(line, |own| format!("tcp {own}"));
        Ok(Self::new(Lines::Tcp(listener, Seat::new(must_speak), None), name))
    }

    /// Opens a serial port: 8 data bits, no parity, one stop bit.
    ///
    /// # Errors
    /// When it is unavailable, with the reason and what to try.
    pub fn serial(path: &Path, baud: u32, clock: &Arc<dyn Clock>) -> Result<Self, OutletError> {
        let link = SerialLink::open(SerialParams::new(path, baud), clock)?;
        Ok(Self::new(Lines::Serial(link), format!("serial {}", path.display())))
    }

    /// Opens a pseudo-terminal with a link to it.
    ///
    /// # Errors
    /// When the system has none left, or the link cannot be made.
    pub fn terminal(path: &Path) -> Result<Self, OutletError> {
        let (linked, master, port) = LinkedTerminal::open(path)?;
        let outlet = Self::new(Lines::Terminal(File::from(master)), format!("pty {}", path.display()));
        Ok(Self { kept: Some(Box::new((port, linked))), ..outlet })
    }

    /// Opens a CAN interface of the kernel, for the frames of a CANopen node or its master.
    ///
    /// # Errors
    /// When it is unavailable, with the reason and what to try.
    pub fn socketcan(interface: &str, receives: Receives, clock: &Arc<dyn Clock>) -> Result<Self, OutletError> {
        let ids = IdMap::new(0, NO_NODE).unwrap_or_default();
        let params = SocketCanParams { interface: interface.into(), ids, receives, fd: false, bit_rate_switch: false };
        let link = SocketCanLink::open(params, clock)?;
        Ok(Self::new(Lines::SocketCan(link), format!("socketcan {interface}")))
    }

    /// Opens a bus of its own with slcan.
    ///
    /// # Errors
    /// When an address or path is unavailable.
    pub fn slcan(gateway: GatewayParams, bit_rate_bps: u32, clock: &Arc<dyn Clock>) -> Result<Self, OutletError> {
        let timing = BusTiming::CanClassic { bit_rate_bps };
        let name = "tracker".into();
        let latency = Span::ZERO;
        let bus = SimulatedBus::new(BusParams { name, timing, latency, queue_packets: BUS_PACKETS }, clock);
        let gateways = Gateways::start(&bus, &gateway, clock)?;
        let places: Vec<String> = gateways.addresses().iter().map(|(_, address)| address.to_string()).collect();
        let outlet = Self::new(Lines::Bus(bus.attach()), format!("slcan {}", places.join(", ")));
        Ok(Self { kept: Some(Box::new(gateways)), ..outlet })
    }

    /// Takes part in the run's simulated bus.
    pub fn bus(bus: &SimulatedBus) -> Self {
        Self::new(Lines::Bus(bus.attach()), "the run's bus".into())
    }

    /// Makes a file.
    ///
    /// # Errors
    /// When it is there already, or cannot be made.
    pub fn file(path: &Path) -> Result<Self, OutletError> {
        let line = format!("file {}", path.display());
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let made = folder.map_or(Ok(()), std::fs::create_dir_all).and_then(|()| File::create_new(path));
        let file = made.map_err(system(&line, "make it", "; name a file that is not there yet"))?;
        Ok(Self::new(Lines::File(BufWriter::new(file)), line))
    }

    /// Where packets go, for people.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// True when clients may send commands at any time.
    pub fn has_clients(&self) -> bool {
        match &self.lines {
            Lines::Udp(_, params) => params.has_clients,
            Lines::Tcp(..) | Lines::Serial(_) | Lines::Terminal(_) | Lines::SocketCan(_) | Lines::Bus(_) => true,
            Lines::File(_) | Lines::Answers(..) => false,
        }
    }

    /// Sends a packet at `at`, to whoever asked for it where somebody did.
    ///
    /// # Errors
    /// When it is lost.
    pub fn send(&mut self, wire: &Wire, at: Tai, asked_by: Option<SocketAddr>) -> Result<(), OutletError> {
        let unread = |why| OutletError::Unread { line: self.name.clone(), why };
        match (&mut self.lines, wire) {
            (Lines::Udp(socket, params), Wire::Bytes(bytes)) => {
                let to = asked_by.unwrap_or(params.to);
                match socket.send_to(bytes, to) {
                    Ok(_) => Ok(()),
                    // An answer to the packet before: the port has no listener. This packet was not sent either.
                    Err(error) if error.kind() == ErrorKind::ConnectionRefused => {
                        socket.send_to(bytes, to).map(drop).map_err(|_| unread("the port has no listener"))
                    }
                    Err(error) => Err(system(&self.name, "send", "")(error)),
                }
            }
            (Lines::Tcp(_, seat, client), Wire::Bytes(bytes)) => {
                let Some((stream, _)) = client else { return Err(unread("no client is connected")) };
                if let Err(_error) = stream.write_all(bytes) {
                    // A client that does not read, or is gone: a piece of a packet would spoil all that follow.
                    *client = None;
                    seat.leave();
                    return Err(unread("the client did not read, and was hung up on"));
                }
                Ok(())
            }
            (Lines::Serial(link), Wire::Bytes(bytes)) => {
                let unsent = link.counters().unsent;
                for piece in bytes.chunks(CHUNK_MAX) {
                    if let Some(chunk) = SerialChunk::new(piece) {
                        link.send(&Packet::Serial(chunk))?;
                    }
                }
                if link.counters().unsent > unsent { Err(unread("the port did not take it")) } else { Ok(()) }
            }
            (Lines::Terminal(master), Wire::Bytes(bytes)) => {
                master.write_all(bytes).map_err(|_full| unread("the pseudo-terminal has no reader"))
            }
            (Lines::SocketCan(link), Wire::Can(frame)) => {
                let unsent = link.counters().unsent;
                link.send(&Packet::Can(*frame))?;
                if link.counters().unsent > unsent { Err(unread("the interface did not take it")) } else { Ok(()) }
            }
            (Lines::Bus(link), Wire::Can(frame)) => {
                let unsent = link.counters().unsent;
                link.send(&Packet::Can(*frame))?;
                if link.counters().unsent > unsent { Err(unread("the bus was too busy")) } else { Ok(()) }
            }
            (Lines::File(file), wire) => {
                let line = file_line(wire, at);
                file.write_all(line.as_bytes()).map_err(system(&self.name, "write", ""))
            }
            (Lines::Answers(..), _) => Err(unread("a tracker outside takes nothing")),
            (Lines::Udp(..) | Lines::Tcp(..) | Lines::Serial(_) | Lines::Terminal(_), Wire::Can(_))
            | (Lines::SocketCan(_) | Lines::Bus(_), Wire::Bytes(_)) => {
                Err(unread("it carries packets of another kind"))
            }
        }
    }

    /// Lets clients of a server in and out; call once before packets are received.
    pub fn welcome(&mut self, now: Tai) {
        if let Lines::Answers(answers) = &mut self.lines {
            answers.look(now);
        }
        let Lines::Tcp(listener, seat, client) = &mut self.lines else { return };
        match seat.look(listener, now) {
            Ok(SeatChange::Goes(stream)) => {
                let set_up = stream.set_nonblocking(true).and_then(|()| keep_alive(&stream));
                let _packets_go_out_at_once_where_they_can = stream.set_nodelay(true);
                *client = set_up.is_ok().then(|| (stream, Screen::default()));
            }
            Ok(SeatChange::Freed) => *client = None,
            Ok(SeatChange::Same) | Err(_) => {}
        }
        if client.is_none() {
            seat.leave();
        }
    }

    /// Records that the client has sent a command: it keeps its place.
    pub fn keep_client(&mut self) {
        if let Lines::Tcp(_, seat, _) = &mut self.lines {
            seat.speak();
        }
    }

    /// Returns the next packet of a client and, of a datagram, who sent it; `None` when nothing waits.
    pub fn receive(&mut self) -> Option<(Wire, Option<SocketAddr>)> {
        if self.read.is_empty() {
            self.look();
        }
        self.read.pop_front()
    }

    fn look(&mut self) {
        let mut bytes = [0; READ_MAX];
        match &mut self.lines {
            Lines::Udp(socket, params) if params.has_clients => {
                let Ok((length, from)) = socket.recv_from(&mut bytes) else { return };
                // Commands from other addresses and ports are ignored.
                if from == params.to {
                    let mut datagram = bytes[..length].to_vec();
                    if params.are_lines && datagram.last() != Some(&b'\n') {
                        datagram.push(b'\n');
                    }
                    self.read.push_back((Wire::Bytes(datagram), Some(from)));
                }
            }
            Lines::Answers(answers) => self.read.extend(answers.receive(&mut bytes)),
            Lines::Tcp(_, seat, client) => {
                let Some((stream, screen)) = client else { return };
                match stream.read(&mut bytes) {
                    Ok(length @ 1..) if screen.look(&bytes[..length]).is_none() => {
                        self.read.push_back((Wire::Bytes(bytes[..length].to_vec()), None));
                    }
                    Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
                    // The end, an error, or a web page that found the port.
                    Ok(_) | Err(_) => {
                        *client = None;
                        seat.leave();
                    }
                }
            }
            Lines::Terminal(master) => {
                if let Ok(length @ 1..) = master.read(&mut bytes) {
                    self.read.push_back((Wire::Bytes(bytes[..length].to_vec()), None));
                }
            }
            Lines::Serial(link) => self.read.extend(received(link)),
            Lines::SocketCan(link) => self.read.extend(received(link)),
            Lines::Bus(link) => self.read.extend(received(link)),
            Lines::Udp(..) | Lines::File(_) => {}
        }
    }

    /// Writes down all that a file has not.
    ///
    /// # Errors
    /// When the disk refuses it.
    pub fn finish(&mut self) -> Result<(), OutletError> {
        let Lines::File(file) = &mut self.lines else { return Ok(()) };
        file.flush().map_err(system(&self.name, "write", ""))
    }
}

/// Returns the next packet of a link, if one has come.
fn received(link: &mut dyn Link) -> Option<(Wire, Option<SocketAddr>)> {
    let stamped = link.receive(Tai::from_ns(i64::MIN)).ok().flatten()?;
    let wire = match stamped.value {
        Packet::Can(frame) => Wire::Can(frame),
        Packet::Serial(chunk) => Wire::Bytes(chunk.as_slice().to_vec()),
        Packet::Datagram(datagram) => Wire::Bytes(datagram.as_slice().to_vec()),
    };
    Some((wire, None))
}

fn file_line(wire: &Wire, at: Tai) -> String {
    let mut line = format!("{} {} ", at.to_rfc3339(), at.ns());
    match wire {
        Wire::Bytes(_) => line.push('-'),
        Wire::Can(frame) => line.push_str(&identifier(frame)),
    }
    line.push(' ');
    for byte in wire.data() {
        let _ = write!(line, "{byte:02x}"); // writing to a string does not fail
    }
    line.push('\n');
    line
}

fn identifier(frame: &CanFrame) -> String {
    format!("{:x}", frame.id())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_a_line_for_each_packet() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run/st.txt");
        let mut outlet = Outlet::file(&path).unwrap();
        let at = Tai::from_unix_ns(1_772_366_400_250_000_000);
        outlet.send(&Wire::Bytes(vec![0xDE, 0xAD]), at, None).unwrap();
        outlet.send(&Wire::Can(CanFrame::classic(0x1E0, &[1]).unwrap()), at, None).unwrap();
        outlet.finish().unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "2026-03-01T12:00:00.250000Z 1772366437250000000 - dead");
        assert!(lines[1].ends_with(" 1e0 01"), "{}", lines[1]);
        let again = Outlet::file(&path).err().unwrap().to_string();
        assert!(again.contains("not there yet"), "control: {again}");
    }

    #[test]
    fn datagrams_go_to_one_address_and_commands_come_from_it_only() {
        let client = UdpSocket::bind("127.0.0.1:0").unwrap();
        client.set_read_timeout(Some(std::time::Duration::from_secs(10))).unwrap();
        let (to, listen) = (client.local_addr().unwrap(), Some("127.0.0.1:0".parse().unwrap()));
        let mut outlet = Outlet::udp(UdpParams { to, listen, has_clients: true, are_lines: true }).unwrap();
        outlet.send(&Wire::Bytes(b"hello\n".to_vec()), Tai::from_ns(0), None).unwrap();
        let mut bytes = [0; 64];
        let (length, from) = client.recv_from(&mut bytes).unwrap();
        assert_eq!(&bytes[..length], b"hello\n");
        client.send_to(b"{}", from).unwrap();
        let got = core::iter::repeat_with(|| outlet.receive()).flatten().next().unwrap();
        assert_eq!(got, (Wire::Bytes(b"{}\n".to_vec()), Some(to)));
        let other = UdpSocket::bind("127.0.0.1:0").unwrap();
        other.send_to(b"[]", from).unwrap();
        client.send_to(b"{}", from).unwrap();
        let got = core::iter::repeat_with(|| outlet.receive()).flatten().next().unwrap();
        assert_eq!(got, (Wire::Bytes(b"{}\n".to_vec()), Some(to)), "not those of another port");
    }

    #[test]
    fn silent_client_of_a_server_gives_way_and_one_that_commands_stays() {
        let at = |ms: i64| Tai::from_ns(1_000_000 * ms);
        let mut outlet = Outlet::tcp("127.0.0.1:0".parse().unwrap(), false).unwrap();
        let address: SocketAddr = outlet.name().trim_start_matches("tcp ").parse().unwrap();
        let connect = |outlet: &mut Outlet, ms| {
            let client = TcpStream::connect(address).unwrap();
            outlet.welcome(at(ms));
            client
        };
        let reads = |outlet: &mut Outlet, client: &mut TcpStream| {
            outlet.send(&Wire::Bytes(vec![7]), at(0), None).unwrap();
            client.set_read_timeout(Some(std::time::Duration::from_millis(200))).unwrap();
            client.read_exact(&mut [0]).is_ok()
        };
        let mut silent = connect(&mut outlet, 0);
        assert!(reads(&mut outlet, &mut silent));
        let mut newcomer = connect(&mut outlet, 999);
        assert!(!reads(&mut outlet, &mut newcomer), "within the grace");
        outlet.welcome(at(1000));
        assert!(reads(&mut outlet, &mut newcomer));
        outlet.keep_client();
        let mut third = connect(&mut outlet, 9000);
        outlet.welcome(at(90_000));
        assert!(!reads(&mut outlet, &mut third), "control: the client has sent a command");
    }

    #[test]
    fn server_has_one_client_and_hangs_up_on_web_pages() {
        let now = Tai::from_ns(0);
        let mut outlet = Outlet::tcp("127.0.0.1:0".parse().unwrap(), false).unwrap();
        let lost = outlet.send(&Wire::Bytes(vec![1]), Tai::from_ns(0), None).unwrap_err().to_string();
        assert!(lost.contains("no client"), "{lost}");
        let address: SocketAddr = outlet.name().trim_start_matches("tcp ").parse().unwrap();
        let mut client = TcpStream::connect(address).unwrap();
        client.write_all(b"abc").unwrap();
        let looked = core::iter::repeat_with(|| {
            outlet.welcome(now);
            outlet.receive()
        });
        let got = looked.flatten().next().unwrap();
        assert_eq!(got.0, Wire::Bytes(b"abc".to_vec()));
        outlet.send(&Wire::Bytes(vec![7]), Tai::from_ns(0), None).unwrap();
        let mut bytes = [0; 1];
        client.read_exact(&mut bytes).unwrap();
        assert_eq!(bytes, [7]);
        drop(client);
        while outlet.send(&Wire::Bytes(vec![7]), Tai::from_ns(0), None).is_ok() {
            outlet.receive();
        }
        let mut page = TcpStream::connect(address).unwrap();
        page.write_all(b"POST / HTTP/1.1\r\nHost: a\r\n\r\n{\"command\": \"reset\"}\n").unwrap();
        page.shutdown(std::net::Shutdown::Write).unwrap();
        let mut rest = Vec::new();
        // It is read, refused and closed: the client sees the end.
        let ended = core::iter::repeat_with(|| {
            outlet.welcome(now);
            assert!(outlet.receive().is_none());
            page.set_nonblocking(true).unwrap();
            page.read_to_end(&mut rest)
        });
        let ended =
            ended.take(1_000_000).any(|read| !matches!(&read, Err(error) if error.kind() == ErrorKind::WouldBlock));
        assert!(ended);
    }
}
