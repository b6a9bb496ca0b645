//! Packets pass a tap unchanged and are in the capture; those that are not in it are counted.

use super::capture::Capture;
use crate::capture::{CaptureError, CaptureFormat, CaptureReader, Direction};
use crate::simulated::{BusParams, BusTiming, simulated_pair};
use crate::{Link, Packet};
use base::clock::{Clock, Virtual};
use base::time::{Span, Tai};
use firmware_protocol::can::CanFrame;
use std::io::{self, Write};
use std::sync::{Arc, Mutex};

const START: Tai = Tai::from_ns(1_790_000_000_000_000_000);

/// An output that can be looked at, that takes `space` bytes and then has none left.
#[derive(Clone)]
struct Disk {
    bytes: Arc<Mutex<Vec<u8>>>,
    space: usize,
}

impl Disk {
    fn new(space: usize) -> Self {
        Self { bytes: Arc::default(), space }
    }
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut disk = self.bytes.lock().unwrap();
        if disk.len() + bytes.len() > self.space {
            return Err(io::ErrorKind::StorageFull.into());
        }
        disk.extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn packet(n: u16) -> Packet {
    Packet::Can(CanFrame::classic(0x100, &n.to_le_bytes()).unwrap())
}

/// Sends `packets` through a tap, answers each, and finishes.
fn run(disk: &Disk, waits: bool, space: usize, packets: u16) -> super::CaptureOutcome {
    let clock = Arc::new(Virtual::new(START));
    let shared: Arc<dyn Clock> = Arc::<Virtual>::clone(&clock);
    let timing = BusTiming::CanClassic { bit_rate_bps: 1_000_000 };
    let bus = BusParams { name: "test".into(), timing, latency: Span::ZERO, queue_packets: 64 };
    let (near, mut far) = simulated_pair(bus, &shared);
    let capture = Capture::with_space(Box::new(disk.clone()), CaptureFormat::Candump, waits, space).unwrap();
    let mut near = capture.tap(Box::new(near), 0);
    for n in 0..packets {
        clock.advance_to(START + Span::from_ms(i64::from(n)));
        far.send(&packet(n)).unwrap();
        clock.advance_to(START + Span::from_ms(i64::from(n)) + Span::from_ns(500_000));
        let got = near.receive(START).unwrap().expect("it has arrived");
        assert_eq!(got.value, packet(n), "unchanged");
        near.send(&packet(n)).unwrap();
    }
    assert_eq!(near.counters().received, u64::from(packets));
    capture.finish()
}

#[test]
fn everything_that_passes_is_written_in_order() {
    let disk = Disk::new(usize::MAX);
    let outcome = run(&disk, true, 1, 500);
    assert!(outcome.error.is_none() && outcome.lost == 0 && outcome.written == 1000, "{outcome:?}");
    let bytes = disk.bytes.lock().unwrap().clone();
    let mut reader = CaptureReader::new(&bytes[..]).unwrap();
    for n in 0..500 {
        for direction in [Direction::Received, Direction::Sent] {
            let captured = reader.read().unwrap().expect("a packet");
            assert_eq!((captured.direction, captured.packet), (direction, packet(n)));
            // 111 bits at most of a frame with two bytes at 1 Mbit/s.
            let after = captured.at - (START + Span::from_ms(i64::from(n)));
            assert!(after > Span::ZERO && after < Span::from_ms(1), "{} ms", after.ms());
        }
    }
    assert!(reader.read().unwrap().is_none());
}

#[test]
fn links_of_one_capture_keep_their_numbers() {
    let disk = Disk::new(usize::MAX);
    let capture = Capture::with_space(Box::new(disk.clone()), CaptureFormat::Pcapng, true, 4).unwrap();
    let shared: Arc<dyn Clock> = Arc::new(Virtual::new(START));
    let timing = BusTiming::CanClassic { bit_rate_bps: 1_000_000 };
    let (mut taps, mut ends) = (Vec::new(), Vec::new());
    for number in [0, 1, 4] {
        let bus = BusParams { name: "test".into(), timing, latency: Span::ZERO, queue_packets: 64 };
        let (near, far) = simulated_pair(bus, &shared);
        taps.push((number, capture.tap(Box::new(near), number)));
        ends.push(far);
    }
    for n in 0..20 {
        for (number, tap) in &mut taps {
            tap.send(&packet(100 * u16::from(*number) + n)).unwrap();
        }
    }
    assert_eq!(capture.finish().written, 60);
    let bytes = disk.bytes.lock().unwrap().clone();
    let mut reader = CaptureReader::new(&bytes[..]).unwrap();
    for n in 0..20 {
        for number in [0_u8, 1, 4] {
            let captured = reader.read().unwrap().expect("a packet");
            assert_eq!((captured.interface, captured.packet), (number, packet(100 * u16::from(number) + n)));
        }
    }
}

#[test]
fn a_full_disk_ends_the_capture_and_not_the_run() {
    let disk = Disk::new(1000);
    let outcome = run(&disk, true, 8, 100);
    assert!(matches!(outcome.error, Some(CaptureError::Write(_))), "{outcome:?}");
    assert_eq!(outcome.written + outcome.lost, 200, "what is not written is counted");
    assert!(outcome.written > 20, "packets that fit are written: {outcome:?}");
}

#[test]
fn writer_that_blocks_is_given_up_and_what_it_has_not_written_is_lost() {
    base::patience::be_short();
    struct Blocking(crossbeam_channel::Receiver<()>);
    impl Write for Blocking {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let _ = self.0.recv(); // the test ends it
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    // Where taps wait and two packets fit, the third waits for the writer. Where they do not wait, it is lost.
    for (waits, space) in [(true, 2), (true, 64), (false, 2)] {
        let (_never, blocks) = crossbeam_channel::bounded(0);
        let shared: Arc<dyn Clock> = Arc::new(Virtual::new(START));
        let timing = BusTiming::CanClassic { bit_rate_bps: 1_000_000 };
        let bus = BusParams { name: "test".into(), timing, latency: Span::ZERO, queue_packets: 64 };
        let (near, _far) = simulated_pair(bus, &shared);
        let capture = Capture::with_space(Box::new(Blocking(blocks)), CaptureFormat::Candump, waits, space).unwrap();
        let mut near = capture.tap(Box::new(near), 0);
        for n in 0..20 {
            near.send(&packet(n)).unwrap();
        }
        let outcome = capture.finish();
        assert_eq!((outcome.written, outcome.lost), (0, 20), "{outcome:?}");
        let error = outcome.error.expect("the reason").to_string();
        assert!(error.contains("packets cannot be written") && error.contains("given up"), "{error}");
    }
}

#[test]
fn a_full_queue_loses_packets_and_counts_them() {
    // A disk that hangs until it is let go.
    struct Hanging(Arc<Mutex<()>>, Disk);
    impl Write for Hanging {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let _go = self.0.lock().unwrap();
            self.1.write(bytes)
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let gate = Arc::new(Mutex::new(()));
    let hanging = Hanging(Arc::clone(&gate), Disk::new(usize::MAX));
    let clock = Arc::new(Virtual::new(START));
    let shared: Arc<dyn Clock> = clock;
    let timing = BusTiming::CanClassic { bit_rate_bps: 1_000_000 };
    let bus = BusParams { name: "test".into(), timing, latency: Span::ZERO, queue_packets: 64 };
    let (near, _far) = simulated_pair(bus, &shared);
    let capture = Capture::with_space(Box::new(hanging), CaptureFormat::Candump, false, 4).unwrap();
    let mut near = capture.tap(Box::new(near), 0);
    let closed = gate.lock().unwrap();
    for n in 0..100 {
        near.send(&packet(n)).unwrap();
    }
    drop(closed);
    let outcome = capture.finish();
    assert_eq!(outcome.written + outcome.lost, 100, "{outcome:?}");
    assert!((94..=96).contains(&outcome.lost), "four wait, one hangs: {outcome:?}");
}
