//! Keys of a camera on the network: `kind = "network_camera"` in a table of a sink.

use crate::key::{Given, section, taken};
use crate::key_type::{Any, Whole, Word};
use crate::{check::Checker, error::Result};
use outputs::network_camera::{Identity, Params, PixelFormat, XmlForm};
use std::net::Ipv4Addr;

section! {
    /// A camera on the network, as clients of GigE Vision see it.
    NetworkCameraKeys at "sink" {
        /// A camera has one address: 127.0.0.1 for programs on this machine, or that of a network interface.
        address: String = "127.0.0.1", "IPv4 address";
        /// Port of its control channel: clients look at 3956; 0 takes a free port.
        port: Whole<u16> = 3956, 0..=65_535;
        /// Auto takes the narrowest that holds the detector's bits; clients may choose another.
        pixel_format: Word<Option<PixelFormat>> = "auto", [
            ("auto", None), ("Mono8", Some(PixelFormat::Mono8)), ("Mono10", Some(PixelFormat::Mono10)),
            ("Mono10Packed", Some(PixelFormat::Mono10Packed)), ("Mono10p", Some(PixelFormat::Mono10p)),
            ("Mono12", Some(PixelFormat::Mono12)), ("Mono12Packed", Some(PixelFormat::Mono12Packed)),
            ("Mono12p", Some(PixelFormat::Mono12p)), ("Mono14", Some(PixelFormat::Mono14)),
            ("Mono14p", Some(PixelFormat::Mono14p)), ("Mono16", Some(PixelFormat::Mono16)),
        ];
        /// Bytes of a packet with IP and UDP headers: 1500, or 9000 where every switch has jumbo frames.
        packet_bytes: Whole = 1500, 576..=65_532;
        /// Rate of sending, below what the network and the receiver take: a frame sent faster is lost.
        rate_mbit_s: f64 = 1000.0, Within(1.0, 1e5);
        /// Frames that a client may ask for again, such as 4.
        frames_kept: Whole = i64::from(Params::default().frames_kept), 1..=64;
        /// Frames that may wait to be sent, such as 2.
        frames_queued: Whole = i64::from(Params::default().frames_queued), 1..=16;
        /// Vendor that clients see.
        vendor: String = Computed("starloop's own"), "text", PLAIN;
        /// Model that clients see.
        model: String = Computed("starloop's own"), "text", PLAIN;
        /// Serial number that clients see.
        serial: String = Computed("starloop's own"), "text", PLAIN;
        /// User-defined name that clients see.
        user_name: String = Computed("none"), "text", PLAIN;
        /// Hardware address that clients see, such as "02:00:7f:00:00:01"; leave it out for that of the interface.
        mac: String = Optional, "six pairs of hexadecimal digits";
        /// Form of the description at the first address; the other form is at the second address.
        xml: Word<XmlForm> = "zip", [("zip", XmlForm::Zip), ("plain", XmlForm::Plain)];
        /// Frames may be sent to another machine than the one that controls the camera.
        allow_other_receivers: bool = false, Any;
        /// The socket on which ptp4l of this machine answers, for PtpStatus.
        ptp_socket: String = "/var/run/ptp4l", "path";
        /// A fault: one packet in so many is not sent; leave the key out for none.
        lose_one_in: Whole = Optional, 1..=1_000_000;
    }
}

const PLAIN: &str = "ASCII without < > & and quotes";

/// Checks the keys of a sink. The sensor's size and bits are of the camera file.
pub(super) fn check(keys: &NetworkCameraKeys, check: &mut Checker<'_>) -> Result<Params> {
    let address = address(keys, check)?;
    taken!(check, keys => port, pixel_format, packet_bytes, rate_mbit_s, frames_kept, frames_queued, xml);
    let lose_one_in = keys.lose_one_in().optional(check)?;
    let allow_other_receivers = keys.allow_other_receivers().check(check)?;
    Ok(Params {
        address,
        port,
        pixel_format,
        packet_bytes,
        rate_bit_s: rate_mbit_s * 1e6,
        frames_kept,
        frames_queued,
        identity: identity(keys, check)?,
        mac: mac(&keys.mac(), check)?,
        xml,
        allow_other_receivers,
        ptp_socket: keys.ptp_socket().check(check)?.into(),
        lose_one_in,
    })
}

fn address(keys: &NetworkCameraKeys, check: &mut Checker<'_>) -> Result<Ipv4Addr> {
    let text = keys.address().check(check)?;
    let found = text.parse::<Ipv4Addr>().ok().filter(|address| !address.is_unspecified() && !address.is_broadcast());
    found.ok_or_else(|| keys.address().invalid(format!("\"{text}\""), "the IPv4 address of an interface", check))
}

fn identity(keys: &NetworkCameraKeys, check: &Checker<'_>) -> Result<Identity> {
    let usual = Identity::default();
    let text = |given: Given<'_, String>, usual: String, most: usize| {
        let text = given.raw().cloned().unwrap_or(usual);
        let is_plain = text.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic() && !b"<>&\"'".contains(&byte));
        if text.len() <= most && is_plain {
            return Ok(text);
        }
        Err(given.invalid(format!("\"{text}\""), format!("at most {most} plain characters"), check))
    };
    Ok(Identity {
        vendor: text(keys.vendor(), usual.vendor, 31)?,
        model: text(keys.model(), usual.model, 31)?,
        serial: text(keys.serial(), usual.serial, 15)?,
        user_name: text(keys.user_name(), usual.user_name, 15)?,
        ..Identity::default()
    })
}

/// Returns the six pairs of hexadecimal digits with colons.
fn mac(given: &Given<'_, String>, check: &Checker<'_>) -> Result<Option<[u8; 6]>> {
    let Some(text) = given.raw() else { return Ok(None) };
    let pairs: Vec<Option<u8>> = text
        .split(':')
        .map(|pair| u8::from_str_radix(pair, 16).ok().filter(|_| pair.len() == 2 && !pair.starts_with('+')))
        .collect();
    let bytes: Option<Vec<u8>> = pairs.into_iter().collect();
    let mac = bytes.and_then(|bytes| <[u8; 6]>::try_from(bytes).ok()).filter(|mac| mac[0] & 1 == 0);
    let wanted = "six pairs of hexadecimal digits of one station, such as \"02:00:7f:00:00:01\"";
    mac.map(Some).ok_or_else(|| given.invalid(format!("\"{text}\""), wanted, check))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{document::Document, key::Section};
    use std::path::Path;

    fn read(text: &str) -> Result<Params> {
        let document = Document::from_text(text, Path::new("bench.toml"));
        let keys = document.read_as::<NetworkCameraKeys>()?;
        check(&keys.at(""), &mut Checker::new(&document))
    }

    #[test]
    fn nothing_given_is_the_usual_camera_on_loopback() {
        assert_eq!(read("").unwrap(), Params::default());
    }

    #[test]
    fn everything_given_is_taken() {
        let text = "address = \"127.0.0.2\"\nport = 0\npixel_format = \"Mono16\"\npacket_bytes = 9000\nrate_mbit_s = 2000\n\
                    frames_kept = 8\nframes_queued = 3\nserial = \"a 1\"\nuser_name = \"north\"\nmodel = \"m\"\n\
                    vendor = \"v\"\nmac = \"02:00:7f:00:00:0A\"\nxml = \"plain\"\n\
                    allow_other_receivers = true\nptp_socket = \"/tmp/p\"\nlose_one_in = 10\n";
        let wanted = Params {
            address: Ipv4Addr::new(127, 0, 0, 2),
            port: 0,
            pixel_format: Some(PixelFormat::Mono16),
            packet_bytes: 9000,
            rate_bit_s: 2e9,
            frames_kept: 8,
            frames_queued: 3,
            identity: Identity {
                vendor: "v".into(),
                model: "m".into(),
                serial: "a 1".into(),
                user_name: "north".into(),
                ..Identity::default()
            },
            mac: Some([2, 0, 0x7F, 0, 0, 10]),
            xml: XmlForm::Plain,
            allow_other_receivers: true,
            ptp_socket: "/tmp/p".into(),
            lose_one_in: Some(10),
        };
        assert_eq!(read(text).unwrap(), wanted);
    }

    #[test]
    fn both_sides_of_each_edge() {
        for (good, bad, part) in [
            ("packet_bytes = 576", "packet_bytes = 575", "576 to 65532"),
            ("port = 65535", "port = 65536", "3956"),
            ("rate_mbit_s = 1", "rate_mbit_s = 0.9", "1 to 100000"),
            ("frames_kept = 64", "frames_kept = 65", "1 to 64"),
            ("lose_one_in = 1", "lose_one_in = 0", "1 to 1000000"),
            ("serial = \"123456789012345\"", "serial = \"1234567890123456\"", "15 plain"),
            ("model = \"a b\"", "model = \"a<b\"", "quotes"),
            ("mac = \"00:11:22:33:44:55\"", "mac = \"01:11:22:33:44:55\"", "six pairs"),
            ("address = \"10.0.0.1\"", "address = \"0.0.0.0\"", "one address"),
            (
                "address = \"127.0.0.1\"",
                "address = \"localhost\"",
                "IPv4 address of an interface: a camera has one address: 127.0.0.1",
            ),
            ("pixel_format = \"Mono8\"", "pixel_format = \"mono8\"", "did you mean \"Mono8\""),
            ("xml = \"zip\"", "xml = \"gzip\"", "plain"),
            ("", "adress = \"127.0.0.1\"", "did you mean `address`"),
        ] {
            read(good).unwrap();
            let reported = read(bad).unwrap_err().to_string();
            assert!(reported.contains(part) && reported.contains("bench.toml"), "{reported}");
        }
    }
}
