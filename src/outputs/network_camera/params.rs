//! The parameters of a camera before it starts: its place on the network, its names, and the sensor behind it.

use crate::network_camera::pixel_format::PixelFormat;
use base::{bayer::BayerPattern, clock::Clock, refused::Refused};
use frames::camera_control::{CameraDesk, CameraRange, CameraSettings, StartSettings};
use std::{net::Ipv4Addr, path::PathBuf, sync::Arc};

/// Port on which clients look for cameras.
pub(super) const GVCP_PORT: u16 = 3956;
/// Least packet that the test packet of a client begins with, bytes with IP and UDP headers.
pub(super) const PACKET_BYTES_MIN: u32 = 576;
/// Most bytes of one packet: the largest multiple of 4 in the packet size register.
pub(super) const PACKET_BYTES_MAX: u32 = 65_532;

/// Most bytes of a serial number.
const SERIAL_BYTES: usize = 15;

/// How the XML lies in the device's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum XmlForm {
    /// Deflated, in a zip archive of one file; the second URL gives it plain.
    #[default]
    Zip,
    /// As text; the second URL gives it zipped.
    Plain,
}

/// Names that the device reports. Longer ones than the registers hold are refused.
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
    /// Pixel format at the start; `None`: the narrowest that holds the detector's numbers.
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
    /// Hardware address to report; `None`: the interface's for its first address, one made of the address for others.
    pub mac: Option<[u8; 6]>,
    /// Form of the XML that the first URL names.
    pub xml: XmlForm,
    /// Frames may go to another neighbour than the controller; otherwise only to the controller's address.
    pub allow_other_receivers: bool,
    /// The socket on which `ptp4l` of this machine answers questions.
    pub ptp_socket: PathBuf,
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
            allow_other_receivers: false,
            ptp_socket: "/var/run/ptp4l".into(),
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
    /// Frames per second of the run, reported to clients.
    pub frame_rate_hz: f64,
    /// Integration time, reported to clients, s.
    pub exposure_s: f64,
    /// Detector gain, reported to clients, e-/DN.
    pub gain_e_per_dn: f64,
    /// Colours of the image's pixels, where they have filters.
    pub colours: Option<BayerPattern>,
    /// Temperature of the detector until a frame says another, degrees Celsius.
    pub temperature_c: f64,
}

/// The data of the device beside [`Params`]: found on the machine when it starts.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceParams {
    /// The camera's own address.
    pub address: Ipv4Addr,
    /// Mask of its subnet.
    pub mask: Ipv4Addr,
    /// Hardware address.
    pub mac: [u8; 6],
    /// Most bytes of one packet, IP and UDP headers included.
    pub packet_bytes_max: u32,
    /// Port that packets come from.
    pub stream_source_port: u16,
    /// Port that messages come from.
    pub message_source_port: u16,
}

/// The connections with which a client commands the camera that makes the frames.
#[derive(Clone)]
pub struct CommandParams {
    /// Where commands are put and events come from.
    pub desk: CameraDesk,
    /// Limits of the settings.
    pub range: CameraRange,
    /// Settings of the first exposure.
    pub settings: CameraSettings,
    /// First settings of the start of exposures.
    pub start: StartSettings,
    /// A line of this machine gives edges: exposures may last as long as it is active.
    pub has_line: bool,
    /// The clock of the bench: commands are dated by it, time stamps are its time.
    pub clock: Arc<dyn Clock>,
}

impl Params {
    /// Returns one of several cameras of a bench: its number is added to the address and to a given hardware address,
    /// and follows the serial number, so that clients can distinguish them.
    ///
    /// # Errors
    /// When the address or the serial number cannot take the number.
    pub fn of_head(&self, head: usize) -> Result<Self, Refused> {
        let refuse =
            |what, wanted: &str, got: String| Refused(format!("network camera: {what} is {got}; wanted {wanted}"));
        let more = u8::try_from(head).ok();
        let [a, b, c, last] = self.address.octets();
        let last = more.and_then(|more| last.checked_add(more)).filter(|last| *last < 255);
        let got = || format!("{} for head {head}", self.address);
        let last =
            last.ok_or_else(|| refuse("address", "a last number that stays at most .254 for each head", got()))?;
        let serial = format!("{}-{head}", self.identity.serial);
        if serial.len() > SERIAL_BYTES {
            return Err(refuse("serial", "at most 15 characters with the head's number behind it", serial));
        }
        let mac = self.mac.map(|[a, b, c, d, e, f]| {
            let [_, d, e, f] = (u32::from_be_bytes([0, d, e, f]) + u32::from(more.unwrap_or_default())).to_be_bytes();
            [a, b, c, d, e, f]
        });
        let identity = Identity { serial, ..self.identity.clone() };
        Ok(Self { address: Ipv4Addr::new(a, b, c, last), mac, identity, ..self.clone() })
    }

    /// Refuses parameters that no camera can have.
    pub(super) fn check(&self, sensor: &SensorParams) -> Result<(), Refused> {
        let refuse =
            |what, wanted: &str, got: String| Err(Refused(format!("network camera: {what} is {got}; wanted {wanted}")));
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
    fn check(&self) -> Result<(), Refused> {
        for (what, text, most) in [
            ("vendor", &self.vendor, 31),
            ("model", &self.model, 31),
            ("version", &self.version, 31),
            ("info", &self.info, 47),
            ("serial", &self.serial, SERIAL_BYTES),
            ("user_name", &self.user_name, 15),
        ] {
            let is_plain =
                text.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic() && !b"<>&\"'".contains(&byte));
            if text.len() > most || !is_plain {
                let wanted = format!("at most {most} plain characters (ASCII without < > & and quotes)");
                return Err(Refused(format!("network camera: {what} is {text:?}; wanted {wanted}")));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_differ_in_address_serial_number_and_hardware_address() {
        let identity = Identity { serial: "thirteen char".into(), ..Identity::default() };
        let first = Params { mac: Some([2, 0, 0, 0, 0, 0xFF]), identity, ..Params::default() };
        let reported = |head| {
            let params = first.of_head(head).unwrap();
            params.identity.check().unwrap();
            (params.address.octets()[3], params.identity.serial, params.mac.unwrap())
        };
        assert_eq!(reported(0), (1, "thirteen char-0".into(), [2, 0, 0, 0, 0, 0xFF]));
        assert_eq!(reported(9), (10, "thirteen char-9".into(), [2, 0, 0, 0, 1, 8]));
        let error = |head| first.of_head(head).unwrap_err().to_string();
        assert!(error(10).contains("thirteen char-10"), "{}", error(10));
        let short = Params::default();
        assert_eq!(short.of_head(253).unwrap().address, Ipv4Addr::new(127, 0, 0, 254));
        assert!(short.of_head(254).unwrap_err().to_string().contains("127.0.0.1 for head 254"));
        assert!(short.of_head(1000).is_err());
    }
}
