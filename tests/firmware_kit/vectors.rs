//! vectors.json -> messages and bytes.

use firmware_protocol::can::{CanFrame, CanId, IdMap};
use firmware_protocol::message::{
    AttitudeFlags, AttitudeRecord, CameraPage, CameraSet, CameraSetting, CameraStatus, CameraTrigger, CameraTriggered,
    Command, Exposure, Heartbeat, Identity, Info, JitterBurst, JitterPair, NodeState, PointingAngle, Rates, Refusal,
    Reply, Request, Response, Scet, StartedBy, StatusPage, StimulatorMode, Sync, Table, TableCell, TimeFollowUp,
    Trigger, Triggered, Wheels,
};
use firmware_protocol::{Message, Reject};
use firmware_protocol::{tables::Applied, version::Version};
use serde_json::Value;

/// A message and its bytes.
#[derive(Debug, Clone)]
pub(crate) struct Vector {
    pub(crate) name: String,
    pub(crate) message: Message,
    /// The base, which says the length of identifiers too.
    pub(crate) base: CanId,
    pub(crate) node: u8,
    pub(crate) fd: CanFrame,
    pub(crate) classic: Option<Vec<CanFrame>>,
    pub(crate) serial_seq: u8,
    pub(crate) serial: Vec<u8>,
}

impl Vector {
    pub(crate) fn ids(&self) -> IdMap {
        IdMap::of(self.base, self.node).unwrap()
    }
}

/// Input whose last piece is refused.
pub(crate) struct Rejected {
    pub(crate) name: String,
    pub(crate) input: Input,
    pub(crate) reason: Reject,
}

/// Input of a receiver.
pub(crate) enum Input {
    Frames(Vec<CanFrame>),
    Serial(Vec<u8>),
}

pub(crate) fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn frame(value: &Value) -> CanFrame {
    let digits = value["id"].as_str().unwrap();
    let id = u32::from_str_radix(digits, 16).unwrap();
    // 3 digits say 11 bits, 8 digits 29.
    let id = if digits.len() == 8 { CanId::extended(id) } else { CanId::from_flagged(id) }.unwrap();
    let data = bytes(value["data"].as_str().unwrap());
    CanFrame::classic(id, &data).or_else(|| CanFrame::fd(id, &data)).unwrap()
}

fn frames(value: &Value) -> Vec<CanFrame> {
    value.as_array().unwrap().iter().map(frame).collect()
}

fn base(value: &Value) -> CanId {
    let base = u32::try_from(value["base"].as_u64().unwrap()).unwrap();
    match value["id_bits"].as_u64() {
        Some(11) => CanId::from_flagged(base).unwrap(),
        Some(29) => CanId::extended(base).unwrap(),
        other => panic!("identifiers of {other:?} bits"),
    }
}

fn document() -> Value {
    serde_json::from_str(&crate::text("vectors.json")).unwrap()
}

/// Returns every message of vectors.json.
pub(crate) fn messages() -> Vec<Vector> {
    let vector = |value: &Value| Vector {
        name: value["name"].as_str().unwrap().to_owned(),
        message: Fields(&value["fields"]).message(value["message"].as_str().unwrap()),
        base: base(value),
        node: u8::try_from(value["node"].as_u64().unwrap()).unwrap(),
        fd: frame(&value["fd"]),
        classic: (!value["classic"].is_null()).then(|| frames(&value["classic"])),
        serial_seq: u8::try_from(value["serial"]["seq"].as_u64().unwrap()).unwrap(),
        serial: bytes(value["serial"]["data"].as_str().unwrap()),
    };
    document()["messages"].as_array().unwrap().iter().map(vector).collect()
}

/// Returns every rejected input of vectors.json.
pub(crate) fn rejected() -> Vec<Rejected> {
    let rejected = |value: &Value| {
        let reason = value["reason"].as_str().unwrap();
        Rejected {
            name: value["name"].as_str().unwrap().to_owned(),
            input: match value["serial"].as_str() {
                Some(hex) => Input::Serial(bytes(hex)),
                None => Input::Frames(frames(&value["frames"])),
            },
            reason: Reject::ALL.into_iter().find(|known| format!("{known:?}") == reason).unwrap(),
        }
    };
    document()["rejected"].as_array().unwrap().iter().map(rejected).collect()
}

/// The physical values of one message.
struct Fields<'a>(&'a Value);

impl Fields<'_> {
    fn int<T: TryFrom<i64>>(&self, name: &str) -> T {
        let value = self.0[name].as_i64().unwrap_or_else(|| panic!("{name} in {}", self.0));
        T::try_from(value).unwrap_or_else(|_| panic!("{name} = {value} does not fit"))
    }

    #[allow(clippy::cast_possible_truncation, reason = "the wire carries f32")]
    fn float(&self, name: &str) -> f32 {
        self.0[name].as_f64().unwrap() as f32
    }

    fn flag(&self, name: &str) -> bool {
        self.0[name].as_bool().unwrap()
    }

    fn floats<const N: usize>(&self, name: &str) -> [f32; N] {
        floats(&self.0[name])
    }

    fn samples(&self) -> Vec<[f32; 2]> {
        self.0["samples_arcsec"].as_array().unwrap().iter().map(floats).collect()
    }

    fn message(&self, name: &str) -> Message {
        match name {
            "SYNC" => Message::Sync(Sync { counter: self.int("counter") }),
            "TIME_FUP" => Message::TimeFollowUp(TimeFollowUp {
                scet: Scet::new(self.int("seconds"), self.int("fraction_2_24")).unwrap(),
                counter: self.int("counter"),
            }),
            "ATT_FD" => Message::Attitude(self.attitude()),
            "JITTER_FD" => Message::Jitter(
                JitterBurst::new(self.int("t_first_us"), self.int("period_us"), self.int("seq"), &self.samples())
                    .unwrap(),
            ),
            "JITTER" => Message::JitterPair(JitterPair {
                slot: self.int("slot"),
                samples_arcsec: self.samples().try_into().unwrap(),
            }),
            "WHEELS" => Message::Wheels(Wheels { speed_rpm: self.floats("speed_rpm") }),
            "EXPOSURE" => Message::Exposure(Exposure::new(
                self.int("frame"),
                self.int("attitude_seq"),
                self.int("mid_exposure_us"),
                self.int("age_us"),
            )),
            "STATUS" => Message::Status(self.status()),
            "CAMERA_STATUS" => Message::Camera(self.camera_status()),
            "TABLE" => Message::Table(TableCell {
                table: Table::from_number(self.int("table")).unwrap(),
                row: self.int("row"),
                column: self.int("column"),
                value: self.float("value"),
            }),
            "CMD" => Message::Command(Command { token: self.int("token"), request: self.request() }),
            "RSP" => Message::Response(Response { token: self.int("token"), reply: self.reply() }),
            "HEARTBEAT" => {
                let states = [NodeState::Starting, NodeState::Ready, NodeState::Running, NodeState::Fault];
                Message::Heartbeat(Heartbeat { state: states[self.int::<usize>("state")], major: self.int("major") })
            }
            _ => panic!("no message {name}"),
        }
    }

    fn attitude(&self) -> AttitudeRecord {
        AttitudeRecord {
            t_us: self.int("t_us"),
            seq: self.int("seq"),
            flags: AttitudeFlags { rate: self.flag("rate_valid"), acceleration: self.flag("acceleration_valid") },
            q_wxyz: self.floats("q_wxyz"),
            rate_rad_s: self.floats("rate_rad_s"),
            acceleration_rad_s2: self.floats("acceleration_rad_s2"),
        }
    }

    fn status(&self) -> StatusPage {
        let modes = [
            StimulatorMode::Idle,
            StimulatorMode::Running,
            StimulatorMode::Holding,
            StimulatorMode::Blank,
            StimulatorMode::Stopped,
        ];
        let angles = [PointingAngle::RightAscension, PointingAngle::Declination, PointingAngle::Roll];
        match self.int::<usize>("page") {
            0 => StatusPage::State {
                mode: modes[self.int::<usize>("mode")],
                frames: self.int("frames"),
                latency_us: self.int("latency_us"),
            },
            1 => StatusPage::Prediction {
                horizon_10us: self.int("horizon_10us"),
                error_arcsec: self.float("error_arcsec"),
            },
            2 => StatusPage::Clock { drift_0_1ppm: self.int("drift_0_1ppm"), residual_ns: self.int("residual_ns") },
            3 => {
                StatusPage::Rejects { reason: Reject::from_code(self.int("reason")).unwrap(), count: self.int("count") }
            }
            page => StatusPage::Pointing {
                angle: angles[page - 4],
                frame: self.int("frame"),
                turns_2_32: self.int("turns_2_32"),
                flags: self.int("flags"),
            },
        }
    }

    fn camera_status(&self) -> CameraStatus {
        let page = match self.int("page") {
            0 => CameraPage::Exposure {
                started_by: StartedBy::from_code(self.int("started_by")).unwrap(),
                exposure_us: self.int("exposure_us"),
            },
            1 => {
                CameraPage::Levels { gain_cdb: self.int("gain_cdb"), black_level_dn_16: self.int("black_level_dn_16") }
            }
            2 => CameraPage::Trigger { delay_us: self.int("delay_us") },
            page => panic!("no page {page}"),
        };
        CameraStatus { head: self.int("head"), frame: self.int("frame"), page }
    }

    fn version(&self) -> Version {
        Version { major: self.int("major"), minor: self.int("minor") }
    }

    fn request(&self) -> Request {
        match self.int("opcode") {
            1 => Request::Hello(self.version()),
            2 => Request::Info { page: self.int("page") },
            3 => Request::Run,
            4 => Request::Stop,
            5 => Request::Apply {
                table: self.int("table"),
                rows: self.int("rows"),
                crc: self.int("crc16"),
                seed: self.int("seed"),
            },
            6 => Request::Trigger(Trigger { number: self.int("trigger"), at_us: self.int("at_us") }),
            7 => Request::Camera(CameraSetting {
                kind: self.int("camera_kind"),
                head: self.int("head"),
                value: self.int("camera_value"),
            }),
            8 => Request::CameraTrigger(CameraTrigger { head: self.int("head"), at_us: self.int("at_us") }),
            opcode => Request::Unknown { opcode },
        }
    }

    fn reply(&self) -> Reply {
        let code: u8 = self.int("code");
        if code != 0 {
            let reason = Refusal::ALL.into_iter().find(|reason| reason.code() == code).unwrap();
            return Reply::Refused { opcode: self.int("opcode"), reason };
        }
        match (self.int::<u8>("opcode"), self.0["page"].as_u64()) {
            (1, _) => Reply::Hello(Identity {
                version: self.version(),
                capabilities: self.int("capabilities"),
                attitude_convention: self.int("attitude_convention"),
            }),
            (2, Some(0)) => Reply::Info(Info::DbcCrc32(self.int("dbc_crc32"))),
            (2, Some(1)) => Reply::Info(Info::Rates(Rates {
                attitude_hz: self.int("attitude_hz"),
                jitter_hz: self.int("jitter_hz"),
            })),
            (3, _) => Reply::Run,
            (4, _) => Reply::Stop,
            (5, _) => Reply::Applied(Applied {
                table: Table::from_number(self.int("table")).unwrap(),
                rows: self.int("rows"),
            }),
            (6, _) => Reply::Triggered(Triggered { number: self.int("trigger"), is_late: self.int::<u8>("late") == 1 }),
            (7, _) => Reply::CameraSet(CameraSet { kind: self.int("camera_kind"), head: self.int("head") }),
            (8, _) => {
                Reply::CameraTriggered(CameraTriggered { head: self.int("head"), is_late: self.int::<u8>("late") == 1 })
            }
            other => panic!("no response {other:?}"),
        }
    }
}

#[allow(clippy::cast_possible_truncation, reason = "the wire carries f32")]
fn floats<const N: usize>(value: &Value) -> [f32; N] {
    let values = value.as_array().unwrap().iter().map(|value| value.as_f64().unwrap() as f32);
    values.collect::<Vec<_>>().try_into().unwrap()
}
