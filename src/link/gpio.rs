//! Edges of GPIO lines (Linux character device, uAPI v2) -> instants on the bench clock.
//!
//! The kernel debounces the lines, stamps each edge with CLOCK_REALTIME in its interrupt (after the debounce period,
//! where there is one) and numbers the edges of each line. An edge is placed on the bench clock like a packet's stamp,
//! by its age when it is read; error: the interrupt's latency and half the window of the paired reading. A gap in the
//! numbers is edges that the kernel dropped because its queue was full: they are counted as lost. Numbers that go back
//! are those of a source that has started again: that is counted once, and no edge as lost. Both edges of a line are
//! reported: the active one starts an exposure, the other one ends those whose length is the pulse's.
//!
//! *A named pipe in place of a chip.* Where the chip is a named pipe, it brings events of the kernel's own form
//! (`struct gpio_v2_line_event`, 48 bytes): a pulse generator that is a program, for benches without lines, and for
//! tests.
//!
//! Source: Linux `include/uapi/linux/gpio.h`, `Documentation/userspace-api/gpio/chardev.rst`. Limits: `QUEUE` edges may
//! wait for all lines of a chip together; waiting reads a file, off the frame path. Tests: `gpio_tests`, on a named
//! pipe; on a simulated chip of the kernel where there is one, `hil_scripts/tests/test_triggers.py`.

use super::readiness::{Readiness, wait_for};
use super::{LinkError, kernel_stamp::StampMap};
use base::clock::{Clock, PairedReading};
use base::time::{Span, Tai};
use gpiocdev::line::{Bias, EdgeDetection, EdgeKind, EventClock};
use gpiocdev::request::Config;
use gpiocdev::{Chip, Request};
use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::{os::fd::AsFd, path::Path, time::Duration};

/// Edges that may wait in the kernel.
pub const QUEUE: u32 = 256;
/// Bytes of an event: `struct gpio_v2_line_event`.
pub const EVENT_BYTES: usize = 48;
/// A number of an edge that is so far ahead of the one before, modulo 2^32, is behind it.
const RESTARTED: u32 = 1 << 31;
/// `GPIO_V2_LINE_EVENT_RISING_EDGE` and `GPIO_V2_LINE_EVENT_FALLING_EDGE`.
const RISING: u32 = 1;
const FALLING: u32 = 2;

const NO_CHIP: &str = "; `gpiodetect` lists chips; reading one needs rights (group gpio, or a udev rule)";
const NO_LINE: &str = "; `gpioinfo` lists the lines of a chip, their names, and who uses them";
const BY_OFFSET: &str = "; a named pipe has no names: give the number of the line";

/// Name of a line of a chip.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LineName {
    /// By its number on the chip, from 0.
    Offset(u32),
    /// By the name that the board gives it.
    Name(String),
}

/// The edge with which a line becomes active.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActiveEdge {
    /// From low to high.
    Rising,
    /// From high to low.
    Falling,
}

/// Setting of the chip's own resistors for a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineBias {
    /// The present setting, unchanged.
    AsIs,
    /// Both resistors are off.
    Off,
    /// The pull-up resistor is on.
    PullUp,
    /// The pull-down resistor is on.
    PullDown,
}

/// One line and its settings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GpioLine {
    /// Name of the line.
    pub name: LineName,
    /// The edge with which it becomes active.
    pub active: ActiveEdge,
    /// The chip's resistors.
    pub bias: LineBias,
    /// Shortest time that a level must last to count; zero: any time.
    pub debounce: Duration,
}

/// An edge of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edge {
    /// Number of the line among those that were requested, from 0.
    pub line: usize,
    /// Time of the edge.
    pub at: Tai,
    /// Whether the line became active; false: inactive.
    pub is_active: bool,
}

/// Counts of the edges so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EdgeCounters {
    /// Edges reported.
    pub edges: u64,
    /// Edges that the kernel dropped because too many waited.
    pub lost: u64,
    /// Times the numbers of a line went back: its source started again.
    pub restarts: u64,
    /// Edges whose stamp was impossible, as across a step of CLOCK_REALTIME: they have the instant at which they were
    /// read.
    pub unstamped: u64,
    /// Events of lines that were not asked for, or of no known kind: refused.
    pub refused: u64,
}

/// The lines of one chip.
#[derive(Debug)]
pub struct GpioChip {
    name: String,
    source: Source,
    lines: Vec<Listened>,
    stamps: StampMap,
    counters: EdgeCounters,
}

/// A line as it is listened to.
#[derive(Debug, Clone, Copy)]
struct Listened {
    offset: u32,
    active: ActiveEdge,
    /// Number of its latest edge; 0 before the first.
    newest: u32,
}

/// Source of events.
#[derive(Debug)]
enum Source {
    /// The kernel.
    Lines(Request),
    /// A named pipe.
    Pipe(File),
}

/// An event as the kernel reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawEdge {
    /// CLOCK_REALTIME, ns.
    pub realtime_ns: u64,
    /// True for low to high, false for high to low; `None` for an event that is not an edge.
    pub is_rising: Option<bool>,
    /// Number of the line on its chip.
    pub offset: u32,
    /// Number of the edge on its line, from 1.
    pub line_seqno: u32,
}

impl RawEdge {
    /// Returns the bytes of the event: `struct gpio_v2_line_event` of this machine.
    pub fn to_bytes(self) -> [u8; EVENT_BYTES] {
        let mut bytes = [0; EVENT_BYTES];
        bytes[..8].copy_from_slice(&self.realtime_ns.to_ne_bytes());
        let kind = self.is_rising.map_or(0, |is_rising| if is_rising { RISING } else { FALLING });
        for (place, number) in [kind, self.offset, self.line_seqno, self.line_seqno].into_iter().enumerate() {
            bytes[8 + 4 * place..12 + 4 * place].copy_from_slice(&number.to_ne_bytes());
        }
        bytes
    }

    /// Returns the event of these bytes.
    pub fn from_bytes(bytes: &[u8; EVENT_BYTES]) -> Self {
        let number = |at: usize| u32::from_ne_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let [low, high] = [0, 4].map(|at| number(at).to_ne_bytes());
        let realtime_ns = u64::from_ne_bytes([low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]]);
        let is_rising = match number(8) {
            RISING => Some(true),
            FALLING => Some(false),
            // A number of the wire, not an enumeration of ours.
            0 | 3.. => None,
        };
        Self { realtime_ns, is_rising, offset: number(12), line_seqno: number(20) }
    }
}

impl GpioChip {
    /// Listens to lines of a chip from here on; edges before are not reported.
    ///
    /// # Errors
    /// When the chip or the line does not exist, or another program has the line.
    pub fn open(path: &Path, lines: &[GpioLine], now: PairedReading) -> Result<Self, LinkError> {
        let name = path.display().to_string();
        let failed = |doing, source, advice| LinkError::System { link: name.clone(), doing, source, advice };
        let kind = std::fs::metadata(path).map_err(|error| failed("open the GPIO chip", error, NO_CHIP))?.file_type();
        let (source, offsets) = if kind.is_fifo() {
            let offsets = lines.iter().map(|line| match line.name {
                LineName::Offset(offset) => Ok(offset),
                LineName::Name(_) => Err(failed("find the line", io::ErrorKind::NotFound.into(), BY_OFFSET)),
            });
            let offsets = offsets.collect::<Result<Vec<_>, _>>()?;
            // Opened for reading and writing: the pipe does not end when a writer closes it.
            let nonblocking = i32::try_from(rustix::fs::OFlags::NONBLOCK.bits()).unwrap_or(0);
            let pipe = OpenOptions::new().read(true).write(true).custom_flags(nonblocking).open(path);
            (Source::Pipe(pipe.map_err(|error| failed("open the named pipe", error, ""))?), offsets)
        } else {
            let chip =
                Chip::from_path(path).map_err(|error| failed("open the GPIO chip", io_error(&error), NO_CHIP))?;
            let offsets = lines.iter().map(|line| offset_of(&chip, &line.name));
            let offsets = offsets.collect::<Result<Vec<_>, _>>();
            let offsets = offsets.map_err(|error| failed("find the line", error, NO_LINE))?;
            let request = request(path, lines, &offsets);
            (Source::Lines(request.map_err(|error| failed("listen to the line", io_error(&error), NO_LINE))?), offsets)
        };
        let listened = |(line, offset): (&GpioLine, u32)| Listened { offset, active: line.active, newest: 0 };
        let lines = lines.iter().zip(offsets).map(listened).collect();
        Ok(Self { name, source, lines, stamps: StampMap::new(now), counters: EdgeCounters::default() })
    }

    /// Waits for the next edge, this long at most.
    ///
    /// # Errors
    /// When the chip is gone.
    pub fn wait(&mut self, at_most: Span, clock: &dyn Clock) -> Result<Option<Edge>, LinkError> {
        let failed =
            |source, link: &str| LinkError::System { link: link.into(), doing: "read edges", source, advice: "" };
        let before = PairedReading::take(clock);
        if !self.source.is_ready(Span::ZERO).map_err(|error| failed(error, &self.name))? {
            // Edges from here on are stamped after any step of the clock so far.
            let _ = self.stamps.place(None, before);
            self.stamps.drained();
            if !self.source.is_ready(at_most).map_err(|error| failed(error, &self.name))? {
                return Ok(None);
            }
        }
        let raw = self.source.read().map_err(|error| failed(error, &self.name))?;
        Ok(raw.and_then(|raw| self.edge(raw, PairedReading::take(clock))))
    }

    /// Returns the counts of the edges so far.
    pub fn counters(&self) -> EdgeCounters {
        self.counters
    }

    /// Returns the edge of an event that was read at `now`.
    fn edge(&mut self, raw: RawEdge, now: PairedReading) -> Option<Edge> {
        let found = self.lines.iter().position(|line| line.offset == raw.offset).zip(raw.is_rising);
        let Some((number, is_rising)) = found else {
            self.counters.refused += 1;
            return None;
        };
        let line = &mut self.lines[number];
        match raw.line_seqno.wrapping_sub(line.newest) {
            0 | RESTARTED.. => self.counters.restarts += 1,
            ahead => self.counters.lost += u64::from(ahead - 1),
        }
        line.newest = raw.line_seqno;
        let placed = self.stamps.place(i64::try_from(raw.realtime_ns).ok(), now);
        self.counters.edges += 1;
        self.counters.unstamped += u64::from(!placed.is_kernels);
        Some(Edge { line: number, at: placed.at, is_active: is_rising == (line.active == ActiveEdge::Rising) })
    }
}

impl Source {
    fn is_ready(&self, at_most: Span) -> io::Result<bool> {
        match self {
            Self::Lines(request) => {
                let at_most = Duration::from_nanos(at_most.ns().unsigned_abs());
                request.wait_edge_event(at_most).map_err(|error| io_error(&error))
            }
            Self::Pipe(pipe) => wait_for(pipe.as_fd(), Readiness::Read, at_most),
        }
    }

    /// Reads an edge; `None` while no event is waiting.
    fn read(&mut self) -> io::Result<Option<RawEdge>> {
        match self {
            Self::Lines(request) => {
                let event = request.read_edge_event().map_err(|error| io_error(&error))?;
                Ok(Some(RawEdge {
                    realtime_ns: event.timestamp_ns,
                    is_rising: Some(event.kind == EdgeKind::Rising),
                    offset: event.offset,
                    line_seqno: event.line_seqno,
                }))
            }
            Self::Pipe(pipe) => {
                let mut bytes = [0; EVENT_BYTES];
                // A pipe transfers a write shorter than a page as a whole, or not at all.
                match pipe.read(&mut bytes) {
                    Ok(EVENT_BYTES) => Ok(Some(RawEdge::from_bytes(&bytes))),
                    Ok(_) => Ok(Some(RawEdge { realtime_ns: 0, is_rising: None, offset: 0, line_seqno: 0 })),
                    Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(None),
                    Err(error) => Err(error),
                }
            }
        }
    }
}

fn offset_of(chip: &Chip, name: &LineName) -> io::Result<u32> {
    match name {
        LineName::Offset(offset) => Ok(*offset),
        LineName::Name(name) => {
            let found = chip.find_line_info(name).map(|info| info.offset);
            found.ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, format!("the chip has no line \"{name}\"")))
        }
    }
}

fn request(path: &Path, lines: &[GpioLine], offsets: &[u32]) -> gpiocdev::Result<Request> {
    let mut config = Config::default();
    config.on_chip(path);
    for (line, offset) in lines.iter().zip(offsets) {
        config.with_line(*offset).as_input();
        config.with_edge_detection(EdgeDetection::BothEdges).with_event_clock(EventClock::Realtime);
        match line.bias {
            LineBias::AsIs => {}
            LineBias::Off => drop(config.with_bias(Bias::Disabled)),
            LineBias::PullUp => drop(config.with_bias(Bias::PullUp)),
            LineBias::PullDown => drop(config.with_bias(Bias::PullDown)),
        }
        if !line.debounce.is_zero() {
            config.with_debounce_period(line.debounce);
        }
    }
    Request::from_config(config).with_consumer("starloop").with_kernel_event_buffer_size(QUEUE).request()
}

fn io_error(error: &gpiocdev::Error) -> io::Error {
    io::Error::other(error.to_string())
}
