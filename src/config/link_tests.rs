//! Links of every kind: what is taken, and what is refused with which words.

use super::*;
use crate::{Bench, Document};
use std::path::Path;

fn link(text: &str) -> Result<Link, String> {
    let text = format!("[flight_computer]\nkind = \"external\"\n[link]\n{text}");
    let document = Document::from_text(&text, Path::new("lab/bench.toml"));
    Bench::from_document(&document).map(|bench| bench.link).map_err(|error| error.to_string())
}

#[test]
fn each_kind_is_read_with_its_own_keys() {
    let can =
        link("kind = \"socketcan\"\ninterface = \"can1\"\nwire = \"can_classic\"\nnode = 3\nid_base = 128").unwrap();
    assert_eq!(can.carrier, Carrier::SocketCan { interface: "can1".into() });
    assert_eq!((can.wire, Some(can.ids)), (WireFormat::CanClassic, IdMap::new(128, 3)));
    let serial = link("kind = \"serial\"\nport = \"/dev/ttyS0\"\nparity = \"even\"\nbit_rate = 115200.0").unwrap();
    let Carrier::SerialPort { port, .. } = &serial.carrier else { panic!("{serial:?}") };
    assert_eq!((port.parity, port.stop_bits, serial.wire), (Parity::Even, StopBits::One, WireFormat::Serial));
    let simulated = link("slcan_tcp = 0\nsocketcand = \"10.0.0.1:29536\"").unwrap();
    let Carrier::Simulated(gateway_ports) = &simulated.carrier else { panic!("{simulated:?}") };
    assert_eq!(gateway_ports.slcan_tcp, Some("127.0.0.1:0".parse().unwrap()), "a bare port is on loopback");
    assert_eq!(gateway_ports.socketcand, Some("10.0.0.1:29536".parse().unwrap()));
}

#[test]
fn identifiers_have_11_or_29_bits() {
    let ids = |text: &str| link(text).map(|link| link.ids);
    assert_eq!(ids(""), Ok(IdMap::default()));
    assert_eq!(ids("id_bits = 29").ok(), IdMap::extended(0, 0));
    assert_ne!(ids("id_bits = 29"), ids("id_bits = 11"));
    assert_eq!(ids("id_base = 0xF0").ok(), IdMap::new(0xF0, 0));
    assert_eq!(ids("id_bits = 29\nnode = 5\nid_base = 0x18FF0000").ok(), IdMap::extended(0x18FF_0000, 5));
    assert_eq!(ids("id_bits = 29\nid_base = 0x1FFFF8F0").ok(), IdMap::extended(0x1FFF_F8F0, 0));
    for (text, words) in [
        ("id_base = 0x100", "0 to 240"),
        ("id_base = 0x100", "id_bits = 29"),
        ("id_bits = 29\nid_base = 0x1FFFF900", "0 to 536869104"),
        ("id_bits = 29\nid_base = 0x18FF0008", "multiple of 16"),
        ("id_bits = 16", "11 or 29"),
        ("id_bits = 30", "link.id_bits"),
        ("wire = \"serial\"\nid_bits = 29", "a CAN wire"),
    ] {
        let error = link(text).unwrap_err();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn unused_and_missing_keys_are_refused_by_name() {
    for (text, words) in [
        ("kind = \"socketcan\"", "link.interface"),
        ("kind = \"socketcan\"", "ip -br link"),
        ("kind = \"socketcan\"\ninterface = \" \"", "empty"),
        ("kind = \"socketcan\"\ninterface = \"can0\"\nwire = \"serial\"", "can_fd"),
        ("kind = \"serial\"", "link.port"),
        ("kind = \"serial\"", "/dev/serial/by-id"),
        ("kind = \"serial\"\nport = \"/dev/x\"\nstop_bits = 3", "1 to 2"),
        ("interface = \"can0\"", "socketcan"),
        ("kind = \"socketcan\"\ninterface = \"can0\"\nslcan_tcp = \"0\"", "simulated"),
        ("slcan_tcp = \"nowhere\"", "address:port"),
        ("socketcand = \"default\"", "a port on loopback such as 29536"),
        ("slcan_tcp = 70000", "is \"70000\""),
        ("id_base = 8", "multiple of 16"),
        ("node = 16", "0 to 15"),
        ("wire = \"serial\"\nnode = 1", "a CAN wire"),
        ("pps = \"/sys/class/pps/pps0\"", "link.pps"),
    ] {
        let error = link(text).unwrap_err();
        assert!(error.contains(words), "{text}: {error}");
    }
}
