//! Every rule of `[[tracker_out]]` with an example that breaks it.

use super::*;
use crate::{Bench, Document};
use std::path::Path;

fn outs(text: &str) -> Result<Vec<TrackerOut>, String> {
    let document = Document::from_text(text, Path::new("lab/bench.toml"));
    Bench::from_document(&document).map(|bench| bench.tracker_outs).map_err(|error| error.to_string())
}

fn one(keys: &str) -> Result<TrackerOut, String> {
    outs(&format!("[[tracker_out]]\n{keys}")).map(|outs| outs.into_iter().next().expect("one"))
}

#[test]
fn telemetry_is_as_the_bench_file_says() {
    assert_eq!(outs("").unwrap(), []);
    let plain = one("link = \"udp\"\nsend_to = 9001").unwrap();
    assert_eq!((plain.head, plain.protocol, plain.delay), (0, TrackerProtocol::Json, Span::from_ms(50)));
    assert_eq!(plain.source, TrackerSource::Pixels { most_stars: 40 });
    let to = "127.0.0.1:9001".parse().unwrap();
    assert_eq!(plain.line, TrackerLine::Udp { to, listen: None });
    let can = one("protocol = \"canopen\"\nlink = \"slcan_pty\"\npath = \"/tmp/st\"\nnode_id = 100").unwrap();
    let of = |pdos| TrackerProtocol::CanOpen { node: 100, heartbeat_ms: 1000, starts_operational: false, pdos };
    assert_eq!((can.protocol, can.line.has_virtual_time()), (of(TrackerPdos::Starloop), false));
    let keys = "protocol = \"canopen\"\nlink = \"file\"\npath = \"a.txt\"\nnode_id = 100\npdo_map = \"oresat\"";
    assert_eq!(one(keys).unwrap().protocol, of(TrackerPdos::OreSat));
    let model = one(
        "source = \"model\"\nlink = \"file\"\npath = \"st.txt\"\nrate_hz = 5.0\n[tracker_out.model]\nbias_arcsec = [1.0, 0.0, 0.0]\n\
         [[tracker_out.fault]]\nkind = \"late\"\nat_s = 1.0\nfor_s = 2.0\nlate_ms = 30.0",
    );
    let model = model.unwrap();
    let TrackerSource::Model(figures) = model.source else { unreachable!("{:?}", model.source) };
    assert_eq!((figures.bias_rad.x, figures.noise_rad.z), (ARCSEC, 16.0 * ARCSEC));
    assert!((figures.field_rad / DEG - 20.0).abs() < 2.0, "{}", figures.field_rad / DEG);
    assert_eq!(model.faults[0].kind, TrackerOutFaultKind::Late(Span::from_ms(30)));
}

#[test]
fn each_rule_has_a_failing_example() {
    for (keys, parts) in [
        ("head = 0", ["tracker_out[0].link", "missing"]),
        ("link = \"udp\"", ["tracker_out[0].send_to", "missing"]),
        ("link = \"tcp\"", ["tracker_out[0].listen", "missing"]),
        ("link = \"pty\"", ["tracker_out[0].path", "missing"]),
        ("link = \"udp\"\nsend_to = 1\nhead = 1", ["tracker_out[0].head", "below 1"]),
        ("link = \"udp\"\nsend_to = 1\nprotocol = \"canopen\"", ["tracker_out[0].link", "slcan_pty"]),
        ("link = \"slcan_pty\"\npath = \"a\"", ["tracker_out[0].link", "a line of bytes"]),
        ("link = \"udp\"\nsend_to = 1\nprotocol = \"nos3\"", ["tracker_out[0].link", "serial, pty"]),
        ("link = \"pty\"\npath = \"a\"\nprotocol = \"nos3\"\nrate_hz = 1.0", ["tracker_out[0].rate_hz", "unasked"]),
        (
            "link = \"pty\"\npath = \"a\"\nprotocol = \"nos3\"\nquaternion = \"conjugate\"",
            ["quaternion", "leave it open"],
        ),
        ("link = \"udp\"\nsend_to = 1\nnode_id = 5", ["tracker_out[0].node_id", "canopen"]),
        ("link = \"udp\"\nsend_to = 1\npdo_map = \"oresat\"", ["tracker_out[0].pdo_map", "canopen"]),
        ("link = \"udp\"\nsend_to = 1\napid = 5", ["tracker_out[0].apid", "ccsds"]),
        ("link = \"udp\"\nsend_to = 1\npath = \"a\"", ["tracker_out[0].path", "serial"]),
        ("link = \"udp\"\nsend_to = 1\nsource = \"model\"\nstars = 9", ["tracker_out[0].stars", "pixels"]),
        ("link = \"udp\"\nsend_to = 1\n[tracker_out.model]\nacquisition_s = 1.0", ["tracker_out[0].model", "source"]),
        (
            "link = \"udp\"\nsend_to = 1\nsource = \"model\"\n[tracker_out.model]\nlost_above_deg_s = 0.5",
            ["tracker_out[0].model.lost_above_deg_s", "at least"],
        ),
        (
            "link = \"udp\"\nsend_to = 1\n[[tracker_out.fault]]\nkind = \"bias\"\nat_s = 0.0\nfor_s = 1.0",
            ["tracker_out[0].fault[0].bias_arcsec", "missing"],
        ),
        (
            "link = \"udp\"\nsend_to = 1\n[[tracker_out.fault]]\nkind = \"drop\"\nat_s = 0.0\nfor_s = 1.0\nlate_ms = 1.0",
            ["tracker_out[0].fault[0].late_ms", "late"],
        ),
        ("link = \"socketcan\"\nprotocol = \"canopen\"", ["tracker_out[0].interface", "missing"]),
        ("link = \"file\"\npath = \"../st.txt\"", ["tracker_out[0].path", "below the run's folder"]),
        ("link = \"file\"\npath = \"/tmp/st.txt\"", ["tracker_out[0].path", "below the run's folder"]),
        ("link = \"file\"\npath = \"a/../../st.txt\"", ["tracker_out[0].path", "below the run's folder"]),
        ("link = \"file\"\npath = \".\"", ["tracker_out[0].path", "below the run's folder"]),
        ("link = \"file\"\npath = \"summary.json\"", ["tracker_out[0].path", "another ending"]),
        ("link = \"file\"\npath = \"./events.JSONL\"", ["tracker_out[0].path", "another ending"]),
    ] {
        let error = one(keys).expect_err(keys);
        assert!(parts.iter().all(|part| error.contains(part)), "{keys}: {error}");
    }
}

#[test]
fn a_file_of_telemetry_may_be_anywhere_below_the_folder() {
    for path in ["st.txt", "a/b/st.txt", "./st", "telemetry/st.json"] {
        one(&format!("link = \"file\"\npath = \"{path}\"")).expect(path);
    }
}
