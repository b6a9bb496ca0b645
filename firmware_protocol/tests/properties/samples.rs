//! Legal messages for the property tests.

use firmware_protocol::message::{
    AttitudeFlags, AttitudeRecord, CameraPage, CameraSet, CameraSetting, CameraStatus, CameraTrigger, CameraTriggered,
    Command, Exposure, Heartbeat, JitterBurst, JitterPair, NodeState, PointingAngle, Reply, Request, Response, Scet,
    StartedBy, StatusPage, Sync, Table, TableCell, TimeFollowUp, Trigger, Triggered, Wheels,
};
use firmware_protocol::tables::Applied;
use firmware_protocol::{Message, Reject};
use proptest::array::{uniform2, uniform3, uniform4};
use proptest::prelude::*;

/// Returns the unit quaternions whose components are rounded to f32.
fn quaternion() -> impl Strategy<Value = [f32; 4]> {
    uniform4(-1.0_f32..1.0).prop_filter_map("too short to normalise", |q| {
        let norm = q.iter().map(|value| value * value).sum::<f32>().sqrt();
        (norm > 0.1).then(|| q.map(|value| value / norm))
    })
}

pub(crate) fn attitude() -> impl Strategy<Value = AttitudeRecord> {
    let rates = (uniform3(-1.0_f32..1.0), uniform3(-1.0_f32..1.0));
    (any::<u32>(), any::<u8>(), 0_u8..4, quaternion(), rates).prop_map(|(t_us, seq, bits, q_wxyz, (rate, acc))| {
        let flags = AttitudeFlags::from_bits(bits);
        AttitudeRecord {
            t_us,
            seq,
            flags,
            q_wxyz,
            rate_rad_s: if flags.rate { rate } else { [0.0; 3] },
            acceleration_rad_s2: if flags.acceleration { acc } else { [0.0; 3] },
        }
    })
}

/// Multiples of `lsb`, as the wire carries them.
fn stepped(limit: i32, lsb: f64) -> impl Strategy<Value = f32> {
    #[allow(clippy::cast_possible_truncation, reason = "the value a decoder gives")]
    (-limit..=limit).prop_map(move |counts| (f64::from(counts) * lsb) as f32)
}

fn jitter() -> impl Strategy<Value = Message> {
    let samples = prop::collection::vec(uniform2(stepped(32_767, 0.01)), 1..=14);
    (any::<u32>(), 1_u16.., any::<u8>(), samples)
        .prop_map(|(t, period, seq, samples)| Message::Jitter(JitterBurst::new(t, period, seq, &samples).unwrap()))
}

fn status() -> impl Strategy<Value = StatusPage> {
    prop_oneof![
        (any::<i16>(), 0.0_f32..1e6)
            .prop_map(|(horizon_10us, error_arcsec)| StatusPage::Prediction { horizon_10us, error_arcsec }),
        (any::<i16>(), any::<i32>())
            .prop_map(|(drift_0_1ppm, residual_ns)| StatusPage::Clock { drift_0_1ppm, residual_ns }),
        (prop::sample::select(&Reject::ALL[..]), any::<u32>())
            .prop_map(|(reason, count)| StatusPage::Rejects { reason, count }),
        (any::<u8>(), any::<u16>(), any::<u32>()).prop_map(|(frame, flags, turns_2_32)| StatusPage::Pointing {
            angle: PointingAngle::Roll,
            frame,
            flags,
            turns_2_32
        }),
    ]
}

fn cell() -> impl Strategy<Value = TableCell> {
    let value = prop::num::f32::NORMAL | prop::num::f32::ZERO;
    (prop::sample::select(&Table::ALL[..]), any::<u8>(), any::<u8>(), value).prop_map(|(table, row, column, value)| {
        TableCell { table, row: row % table.rows_max(), column: column % table.columns(), value }
    })
}

fn apply() -> impl Strategy<Value = Request> {
    (any::<u8>(), any::<u8>(), any::<u16>(), any::<u16>()).prop_map(|(table, rows, crc, seed)| Request::Apply {
        table,
        rows,
        crc,
        seed,
    })
}

fn trigger() -> impl Strategy<Value = Request> {
    (any::<u16>(), any::<u32>()).prop_map(|(number, at_us)| Request::Trigger(Trigger { number, at_us }))
}

fn triggered() -> impl Strategy<Value = Reply> {
    (any::<u16>(), any::<bool>()).prop_map(|(number, is_late)| Reply::Triggered(Triggered { number, is_late }))
}

fn camera_request() -> impl Strategy<Value = Request> {
    prop_oneof![
        (any::<u8>(), any::<u8>(), any::<u32>()).prop_map(|(kind, head, value)| Request::Camera(CameraSetting {
            kind,
            head,
            value
        })),
        (any::<u8>(), any::<u32>()).prop_map(|(head, at_us)| Request::CameraTrigger(CameraTrigger { head, at_us })),
    ]
}

fn camera_reply() -> impl Strategy<Value = Reply> {
    prop_oneof![
        (any::<u8>(), any::<u8>()).prop_map(|(kind, head)| Reply::CameraSet(CameraSet { kind, head })),
        (any::<u8>(), any::<bool>())
            .prop_map(|(head, is_late)| Reply::CameraTriggered(CameraTriggered { head, is_late })),
    ]
}

fn camera_status() -> impl Strategy<Value = CameraStatus> {
    let page = prop_oneof![
        (prop::sample::select(&StartedBy::ALL[..]), any::<u32>())
            .prop_map(|(started_by, exposure_us)| CameraPage::Exposure { started_by, exposure_us }),
        (any::<u16>(), 0_u32..1 << 24)
            .prop_map(|(gain_cdb, black_level_dn_16)| CameraPage::Levels { gain_cdb, black_level_dn_16 }),
        any::<u32>().prop_map(|delay_us| CameraPage::Trigger { delay_us }),
    ];
    (any::<u8>(), any::<u8>(), page).prop_map(|(head, frame, page)| CameraStatus { head, frame, page })
}

fn applied() -> impl Strategy<Value = Reply> {
    (prop::sample::select(&Table::ALL[..]), any::<u8>())
        .prop_map(|(table, rows)| Reply::Applied(Applied { table, rows }))
}

/// Returns any message except a jitter burst, which classic CAN does not carry.
pub(crate) fn classic_message() -> impl Strategy<Value = Message> {
    let follow_up = (any::<u32>(), 0_u32..1 << 24, any::<u8>());
    prop_oneof![
        attitude().prop_map(Message::Attitude),
        any::<u8>().prop_map(|counter| Message::Sync(Sync { counter })),
        follow_up.prop_map(|(s, f, counter)| Message::TimeFollowUp(TimeFollowUp {
            scet: Scet::new(s, f).unwrap(),
            counter
        })),
        uniform4(stepped(32_767, 0.25)).prop_map(|speed_rpm| Message::Wheels(Wheels { speed_rpm })),
        (any::<u8>(), uniform2(uniform2(stepped(8191, 0.02))))
            .prop_map(|(slot, samples_arcsec)| Message::JitterPair(JitterPair { slot, samples_arcsec })),
        (any::<u8>(), any::<u8>(), any::<u32>(), 0_u32..655_360)
            .prop_map(|(frame, seq, t, age)| Message::Exposure(Exposure::new(frame, seq, t, age))),
        status().prop_map(Message::Status),
        camera_status().prop_map(Message::Camera),
        (any::<u8>(), any::<u8>())
            .prop_map(|(token, page)| Message::Command(Command { token, request: Request::Info { page } })),
        (any::<u8>(), prop_oneof![apply(), trigger(), camera_request()])
            .prop_map(|(token, request)| Message::Command(Command { token, request })),
        any::<u8>().prop_map(|token| Message::Response(Response { token, reply: Reply::Stop })),
        (any::<u8>(), prop_oneof![applied(), triggered(), camera_reply()])
            .prop_map(|(token, reply)| Message::Response(Response { token, reply })),
        cell().prop_map(Message::Table),
        any::<u8>().prop_map(|major| Message::Heartbeat(Heartbeat { state: NodeState::Fault, major })),
    ]
}

pub(crate) fn message() -> impl Strategy<Value = Message> {
    prop_oneof![4 => classic_message(), 1 => jitter()]
}
