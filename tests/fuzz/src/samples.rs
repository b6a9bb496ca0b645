//! Legal messages from any bytes.

use crate::Input;
use firmware_protocol::Message;
use firmware_protocol::message::{
    AttitudeFlags, AttitudeRecord, Command, Exposure, Heartbeat, NodeState, Request, Scet, Sync, Table, TableCell,
    TimeFollowUp, Wheels,
};

/// Largest count of a rate in the classic group, 1 urad/s each.
const RATE_MAX: i32 = (1 << 20) - 1;

/// Returns a unit quaternion.
pub fn quaternion(input: &mut Input<'_>) -> [f32; 4] {
    let mut parts = || f64::from(i16::from_le_bytes(input.array()));
    let q = [parts(), parts(), parts(), parts()];
    let norm = q.iter().map(|part| part * part).sum::<f64>().sqrt();
    if norm > 0.0 { q.map(|part| (part / norm) as f32) } else { [1.0, 0.0, 0.0, 0.0] }
}

/// Returns a record that the classic group carries without rounding.
pub fn attitude(input: &mut Input<'_>) -> AttitudeRecord {
    let flags = AttitudeFlags::from_bits(input.u8());
    let (t_us, seq, q_wxyz) = (input.u32(), input.u8(), quaternion(input));
    let mut counted = |holds: bool| {
        [(); 3].map(|()| {
            let count = (input.u32() & 0x1F_FFFF).cast_signed() - (1 << 20);
            if holds { (f64::from(count.max(-RATE_MAX)) * 1e-6) as f32 } else { 0.0 }
        })
    };
    let (rate_rad_s, acceleration_rad_s2) = (counted(flags.rate), counted(flags.acceleration));
    AttitudeRecord { t_us, seq, flags, q_wxyz, rate_rad_s, acceleration_rad_s2 }
}

/// Returns a message without a sequence number: no decoder takes it for a repeat.
pub fn unnumbered(input: &mut Input<'_>) -> Message {
    match input.u8() % 6 {
        0 => Message::Sync(Sync { counter: input.u8() }),
        1 => {
            let scet = Scet::new(input.u32(), input.u32() & 0xFF_FFFF).unwrap_or(Scet::from_ns(0));
            Message::TimeFollowUp(TimeFollowUp { scet, counter: input.u8() })
        }
        2 => {
            let speeds = [(); 4].map(|()| f32::from(i16::from_le_bytes(input.array()).max(-i16::MAX)) * 0.25);
            Message::Wheels(Wheels { speed_rpm: speeds })
        }
        3 => Message::Exposure(Exposure::new(input.u8(), input.u8(), input.u32(), input.u32())),
        4 => {
            let table = Table::ALL[input.below(3)];
            let (row, column) = (input.u8() % table.rows_max(), input.u8() % table.columns());
            Message::Table(TableCell { table, row, column, value: input.finite() })
        }
        _ if input.bool() => Message::Command(Command { token: input.u8(), request: Request::Run }),
        _ => Message::Heartbeat(Heartbeat { state: NodeState::Ready, major: input.u8() }),
    }
}
