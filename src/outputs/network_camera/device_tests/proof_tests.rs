//! Clients that have not proven their address get nothing large, and hold nothing for long.

use super::*;

#[test]
fn stream_and_test_packet_of_a_client_that_has_not_read_the_xml_are_refused() {
    let mut bench = bench();
    assert_eq!(bench.write(A, at::CONTROL, 2), OK);
    bench.write(A, at::STREAM_ADDRESS, A.ip().to_bits());
    bench.write(A, at::STREAM_PORT, 1234);
    assert_eq!(bench.write(A, own::ACQUISITION_START, 1), 0x8006);
    assert_eq!(bench.write(A, at::PACKET_SIZE, 0x8000_0000 | 1400), 0x8006);
    assert_eq!((bench.device.stream().destination, bench.answer.test_packet), (None, None));
    // Text that was shown to another client proves nothing.
    let of_another = bench.shown_at(B, at::FIRST_URL);
    let read = |address: u32| [address.to_be_bytes(), 4_u32.to_be_bytes()].concat();
    assert_eq!(bench.ask(A, 0x84, &read(of_another)).unwrap().0, 0x8003);
    assert_eq!(bench.ask(A, 0x84, &read(registers::FIRST_XML)).unwrap().0, 0x8003, "nor is its place in memory");
    assert_eq!(bench.write(A, own::ACQUISITION_START, 1), 0x8006);
    bench.prove(A);
    assert_eq!(bench.write(A, own::ACQUISITION_START, 1), OK);
    assert_eq!(bench.device.stream().destination.map(|to| *to.ip()), Some(*A.ip()));
    let counters = bench.device.counters();
    assert_eq!((counters.unproven_refused, counters.xml_misses), (3, 1));
}

#[test]
fn features_change_for_a_proven_client_only() {
    let (mut bench, end) = commanded_tests::without_control();
    assert_eq!(bench.write(A, at::CONTROL, 2), OK);
    let numbers = [(own::EXPOSURE_TIME, 50_000.0), (own::GAIN, 6.0), (own::FRAME_RATE, 0.01)];
    let words = [(own::TRIGGER_MODE, 1), (own::TRIGGER_SOFTWARE, 1), (own::WIDTH, 8), (own::DEVICE_RESET, 1)];
    let write_all = |bench: &mut Bench| -> Vec<u16> {
        let numbers: Vec<u16> = numbers.iter().map(|(place, number)| bench.write_number(*place, *number)).collect();
        let words: Vec<u16> = words.iter().map(|(place, value)| bench.write(A, *place, *value)).collect();
        [numbers, words].concat()
    };
    assert_eq!(write_all(&mut bench), [0x8006; 7]);
    assert_eq!((end.commands().count(), bench.read(A, own::WIDTH)), (0, Ok(31)));
    assert_eq!(bench.device.counters().unproven_refused, 7);
    bench.prove(A);
    assert_eq!(write_all(&mut bench), [OK; 7], "control");
    assert!(end.commands().count() > 3);
}

#[test]
fn a_forged_controller_keeps_no_client_from_control() {
    let mut bench = bench();
    for round in 0..50 {
        bench.now = bench.now + Span::from_ms(2_000);
        assert_eq!(bench.write(B, at::CONTROL, 2), OK, "forged, round {round}");
        bench.write(B, own::WIDTH, 7);
        bench.control();
        assert_eq!((bench.read(A, own::WIDTH), bench.write(A, at::CONTROL, 0)), (Ok(31), OK));
    }
    assert_eq!(bench.write(B, at::CONTROL, 2), OK);
    bench.control();
    assert_eq!(bench.write(B, at::CONTROL, 2), 0x8006, "control: a proven client is not displaced");
}

#[test]
fn long_answers_to_a_client_without_a_proof_are_bounded() {
    let mut bench = bench();
    let read = [0_u32.to_be_bytes(), 512_u32.to_be_bytes()].concat();
    let long = (0..1000).filter(|_| bench.ask(A, 0x84, &read).unwrap().0 == OK).count();
    assert!((16..=100).contains(&long), "{long} of 1000 within an instant");
    assert_eq!(bench.ask(A, 0x02, &[]).map(|(status, answer)| (status, answer.len())), Some((0x8006, 0)));
    assert_eq!(bench.ask(B, 0x02, &[]).map(|(_, answer)| answer.len()), Some(248), "others are not kept out");
    bench.now = bench.now + Span::from_ms(1_001);
    bench.prove(A);
    assert!((0..1000).all(|_| bench.ask(A, 0x84, &read).unwrap().0 == OK), "control: proven");
}

#[test]
fn blind_datagrams_get_at_most_three_times_their_bytes() {
    /// IP and UDP headers, which both directions have.
    const IP_UDP: usize = 28;
    let answered_and_sent = |is_blind: bool| {
        let mut bench = bench();
        let mut bytes = [0, 0];
        let mut send = |bench: &mut Bench, words: &[u32]| {
            let payload: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
            bench.ask(A, 0x82, &payload);
            let test = bench.answer.test_packet.map_or(0, |(_, bytes)| bytes + IP_UDP);
            bytes[0] += 8 + payload.len() + IP_UDP;
            bytes[1] += bench.answer.reply.len() + IP_UDP + test;
        };
        send(&mut bench, &[at::CONTROL, 2]);
        let words = [
            [at::HEARTBEAT_MS, 600_000],
            [at::STREAM_PORT, 1234],
            [at::STREAM_ADDRESS, A.ip().to_bits()],
            [at::PACKET_SIZE, 0x8000_0000 | 1500],
            [own::ACQUISITION_START, 1],
        ];
        if !is_blind {
            bench.prove(A);
        }
        send(&mut bench, &words.concat());
        words.iter().for_each(|word| send(&mut bench, word));
        (bytes[1] as f64 / bytes[0] as f64, bench.device.stream().destination.is_some())
    };
    let (ratio, streams) = answered_and_sent(true);
    assert!(ratio <= 3.0 && !streams, "{ratio} times the bytes, stream open: {streams}");
    let (ratio, streams) = answered_and_sent(false);
    assert!(ratio > 3.0 && streams, "a client that reads its answers gets what it asks for: {ratio}");
}

#[test]
fn heartbeat_of_an_unproven_or_remote_controller_is_bounded() {
    let mut bench = bench();
    assert_eq!(bench.write(A, at::CONTROL, 1), OK, "exclusive");
    assert_eq!(bench.read(B, own::WIDTH), Ok(31), "one datagram shuts out no reader");
    bench.write(A, at::HEARTBEAT_MS, 600_000);
    assert_eq!(bench.read(A, at::HEARTBEAT_MS), Ok(30_000), "other machines reach this camera");
    bench.now = bench.now + Span::from_ms(3_000);
    bench.device.tick(bench.now);
    assert_eq!(bench.device.counters().controllers_timed_out, 0);
    bench.now = bench.now + Span::from_ms(1);
    bench.device.tick(bench.now);
    assert_eq!(bench.device.counters().controllers_timed_out, 1, "it has not proven its address");
    bench.control();
    bench.write(A, at::CONTROL, 1);
    bench.write(A, at::HEARTBEAT_MS, 600_000);
    assert_eq!(bench.read(B, own::WIDTH), Err(0x8006), "proven, and exclusive");
    bench.now = bench.now + Span::from_ms(29_000);
    bench.device.tick(bench.now);
    assert_eq!(bench.read(A, at::CONTROL), Ok(1));
    bench.now = bench.now + Span::from_ms(30_001);
    bench.device.tick(bench.now);
    assert_eq!(bench.read(B, own::WIDTH), Ok(31));
}

#[test]
fn control_that_was_lost_is_not_answered_from_memory() {
    let mut bench = bench();
    bench.control();
    let control = [at::CONTROL.to_be_bytes(), 2_u32.to_be_bytes()].concat();
    bench.now = START + Span::from_ms(3001);
    bench.device.tick(bench.now);
    assert_eq!(bench.read(B, at::CONTROL), Ok(0));
    bench.id -= 1;
    assert_eq!(bench.ask_again(A, 0x82, &control), Some((OK, vec![0, 0, 0, 1])));
    assert_eq!(bench.read(B, at::CONTROL), Ok(2), "taken again");
    assert_eq!(bench.device.counters().repeats, 0);
}
