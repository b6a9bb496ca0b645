//! Plain links: what is taken, what is refused with which words, and what a bench must have beside them.

use super::*;
use crate::{Bench, Document};
use link::{WireFormat, plain::Field};
use std::path::Path;

fn bench(link: &str, rest: &str) -> Result<Bench, String> {
    let text = format!("{rest}\n[link]\n{link}");
    let document = Document::from_text(&text, Path::new("lab/bench.toml"));
    Bench::from_document(&document).map_err(|error| error.to_string())
}

const OUTSIDE: &str = "[flight_computer]\nkind = \"external\"";

fn link(text: &str) -> Result<Link, String> {
    bench(text, OUTSIDE).map(|bench| bench.link)
}

#[test]
fn each_carrier_and_convention_is_read() {
    let udp = link("kind = \"udp\"\nlisten = 29700").unwrap();
    assert_eq!(udp.carrier, Carrier::Udp { listen: "127.0.0.1:29700".parse().unwrap() }, "on loopback");
    assert_eq!((udp.wire, udp.plain.unwrap().layout), (WireFormat::Plain, PlainLayout::default()));
    let tcp = link(
        "kind = \"tcp\"\nconnect = \"10.0.0.1:5\"\nencoding = \"json\"\nlayout = [\"q_x\", \"q_y\", \"q_z\", \"q_w\", \
                    \"w_x\", \"w_y\", \"w_z\"]\nquaternion = \"conjugate\"\nrate_unit = \"deg_s\"\ntime_unit = \"ms\"\ntime = \
                    \"arrival\"",
    );
    let tcp = tcp.unwrap();
    assert_eq!(tcp.carrier, Carrier::Tcp { address: "10.0.0.1:5".parse().unwrap(), connects: true });
    let layout = tcp.plain.unwrap().layout;
    assert_eq!((layout.fields.len(), layout.fields[3]), (7, Field::Quaternion(0)));
    assert_eq!(
        (layout.encoding, layout.sense, layout.time),
        (Encoding::Json, QuaternionSense::Conjugate, TimeMeaning::Arrival)
    );
    assert!((layout.angle_unit_rad - 1.0_f64.to_radians()).abs() < 1e-18 && (layout.time_unit_ns - 1e6).abs() < 1e-9);
    let lines = link("kind = \"tcp\"\nlisten = 0\nencoding = \"42\"\nspacecraft_number = 2").unwrap();
    let layout = lines.plain.unwrap().layout;
    assert_eq!((layout.encoding, layout.time), (Encoding::FortyTwo(2), TimeMeaning::Tag));
}

#[test]
fn unused_and_missing_keys_are_refused_by_name() {
    for (text, words) in [
        ("kind = \"udp\"", "link.listen"),
        ("kind = \"udp\"", "29700"),
        ("kind = \"udp\"\nlisten = 1\nconnect = 2", "kind = \"tcp\""),
        ("kind = \"udp\"\nlisten = 1\nwire = \"can_fd\"", "\"plain\""),
        ("kind = \"udp\"\nlisten = 1\nbit_rate = 9600.0", "link.bit_rate"),
        ("kind = \"udp\"\nlisten = 1\nencoding = \"42\"", "TCP"),
        ("kind = \"udp\"\nlisten = 1\nlayout = [\"t\", \"q\"]", "is \"q\"; wanted some of t, q_w"),
        ("kind = \"udp\"\nlisten = 1\nlayout = [\"t\", \"qw\"]", "it is not the name of a field"),
        ("kind = \"udp\"\nlisten = 1\nlayout = [\"t\", \"q_w\", \"q_w\"]", "it has the field \"q_w\" twice"),
        ("kind = \"udp\"\nlisten = 1\nlayout = [\"t\", \"w_x\", \"w_y\", \"w_z\"]", "it lacks the field \"q_w\""),
        (
            "kind = \"udp\"\nlisten = 1\nlayout = [\"q_w\", \"q_x\", \"q_y\", \"q_z\", \"w_x\", \"w_y\", \"w_z\"]",
            "no \"t\"",
        ),
        ("kind = \"udp\"\nlisten = 1\nspacecraft_number = 1", "encoding = \"42\""),
        ("kind = \"tcp\"", "link.listen"),
        ("kind = \"tcp\"\nlisten = 1\nconnect = 2", "link.connect"),
        ("kind = \"tcp\"\nlisten = 1\nsender_timeout_s = 1.0", "kind = \"udp\""),
        ("kind = \"tcp\"\nlisten = 1\nencoding = \"42\"\nquaternion = \"conjugate\"", "its own conventions"),
        ("kind = \"socketcan\"\ninterface = \"can0\"\nencoding = \"json\"", "\"udp\""),
        ("kind = \"socketcan\"\ninterface = \"can0\"\nlisten = 1", "\"udp\""),
    ] {
        let error = link(text).unwrap_err();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn bench_of_a_plain_link_has_nothing_that_needs_the_protocol() {
    let udp = "kind = \"udp\"\nlisten = 29700";
    assert!(bench(udp, OUTSIDE).is_ok(), "control");
    let started = format!("{OUTSIDE}\n[session]\nstart = \"on_run\"");
    assert!(bench(udp, &started).unwrap_err().contains("session.start"));
    let extra = format!("{OUTSIDE}\n[[extra_link]]\nkind = \"socketcan\"\ninterface = \"can0\"");
    assert!(bench(udp, &extra).unwrap_err().contains("extra_link[0]"));
    assert!(bench(udp, "").is_ok() && bench("wire = \"plain\"", "").is_ok(), "the simulated flight computer");
    let samples = "[flight_computer]\njitter_source = \"samples\"";
    assert!(bench("wire = \"plain\"", samples).unwrap_err().contains("jitter_source"));
    let lines = "kind = \"tcp\"\nlisten = 1\nencoding = \"42\"";
    assert!(bench(lines, "").unwrap_err().contains("read, not written"));
}
