//! Plain messages through ports over the link, and damaged ones: eight little-endian doubles, the default layout.

use super::suite::{PATIENCE, Suite};
use crate::plain::{PlainRecord, PlainReject};
use crate::{Datagram, Input, Packet, Port, WireFormat};
use firmware_protocol::message::{AttitudeFlags, AttitudeRecord};
use firmware_protocol::{Message, can::IdMap};

/// Numbers of the default layout.
const NUMBERS: usize = 8;

fn attitude(seq: u8) -> AttitudeRecord {
    AttitudeRecord {
        t_us: 1_000_000 + u32::from(seq),
        seq,
        flags: AttitudeFlags::ALL,
        q_wxyz: [0.5, -0.5, 0.5, 0.5],
        rate_rad_s: [0.25, -0.125, f32::from(seq)],
        acceleration_rad_s2: [0.0; 3],
    }
}

fn port(link: Box<dyn crate::Link>) -> Port {
    Port::new(link, WireFormat::Plain, IdMap::default())
}

fn next(suite: &Suite<'_>, port: &mut Port) -> Result<PlainRecord, String> {
    let got = port.receive_any(suite.clock.now() + PATIENCE).map_err(|error| error.to_string())?;
    match got.map(|got| got.value) {
        Some(Input::Plain(record)) => Ok(record),
        other => Err(format!("wanted a plain message, got {other:?}; {:?}", port.plain_rejects())),
    }
}

fn check(record: &PlainRecord, wanted: &AttitudeRecord) -> Result<(), String> {
    let got = record.attitude.map(|attitude| (attitude.q_wxyz, attitude.rate_rad_s));
    let wanted = (wanted.q_wxyz.map(f64::from), wanted.rate_rad_s.map(f64::from));
    if got == Some(wanted) { Ok(()) } else { Err(format!("wanted {wanted:?}, got {record:?}")) }
}

pub(super) fn messages(suite: &mut Suite<'_>) -> Result<String, String> {
    let (near, far) = suite.pair()?;
    let (mut near, mut far) = (port(near), port(far));
    for direction in ["there", "back"] {
        for seq in 0..10 {
            near.send(&Message::Attitude(attitude(seq))).map_err(|error| error.to_string())?;
            check(&next(suite, &mut far)?, &attitude(seq)).map_err(|broken| format!("{direction}: {broken}"))?;
        }
        if far.plain_rejects().total() != 0 {
            return Err(format!("{direction}: rejected {:?}", far.plain_rejects()));
        }
        core::mem::swap(&mut near, &mut far);
    }
    Ok("attitudes".into())
}

/// Checks that after each piece of damage a good message arrives next.
pub(super) fn damage(suite: &mut Suite<'_>) -> Result<String, String> {
    let (mut near, far) = suite.pair()?;
    let mut far = port(far);
    let good = [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let with = |place: usize, value: f64| {
        let mut numbers = good;
        numbers[place % NUMBERS] = value;
        numbers.map(f64::to_le_bytes).concat()
    };
    let swapped = good.map(f64::to_be_bytes).concat();
    let pieces = [
        (PlainReject::NotFinite, with(5, f64::NAN)),
        (PlainReject::NotFinite, with(2, f64::INFINITY)),
        (PlainReject::QuaternionNorm, with(1, 0.5)),
        (PlainReject::QuaternionNorm, swapped),
        (PlainReject::Time, with(0, 1e30)),
    ];
    for (seq, (reason, bytes)) in (0..).zip(&pieces) {
        let before = far.plain_rejects().get(*reason);
        let numbers = attitude(seq);
        let mut good = vec![0.0];
        good.extend(numbers.q_wxyz.iter().chain(&numbers.rate_rad_s).copied().map(f64::from));
        let good: Vec<u8> = good.into_iter().flat_map(f64::to_le_bytes).collect();
        for bytes in [bytes, &good] {
            let datagram = Datagram::new(bytes).ok_or("a datagram too long")?;
            near.send(&Packet::Datagram(datagram)).map_err(|error| error.to_string())?;
        }
        check(&next(suite, &mut far)?, &numbers).map_err(|broken| format!("after {reason:?}: {broken}"))?;
        if far.plain_rejects().get(*reason) != before + 1 {
            return Err(format!("not counted as {reason:?}: {:?}", far.plain_rejects()));
        }
    }
    Ok(format!("{} pieces", pieces.len()))
}
