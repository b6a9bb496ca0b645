//! Tests that every line is a request or a refusal in plain words, that lines of any bytes are separated.

use super::admission::{ControlRefusals, admit};
use super::lines::{ControlAddress, Incoming, LineSocket};
use super::protocol::{LINE_BYTES_MAX, Request, StepBy, parse};
use super::token::Token;
use core::sync::atomic::{AtomicBool, Ordering};
use serde_json::json;
use std::io::Write;
use std::net::{TcpListener, TcpStream};

#[test]
fn requests_are_read() {
    let read = |line| parse(line).1.expect(line);
    assert_eq!(read(r#"{"request": "hello"}"#), Request::Hello { token: None });
    let token = Some("00ff".into());
    assert_eq!(read(r#"{"request": "hello", "token": "00ff"}"#), Request::Hello { token });
    assert_eq!(read(r#"{"request": "step", "s": 2}"#), Request::Step(StepBy::Seconds(2.0)));
    assert_eq!(read(r#"{"request": "step", "frames": 3}"#), Request::Step(StepBy::Frames(3)));
    assert_eq!(read(r#"{"request": "step", "until_s": -0.5}"#), Request::Step(StepBy::Until(-0.5)));
    let trigger = |at_s| Request::Trigger { number: 65_535, at_s };
    assert_eq!(read(r#"{"request": "trigger", "number": 65535}"#), trigger(None));
    assert_eq!(read(r#"{"request": "trigger", "number": 65535, "at_s": 2.5}"#), trigger(Some(2.5)));
    assert_eq!(read(r#"{"request": "truth"}"#), Request::Truth { at_s: None });
    assert_eq!(read(r#"{"request": "frame", "head": 1}"#), Request::Frame { head: 1, path: None, pixels: true });
    let (id, _) = parse(r#"{"id": [1, "a"], "request": "dance"}"#);
    assert_eq!(id, Some(json!([1, "a"])), "an id is echoed whatever it is and whatever is wrong");
}

#[test]
fn invalid_request_is_refused_with_its_error() {
    let cases = [
        ("hello", "not JSON"),
        ("step 0.5", "wanted {\"request\": \"step\""),
        ("[1]", "the line is a list"),
        ("{}", "request is missing; wanted one of: hello, state, step"),
        (r#"{"request": 1}"#, "request is 1"),
        (r#"{"request": "dance"}"#, "request is \"dance\""),
        (r#"{"request": "hello", "s": 1}"#, "unknown key \"s\" in hello"),
        (r#"{"request": "hello", "token": 1}"#, "token is a number; wanted a string"),
        (r#"{"request": "step", "seconds": 0.5}"#, "unknown key \"seconds\" in step; wanted s, frames, until_s"),
        (r#"{"request": "step"}"#, "step has 0 of s, frames and until_s; wanted exactly one"),
        (r#"{"request": "step", "s": 1, "frames": 1}"#, "step has 2 of"),
        (r#"{"request": "step", "s": "1"}"#, "s is \"1\"; wanted a number"),
        (r#"{"request": "step", "s": -1}"#, "s is -1; wanted seconds above 0"),
        (r#"{"request": "step", "s": 0}"#, "above 0"),
        (r#"{"request": "step", "s": 1e999}"#, "not JSON"),
        (r#"{"request": "step", "frames": 1.5}"#, "frames is 1.5; wanted a whole number"),
        (r#"{"request": "step", "frames": -2}"#, "frames is -2"),
        (r#"{"request": "inject"}"#, "event is missing"),
        (r#"{"request": "inject", "event": 3}"#, "event is 3"),
        (r#"{"request": "trigger"}"#, "number is missing"),
        (r#"{"request": "trigger", "number": 65536}"#, "number is 65536; wanted a whole number from 0 to 65535"),
        (r#"{"request": "truth", "at_s": null}"#, "at_s is null"),
        (r#"{"request": "frame", "head": -1}"#, "head is -1"),
        (r#"{"request": "frame", "path": ""}"#, "path is \"\""),
        (r#"{"request": "frame", "pixels": 0}"#, "pixels is 0; wanted true or false"),
        (r#"{"request": "attitude", "samples": [[0, 1, 0, 0, 0, 0, 0, 1e999]]}"#, "not JSON"),
        (r#"{"request": "attitude", "samples": [], "unit": "km"}"#, "unknown key \"unit\" in attitude"),
    ];
    for (line, part) in cases {
        let error = parse(line).1.expect_err(line);
        assert!(error.contains(part), "{line}: no \"{part}\" in: {error}");
    }
}

#[test]
fn samples_that_cannot_be_read_are_requests_to_be_counted() {
    for (line, part) in [
        (r#"{"request": "attitude"}"#, "samples is missing"),
        (r#"{"request": "attitude", "samples": [[0, 1, 0, 0]]}"#, "samples[0] has 4 numbers"),
        (r#"{"request": "observer", "samples": [[0]], "unit": 1}"#, "unit is 1; wanted \"km\" or \"m\""),
    ] {
        let request = parse(line).1.expect(line);
        assert!(matches!(&request, Request::BadSamples(why) if why.contains(part)), "{line}: {request:?}");
    }
    let good = r#"{"request": "attitude", "samples": [[0, 1, 0, 0, 0, 0, 0, 0]]}"#;
    assert!(matches!(parse(good).1, Ok(Request::Plant(_))), "control");
}

/// Tests lines of every request with numbers, damaged in one to four bytes: each is read or refused in words, and every
/// value that is read is within its limits.
#[test]
fn damaged_lines_are_read_or_refused() {
    let lines = [
        r#"{"request": "attitude", "samples": [[0.5, 0.6, 0, 0.8, 0, 1e-3, 0, 0], [1, 1, 0, 0, 0, 0, 0, 0, 1, 2, 3]]}"#,
        r#"{"request": "observer", "samples": [[0, 7e3, 0, 0, 0, 7.5, 0]], "unit": "m"}"#,
        r#"{"request": "jitter", "samples": [[0.001, 0.2, -0.1, 0]], "unit": "rad"}"#,
        r#"{"request": "wheels", "torques_n_m": [0.01, 0, -0.01], "at_s": 1.5}"#,
        r#"{"request": "torque", "torque_n_m": [0.1, 0, 0], "for_s": 2.0}"#,
        r#"{"request": "tracker_attitude", "at_s": 1, "body_from_icrf": [1, 0, 0, 0], "sigma_arcsec": [1, 2, 3]}"#,
    ];
    let (mut word, mut read, mut refused) = (1_u64, 0, 0);
    let mut random = |below: usize| {
        word = word.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (word >> 33) as usize % below
    };
    let damage = br#"0123456789.-+eE,[]{}" nulltr"#;
    for round in 0..6000 {
        let mut bytes = lines[round % lines.len()].as_bytes().to_vec();
        for _ in 0..=random(4) {
            let place = random(bytes.len());
            match random(3) {
                0 => {
                    bytes.remove(place);
                }
                1 => bytes.insert(place, damage[random(damage.len())]),
                _ => bytes[place] = damage[random(damage.len())],
            }
        }
        let line = String::from_utf8(bytes).expect("ASCII");
        match parse(&line).1 {
            Ok(Request::Plant(list)) => {
                read += 1;
                for sample in list.since(base::time::Tai::from_ns(0)) {
                    assert!(sample.at.ns().abs() <= 100_000_000 * 1_000_000_000, "{line}");
                    let norm = sample.attitude.map_or(1.0, |attitude| attitude.body_from_icrf.quat().length());
                    assert!((norm - 1.0).abs() < 1e-12, "{line}");
                }
            }
            Ok(_) => read += 1,
            Err(why) => {
                refused += 1;
                assert!(!why.is_empty(), "{line}");
            }
        }
    }
    assert!(read > 50 && refused > 50, "control: {read} read, {refused} refused");
}

#[test]
fn only_loopback_addresses_are_taken() {
    for good in ["127.0.0.1:0", "127.8.8.8:99", "[::1]:4000", "localhost:7"] {
        assert!(good.parse::<ControlAddress>().is_ok(), "{good}");
    }
    for (bad, part) in [("0.0.0.0:0", "not a loopback"), ("192.168.1.2:5", "not a loopback"), ("[::]:0", "not a")] {
        let error = bad.parse::<ControlAddress>().expect_err(bad);
        assert!(error.contains(part), "{bad}: {error}");
    }
    for bad in ["", "127.0.0.1", "localhost:port", "example.org:1"] {
        assert!(bad.parse::<ControlAddress>().expect_err(bad).contains("such as 127.0.0.1:0"), "{bad}");
    }
}

/// Returns a server's socket and a client's stream.
fn connected() -> (LineSocket, TcpStream) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let client = TcpStream::connect(listener.local_addr().expect("bound")).expect("a listener");
    (LineSocket::new(listener.accept().expect("a client").0).expect("options"), client)
}

#[test]
fn lines_of_any_length_and_bytes_are_distinguished() {
    let (mut socket, mut client) = connected();
    let longest = "x".repeat(LINE_BYTES_MAX);
    let mut sent = b"one\n\r\n  two\r\n\xff\xfe\x00\n".to_vec();
    sent.extend_from_slice(longest.as_bytes());
    sent.extend_from_slice(b"\n");
    sent.extend_from_slice("y".repeat(LINE_BYTES_MAX + 1).as_bytes());
    sent.extend_from_slice(b"\n");
    sent.extend_from_slice("z".repeat(5 * LINE_BYTES_MAX).as_bytes());
    sent.extend_from_slice(b"\nlast\nunfinished");
    let writer = std::thread::Builder::new().name("client".into()).spawn(move || client.write_all(&sent).is_ok());
    let stop = AtomicBool::new(false);
    let mut next = || socket.read_line(&|| stop.load(Ordering::SeqCst));
    assert_eq!(next(), Incoming::Line("one".into()));
    assert_eq!(next(), Incoming::Line("two".into()), "empty lines ask for nothing");
    assert!(matches!(next(), Incoming::Unusable(why) if why.contains("UTF-8")));
    assert_eq!(next(), Incoming::Line(longest), "the longest line that is allowed");
    for _ in 0..2 {
        assert!(matches!(next(), Incoming::Unusable(why) if why.contains("longer than 65536 bytes")));
    }
    assert_eq!(next(), Incoming::Line("last".into()));
    assert_eq!(next(), Incoming::Gone, "half a line is none");
    assert!(writer.expect("a thread").join().expect("no panic"), "everything was taken");
}

#[test]
fn ctrl_c_ends_a_wait() {
    let (mut socket, _client) = connected();
    assert_eq!(socket.read_line(&|| true), Incoming::Stopped);
}

/// Sends a byte every few milliseconds, and no line, until `is_over`.
fn drip(mut client: TcpStream, is_over: std::sync::Arc<AtomicBool>) -> std::thread::JoinHandle<()> {
    let thread = std::thread::Builder::new().name("client".into());
    let dripping = thread.spawn(move || {
        while !is_over.load(Ordering::SeqCst) && client.write_all(b"a").is_ok() {
            std::thread::sleep(core::time::Duration::from_millis(5));
        }
    });
    dripping.unwrap()
}

#[test]
fn bytes_without_a_line_keep_no_client_waiting() {
    let (mut socket, client) = connected();
    let is_over = std::sync::Arc::new(AtomicBool::new(false));
    let dripping = drip(client, is_over.clone());
    assert_eq!(socket.read_line(&|| true), Incoming::Stopped, "the run has ended");
    assert_eq!(socket.look(), None);
    is_over.store(true, Ordering::SeqCst);
    dripping.join().unwrap();
}

#[test]
fn the_owner_is_admitted_beside_a_client_that_sends_bytes_without_a_line() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let address = listener.local_addr().unwrap();
    let (token, is_over) = (Token::random().unwrap(), std::sync::Arc::new(AtomicBool::new(false)));
    let dripping = drip(TcpStream::connect(address).unwrap(), is_over.clone());
    let mut owner = TcpStream::connect(address).unwrap();
    owner.write_all(format!("{{\"request\": \"hello\", \"token\": \"{token}\", \"id\": 7}}\n").as_bytes()).unwrap();
    let mut refusals = ControlRefusals::new();
    let admitted = admit(&listener, &token, &AtomicBool::new(false), &mut refusals).expect("the owner");
    assert_eq!((admitted.id, refusals.get("gave_way")), (Some(json!(7)), Some(&1)));
    is_over.store(true, Ordering::SeqCst);
    dripping.join().unwrap();
}
