//! Settings of a camera that change from exposure to exposure, and the commands that change them.
//!
//! ```text
//! network camera, bus, control socket, built-in tracker
//!        | CameraCommand, stamped            ^ CameraEvent
//!        v                                   |
//!      Desk (bounded queues) <---------> the frame loop: settings of the next exposure, its start and length
//! ```
//!
//! A setting acts from the first exposure that starts at or after the instant of its command. Each frame carries the
//! settings that it was exposed with. Times are those of the bench clock. Nothing here allocates after it was made.

mod desk;
mod settings;

pub use base::region::{REGIONS_MAX, Region, Regions};
pub use desk::{CameraDesk, CameraEvent, CameraEventKind, DeskEnd, desk};
pub use settings::{
    AutoMode, CameraCommand, CameraRange, CameraSettings, CommandSource, Commanded, EXPOSURE_LEAST, ExposureMode,
    GAIN_MAX_DB, SettingRefusal, StartSettings, TriggerOverlap, TriggerSource, TriggerSources, longest_exposure_s,
};
