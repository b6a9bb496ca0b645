//! The structures of `starloop_protocol.h`, and what they mean as messages of the crate.
//!
//! A structure that no message of the crate can say (an unknown enumeration, a burst without samples) gives `None`.

use firmware_protocol::message::{AttitudeFlags, AttitudeRecord, CameraPage, CameraSet, CameraSetting, CameraStatus, CameraTrigger, CameraTriggered, Command, Exposure, Heartbeat, Identity, Info, JITTER_BURST_MAX, JitterBurst, JitterPair, NodeState, PointingAngle, Rates, Refusal, Reply, Request, Response, Scet, StartedBy, StatusPage, StimulatorMode, Sync, Table, TableCell, TimeFollowUp, Trigger, Triggered, Wheels, opcode};
use firmware_protocol::{Reject, tables::Applied, version::Version};

macro_rules! structures {
    ($($(#[doc = $doc:literal])+ $name:ident { $($field:ident: $kind:ty,)+ })+) => {
        $(
            $(#[doc = $doc])+
            #[repr(C)]
            #[derive(Clone, Copy, Default)]
            pub(crate) struct $name { $(pub(crate) $field: $kind,)+ }
        )+
    };
}

structures! {
    /// `sl_sync`
    RawSync { counter: u8, }
    /// `sl_time_fup`
    RawTime { seconds: u32, fraction_2_24: u32, counter: u8, }
    /// `sl_attitude`
    RawAttitude {
        t_us: u32,
        seq: u8,
        flags: u8,
        q_wxyz: [f32; 4],
        rate_rad_s: [f32; 3],
        acceleration_rad_s2: [f32; 3],
    }
    /// `sl_jitter_burst`
    RawBurst { t_first_us: u32, period_us: u16, seq: u8, count: u8, samples_arcsec: [[f32; 2]; JITTER_BURST_MAX], }
    /// `sl_jitter_pair`
    RawPair { slot: u8, samples_arcsec: [[f32; 2]; 2], }
    /// `sl_wheels`
    RawWheels { speed_rpm: [f32; 4], }
    /// `sl_exposure`
    RawExposure { frame: u8, attitude_seq: u8, mid_exposure_us: u32, age_us: u32, }
    /// `sl_status`
    RawStatus {
        page: u8,
        mode: u8,
        frames: u16,
        latency_us: u32,
        horizon_10us: i16,
        error_arcsec: f32,
        drift_0_1ppm: i16,
        residual_ns: i32,
        reason: u8,
        count: u32,
        frame: u8,
        turns_2_32: u32,
        flags: u16,
    }
    /// `sl_camera_status`
    RawCameraStatus {
        page: u8,
        head: u8,
        frame: u8,
        started_by: u8,
        exposure_us: u32,
        gain_cdb: u16,
        black_level_dn_16: u32,
        delay_us: u32,
    }
    /// `sl_table_cell`
    RawCell { table: u8, row: u8, column: u8, value: f32, }
    /// `sl_command`
    RawCommand {
        opcode: u8,
        token: u8,
        major: u8,
        minor: u8,
        page: u8,
        table: u8,
        rows: u8,
        crc16: u16,
        seed: u16,
        trigger: u16,
        at_us: u32,
        camera_kind: u8,
        head: u8,
        camera_value: u32,
    }
    /// `sl_response`
    RawResponse {
        opcode: u8,
        token: u8,
        code: u8,
        major: u8,
        minor: u8,
        capabilities: u16,
        attitude_convention: u8,
        page: u8,
        dbc_crc32: u32,
        attitude_hz: u16,
        jitter_hz: u16,
        table: u8,
        rows: u8,
        trigger: u16,
        late: u8,
        camera_kind: u8,
        head: u8,
    }
    /// `sl_heartbeat`
    RawHeartbeat { state: u8, major: u8, }
}

impl RawTime {
    pub(crate) fn read(&self) -> Option<TimeFollowUp> {
        Scet::new(self.seconds, self.fraction_2_24).map(|scet| TimeFollowUp { scet, counter: self.counter })
    }

    pub(crate) fn of(time: &TimeFollowUp) -> Self {
        Self { seconds: time.scet.seconds(), fraction_2_24: time.scet.fraction(), counter: time.counter }
    }
}

impl RawSync {
    pub(crate) fn read(&self) -> Sync {
        Sync { counter: self.counter }
    }
}

impl RawAttitude {
    pub(crate) fn read(&self) -> AttitudeRecord {
        AttitudeRecord {
            t_us: self.t_us,
            seq: self.seq,
            flags: AttitudeFlags::from_bits(self.flags),
            q_wxyz: self.q_wxyz,
            rate_rad_s: self.rate_rad_s,
            acceleration_rad_s2: self.acceleration_rad_s2,
        }
    }

    pub(crate) fn of(record: &AttitudeRecord) -> Self {
        Self {
            t_us: record.t_us,
            seq: record.seq,
            flags: record.flags.bits(),
            q_wxyz: record.q_wxyz,
            rate_rad_s: record.rate_rad_s,
            acceleration_rad_s2: record.acceleration_rad_s2,
        }
    }
}

impl RawBurst {
    pub(crate) fn read(&self) -> Option<JitterBurst> {
        let samples = self.samples_arcsec.get(..usize::from(self.count))?;
        JitterBurst::new(self.t_first_us, self.period_us, self.seq, samples)
    }

    pub(crate) fn of(burst: &JitterBurst) -> Self {
        let (mut samples_arcsec, mut count) = ([[0.0; 2]; JITTER_BURST_MAX], 0);
        for (to, from) in samples_arcsec.iter_mut().zip(burst.samples_arcsec()) {
            *to = *from;
            count += 1;
        }
        Self { t_first_us: burst.t_first_us, period_us: burst.period_us, seq: burst.seq, count, samples_arcsec }
    }
}

impl RawPair {
    pub(crate) fn read(&self) -> JitterPair {
        JitterPair { slot: self.slot, samples_arcsec: self.samples_arcsec }
    }
}

impl RawWheels {
    pub(crate) fn read(&self) -> Wheels {
        Wheels { speed_rpm: self.speed_rpm }
    }
}

impl RawExposure {
    pub(crate) fn read(&self) -> Exposure {
        Exposure::new(self.frame, self.attitude_seq, self.mid_exposure_us, self.age_us)
    }

    pub(crate) fn of(exposure: &Exposure) -> Self {
        Self {
            frame: exposure.frame,
            attitude_seq: exposure.attitude_seq,
            mid_exposure_us: exposure.mid_exposure_us,
            age_us: exposure.age_us(),
        }
    }
}

impl RawStatus {
    pub(crate) fn read(&self) -> Option<StatusPage> {
        let pointing = |angle| {
            let Self { frame, flags, turns_2_32, .. } = *self;
            StatusPage::Pointing { angle, frame, flags, turns_2_32 }
        };
        match self.page {
            0 => {
                let mode = StimulatorMode::from_code(self.mode)?;
                Some(StatusPage::State { mode, frames: self.frames, latency_us: self.latency_us })
            }
            1 => Some(StatusPage::Prediction { horizon_10us: self.horizon_10us, error_arcsec: self.error_arcsec }),
            2 => Some(StatusPage::Clock { drift_0_1ppm: self.drift_0_1ppm, residual_ns: self.residual_ns }),
            3 => Reject::from_code(self.reason).map(|reason| StatusPage::Rejects { reason, count: self.count }),
            4 => Some(pointing(PointingAngle::RightAscension)),
            5 => Some(pointing(PointingAngle::Declination)),
            6 => Some(pointing(PointingAngle::Roll)),
            _ => None,
        }
    }

    pub(crate) fn of(page: &StatusPage) -> Self {
        let none = Self::default();
        match *page {
            StatusPage::State { mode, frames, latency_us } => Self { mode: mode as u8, frames, latency_us, ..none },
            StatusPage::Prediction { horizon_10us, error_arcsec } => {
                Self { page: 1, horizon_10us, error_arcsec, ..none }
            }
            StatusPage::Clock { drift_0_1ppm, residual_ns } => Self { page: 2, drift_0_1ppm, residual_ns, ..none },
            StatusPage::Rejects { reason, count } => Self { page: 3, reason: reason.code(), count, ..none },
            StatusPage::Pointing { angle, frame, flags, turns_2_32 } => {
                Self { page: angle as u8, frame, flags, turns_2_32, ..none }
            }
        }
    }
}

impl RawCameraStatus {
    pub(crate) fn read(&self) -> Option<CameraStatus> {
        let page = match self.page {
            0 => {
                let started_by = StartedBy::from_code(self.started_by)?;
                CameraPage::Exposure { started_by, exposure_us: self.exposure_us }
            }
            1 => CameraPage::Levels { gain_cdb: self.gain_cdb, black_level_dn_16: self.black_level_dn_16 },
            2 => CameraPage::Trigger { delay_us: self.delay_us },
            _ => return None,
        };
        Some(CameraStatus { head: self.head, frame: self.frame, page })
    }

    pub(crate) fn of(status: &CameraStatus) -> Self {
        let CameraStatus { head, frame, page } = *status;
        let bare = Self { page: page.number(), head, frame, ..Self::default() };
        match page {
            CameraPage::Exposure { started_by, exposure_us } => {
                Self { started_by: started_by as u8, exposure_us, ..bare }
            }
            CameraPage::Levels { gain_cdb, black_level_dn_16 } => Self { gain_cdb, black_level_dn_16, ..bare },
            CameraPage::Trigger { delay_us } => Self { delay_us, ..bare },
        }
    }
}

impl RawCell {
    pub(crate) fn read(&self) -> Option<TableCell> {
        let table = Table::from_number(self.table)?;
        let cell = TableCell { table, row: self.row, column: self.column, value: self.value };
        cell.exists().then_some(cell)
    }

    pub(crate) fn of(cell: &TableCell) -> Self {
        Self { table: cell.table.number(), row: cell.row, column: cell.column, value: cell.value }
    }
}

impl RawCommand {
    pub(crate) fn read(&self) -> Command {
        let request = match self.opcode {
            opcode::HELLO => Request::Hello(Version { major: self.major, minor: self.minor }),
            opcode::INFO => Request::Info { page: self.page },
            opcode::RUN => Request::Run,
            opcode::STOP => Request::Stop,
            opcode::APPLY => Request::Apply { table: self.table, rows: self.rows, crc: self.crc16, seed: self.seed },
            opcode::TRIGGER => Request::Trigger(Trigger { number: self.trigger, at_us: self.at_us }),
            opcode::CAMERA => {
                Request::Camera(CameraSetting { kind: self.camera_kind, head: self.head, value: self.camera_value })
            }
            opcode::CAMERA_TRIGGER => Request::CameraTrigger(CameraTrigger { head: self.head, at_us: self.at_us }),
            opcode => Request::Unknown { opcode },
        };
        Command { token: self.token, request }
    }

    pub(crate) fn of(command: &Command) -> Self {
        let bare = Self { opcode: command.request.opcode(), token: command.token, ..Self::default() };
        match command.request {
            Request::Hello(version) => Self { major: version.major, minor: version.minor, ..bare },
            Request::Info { page } => Self { page, ..bare },
            Request::Apply { table, rows, crc, seed } => Self { table, rows, crc16: crc, seed, ..bare },
            Request::Trigger(Trigger { number, at_us }) => Self { trigger: number, at_us, ..bare },
            Request::Camera(CameraSetting { kind, head, value }) => {
                Self { camera_kind: kind, head, camera_value: value, ..bare }
            }
            Request::CameraTrigger(CameraTrigger { head, at_us }) => Self { head, at_us, ..bare },
            Request::Run | Request::Stop | Request::Unknown { .. } => bare,
        }
    }
}

impl RawResponse {
    pub(crate) fn read(&self) -> Option<Response> {
        let reply = if self.code == 0 { self.done()? } else { self.refused()? };
        Some(Response { token: self.token, reply })
    }

    fn refused(&self) -> Option<Reply> {
        let reason = Refusal::ALL.into_iter().find(|reason| reason.code() == self.code)?;
        Some(Reply::Refused { opcode: self.opcode, reason })
    }

    fn done(&self) -> Option<Reply> {
        match (self.opcode, self.page) {
            (opcode::HELLO, _) => Some(Reply::Hello(Identity {
                version: Version { major: self.major, minor: self.minor },
                capabilities: self.capabilities,
                attitude_convention: self.attitude_convention,
            })),
            (opcode::INFO, 0) => Some(Reply::Info(Info::DbcCrc32(self.dbc_crc32))),
            (opcode::INFO, 1) => {
                Some(Reply::Info(Info::Rates(Rates { attitude_hz: self.attitude_hz, jitter_hz: self.jitter_hz })))
            }
            (opcode::RUN, _) => Some(Reply::Run),
            (opcode::STOP, _) => Some(Reply::Stop),
            (opcode::APPLY, _) => {
                Table::from_number(self.table).map(|table| Reply::Applied(Applied { table, rows: self.rows }))
            }
            (opcode::TRIGGER, _) => Some(Reply::Triggered(Triggered { number: self.trigger, is_late: self.late != 0 })),
            (opcode::CAMERA, _) => Some(Reply::CameraSet(CameraSet { kind: self.camera_kind, head: self.head })),
            (opcode::CAMERA_TRIGGER, _) => {
                Some(Reply::CameraTriggered(CameraTriggered { head: self.head, is_late: self.late != 0 }))
            }
            _ => None,
        }
    }

    pub(crate) fn of(response: &Response) -> Self {
        let bare = |opcode| Self { opcode, token: response.token, ..Self::default() };
        match response.reply {
            Reply::Hello(identity) => Self {
                major: identity.version.major,
                minor: identity.version.minor,
                capabilities: identity.capabilities,
                attitude_convention: identity.attitude_convention,
                ..bare(opcode::HELLO)
            },
            Reply::Info(Info::DbcCrc32(dbc_crc32)) => Self { dbc_crc32, ..bare(opcode::INFO) },
            Reply::Info(Info::Rates(rates)) => {
                Self { page: 1, attitude_hz: rates.attitude_hz, jitter_hz: rates.jitter_hz, ..bare(opcode::INFO) }
            }
            Reply::Run => bare(opcode::RUN),
            Reply::Stop => bare(opcode::STOP),
            Reply::Applied(applied) => {
                Self { table: applied.table.number(), rows: applied.rows, ..bare(opcode::APPLY) }
            }
            Reply::Triggered(Triggered { number, is_late }) => {
                Self { trigger: number, late: is_late.into(), ..bare(opcode::TRIGGER) }
            }
            Reply::CameraSet(CameraSet { kind, head }) => Self { camera_kind: kind, head, ..bare(opcode::CAMERA) },
            Reply::CameraTriggered(CameraTriggered { head, is_late }) => {
                Self { head, late: is_late.into(), ..bare(opcode::CAMERA_TRIGGER) }
            }
            Reply::Refused { opcode, reason } => Self { code: reason.code(), ..bare(opcode) },
        }
    }
}

impl RawHeartbeat {
    pub(crate) fn read(&self) -> Option<Heartbeat> {
        NodeState::from_code(self.state).map(|state| Heartbeat { state, major: self.major })
    }
}
