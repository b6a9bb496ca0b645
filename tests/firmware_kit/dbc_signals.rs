//! Payload -> signals, by the DBC alone; message -> what its signals should say, by the crate's types alone.

use can_dbc::{Dbc, Message as Described, MultiplexIndicator, Signal, SignalExtendedValueType, ValueType};
use firmware_protocol::Message;
use firmware_protocol::message::{
    AttitudeRecord, CameraPage, CameraStatus, Command, Info, MessageId, PointingAngle, Reply, Request, Response,
    StatusPage, Table, TableCell,
};

/// Returns bits of a signal, least significant first.
fn bits(data: &[u8], signal: &Signal) -> u64 {
    let bit = |at: u64| u64::from(data[usize::try_from(at / 8).unwrap()] >> (at % 8) & 1);
    (0..signal.size).fold(0, |value, i| value | bit(signal.start_bit + i) << i)
}

/// Returns the physical value of a signal.
#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "at most 32 bits")]
fn physical(dbc: &Dbc, described: &Described, signal: &Signal, data: &[u8]) -> f64 {
    let raw = bits(data, signal);
    let is_float = dbc.signal_extended_value_type_list.iter().any(|entry| {
        entry.message_id == described.id
            && entry.signal_name == signal.name
            && entry.signal_extended_value_type == SignalExtendedValueType::IEEEfloat32Bit
    });
    let value = match signal.value_type {
        _ if is_float => f64::from(f32::from_bits(raw as u32)),
        ValueType::Signed => {
            let unused = 64 - signal.size;
            ((raw << unused).cast_signed() >> unused) as f64
        }
        ValueType::Unsigned => raw as f64,
    };
    value * signal.factor + signal.offset
}

/// Returns whether the signal's multiplexors, up to the first, have the values that select it.
pub(crate) fn is_active(dbc: &Dbc, described: &Described, signal: &Signal, data: &[u8]) -> bool {
    let selected_by =
        |parent: &Signal, value: u64| bits(data, parent) == value && is_active(dbc, described, parent, data);
    let named = |name: &str| described.signals.iter().find(|signal| signal.name == name).unwrap();
    match signal.multiplexer_indicator {
        MultiplexIndicator::Plain | MultiplexIndicator::Multiplexor => true,
        MultiplexIndicator::MultiplexedSignal(value) | MultiplexIndicator::MultiplexorAndMultiplexedSignal(value) => {
            let extended = dbc
                .extended_multiplex
                .iter()
                .find(|entry| entry.message_id == described.id && entry.signal_name == signal.name);
            let first =
                || described.signals.iter().find(|s| s.multiplexer_indicator == MultiplexIndicator::Multiplexor);
            match extended {
                Some(entry) => selected_by(named(&entry.multiplexor_signal_name), value),
                None => selected_by(first().unwrap(), value),
            }
        }
    }
}

/// Returns every signal that the payload holds, by name.
pub(crate) fn decode(dbc: &Dbc, described: &Described, data: &[u8]) -> Vec<(String, f64)> {
    let active = described.signals.iter().filter(|signal| is_active(dbc, described, signal, data));
    active.map(|signal| (signal.name.clone(), physical(dbc, described, signal, data))).collect()
}

/// Signals with their values and how far off they may be.
type Expected = Vec<(String, f64, f64)>;

/// Rounding of f64 in scale and offset, relative.
const ROUNDING: f64 = 1e-12;
/// Half a count of classic rates.
const HALF_COUNT: f64 = 0.5e-6 + 1e-12;
/// f32 values of scaled fields: relative.
const F32: f64 = 1.2e-7;

fn exact<T: Into<f64>>(name: &str, value: T) -> (String, f64, f64) {
    let value = value.into();
    (name.to_owned(), value, value.abs() * ROUNDING)
}

fn scaled(name: impl Into<String>, value: f32) -> (String, f64, f64) {
    (name.into(), value.into(), f64::from(value.abs()) * F32 + ROUNDING)
}

fn turns_deg(turns: f64) -> f64 {
    turns * 360.0 / 4_294_967_296.0
}

/// Returns the expected signals of one frame of the message. A CRC is taken from the bytes: the vectors check it.
pub(crate) fn expected(message: &Message, frame: MessageId, data: &[u8]) -> Expected {
    match message {
        Message::Sync(sync) => vec![exact("Counter", sync.counter)],
        Message::TimeFollowUp(time) => vec![
            exact("Seconds", time.scet.seconds()),
            exact("Fraction", f64::from(time.scet.fraction()) / 16_777_216.0),
            exact("Counter", time.counter),
        ],
        Message::Attitude(record) => attitude(record, frame, u16::from_le_bytes([data[6], data[7]])),
        Message::Jitter(burst) => {
            let used = burst.samples_arcsec();
            let mut signals = vec![
                exact("TimeTag", burst.t_first_us),
                exact("Period", burst.period_us),
                exact("Seq", burst.seq),
                exact("Samples", u8::try_from(used.len()).unwrap()),
            ];
            signals.extend((0..14).flat_map(|i| sample(i, used.get(i).copied().unwrap_or_default())));
            signals
        }
        Message::JitterPair(pair) => {
            let mut signals = vec![exact("Slot", pair.slot)];
            signals.extend((0..2).flat_map(|i| sample(i, pair.samples_arcsec[i])));
            signals
        }
        Message::Wheels(wheels) => (0..4).map(|i| exact(&format!("Speed{i}"), wheels.speed_rpm[i])).collect(),
        Message::Exposure(exposure) => vec![
            exact("Frame", exposure.frame),
            exact("AttitudeSeq", exposure.attitude_seq),
            exact("MidExposure", exposure.mid_exposure_us),
            exact("Age", exposure.age_us()),
        ],
        Message::Status(page) => status(page),
        Message::Camera(status) => camera_status(status),
        Message::Table(cell) => table(cell),
        Message::Command(command) => request(command),
        Message::Response(response) => reply(response),
        Message::Heartbeat(heartbeat) => vec![exact("State", heartbeat.state as u8), exact("Major", heartbeat.major)],
    }
}

fn sample(i: usize, [x, y]: [f32; 2]) -> [(String, f64, f64); 2] {
    [scaled(format!("X{i}"), x), scaled(format!("Y{i}"), y)]
}

fn attitude(record: &AttitudeRecord, frame: MessageId, crc: u16) -> Expected {
    let head = || {
        vec![
            exact("TimeTag", record.t_us),
            exact("Seq", record.seq),
            exact("RateValid", u8::from(record.flags.rate)),
            exact("AccelerationValid", u8::from(record.flags.acceleration)),
            exact("Crc16", crc),
        ]
    };
    let q = |i: usize| exact(["Qw", "Qx", "Qy", "Qz"][i], record.q_wxyz[i]);
    let rates = |name: &str, values: [f32; 3], off: f64| -> Expected {
        let axes = ["X", "Y", "Z"].into_iter().zip(values);
        axes.map(|(axis, value)| (format!("{name}{axis}"), f64::from(value), off)).collect()
    };
    match frame {
        MessageId::AttitudeQ01 => vec![q(0), q(1)],
        MessageId::AttitudeQ23 => vec![q(2), q(3)],
        MessageId::AttitudeRate => rates("Rate", record.rate_rad_s, HALF_COUNT),
        MessageId::AttitudeAcceleration => rates("Acceleration", record.acceleration_rad_s2, HALF_COUNT),
        MessageId::AttitudeCommit => head(),
        _ => {
            let mut signals = head();
            signals.extend((0..4).map(q));
            signals.extend(rates("Rate", record.rate_rad_s, 0.0));
            signals.extend(rates("Acceleration", record.acceleration_rad_s2, 0.0));
            signals
        }
    }
}

fn status(page: &StatusPage) -> Expected {
    match *page {
        StatusPage::State { mode, frames, latency_us } => {
            vec![exact("Page", 0), exact("Mode", mode as u8), exact("Frames", frames), exact("Latency", latency_us)]
        }
        StatusPage::Prediction { horizon_10us, error_arcsec } => vec![
            exact("Page", 1),
            exact("Horizon", f64::from(horizon_10us) * 10.0),
            exact("PredictionError", error_arcsec),
        ],
        StatusPage::Clock { drift_0_1ppm, residual_ns } => {
            vec![exact("Page", 2), exact("Drift", f64::from(drift_0_1ppm) / 10.0), exact("Residual", residual_ns)]
        }
        StatusPage::Rejects { reason, count } => {
            vec![exact("Page", 3), exact("Reason", reason.code()), exact("Count", count)]
        }
        StatusPage::Pointing { angle, frame, flags, turns_2_32 } => {
            let (name, turns) = match angle {
                PointingAngle::RightAscension => ("RightAscension", f64::from(turns_2_32)),
                PointingAngle::Declination => ("Declination", f64::from(turns_2_32.cast_signed())),
                PointingAngle::Roll => ("Roll", f64::from(turns_2_32.cast_signed())),
            };
            let (page, frame) = (exact("Page", angle as u8), exact(&format!("{name}Frame"), frame));
            vec![page, frame, exact(&format!("{name}Flags"), flags), exact(name, turns_deg(turns))]
        }
    }
}

fn camera_status(status: &CameraStatus) -> Expected {
    let mut signals =
        vec![exact("Page", status.page.number()), exact("Head", status.head), exact("Frame", status.frame)];
    signals.extend(match status.page {
        CameraPage::Exposure { started_by, exposure_us } => {
            vec![exact("StartedBy", started_by as u8), exact("ExposureTime", exposure_us)]
        }
        CameraPage::Levels { gain_cdb, black_level_dn_16 } => {
            vec![exact("Gain", f64::from(gain_cdb) / 100.0), exact("BlackLevel", f64::from(black_level_dn_16) / 16.0)]
        }
        CameraPage::Trigger { delay_us } => vec![exact("TriggerDelay", delay_us)],
    });
    signals
}

fn table(cell: &TableCell) -> Expected {
    let (column, names): (_, &[&str]) = match cell.table {
        Table::Lines => {
            let names = &["Frequency", "AmplitudeX", "AmplitudeY", "AmplitudeZ", "Phase"];
            ("Line", names)
        }
        Table::Psd => ("Psd", &["Frequency", "DensityX", "DensityY", "DensityZ"]),
        Table::WheelHarmonics => {
            ("Harmonic", &["Wheel", "Number", "AmplitudeX", "AmplitudeY", "AmplitudeZ", "Exponent", "Phase"])
        }
    };
    vec![
        exact("TableNumber", cell.table.number()),
        exact("Row", cell.row),
        exact(&format!("{column}Column"), cell.column),
        exact(&format!("{column}{}", names[usize::from(cell.column)]), cell.value),
    ]
}

fn request(command: &Command) -> Expected {
    let mut signals = vec![exact("Opcode", command.request.opcode()), exact("Token", command.token)];
    match command.request {
        Request::Hello(version) => signals.extend([exact("Major", version.major), exact("Minor", version.minor)]),
        Request::Info { page } => signals.push(exact("InfoPage", page)),
        Request::Apply { table, rows, crc, seed } => signals.extend([
            exact("ApplyTable", table),
            exact("ApplyRows", rows),
            exact("ApplyCrc16", crc),
            exact("ApplySeed", seed),
        ]),
        Request::Trigger(trigger) => {
            signals.extend([exact("TriggerNumber", trigger.number), exact("TriggerTime", trigger.at_us)]);
        }
        Request::Camera(setting) => signals.extend([
            exact("CameraKind", setting.kind),
            exact("CameraHead", setting.head),
            exact("CameraValue", setting.value),
        ]),
        Request::CameraTrigger(trigger) => {
            signals.extend([exact("CameraTriggerHead", trigger.head), exact("CameraTriggerTime", trigger.at_us)]);
        }
        Request::Run | Request::Stop | Request::Unknown { .. } => {}
    }
    signals
}

fn reply(response: &Response) -> Expected {
    let head =
        |opcode: u8, code: u8| vec![exact("Opcode", opcode), exact("Token", response.token), exact("Code", code)];
    match response.reply {
        Reply::Hello(identity) => {
            hello(head(1, 0), identity.version, identity.capabilities, identity.attitude_convention)
        }
        Reply::Info(info) => {
            let mut signals = head(2, 0);
            signals.extend(match info {
                Info::DbcCrc32(crc) => vec![exact("InfoPage", 0), exact("DbcCrc32", crc)],
                Info::Rates(rates) => vec![
                    exact("InfoPage", 1),
                    exact("AttitudeRate", rates.attitude_hz),
                    exact("JitterRate", rates.jitter_hz),
                ],
            });
            signals
        }
        Reply::Run => head(3, 0),
        Reply::Stop => head(4, 0),
        Reply::Applied(applied) => {
            let mut signals = head(5, 0);
            signals.extend([exact("AppliedTable", applied.table.number()), exact("AppliedRows", applied.rows)]);
            signals
        }
        Reply::Triggered(triggered) => {
            let late = u8::from(triggered.is_late);
            let mut signals = head(6, 0);
            signals.extend([exact("TriggeredNumber", triggered.number), exact("TriggeredLate", late)]);
            signals
        }
        Reply::CameraSet(set) => {
            let mut signals = head(7, 0);
            signals.extend([exact("CameraKind", set.kind), exact("CameraHead", set.head)]);
            signals
        }
        Reply::CameraTriggered(triggered) => {
            let late = u8::from(triggered.is_late);
            let mut signals = head(8, 0);
            signals.extend([exact("CameraTriggeredHead", triggered.head), exact("CameraTriggeredLate", late)]);
            signals
        }
        // A refusal has zeros in the place of the answer, and the DBC reads them as such.
        Reply::Refused { opcode, reason } => {
            let mut signals = head(opcode, reason.code());
            signals.extend(match opcode {
                1 => hello(vec![], firmware_protocol::version::Version { major: 0, minor: 0 }, 0, 0),
                2 => vec![exact("InfoPage", 0), exact("DbcCrc32", 0)],
                5 => vec![exact("AppliedTable", 0), exact("AppliedRows", 0)],
                6 => vec![exact("TriggeredNumber", 0), exact("TriggeredLate", 0)],
                7 => vec![exact("CameraKind", 0), exact("CameraHead", 0)],
                8 => vec![exact("CameraTriggeredHead", 0), exact("CameraTriggeredLate", 0)],
                _ => vec![],
            });
            signals
        }
    }
}

fn hello(head: Expected, version: firmware_protocol::version::Version, capabilities: u16, convention: u8) -> Expected {
    let bit = |name: &str, at: u32| exact(name, u8::from(capabilities >> at & 1 == 1));
    let mut signals = head;
    signals.extend([exact("Major", version.major), exact("Minor", version.minor)]);
    signals.extend([bit("ParameterTables", 0), bit("JitterSamples", 1), bit("WheelSpeeds", 2), bit("Triggers", 3)]);
    signals.push(bit("Cameras", 4));
    signals.push(exact("AttitudeConvention", convention));
    signals
}
