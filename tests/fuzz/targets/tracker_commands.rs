//! Commands of a tracker's clients: any bytes in any chunks -> the same answers and orders; orders within the tracker's
//! limits; answers that their own protocol can read; and for NOS3 and Sagitta as many as an independent reading finds.

#![no_main]

use base::time::{Span, Tai};
use firmware_protocol::{can::CanFrame, crc::crc16};
use libfuzzer_sys::fuzz_target;
use starloop_fuzz::control::is_broken;
use starloop_fuzz::{Input, input};
use telemetry::canopen::{CanOpenDevice, NodeParams, dictionary::STARLOOP};
use telemetry::{Answered, Device, Limits, Mode, Order, Report, Sense, Wire};
use telemetry::{
    ccsds::CcsdsDevice, json::JsonDevice, nos3::Nos3Device, sagitta::SagittaDevice, sagitta::slip::SlipReader,
};

const LIMITS: Limits = Limits { exposure_s: Some([0.001, 0.1]) };
const NOW: Tai = Tai::from_ns(1_772_366_437_250_000_000);
const NODE: u8 = 0x60;

fuzz_target!(|bytes: &[u8]| {
    let mut rest = Input::new(bytes);
    let (kind, chunks) = (rest.u8() % 5, rest.array::<4>());
    let stream = rest.rest();
    let whole = if kind == 4 { frames(stream) } else { read(kind, stream, &[u8::MAX]) };
    if kind < 4 {
        assert_eq!(read(kind, stream, &[0]), whole, "byte by byte");
        assert_eq!(read(kind, stream, &chunks), whole, "in chunks of {chunks:?}");
    }
    for order in &whole.orders {
        if let Order::Exposure(exposure) = order {
            assert!((Span::from_ms(1)..=Span::from_ms(100)).contains(exposure), "{exposure:?}");
        }
    }
    assert!(whole.answered.commands + whole.answered.refused <= stream.len() as u64 + 1, "{:?}", whole.answered);
    match kind {
        0 => whole.out.iter().for_each(|line| assert!(line.ends_with(b"}\n"), "{line:?}")),
        1 => nos3(stream, &whole),
        2 => sagitta(stream, &whole),
        3 => ccsds(&whole),
        _ => assert!(whole.out.iter().all(|data| data.len() <= 8)),
    }
});

/// Answers of a device to its input.
#[derive(Debug, PartialEq)]
struct Outcome {
    out: Vec<Vec<u8>>,
    orders: Vec<Order>,
    answered: Answered,
}

fn report() -> Report {
    Report {
        frame: 7,
        time_tag: NOW,
        attitude_wxyz: Some([0.5, -0.5, 0.5, 0.5]),
        rate_rad_s: Some([0.1, -0.2, 9.0]),
        sigma_rad: [1e-5; 3],
        stars: 21,
        mode: Mode::Tracking,
        exposure_s: 0.05,
        background_dn: f64::NAN,
        temperature_c: -5.0,
    }
}

fn device(kind: u8) -> Box<dyn Device> {
    let mut device: Box<dyn Device> = match kind {
        0 => Box::new(JsonDevice::new(0, Sense::Starloop, LIMITS)),
        1 => Box::new(Nos3Device::new(LIMITS)),
        2 => Box::new(SagittaDevice::new(LIMITS, 0.05)),
        3 => Box::new(CcsdsDevice::new(100, Sense::Starloop, LIMITS)),
        _ => {
            let params = NodeParams { node: NODE, heartbeat_ms: 100, starts_operational: true, map: &STARLOOP };
            Box::new(CanOpenDevice::new(params, Sense::Starloop, LIMITS, 0.05))
        }
    };
    device.report(&report(), NOW, &mut Vec::new());
    device
}

fn outcome(mut device: Box<dyn Device>, wires: impl Iterator<Item = Wire>) -> Outcome {
    let (mut out, mut orders) = (Vec::new(), Vec::new());
    wires.for_each(|wire| device.take(&wire, NOW, &mut out, &mut orders));
    let answered = device.answered();
    Outcome { out: out.iter().map(|wire| wire.data().to_vec()).collect(), orders, answered }
}

/// Reads a stream in chunks. Broken: the first byte of a chunk that is not the first one is lost.
fn read(kind: u8, stream: &[u8], lengths: &[u8]) -> Outcome {
    let lost = usize::from(is_broken());
    let chunks = input::chunks(stream, lengths).enumerate();
    let wires = chunks.map(|(place, chunk)| Wire::Bytes(chunk[if place > 0 { lost } else { 0 }..].to_vec()));
    outcome(device(kind), wires)
}

/// Reads CAN frames: identifier and length in two bytes, data.
fn frames(stream: &[u8]) -> Outcome {
    let mut rest = Input::new(stream);
    let mut wires = Vec::new();
    while !rest.is_empty() {
        let head = rest.u16();
        let id = match head & 3 {
            0 => 0x600 + u16::from(NODE),
            1 => 0x000,
            2 => 0x080,
            _ => (head >> 2) & 0x7FF,
        };
        let data = rest.take(usize::from(head >> 12) % 9);
        wires.extend(CanFrame::classic(id, data).map(Wire::Can));
    }
    outcome(device(4), wires.into_iter())
}

/// Each window of nine bytes with the right ends is a command, unless it overlaps one before.
fn nos3(stream: &[u8], got: &Outcome) {
    let (mut at, mut commands) = (0, Vec::new());
    while let Some(window) = stream.get(at..at + 9) {
        let is_framed = window.starts_with(&[0xDE, 0xAD]) && window.ends_with(&[0xBE, 0xEF]);
        at += if is_framed { 9 } else { 1 };
        commands.extend(is_framed.then_some(window));
    }
    let payload = |command: &[u8]| u32::from_be_bytes([command[3], command[4], command[5], command[6]]);
    let obeyed = |command: &&&[u8]| match command[2] {
        0..=2 => true,
        3 => payload(command) <= 2 || (1000..=100_000).contains(&payload(command)),
        _ => false,
    };
    let echoes: Vec<&[u8]> = commands.iter().filter(obeyed).copied().collect();
    assert_eq!(got.out.len(), echoes.len());
    for (answer, echo) in got.out.iter().zip(echoes) {
        assert!(answer.starts_with(echo) && [9, 17, 22].contains(&answer.len()), "{answer:02x?}");
    }
}

/// Every answer is a frame with a right hash; no frame of another address is answered.
fn sagitta(stream: &[u8], got: &Outcome) {
    let mut requests = 0;
    SlipReader::default().push(stream, &mut |frame| {
        requests += usize::from(frame.is_ok_and(|frame| matches!(frame, [0x21, 0..=3, _, ..])));
    });
    assert_eq!(got.out.len(), requests);
    for answer in &got.out {
        let mut frames = 0;
        SlipReader::default().push(answer, &mut |frame| {
            assert!(matches!(frame, Ok([0x21, 128..=131, _, _, ..])), "{frame:02x?}");
            frames += 1;
        });
        assert_eq!(frames, 1);
    }
}

/// Every answer is a telemetry packet of its own length with a right CRC.
fn ccsds(got: &Outcome) {
    for packet in &got.out {
        assert_eq!(packet[0] & 0xF8, 0x08);
        assert_eq!(usize::from(u16::from_be_bytes([packet[4], packet[5]])) + 7, packet.len());
        assert_eq!(crc16(packet), 0, "the CRC over a packet with its CRC is zero");
    }
}
