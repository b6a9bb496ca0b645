//! What a camera is told before it comes up: its place on the network, its names, and the sensor behind it.

use crate::network_camera::error::NetworkCameraError;
use crate::network_camera::pixel_format::PixelFormat;
use std::net::Ipv4Addr;

/// Port on which clients look for cameras.
pub(super) const GVCP_PORT: u16 = 3956;
/// Least packet that the test packet of a client begins with, bytes with IP and UDP headers.
pub(super) const PACKET_BYTES_MIN: u32 = 576;
/// Most bytes of one packet: what the packet size register holds, and a multiple of 4.
pub(super) const PACKET_BYTES_MAX: u32 = 65_532;

/// How the XML lies in the device's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum XmlForm {
    /// Deflated, in a zip archive of one file; the second URL gives it plain.
    #[default]
    Zip,
    /// As text; the second URL gives it zipped.
    Plain,
}

/// Names that the device tells. Longer ones than the registers hold are refused.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Vendor, at most 31 bytes.
    pub vendor: String,
    /// Model, at most 31 bytes.
    pub model: String,
    /// Version, at most 31 bytes.
    pub version: String,
    /// Anything about the vendor, at most 47 bytes.
    pub info: String,
    /// Serial number, at most 15 bytes.
    pub serial: String,
    /// Name given by the user, at most 15 bytes; clients may change it until the run ends.
    pub user_name: String,
}

impl Default for Identity {
    fn default() -> Self {
        Self {
            vendor: "starloop".into(),
            model: "star_sensor_stimulator".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            info: "simulated star sensor".into(),
            serial: "1".into(),
            user_name: String::new(),
        }
    }
}

/// A camera on the network.
#[derive(Debug, Clone, PartialEq)]
pub struct Params {
    /// Address of an interface of this machine (on loopback: any of 127.0.0.0/8).
    pub address: Ipv4Addr,
    /// Control port; 0 takes a free one. Many clients know 3956 only.
    pub port: u16,
    /// Pixel format at the start; `None`: the narrowest that holds what the detector reads out.
    pub pixel_format: Option<PixelFormat>,
    /// Packet size at the start, bytes with IP and UDP headers; the interface's MTU when that is less.
    pub packet_bytes: u32,
    /// Packets leave no faster, bit/s (IP and UDP headers not counted).
    pub rate_bit_s: f64,
    /// Frames kept for resend, the one being sent included.
    pub frames_kept: u32,
    /// Frames that may wait to be sent.
    pub frames_queued: u32,
    /// Names.
    pub identity: Identity,
    /// Hardware address to tell; `None`: the interface's, on loopback one made of the address.
    pub mac: Option<[u8; 6]>,
    /// Form of the XML that the first URL names.
    pub xml: XmlForm,
    /// A fault: one packet in so many is lost on purpose (never sent), resent ones too; `None` for none.
    pub lose_one_in: Option<u32>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            address: Ipv4Addr::LOCALHOST,
            port: GVCP_PORT,
            pixel_format: None,
            packet_bytes: 1500,
            rate_bit_s: 1e9,
            frames_kept: 4,
            frames_queued: 4,
            identity: Identity::default(),
            mac: None,
            xml: XmlForm::Zip,
            lose_one_in: None,
        }
    }
}

/// The sensor whose frames the camera sends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorParams {
    /// Columns and rows of the images.
    pub size_px: [u32; 2],
    /// Bits of the detector's converter: pixels lie below `2^bits`, 1 to 16.
    pub bits: u32,
    /// Frames per second of the run, told to clients.
    pub frame_rate_hz: f64,
    /// Integration time, told to clients, s.
    pub exposure_s: f64,
    /// Detector gain, told to clients, e-/DN.
    pub gain_e_per_dn: f64,
}

impl Params {
    /// Refuses what no camera can be.
    pub(super) fn check(&self, sensor: &SensorParams) -> Result<(), NetworkCameraError> {
        let refuse =
            |what, wanted: &str, got: String| Err(NetworkCameraError::Invalid { what, wanted: wanted.into(), got });
        if sensor.size_px.iter().any(|side| !(1..=16_384).contains(side)) {
            return refuse("size_px", "sides of 1 to 16384 px", format!("{:?}", sensor.size_px));
        }
        if !(1..=16).contains(&sensor.bits) {
            return refuse("bits", "1 to 16", sensor.bits.to_string());
        }
        if !(PACKET_BYTES_MIN..=PACKET_BYTES_MAX).contains(&self.packet_bytes) {
            return refuse("packet_bytes", "576 to 65532", self.packet_bytes.to_string());
        }
        if !(1e6..=1e11).contains(&self.rate_bit_s) {
            return refuse("rate_bit_s", "1e6 to 1e11", self.rate_bit_s.to_string());
        }
        if !(1..=64).contains(&self.frames_kept) || !(1..=16).contains(&self.frames_queued) {
            let got = format!("{} and {}", self.frames_kept, self.frames_queued);
            return refuse("frames_kept, frames_queued", "1 to 64 and 1 to 16", got);
        }
        if self.lose_one_in == Some(0) {
            return refuse("lose_one_in", "1 or more, or none", "0".into());
        }
        self.identity.check()
    }
}

impl Identity {
    fn check(&self) -> Result<(), NetworkCameraError> {
        for (what, text, most) in [
            ("vendor", &self.vendor, 31),
            ("model", &self.model, 31),
            ("version", &self.version, 31),
            ("info", &self.info, 47),
            ("serial", &self.serial, 15),
            ("user_name", &self.user_name, 15),
        ] {
            let is_plain =
                text.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic() && !b"<>&\"'".contains(&byte));
            if text.len() > most || !is_plain {
                let wanted = format!("at most {most} plain characters (ASCII without < > & and quotes)");
                return Err(NetworkCameraError::Invalid { what, wanted, got: format!("{text:?}") });
            }
        }
        Ok(())
    }
}
