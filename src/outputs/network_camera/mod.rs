//! Frames -> a camera on the network: a device that speaks GVCP (control) and GVSP (stream) over UDP/IPv4.
//!
//! Input: frames through [`frames::sink::Sink`]. Output: a camera as a GenICam client sees it: discovery, bootstrap
//! registers, an XML that names the features, image packets on a stated rate, each frame's truth as chunk data.
//!
//! ```text
//! client --GVCP--> "camera control" thread: Device (registers, control privilege, acquisition), no frame in sight
//!                         | settings (small, copied), resend requests (bounded)
//! sink thread: send() --> | free slot? copy : count a drop
//!                         v
//!                  "camera stream" thread: pixel format, packets, pacing, kept frames for resend --GVSP--> client
//! ```
//!
//! `send` never waits for either thread: a client that does nothing, stalls, or floods the control port costs frames,
//! which are counted, and no time. Memory is fixed at the start: incoming slots, kept frames, two bounded queues.
//!
//! With [`CommandParams`] clients command the camera that makes the frames: writes become commands to the frame loop,
//! and triggers and actions, also scheduled ones, start exposures. Without, settings are read-only and triggers choose
//! frames.
//!
//! A message channel sends events of the exposures (`messages`); user sets keep settings in memory (`user_sets`); test
//! patterns take the place of images (`test_pattern`); the state of the machine's PTP clock is that of `ptp4l` (`ptp`).
//!
//! Limits: IPv4, one stream channel. Nothing here is certified; the registers and packets are those that Aravis and its
//! relatives use. Packets carry at most the interface's MTU. A multicast group may receive the stream where the bench
//! allows other receivers. Discovery is answered to the device's own subnet only: a program that receives the answer
//! can also get its frames. Frames go to the controller's own address, unless the bench allows others. At the end of a
//! run waiting packets are sent for one more second.
//!
//! Tests: `device_tests` (the protocol with virtual time, no sockets), `pixel_format`, `gvsp`, `xml` beside their
//! code, `tests` (loopback, stalled clients), `tests/network_camera` (any bytes), and in `hil_scripts`
//! `test_network_camera.py` (Aravis, GStreamer, the reference GenApi; bit-exact), `test_camera_genicam.py` (commanded),
//! `test_camera_events.py` (events, actions), `test_camera_ptp.py`.
//!
//! Tour: `params` -> `pixel_format`, `test_pattern`, `chunk` (forms of a frame) -> `gvcp`, `gvsp`, `messages`
//! (bytes) -> `features` (the table), `registers`, `user_sets`, `xml` (memory) -> `acquisition`, `control`, `ptp`,
//! `device` (the state machine) -> `shared` (between threads) -> `interface`, `packets`, `stream`, `listener` (sockets
//! and threads) -> `camera` (the sink).

mod acquisition;
mod camera;
mod chunk;
mod control;
mod counters;
mod device;
#[cfg(test)]
mod device_tests;
mod feature;
mod features;
mod gvcp;
mod gvsp;
mod interface;
mod listener;
mod messages;
mod packets;
mod params;
mod pixel_format;
mod proof;
mod ptp;
mod regions;
mod registers;
mod shared;
mod stream;
mod test_pattern;
mod user_sets;
#[cfg(test)]
mod tests;
mod xml;

pub use acquisition::Wanted;
pub use camera::NetworkCamera;
pub use counters::Counters;
pub use device::{Answer, Device};
pub use gvcp::{Malformed, Status};
pub use gvsp::StreamSettings;
pub use params::{CommandParams, DeviceParams, Identity, Params, SensorParams, XmlForm};
pub use pixel_format::PixelFormat;
pub use test_pattern::TestPattern;
