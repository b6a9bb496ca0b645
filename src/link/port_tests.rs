//! Messages through a port over every wire format; damage is counted and passes nothing.

use super::simulated::{BusParams, BusTiming, SimulatedLink, simulated_pair};
use super::*;
use base::clock::{Clock, Virtual};
use base::time::Span;
use firmware_protocol::can::{CanFrame, IdMap};
use firmware_protocol::message::{AttitudeFlags, AttitudeRecord, Sync};
use firmware_protocol::{Message, Reject};
use std::sync::Arc;

const START: Tai = Tai::from_ns(1_000_000_000);
const FORMATS: [(WireFormat, BusTiming); 3] = [
    (WireFormat::CanClassic, BusTiming::CanClassic { bit_rate_bps: 500_000 }),
    (WireFormat::CanFd, BusTiming::CanFd { arbitration_bps: 500_000, data_bps: 2_000_000 }),
    (WireFormat::Serial, BusTiming::Serial { baud: 921_600 }),
];

struct Bench {
    clock: Arc<Virtual>,
    near: SimulatedLink,
    far: SimulatedLink,
}

fn bench(timing: BusTiming) -> Bench {
    let clock = Arc::new(Virtual::new(START));
    let shared: Arc<dyn Clock> = Arc::<Virtual>::clone(&clock);
    let params = BusParams { name: "test".into(), timing, latency: Span::ZERO, queue_packets: 64 };
    let (near, far) = simulated_pair(params, &shared);
    Bench { clock, near, far }
}

fn port(link: impl Link + 'static, format: WireFormat) -> Port {
    Port::new(Box::new(link), format, IdMap::new(0, 1).unwrap())
}

fn attitude(seq: u8) -> Message {
    Message::Attitude(AttitudeRecord {
        t_us: 7,
        seq,
        flags: AttitudeFlags::ALL,
        q_wxyz: [1.0, 0.0, 0.0, 0.0],
        rate_rad_s: [0.25, 0.0, 0.0],
        acceleration_rad_s2: [0.0; 3],
    })
}

fn receive_all(port: &mut Port) -> Vec<Stamped<Message>> {
    core::iter::from_fn(|| port.receive(START).unwrap()).collect()
}

/// A tap: damages every bit pattern that passes through it.
struct Corrupting<L> {
    inner: L,
    flips: u8,
}

impl<L: Link> Link for Corrupting<L> {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        let packet = self.inner.receive(until)?;
        Ok(packet.map(|packet| Stamped { at: packet.at, value: self.damaged(&packet.value) }))
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        self.inner.send(packet)
    }

    fn counters(&self) -> LinkCounters {
        self.inner.counters()
    }
}

impl<L> Corrupting<L> {
    fn damaged(&self, packet: &Packet) -> Packet {
        let flip = |bytes: &[u8]| -> Vec<u8> {
            let mut bytes = bytes.to_vec();
            if let Some(byte) = bytes.get_mut(4) {
                *byte ^= self.flips;
            }
            bytes
        };
        match packet {
            Packet::Can(frame) if frame.is_fd() => Packet::Can(CanFrame::fd(frame.id(), &flip(frame.data())).unwrap()),
            Packet::Can(frame) => Packet::Can(CanFrame::classic(frame.id(), &flip(frame.data())).unwrap()),
            Packet::Serial(chunk) => Packet::Serial(SerialChunk::new(&flip(chunk.as_slice())).unwrap()),
            Packet::Datagram(datagram) => Packet::Datagram(Datagram::new(&flip(datagram.as_slice())).unwrap()),
        }
    }
}

#[test]
fn messages_arrive_whole_stamped_with_their_last_packet() {
    for (format, timing) in FORMATS {
        let Bench { clock, near, far } = bench(timing);
        let (mut near, mut far) = (port(near, format), port(far, format));
        let leaves = [attitude(1), attitude(2)].map(|message| near.send(&message).unwrap());
        assert_eq!(receive_all(&mut far), [], "{format:?}: not yet due");
        clock.advance_to(START + Span::from_ms(50));
        let got = receive_all(&mut far);
        let wanted = [(1, leaves[0]), (2, leaves[1])].map(|(seq, at)| Stamped { at, value: attitude(seq) });
        assert_eq!(got, wanted, "{format:?}");
        assert_eq!(far.rejects().total(), 0, "{format:?}");
    }
}

#[test]
fn several_messages_in_one_chunk_all_come_out() {
    let Bench { clock, mut near, far } = bench(FORMATS[2].1);
    let mut encoder = firmware_protocol::serial::Encoder::new();
    let mut line = Vec::new();
    for counter in 0..3 {
        let mut packet = [0; CHUNK_MAX];
        let len = encoder.encode(&Message::Sync(Sync { counter }), &mut packet).unwrap();
        line.extend_from_slice(&packet[..len]);
    }
    // The chunks' border lies inside the second message.
    for piece in [&line[..12], &line[12..]] {
        near.send(&Packet::Serial(SerialChunk::new(piece).unwrap())).unwrap();
    }
    clock.advance_to(START + Span::from_ms(50));
    let got = receive_all(&mut port(far, WireFormat::Serial));
    let counters: Vec<_> = got.iter().map(|message| message.value).collect();
    assert_eq!(counters, [0, 1, 2].map(|counter| Message::Sync(Sync { counter })));
    assert!(got[0].at < got[1].at && got[1].at == got[2].at, "stamped with the chunk in which each ended");
}

#[test]
fn noise_without_a_delimiter_is_counted() {
    let Bench { clock, mut near, far } = bench(FORMATS[2].1);
    let mut far = port(far, WireFormat::Serial);
    for _ in 0..100 {
        near.send(&Packet::Serial(SerialChunk::new(&[0x55; CHUNK_MAX]).unwrap())).unwrap();
        clock.advance_to(clock.now() + Span::from_ms(50));
        assert_eq!(receive_all(&mut far), []);
    }
    // 8000 bytes.
    assert_eq!(far.rejects().get(Reject::Oversize), 7);
}

#[test]
fn damage_is_counted_and_passes_nothing() {
    for (format, timing) in FORMATS {
        for flips in [0, 0xFF] {
            let Bench { clock, near, far } = bench(timing);
            let (mut near, mut far) = (port(near, format), port(Corrupting { inner: far, flips }, format));
            near.send(&attitude(1)).unwrap();
            clock.advance_to(START + Span::from_ms(50));
            let (got, rejected) = (receive_all(&mut far).len(), far.rejects().total());
            assert_eq!((got, rejected > 0), if flips == 0 { (1, false) } else { (0, true) }, "{format:?} {flips}");
        }
    }
}

#[test]
fn noise_on_the_line_is_counted() {
    let Bench { clock, mut near, far } = bench(FORMATS[2].1);
    let mut far = port(far, WireFormat::Serial);
    for noise in [&[9, 9, 0][..], &[3, 1, 1, 0, 0, 0], &[1; 80], &[1; 80], &[0]] {
        near.send(&Packet::Serial(SerialChunk::new(noise).unwrap())).unwrap();
    }
    port(near, WireFormat::Serial).send(&attitude(1)).unwrap();
    clock.advance_to(START + Span::from_ms(50));
    assert_eq!(receive_all(&mut far).len(), 1, "back in step");
    assert_eq!(far.rejects().get(Reject::BadFraming), 1);
    assert_eq!(far.rejects().get(Reject::WrongLength), 1);
    assert_eq!(far.rejects().get(Reject::Oversize), 1);
    assert_eq!(far.rejects().total(), 3);
}

#[test]
fn message_that_classic_can_does_not_carry_is_refused() {
    let Bench { near, .. } = bench(FORMATS[0].1);
    let burst = firmware_protocol::message::JitterBurst::new(0, 1000, 0, &[[0.0; 2]]).unwrap();
    let error = port(near, WireFormat::CanClassic).send(&Message::Jitter(burst)).unwrap_err();
    assert!(matches!(error, LinkError::Encode(EncodeError::NotCarried { .. })), "{error}");
}
