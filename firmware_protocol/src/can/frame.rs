//! Message -> frames on the bus, and back; the classic attitude group: parts, commit, and the check that all are of one
//! epoch.

use crate::bytes::{Payload, Reader, Writer};
use crate::can::{CanId, IdMap, ToCanId};
use crate::message::{ACCELERATION, AttitudeFlags, AttitudeRecord, RATE};
use crate::{EncodeError, Message, MessageId, Reject};
use crate::{crc::Crc16, sequence::Sequences};

/// Longest classic payload.
pub const CLASSIC_MAX: usize = 8;
/// Longest FD payload.
pub const FD_MAX: usize = 64;

/// Payload lengths that a data length code can say.
const FD_LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// A data frame, classic or FD, with an identifier of 11 or 29 bits. Only legal lengths exist.
#[derive(Debug, Clone, Copy)]
pub struct CanFrame {
    id: CanId,
    fd: bool,
    len: u8,
    data: [u8; FD_MAX],
}

impl CanFrame {
    /// Returns a classic frame; `None` when no identifier has this number or the data exceed 8 bytes.
    pub fn classic(id: impl ToCanId, data: &[u8]) -> Option<Self> {
        (data.len() <= CLASSIC_MAX).then(|| Self::new(id, false, data)).flatten()
    }

    /// Returns an FD frame; `None` when no identifier has this number or no length code says the length of the data.
    pub fn fd(id: impl ToCanId, data: &[u8]) -> Option<Self> {
        FD_LENGTHS.contains(&data.len()).then(|| Self::new(id, true, data)).flatten()
    }

    fn new(id: impl ToCanId, fd: bool, bytes: &[u8]) -> Option<Self> {
        let mut data = [0; FD_MAX];
        data.get_mut(..bytes.len())?.copy_from_slice(bytes);
        let len = u8::try_from(bytes.len()).ok()?;
        Some(Self { id: id.to_can_id()?, fd, len, data })
    }

    /// Returns the same frame with other data; `None` when a frame of its kind has no such length.
    pub fn with_data(&self, data: &[u8]) -> Option<Self> {
        if self.fd { Self::fd(self.id, data) } else { Self::classic(self.id, data) }
    }

    /// Returns the identifier.
    pub const fn id(&self) -> CanId {
        self.id
    }

    /// Returns true for CAN FD.
    pub const fn is_fd(&self) -> bool {
        self.fd
    }

    /// Returns the payload.
    pub fn data(&self) -> &[u8] {
        self.data.get(..usize::from(self.len)).unwrap_or(&[])
    }
}

impl PartialEq for CanFrame {
    fn eq(&self, other: &Self) -> bool {
        (self.id, self.fd, self.data()) == (other.id, other.fd, other.data())
    }
}
impl Eq for CanFrame {}

/// Frames one message needs at most: the classic attitude group.
pub const FRAMES_MAX: usize = 5;

/// Which frames the bus has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// At most 8 bytes; attitude as a group.
    Classic,
    /// At most 64 bytes; every message in one frame. Messages of up to 8 bytes go as classic frames.
    Fd,
}

/// The frames of one message, in the order to send them.
#[derive(Debug, Clone, Copy, Default)]
pub struct Frames {
    frames: [Option<CanFrame>; FRAMES_MAX],
}

impl Frames {
    /// Returns the frames in the order to send them.
    pub fn iter(&self) -> impl Iterator<Item = &CanFrame> {
        self.frames.iter().flatten()
    }
}

/// Returns the frames of a message.
///
/// # Errors
/// When a scaled field cannot hold its value, or the format has no form for the message.
pub fn encode(message: &Message, format: Format, ids: &IdMap) -> Result<Frames, EncodeError> {
    match (message, format) {
        (Message::Attitude(record), Format::Classic) => encode_group(record, ids),
        (Message::Jitter(_), Format::Classic) => Err(EncodeError::NotCarried {
            message: "JITTER_FD (a burst of up to 14 samples)",
            format: "classic CAN",
            instead: "JITTER, two samples each",
        }),
        _ => encode_single(message, ids),
    }
}

fn encode_single(message: &Message, ids: &IdMap) -> Result<Frames, EncodeError> {
    let (payload, id) = (message.payload()?, ids.id(message.id()));
    let data = payload.as_slice();
    let frame = CanFrame::classic(id, data).or_else(|| CanFrame::fd(id, data));
    Ok(Frames { frames: [frame, None, None, None, None] })
}

fn encode_group(record: &AttitudeRecord, ids: &IdMap) -> Result<Frames, EncodeError> {
    let group = Group::of(record)?;
    let part = |part, id| group.part(part).and_then(|data| CanFrame::classic(ids.id(id), &data));
    let commit = group.commit(record);
    Ok(Frames {
        frames: [
            part(Part::Q01, MessageId::AttitudeQ01),
            part(Part::Q23, MessageId::AttitudeQ23),
            part(Part::Rate, MessageId::AttitudeRate),
            part(Part::Acceleration, MessageId::AttitudeAcceleration),
            CanFrame::classic(ids.id(MessageId::AttitudeCommit), commit.as_slice()),
        ],
    })
}

/// Turns the frames of one node into messages; reads classic and FD alike.
///
/// State: the parts of the classic attitude group not yet committed, and the newest sequence numbers.
#[derive(Debug, Clone)]
pub struct Decoder {
    ids: IdMap,
    group: Group,
    sequences: Sequences,
}

impl Decoder {
    /// Returns a decoder that has seen nothing.
    pub fn new(ids: IdMap) -> Self {
        Self { ids, group: Group::default(), sequences: Sequences::default() }
    }

    /// Reads one frame: a message, or nothing yet.
    ///
    /// # Errors
    /// The reason why the frame, or the group it closes or tears, is not a legal message.
    pub fn read(&mut self, frame: &CanFrame) -> Result<Option<Message>, Reject> {
        let (id, data) = (self.ids.message(frame.id())?, frame.data());
        let message = match id {
            MessageId::AttitudeQ01 => return self.keep(Part::Q01, data),
            MessageId::AttitudeQ23 => return self.keep(Part::Q23, data),
            MessageId::AttitudeRate => return self.keep(Part::Rate, data),
            MessageId::AttitudeAcceleration => return self.keep(Part::Acceleration, data),
            MessageId::AttitudeCommit => Message::Attitude(self.group.close(data)?),
            MessageId::Sync
            | MessageId::Exposure
            | MessageId::Status
            | MessageId::CameraStatus
            | MessageId::TimeFollowUp
            | MessageId::Wheels
            | MessageId::JitterPair
            | MessageId::Attitude
            | MessageId::Jitter
            | MessageId::Table
            | MessageId::Response
            | MessageId::Command
            | MessageId::Heartbeat => Message::from_payload(id, data)?,
        };
        self.sequences.admit(message).map(Some)
    }

    fn keep(&mut self, part: Part, data: &[u8]) -> Result<Option<Message>, Reject> {
        self.group.keep(part, data).map(|()| None)
    }
}

/// Parts before the commit, in the order of their identifiers.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part {
    Q01 = 0,
    Q23 = 1,
    Rate = 2,
    Acceleration = 3,
}

/// The parts received since the last commit.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Group {
    parts: [Option<[u8; 8]>; 4],
}

impl Group {
    /// Returns the parts of a record.
    pub(super) fn of(record: &AttitudeRecord) -> Result<Self, EncodeError> {
        let [w, x, y, z] = record.q_wxyz;
        let rate = record.flags.rate.then(|| RATE.pack(record.rate_rad_s)).transpose()?;
        let acceleration = record.flags.acceleration.then(|| ACCELERATION.pack(record.acceleration_rad_s2));
        let acceleration = acceleration.transpose()?;
        Ok(Self {
            parts: [
                Some(pair_bytes(w, x)),
                Some(pair_bytes(y, z)),
                rate.map(u64::to_le_bytes),
                acceleration.map(u64::to_le_bytes),
            ],
        })
    }

    pub(super) fn part(&self, part: Part) -> Option<[u8; 8]> {
        self.parts.get(part as usize).copied().flatten()
    }

    /// Returns the ATT_T that closes this group.
    pub(super) fn commit(&self, record: &AttitudeRecord) -> Payload {
        let mut to = Writer::new();
        to.u32(record.t_us).u8(record.seq).u8(record.flags.bits());
        let crc = self.crc(to.finish().as_slice());
        to.u16(crc).finish()
    }

    /// Keeps a part. A part that is there already belongs to an epoch that was never committed: that one is dropped.
    pub(super) fn keep(&mut self, part: Part, data: &[u8]) -> Result<(), Reject> {
        let bytes = Reader::exact(data, 8)?.take()?;
        let torn = self.part(part).is_some();
        if torn {
            *self = Self::default();
        }
        if let Some(slot) = self.parts.get_mut(part as usize) {
            *slot = Some(bytes);
        }
        if torn { Err(Reject::TornGroup) } else { Ok(()) }
    }

    /// Closes the group: the record, when every part is there and of this epoch. Leaves no part behind.
    pub(super) fn close(&mut self, commit: &[u8]) -> Result<AttitudeRecord, Reject> {
        let group = core::mem::take(self);
        let mut from = Reader::exact(commit, 8)?;
        let (t_us, seq, flags, crc) = (from.u32()?, from.u8()?, AttitudeFlags::from_bits(from.u8()?), from.u16()?);
        let complete = group.part(Part::Rate).is_some() == flags.rate
            && group.part(Part::Acceleration).is_some() == flags.acceleration;
        let (Some(q01), Some(q23), true) = (group.part(Part::Q01), group.part(Part::Q23), complete) else {
            return Err(Reject::TornGroup);
        };
        if group.crc(commit.get(..6).unwrap_or(&[])) != crc {
            return Err(Reject::TornGroup);
        }
        let ([w, x], [y, z]) = (pair_values(q01)?, pair_values(q23)?);
        AttitudeRecord {
            t_us,
            seq,
            flags,
            q_wxyz: [w, x, y, z],
            rate_rad_s: RATE.unpack(group.word(Part::Rate))?,
            acceleration_rad_s2: ACCELERATION.unpack(group.word(Part::Acceleration))?,
        }
        .judged()
    }

    fn word(&self, part: Part) -> u64 {
        self.part(part).map_or(0, u64::from_le_bytes)
    }

    fn crc(&self, head: &[u8]) -> u16 {
        let parts = self.parts.iter().flatten().fold(Crc16::new(), |crc, part| crc.over(part));
        parts.over(head).value()
    }
}

fn pair_bytes(a: f32, b: f32) -> [u8; 8] {
    (u64::from(b.to_bits()) << 32 | u64::from(a.to_bits())).to_le_bytes()
}

fn pair_values(bytes: [u8; 8]) -> Result<[f32; 2], Reject> {
    Reader::exact(&bytes, 8)?.f32s()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_frames_that_exist_can_be_made() {
        assert!(CanFrame::classic(0x7FF, &[0; 8]).is_some());
        assert!(CanFrame::classic(0x800, &[]).is_none(), "12 bits");
        let long = CanId::extended(0x7FF).unwrap();
        assert_ne!(CanFrame::classic(long, &[0; 8]), CanFrame::classic(0x7FF, &[0; 8]), "29 bits and 11");
        assert!(CanFrame::classic(1, &[0; 9]).is_none(), "9 bytes");
        assert!(CanFrame::fd(1, &[0; 48]).is_some());
        assert!(CanFrame::fd(1, &[0; 47]).is_none(), "no such length code");
        assert!(CanFrame::fd(1, &[0; 65]).is_none(), "too long");
    }
}
