//! Messages received from the stimulator, counted, and the last of each kind.

use firmware_protocol::Message;
use firmware_protocol::message::{CameraStatus, Exposure, StatusPage};
use link::Stamped;

/// Counts of what came in, and the newest of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Received {
    /// EXPOSURE messages.
    pub exposures: u64,
    /// The newest EXPOSURE.
    pub last_exposure: Option<Stamped<Exposure>>,
    /// STATUS pages.
    pub status_pages: u64,
    /// The newest STATUS page.
    pub last_status: Option<Stamped<StatusPage>>,
    /// CAMERA_STATUS pages.
    pub camera_pages: u64,
    /// The newest CAMERA_STATUS page.
    pub last_camera: Option<Stamped<CameraStatus>>,
    /// Other messages.
    pub others: u64,
}

impl Received {
    pub(super) fn count(&mut self, message: Stamped<Message>) {
        let at = message.at;
        match message.value {
            Message::Exposure(value) => {
                self.exposures += 1;
                self.last_exposure = Some(Stamped { at, value });
            }
            Message::Status(value) => {
                self.status_pages += 1;
                self.last_status = Some(Stamped { at, value });
            }
            Message::Camera(value) => {
                self.camera_pages += 1;
                self.last_camera = Some(Stamped { at, value });
            }
            Message::Sync(_)
            | Message::TimeFollowUp(_)
            | Message::Attitude(_)
            | Message::Jitter(_)
            | Message::JitterPair(_)
            | Message::Wheels(_)
            | Message::Table(_)
            | Message::Command(_)
            | Message::Response(_)
            | Message::Heartbeat(_) => self.others += 1,
        }
    }
}
