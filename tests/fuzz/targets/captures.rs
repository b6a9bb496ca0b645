//! Capture files: any bytes are read or refused with a place, in bounded memory; what was written is read again.

#![no_main]

use base::time::Tai;
use firmware_protocol::can::{CanFrame, CanId};
use libfuzzer_sys::fuzz_target;
use link::capture::{
    BLOCK_MAX, CaptureError, CaptureFormat, CaptureReader, CaptureWriter, CapturedPacket, Direction, LINE_MAX, Line,
    parse_line,
};
use link::{CHUNK_MAX, Packet, SerialChunk};
use starloop_fuzz::{Input, control};

/// One block, the packets that its serial bytes become (seven times their size, in a queue that doubles), buffers.
const MEMORY_MAX: u64 = 24 * BLOCK_MAX as u64;
/// Most packets per byte: a line of a frame without data.
const SHORTEST: usize = 8;

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    match input.u8() % 4 {
        0 => read_any(input.rest()),
        1 => read_any(&blocks(&mut input)),
        2 => read_line(input.rest()),
        _ => write_and_read(&mut input),
    }
});

// --- any bytes -------------------------------------------------------------------------------------------------------

fn read(bytes: &[u8]) -> (Vec<CapturedPacket>, Option<CaptureError>) {
    let mut packets = Vec::new();
    let error = read_each(bytes, &mut |packet| packets.push(packet));
    (packets, error)
}

fn read_each(bytes: &[u8], each: &mut impl FnMut(CapturedPacket)) -> Option<CaptureError> {
    let mut reader = match CaptureReader::new(bytes) {
        Ok(reader) => reader,
        Err(error) => return Some(error),
    };
    loop {
        match reader.read() {
            Ok(Some(packet)) => each(packet),
            Ok(None) => return None,
            Err(error) => {
                assert!(matches!(reader.read(), Ok(None)), "nothing follows an error");
                return Some(error);
            }
        }
    }
}

fn read_any(bytes: &[u8]) {
    let mut count = 0;
    let memory = allocation_counter::measure(|| drop(read_each(bytes, &mut |_| count += 1)));
    assert!(memory.bytes_max < MEMORY_MAX, "{} bytes of memory for {}", memory.bytes_max, bytes.len());
    assert_eq!(memory.bytes_current, 0, "nothing is kept");
    let (packets, error) = read(bytes);
    assert_eq!(packets.len(), count, "the same again");
    assert!(count <= bytes.len() / SHORTEST, "{count} packets in {} bytes", bytes.len());
    if let Some(error) = error {
        assert_has_a_place(&error, bytes);
    }
    // Whatever was read can be written, and is the same when read again.
    assert_eq!(read(&written(&packets, CaptureFormat::Pcapng)).0, packets);
    if packets.iter().all(|packet| matches!(packet.packet, Packet::Can(_))) {
        let stamped: Vec<_> = packets.iter().copied().map(as_candump).collect();
        assert_eq!(read(&written(&packets, CaptureFormat::Candump)).0, stamped);
    }
}

fn assert_has_a_place(error: &CaptureError, bytes: &[u8]) {
    let lines = bytes.split(|byte| *byte == b'\n').count() as u64;
    match error {
        CaptureError::Empty => assert!(bytes.is_empty()),
        CaptureError::ClassicPcap => assert!(bytes.len() >= 4),
        CaptureError::Line { line, text, .. } => {
            assert!((1..=lines).contains(line) && text.len() <= LINE_MAX, "{error}");
        }
        CaptureError::Block { offset, .. } => assert!(*offset < bytes.len() as u64, "{error}"),
        CaptureError::CutOff { place } => {
            let number = place.split(|c: char| !c.is_ascii_digit()).find_map(|word| word.parse::<u64>().ok());
            let number = number.expect("a number");
            assert!(number <= lines || number <= bytes.len() as u64, "{error}");
        }
        CaptureError::Read { .. }
        | CaptureError::Write(_)
        | CaptureError::WriterLost
        | CaptureError::GivenUp { .. }
        | CaptureError::NotCan => panic!("not here: {error}"),
    }
}

/// Returns a pcapng file of any blocks whose lengths are right, mostly: chance alone never gets past them.
fn blocks(input: &mut Input<'_>) -> Vec<u8> {
    let mut file = Vec::new();
    let mut is_big_endian = input.bool();
    put_block(&mut file, 0x0A0D_0D0A, &word(0x1A2B_3C4D, is_big_endian), is_big_endian, 0);
    while !input.is_empty() {
        let (kind, length, slip) = (input.u8(), input.u8(), input.u8());
        let kind = match kind % 8 {
            0 | 1 => 1,
            2..=5 => 6,
            6 => {
                is_big_endian = input.bool();
                put_block(&mut file, 0x0A0D_0D0A, &word(0x1A2B_3C4D, is_big_endian), is_big_endian, 0);
                continue;
            }
            _ => u32::from(kind >> 3),
        };
        let body = input.take(usize::from(length));
        put_block(&mut file, kind, body, is_big_endian, u32::from(slip > 250));
    }
    file
}

fn word(value: u32, is_big_endian: bool) -> [u8; 4] {
    if is_big_endian { value.to_be_bytes() } else { value.to_le_bytes() }
}

fn put_block(file: &mut Vec<u8>, kind: u32, body: &[u8], is_big_endian: bool, slip: u32) {
    let length = body.len().next_multiple_of(4);
    let reported = word(u32::try_from(length + 12).unwrap_or(0) + slip, is_big_endian);
    file.extend(word(kind, is_big_endian));
    file.extend(reported);
    file.extend(body);
    file.resize(file.len() + length - body.len(), 0);
    file.extend(reported);
}

/// Asserts that a line is equal when it is written again.
fn read_line(text: &[u8]) {
    if let Ok(Line::Packet(packet)) = parse_line(text) {
        let line = written(&[packet], CaptureFormat::Candump);
        assert_eq!(parse_line(&line), Ok(Line::Packet(as_candump(packet))), "{}", String::from_utf8_lossy(text));
    }
}

// --- written captures ------------------------------------------------------------------------------------------------

fn written(packets: &[CapturedPacket], format: CaptureFormat) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = CaptureWriter::new(&mut bytes, format).expect("memory takes everything");
    for packet in packets {
        writer.write(packet).expect("a packet that the format holds");
    }
    writer.flush().expect("memory takes everything");
    drop(writer);
    bytes
}

/// Returns a packet as a candump log stores it: Unix time from 1970, where a leap second counts as the second after it.
/// Broken: microseconds only.
fn as_candump(packet: CapturedPacket) -> CapturedPacket {
    let unix_ns = packet.at.to_unix_ns().max(0);
    let unix_ns = if control::is_broken() { unix_ns / 1000 * 1000 } else { unix_ns };
    CapturedPacket { at: Tai::from_unix_ns(unix_ns), ..packet }
}

fn write_and_read(input: &mut Input<'_>) {
    let (place, holds_serial) = (input.u16(), input.bool());
    let packets: Vec<CapturedPacket> =
        core::iter::from_fn(|| (!input.is_empty()).then(|| packet(holds_serial, input))).take(64).collect();
    assert_reads_back(&packets, &written(&packets, CaptureFormat::Pcapng), place);
    if !holds_serial {
        let wanted: Vec<_> = packets.iter().copied().map(as_candump).collect();
        assert_reads_back(&wanted, &written(&packets, CaptureFormat::Candump), place);
    }
}

fn assert_reads_back(packets: &[CapturedPacket], file: &[u8], place: u16) {
    let (all, error) = read(file);
    assert_eq!(all, packets);
    assert!(matches!(error, None | Some(CaptureError::Empty)), "{error:?}");
    let cut = &file[..usize::from(place) % (file.len() + 1)];
    let (some, error) = read(cut);
    assert!(packets.starts_with(&some), "a prefix");
    assert!(matches!(error, None | Some(CaptureError::CutOff { .. } | CaptureError::Empty)), "{error:?}");
}

fn packet(may_be_serial: bool, input: &mut Input<'_>) -> CapturedPacket {
    let form = input.u8();
    let direction = if form & 1 == 0 { Direction::Received } else { Direction::Sent };
    // Around leap seconds, around 1970, and anywhere.
    let at = match form >> 1 & 3 {
        0 => input.i64(),
        1 => i64::from(input.u32().cast_signed()),
        _ => 1_483_228_836_000_000_000 + i64::from(input.u32().cast_signed()),
    };
    let (length, number) = (usize::from(input.u8()), input.u16());
    let long = u32::from(number) << 13 | u32::from(number >> 11);
    let id = if form & 64 == 0 { CanId::standard(number & 0x7FF) } else { CanId::extended(long & 0x1FFF_FFFF) };
    let id = id.expect("of its length");
    let is_serial = may_be_serial && form & 8 != 0;
    let longest = if is_serial { CHUNK_MAX } else { 64 };
    let data = input.take(length % (longest + 1));
    // An empty chunk is none: no link gives one.
    let chunk = SerialChunk::new(data).filter(|chunk| is_serial && !chunk.as_slice().is_empty());
    let frame = CanFrame::classic(id, data).filter(|_| form & 16 == 0).or_else(|| CanFrame::fd(id, data));
    let packet = chunk.map(Packet::Serial).or(frame.map(Packet::Can));
    let packet = packet.or(CanFrame::classic(id, &data[..data.len().min(8)]).map(Packet::Can));
    let interface = if form & 32 == 0 { 0 } else { form };
    CapturedPacket { at: Tai::from_ns(at), direction, interface, packet: packet.expect("8 bytes at most") }
}
