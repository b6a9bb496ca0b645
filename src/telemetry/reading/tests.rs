//! Round trips: what a device says is what its reader gives, in runs of any length; damage is counted.

use super::*;
use crate::canopen::dictionary::{ORESAT, PdoMap, STARLOOP};
use crate::canopen::{CanOpenDevice, CanOpenReader, NodeParams};
use crate::ccsds::{CcsdsDevice, CcsdsReader};
use crate::json::{JsonDevice, JsonReader};
use crate::nos3::{Nos3Device, Nos3Reader};
use crate::sagitta::{SagittaDevice, SagittaReader};
use crate::sample::{lost, report};
use crate::{Device, Limits, Report, Sense};
use base::time::Span;
use firmware_protocol::can::{CanFrame, CanId};
use proptest::prelude::*;

const NODE: u8 = 100;
const LATER: Span = Span::from_ms(80);
/// Half a step of NOS3's 16 bits on each component, twice.
const NOS3_RAD: f64 = 1.3e-4;

/// A protocol with its two ends, and the resolution of an attitude, rad.
struct Ends {
    device: Box<dyn Device>,
    reader: Box<dyn Reader>,
    resolution_rad: f64,
    is_tagged: bool,
}

fn all_ends(sense: Sense) -> [Ends; 6] {
    let node = |map: &'static PdoMap| NodeParams { node: NODE, heartbeat_ms: 100, starts_operational: true, map };
    let can_open = |map| CanOpenDevice::new(node(map), sense, Limits::default(), 0.05);
    let of = |device: Box<dyn Device>, reader: Box<dyn Reader>, resolution_rad: f64| Ends {
        is_tagged: !device.is_polled(),
        device,
        reader,
        resolution_rad,
    };
    [
        of(Box::new(Nos3Device::new(Limits::default())), Box::<Nos3Reader>::default(), NOS3_RAD),
        of(Box::new(SagittaDevice::new(Limits::default(), 0.05)), Box::<SagittaReader>::default(), 3e-7),
        of(Box::new(CcsdsDevice::new(100, sense, Limits::default())), Box::new(CcsdsReader::new(sense)), 1e-12),
        of(Box::new(can_open(&STARLOOP)), Box::new(CanOpenReader::new(NODE, &STARLOOP, sense)), 3e-7),
        of(Box::new(can_open(&ORESAT)), Box::new(CanOpenReader::new(NODE, &ORESAT, sense)), 3e-7),
        of(Box::new(JsonDevice::new(0, sense, Limits::default())), Box::new(JsonReader::new(sense)), 2e-12),
    ]
}

/// Returns the packets of one report: of a polled device, the answer to a request of data.
fn said(device: &mut dyn Device, report: &Report) -> Vec<Wire> {
    let (mut out, now) = (Vec::new(), report.time_tag + LATER);
    device.start(now, &mut out);
    device.report(report, now, &mut out);
    if device.is_polled() {
        let request = Wire::Bytes(vec![0xDE, 0xAD, 2, 0, 0, 0, 0, 0xBE, 0xEF]);
        device.take(&request, now, &mut out, &mut Vec::new());
    }
    out
}

/// Angle between two attitudes, rad.
fn angle(a: [f64; 4], b: [f64; 4]) -> f64 {
    let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    let across: f64 = a.iter().zip(b).map(|(a, b)| (a - dot.signum() * b).powi(2)).sum();
    2.0 * across.sqrt()
}

fn received(reader: &mut dyn Reader, wires: &[Wire], at: Tai) -> Vec<Measured> {
    let mut out = Vec::new();
    wires.iter().for_each(|wire| reader.take(wire, at, &mut out));
    out
}

fn round_trip(q: [f64; 4], sense: Sense) {
    let report = Report { attitude_wxyz: Some(q), ..report() };
    let at = report.time_tag + LATER;
    for mut ends in all_ends(sense) {
        let wires = said(ends.device.as_mut(), &report);
        let [measured] = received(ends.reader.as_mut(), &wires, at)[..] else { panic!("one report") };
        let got = measured.attitude_wxyz.unwrap();
        assert!(angle(got, q) < ends.resolution_rad, "{got:?} {q:?}");
        // Control: two axes swapped are another attitude.
        let [w, x, y, z] = q;
        assert!((x - y).abs() < 1e-3 || angle(got, [w, y, x, z]) > ends.resolution_rad);
        assert_eq!(measured.time_tag.is_some(), ends.is_tagged);
        let off_ns = measured.time_tag.map_or(0, |tag| (report.time_tag - tag).ns());
        assert!((0..1_000_000).contains(&off_ns), "{off_ns} ns");
        assert_eq!((measured.at, ends.reader.damaged()), (at, 0));
        assert!(measured.stars.is_none_or(|stars| stars == 21));
    }
}

proptest! {
    #[test]
    fn attitudes_come_back_to_the_resolution_of_their_protocol(
        parts in [-1.0..1.0_f64, -1.0..1.0, -1.0..1.0, -1.0..1.0], is_conjugate in any::<bool>()
    ) {
        let norm = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
        prop_assume!(norm > 0.1);
        round_trip(parts.map(|part| part / norm), if is_conjugate { Sense::Conjugate } else { Sense::Starloop });
    }

    #[test]
    fn runs_of_any_length_say_the_same(cut in 1..40_usize) {
        for mut ends in all_ends(Sense::Starloop) {
            let wires = said(ends.device.as_mut(), &report());
            let whole = received(ends.reader.as_mut(), &wires, report().time_tag);
            let bytes: Vec<u8> = wires.iter().flat_map(|wire| wire.data().to_vec()).collect();
            if wires.iter().any(|wire| matches!(wire, Wire::Can(_))) {
                continue;
            }
            let pieces: Vec<Wire> = bytes.chunks(cut).map(|piece| Wire::Bytes(piece.to_vec())).collect();
            let again = received(all_ends(Sense::Starloop).into_iter().find(|other| other.resolution_rad == ends.resolution_rad)
                .unwrap().reader.as_mut(), &pieces, report().time_tag);
            prop_assert_eq!(again, whole);
        }
    }
}

#[test]
fn a_lost_attitude_is_read_as_such() {
    for mut ends in all_ends(Sense::Starloop) {
        let mut wires = said(ends.device.as_mut(), &report());
        wires.extend(said(ends.device.as_mut(), &lost()));
        let measured = received(ends.reader.as_mut(), &wires, report().time_tag);
        let known: Vec<bool> = measured.iter().map(|measured| measured.attitude_wxyz.is_some()).collect();
        assert_eq!((known, ends.reader.damaged()), (vec![true, false], 0));
    }
}

#[test]
fn damage_is_counted_and_the_next_packet_is_read() {
    for mut ends in all_ends(Sense::Starloop) {
        let whole = said(ends.device.as_mut(), &report());
        let mut damaged = whole.clone();
        let is_polled = !ends.is_tagged;
        // PDO2 of this program's map, PDO4 of OreSat's.
        let has_first =
            whole.iter().any(|wire| matches!(wire, Wire::Can(frame) if frame.id() == 0x180 + u16::from(NODE)));
        let real_and_i = if has_first { 0x280 } else { 0x480 };
        for wire in &mut damaged {
            match wire {
                // The validity of NOS3, the bracket of JSON, a byte of the quaternion of the others.
                Wire::Bytes(bytes) => {
                    let place = match bytes[0] {
                        _ if is_polled => 19,
                        b'{' => 0,
                        _ => bytes.len().saturating_sub(40).max(8),
                    };
                    bytes[place] ^= 0x40;
                }
                Wire::Can(frame) if frame.id() == real_and_i + u16::from(NODE) => {
                    let mut data = frame.data().to_vec();
                    data[3] ^= 0x40;
                    *frame = CanFrame::classic(frame.id(), &data).unwrap();
                }
                Wire::Can(_) => {}
            }
        }
        damaged.extend(whole);
        let measured = received(ends.reader.as_mut(), &damaged, report().time_tag);
        assert_eq!(measured.len(), 1);
        assert!(ends.reader.damaged() >= 1);
    }
}

#[test]
fn others_on_the_line_are_passed_over_and_midnight_is_crossed() {
    let mut reader = CanOpenReader::new(NODE, &STARLOOP, Sense::Starloop);
    let other = CanFrame::classic(0x180 + u16::from(NODE) + 1, &[1; 8]).unwrap();
    let long = CanId::extended(0x180 + u32::from(NODE)).unwrap();
    for id in [other.id(), long] {
        let frame = Wire::Can(CanFrame::classic(id, &[1; 8]).unwrap());
        assert!(received(&mut reader, &[frame], report().time_tag).is_empty());
    }
    assert_eq!(reader.damaged(), 0, "passed over");
    // 23:59:59.900 is received at 00:00:00.050 of the next day.
    let midnight = Tai::from_rfc3339("2026-03-02T00:00:00Z").unwrap();
    let tag = midnight - Span::from_ms(100);
    let node = NodeParams { node: NODE, heartbeat_ms: 0, starts_operational: true, map: &STARLOOP };
    let mut device = CanOpenDevice::new(node, Sense::Starloop, Limits::default(), 0.05);
    let wires = said(&mut device, &Report { time_tag: tag, ..report() });
    let measured = received(&mut reader, &wires, midnight + Span::from_ms(50));
    assert_eq!((measured[0].time_tag, reader.damaged()), (Some(tag), 0));
}
