//! Serial bytes: whatever came before, a packet is received; damaged ones are not; nothing is allocated.

#![no_main]

use firmware_protocol::{Message, Reject, serial};
use libfuzzer_sys::fuzz_target;
use starloop_fuzz::{Input, control, damage, samples};

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    let (first, second) = (samples::unnumbered(&mut input), samples::unnumbered(&mut input));
    let mut record = Message::Attitude(samples::attitude(&mut input));
    let mut flips = Input::new(input.take(8));
    let noise = input.rest();

    let mut decoder = serial::Decoder::new();
    let memory = allocation_counter::measure(|| read_noise(&mut decoder, noise));
    assert_eq!(memory.count_total, 0, "reading takes no memory");

    // The packet next to the noise may be lost with it. Broken: the noise is not ended, and the packet is wanted.
    let lost = if control::is_broken() { vec![] } else { line(&first, 0) };
    outcomes(&mut decoder, &lost);
    assert_eq!(outcomes(&mut decoder, &line(&second, 1)), [Ok(second)], "after {noise:02X?}");

    // An attitude is a repeat where the noise contained one; a fresh decoder cannot know.
    let received = outcomes(&mut decoder, &line(&record, 2));
    assert!(received == [Ok(record)] || received == [Err(Reject::ReplayedSequence)], "{received:?}");

    for sent in [&second, &record] {
        let damaged = damaged(&line(sent, 3), &mut flips);
        let received = outcomes(&mut serial::Decoder::new(), &damaged);
        assert!(matches!(received.as_slice(), [Err(_)]), "{received:?} for {damaged:02X?}");
    }
    if let Message::Attitude(record) = &mut record {
        record.seq = record.seq.wrapping_add(1);
    }
    let received = outcomes(&mut decoder, &line(&record, 4));
    assert!(received == [Ok(record)] || received == [Err(Reject::ReplayedSequence)], "still in step: {received:?}");
});

/// Asserts that each run of bytes up to a delimiter is one message or one refusal.
fn read_noise(decoder: &mut serial::Decoder, noise: &[u8]) {
    let ended = noise.iter().rposition(|byte| *byte == 0).map_or(&[][..], |end| &noise[..end]);
    let runs = ended.split(|byte| *byte == 0).filter(|run| !run.is_empty()).count();
    let (mut rest, mut count) = (noise, 0);
    while let Some(outcome) = decoder.read(&mut rest) {
        count += 1;
        if let Ok(message) = outcome {
            assert_legal(&message);
        }
    }
    assert_eq!(count, runs, "one outcome per run");
    assert!(rest.is_empty(), "everything is taken");
}

fn assert_legal(message: &Message) {
    if let Message::Attitude(record) = message {
        let norm = record.q_wxyz.iter().map(|part| f64::from(*part).powi(2)).sum::<f64>().sqrt();
        assert!((norm - 1.0).abs() <= 1.000_001e-3, "norm {norm}");
        assert!(record.rate_rad_s.iter().chain(&record.acceleration_rad_s2).all(|value| value.is_finite()));
    }
}

fn line(message: &Message, seq: u8) -> Vec<u8> {
    let mut line = [0; serial::ENCODED_MAX];
    let length = serial::Encoder::starting_at(seq).encode(message, &mut line).expect("a legal message");
    line[..length].to_vec()
}

fn outcomes(decoder: &mut serial::Decoder, bytes: &[u8]) -> Vec<Result<Message, Reject>> {
    let mut rest = bytes;
    core::iter::from_fn(|| decoder.read(&mut rest)).collect()
}

/// Returns the packet behind a line, damaged, on a line again: stuffing is written afresh, so that the error is the one
/// made.
fn damaged(line: &[u8], flips: &mut Input<'_>) -> Vec<u8> {
    let mut packet = unstuffed(line);
    let crc = packet.len() - 2;
    packet[crc..].reverse();
    if !damage::flip(&mut packet, flips) {
        packet[0] ^= 1;
    }
    packet[crc..].reverse();
    stuffed(&packet)
}

fn unstuffed(line: &[u8]) -> Vec<u8> {
    let mut packet = Vec::new();
    let mut rest = &line[..line.len() - 1];
    while let Some((distance, after)) = rest.split_first() {
        let (run, after) = after.split_at(usize::from(*distance) - 1);
        packet.extend_from_slice(run);
        packet.push(0);
        rest = after;
    }
    packet.pop();
    packet
}

/// Returns the COBS bytes of a packet below 254 bytes.
fn stuffed(packet: &[u8]) -> Vec<u8> {
    let mut line = Vec::new();
    for run in packet.split(|byte| *byte == 0) {
        line.push(u8::try_from(run.len() + 1).expect("a short packet"));
        line.extend_from_slice(run);
    }
    line.push(0);
    line
}
