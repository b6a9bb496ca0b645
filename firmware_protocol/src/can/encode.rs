//! Message -> frames.

use super::group::{Group, Part};
use super::{CanFrame, IdMap};
use crate::message::AttitudeRecord;
use crate::{EncodeError, Message, MessageId};

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
