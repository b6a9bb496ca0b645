//! Telemetry of trackers: any bytes in any chunks -> the same measurements, each with an attitude of norm 1; what a
//! device says after the noise is read, with its own attitude.

#![no_main]

use base::time::{Span, Tai};
use libfuzzer_sys::fuzz_target;
use starloop_fuzz::control::is_broken;
use starloop_fuzz::{Input, input};
use telemetry::canopen::{CanOpenDevice, CanOpenReader, NodeParams, dictionary::STARLOOP};
use telemetry::ccsds::{CcsdsDevice, CcsdsReader};
use telemetry::json::{JsonDevice, JsonReader};
use telemetry::nos3::{Nos3Device, Nos3Reader};
use telemetry::reading::{Measured, Reader};
use telemetry::sagitta::{SagittaDevice, SagittaReader};
use telemetry::{Device, Limits, Mode, Report, Sense, Wire};

const NOW: Tai = Tai::from_ns(1_772_366_437_250_000_000);
const NODE: u8 = 0x60;
/// More than the longest packet of each protocol: after so many zeros no noise is part of a packet.
const QUIET: usize = 4200;

fuzz_target!(|bytes: &[u8]| {
    let mut rest = Input::new(bytes);
    let (kind, chunks) = (rest.u8() % 5, rest.array::<4>());
    let stream = rest.rest();
    let (whole, damaged) = if kind == 3 { frames(stream) } else { read(kind, stream, &[u8::MAX]) };
    if kind != 3 {
        assert_eq!(read(kind, stream, &[0]), (whole.clone(), damaged), "byte by byte");
        assert_eq!(read(kind, stream, &chunks), (whole.clone(), damaged), "in chunks of {chunks:?}");
    }
    assert!(whole.len() as u64 + damaged <= stream.len() as u64 + 1, "{} and {damaged}", whole.len());
    for measured in &whole {
        if let Some(q) = measured.attitude_wxyz {
            let norm = q.iter().map(|part| part * part).sum::<f64>();
            assert!((norm - 1.0).abs() < 1e-9, "{q:?}");
        }
    }
    after_noise(kind, stream);
});

fn reader(kind: u8) -> Box<dyn Reader> {
    match kind {
        0 => Box::<Nos3Reader>::default(),
        1 => Box::<SagittaReader>::default(),
        2 => Box::new(CcsdsReader::new(Sense::Conjugate)),
        3 => Box::new(CanOpenReader::new(NODE, &STARLOOP, Sense::Conjugate)),
        _ => Box::new(JsonReader::new(Sense::Conjugate)),
    }
}

/// Reads a stream in chunks. Broken: the first byte of a chunk that is not the first one is lost.
fn read(kind: u8, stream: &[u8], lengths: &[u8]) -> (Vec<Measured>, u64) {
    let lost = usize::from(is_broken());
    let (mut reader, mut out) = (reader(kind), Vec::new());
    for (place, chunk) in input::chunks(stream, lengths).enumerate() {
        let part = &chunk[if place > 0 { lost } else { 0 }..];
        reader.take(&Wire::Bytes(part.to_vec()), NOW, &mut out);
    }
    (out, reader.damaged())
}

/// Reads CAN frames: identifier and length in two bytes, data. Most identifiers are those of the node.
fn wires(stream: &[u8]) -> Vec<Wire> {
    let mut rest = Input::new(stream);
    let mut wires = Vec::new();
    while !rest.is_empty() {
        let head = rest.u16();
        let id = match head & 3 {
            3 => (head >> 2) & 0x7FF,
            pdo => 0x180 + 0x100 * pdo + u16::from(NODE),
        };
        let data = rest.take(usize::from(head >> 12) % 9);
        wires.extend(Wire::can(id, data));
    }
    wires
}

fn frames(stream: &[u8]) -> (Vec<Measured>, u64) {
    let (mut reader, mut out) = (reader(3), Vec::new());
    wires(stream).iter().for_each(|wire| reader.take(wire, NOW, &mut out));
    (out, reader.damaged())
}

/// Noise, quiet, and the telemetry of a device: its last measurement is that of the device.
fn after_noise(kind: u8, stream: &[u8]) {
    let q = [0.5, -0.5, 0.5, 0.5];
    let report = Report {
        frame: 7,
        time_tag: NOW - Span::from_ms(100),
        attitude_wxyz: Some(q),
        rate_rad_s: None,
        sigma_rad: [1e-5; 3],
        stars: 21,
        mode: Mode::Tracking,
        exposure_s: 0.05,
        background_dn: f64::NAN,
        temperature_c: -5.0,
    };
    let node = NodeParams { node: NODE, heartbeat_ms: 100, starts_operational: true, map: &STARLOOP };
    let mut device: Box<dyn Device> = match kind {
        0 => Box::new(Nos3Device::new(Limits::default())),
        1 => Box::new(SagittaDevice::new(Limits::default(), 0.05)),
        2 => Box::new(CcsdsDevice::new(100, Sense::Conjugate, Limits::default())),
        3 => Box::new(CanOpenDevice::new(node, Sense::Conjugate, Limits::default(), 0.05)),
        _ => Box::new(JsonDevice::new(0, Sense::Conjugate, Limits::default())),
    };
    let (mut said, mut reader, mut out) = (Vec::new(), reader(kind), Vec::new());
    device.start(NOW, &mut said);
    device.report(&report, NOW, &mut said);
    if device.is_polled() {
        device.take(&Wire::Bytes(vec![0xDE, 0xAD, 2, 0, 0, 0, 0, 0xBE, 0xEF]), NOW, &mut said, &mut Vec::new());
    }
    if kind == 3 {
        wires(stream).iter().for_each(|wire| reader.take(wire, NOW, &mut out));
    } else {
        reader.take(&Wire::Bytes(stream.to_vec()), NOW, &mut out);
        // The ends of a frame of SLIP and of a line; zeros begin no packet of the others.
        let quiet = match kind {
            1 => 0xC0,
            4 => b'\n',
            _ => 0,
        };
        reader.take(&Wire::Bytes(vec![quiet; QUIET]), NOW, &mut out);
    }
    out.clear();
    said.iter().for_each(|wire| reader.take(wire, NOW, &mut out));
    let got = out.last().and_then(|measured| measured.attitude_wxyz).expect("the device is read");
    let dot: f64 = got.iter().zip(q).map(|(a, b)| a * b).sum();
    assert!(dot.abs() > 1.0 - 1e-8, "{got:?}");
}
