//! Messages through ports over the link, and damaged ones.

use super::plain;
use super::suite::{PATIENCE, Suite};
use crate::{Packet, Port, SerialChunk, WireFormat};
use firmware_protocol::can::{CanFrame, CanId, Format, IdMap, encode};
use firmware_protocol::message::{
    AttitudeFlags, AttitudeRecord, Command, Exposure, Heartbeat, JitterBurst, JitterPair, NodeState, Reply, Request,
    Response, Scet, Sync, TimeFollowUp, Wheels,
};
use firmware_protocol::serial::{ENCODED_MAX, Encoder};
use firmware_protocol::{Message, Reject, version};

const NODE: u8 = 5;

fn ids() -> Result<IdMap, String> {
    IdMap::new(0, NODE).ok_or_else(|| "no such node".into())
}

fn attitude(seq: u8) -> AttitudeRecord {
    AttitudeRecord {
        t_us: 0x1234_5678,
        seq,
        flags: AttitudeFlags::ALL,
        q_wxyz: [0.5, -0.5, 0.5, 0.5],
        rate_rad_s: [0.25, -0.125, 0.0],
        acceleration_rad_s2: [0.0, 0.5, -0.25],
    }
}

/// Returns one message of each kind that this wire carries; values that every layout holds exactly.
fn every_message(format: WireFormat) -> Vec<Message> {
    let burst = JitterBurst::new(7, 1000, 1, &[[0.0; 2]; 14]).map(Message::Jitter);
    let mut messages = vec![
        Message::Sync(Sync { counter: 3 }),
        Message::TimeFollowUp(TimeFollowUp { scet: Scet::from_ns(1_500_000_000), counter: 3 }),
        Message::Attitude(attitude(1)),
        Message::JitterPair(JitterPair { slot: 9, samples_arcsec: [[0.0; 2]; 2] }),
        Message::Wheels(Wheels { speed_rpm: [0.0; 4] }),
        Message::Exposure(Exposure::new(1, 2, 3, 40)),
        Message::Command(Command { token: 4, request: Request::Run }),
        Message::Response(Response { token: 4, reply: Reply::Run }),
        Message::Heartbeat(Heartbeat { state: NodeState::Running, major: version::MAJOR }),
    ];
    messages.extend(burst.filter(|_| format != WireFormat::CanClassic));
    messages
}

pub(super) fn messages(suite: &mut Suite<'_>) -> Result<String, String> {
    if suite.format == WireFormat::Plain {
        return plain::messages(suite);
    }
    let (near, far) = suite.pair()?;
    let (mut near, mut far) = (Port::new(near, suite.format, ids()?), Port::new(far, suite.format, ids()?));
    let messages = every_message(suite.format);
    for direction in ["there", "back"] {
        for message in &messages {
            near.send(message).map_err(|error| error.to_string())?;
            let got = far.receive(suite.clock.now() + PATIENCE).map_err(|error| error.to_string())?;
            if got.map(|got| got.value) != Some(*message) {
                return Err(format!("{direction}: wanted {message:?}, got {got:?}; {:?}", far.rejects()));
            }
        }
        if far.rejects().total() != 0 {
            return Err(format!("{direction}: rejected {:?}", far.rejects()));
        }
        core::mem::swap(&mut near, &mut far);
    }
    Ok(format!("{} kinds of message", messages.len()))
}

/// Damaged packets, and the reason why they are rejected; `None` where damage may show as one reason or another.
struct Damage {
    packets: Vec<Packet>,
    reason: Option<Reject>,
}

/// Checks that after each piece of damage a mark (a SYNC message) arrives next.
pub(super) fn damage(suite: &mut Suite<'_>) -> Result<String, String> {
    if suite.format == WireFormat::Plain {
        return plain::damage(suite);
    }
    let (mut near, far) = suite.pair()?;
    let mut far = Port::new(far, suite.format, ids()?);
    let pieces = match suite.format {
        WireFormat::Serial | WireFormat::Plain => serial_damage()?,
        WireFormat::CanClassic => can_damage(Format::Classic)?,
        WireFormat::CanFd => can_damage(Format::Fd)?,
    };
    for (number, piece) in pieces.iter().enumerate() {
        let before = *far.rejects();
        let counter = u8::try_from(number % 256).unwrap_or(0);
        for packet in piece.packets.iter().chain(&mark(suite.format, counter)?) {
            near.send(packet).map_err(|error| error.to_string())?;
        }
        let got = far.receive(suite.clock.now() + PATIENCE).map_err(|error| error.to_string())?;
        if got.map(|got| got.value) != Some(Message::Sync(Sync { counter })) {
            return Err(format!("piece {number}: wanted the mark after it, got {got:?}"));
        }
        let rejects = far.rejects();
        let is_counted = match piece.reason {
            Some(reason) => rejects.get(reason) > before.get(reason),
            None => rejects.total() > before.total(),
        };
        if !is_counted {
            return Err(format!("piece {number}: not counted as {:?}: {rejects:?}", piece.reason));
        }
    }
    let reasons: Vec<_> = far.rejects().iter().filter(|(_, count)| *count > 0).collect();
    let reasons: Vec<_> = reasons.iter().map(|(reason, count)| format!("{count} {reason:?}")).collect();
    Ok(format!("{} pieces: {}", pieces.len(), reasons.join(", ")))
}

fn mark(format: WireFormat, counter: u8) -> Result<Vec<Packet>, String> {
    let message = Message::Sync(Sync { counter });
    match format {
        // A delimiter first: it ends any bytes before the mark.
        WireFormat::Serial => Ok(vec![chunk(&[0])?, chunk(&encoded(&message)?)?]),
        WireFormat::CanClassic | WireFormat::CanFd | WireFormat::Plain => frames(&message, Format::Fd).map(packets),
    }
}

/// Returns the attitude record with a legal layout and an illegal value.
fn illegal_records() -> [(Reject, AttitudeRecord); 3] {
    let good = attitude(1);
    [
        (Reject::NotFinite, AttitudeRecord { q_wxyz: [f32::NAN, 0.0, 0.0, 1.0], ..good }),
        (Reject::QuaternionNorm, AttitudeRecord { q_wxyz: [1.0, 0.1, 0.0, 0.0], ..good }),
        (Reject::NotFinite, AttitudeRecord { q_wxyz: [1.0, 0.0, f32::INFINITY, 0.0], ..good }),
    ]
}

fn can_damage(format: Format) -> Result<Vec<Damage>, String> {
    let good = frames(&Message::Attitude(attitude(1)), format)?;
    let mut pieces = Vec::new();
    for (place, frame) in good.iter().enumerate() {
        for at in 0..frame.data().len() {
            let mut bytes = frame.data().to_vec();
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 0x10;
            }
            let mut group = good.clone();
            group.splice(place..=place, frame.with_data(&bytes));
            pieces.push(Damage { packets: packets(group), reason: None });
        }
    }
    for (reason, record) in illegal_records() {
        let packets = packets(frames(&Message::Attitude(record), format)?);
        pieces.push(Damage { packets, reason: Some(reason) });
    }
    let ids = ids()?;
    let sync = ids.id(firmware_protocol::MessageId::Sync);
    let one = |reason, id, bytes: &[u8]| Damage {
        packets: packets(CanFrame::classic(id, bytes).into_iter().collect()),
        reason: Some(reason),
    };
    pieces.push(one(Reject::WrongLength, sync, &[1, 2]));
    // Unknown, of another node, and of the other length.
    let heartbeat = ids.id(firmware_protocol::MessageId::Heartbeat).number();
    let unknown = [CanId::from_flagged(0x7F0), CanId::from_flagged(heartbeat + 1), CanId::extended(heartbeat)];
    pieces.extend(unknown.into_iter().flatten().map(|id| one(Reject::UnknownId, id, &[1, 1])));
    if format == Format::Classic {
        for missing in 0..good.len() - 1 {
            let mut group = good.clone();
            group.remove(missing);
            pieces.push(Damage { packets: packets(group), reason: Some(Reject::TornGroup) });
        }
    }
    Ok(pieces)
}

fn serial_damage() -> Result<Vec<Damage>, String> {
    let good = encoded(&Message::Attitude(attitude(1)))?;
    let mut pieces = Vec::new();
    for at in 0..good.len() {
        let mut bytes = good.clone();
        if let Some(byte) = bytes.get_mut(at) {
            *byte ^= 0x10;
        }
        pieces.push(Damage { packets: vec![chunk(&bytes)?], reason: None });
        // Cut off after this byte. The mark's delimiter makes the packet whole when nothing else is missing.
        if at + 2 < good.len() {
            pieces.push(Damage { packets: vec![chunk(good.get(..=at).unwrap_or(&[]))?], reason: None });
        }
    }
    for (reason, record) in illegal_records() {
        let packets = vec![chunk(&encoded(&Message::Attitude(record))?)?];
        pieces.push(Damage { packets, reason: Some(reason) });
    }
    pieces.push(Damage { packets: vec![chunk(&[9, 9, 0])?], reason: Some(Reject::BadFraming) });
    pieces.push(Damage { packets: vec![chunk(&[1; 80])?, chunk(&[1; 80])?], reason: Some(Reject::Oversize) });
    Ok(pieces)
}

fn frames(message: &Message, format: Format) -> Result<Vec<CanFrame>, String> {
    let frames = encode(message, format, &ids()?).map_err(|error| error.to_string())?;
    Ok(frames.iter().copied().collect())
}

fn packets(frames: Vec<CanFrame>) -> Vec<Packet> {
    frames.into_iter().map(Packet::Can).collect()
}

fn encoded(message: &Message) -> Result<Vec<u8>, String> {
    let mut line = [0; ENCODED_MAX];
    let len = Encoder::new().encode(message, &mut line).map_err(|error| error.to_string())?;
    Ok(line.get(..len).unwrap_or(&[]).to_vec())
}

fn chunk(bytes: &[u8]) -> Result<Packet, String> {
    SerialChunk::new(bytes).map(Packet::Serial).ok_or_else(|| "a chunk too long".into())
}
