//! Keys of a camera on the network: `kind = "network_camera"` in a table of a sink.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use outputs::network_camera::{Identity, Params, PixelFormat, XmlForm};
use serde::Deserialize;
use std::net::Ipv4Addr;

/// A camera on the network, as it is written.
#[derive(Debug, Default, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NetworkCameraKeys {
    address: Option<String>,
    port: Option<i64>,
    pixel_format: Option<String>,
    packet_bytes: Option<i64>,
    rate_mbit_s: Option<f64>,
    frames_kept: Option<i64>,
    frames_queued: Option<i64>,
    vendor: Option<String>,
    model: Option<String>,
    serial: Option<String>,
    user_name: Option<String>,
    mac: Option<String>,
    xml: Option<String>,
    allow_other_receivers: Option<bool>,
    lose_one_in: Option<i64>,
}

/// Checks the keys of the table `prefix`, such as `extra_sink[0].`. The camera file tells the sensor's size and bits.
pub(super) fn check(keys: &NetworkCameraKeys, prefix: &str, check: &mut Checker<'_>) -> Result<Params, ConfigError> {
    let key = |name: &str| format!("{prefix}{name}");
    let usual = Params::default();
    let address = address(&key("address"), keys.address.as_deref(), check)?;
    let advice = "clients look at 3956; 0 takes a free port";
    let port = check.whole(&key("port"), keys.port, Some(3956), 0..=65_535, advice)?;
    let formats = [
        ("auto", None),
        ("Mono8", Some(PixelFormat::Mono8)),
        ("Mono10", Some(PixelFormat::Mono10)),
        ("Mono12", Some(PixelFormat::Mono12)),
        ("Mono12Packed", Some(PixelFormat::Mono12Packed)),
        ("Mono16", Some(PixelFormat::Mono16)),
    ];
    let advice = "auto takes the narrowest that holds the detector's bits; clients may choose another";
    let pixel_format = check.choice(&key("pixel_format"), keys.pixel_format.as_deref(), &formats, advice)?;
    let advice = "bytes with IP and UDP headers: 1500, or 9000 where every switch has jumbo frames";
    let packet_bytes = check.whole(&key("packet_bytes"), keys.packet_bytes, Some(1500), 576..=65_532, advice)?;
    let advice = "below what the network and the receiver take: a frame sent faster is lost";
    let rate_mbit_s = check.number(&key("rate_mbit_s"), keys.rate_mbit_s, 1000.0, Rule::Within(1.0, 1e5), advice)?;
    let advice = "frames that a client may ask for again, such as 4";
    let frames_kept = check.whole(&key("frames_kept"), keys.frames_kept, Some(usual.frames_kept), 1..=64, advice)?;
    let advice = "frames that may wait to be sent, such as 2";
    let frames_queued =
        check.whole(&key("frames_queued"), keys.frames_queued, Some(usual.frames_queued), 1..=16, advice)?;
    let forms = [("zip", XmlForm::Zip), ("plain", XmlForm::Plain)];
    let xml = check.choice(&key("xml"), keys.xml.as_deref(), &forms, "the other form is at the second address")?;
    let lose_one_in = keys.lose_one_in.map(|_| {
        let advice = "a fault: one packet in so many is not sent; leave the key out for none";
        check.whole(&key("lose_one_in"), keys.lose_one_in, None, 1..=1_000_000, advice)
    });
    let allow_other_receivers = check.given_or(&key("allow_other_receivers"), keys.allow_other_receivers, false);
    Ok(Params {
        address,
        port: u16::try_from(port).unwrap_or_default(),
        pixel_format,
        packet_bytes,
        rate_bit_s: rate_mbit_s * 1e6,
        frames_kept,
        frames_queued,
        identity: identity(keys, prefix, check)?,
        mac: mac(&key("mac"), keys.mac.as_deref(), check)?,
        xml,
        allow_other_receivers,
        lose_one_in: lose_one_in.transpose()?,
    })
}

fn address(key: &str, given: Option<&str>, check: &mut Checker<'_>) -> Result<Ipv4Addr, ConfigError> {
    let text = check.given_or(key, given.map(str::to_owned), Ipv4Addr::LOCALHOST.to_string());
    let found = text.parse::<Ipv4Addr>().ok().filter(|address| !address.is_unspecified() && !address.is_broadcast());
    let advice = "a camera has one address: 127.0.0.1 for programs on this machine, or that of a network interface";
    found.ok_or_else(|| check.invalid(key, format!("\"{text}\""), "the IPv4 address of an interface", advice))
}

fn identity(keys: &NetworkCameraKeys, prefix: &str, check: &Checker<'_>) -> Result<Identity, ConfigError> {
    let usual = Identity::default();
    let text = |name: &str, given: &Option<String>, usual: String, most: usize| {
        let text = given.clone().unwrap_or(usual);
        let is_plain = text.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic() && !b"<>&\"'".contains(&byte));
        if text.len() <= most && is_plain {
            return Ok(text);
        }
        let wanted = format!("at most {most} plain characters");
        Err(check.invalid(&format!("{prefix}{name}"), format!("\"{text}\""), wanted, "ASCII without < > & and quotes"))
    };
    Ok(Identity {
        vendor: text("vendor", &keys.vendor, usual.vendor, 31)?,
        model: text("model", &keys.model, usual.model, 31)?,
        serial: text("serial", &keys.serial, usual.serial, 15)?,
        user_name: text("user_name", &keys.user_name, usual.user_name, 15)?,
        ..Identity::default()
    })
}

/// Six pairs of hexadecimal digits with colons.
fn mac(key: &str, given: Option<&str>, check: &Checker<'_>) -> Result<Option<[u8; 6]>, ConfigError> {
    let Some(text) = given else { return Ok(None) };
    let pairs: Vec<Option<u8>> = text
        .split(':')
        .map(|pair| u8::from_str_radix(pair, 16).ok().filter(|_| pair.len() == 2 && !pair.starts_with('+')))
        .collect();
    let bytes: Option<Vec<u8>> = pairs.into_iter().collect();
    let mac = bytes.and_then(|bytes| <[u8; 6]>::try_from(bytes).ok()).filter(|mac| mac[0] & 1 == 0);
    let wanted = "six pairs of hexadecimal digits of one station, such as \"02:00:7f:00:00:01\"";
    mac.map(Some)
        .ok_or_else(|| check.invalid(key, format!("\"{text}\""), wanted, "leave it out to tell the interface's"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Document;
    use std::path::Path;

    fn read(text: &str) -> Result<Params, ConfigError> {
        let document = Document::from_text(text, Path::new("bench.toml"));
        let keys = document.read_as::<NetworkCameraKeys>()?;
        check(&keys, "", &mut Checker::new(&document))
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
                    allow_other_receivers = true\nlose_one_in = 10\n";
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
            ("address = \"127.0.0.1\"", "address = \"localhost\"", "IPv4"),
            ("pixel_format = \"Mono8\"", "pixel_format = \"mono8\"", "did you mean \"Mono8\""),
            ("xml = \"zip\"", "xml = \"gzip\"", "plain"),
            ("", "adress = \"127.0.0.1\"", "did you mean `address`"),
        ] {
            read(good).unwrap();
            let told = read(bad).unwrap_err().to_string();
            assert!(told.contains(part) && told.contains("bench.toml"), "{told}");
        }
    }
}
