//! Messages, on any carrier. One file per family; each gives its layout byte by byte.

mod attitude;
mod camera;
mod command;
mod jitter;
mod status;
mod table;
mod time;

pub use attitude::{AttitudeFlags, AttitudeRecord, NORM_TOLERANCE};
pub use camera::{
    ALL_HEADS, CameraKind, CameraPage, CameraSet, CameraSetting, CameraStatus, CameraTrigger, CameraTriggered,
    Exposure, StartedBy,
};
pub use command::{
    Command, Identity, Info, Rates, Refusal, Reply, Request, Response, Trigger, Triggered, capability, opcode,
};
pub use jitter::{JITTER_BURST_MAX, JitterBurst, JitterPair, PAIR_PERIOD_US, Wheels};
pub use status::{PointingAngle, StatusPage, StimulatorMode, frame_flag};
pub use table::{Table, TableCell};
pub use time::{Heartbeat, NodeState, Scet, Sync, TimeFollowUp};

pub(crate) use attitude::{ACCELERATION, RATE};

use crate::bytes::{Payload, Reader, Writer};
use crate::{EncodeError, Reject};

/// Number of a message: the CAN identifier without node, and the serial type. Lower numbers win arbitration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum MessageId {
    /// [`Sync`].
    Sync = 0x08,
    /// [`Exposure`].
    Exposure = 0x18,
    /// [`StatusPage`].
    Status = 0x19,
    /// [`CameraStatus`].
    CameraStatus = 0x1A,
    /// [`TimeFollowUp`].
    TimeFollowUp = 0x20,
    /// Classic attitude group: w and x.
    AttitudeQ01 = 0x21,
    /// Classic attitude group: y and z.
    AttitudeQ23 = 0x22,
    /// Classic attitude group: rate.
    AttitudeRate = 0x23,
    /// Classic attitude group: angular acceleration.
    AttitudeAcceleration = 0x24,
    /// Classic attitude group: time tag and commit.
    AttitudeCommit = 0x25,
    /// [`Wheels`].
    Wheels = 0x28,
    /// [`JitterPair`].
    JitterPair = 0x2A,
    /// [`AttitudeRecord`] in one piece.
    Attitude = 0x30,
    /// [`JitterBurst`].
    Jitter = 0x31,
    /// [`TableCell`].
    Table = 0x48,
    /// [`Response`].
    Response = 0x58,
    /// [`Command`].
    Command = 0x60,
    /// [`Heartbeat`].
    Heartbeat = 0x70,
}

impl MessageId {
    /// Every message number, ascending.
    pub const ALL: [Self; 18] = [
        Self::Sync,
        Self::Exposure,
        Self::Status,
        Self::CameraStatus,
        Self::TimeFollowUp,
        Self::AttitudeQ01,
        Self::AttitudeQ23,
        Self::AttitudeRate,
        Self::AttitudeAcceleration,
        Self::AttitudeCommit,
        Self::Wheels,
        Self::JitterPair,
        Self::Attitude,
        Self::Jitter,
        Self::Table,
        Self::Response,
        Self::Command,
        Self::Heartbeat,
    ];

    /// Returns the message of a number.
    ///
    /// # Errors
    /// [`Reject::UnknownId`] when this version has none.
    pub fn from_number(number: u8) -> Result<Self, Reject> {
        Self::ALL.into_iter().find(|id| id.number() == number).ok_or(Reject::UnknownId)
    }

    /// Returns the number on the wire.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Returns bytes of its frame on CAN; of its payload on a serial line, where the message travels in one piece.
    pub const fn len_bytes(self) -> usize {
        match self {
            Self::Sync => 1,
            Self::Heartbeat => 2,
            Self::Attitude => 48,
            Self::Jitter => 64,
            Self::Exposure
            | Self::Status
            | Self::CameraStatus
            | Self::TimeFollowUp
            | Self::AttitudeQ01
            | Self::AttitudeQ23
            | Self::AttitudeRate
            | Self::AttitudeAcceleration
            | Self::AttitudeCommit
            | Self::Wheels
            | Self::JitterPair
            | Self::Table
            | Self::Response
            | Self::Command => 8,
        }
    }

    /// Returns false for the parts of the classic attitude group, which only classic CAN has.
    pub const fn is_whole(self) -> bool {
        !matches!(
            self,
            Self::AttitudeQ01
                | Self::AttitudeQ23
                | Self::AttitudeRate
                | Self::AttitudeAcceleration
                | Self::AttitudeCommit
        )
    }
}

/// One message. Values that come from a decoder are legal: finite, of unit norm, of known enumerations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Message {
    /// Time mark: the first of the two steps of time correlation.
    Sync(Sync),
    /// When the last [`Sync`] left.
    TimeFollowUp(TimeFollowUp),
    /// Attitude, rate, acceleration.
    Attitude(AttitudeRecord),
    /// Jitter samples with their own time tag.
    Jitter(JitterBurst),
    /// Two jitter samples in a classic frame.
    JitterPair(JitterPair),
    /// Reaction wheel speeds.
    Wheels(Wheels),
    /// One cell of a parameter table.
    Table(TableCell),
    /// One exposure as the stimulator rendered it.
    Exposure(Exposure),
    /// One page of the stimulator's state.
    Status(StatusPage),
    /// One page of what an exposure of a camera was taken with.
    Camera(CameraStatus),
    /// Flight computer to stimulator.
    Command(Command),
    /// Stimulator to flight computer.
    Response(Response),
    /// Sign of life.
    Heartbeat(Heartbeat),
}

impl Message {
    /// Returns the number under which the message travels in one piece (CAN FD and serial).
    pub const fn id(&self) -> MessageId {
        match self {
            Self::Sync(_) => MessageId::Sync,
            Self::TimeFollowUp(_) => MessageId::TimeFollowUp,
            Self::Attitude(_) => MessageId::Attitude,
            Self::Jitter(_) => MessageId::Jitter,
            Self::JitterPair(_) => MessageId::JitterPair,
            Self::Wheels(_) => MessageId::Wheels,
            Self::Table(_) => MessageId::Table,
            Self::Exposure(_) => MessageId::Exposure,
            Self::Status(_) => MessageId::Status,
            Self::Camera(_) => MessageId::CameraStatus,
            Self::Command(_) => MessageId::Command,
            Self::Response(_) => MessageId::Response,
            Self::Heartbeat(_) => MessageId::Heartbeat,
        }
    }

    /// Returns the payload in one piece. Values are not judged here, so that a test can send bad ones; only what the
    /// layout cannot hold is refused.
    ///
    /// # Errors
    /// [`EncodeError::OutOfRange`] when a scaled field cannot hold its value.
    pub fn payload(&self) -> Result<Payload, EncodeError> {
        let mut to = Writer::new();
        match self {
            Self::Sync(sync) => sync.write(&mut to),
            Self::TimeFollowUp(follow_up) => follow_up.write(&mut to),
            Self::Attitude(record) => record.write(&mut to),
            Self::Jitter(burst) => burst.write(&mut to)?,
            Self::JitterPair(pair) => pair.write(&mut to)?,
            Self::Wheels(wheels) => wheels.write(&mut to)?,
            Self::Table(cell) => cell.write(&mut to),
            Self::Exposure(exposure) => exposure.write(&mut to),
            Self::Status(page) => page.write(&mut to),
            Self::Camera(status) => status.write(&mut to)?,
            Self::Command(command) => command.write(&mut to),
            Self::Response(response) => response.write(&mut to),
            Self::Heartbeat(heartbeat) => heartbeat.write(&mut to),
        }
        Ok(to.finish())
    }

    /// Reads a payload that came in one piece.
    ///
    /// # Errors
    /// The reason why it is not a legal message.
    pub fn from_payload(id: MessageId, bytes: &[u8]) -> Result<Self, Reject> {
        if !id.is_whole() {
            return Err(Reject::UnknownId);
        }
        let from = &mut Reader::exact(bytes, id.len_bytes())?;
        match id {
            MessageId::Sync => Sync::read(from).map(Self::Sync),
            MessageId::TimeFollowUp => TimeFollowUp::read(from).map(Self::TimeFollowUp),
            MessageId::Attitude => AttitudeRecord::read(from, bytes).map(Self::Attitude),
            MessageId::Jitter => JitterBurst::read(from).map(Self::Jitter),
            MessageId::JitterPair => JitterPair::read(from).map(Self::JitterPair),
            MessageId::Wheels => Wheels::read(from).map(Self::Wheels),
            MessageId::Table => TableCell::read(from).map(Self::Table),
            MessageId::Exposure => Exposure::read(from).map(Self::Exposure),
            MessageId::Status => StatusPage::read(from).map(Self::Status),
            MessageId::CameraStatus => CameraStatus::read(from).map(Self::Camera),
            MessageId::Command => Command::read(from).map(Self::Command),
            MessageId::Response => Response::read(from).map(Self::Response),
            MessageId::Heartbeat => Heartbeat::read(from).map(Self::Heartbeat),
            MessageId::AttitudeQ01
            | MessageId::AttitudeQ23
            | MessageId::AttitudeRate
            | MessageId::AttitudeAcceleration
            | MessageId::AttitudeCommit => Err(Reject::UnknownId),
        }
    }
}
