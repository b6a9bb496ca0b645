//! The protocol with virtual time and no sockets, as a client of the bootstrap registers would speak it.

mod address_tests;
mod commanded_tests;
mod message_tests;
mod proof_tests;
mod region_tests;
mod user_set_tests;

use super::*;
use crate::network_camera::features::{at, own};
use crate::network_camera::{gvsp::tests::one_region, registers};
use base::time::{Span, Tai};
use proptest::prelude::*;
use std::net::{Ipv4Addr, SocketAddrV4};

const START: Tai = Tai::from_ns(1_790_000_000_000_000_000);
const A: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 7), 40_000);
const B: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 8), 40_000);
const STRANGER: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(10, 0, 1, 7), 40_000);
const OK: u16 = 0;

fn sensor() -> SensorParams {
    SensorParams {
        size_px: [31, 17],
        bits: 12,
        frame_rate_hz: 10.0,
        exposure_s: 0.1,
        gain_e_per_dn: 2.5,
        temperature_c: 20.0,
        colours: None,
    }
}

struct Bench {
    device: Device,
    answer: Answer,
    now: Tai,
    /// Number of the last command.
    id: u16,
}

impl Bench {
    fn new(params: &Params) -> Self {
        Self::with(params, None)
    }

    fn with(params: &Params, commands: Option<CommandParams>) -> Self {
        Self::of(params, &sensor(), commands)
    }

    fn of(params: &Params, sensor: &SensorParams, commands: Option<CommandParams>) -> Self {
        let place = DeviceParams {
            address: Ipv4Addr::new(10, 0, 0, 1),
            mask: Ipv4Addr::new(255, 255, 255, 0),
            mac: [2, 0, 10, 0, 0, 1],
            packet_bytes_max: 1500,
            stream_source_port: 50_000,
            message_source_port: 50_001,
        };
        let device = Device::new(params, sensor, place, commands).unwrap();
        Self { device, answer: Answer::default(), now: START, id: 0 }
    }

    /// Status and payload of the answer; `None` for silence.
    fn ask(&mut self, from: SocketAddrV4, code: u16, payload: &[u8]) -> Option<(u16, Vec<u8>)> {
        self.id += 1;
        self.ask_again(from, code, payload)
    }

    /// Returns the same under the number of the last command.
    fn ask_again(&mut self, from: SocketAddrV4, code: u16, payload: &[u8]) -> Option<(u16, Vec<u8>)> {
        let bytes = self.datagram(code, payload);
        self.device.answer(from, &bytes, self.now, &mut self.answer);
        self.reported(code)
    }

    fn broadcast(&mut self, from: SocketAddrV4, code: u16, payload: &[u8]) -> Option<(u16, Vec<u8>)> {
        self.id += 1;
        let bytes = self.datagram(code, payload);
        self.device.answer_broadcast(from, &bytes, self.now, &mut self.answer);
        self.reported(code)
    }

    fn datagram(&self, code: u16, payload: &[u8]) -> Vec<u8> {
        let length = u16::try_from(payload.len()).unwrap();
        [&[0x42, 1][..], &code.to_be_bytes(), &length.to_be_bytes(), &self.id.to_be_bytes(), payload].concat()
    }

    fn reported(&self, code: u16) -> Option<(u16, Vec<u8>)> {
        let reply = &self.answer.reply;
        if reply.is_empty() {
            return None;
        }
        let half = |place: usize| u16::from_be_bytes([reply[place], reply[place + 1]]);
        assert_eq!((half(2), usize::from(half(4)), half(6)), (code + 1, reply.len() - 8, self.id));
        Some((half(0), reply[8..].to_vec()))
    }

    fn write(&mut self, from: SocketAddrV4, address: u32, value: u32) -> u16 {
        let (status, reported) = self.ask(from, 0x82, &[address.to_be_bytes(), value.to_be_bytes()].concat()).unwrap();
        assert_eq!(reported, [0, 0, 0, u8::from(status == OK)], "how many were written");
        status
    }

    fn read(&mut self, from: SocketAddrV4, address: u32) -> Result<u32, u16> {
        let (status, reported) = self.ask(from, 0x80, &address.to_be_bytes()).unwrap();
        if status == OK { Ok(u32::from_be_bytes(reported.try_into().unwrap())) } else { Err(status) }
    }

    fn memory(&mut self, address: u32, bytes: usize) -> Vec<u8> {
        let mut read = Vec::new();
        while read.len() < bytes {
            let (next, count) = (address + u32::try_from(read.len()).unwrap(), (bytes - read.len()).min(512));
            let payload = [next.to_be_bytes(), u32::try_from(count).unwrap().to_be_bytes()].concat();
            let (status, reported) = self.ask(A, 0x84, &payload).unwrap();
            assert_eq!((status, &reported[..4]), (OK, &next.to_be_bytes()[..]));
            read.extend(&reported[4..]);
        }
        read
    }

    /// Returns the XML that a URL register names, as its bytes.
    fn xml(&mut self, url: u32) -> (String, Vec<u8>) {
        let text = self.memory(url, 512);
        let text = String::from_utf8(text).unwrap().trim_end_matches('\0').to_owned();
        let parts: Vec<&str> = text.split(';').collect();
        let number = |text: &str| u32::from_str_radix(text, 16).unwrap();
        let bytes = self.memory(number(parts[1]), number(parts[2]) as usize);
        (parts[0].to_owned(), bytes)
    }

    /// Takes control as clients do, which fetch the XML first.
    fn control(&mut self) {
        self.prove(A);
        assert_eq!(self.write(A, at::CONTROL, 2), OK);
    }

    /// Returns the address at which a client sees the XML of a URL register.
    fn shown_at(&mut self, from: SocketAddrV4, url: u32) -> u32 {
        let (status, answer) = self.ask(from, 0x84, &[url.to_be_bytes(), 512_u32.to_be_bytes()].concat()).unwrap();
        assert_eq!(status, OK);
        let text = String::from_utf8(answer[4..].to_vec()).unwrap();
        u32::from_str_radix(text.split(';').nth(1).unwrap(), 16).unwrap()
    }

    /// Reads the first word of the XML where this client sees it.
    fn prove(&mut self, from: SocketAddrV4) {
        let address = self.shown_at(from, at::FIRST_URL);
        let (status, _) = self.ask(from, 0x84, &[address.to_be_bytes(), 4_u32.to_be_bytes()].concat()).unwrap();
        assert_eq!(status, OK);
    }

    /// Starts a stream.
    fn stream(&mut self) {
        self.control();
        assert_eq!(self.write(A, at::STREAM_ADDRESS, A.ip().to_bits()), OK);
        assert_eq!(self.write(A, at::STREAM_PORT, 1234), OK);
        assert_eq!(self.write(A, own::ACQUISITION_START, 1), OK);
    }
}

fn bench() -> Bench {
    Bench::new(&Params::default())
}

#[test]
fn discovery_is_answered_to_the_own_subnet_alone() {
    let mut bench = bench();
    let (status, reported) = bench.ask(B, 0x02, &[]).unwrap();
    assert_eq!((status, reported.len()), (OK, 0xF8));
    assert_eq!(reported[..16], [0, 1, 0, 2, 0x80, 0, 0, 1, 0, 0, 2, 0, 10, 0, 0, 1]);
    assert_eq!(reported[0x24..0x28], [10, 0, 0, 1]);
    assert!(reported[0x48..].starts_with(b"starloop\0"));
    assert_eq!(bench.ask(STRANGER, 0x02, &[]), None);
    let counters = bench.device.counters();
    assert_eq!((counters.discoveries, counters.strangers), (1, 1));
}

#[test]
fn both_urls_name_the_same_xml_and_each_of_its_addresses_can_be_read() {
    for form in [XmlForm::Zip, XmlForm::Plain] {
        let mut bench = Bench::new(&Params { xml: form, ..Params::default() });
        let (first, second) = (bench.xml(at::FIRST_URL), bench.xml(at::SECOND_URL));
        let (plain, zipped) = if form == XmlForm::Zip { (second, first) } else { (first, second) };
        let number = plain.0.strip_prefix("Local:starloop_").and_then(|rest| rest.strip_suffix(".xml")).unwrap();
        assert_eq!((number.len(), zipped.0), (8, format!("Local:starloop_{number}.zip")));
        let text = String::from_utf8(plain.1).unwrap();
        let mut inflated = String::new();
        let start = 30 + "starloop.xml".len();
        std::io::Read::read_to_string(&mut flate2::read::DeflateDecoder::new(&zipped.1[start..]), &mut inflated)
            .unwrap();
        assert_eq!(inflated.trim_end(), text.trim_end());
        every_address_is_there(&mut bench, &text);
    }
}

/// Checks that every register is readable memory of the device's port, write-only ones too, and that every reference
/// has its node.
fn every_address_is_there(bench: &mut Bench, text: &str) {
    let document = roxmltree::Document::parse(text).unwrap();
    let names: Vec<&str> = document.descendants().filter_map(|node| node.attribute("Name")).collect();
    let mut registers = 0;
    for node in document.descendants().filter(roxmltree::Node::is_element) {
        let child = |name: &str| {
            node.children().find(|child| child.has_tag_name(("http://www.genicam.org/GenApi/Version_1_1", name)))
        };
        if node.tag_name().name().starts_with('p') && node.tag_name().name() != "pPort" {
            assert!(names.contains(&node.text().unwrap()), "{node:?} names nothing");
        }
        let (Some(address), Some(port)) = (child("Address"), child("pPort")) else { continue };
        if port.text() == Some("Device") {
            let address = u32::from_str_radix(address.text().unwrap().trim_start_matches("0x"), 16).unwrap();
            let length = child("Length").unwrap().text().unwrap().parse().unwrap();
            assert_eq!(bench.memory(address, length).len(), length, "{node:?}");
            registers += 1;
        }
    }
    assert!(registers > 40, "{registers} registers");
    assert!(!text.contains('{'), "every place of the template is filled in");
}

#[test]
fn only_the_controller_writes_and_reads_are_for_all() {
    let mut bench = bench();
    assert_eq!(bench.write(A, own::WIDTH, 8), 0x8006, "without control");
    bench.control();
    assert_eq!(bench.write(B, at::CONTROL, 2), 0x8006);
    assert_eq!(bench.write(B, own::WIDTH, 8), 0x8006);
    assert_eq!(bench.read(B, own::WIDTH), Ok(31));
    assert_eq!(bench.write(A, own::WIDTH, 8), OK);
    assert_eq!(bench.read(B, own::WIDTH), Ok(8));
    assert_eq!(bench.write(A, at::CONTROL, 1), OK);
    assert_eq!(bench.read(B, own::WIDTH), Err(0x8006), "exclusive");
    assert!(bench.ask(B, 0x02, &[]).is_some(), "but still found");
    let counters = bench.device.counters();
    assert_eq!((counters.controllers_accepted, counters.controllers_refused), (1, 1));
}

#[test]
fn a_silent_controller_loses_control_and_its_stream() {
    let mut bench = bench();
    bench.stream();
    assert!(bench.device.stream().destination.is_some() && bench.device.wanted().take().is_some());
    bench.now = START + Span::from_ms(3000);
    bench.device.tick(bench.now);
    assert_eq!(bench.read(A, at::CONTROL), Ok(2), "still, and received again");
    bench.now = START + Span::from_ms(6001);
    bench.device.tick(bench.now);
    assert_eq!((bench.device.stream().destination, bench.device.wanted().take()), (None, None));
    assert_eq!(bench.read(B, at::CONTROL), Ok(0));
    assert_eq!(bench.device.counters().controllers_timed_out, 1);
    assert_eq!(bench.write(B, at::CONTROL, 2), OK, "the next one takes over");
}

#[test]
fn regions_stay_on_the_sensor() {
    let mut bench = bench();
    bench.control();
    for (address, value, status) in [
        (own::OFFSET_X, 1, 0x8002),
        (own::WIDTH, 32, 0x8002),
        (own::WIDTH, 0, 0x8002),
        (own::WIDTH, 11, OK),
        (own::OFFSET_X, 20, OK),
        (own::OFFSET_X, 21, 0x8002),
        (own::WIDTH, 12, 0x8002),
        (own::HEIGHT, 18, 0x8002),
        (own::HEIGHT, 17, OK),
        (own::PIXEL_FORMAT, 0x0108_0001, OK),
        (own::PIXEL_FORMAT, 0x0108_0002, 0x8002),
        (own::SENSOR_WIDTH, 1, 0x8004),
        (0x9000, 1, 0x8003),
        (0xA009, 1, 0x8005),
    ] {
        assert_eq!(bench.write(A, address, value), status, "{address:x} {value}");
    }
    assert_eq!(bench.read(A, own::PAYLOAD_SIZE), Ok(11 * 17));
    assert_eq!(bench.write(A, own::CHUNK_MODE, 1), OK);
    assert_eq!(bench.read(A, own::PAYLOAD_SIZE), Ok(11 * 17 + u32::try_from(chunk::added_bytes()).unwrap()));
    assert_eq!(bench.device.stream().regions, one_region([20, 0, 11, 17]));
    assert_eq!(bench.write(A, own::ACQUISITION_START, 1), OK);
    assert_eq!(bench.write(A, own::WIDTH, 5), 0x8007, "not while frames are acquired");
    assert_eq!(bench.write(A, own::ACQUISITION_STOP, 1), OK);
    assert_eq!(bench.write(A, own::WIDTH, 5), OK);
}

#[test]
fn packet_sizes_are_held_to_the_mtu_and_tested_as_asked() {
    let mut bench = bench();
    bench.control();
    assert_eq!(bench.write(A, at::PACKET_SIZE, 0xC000_0000 | 1500), OK);
    assert_eq!(bench.answer.test_packet, None, "nowhere to send it");
    assert_eq!(bench.write(A, at::STREAM_ADDRESS, STRANGER.ip().to_bits()), 0x8002, "neighbours only");
    bench.write(A, at::STREAM_ADDRESS, A.ip().to_bits());
    bench.write(A, at::STREAM_PORT, 1234);
    for (asked, stored, test) in [
        (1500, 1500, Some(1472)),
        (1501, 1500, None),
        (9000, 1500, None),
        (100, 576, Some(72)),
        (1402, 1400, Some(1374)),
    ] {
        assert_eq!(bench.write(A, at::PACKET_SIZE, 0xC000_0000 | asked), OK);
        assert_eq!(bench.answer.test_packet.map(|(to, bytes)| (to.port(), bytes)), test.map(|bytes| (1234, bytes)));
        assert_eq!(bench.read(A, at::PACKET_SIZE), Ok(0x4000_0000 | stored), "the test bit clears itself");
    }
    bench.write(A, at::PACKET_SIZE, 1000);
    assert_eq!((bench.answer.test_packet, bench.device.stream().packet_bytes), (None, 1000));
}

#[test]
fn many_registers_in_one_command_stop_at_the_first_refusal() {
    let mut bench = bench();
    bench.control();
    let words = [own::WIDTH, 9, own::HEIGHT, 99, own::OFFSET_X, 1];
    let payload: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
    assert_eq!(bench.ask(A, 0x82, &payload), Some((0x8002, vec![0, 0, 0, 1])));
    assert_eq!((bench.read(A, own::WIDTH), bench.read(A, own::OFFSET_X)), (Ok(9), Ok(0)));
    let addresses: Vec<u8> = [own::WIDTH, own::SENSOR_HEIGHT].iter().flat_map(|word| word.to_be_bytes()).collect();
    assert_eq!(bench.ask(A, 0x80, &addresses), Some((OK, vec![0, 0, 0, 9, 0, 0, 0, 17])));
    let name = [&at::USER_NAME.to_be_bytes()[..], b"north head\0\0"].concat();
    assert_eq!(bench.ask(A, 0x86, &name), Some((OK, vec![0, 0, 0, 12])), "bytes");
    assert!(bench.memory(at::USER_NAME, 16).starts_with(b"north head\0"));
}

#[test]
fn triggers_come_from_the_source_that_was_chosen() {
    let mut bench = bench();
    bench.control();
    for (address, value) in [
        (own::TRIGGER_MODE, 1),
        (own::TRIGGER_SOURCE, 1),
        (at::ACTION_DEVICE_KEY, 5),
        (at::ACTION_GROUP_KEY, 6),
        (at::ACTION_GROUP_MASK, 3),
    ] {
        assert_eq!(bench.write(A, address, value), OK);
    }
    let wanted = bench.device.wanted();
    let action = |words: [u32; 3]| words.map(u32::to_be_bytes).concat();
    assert_eq!(bench.ask(B, 0x100, &action([5, 6, 1])), Some((OK, vec![])));
    assert_eq!(wanted.take(), None, "before the start");
    bench.write(A, own::ACQUISITION_START, 1);
    bench.write(A, own::TRIGGER_SOFTWARE, 1);
    assert_eq!(wanted.take(), None, "another source");
    for words in [[4, 6, 1], [5, 7, 1], [5, 6, 4]] {
        assert_eq!(bench.ask(B, 0x100, &action(words)), None, "meant for others");
    }
    assert_eq!(wanted.take(), None);
    assert_eq!(bench.ask(B, 0x100, &action([5, 6, 2])), Some((OK, vec![])));
    assert!(wanted.take().is_some() && wanted.take().is_none(), "one frame");
    assert_eq!(bench.device.counters().triggers, 1);
}

#[test]
fn the_time_of_the_bench_is_latched() {
    let mut bench = bench();
    bench.control();
    bench.now = START + Span::from_ns(123);
    assert_eq!(bench.write(A, at::TIMESTAMP_CONTROL, 2), OK);
    bench.now = START + Span::from_ns(456);
    assert_eq!(bench.memory(at::TIMESTAMP, 8), (START + Span::from_ns(123)).ns().to_be_bytes());
    assert_eq!(bench.memory(at::TICK_FREQUENCY, 8), 1_000_000_000_u64.to_be_bytes());
}

#[test]
fn requests_to_send_again_are_handed_on_and_never_answered() {
    let mut bench = bench();
    bench.stream();
    let request = [[0, 0, 0, 9], [0, 0, 0, 3], [0, 0, 0, 5]].concat();
    assert_eq!(bench.ask(A, 0x40, &request), None);
    assert_eq!(bench.answer.resend.map(|resend| (resend.block, resend.first, resend.last)), Some((9, 3, 5)));
    assert!(bench.ask(A, 0x02, &[]).is_some());
    assert_eq!(bench.answer.resend, None, "only once");
}

#[test]
fn malformed_commands_are_counted_by_reason() {
    let mut bench = bench();
    for bytes in [&[][..], &[0x42; 7], &[0x41, 1, 0, 2, 0, 0, 0, 1], &[0x42, 1, 0, 2, 0, 9, 0, 1]] {
        bench.device.answer(A, bytes, START, &mut bench.answer);
        assert!(bench.answer.reply.is_empty());
    }
    assert_eq!(bench.ask(A, 0x80, &[1]), Some((0x8002, vec![])));
    assert_eq!(bench.ask(A, 0xC0, &[]), Some((0x8001, vec![])));
    let counted: Vec<_> = bench.device.counters().malformed.into_iter().collect();
    let wanted =
        [("too_short", 2), ("unknown_command", 1), ("wrong_key", 1), ("wrong_length", 1), ("wrong_payload", 1)];
    assert_eq!(counted, wanted);
}

#[test]
fn truth_is_sent_while_any_of_it_is_wanted() {
    let mut bench = bench();
    bench.control();
    bench.write(A, own::CHUNK_MODE, 1);
    let fields = u32::try_from(chunk::FIELDS.len()).unwrap();
    for field in 0..fields {
        assert!(bench.device.stream().with_chunks, "{field}");
        assert_eq!(bench.write(A, own::CHUNK_SELECTOR, field), OK);
        assert_eq!(bench.read(A, own::CHUNK_ENABLE), Ok(1));
        assert_eq!(bench.write(A, own::CHUNK_ENABLE, 0), OK);
    }
    assert!(!bench.device.stream().with_chunks);
    assert_eq!(bench.read(A, own::PAYLOAD_SIZE), Ok(31 * 17 * 2));
    assert_eq!(bench.write(A, own::CHUNK_SELECTOR, fields), 0x8002);
    assert_eq!(bench.write(A, own::CHUNK_SELECTOR, 3), OK);
    assert_eq!((bench.read(A, own::CHUNK_ENABLE), bench.write(A, own::CHUNK_ENABLE, 1)), (Ok(0), OK));
    assert!(bench.device.stream().with_chunks);
}

#[test]
fn the_frame_rate_is_that_of_each_nth_frame() {
    let mut bench = bench();
    bench.control();
    let write = |rate: f64| [&own::FRAME_RATE.to_be_bytes()[..], &rate.to_be_bytes()].concat();
    let rate = |bench: &mut Bench| f64::from_be_bytes(bench.memory(own::FRAME_RATE, 8).try_into().unwrap());
    for (asked, taken) in [(10.0, 10.0), (5.0, 5.0), (9.9, 10.0), (3.4, 10.0 / 3.0), (0.01, 0.01), (1e-3, 1e-3)] {
        assert_eq!(bench.ask(A, 0x86, &write(asked)), Some((OK, vec![0, 0, 0, 8])), "{asked}");
        assert!((rate(&mut bench) - taken).abs() < 1e-9 * taken, "{asked}");
    }
    let before = rate(&mut bench);
    for asked in [10.001, 11.0, 1e-4, 0.0, -5.0, f64::NAN, f64::INFINITY] {
        assert_eq!(bench.ask(A, 0x86, &write(asked)), Some((0x8002, vec![0, 0, 0, 4])), "{asked}: at byte 4");
        assert!(rate(&mut bench) == before, "{asked}");
    }
    assert_eq!(bench.write(A, own::FRAME_RATE_MOST, 1), 0x8004);
}

#[test]
fn a_repeated_command_is_answered_as_before_and_carried_out_once() {
    let mut bench = bench();
    bench.control();
    assert_eq!(bench.write(A, own::TRIGGER_MODE, 1), OK);
    assert_eq!(bench.write(A, own::ACQUISITION_START, 1), OK);
    let wanted = bench.device.wanted();
    let trigger = [own::TRIGGER_SOFTWARE.to_be_bytes(), 1_u32.to_be_bytes()].concat();
    let answer = Some((OK, vec![0, 0, 0, 1]));
    assert_eq!(bench.ask(A, 0x82, &trigger), answer);
    assert_eq!(bench.ask_again(B, 0x82, &trigger), Some((0x8006, vec![0, 0, 0, 0])), "of another sender");
    assert_eq!(
        [bench.ask_again(A, 0x82, &trigger), bench.ask_again(A, 0x82, &trigger)],
        [answer.clone(), answer.clone()]
    );
    assert!(wanted.take().is_some() && wanted.take().is_none(), "one frame for one command");
    assert_eq!(bench.device.counters().repeats, 2);
    assert_eq!(bench.ask(A, 0x82, &trigger), answer, "another number is another command");
    assert!(wanted.take().is_some());
    // Reading shows the present memory, whatever the number of the request.
    bench.read(B, own::WIDTH).unwrap();
    assert_eq!(bench.write(A, own::ACQUISITION_STOP, 1), OK);
    assert_eq!(bench.write(A, own::TRIGGER_SOURCE, 1), OK);
    bench.write(A, own::WIDTH, 9);
    assert_eq!(bench.ask_again(B, 0x80, &own::WIDTH.to_be_bytes()), Some((OK, vec![0, 0, 0, 9])));
    // An action that comes by two broadcasts is one.
    bench.write(A, at::ACTION_GROUP_MASK, 1);
    bench.write(A, own::ACQUISITION_START, 1);
    let action = [0_u32, 0, 1].map(u32::to_be_bytes).concat();
    assert_eq!(bench.broadcast(B, 0x100, &action), Some((OK, vec![])));
    let bytes = bench.datagram(0x100, &action);
    bench.device.answer_broadcast(B, &bytes, bench.now, &mut bench.answer);
    assert!(wanted.take().is_some() && wanted.take().is_none());
}

#[test]
fn by_broadcast_come_discovery_actions_and_addresses_alone() {
    let mut bench = bench();
    assert!(bench.broadcast(B, 0x02, &[]).is_some());
    let control = [at::CONTROL.to_be_bytes(), 2_u32.to_be_bytes()].concat();
    assert_eq!(bench.broadcast(A, 0x82, &control), None);
    assert_eq!(bench.read(B, at::CONTROL), Ok(0), "not carried out");
    for (code, payload) in [(0x80, &control[..4]), (0xC0, &[]), (0x04, &[1, 2]), (0x40, &[0; 12])] {
        assert_eq!(bench.broadcast(B, code, payload), None, "{code:x}");
        assert_eq!(bench.answer.resend, None);
    }
    assert_eq!(bench.device.counters().broadcasts_ignored, 5);
}

#[test]
fn half_words_are_refused_and_tiny_packets_do_not_panic() {
    let mut bench = bench();
    bench.control();
    let before = bench.memory(0xA000, (own::END - own::SENSOR_WIDTH) as usize);
    for base in
        [own::WIDTH, own::FRAME_RATE, own::EXPOSURE_TIME - 4, own::GAIN, at::USER_NAME, at::STREAM_PORT, at::CONTROL]
    {
        for off in 1..4 {
            assert_eq!(bench.write(A, base + off, 0), 0x8005, "{base:x} + {off}");
        }
    }
    assert_eq!(bench.memory(0xA000, before.len()), before);
    let place = DeviceParams {
        address: Ipv4Addr::new(10, 0, 0, 1),
        mask: Ipv4Addr::new(255, 255, 255, 0),
        mac: [2, 0, 10, 0, 0, 1],
        packet_bytes_max: 68,
        stream_source_port: 1,
        message_source_port: 2,
    };
    let mut tiny = Bench { device: Device::new(&Params::default(), &sensor(), place, None).unwrap(), ..self::bench() };
    tiny.control();
    assert_eq!(tiny.write(A, at::PACKET_SIZE, 1500), OK, "no panic; such an interface is refused before");
}

/// Returns datagrams: noise, and commands with likely and unlikely addresses and values.
fn any_datagram() -> impl Strategy<Value = Vec<u8>> {
    let code = prop_oneof![
        Just(0x02_u16),
        Just(0x04),
        Just(0x40),
        Just(0x80),
        Just(0x82),
        Just(0x84),
        Just(0x86),
        Just(0x100),
        any::<u16>()
    ];
    let address = prop_oneof![
        0xA000_u32..0xA118,
        0xB00_u32..0xB20,
        0x900_u32..0xA20,
        0xD00_u32..0xD20,
        0x9800_u32..0x9810,
        0_u32..0x300,
        any::<u32>()
    ];
    let value = prop_oneof![0_u32..40, 0x0108_0000_u32..0x0110_0010, Just(A.ip().to_bits()), any::<u32>()];
    let words = prop::collection::vec((address, value), 0..6);
    let command = (any::<u8>(), code, words, 0_usize..4).prop_map(|(flags, code, words, cut)| {
        let mut payload: Vec<u8> =
            words.iter().flat_map(|(a, v)| [a.to_be_bytes(), v.to_be_bytes()].concat()).collect();
        payload.truncate(payload.len().saturating_sub(cut));
        let length = u16::try_from(payload.len()).unwrap();
        [&[0x42, flags][..], &code.to_be_bytes(), &length.to_be_bytes(), &[0, 1], &payload].concat()
    });
    prop_oneof![1 => prop::collection::vec(any::<u8>(), 0..700), 9 => command]
}

/// Returns true if a stream is possible on this sensor.
fn is_possible(stream: &StreamSettings) -> bool {
    let regions = stream.regions.as_slice();
    let is_inside = !regions.is_empty() && regions.iter().all(|region| region.is_within([31, 17]));
    is_inside
        && (576..=1500).contains(&stream.packet_bytes)
        && stream.destination.is_none_or(|to| to.ip().octets()[..3] == [10, 0, 0])
}

proptest! {
    #[test]
    fn any_datagrams_leave_a_possible_camera(steps in prop::collection::vec((0_usize..3, any_datagram(), 0_i64..2000), 1..60)) {
        let mut bench = bench();
        bench.control();
        for (from, datagram, pause_ms) in steps {
            let from = [A, B, STRANGER][from];
            if pause_ms % 4 == 0 {
                bench.device.answer_broadcast(from, &datagram, bench.now, &mut bench.answer);
            } else {
                bench.device.answer(from, &datagram, bench.now, &mut bench.answer);
            }
            prop_assert!(bench.answer.reply.len() <= 548 && (from != STRANGER || bench.answer.reply.is_empty()));
            prop_assert!(is_possible(&bench.device.stream()), "{:?}", bench.device.stream());
            bench.now = bench.now + Span::from_ms(pause_ms);
            bench.device.tick(bench.now);
        }
    }

    #[test]
    fn no_one_but_the_controller_changes_the_stream(steps in prop::collection::vec((any::<bool>(), any_datagram()), 1..60)) {
        let mut bench = bench();
        bench.stream();
        let before = bench.device.stream();
        for (is_neighbour, datagram) in steps {
            let from = if is_neighbour { B } else { STRANGER };
            bench.device.answer(from, &datagram, bench.now, &mut bench.answer);
            prop_assert_eq!(bench.device.stream(), before);
        }
    }
}
