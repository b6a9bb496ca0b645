//! The CANopen tracker, frame by frame.

use super::dictionary::{ORESAT, STARLOOP};
use super::*;
use crate::sample::{lost, report};
use firmware_protocol::can::CanId;

const NODE: u8 = 0x60;

fn device(starts_operational: bool) -> CanOpenDevice {
    with_map(&STARLOOP, starts_operational)
}

fn with_map(map: &'static PdoMap, starts_operational: bool) -> CanOpenDevice {
    let params = NodeParams { node: NODE, heartbeat_ms: 500, starts_operational, map };
    CanOpenDevice::new(params, Sense::Starloop, Limits { exposure_s: Some([0.001, 0.1]) }, 0.05)
}

fn frames(out: &[Wire]) -> Vec<(u16, Vec<u8>)> {
    out.iter()
        .map(|wire| match wire {
            Wire::Can(frame) => (frame.id().parts().0, frame.data().to_vec()),
            Wire::Bytes(bytes) => unreachable!("{bytes:?}"),
        })
        .collect()
}

fn exchange(device: &mut CanOpenDevice, id: u16, data: &[u8]) -> (Vec<(u16, Vec<u8>)>, Vec<Order>) {
    let (mut out, mut orders) = (Vec::new(), Vec::new());
    let frame = CanFrame::classic(id, data).unwrap();
    device.take(&Wire::Can(frame), report().time_tag, &mut out, &mut orders);
    (frames(&out), orders)
}

fn reported(device: &mut CanOpenDevice, report: &Report) -> Vec<(u16, Vec<u8>)> {
    let mut out = Vec::new();
    device.report(report, report.time_tag, &mut out);
    frames(&out)
}

#[test]
fn node_boots_beats_and_speaks_when_it_is_started() {
    let (mut device, mut out) = (device(false), Vec::new());
    let start = report().time_tag;
    device.start(start, &mut out);
    assert_eq!(frames(&out), [(0x760, vec![0])]);
    assert!(reported(&mut device, &report()).is_empty(), "not operational yet");
    out.clear();
    (0..=10).for_each(|i| device.step(start + Span::from_ms(100 * i), &mut out));
    assert_eq!(frames(&out), [(0x760, vec![0x7F]), (0x760, vec![0x7F])]);
    exchange(&mut device, 0, &[1, 0x61]);
    assert!(reported(&mut device, &report()).is_empty(), "control: another node was started");
    let long = CanFrame::classic(CanId::extended(0).unwrap(), &[1, NODE]).unwrap();
    device.take(&Wire::Can(long), start, &mut Vec::new(), &mut Vec::new());
    assert!(reported(&mut device, &report()).is_empty(), "control: an identifier of 29 bits");
    exchange(&mut device, 0, &[1, NODE]);
    assert_eq!(reported(&mut device, &report()).len(), 4);
    assert_eq!(exchange(&mut device, 0, &[129, 0]), (vec![(0x760, vec![0])], vec![Order::Reset]));
}

#[test]
#[allow(clippy::cast_possible_truncation, reason = "single precision on the wire")]
fn pdos_have_the_attitude_its_time_and_the_rates() {
    let mut device = device(true);
    device.start(report().time_tag, &mut Vec::new());
    let got = reported(&mut device, &report());
    let ids: Vec<u16> = got.iter().map(|(id, _)| *id).collect();
    assert_eq!(ids, [0x1E0, 0x2E0, 0x3E0, 0x4E0]);
    assert_eq!(got[0].1[..4], [4, 1, 21, 0]);
    assert_eq!(u32::from_le_bytes(got[0].1[4..].try_into().unwrap()), 12 * 3_600_000 + 250);
    let f32_at = |pdo: usize, at: usize| f32::from_le_bytes(got[pdo].1[at..at + 4].try_into().unwrap());
    assert_eq!(
        [f32_at(1, 0), f32_at(1, 4), f32_at(2, 0), f32_at(2, 4)],
        [0.1_f64.cos() as f32, -(0.1_f64.sin() as f32), 0.0, 0.0]
    );
    let rates: Vec<i16> = got[3].1[..6].chunks(2).map(|two| i16::from_le_bytes([two[0], two[1]])).collect();
    assert_eq!((rates, &got[3].1[6..]), (vec![206, -413, 619], &[7, 0][..]));
    let without = reported(&mut device, &lost());
    assert_eq!(without[0], (0xE0, vec![0x01, 0xFF, 0x81, 0, 0, 0, 0, 0]), "EMCY");
    assert_eq!(without[1].1[1], 0, "control: not known");
    assert_eq!(reported(&mut device, &report())[0], (0xE0, vec![0; 8]), "EMCY: over");
}

#[test]
#[allow(clippy::cast_possible_truncation, reason = "single precision on the wire")]
fn pdos_of_oresats_map_have_its_numbers_and_parts() {
    let mut device = with_map(&ORESAT, true);
    device.start(report().time_tag, &mut Vec::new());
    let got = reported(&mut device, &report());
    let single = |angle: f64| (angle as f32).to_le_bytes();
    let time = (12 * 3_600_000_u32 + 250).to_le_bytes();
    let wanted = [
        (0x3E0, [&[4, 1][..], &time[..]].concat()),
        (0x4E0, [single(0.1_f64.cos()), single(-(0.1_f64.sin()))].concat()),
        (0x1E1, [single(0.0), single(0.0)].concat()),
    ];
    assert_eq!(got, wanted);
    let mut sdo = |data: [u8; 8]| exchange(&mut device, 0x660, &data).0.remove(0).1;
    assert_eq!(sdo([0x40, 0x04, 0x18, 1, 0, 0, 0, 0])[4..], 0x1E1_u32.to_le_bytes());
    assert_eq!(sdo([0x40, 0x04, 0x1A, 2, 0, 0, 0, 0])[4..], 0x4002_0320_u32.to_le_bytes());
    assert_eq!(sdo([0x40, 0x00, 0x18, 1, 0, 0, 0, 0])[0], 0x80, "control: it has no first PDO");
    assert_eq!(sdo([0x2F, 0x04, 0x18, 2, 1, 0, 0, 0])[0], 0x60);
    assert_eq!(reported(&mut device, &report()).len(), 2, "the last one waits");
    assert_eq!(exchange(&mut device, 0x80, &[]).0[0].0, 0x1E1, "with each SYNC");
}

#[test]
fn sdo_reads_and_writes_what_the_dictionary_allows() {
    let mut device = device(false);
    device.start(report().time_tag, &mut Vec::new());
    let mut sdo = |data: [u8; 8]| {
        let (frames, orders) = exchange(&mut device, 0x660, &data);
        let (id, answer) = frames.into_iter().next().unwrap();
        assert_eq!(id, 0x5E0);
        (<[u8; 8]>::try_from(answer).unwrap(), orders)
    };
    assert_eq!(sdo([0x40, 0x17, 0x10, 0, 0, 0, 0, 0]).0, [0x4B, 0x17, 0x10, 0, 0xF4, 1, 0, 0]);
    assert_eq!(sdo([0x2F, 0x00, 0x40, 0, 2, 0, 0, 0]), ([0x60, 0x00, 0x40, 0, 0, 0, 0, 0], vec![Order::Pause]));
    assert_eq!(sdo([0x2F, 0x00, 0x40, 0, 9, 0, 0, 0]).0[4..], 0x0609_0030_u32.to_le_bytes());
    let exposure = |us: u32| {
        let [a, b, c, d] = us.to_le_bytes();
        [0x23, 0x05, 0x40, 0, a, b, c, d]
    };
    assert_eq!(sdo(exposure(20_000)).1, [Order::Exposure(Span::from_ms(20))]);
    assert_eq!(sdo(exposure(9_000_000)).0[0], 0x80, "control: out of range");
    assert_eq!(sdo([0x40, 0x05, 0x40, 0, 0, 0, 0, 0]).0[4..], 20_000_u32.to_le_bytes());
    assert_eq!(sdo([0x2F, 0x07, 0x40, 0, 1, 0, 0, 0]).1, [Order::Reset]);
    assert_eq!(sdo([0x40, 0x00, 0x1A, 1, 0, 0, 0, 0]).0[4..], 0x4000_0008_u32.to_le_bytes());
    assert_eq!(device.answered(), Answered { commands: 6, refused: 2 });
}

#[test]
fn its_name_is_read_in_segments_by_one_client_at_a_time() {
    let mut device = device(false);
    let mut sdo = |command: u8, index: u16| {
        let [low, high] = index.to_le_bytes();
        exchange(&mut device, 0x660, &[command, low, high, 0, 0, 0, 0, 0]).0.remove(0).1
    };
    assert_eq!(sdo(0x60, 0)[4..], 0x0504_0001_u32.to_le_bytes(), "nothing is under way");
    assert_eq!(sdo(0x40, 0x1008)[4..], 21_u32.to_le_bytes());
    let text: Vec<u8> = [0x60, 0x70, 0x60].iter().flat_map(|command| sdo(*command, 0).split_off(1)).collect();
    assert_eq!(text, b"starloop star tracker");
    assert_eq!(sdo(0x70, 0)[0], 0x80, "it is over");
    sdo(0x40, 0x1008);
    sdo(0x40, 0x1017);
    assert_eq!(sdo(0x60, 0)[0], 0x80, "control: another transfer ends it");
}

#[test]
fn pdos_of_a_synchronous_type_wait_for_their_sync() {
    let mut device = device(true);
    device.start(report().time_tag, &mut Vec::new());
    exchange(&mut device, 0x660, &[0x2F, 0x00, 0x18, 2, 2, 0, 0, 0]);
    assert_eq!(reported(&mut device, &report()).len(), 3, "the first one waits");
    assert_eq!(exchange(&mut device, 0x80, &[]).0.len(), 0);
    assert_eq!(exchange(&mut device, 0x80, &[]).0[0].0, 0x1E0, "with every second SYNC");
}

#[test]
fn identifiers_keep_clear_of_the_simulators_own() {
    use firmware_protocol::can::IdMap;
    let is_own = |id: u16| (0..16).filter_map(|node| IdMap::new(0, node)).any(|ids| ids.message(id).is_ok());
    let of_node = |node: u8, map: &PdoMap| {
        let ids = [EMCY, SDO_ANSWER, SDO_REQUEST, ERROR_CONTROL, 0x200, 0x300, 0x400, 0x500];
        let tpdos = map.pdos.iter().map(|pdo| pdo.id());
        ids.into_iter().chain(tpdos).map(|id| id + u16::from(node)).collect::<Vec<_>>()
    };
    let collides = |node: u8| of_node(node, &STARLOOP).into_iter().any(is_own);
    assert!((FIRST_FREE_NODE..=127).all(|node| !collides(node)));
    assert!((1..FIRST_FREE_NODE).any(collides) && collides(FIRST_FREE_NODE - 1), "control");
    // OreSat's fifth PDO is that of the next node, and the last node has no next one.
    let collides = |node: u8| of_node(node, &ORESAT).into_iter().any(is_own);
    assert!((FIRST_FREE_NODE..=126).all(|node| !collides(node)) && collides(127));
}
