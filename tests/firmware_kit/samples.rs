//! Random messages and random damage, the same for the same seed.

use firmware_protocol::can::{CanFrame, CanId};
use firmware_protocol::message::{
    AttitudeFlags, AttitudeRecord, CameraPage, CameraSet, CameraSetting, CameraStatus, CameraTrigger, CameraTriggered,
    Command, Exposure, Heartbeat, Identity, Info, JitterBurst, JitterPair, NodeState, PointingAngle, Rates, Refusal,
    Reply, Request, Response, Scet, StartedBy, StatusPage, StimulatorMode, Sync, Table, TableCell, TimeFollowUp,
    Trigger, Triggered, Wheels,
};
use firmware_protocol::{Message, Reject};
use firmware_protocol::{tables::Applied, version::Version};

/// Kinds of message that [`Samples::message`] makes in turn.
pub(crate) const KINDS: u64 = 13;

/// SplitMix64 (Steele, Lea, Flood 2014).
pub(crate) struct Samples {
    state: u64,
    turn: u64,
}

impl Samples {
    pub(crate) fn new(seed: u64) -> Self {
        Self { state: seed, turn: 0 }
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.state ^ (self.state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Returns a number in `0..limit`.
    pub(crate) fn below(&mut self, limit: u64) -> u64 {
        self.bits() % limit
    }

    fn int<T: TryFrom<u64>>(&mut self, bits: u32) -> T {
        let value = self.bits() >> (64 - bits);
        T::try_from(value).unwrap_or_else(|_| panic!("{bits} bits"))
    }

    pub(crate) fn u8(&mut self) -> u8 {
        self.int(8)
    }

    /// Returns a number from -1 to 1.
    #[allow(clippy::cast_possible_truncation, reason = "24 bits fit in f32")]
    fn unit(&mut self) -> f32 {
        (self.int::<u32>(24) as f32) / 8_388_608.0 - 1.0
    }

    /// Returns a multiple of `lsb` up to `limit` counts, as a decoder gives it.
    #[allow(clippy::cast_possible_truncation, reason = "the value a decoder gives")]
    fn stepped(&mut self, limit: i32, lsb: f64) -> f32 {
        let counts = self.int::<i32>(31) % (2 * limit + 1) - limit;
        (f64::from(counts) * lsb) as f32
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[usize::try_from(self.below(from.len() as u64)).unwrap()]
    }

    /// Returns every kind of message in turn.
    pub(crate) fn message(&mut self) -> Message {
        self.turn += 1;
        match self.turn % KINDS {
            0 => Message::Sync(Sync { counter: self.u8() }),
            1 => Message::TimeFollowUp(TimeFollowUp {
                scet: Scet::new(self.int(32), self.int(24)).unwrap(),
                counter: self.u8(),
            }),
            2 => Message::Attitude(self.attitude()),
            3 => Message::Jitter(self.burst()),
            4 => Message::JitterPair(JitterPair {
                slot: self.u8(),
                samples_arcsec: [0; 2].map(|_| [0; 2].map(|_| self.stepped(8191, 0.02))),
            }),
            5 => Message::Wheels(Wheels { speed_rpm: [0; 4].map(|_| self.stepped(32_767, 0.25)) }),
            6 => {
                let (frame, seq, t_us, age_us) = (self.u8(), self.u8(), self.int(32), self.int::<u32>(16) * 10);
                Message::Exposure(Exposure::new(frame, seq, t_us, age_us))
            }
            7 => Message::Status(self.status()),
            8 => Message::Table(self.cell()),
            9 => Message::Command(Command { token: self.u8(), request: self.request() }),
            10 => Message::Response(Response { token: self.u8(), reply: self.reply() }),
            11 => Message::Camera(self.camera_status()),
            _ => {
                let states = [NodeState::Starting, NodeState::Ready, NodeState::Running, NodeState::Fault];
                Message::Heartbeat(Heartbeat { state: self.pick(&states), major: self.u8() })
            }
        }
    }

    fn attitude(&mut self) -> AttitudeRecord {
        let q = [0; 4].map(|_| self.unit() + 0.01);
        let norm = q.iter().map(|value| value * value).sum::<f32>().sqrt();
        let flags = AttitudeFlags::from_bits(self.u8());
        let vector = |holds: bool, samples: &mut Self| {
            if holds { [0; 3].map(|_| samples.unit()) } else { [0.0; 3] }
        };
        AttitudeRecord {
            t_us: self.int(32),
            seq: self.u8(),
            flags,
            q_wxyz: q.map(|value| value / norm),
            rate_rad_s: vector(flags.rate, self),
            acceleration_rad_s2: vector(flags.acceleration, self),
        }
    }

    fn burst(&mut self) -> JitterBurst {
        let count = usize::try_from(1 + self.below(14)).unwrap();
        let samples: Vec<_> = (0..count).map(|_| [0; 2].map(|_| self.stepped(32_767, 0.01))).collect();
        let (t_us, period_us, seq) = (self.int(32), self.int::<u16>(16).max(1), self.u8());
        JitterBurst::new(t_us, period_us, seq, &samples).unwrap()
    }

    fn status(&mut self) -> StatusPage {
        let modes = [
            StimulatorMode::Idle,
            StimulatorMode::Running,
            StimulatorMode::Holding,
            StimulatorMode::Blank,
            StimulatorMode::Stopped,
        ];
        let angles = [PointingAngle::RightAscension, PointingAngle::Declination, PointingAngle::Roll];
        match self.below(7) {
            0 => StatusPage::State { mode: self.pick(&modes), frames: self.int(16), latency_us: self.int(32) },
            1 => StatusPage::Prediction {
                horizon_10us: self.int::<u16>(16).cast_signed(),
                error_arcsec: self.unit() * 100.0,
            },
            2 => StatusPage::Clock {
                drift_0_1ppm: self.int::<u16>(16).cast_signed(),
                residual_ns: self.int::<u32>(32).cast_signed(),
            },
            3 => StatusPage::Rejects { reason: self.pick(&Reject::ALL), count: self.int(32) },
            _ => {
                let (angle, frame, flags) = (self.pick(&angles), self.u8(), self.int(16));
                StatusPage::Pointing { angle, frame, flags, turns_2_32: self.int(32) }
            }
        }
    }

    fn camera_status(&mut self) -> CameraStatus {
        let page = match self.below(3) {
            0 => CameraPage::Exposure { started_by: self.pick(&StartedBy::ALL), exposure_us: self.int(32) },
            1 => CameraPage::Levels { gain_cdb: self.int(16), black_level_dn_16: self.int(24) },
            _ => CameraPage::Trigger { delay_us: self.int(32) },
        };
        CameraStatus { head: self.u8(), frame: self.u8(), page }
    }

    fn cell(&mut self) -> TableCell {
        let table = self.pick(&Table::ALL);
        let (row, column) = (self.u8() % table.rows_max(), self.u8() % table.columns());
        TableCell { table, row, column, value: self.unit() * 1000.0 }
    }

    fn request(&mut self) -> Request {
        match self.below(9) {
            0 => Request::Hello(Version { major: self.u8(), minor: self.u8() }),
            1 => Request::Info { page: self.u8() },
            2 => Request::Run,
            3 => Request::Stop,
            4 => Request::Apply { table: self.u8(), rows: self.u8(), crc: self.int(16), seed: self.int(16) },
            5 => Request::Trigger(Trigger { number: self.int(16), at_us: self.int(32) }),
            6 => Request::Camera(CameraSetting { kind: self.u8(), head: self.u8(), value: self.int(32) }),
            7 => Request::CameraTrigger(CameraTrigger { head: self.u8(), at_us: self.int(32) }),
            _ => Request::Unknown { opcode: self.u8() | 0x80 },
        }
    }

    fn reply(&mut self) -> Reply {
        match self.below(10) {
            0 => Reply::Hello(Identity {
                version: Version { major: self.u8(), minor: self.u8() },
                capabilities: self.int(16),
                attitude_convention: self.u8(),
            }),
            1 => Reply::Info(Info::DbcCrc32(self.int(32))),
            2 => Reply::Info(Info::Rates(Rates { attitude_hz: self.int(16), jitter_hz: self.int(16) })),
            3 => Reply::Run,
            4 => Reply::Stop,
            5 => Reply::Applied(Applied { table: self.pick(&Table::ALL), rows: self.u8() }),
            6 => Reply::Triggered(Triggered { number: self.int(16), is_late: self.below(2) == 0 }),
            7 => Reply::CameraSet(CameraSet { kind: self.u8(), head: self.u8() }),
            8 => Reply::CameraTriggered(CameraTriggered { head: self.u8(), is_late: self.below(2) == 0 }),
            _ => Reply::Refused { opcode: self.u8(), reason: self.pick(&Refusal::ALL) },
        }
    }

    /// Returns the message; an attitude sometimes with values that no decoder lets through.
    pub(crate) fn strange_message(&mut self) -> Message {
        let mut message = self.message();
        if let Message::Attitude(record) = &mut message {
            let values = [record.q_wxyz[0], 1.0, 0.0, 1.01, f32::NAN, f32::INFINITY];
            record.q_wxyz[0] = self.pick(&values);
            record.rate_rad_s[2] = if self.below(8) == 0 { f32::NAN } else { record.rate_rad_s[2] };
        }
        message
    }

    /// Returns the frame with some of its bits, its length or its identifier changed; half of the time as it was.
    pub(crate) fn spoiled(&mut self, frame: &CanFrame) -> CanFrame {
        let (mut id, mut data) = (frame.id(), frame.data().to_vec());
        match self.below(16) {
            0 => id = self.spoiled_id(id),
            1 | 2 => data.truncate(usize::try_from(self.below(9)).unwrap()),
            3..=6 => {
                for _ in 0..=self.below(3) {
                    let bit = usize::try_from(self.below(8 * data.len() as u64)).unwrap();
                    data[bit / 8] ^= 1 << (bit % 8);
                }
            }
            _ => {}
        }
        CanFrame::classic(id, &data).or_else(|| CanFrame::fd(id, &data)).unwrap()
    }

    /// Returns the identifier with one of its bits changed, or the same number with the other length where it exists.
    fn spoiled_id(&mut self, id: CanId) -> CanId {
        let (bits, number) = if id.is_extended() { (29, id.flagged()) } else { (11, id.number()) };
        let other = CanId::from_flagged(id.flagged() ^ 1 << 31).filter(|_| self.below(4) == 0);
        other.or_else(|| CanId::from_flagged(number ^ 1 << self.below(bits))).unwrap()
    }
}
