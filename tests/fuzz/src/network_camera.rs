//! `starloop::network_camera`: its control side, without sockets.

#![allow(dead_code, reason = "the stream side is not here")]

#[path = "../../../src/network_camera/acquisition.rs"]
mod acquisition;
#[path = "../../../src/network_camera/chunk.rs"]
mod chunk;
#[path = "../../../src/network_camera/control.rs"]
mod control;
#[path = "../../../src/network_camera/counters.rs"]
mod counters;
#[path = "../../../src/network_camera/device.rs"]
mod device;
#[path = "../../../src/network_camera/error.rs"]
mod error;
#[path = "../../../src/network_camera/first_values.rs"]
mod first_values;
#[path = "../../../src/network_camera/gvcp.rs"]
mod gvcp;
#[path = "../../../src/network_camera/gvsp.rs"]
mod gvsp;
#[path = "../../../src/network_camera/params.rs"]
mod params;
#[path = "../../../src/network_camera/pixel_format.rs"]
mod pixel_format;
#[path = "../../../src/network_camera/proof.rs"]
mod proof;
#[path = "../../../src/network_camera/registers.rs"]
mod registers;
#[path = "../../../src/network_camera/repeats.rs"]
mod repeats;
#[path = "../../../src/network_camera/shared.rs"]
mod shared;
#[path = "../../../src/network_camera/xml.rs"]
mod xml;
#[path = "../../../src/network_camera/zip.rs"]
mod zip;

pub use device::{Answer, Device, DeviceParams};
pub use error::NetworkCameraError;
pub use gvcp::{Malformed, Resend, Status};
pub use gvsp::StreamSettings;
pub use params::{Params, SensorParams};
