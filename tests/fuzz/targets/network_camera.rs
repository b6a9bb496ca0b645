//! GVCP: any datagrams of three senders -> at most one answer each, of bounded length, with the command's number; a
//! stream that the sensor has, sent to neighbours, and changed by its controller only.

#![no_main]

use base::time::{Span, Tai};
use libfuzzer_sys::fuzz_target;
use outputs::network_camera::{Answer, Device, DeviceParams, Params, SensorParams, StreamSettings};
use starloop_fuzz::{Input, control};
use std::net::{Ipv4Addr, SocketAddrV4};

/// Two neighbours and one from outside the subnet 10.0.0.0/24.
const SENDERS: [SocketAddrV4; 3] = [
    SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 7), 4000),
    SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 8), 4001),
    SocketAddrV4::new(Ipv4Addr::new(10, 0, 1, 7), 4002),
];
/// A neighbour that observes.
const WITNESS: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 9), 4003);
const CODES: [u16; 8] = [0x02, 0x40, 0x80, 0x82, 0x84, 0x86, 0x100, 0xC0];
/// Places in which something happens: control, stream, features, keys.
const PLACES: [u32; 8] = [0x0A00, 0x0D00, 0x0A00, 0xA000, 0xA020, 0xA040, 0x9800, 0x0900];
const SIZE_PX: [u32; 2] = [31, 17];
/// UDP data of the longest answer.
const ANSWER_MAX: usize = 548;

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    let (exposure_s, gain_e_per_dn, temperature_c, colours) = (0.1, 1.0, 20.0, None);
    let sensor = SensorParams {
        size_px: SIZE_PX,
        bits: 12,
        frame_rate_hz: 10.0,
        exposure_s,
        gain_e_per_dn,
        temperature_c,
        colours,
    };
    let place = DeviceParams {
        address: Ipv4Addr::new(10, 0, 0, 1),
        mask: Ipv4Addr::new(255, 255, 255, 0),
        mac: [2, 0, 10, 0, 0, 1],
        packet_bytes_max: 1500,
        stream_source_port: 5000,
        message_source_port: 5001,
    };
    let mut device = Device::new(&Params::default(), &sensor, place, None).expect("a legal camera");
    let mut now = Tai::from_ns(1_000_000_000);
    SENDERS.into_iter().for_each(|sender| prove(&mut device, sender, now));
    while !input.is_empty() {
        let from = SENDERS[input.below(3)];
        now = now + Span::from_ms(i64::from(input.u8()) * 20);
        device.tick(now);
        let datagram = datagram(&mut input);
        let controller = controller(&mut device, now);
        let before = device.stream();
        let mut answer = Answer::default();
        device.answer(from, &datagram, now, &mut answer);
        judge_answer(from, &datagram, &answer);
        judge_stream(&device.stream());
        // Broken: the controller may not change it either.
        let is_bystander = controller.is_some_and(|controller| controller != from || control::is_broken());
        assert!(!is_bystander || device.stream() == before, "changed by {from}, controlled by {controller:?}");
    }
});

/// Reads the XML where the camera shows it to this sender: without that no stream starts.
fn prove(device: &mut Device, sender: SocketAddrV4, now: Tai) {
    let mut read = |address: u32, bytes: u32| {
        let mut answer = Answer::default();
        let payload = [address.to_be_bytes(), bytes.to_be_bytes()].concat();
        device.answer(sender, &[&[0x42, 1, 0, 0x84, 0, 8, 0, 2][..], &payload].concat(), now, &mut answer);
        answer.reply.get(12..).unwrap_or_default().to_vec()
    };
    let url = String::from_utf8(read(0x200, 512)).expect("a URL");
    if let Some(address) = url.split(';').nth(1) {
        read(u32::from_str_radix(address, 16).expect("an address"), 4);
    }
}

/// Returns noise, or a command of likely addresses.
fn datagram(input: &mut Input<'_>) -> Vec<u8> {
    let (kind, flags, code) = (input.u8(), input.u8(), CODES[input.below(CODES.len())]);
    let words = usize::from(kind >> 4);
    if kind & 15 == 0 {
        return input.take(words * 40).to_vec();
    }
    let mut payload = Vec::new();
    for word in 0..words {
        let value = if word % 2 == 0 && code != 0x40 {
            PLACES[input.below(PLACES.len())] + 4 * u32::from(input.u8() & 31)
        } else {
            u32::from_be_bytes(input.array())
        };
        payload.extend(value.to_be_bytes());
    }
    let length = u16::try_from(payload.len()).expect("at most 60 bytes");
    [&[0x42, flags][..], &code.to_be_bytes(), &length.to_be_bytes(), &[0xAB, 0xCD], &payload].concat()
}

/// Returns the controller, as a neighbour reads it; `None` without one, or when the neighbour may not read.
fn controller(device: &mut Device, now: Tai) -> Option<SocketAddrV4> {
    let question = [&[0x42, 1, 0, 0x80, 0, 8, 0, 1][..], &0xA04_u32.to_be_bytes(), &0xA14_u32.to_be_bytes()].concat();
    let mut answer = Answer::default();
    device.answer(WITNESS, &question, now, &mut answer);
    let (status, reported) = (answer.reply.get(..2)?, answer.reply.get(8..16)?);
    let word = |place: usize| u32::from_be_bytes(reported[place..place + 4].try_into().expect("four bytes"));
    let address = SocketAddrV4::new(Ipv4Addr::from_bits(word(4)), u16::try_from(word(0)).expect("a port"));
    (status == [0, 0] && word(0) != 0).then_some(address)
}

fn judge_answer(from: SocketAddrV4, datagram: &[u8], answer: &Answer) {
    let reply = &answer.reply;
    let is_command = datagram.len() >= 8
        && datagram[0] == 0x42
        && usize::from(u16::from_be_bytes([datagram[4], datagram[5]])) == datagram.len() - 8;
    assert!(reply.len() <= ANSWER_MAX, "{} bytes", reply.len());
    if !is_command || from == SENDERS[2] {
        assert!(reply.is_empty() && answer.resend.is_none() && answer.test_packet.is_none());
        return;
    }
    let code = u16::from_be_bytes([datagram[2], datagram[3]]);
    let must_answer = datagram[1] & 1 != 0 && !matches!(code, 0x40 | 0x100);
    assert!(!must_answer || !reply.is_empty(), "no answer to {datagram:02X?}");
    if !reply.is_empty() {
        assert!(datagram[1] & 1 != 0, "an answer was not wanted");
        assert_eq!(reply[2..4], code.wrapping_add(1).to_be_bytes());
        assert_eq!(usize::from(u16::from_be_bytes([reply[4], reply[5]])), reply.len() - 8);
        assert_eq!(reply[6..8], datagram[6..8]);
    }
}

fn judge_stream(stream: &StreamSettings) {
    let [columns, rows] = SIZE_PX.map(|side| side as usize);
    let regions = stream.regions.as_slice();
    assert!(!regions.is_empty() && regions.iter().all(|region| region.is_within([columns, rows])), "{stream:?}");
    assert!((576..=1500).contains(&stream.packet_bytes), "{stream:?}");
    assert!(stream.destination.is_none_or(|to| to.ip().octets()[..3] == [10, 0, 0]), "{stream:?}");
}
