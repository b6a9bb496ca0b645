//! Captures of every protocol, made by the devices of `telemetry`.

use super::*;
use telemetry::canopen::{CanOpenDevice, NodeParams};
use telemetry::{Device, Limits, Mode, Report};
use telemetry::{ccsds::CcsdsDevice, nos3::Nos3Device, sagitta::SagittaDevice};

const Q: [f64; 4] = [0.8, 0.6, 0.0, 0.0];
const LATER: Span = Span::from_ms(120);

fn tag(second: i64) -> Tai {
    Tai::from_rfc3339("2026-03-01T12:00:00Z").unwrap() + Span::from_ms(1000 * second)
}

fn device(name: &str) -> Box<dyn Device> {
    let node = NodeParams { node: 100, heartbeat_ms: 100, starts_operational: true };
    match name {
        "nos3" => Box::new(Nos3Device::new(Limits::default())),
        "sagitta" => Box::new(SagittaDevice::new(Limits::default(), 0.05)),
        "ccsds" => Box::new(CcsdsDevice::new(100, Sense::Conjugate, Limits::default())),
        _canopen => Box::new(CanOpenDevice::new(node, Sense::Conjugate, Limits::default(), 0.05)),
    }
}

/// Three seconds of telemetry, the last without an attitude, as a capture of the program or of candump.
fn capture(name: &str, is_candump: bool) -> String {
    let (mut device, mut text) = (device(name), String::new());
    for second in 0..3 {
        let (mut out, now) = (Vec::new(), tag(second) + LATER);
        let report = Report {
            frame: second as u32,
            time_tag: tag(second),
            attitude_wxyz: (second < 2).then_some(Q),
            rate_rad_s: None,
            sigma_rad: [1e-5; 3],
            stars: 12,
            mode: Mode::Tracking,
            exposure_s: 0.05,
            background_dn: 1.0,
            temperature_c: 1.0,
        };
        if second == 0 {
            device.start(now, &mut out);
        }
        device.report(&report, now, &mut out);
        if device.is_polled() {
            device.take(&Wire::Bytes(vec![0xDE, 0xAD, 2, 0, 0, 0, 0, 0xBE, 0xEF]), now, &mut out, &mut Vec::new());
        }
        for wire in out {
            let bytes: String = wire.data().iter().map(|byte| format!("{byte:02X}")).collect();
            let id = match &wire {
                Wire::Can(frame) => format!("{:03X}", frame.id()),
                Wire::Bytes(_) => "-".into(),
            };
            let unix_us = now.to_unix_ns() / 1000;
            text += &if is_candump {
                format!("({}.{:06}) can0 {id}#{bytes}\n", unix_us / 1_000_000, unix_us % 1_000_000)
            } else {
                format!("{now} {} {id} {bytes}\n", now.ns())
            };
        }
    }
    text
}

fn rows(text: &str) -> Result<Vec<LogRow>> {
    assert!(is_capture(text), "{text}");
    match read("capture.txt", text)? {
        Captured::Rows(rows) => Ok(rows),
        Captured::Json(text) => bail!("JSON: {text}"),
    }
}

fn check(name: &str, text: &str) {
    let rows = rows(text).unwrap();
    assert_eq!(rows.len(), 3, "{name}");
    let wanted = DQuat::from_xyzw(Q[1], Q[2], Q[3], Q[0]);
    for (second, row) in (0..3).zip(&rows) {
        assert_eq!(row.at_ns, Some(tag(second).ns()), "{name}");
        assert_eq!(row.available_ns, Some((tag(second) + LATER).ns()), "{name}");
        assert_eq!(row.attitude.is_some(), second < 2, "{name}");
    }
    let got = rows[1].attitude.unwrap();
    assert!(got.dot(wanted).abs() > 1.0 - 1e-8, "{name}: {got}");
    // Control: swapped axes are another attitude.
    assert!(got.dot(DQuat::from_xyzw(Q[2], Q[1], Q[3], Q[0])).abs() < 0.9);
}

#[test]
fn captures_of_every_protocol_are_logs() {
    check("nos3", &format!("# latency_ms: 120\n{}", capture("nos3", false)));
    check("sagitta", &capture("sagitta", false));
    check("ccsds", &format!("# sense: icrf_from_sensor\n{}", capture("ccsds", false)));
    for is_candump in [false, true] {
        let text = format!("# node: 100\n# sense: icrf_from_sensor\n{}", capture("canopen", is_candump));
        check("canopen", &text);
    }
}

#[test]
fn frames_with_29_bits_are_passed_over() {
    let text = format!("# node: 100\n# sense: icrf_from_sensor\n{}", capture("canopen", true));
    // Each frame twice: the second has the same number with 29 bits, and no data.
    let longer = |line: &str| line.split_once('#').map(|(head, _)| head.replace(" can0 ", " can0 00000") + "#\n");
    let lines = text
        .lines()
        .map(|line| format!("{line}\n{}", longer(line).filter(|_| line.starts_with('(')).unwrap_or_default()));
    let both: String = lines.collect();
    assert!(both.contains(" can0 000001E4#\n"), "{both}");
    check("canopen", &both);
    // Control: with 11 bits the frames without data are damage.
    assert_ne!(rows(&both.replace(" can0 00000", " can0 ")).unwrap().len(), 3);
}

#[test]
fn the_other_sense_is_another_attitude() {
    let rows = rows(&capture("ccsds", false)).unwrap();
    let got = rows[1].attitude.unwrap();
    assert!(got.dot(DQuat::from_xyzw(-Q[1], 0.0, 0.0, Q[0])).abs() > 1.0 - 1e-9, "{got}");
}

#[test]
fn damaged_packets_are_rows_of_their_own() {
    let text = capture("sagitta", false);
    let last = text.trim_end().rfind(' ').unwrap() + 40;
    let other = if &text[last..=last] == "0" { "1" } else { "0" };
    let damaged = format!("{}{other}{}", &text[..last], &text[last + 1..]);
    let rows = rows(&damaged).unwrap();
    assert_eq!(rows.len(), 3);
    assert_eq!(rows[2], LogRow::default());
}

#[test]
fn a_line_that_is_no_packet_is_a_row_of_its_own() {
    let text = capture("sagitta", false);
    let lines: Vec<&str> = text.lines().collect();
    let damaged = format!("{}\n{}0\n{}\n", lines[0], lines[1], lines[2..].join("\n"));
    let (whole, got) = (rows(&text).unwrap(), rows(&damaged).unwrap());
    assert!(got.contains(&LogRow::default()) && !whole[..2].contains(&LogRow::default()), "half a byte more");
    let all_damaged = text.replace(" - ", " ? ");
    assert!(format!("{:#}", rows(&format!("{}\n{all_damaged}", lines[0])).unwrap_err()).contains("line 2"));
}

#[test]
fn anything_else_is_refused_in_words() {
    let refused = |text: &str| format!("{:#}", rows(text).unwrap_err());
    assert!(refused(&capture("nos3", false)).contains("# latency_ms: 120"));
    assert!(refused(&format!("# latency_ms: x\n{}", capture("nos3", false))).contains("wanted 0 to 60000"));
    assert!(refused(&format!("# latency_ms: 5\n{}", capture("ccsds", false))).contains("have time tags"));
    assert!(refused(&format!("# sense: both\n{}", capture("ccsds", false))).contains("got both"));
    assert!(refused(&format!("# sense: icrf_from_body\n{}", capture("sagitta", false))).contains("# sense"));
    assert!(refused(&format!("# protocol: x\n{}", capture("ccsds", false))).contains("got x"));
    assert!(refused(&format!("# node: 200\n{}", capture("canopen", true))).contains("1 to 127"));
    let other_node = refused(&capture("canopen", true));
    assert!(other_node.contains("no report of a tracker") && other_node.contains("# node"), "{other_node}");
    let unknown = "2026-03-01T12:00:00Z 1772366437000000000 - 5500";
    assert!(refused(unknown).contains("begin with 55"));
    assert!(refused(&format!("{unknown}\nnonsense")).contains("line 2"));
    assert!(!is_capture("frame,q_w\n1,2\n") && !is_capture("# only\n") && !is_capture("(x) can0 1#00"));
}

#[test]
fn stamps_of_candump_are_exact() {
    assert_eq!(unix("1772366400.25").unwrap(), Tai::from_unix_ns(1_772_366_400_250_000_000));
    assert_eq!(unix("1772366400.000000001").unwrap(), Tai::from_unix_ns(1_772_366_400_000_000_001));
    assert_eq!((unix("1.x"), unix("9999999999999999"), unix("1.0123456789")), (None, None, None));
}
