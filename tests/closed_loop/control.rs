//! Tests the control socket as a client uses it: stepping has the bits of running, injected faults appear in the
//! report, an invalid line is answered with its error and changes nothing, and a client that disconnects ends the run
//! cleanly.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

/// A short run of the small tracker from an attitude near the target.
const SHORT: [&str; 8] = [
    "duration_s=4.0",
    "expect.window_s=1.0",
    "bench.camera=../cameras/small_tracker.toml",
    "initial.attitude=given",
    "initial.ra_deg=84.0",
    "initial.dec_deg=-1.2",
    "initial.roll_deg=0.0",
    "initial.rate_deg_s=[0.01, -0.02, 0.01]",
];

fn command(arguments: &[&str]) -> Command {
    command_on("virtual", arguments)
}

fn command_on(clock: &str, arguments: &[&str]) -> Command {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/scenarios/acquisition.toml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_starloop"));
    command.arg("run").arg(scenario).args(["--clock", clock, "--quiet", "--json"]);
    command.args(SHORT.iter().flat_map(|setting| ["--set", setting])).args(arguments);
    command
}

/// Returns the report on standard output.
fn report(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&output.stderr)))
}

/// Returns the parts of a report that depend on the bits of a run.
fn bits(report: &Value) -> Value {
    let mut bits = report.clone();
    // The schema is that of a file or a line for programs, which the socket is not.
    for of_the_machine in ["wall_s", "speed", "machine", "schema"] {
        bits.as_object_mut().unwrap().remove(of_the_machine);
    }
    bits
}

/// A program that waits for the client with its token.
struct Waiting {
    child: Child,
    address: String,
    token: String,
    token_file: PathBuf,
    /// Its runtime folder, which contains the token.
    _runtime: tempfile::TempDir,
}

impl Waiting {
    fn start(arguments: &[&str]) -> Self {
        Self::start_on("virtual", arguments)
    }

    fn start_on(clock: &str, arguments: &[&str]) -> Self {
        let mut command = command_on(clock, &["--control", "127.0.0.1:0"]);
        command.args(arguments);
        Self::spawn(command)
    }

    fn spawn(mut command: Command) -> Self {
        let runtime = tempfile::tempdir().unwrap();
        let mut child = command
            .env("XDG_RUNTIME_DIR", runtime.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let [listening, secret] = [next_line(&mut child), next_line(&mut child)];
        let address = listening.strip_prefix("control: listening on ").unwrap_or_else(|| panic!("{listening}"));
        let secret = secret.strip_prefix("control: token ").unwrap_or_else(|| panic!("{secret}"));
        let (token, file) = secret.split_once(", also in ").unwrap_or_else(|| panic!("{secret}"));
        let (address, token, token_file) = (address.to_owned(), token.to_owned(), file.into());
        Self { child, address, token, token_file, _runtime: runtime }
    }

    /// Sends these bytes, and returns everything until the program closes the connection.
    fn answer(&self, bytes: &[u8]) -> String {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        let _the_rest_may_find_it_closed = stream.write_all(bytes);
        let mut said = Vec::new();
        match stream.read_to_end(&mut said) {
            Ok(_) => {}
            Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::ConnectionReset, "{error}"),
        }
        String::from_utf8(said).unwrap()
    }

    /// Connects as the client with the token.
    fn admitted(self) -> Stepped {
        let stream = TcpStream::connect(&self.address).unwrap();
        let replies = BufReader::new(stream.try_clone().unwrap());
        let mut stepped = Stepped { stream, replies, token: self.token, child: self.child, _runtime: self._runtime };
        let hello = json!({ "request": "hello", "token": stepped.token });
        stepped.answered(hello);
        stepped
    }
}

/// Returns the next line on standard error, read byte by byte, so that nothing after it is taken away from `wait`.
fn next_line(child: &mut Child) -> String {
    let (mut line, mut byte) = (Vec::new(), [0]);
    let stderr = child.stderr.as_mut().unwrap();
    while stderr.read(&mut byte).unwrap() == 1 && byte[0] != b'\n' {
        line.push(byte[0]);
    }
    String::from_utf8(line).unwrap()
}

/// A program under control, and its client's end.
struct Stepped {
    child: Child,
    stream: TcpStream,
    replies: BufReader<TcpStream>,
    token: String,
    _runtime: tempfile::TempDir,
}

impl Stepped {
    fn start(arguments: &[&str]) -> Self {
        Waiting::start(arguments).admitted()
    }

    fn send(&mut self, line: &[u8]) -> Value {
        self.stream.write_all(line).unwrap();
        self.stream.write_all(b"\n").unwrap();
        let mut reply = String::new();
        self.replies.read_line(&mut reply).unwrap();
        serde_json::from_str(&reply).unwrap_or_else(|error| panic!("{error}: {reply}"))
    }

    fn ask(&mut self, request: &Value) -> Value {
        self.send(request.to_string().as_bytes())
    }

    /// Sends a request that must succeed, and returns the answer.
    fn answered(&mut self, request: Value) -> Value {
        let reply = self.ask(&request);
        assert_eq!(reply["ok"], true, "{request}: {reply}");
        reply
    }

    /// Sends a line that must be refused, and returns the reason.
    fn refused(&mut self, line: &[u8]) -> String {
        let reply = self.send(line);
        assert_eq!(reply["ok"], false, "{}: {reply}", String::from_utf8_lossy(&line[..line.len().min(80)]));
        reply["error"].as_str().unwrap().to_owned()
    }

    /// Ends the run; returns the final reply and the program's output.
    fn finish(mut self) -> (Value, Output) {
        let reply = self.answered(json!({ "request": "finish" }));
        (reply, self.child.wait_with_output().unwrap())
    }
}

#[test]
fn a_run_in_steps_has_the_bits_of_the_run_in_one() {
    let through = report(&command(&[]).output().unwrap());
    step_oddly(&[], &through);
    let other = report(&command(&["--seed", "2"]).output().unwrap());
    assert_ne!(other["frames_crc32"], through["frames_crc32"], "control: another seed has other bits");
    assert_ne!(other["telemetry_crc32"], through["telemetry_crc32"], "control");
}

/// Tests a run that is over before the last frame's period, with torques that start between the spacecraft's steps and
/// frames that are late, dropped and doubled: neither the end nor reading the truth in between changes anything.
#[test]
fn steps_do_not_shift_what_falls_between_them() {
    let faults = "event=[{ at_s = 1.0, do = \"frame_late\", late_ms = 333.3, for_s = 0.5 }, \
                  { at_s = 2.0, do = \"frame_drop\", for_s = 0.2 }, \
                  { at_s = 3.75, do = \"frame_late\", late_ms = 70.7, for_s = 1.0 }]";
    for event in [faults, "event=[{ at_s = 3.75, do = \"frame_drop\", for_s = 1.0 }]"] {
        let exposure = "bench.camera.exposure.exposure_s=0.03";
        let arguments = ["--set", exposure, "--set", "control.delay_ms=33.37", "--set", event];
        step_oddly(&arguments, &report(&command(&arguments).output().unwrap()));
    }
}

/// Steps to the end in odd lengths, queries everything in between, and compares the reports with the run in one piece.
fn step_oddly(arguments: &[&str], through: &Value) {
    let mut stepped = Stepped::start(arguments);
    let hello = stepped.answered(json!({ "id": 7, "request": "hello" }));
    assert_eq!((&hello["id"], &hello["protocol"]), (&json!(7), &json!(2)));
    assert_eq!((&hello["width"], &hello["frames"], &hello["seed"]), (&json!(256), &json!(40), &json!(1)));
    // Odd lengths: between the events, on them, and across several frames.
    let mut steps = [0.013, 0.1, 0.000_001, 0.251_3, 0.5, 0.037].iter().cycle();
    while stepped.answered(json!({ "request": "step", "s": steps.next() }))["now_s"].as_f64().unwrap() < 2.0 {
        stepped.answered(json!({ "request": "truth" }));
        stepped.answered(json!({ "request": "estimate" }));
        stepped.answered(json!({ "request": "summary" }));
    }
    let three = stepped.answered(json!({ "request": "step", "frames": 3 }));
    assert!(three["frames_out"].as_u64().unwrap() >= 3, "{three}");
    for until_s in [3.9, 3.95, 3.985, 3.999, 4.0] {
        if stepped.answered(json!({ "request": "step", "until_s": until_s }))["finished"] == true {
            break;
        }
        stepped.answered(json!({ "request": "truth" }));
    }
    assert!(stepped.refused(br#"{"request": "step", "until_s": 4.0}"#).contains("reached its end"));
    let so_far = stepped.answered(json!({ "request": "summary" }));
    let (last, output) = stepped.finish();
    assert_eq!(bits(&report(&output)), bits(through), "stepped and run through");
    assert_eq!(bits(&last["report"]), bits(through), "and reported to the client");
    assert_eq!(so_far["report"]["frames_crc32"], through["frames_crc32"], "the sum so far is the sink's");
    assert_eq!(last["exit_status"].as_i64().map(|code| code as i32), output.status.code());
}

#[test]
fn an_injected_fault_shows_in_frames_and_report() {
    let folder = tempfile::tempdir().unwrap();
    let mut stepped = Stepped::start(&["--out", folder.path().to_str().unwrap()]);
    assert!(stepped.refused(br#"{"request": "frame"}"#).contains("no frame has gone out yet"));
    stepped.answered(json!({ "request": "step", "until_s": 1.05 }));
    let seen = stepped.answered(json!({ "request": "frame" }));
    assert_eq!(seen["faults"], json!([]));
    assert_eq!(seen["pixels_base64_u16_le"].as_str().unwrap().len(), (256 * 256 * 2_usize).div_ceil(3) * 4);
    let event = json!({ "do": "frame_blank", "for_s": 1 });
    let placed = stepped.answered(json!({ "request": "inject", "event": event }));
    assert_eq!((placed["event"].as_str(), placed["from_s"].as_f64()), (Some("frame_blank"), Some(1.05)));
    stepped.answered(json!({ "request": "step", "s": 0.5 }));
    let path = folder.path().join("blank.fits");
    let blank = stepped.answered(json!({ "request": "frame", "path": "blank.fits" }));
    assert_ne!(blank["faults"], json!([]), "the frame says so");
    assert_eq!(std::fs::metadata(&path).unwrap().len(), blank["bytes"].as_u64().unwrap());
    for (path, part) in [("blank.fits", "does not exist yet"), ("../x.fits", "\"..\""), ("/tmp/x.fits", "relative")] {
        let line = json!({ "request": "frame", "path": path }).to_string();
        assert!(stepped.refused(line.as_bytes()).contains(part), "{path}");
    }
    let estimate = stepped.answered(json!({ "request": "estimate" }));
    assert_eq!(estimate["heads"][0]["outcome"], "no_attitude", "and the tracker has seen nothing: {estimate}");
    let so_far = stepped.answered(json!({ "request": "summary" }));
    assert_eq!(so_far["finished"], false);
    assert!(so_far["report"]["faults"][0]["hits"].as_u64().unwrap() >= 4, "{so_far}");
    stepped.answered(json!({ "request": "step", "until_s": 4 }));
    let (last, output) = stepped.finish();
    let fault = &last["report"]["faults"][0];
    assert_eq!((fault["name"].as_str(), fault["hits"].as_u64()), (Some("frame_blank"), Some(10)), "{fault}");
    assert_eq!(last["report"]["violations"], 0, "{last}");
    assert_eq!(bits(&report(&output)), bits(&last["report"]));
}

/// The optics of a defocus that is over are replaced for the next one, in the same memory.
#[test]
fn a_second_injected_defocus_is_that_of_the_file() {
    let defocus = |sigma_px: f64| json!({ "do": "defocus_step", "sigma_px": sigma_px, "for_s": 0.4 });
    let pixels = |arguments: &[&str], second: Option<f64>| {
        let mut stepped = Stepped::start(arguments);
        stepped.answered(json!({ "request": "step", "until_s": 1.05 }));
        stepped.answered(json!({ "request": "inject", "event": defocus(3.0) }));
        stepped.answered(json!({ "request": "step", "until_s": 2.0 }));
        if let Some(sigma_px) = second {
            stepped.answered(json!({ "request": "inject", "event": defocus(sigma_px) }));
        }
        stepped.answered(json!({ "request": "step", "until_s": 2.3 }));
        let seen = stepped.answered(json!({ "request": "frame" }));
        let _ = stepped.finish();
        seen["pixels_base64_u16_le"].as_str().unwrap().to_owned()
    };
    let in_file = ["--set", "event=[{ do = \"defocus_step\", sigma_px = 1.5, at_s = 2.0, for_s = 0.4 }]"];
    let of_file = pixels(&in_file, None);
    assert!(pixels(&[], Some(1.5)) == of_file, "other optics than those made before the run");
    assert!(pixels(&[], Some(1.6)) != of_file && pixels(&[], None) != of_file, "control: another defocus, and none");
}

#[test]
fn a_client_without_the_token_changes_nothing_and_is_counted() {
    let through = report(&command(&[]).output().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let waiting = Waiting::start(&["--out", folder.path().to_str().unwrap()]);
    let body = "{\"request\":\"step\",\"frames\":1}\n{\"request\":\"frame\",\"path\":\"page.fits\"}\n{\"request\":\"finish\"}\n";
    let head = "POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: text/plain\r\n\r\n";
    let hello = |token: &str| format!("{{\"id\":9,\"request\":\"hello\",\"token\":\"{token}\"}}\n{body}");
    let wrong = "0".repeat(32);
    for (bytes, part) in [
        (format!("{head}{body}"), "wanted lines of JSON"),
        (format!("\r\n\r\nhost: x\r\n\r\n{body}"), "wanted lines of JSON"),
        (format!("{head}{}", hello(&waiting.token)), "wanted lines of JSON"),
        ("\u{16}\u{3}\u{1}\n".into(), "wanted lines of JSON"),
        (body.into(), "the first request is not hello"),
        (format!("{{\"request\":\"hello\"}}\n{body}"), "token is missing"),
        (hello(&wrong), "not that of this run"),
        (format!("nonsense\n{}", hello(&waiting.token)), "not JSON"),
    ] {
        let said = waiting.answer(bytes.as_bytes());
        // A connection closed with bytes unread is reset, and the answer may be lost with it: one line or none.
        assert!(said.lines().count() <= 1 && said.lines().all(|line| line.contains(part)), "{bytes}: {said}");
        assert!(!said.contains(&waiting.token), "{said}");
    }
    assert_eq!(std::fs::read_to_string(&waiting.token_file).unwrap(), format!("{}\n", waiting.token));
    let token_file = waiting.token_file.clone();
    let mut stepped = waiting.admitted();
    let hello = stepped.answered(json!({ "request": "hello" }));
    // A run starts a second before its first exposure.
    assert_eq!((&hello["now_s"], folder.path().join("page.fits").exists()), (&json!(-1.0), false), "{hello}");
    let again = stepped.refused(format!("{{\"request\":\"hello\",\"token\":\"{wrong}\"}}").as_bytes());
    assert!(again.contains("not that of this run"), "{again}");
    stepped.answered(json!({ "request": "step", "until_s": 4.0 }));
    let (last, output) = stepped.finish();
    let wanted = json!({ "http_request": 3, "malformed_lines": 1, "no_hello": 1, "no_token": 1,
        "tls_handshake": 1, "wrong_token": 1 });
    assert_eq!((&last["report"]["control_refusals"], &report(&output)["control_refusals"]), (&wanted, &wanted));
    let mut bits = bits(&last["report"]);
    bits.as_object_mut().unwrap().remove("control_refusals");
    assert_eq!(bits["frames_crc32"], through["frames_crc32"], "and nothing has changed");
    assert!(!token_file.exists(), "removed at the end");
}

#[test]
fn silent_connection_is_replaced_by_the_client() {
    let waiting = Waiting::start(&[]);
    let idle = TcpStream::connect(&waiting.address).unwrap();
    let mut stepped = waiting.admitted();
    stepped.answered(json!({ "request": "step", "until_s": 4.0 }));
    let (last, _) = stepped.finish();
    assert_eq!(last["report"]["control_refusals"], json!({ "gave_way": 1 }));
    drop(idle);
}

#[test]
fn a_control_client_that_turns_to_http_is_hung_up_on() {
    let mut stepped = Stepped::start(&[]);
    let error = stepped.refused(b"POST / HTTP/1.1");
    assert!(error.contains("the connection is closed"), "{error}");
    let output = stepped.child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(report(&output)["control_refusals"], json!({ "http_request": 1 }));
}

#[test]
fn triggers_go_over_the_bus_and_show_in_the_report() {
    let mut stepped = Stepped::start(&[]);
    // Faults that wait for these numbers, each of negligible length; nothing waits for 9.
    for number in [3, 4, 65_535] {
        let event = json!({ "on_trigger": number, "for_s": 0.01, "do": "frame_blank" });
        stepped.answered(json!({ "request": "inject", "event": event }));
    }
    stepped.answered(json!({ "request": "step", "until_s": 1.0 }));
    for trigger in [
        json!({ "number": 3 }),
        json!({ "number": 65_535, "at_s": 2.25 }),
        json!({ "number": 4, "at_s": 0.5 }),
        json!({ "number": 9 }),
    ] {
        let mut request = trigger;
        request["request"] = "trigger".into();
        let reported = stepped.answered(request.clone());
        assert_eq!(reported["number"], request["number"]);
    }
    let far = stepped.refused(br#"{"request": "trigger", "number": 3, "at_s": 3602}"#);
    assert!(far.contains("wanted within an hour"), "{far}");
    let events = |stepped: &mut Stepped, until_s: f64| {
        stepped.answered(json!({ "request": "step", "until_s": until_s }));
        let report = stepped.answered(json!({ "request": "summary" }))["report"].clone();
        ["trigger_taken", "trigger_late", "trigger_fired", "trigger_refused"]
            .map(|name| report["events"][name].as_u64().unwrap_or(0))
    };
    assert_eq!(events(&mut stepped, 2.0), [2, 1, 2, 1], "the second waits, the last is refused");
    assert_eq!(events(&mut stepped, 2.5), [2, 1, 3, 1]);
    let _ = stepped.finish();
}

#[test]
fn truth_and_estimate_are_near_each_other_and_move_with_the_rate() {
    let mut stepped = Stepped::start(&[]);
    stepped.answered(json!({ "request": "step", "until_s": 3.0 }));
    let quaternion =
        |reply: &Value| -> [f64; 4] { core::array::from_fn(|i| reply["sensor_from_icrf"][i].as_f64().unwrap()) };
    // Half the angle between two attitudes: the scalar part of one over the other.
    let angle_rad = |a: [f64; 4], b: [f64; 4]| {
        let distance = |sign: f64| (0..4).map(|i| (a[i] - sign * b[i]).powi(2)).sum::<f64>().sqrt();
        4.0 * (0.5 * distance(1.0).min(distance(-1.0))).asin()
    };
    let estimate = stepped.answered(json!({ "request": "estimate" }));
    let now = stepped.answered(json!({ "request": "truth", "at_s": estimate["at_s"] }));
    let error_arcsec = angle_rad(quaternion(&now), quaternion(&estimate["estimate"])).to_degrees() * 3600.0;
    assert!(error_arcsec < 30.0, "a tracker knows better than {error_arcsec} arcsec: {estimate}");
    let before = stepped.answered(json!({ "request": "truth", "at_s": now["at_s"].as_f64().unwrap() - 0.1 }));
    let rate = |i: usize| now["body_rate_rad_s"][i].as_f64().unwrap();
    let turned = 0.1 * (rate(0).powi(2) + rate(1).powi(2) + rate(2).powi(2)).sqrt();
    let moved = angle_rad(quaternion(&now), quaternion(&before));
    // The rate changes by the control's torque over its inertia: well below 1 mrad/s^2 over 0.1 s.
    assert!((moved - turned).abs() < 1e-5, "{moved} rad moved, {turned} rad by the rate");
    let wheels = now["wheel_speeds_rad_s"].as_array().unwrap().len();
    assert!(wheels >= 3, "{wheels} wheels");
    for (at_s, part) in [(0.5, "the last two seconds"), (3.5, "not after now")] {
        let line = json!({ "request": "truth", "at_s": at_s }).to_string();
        assert!(stepped.refused(line.as_bytes()).contains(part));
    }
    let _ = stepped.finish();
}

#[test]
fn wrong_lines_are_refused_in_words_and_the_session_goes_on() {
    let through = report(&command(&[]).output().unwrap());
    let mut stepped = Stepped::start(&[]);
    let huge = vec![b'x'; 200_000];
    let cases: [(&[u8], &str); 17] = [
        (b"this is not JSON", "not JSON"),
        (b"\xff\x00\xfe\x80garbage", "not UTF-8"),
        (&huge, "longer than 65536 bytes"),
        (b"[]", "the line is a list"),
        (br#"{"request": "explode"}"#, "wanted one of: hello"),
        (br#"{"request": "step", "s": -1}"#, "wanted seconds above 0"),
        (br#"{"request": "step", "s": "soon"}"#, "wanted a number"),
        (br#"{"request": "step", "s": 1e300}"#, "past the end"),
        (br#"{"request": "step", "until_s": 4.5}"#, "past the end"),
        (br#"{"request": "step", "until_s": -50}"#, "wanted a time after now"),
        (br#"{"request": "step", "frames": 41}"#, "at most the 40"),
        (br#"{"request": "frame", "head": 1}"#, "there are 1"),
        (br#"{"request": "inject", "event": {"do": "bus_los", "for_s": 1}}"#, "did you mean \"bus_loss\""),
        (br#"{"request": "inject", "event": {"do": "safe", "why": 1}}"#, "unknown key `why`"),
        (br#"{"request": "inject", "event": {"do": "bus_loss", "for_s": 1, "share": 2}}"#, "0 to 1"),
        (br#"{"request": "inject", "event": {"do": "wheel_failure", "wheel": 9}}"#, "wheel 9"),
        (br#"{"request": "inject", "event": {"do": "safe", "at_s": null}}"#, "injected event"),
    ];
    for (line, part) in cases {
        let error = stepped.refused(line);
        assert!(error.contains(part), "no \"{part}\" in: {error}");
    }
    stepped.answered(json!({ "request": "step", "until_s": 4.0 }));
    assert!(stepped.refused(br#"{"request": "step", "s": 0.1}"#).contains("reached its end"));
    let (last, _) = stepped.finish();
    assert_eq!(bits(&last["report"]), bits(&through), "what was refused has changed nothing");
}

#[test]
fn disconnected_client_ends_the_run_with_finished_output() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let mut stepped = Stepped::start(&["--sink", "recorder", "--out", out.to_str().unwrap()]);
    stepped.answered(json!({ "request": "step", "frames": 5 }));
    let Stepped { child, stream, replies, .. } = stepped;
    drop((stream, replies));
    let output = child.wait_with_output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("the control client went away at 0.52"), "{error}");
    for number in 0..5 {
        assert!(out.join(format!("frame_{number:06}.fits")).exists(), "frame {number} is whole");
    }
    let kept: Value = serde_json::from_str(&std::fs::read_to_string(out.join("scenario.json")).unwrap()).unwrap();
    assert_eq!((&kept["frames"]["delivered"], &kept["violations"]), (&json!(5), &json!(0)), "{kept}");
}

#[test]
fn other_addresses_are_refused() {
    for (address, part) in [("0.0.0.0:0", "not a loopback address"), ("127.0.0.1", "such as 127.0.0.1:0")] {
        let output = command(&["--control", address]).output().unwrap();
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn a_bench_is_stepped_as_a_scenario_is() {
    let mut bench = Command::new(env!("CARGO_BIN_EXE_starloop"));
    let fixed = ["run", "--clock", "virtual", "--duration", "1", "--sink", "null", "--quiet", "--json"];
    bench.args(fixed).args(["--backend", "cpu", "--control", "127.0.0.1:0"]);
    let mut stepped = Waiting::spawn(bench).admitted();
    stepped.answered(json!({ "request": "step", "frames": 2 }));
    assert!(stepped.refused(br#"{"request": "truth"}"#).contains("nothing is flown inside"));
    let aboard = br#"{"request": "inject", "event": {"do": "gyro_dropout", "for_s": 1.0}}"#;
    assert!(stepped.refused(aboard).contains("nothing is flown"), "no gyro could fail");
    stepped.answered(json!({ "request": "inject", "event": { "do": "frame_blank", "for_s": 0.3 } }));
    stepped.answered(json!({ "request": "step", "until_s": 0.75 }));
    assert_eq!(stepped.answered(json!({ "request": "state" }))["frames"]["delivered"], 6);
    let (last, output) = stepped.finish();
    assert_eq!(last["report"]["faults"][0]["name"], "frame_blank");
    assert!(last["report"]["faults"][0]["hits"].as_u64().unwrap() >= 2, "{last}");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Tests that on the real clock everything works during the run except stepping.
#[test]
fn a_run_on_the_real_clock_is_watched_and_steered() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["--out", folder.path().to_str().unwrap(), "--set", "duration_s=60.0"];
    let mut steered = Waiting::start_on("real", &arguments).admitted();
    assert!(steered.refused(br#"{"request": "step", "s": 0.5}"#).contains("--clock virtual"));
    assert!(steered.refused(br#"{"request": "summary"}"#).contains("when the run ends"));
    let delivered =
        |steered: &mut Stepped| steered.answered(json!({ "request": "state" }))["frames"]["rendered"].as_u64().unwrap();
    while delivered(&mut steered) < 3 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let event = json!({ "do": "stray_light", "for_s": 30.0, "e_per_s": 300_000.0 });
    let placed = steered.answered(json!({ "request": "inject", "event": event }));
    assert_eq!(placed["event"], "stray_light");
    assert!(
        steered
            .refused(br#"{"request": "inject", "event": {"do": "frame_drop", "head": 3, "for_s": 1.0}}"#)
            .contains("head 3")
    );
    let before = delivered(&mut steered);
    // Two frames may be in flight when the event is placed.
    while delivered(&mut steered) < before + 4 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let frame = steered.answered(json!({ "request": "frame" }));
    assert!(frame["faults"].to_string().contains("stray_light"), "{}", frame["faults"]);
    assert!(steered.answered(json!({ "request": "truth" }))["at_s"].as_f64().unwrap() > 0.0);
    assert!(steered.answered(json!({ "request": "estimate" }))["heads"].is_array());
    steered.answered(json!({ "request": "trigger", "number": 9 }));
    let (last, output) = steered.finish();
    let report = report(&output);
    assert_eq!(report["faults"][0]["name"], "stray_light");
    assert!(report["faults"][0]["hits"].as_u64().unwrap() > 0, "{}", report["faults"]);
    assert_eq!(last["report"]["frames"], report["frames"], "the client gets the report that is printed");
    assert_eq!(last["exit_status"].as_i64().map(|code| code as i32), output.status.code());
}

#[test]
fn a_signal_after_the_last_frame_interrupts_nothing() {
    for is_after in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        let mut steered = Waiting::start_on("real", &["--out", folder.path().to_str().unwrap()]).admitted();
        while is_after && steered.answered(json!({ "request": "state" }))["finished"] != true {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        // The program waits for `finish` now, or has begun a moment ago.
        let killed = Command::new("kill").args(["-TERM", &steered.child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        let output = steered.child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!is_after || output.status.code() != Some(143), "{said}");
        assert_eq!(said.contains("stopped by SIGTERM"), !is_after, "{said}");
        let summary = std::fs::read(folder.path().join("summary.json")).unwrap();
        let summary: Value = serde_json::from_slice(&summary).unwrap();
        let reasons = summary["reasons"].to_string();
        assert_eq!(reasons.contains("stopped before its end"), !is_after, "{reasons}");
    }
}
