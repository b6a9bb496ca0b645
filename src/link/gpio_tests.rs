//! Edges through a named pipe: bytes of the kernel's form, read from a file as the kernel's are.

use crate::gpio::{ActiveEdge, Edge, EdgeCounters, GpioChip, GpioLine, LineBias, LineName, RawEdge};
use base::clock::{Clock, Monotonic, PairedReading};
use base::time::{Span, Tai};
use std::fs::{File, OpenOptions};
use std::{io::Write, path::PathBuf, time::Duration};

struct Pipe {
    path: PathBuf,
    writer: File,
    clock: Monotonic,
    _folder: tempfile::TempDir,
}

impl Pipe {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("chip");
        rustix::fs::mknodat(rustix::fs::CWD, &path, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        let writer = OpenOptions::new().read(true).write(true).open(&path).unwrap();
        Self { path, writer, clock: Monotonic::start_at(Tai::from_ns(5_000_000_000)), _folder: folder }
    }

    fn now(&self) -> PairedReading {
        PairedReading::take(&self.clock)
    }

    fn open(&self, lines: &[GpioLine]) -> GpioChip {
        GpioChip::open(&self.path, lines, self.now()).unwrap()
    }

    /// Writes an edge that was so long ago.
    fn edge(&mut self, offset: u32, is_rising: bool, line_seqno: u32, age: Span) -> Tai {
        let now = self.now();
        let realtime_ns = u64::try_from(now.realtime_ns - age.ns()).unwrap();
        self.raw(RawEdge { realtime_ns, is_rising: Some(is_rising), offset, line_seqno });
        now.bench - age
    }

    fn raw(&mut self, raw: RawEdge) {
        self.writer.write_all(&raw.to_bytes()).unwrap();
    }
}

fn line(offset: u32, active: ActiveEdge) -> GpioLine {
    GpioLine { name: LineName::Offset(offset), active, bias: LineBias::AsIs, debounce: Duration::ZERO }
}

fn next(chip: &mut GpioChip, pipe: &Pipe) -> Option<Edge> {
    chip.wait(Span::from_ms(20), &pipe.clock).unwrap()
}

/// Error of two paired readings on a machine that is busy.
const NEAR: Span = Span::from_ms(2);

#[test]
fn edges_come_in_order_with_the_instants_of_their_stamps() {
    let mut pipe = Pipe::new();
    let mut chip = pipe.open(&[line(4, ActiveEdge::Rising), line(7, ActiveEdge::Falling)]);
    assert_eq!(next(&mut chip, &pipe), None, "nothing yet");
    let wanted = [
        (pipe.edge(4, true, 1, Span::from_ms(0)), 0, true),
        (pipe.edge(7, false, 1, Span::from_ms(0)), 1, true),
        (pipe.edge(7, true, 2, Span::from_ms(0)), 1, false),
        (pipe.edge(4, false, 2, Span::from_ms(0)), 0, false),
    ];
    // They wait, and keep their stamps.
    std::thread::sleep(Duration::from_millis(30));
    for (at, number, is_active) in wanted {
        let edge = next(&mut chip, &pipe).unwrap();
        assert_eq!((edge.line, edge.is_active), (number, is_active));
        assert!((edge.at - at).ns().abs() < NEAR.ns(), "{:?} of {at:?}", edge.at);
        assert!(pipe.clock.now() - edge.at > Span::from_ms(25), "control: not the instant of reading");
    }
    assert_eq!(chip.counters(), EdgeCounters { edges: 4, ..EdgeCounters::default() });
}

#[test]
fn gaps_in_the_numbers_of_a_line_are_lost_edges() {
    let mut pipe = Pipe::new();
    let mut chip = pipe.open(&[line(0, ActiveEdge::Rising), line(1, ActiveEdge::Rising)]);
    for (offset, number) in [(0, 1), (1, 1), (0, 2), (1, 4), (0, 3)] {
        pipe.edge(offset, true, number, Span::ZERO);
        assert!(next(&mut chip, &pipe).is_some());
    }
    assert_eq!((chip.counters().edges, chip.counters().lost), (5, 2), "the second and third of line 1");
}

#[test]
fn a_number_that_goes_back_is_a_restart_and_no_lost_edges() {
    let mut pipe = Pipe::new();
    let mut chip = pipe.open(&[line(0, ActiveEdge::Rising)]);
    for number in [1, 2, 3, 1, 2, 2, 5, u32::MAX] {
        pipe.edge(0, true, number, Span::ZERO);
        assert!(next(&mut chip, &pipe).is_some());
    }
    let counters = chip.counters();
    // After 3 comes 1, after 2 comes 2 again, after 5 comes -1; only 3 and 4 are lost.
    assert_eq!((counters.edges, counters.restarts, counters.lost), (8, 3, 2));
    let mut chip = pipe.open(&[line(0, ActiveEdge::Rising)]);
    for number in [1, 3_000] {
        pipe.edge(0, true, number, Span::ZERO);
        assert!(next(&mut chip, &pipe).is_some());
    }
    assert_eq!((chip.counters().restarts, chip.counters().lost), (0, 2_998), "control: a long gap is lost edges");
}

#[test]
fn foreign_events_are_refused_and_impossible_stamps_are_counted() {
    let mut pipe = Pipe::new();
    let mut chip = pipe.open(&[line(3, ActiveEdge::Rising)]);
    pipe.edge(2, true, 1, Span::ZERO);
    assert_eq!(next(&mut chip, &pipe), None, "another line");
    pipe.raw(RawEdge { realtime_ns: 0, is_rising: None, offset: 3, line_seqno: 1 });
    assert_eq!(next(&mut chip, &pipe), None, "no edge");
    pipe.writer.write_all(&[1; 20]).unwrap();
    assert_eq!(next(&mut chip, &pipe), None, "less than an event");
    assert_eq!((chip.counters().refused, chip.counters().edges), (3, 0));
    let before = pipe.clock.now();
    pipe.edge(3, true, 1, Span::from_ms(3_600_000));
    let edge = next(&mut chip, &pipe).unwrap();
    assert!(edge.at >= before, "an hour old: it has the instant of reading");
    assert_eq!((chip.counters().refused, chip.counters().unstamped, chip.counters().edges), (3, 1, 1));
}

#[test]
fn events_are_the_kernels_48_bytes() {
    let raw = RawEdge { realtime_ns: 0x0102_0304_0506_0708, is_rising: Some(false), offset: 9, line_seqno: 77 };
    let bytes = raw.to_bytes();
    assert_eq!(RawEdge::from_bytes(&bytes), raw);
    // timestamp_ns, id, offset, seqno, line_seqno, padding[6], as in the kernel's header.
    assert_eq!(u64::from_ne_bytes(bytes[..8].try_into().unwrap()), raw.realtime_ns);
    let numbers: Vec<u32> = bytes[8..].chunks(4).map(|four| u32::from_ne_bytes(four.try_into().unwrap())).collect();
    assert_eq!(numbers, [2, 9, 77, 77, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn missing_chips_and_names_on_a_pipe_are_clear_errors() {
    let pipe = Pipe::new();
    let open = |path: &std::path::Path, line: GpioLine| {
        GpioChip::open(path, &[line], pipe.now()).expect_err("refused").to_string()
    };
    let error = open("/dev/gpiochip_none".as_ref(), line(0, ActiveEdge::Rising));
    assert!(error.contains("/dev/gpiochip_none") && error.contains("gpiodetect"), "{error}");
    let error = open("/dev/null".as_ref(), line(0, ActiveEdge::Rising));
    assert!(error.contains("/dev/null") && error.contains("gpiodetect"), "no chip: {error}");
    let named = GpioLine { name: LineName::Name("TRIGGER".into()), ..line(0, ActiveEdge::Rising) };
    let error = open(&pipe.path, named);
    assert!(error.contains("find the line") && error.contains("number of the line"), "{error}");
}
