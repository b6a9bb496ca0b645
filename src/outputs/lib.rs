//! Frames to devices and people; each is a `Sink` of `frames`.
//!
//! * [`display`]: linear-luminance frames -> greys on a monitor in front of a tracker;
//! * [`network_camera`]: a camera on the network: GVCP and GVSP;
//! * [`live`]: the newest frame and the run's numbers: one page for people, metrics for machines (HTTP).

pub mod display;
pub mod live;
pub mod network_camera;
