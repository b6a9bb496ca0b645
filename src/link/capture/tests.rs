//! Written captures read back exact; blocks and lines made by hand from the formats' own documents are read; any damage
//! is an error with its place, or reads as another packet, and never panics.

use super::*;
use crate::{CHUNK_MAX, DATAGRAM_MAX, Datagram, SerialChunk};
use base::time::Span;
use firmware_protocol::can::{CanFrame, CanId};
use proptest::prelude::*;

const FORMATS: [CaptureFormat; 2] = [CaptureFormat::Candump, CaptureFormat::Pcapng];

fn at(ns: i64) -> Tai {
    Tai::from_ns(1_790_000_000_000_000_000 + ns)
}

fn can(ns: i64, direction: Direction, frame: Option<CanFrame>) -> CapturedPacket {
    CapturedPacket { at: at(ns), direction, interface: 0, packet: Packet::Can(frame.unwrap()) }
}

/// Returns frames of every kind and length.
fn frames() -> Vec<CapturedPacket> {
    let data: Vec<u8> = (0..64).map(|i: u8| i.wrapping_mul(37)).collect();
    vec![
        can(0, Direction::Received, CanFrame::classic(0x123, &data[..4])),
        can(1, Direction::Sent, CanFrame::classic(0, &[])),
        can(123_456_789, Direction::Received, CanFrame::classic(0x7FF, &data[..8])),
        can(999_999_999, Direction::Sent, CanFrame::fd(0x300, &data[..48])),
        can(1_000_000_001, Direction::Received, CanFrame::fd(0x310, &data)),
        can(1_000_000_002, Direction::Received, CanFrame::fd(0x310, &[])),
    ]
}

fn extended(number: u32) -> CanId {
    CanId::extended(number).unwrap()
}

/// Returns frames of one number, of 11 and of 29 bits, and of the longest number.
fn frames_of_either_length() -> Vec<CapturedPacket> {
    let data = [1; 8];
    vec![
        can(0, Direction::Received, CanFrame::classic(0x123, &data)),
        can(1, Direction::Received, CanFrame::classic(extended(0x123), &data)),
        can(2, Direction::Sent, CanFrame::fd(extended(0x123), &data)),
        can(3, Direction::Sent, CanFrame::fd(0x123, &data)),
        can(4, Direction::Received, CanFrame::classic(extended(0x1FFF_FFFF), &[])),
    ]
}

fn serial(ns: i64, bytes: &[u8]) -> CapturedPacket {
    let packet = Packet::Serial(SerialChunk::new(bytes).unwrap());
    CapturedPacket { at: at(ns), direction: Direction::Sent, interface: 0, packet }
}

fn datagram(ns: i64, bytes: &[u8]) -> CapturedPacket {
    let packet = Packet::Datagram(Datagram::new(bytes).unwrap());
    CapturedPacket { at: at(ns), direction: Direction::Received, interface: 0, packet }
}

fn written(format: CaptureFormat, packets: &[CapturedPacket]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = CaptureWriter::new(&mut bytes, format).unwrap();
    packets.iter().for_each(|packet| writer.write(packet).unwrap());
    drop(writer);
    bytes
}

/// Returns everything up to the end or the first error, the error, and the number of skipped frames.
fn read(bytes: &[u8]) -> (Vec<CapturedPacket>, Option<CaptureError>, u64) {
    let mut reader = match CaptureReader::new(bytes) {
        Ok(reader) => reader,
        Err(error) => return (Vec::new(), Some(error), 0),
    };
    let mut packets = Vec::new();
    loop {
        match reader.read() {
            Ok(Some(packet)) => packets.push(packet),
            Ok(None) => return (packets, None, reader.skipped()),
            Err(error) => return (packets, Some(error), reader.skipped()),
        }
    }
}

fn refusal(bytes: &[u8]) -> String {
    read(bytes).1.expect("an error").to_string()
}

#[test]
fn written_captures_read_back_exact() {
    for format in FORMATS {
        let (packets, error, skipped) = read(&written(format, &frames()));
        assert!(error.is_none() && skipped == 0, "{error:?}");
        assert_eq!(packets, frames(), "{format:?}");
        let (packets, error, skipped) = read(&written(format, &frames_of_either_length()));
        assert!(error.is_none() && skipped == 0, "{error:?}");
        assert_eq!(packets, frames_of_either_length(), "{format:?}");
    }
    let mixed = [frames()[0], serial(5, &[0; CHUNK_MAX]), serial(6, &[1]), frames()[3]];
    assert_eq!(read(&written(CaptureFormat::Pcapng, &mixed)).0, mixed);
    let plain = [datagram(1, &[7; DATAGRAM_MAX]), serial(2, &[7; 8]), datagram(3, &[7; 8])];
    let (packets, error, skipped) = read(&written(CaptureFormat::Pcapng, &plain));
    assert!(error.is_none() && skipped == 0 && packets == plain, "{packets:?}");
}

#[test]
fn candump_log_refuses_datagrams() {
    let mut bytes = Vec::new();
    let mut writer = CaptureWriter::new(&mut bytes, CaptureFormat::Candump).unwrap();
    assert!(matches!(writer.write(&datagram(0, &[1])), Err(CaptureError::NotCan)));
}

/// Returns the same packets as if each came by another link, the last one by a link beyond all numbers.
fn of_links(mut packets: Vec<CapturedPacket>) -> Vec<CapturedPacket> {
    for (packet, interface) in packets.iter_mut().zip([1, 0, 1, 7, 0, u8::MAX]) {
        packet.interface = interface;
    }
    packets
}

#[test]
fn packets_of_several_links_keep_the_number_of_theirs() {
    let wanted = of_links(frames());
    for format in FORMATS {
        let (packets, error, _) = read(&written(format, &wanted));
        assert!(error.is_none(), "{error:?}");
        assert_eq!(packets, wanted, "{format:?}");
        assert_ne!(read(&written(format, &frames())).0, wanted, "{format:?}, control: all by one link");
    }
    // CAN and serial together, and both kinds under one number.
    let other = CapturedPacket { interface: 1, ..serial(5, &[7; 3]) };
    let mixed = [frames()[0], other, serial(6, &[1]), wanted[0], other];
    assert_eq!(read(&written(CaptureFormat::Pcapng, &mixed)).0, mixed);
}

#[test]
fn links_are_interfaces_that_others_can_name() {
    let bytes = written(CaptureFormat::Pcapng, &of_links(frames()));
    let has = |name: &[u8]| bytes.windows(name.len()).any(|part| part == name);
    assert!(has(b"link0\0") && has(b"link1\0") && has(b"link255\0") && !has(b"link2\0"));
    let text = String::from_utf8(written(CaptureFormat::Candump, &of_links(frames()))).unwrap();
    let names: Vec<&str> = text.lines().map(|line| line.split(' ').nth(1).unwrap()).collect();
    assert_eq!(names, ["can1", "can0", "can1", "can7", "can0", "can255"]);
}

#[test]
fn interfaces_of_others_have_the_number_of_their_name_or_place() {
    let log: String =
        ["vcan3", "can12", "x", "1", "can99999999999999999999"].map(|name| format!("(1.5) {name} 123#11\n")).concat();
    let numbers: Vec<u8> = read(log.as_bytes()).0.iter().map(|packet| packet.interface).collect();
    assert_eq!(numbers, [3, 12, 0, 1, u8::MAX]);
    // Two interfaces without a name, and packets of the second.
    let interface = block(false, 1, &[227, 0, 0, 0, 0, 0, 0, 0]);
    let packet = [&[1, 0, 0, 0][..], &[0; 8], &[12, 0, 0, 0], &[12, 0, 0, 0], &WHOLE_HEADER].concat();
    let section = written(CaptureFormat::Pcapng, &[]);
    let bytes = [section, interface.clone(), interface, block(false, 6, &packet)].concat();
    assert_eq!(read(&bytes).0[0].interface, 1);
}

#[test]
fn a_candump_log_has_the_lines_that_candump_writes() {
    // TAI is 37 s ahead of UTC: Unix time 1790000000 is TAI 1790000037.
    let frame = CapturedPacket { at: Tai::from_unix_ns(1_790_000_000_000_000_042), ..frames()[0] };
    let fd = CapturedPacket { at: frame.at, ..frames()[5] };
    assert_eq!(frame.at.ns(), 1_790_000_037_000_000_042);
    let text = String::from_utf8(written(CaptureFormat::Candump, &[frame, frames()[1], fd])).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "(1790000000.000000042) can0 123#00254A6F R");
    assert!(lines[1].ends_with(" can0 000# T"), "{text}");
    assert!(lines[2].ends_with(" can0 310##1 R"), "{text}");
    let text = String::from_utf8(written(CaptureFormat::Candump, &frames_of_either_length())).unwrap();
    assert!(text.contains(" can0 00000123#0101") && text.contains(" can0 1FFFFFFF# R"), "{text}");
}

#[test]
fn a_candump_log_refuses_serial_bytes() {
    let mut writer = CaptureWriter::new(Vec::new(), CaptureFormat::Candump).unwrap();
    let error = writer.write(&serial(0, &[1])).unwrap_err().to_string();
    assert!(error.contains("use pcapng"), "{error}");
}

#[test]
fn stamps_keep_a_leap_second_in_pcapng_and_not_in_a_candump_log() {
    let midnight = Tai::from_rfc3339("2017-01-01T00:00:00Z").unwrap();
    let inside = CapturedPacket { at: midnight - Span::from_ms(500), ..frames()[0] };
    assert_eq!(read(&written(CaptureFormat::Pcapng, &[inside])).0[0].at, inside.at);
    let read_again = read(&written(CaptureFormat::Candump, &[inside])).0[0].at;
    assert_eq!(read_again - inside.at, Span::from_ms(1000), "the second after it is meant");
}

#[test]
fn logs_of_others_are_read() {
    let log = "(1436509052.249713) vcan0 044#2A366C2BBA\n\n  (1436509052.25) can1 0F6#7ADFE07BD2 \n\
               (0000000001.1) x 20000004#0000000000000000 R\n(1.1) x 80000123#11\n(1.1) x 123#R\n(1.1) x 123#R8\n(1.1) x 123#1122334455667788_B\n\
               (1.000000001) x 7FF##311223344\r\n";
    let (packets, error, skipped) = read(log.as_bytes());
    assert!(error.is_none(), "{error:?}");
    assert_eq!(skipped, 4, "more than 29 bits, as error frames have, and two remote frames");
    assert_eq!(packets.len(), 4);
    assert_eq!(packets[0].at.to_unix_ns(), 1_436_509_052_249_713_000);
    assert_eq!(packets[1].at.to_unix_ns(), 1_436_509_052_250_000_000);
    assert_eq!(packets[1].packet, Packet::Can(CanFrame::classic(0x0F6, &[0x7A, 0xDF, 0xE0, 0x7B, 0xD2]).unwrap()));
    assert_eq!(packets[3].packet, Packet::Can(CanFrame::fd(0x7FF, &[0x11, 0x22, 0x33, 0x44]).unwrap()));
}

#[test]
fn a_line_that_is_none_is_refused_with_its_number() {
    let good = "(1.5) can0 123#11 R\n";
    for (bad, why) in [
        ("1.5 can0 123#11", "no stamp"),
        ("(1.5 can0 123#11", "no stamp"),
        ("(-1.5) can0 123#11", "no stamp"),
        ("(1.) can0 123#11", "one to nine digits"),
        ("(1.1234567890) can0 123#11", "one to nine digits"),
        ("(99999999999999.5) can0 123#11", "2262"),
        ("(99999999999999999999.5) can0 123#11", "no stamp"),
        ("(1.5)", "the interface is missing"),
        ("(1.5) can0", "the frame is missing"),
        ("(1.5) can0 123", "no #"),
        ("(1.5) can0 1234#11", "neither 3 nor 8"),
        ("(1.5) can0 1G3#11", "the identifier is not hexadecimal"),
        ("(1.5) can0 800#11", "more than 11 bits"),
        ("(1.5) can0 123#1", "whole bytes"),
        ("(1.5) can0 123#1G", "not hexadecimal"),
        ("(1.5) can0 123##", "flags are missing"),
        ("(1.5) can0 123#11 X", "only R or T"),
        ("(1.5) can0 123#11 R R", "follows the direction"),
        ("\u{fffd}\0\u{7}", "no stamp"),
    ] {
        let log = format!("{good}{bad}\n{good}");
        let (packets, error, _) = read(log.as_bytes());
        let error = error.expect(bad).to_string();
        assert!(packets.len() == 1 && error.contains("line 2: ") && error.contains(why), "{bad}: {error}");
    }
    let error = refusal(format!("{good}(1.5) {}\n", "x".repeat(LINE_MAX)).as_bytes());
    assert!(error.contains("line 2: longer than 1024"), "{error}");
}

#[test]
fn a_frame_of_a_length_that_none_has_is_left_out_and_counted() {
    let good = "(1.5) can0 123#11 R\n";
    for bytes in
        ["112233445566778899", "112233445566778899AABB", "#1112233445566778899", "#1112233445566778899AABBCCDD"]
    {
        let log = format!("{good}(1.6) can0 123#{bytes} R\n{good}");
        let mut reader = CaptureReader::new(log.as_bytes()).unwrap();
        let packets = core::iter::from_fn(|| reader.read().unwrap()).count();
        assert_eq!((packets, reader.skipped()), (2, 1), "{bytes}");
    }
}

#[test]
fn files_of_other_formats_are_refused_with_advice() {
    assert!(refusal(b"").contains("empty"));
    for magic in [0xA1B2_C3D4_u32, 0xA1B2_3C4D] {
        for bytes in [magic.to_le_bytes(), magic.to_be_bytes()] {
            assert!(refusal(&bytes).contains("editcap -F pcapng"));
        }
    }
    assert!(refusal(b"\x7FELF\x02\x01\x01\0\0").contains("line 1: "), "a program is cut off or no line");
}

/// Returns a block by the specification, in an order of choice.
fn block(big: bool, kind: u32, body: &[u8]) -> Vec<u8> {
    let word = |word: u32| if big { word.to_be_bytes() } else { word.to_le_bytes() };
    let length = word(u32::try_from(body.len() + 12).unwrap());
    [&word(kind), &length, body, &length].concat()
}

/// Returns a section with one interface (link type, units option, offset) and one packet without options.
fn foreign(big: bool, link_type: u16, resolution: u8, ticks: u64, data: &[u8]) -> Vec<u8> {
    let word = |word: u32| if big { word.to_be_bytes() } else { word.to_le_bytes() };
    let half = |half: u16| if big { half.to_be_bytes() } else { half.to_le_bytes() };
    let section = [&word(0x1A2B_3C4D)[..], &half(1), &half(0), &[0xFF; 8]].concat();
    let units = [&half(9)[..], &half(1), &[resolution, 0, 0, 0], &half(0), &half(0)].concat();
    let interface = [&half(link_type)[..], &[0; 2], &word(0x4_0000), &units].concat();
    let length = word(u32::try_from(data.len()).unwrap());
    let mut packet = [word(0), word((ticks >> 32) as u32), word(ticks as u32), length, length].concat();
    packet.extend(data);
    packet.resize(packet.len().next_multiple_of(4), 0);
    [
        block(big, 0x0A0D_0D0A, &section),
        block(big, 4, &[0; 8]), // names: of no use here
        block(big, 1, &interface),
        block(big, 6, &packet),
    ]
    .concat()
}

const WHOLE_HEADER: [u8; 12] = [0, 0, 0x01, 0x23, 4, 0, 0, 0, 0xDE, 0xAD, 0xBE, 0xEF];

#[test]
fn blocks_of_others_are_read_in_both_orders_and_all_units() {
    let wanted = Packet::Can(CanFrame::classic(0x123, &[0xDE, 0xAD, 0xBE, 0xEF]).unwrap());
    for big in [false, true] {
        for (resolution, ticks, unix_ns) in [
            (6, 1_772_366_400_123_456, 1_772_366_400_123_456_000),
            (9, 1_772_366_400_123_456_789, 1_772_366_400_123_456_789),
            (3, 1_772_366_400_123, 1_772_366_400_123_000_000),
            (0, 1_772_366_400, 1_772_366_400_000_000_000),
            (10, 17_723_664_001_234_567_899, 1_772_366_400_123_456_789),
            (0x80 | 10, 1_772_366_400 * 1024 + 512, 1_772_366_400_500_000_000),
        ] {
            let (packets, error, _) = read(&foreign(big, 227, resolution, ticks, &WHOLE_HEADER));
            assert!(error.is_none(), "{error:?}");
            assert_eq!((packets[0].at.to_unix_ns(), packets[0].packet), (unix_ns, wanted), "{resolution:02X}");
        }
    }
}

#[test]
fn frames_without_a_form_are_counted() {
    let headed = |id: u32| [&id.to_be_bytes()[..], &WHOLE_HEADER[4..]].concat();
    let data = &[0xDE, 0xAD, 0xBE, 0xEF];
    for (id, frame) in [
        (0x123, CanFrame::classic(0x123, data)),
        (0x8000_0123, CanFrame::classic(extended(0x123), data)),
        (0x9FFF_FFFF, CanFrame::classic(extended(0x1FFF_FFFF), data)),
    ] {
        let (packets, _, skipped) = read(&foreign(false, 227, 9, 1, &headed(id)));
        assert_eq!((packets[0].packet, skipped), (Packet::Can(frame.unwrap()), 0), "{id:x}");
    }
    let [remote, error, long] = [0xC000_0123, 0x2000_0004, 0x800].map(headed);
    let too_short = &WHOLE_HEADER[..6];
    let cut = &WHOLE_HEADER[..10];
    let of_can = [&remote[..], &error, &long, too_short, cut].map(|data| (227, data));
    for (link_type, data) in of_can.into_iter().chain([(1, &WHOLE_HEADER[..])]) {
        let (packets, error, skipped) = read(&foreign(false, link_type, 9, 1, data));
        assert!(packets.is_empty() && error.is_none() && skipped == 1, "{link_type}: {error:?}");
    }
    let (packets, _, _) = read(&foreign(false, 147, 9, 1, &[7; 2 * CHUNK_MAX + 1]));
    assert_eq!(packets.len(), 3, "a long run of serial bytes comes in pieces");
}

#[test]
fn damaged_blocks_are_refused_with_their_offset() {
    let good = foreign(false, 227, 9, 1, &WHOLE_HEADER);
    let last = good.len() - (32 + WHOLE_HEADER.len());
    let changed = |place: usize, byte: u8| {
        let mut bytes = good.clone();
        bytes[place] = byte;
        bytes
    };
    for (bytes, why) in [
        (changed(8, 0), "byte order"),
        (changed(4, 8), "a section header of 8 bytes"),
        (changed(last + 4, 45), "length 45, wanted a multiple of 4"),
        (changed(last + 6, 0xFF), "wanted 20 to 262144"),
        (changed(last + 8, 9), "interface 9, which was not described"),
        (changed(last + 20, 200), "a packet of 200 bytes"),
        (changed(good.len() - 4, 200), "its length is 44 at its start and 200 at its end"),
        (foreign(false, 227, 0, u64::MAX, &WHOLE_HEADER), "beyond 2262"),
        (foreign(false, 227, 100, 1, &WHOLE_HEADER), "beyond 2262"),
        (foreign(false, 227, 0xFF, 1, &WHOLE_HEADER), ""),
    ] {
        match read(&bytes).1 {
            Some(error) => {
                let error = error.to_string();
                assert!(error.contains(why) && error.contains("at byte "), "{why}: {error}");
            }
            None => assert!(why.is_empty(), "{why}: read"),
        }
    }
}

#[test]
fn a_file_that_was_cut_off_is_read_up_to_the_cut() {
    for format in FORMATS {
        let packets = frames();
        let whole = written(format, &packets);
        // Where each packet's text or block is complete.
        let ends: Vec<usize> = (1..=packets.len()).map(|count| written(format, &packets[..count]).len()).collect();
        for length in 4..whole.len() {
            let (got, error, _) = read(&whole[..length]);
            let complete = ends.iter().filter(|end| **end <= length).count();
            assert_eq!(got, packets[..complete], "{format:?} at {length}");
            match error {
                Some(error) => assert!(error.to_string().contains("cut off at "), "{length}: {error}"),
                None => assert_eq!(written(format, &packets[..complete]).len().max(length), length, "{length}"),
            }
        }
    }
}

#[test]
fn block_that_claims_gigabytes_allocates_nothing() {
    let mut bytes = written(CaptureFormat::Pcapng, &[]);
    let begin = bytes.len();
    bytes.extend([5, 0, 0, 0, 0xFC, 0xFF, 0xFF, 0xFF]);
    assert!(refusal(&bytes).contains(&format!("cut off at byte {begin}")));
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        read(&bytes);
        let section = written(CaptureFormat::Pcapng, &frames()[..1]);
        read(&[section, bytes].concat());
    }

    #[test]
    fn any_change_of_a_capture_is_read_or_refused(place in 0_usize..2000, byte in any::<u8>(), pcapng in any::<bool>()) {
        let mut bytes = written(FORMATS[usize::from(pcapng)], &frames());
        let place = place % bytes.len();
        bytes[place] = byte;
        prop_assert!(read(&bytes).0.len() <= frames().len());
    }

    #[test]
    fn any_line_is_read_or_refused(text in "\\([0-9.]{0,12}\\) [a-z0-9]{0,4} [0-9A-Fa-fR#_]{0,24}( [RTX])?") {
        let _ = parse_line(text.as_bytes()); // any result is right, but no panic
    }
}
