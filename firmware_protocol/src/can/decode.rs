//! Frames -> messages.

use super::group::{Group, Part};
use super::{CanFrame, IdMap};
use crate::sequence::Sequences;
use crate::{Message, MessageId, Reject};

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
