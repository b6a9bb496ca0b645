//! Commands of the flight computer, and the one answer each gets.
//!
//! By a numbered trigger the flight computer makes something happen that the stimulator holds ready. Since protocol 1.2.

use crate::bytes::{Reader, Writer};
use crate::message::camera::{CameraSet, CameraSetting, CameraTrigger, CameraTriggered};
use crate::{Reject, message::table::Table, tables::Applied, version::Version};

/// First byte of commands and responses.
pub mod opcode {
    /// Exchange versions.
    pub const HELLO: u8 = 1;
    /// Ask for one page of facts.
    pub const INFO: u8 = 2;
    /// Start rendering.
    pub const RUN: u8 = 3;
    /// Stop rendering.
    pub const STOP: u8 = 4;
    /// Put uploaded rows of a parameter table into effect. Since protocol 1.1.
    pub const APPLY: u8 = 5;
    /// Fire a numbered trigger. Since protocol 1.2.
    pub const TRIGGER: u8 = 6;
    /// Set something of a camera. Since protocol 1.4.
    pub const CAMERA: u8 = 7;
    /// Start an exposure. Since protocol 1.4.
    pub const CAMERA_TRIGGER: u8 = 8;
}

/// In the answers to TRIGGER and CAMERA_TRIGGER: the instant was past on arrival.
const LATE_BIT: u8 = 1;

/// Bits of [`Identity::capabilities`]. A 1.0 stimulator sends none.
pub mod capability {
    /// TABLE and APPLY are taken.
    pub const PARAMETER_TABLES: u16 = 1;
    /// JITTER and JITTER_FD are taken.
    pub const JITTER_SAMPLES: u16 = 1 << 1;
    /// WHEELS is taken.
    pub const WHEELS: u16 = 1 << 2;
    /// TRIGGER is taken. Since protocol 1.2.
    pub const TRIGGERS: u16 = 1 << 3;
    /// CAMERA and CAMERA_TRIGGER are taken. Since protocol 1.4.
    pub const CAMERA: u16 = 1 << 4;
}

/// `0x60n`, 8 bytes.
///
/// | byte | field |
/// |---|---|
/// | 0 | opcode |
/// | 1 | token: a retry repeats it, a new command changes it |
/// | 2..8 | arguments: HELLO major, minor; INFO page; APPLY table, rows, CRC-16, seed u16; TRIGGER number u16, SCET us u32; CAMERA kind, head, value u32; CAMERA_TRIGGER head, reserved, SCET us u32; the rest zero |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Command {
    /// Names this command; its response carries the same.
    pub token: u8,
    /// The request.
    pub request: Request,
}

/// Request of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Exchange versions.
    Hello(Version),
    /// One page of facts: 0 the CRC-32 of the DBC file, 1 the rates that are sure to be taken.
    Info {
        /// Page.
        page: u8,
    },
    /// Start rendering.
    Run,
    /// Stop rendering.
    Stop,
    /// Rows `0..rows` of a parameter table become effective: [`crate::tables::TableStore::apply`].
    Apply {
        /// Number of the table; kept as it came, so that an unknown one can be refused by name.
        table: u8,
        /// Rows; 0 clears the table.
        rows: u8,
        /// CRC-16 over the values: [`crate::tables::crc`].
        crc: u16,
        /// Seed of the noise; for [`Table::Psd`] only.
        seed: u16,
    },
    /// A numbered trigger, at once or at an instant.
    Trigger(Trigger),
    /// A setting of a camera.
    Camera(CameraSetting),
    /// A trigger of a camera: it starts an exposure.
    CameraTrigger(CameraTrigger),
    /// An opcode of a later minor version: kept, so that it can be refused by name.
    Unknown {
        /// The opcode.
        opcode: u8,
    },
}

/// `0x58n`, 8 bytes.
///
/// | byte | field |
/// |---|---|
/// | 0 | opcode of the command |
/// | 1 | token of the command |
/// | 2 | code: 0 done, else the refusal |
/// | 3..8 | HELLO: major, minor, capabilities u16, attitude convention; INFO: page, value u32; APPLY: table, rows; TRIGGER: number u16, bit 0 late; CAMERA: kind, head; CAMERA_TRIGGER: head, bit 0 late; the rest zero |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Response {
    /// Token of the command.
    pub token: u8,
    /// The answer.
    pub reply: Reply,
}

/// The answer to a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reply {
    /// To HELLO.
    Hello(Identity),
    /// To INFO.
    Info(Info),
    /// Rendering.
    Run,
    /// No longer rendering.
    Stop,
    /// The table is in effect.
    Applied(Applied),
    /// The trigger acts, or waits for its instant.
    Triggered(Triggered),
    /// The camera takes the setting.
    CameraSet(CameraSet),
    /// The camera takes the trigger.
    CameraTriggered(CameraTriggered),
    /// Not done.
    Refused {
        /// Opcode of the command.
        opcode: u8,
        /// Why.
        reason: Refusal,
    },
}

/// Identity of the answering side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// Protocol version.
    pub version: Version,
    /// One bit per capability: [`capability`].
    pub capabilities: u16,
    /// [`crate::ATTITUDE_CONVENTION`].
    pub attitude_convention: u8,
}

/// One page of facts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Info {
    /// Page 0: CRC-32 of the DBC file that the answering side was built with.
    DbcCrc32(u32),
    /// Page 1: rates that are sure to be taken.
    Rates(Rates),
}

/// Rates that the stimulator is designed for; it takes faster records too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rates {
    /// Attitude records per second.
    pub attitude_hz: u16,
    /// Jitter samples per second.
    pub jitter_hz: u16,
}

/// Why a command was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Refusal {
    /// No such opcode.
    UnknownOpcode = 1,
    /// Another major version.
    WrongMajor = 2,
    /// RUN, APPLY, TRIGGER, CAMERA or CAMERA_TRIGGER before a successful HELLO.
    NoHandshake = 3,
    /// No such page.
    UnknownPage = 4,
    /// APPLY before every cell of its rows has come.
    TableIncomplete = 5,
    /// The CRC-16 of APPLY does not match the cells received.
    TableCrc = 6,
    /// No such table, too many rows, or a value that its column forbids.
    TableValue = 7,
    /// TRIGGER with an instant before the first time mark.
    NoTimeYet = 8,
    /// The instant of TRIGGER is further ahead or further past than is taken.
    TriggerTime = 9,
    /// The list of triggers that wait for their instants is full.
    TriggersFull = 10,
    /// No fault or event of the run waits for the number of TRIGGER. Since protocol 1.3.
    UnknownTrigger = 11,
    /// CAMERA with a value that is outside the range of the camera. Since protocol 1.4.
    CameraRange = 12,
    /// The camera does not have what CAMERA sets, or cannot be commanded. Since protocol 1.4.
    CameraUnsupported = 13,
    /// A camera head of this number does not exist. Since protocol 1.4.
    UnknownHead = 14,
    /// As many commands wait for an exposure of the camera as it keeps. Since protocol 1.4.
    CameraFull = 15,
}

impl Refusal {
    /// Every refusal, in the order of the codes, which begin with 1.
    pub const ALL: [Self; 15] = [
        Self::UnknownOpcode,
        Self::WrongMajor,
        Self::NoHandshake,
        Self::UnknownPage,
        Self::TableIncomplete,
        Self::TableCrc,
        Self::TableValue,
        Self::NoTimeYet,
        Self::TriggerTime,
        Self::TriggersFull,
        Self::UnknownTrigger,
        Self::CameraRange,
        Self::CameraUnsupported,
        Self::UnknownHead,
        Self::CameraFull,
    ];

    /// Returns the code in RSP.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// Returns the refusal to send to a peer of this minor version: its decoder rejects codes that came later, so that
    /// it would wait for an answer in vain. Code 1 asks it to do without.
    #[must_use]
    pub const fn for_minor(self, minor: u8) -> Self {
        match self {
            Self::UnknownTrigger if minor < 3 => Self::UnknownOpcode,
            Self::CameraRange | Self::CameraUnsupported | Self::UnknownHead | Self::CameraFull if minor < 4 => {
                Self::UnknownOpcode
            }
            Self::UnknownOpcode
            | Self::WrongMajor
            | Self::NoHandshake
            | Self::UnknownPage
            | Self::TableIncomplete
            | Self::TableCrc
            | Self::TableValue
            | Self::NoTimeYet
            | Self::TriggerTime
            | Self::TriggersFull
            | Self::UnknownTrigger
            | Self::CameraRange
            | Self::CameraUnsupported
            | Self::UnknownHead
            | Self::CameraFull => self,
        }
    }
}

impl Request {
    /// Returns the first byte of the command.
    pub const fn opcode(&self) -> u8 {
        match self {
            Self::Hello(_) => opcode::HELLO,
            Self::Info { .. } => opcode::INFO,
            Self::Run => opcode::RUN,
            Self::Stop => opcode::STOP,
            Self::Apply { .. } => opcode::APPLY,
            Self::Trigger(_) => opcode::TRIGGER,
            Self::Camera(_) => opcode::CAMERA,
            Self::CameraTrigger(_) => opcode::CAMERA_TRIGGER,
            Self::Unknown { opcode } => *opcode,
        }
    }
}

impl Command {
    pub(crate) fn write(&self, to: &mut Writer) {
        to.u8(self.request.opcode()).u8(self.token);
        match self.request {
            Request::Hello(version) => to.u8(version.major).u8(version.minor).u32(0),
            Request::Info { page } => to.u8(page).u8(0).u32(0),
            Request::Apply { table, rows, crc, seed } => to.u8(table).u8(rows).u16(crc).u16(seed),
            Request::Trigger(Trigger { number, at_us }) => to.u16(number).u32(at_us),
            Request::Camera(CameraSetting { kind, head, value }) => to.u8(kind).u8(head).u32(value),
            Request::CameraTrigger(CameraTrigger { head, at_us }) => to.u8(head).u8(0).u32(at_us),
            Request::Run | Request::Stop | Request::Unknown { .. } => to.u16(0).u32(0),
        };
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let [opcode, token, a, b] = from.take()?;
        let request = match opcode {
            opcode::HELLO => Request::Hello(Version { major: a, minor: b }),
            opcode::INFO => Request::Info { page: a },
            opcode::RUN => Request::Run,
            opcode::STOP => Request::Stop,
            opcode::APPLY => Request::Apply { table: a, rows: b, crc: from.u16()?, seed: from.u16()? },
            opcode::TRIGGER => Request::Trigger(Trigger { number: u16::from_le_bytes([a, b]), at_us: from.u32()? }),
            opcode::CAMERA => Request::Camera(CameraSetting { kind: a, head: b, value: from.u32()? }),
            opcode::CAMERA_TRIGGER => Request::CameraTrigger(CameraTrigger { head: a, at_us: from.u32()? }),
            _ => Request::Unknown { opcode },
        };
        Ok(Self { token, request })
    }
}

impl Info {
    fn page_and_value(self) -> (u8, u32) {
        match self {
            Self::DbcCrc32(crc) => (0, crc),
            Self::Rates(rates) => (1, u32::from(rates.jitter_hz) << 16 | u32::from(rates.attitude_hz)),
        }
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        match from.u8()? {
            0 => Ok(Self::DbcCrc32(from.u32()?)),
            1 => Ok(Self::Rates(Rates { attitude_hz: from.u16()?, jitter_hz: from.u16()? })),
            _ => Err(Reject::UnknownValue),
        }
    }
}

impl Identity {
    fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let version = Version { major: from.u8()?, minor: from.u8()? };
        Ok(Self { version, capabilities: from.u16()?, attitude_convention: from.u8()? })
    }
}

impl Reply {
    const fn opcode(&self) -> u8 {
        match self {
            Self::Hello(_) => opcode::HELLO,
            Self::Info(_) => opcode::INFO,
            Self::Run => opcode::RUN,
            Self::Stop => opcode::STOP,
            Self::Applied(_) => opcode::APPLY,
            Self::Triggered(_) => opcode::TRIGGER,
            Self::CameraSet(_) => opcode::CAMERA,
            Self::CameraTriggered(_) => opcode::CAMERA_TRIGGER,
            Self::Refused { opcode, .. } => *opcode,
        }
    }

    fn read(opcode: u8, code: u8, from: &mut Reader<'_>) -> Result<Self, Reject> {
        if code != 0 {
            let reason = Refusal::ALL.into_iter().find(|reason| *reason as u8 == code);
            return reason.map(|reason| Self::Refused { opcode, reason }).ok_or(Reject::UnknownValue);
        }
        match opcode {
            opcode::HELLO => Identity::read(from).map(Self::Hello),
            opcode::INFO => Info::read(from).map(Self::Info),
            opcode::RUN => Ok(Self::Run),
            opcode::STOP => Ok(Self::Stop),
            opcode::APPLY => {
                let table = Table::from_number(from.u8()?).ok_or(Reject::UnknownValue)?;
                Ok(Self::Applied(Applied { table, rows: from.u8()? }))
            }
            opcode::TRIGGER => {
                Ok(Self::Triggered(Triggered { number: from.u16()?, is_late: from.u8()? & LATE_BIT != 0 }))
            }
            opcode::CAMERA => Ok(Self::CameraSet(CameraSet { kind: from.u8()?, head: from.u8()? })),
            opcode::CAMERA_TRIGGER => {
                Ok(Self::CameraTriggered(CameraTriggered { head: from.u8()?, is_late: from.u8()? & LATE_BIT != 0 }))
            }
            _ => Err(Reject::UnknownValue),
        }
    }
}

impl Response {
    pub(crate) fn write(&self, to: &mut Writer) {
        to.u8(self.reply.opcode()).u8(self.token);
        match self.reply {
            Reply::Hello(identity) => {
                to.u8(0).u8(identity.version.major).u8(identity.version.minor);
                to.u16(identity.capabilities).u8(identity.attitude_convention)
            }
            Reply::Info(info) => {
                let (page, value) = info.page_and_value();
                to.u8(0).u8(page).u32(value)
            }
            Reply::Run | Reply::Stop => to.u8(0).put(&[0; 5]),
            Reply::Applied(Applied { table, rows }) => to.u8(0).u8(table.number()).u8(rows).put(&[0; 3]),
            Reply::Triggered(Triggered { number, is_late }) => {
                to.u8(0).u16(number).u8(if is_late { LATE_BIT } else { 0 }).put(&[0; 2])
            }
            Reply::CameraSet(CameraSet { kind, head }) => to.u8(0).u8(kind).u8(head).put(&[0; 3]),
            Reply::CameraTriggered(CameraTriggered { head, is_late }) => {
                to.u8(0).u8(head).u8(if is_late { LATE_BIT } else { 0 }).put(&[0; 3])
            }
            Reply::Refused { reason, .. } => to.u8(reason as u8).put(&[0; 5]),
        };
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let [opcode, token, code] = from.take()?;
        Ok(Self { token, reply: Reply::read(opcode, code, from)? })
    }
}

/// Argument of the command TRIGGER. Its token is its sequence number: a repeat is not done twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trigger {
    /// Which one; what it does is agreed outside the protocol.
    pub number: u16,
    /// When it acts: SCET in microseconds, modulo 2^32; 0 for at once. For an instant whose microseconds are 0, say 1.
    pub at_us: u32,
}

/// Answer to an accepted trigger.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Triggered {
    /// Which one.
    pub number: u16,
    /// Its instant was past when it came: it acts at once.
    pub is_late: bool,
}

impl Trigger {
    /// Returns whether it acts as soon as it has come.
    pub const fn is_at_once(&self) -> bool {
        self.at_us == 0
    }
}
