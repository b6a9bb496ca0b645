//! Tests that a captured run is drawn again to the same bits, on both clocks; that a changed bit, a lost packet and a
//! cut file are reported; and that other programs can read captures.

use link::Packet;
use link::capture::{CaptureFormat, CaptureReader, CaptureWriter, CapturedPacket, Direction};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A run of 20 small frames at 10 Hz that slews, so that no two frames are alike.
const FRAMES: usize = 20;

fn starloop(arguments: &[&str]) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_starloop")).args(arguments).output().unwrap();
    (output.status.code().unwrap(), reported(&output))
}

fn reported(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

fn bench_file() -> String {
    format!("{}/configs/benches/loopback.toml", env!("CARGO_MANIFEST_DIR"))
}

/// Captures a run into `folder/name`.
fn capture(folder: &Path, name: &str, extra: &[&str]) -> PathBuf {
    let directory = folder.join(name);
    let (bench, camera) = (bench_file(), format!("{}/configs/cameras/small_tracker.toml", env!("CARGO_MANIFEST_DIR")));
    let camera = format!("camera={camera}");
    let target = directory.to_str().unwrap();
    let fixed = ["run", &bench, "--set", &camera, "--duration", "2", "--backend", "cpu", "--sink", "null", "--quiet"];
    let (status, text) = starloop(&[&fixed, extra, &["--capture", target][..]].concat());
    // A run that is late by its own settings, or on a busy machine, is captured all the same.
    assert!(status == 0 || status == 6 && text.contains("LATE"), "{status} {text}");
    directory
}

fn replay(directory: &Path, extra: &[&str]) -> (i32, String) {
    starloop(&[&["replay", directory.to_str().unwrap()], extra].concat())
}

fn packets(path: &Path) -> Vec<CapturedPacket> {
    let mut reader = CaptureReader::new(std::fs::File::open(path).unwrap()).unwrap();
    core::iter::from_fn(|| reader.read().unwrap()).collect()
}

fn rewrite(path: &Path, format: CaptureFormat, packets: &[CapturedPacket]) {
    let mut writer = CaptureWriter::new(std::fs::File::create(path).unwrap(), format).unwrap();
    packets.iter().for_each(|packet| writer.write(packet).unwrap());
}

fn rows(directory: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(directory.join("frames.csv")).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

/// Changes the end record of a session.
fn change_end(directory: &Path, change: impl FnOnce(&mut serde_json::Value)) {
    let path = directory.join("session.json");
    let mut session: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    change(&mut session["end"]);
    std::fs::write(&path, session.to_string()).unwrap();
}

/// Returns the index of the attitude record that decides frame 10: the last one that arrived before it.
fn decisive(directory: &Path, packets: &[CapturedPacket]) -> usize {
    let messages: usize = rows(directory)[10][2].parse().unwrap();
    let received = packets.iter().enumerate().filter(|(_, packet)| packet.direction == Direction::Received);
    // On CAN FD each frame is one message, and attitude has 48 bytes.
    let is_attitude = |packet: &CapturedPacket| matches!(packet.packet, Packet::Can(frame) if frame.data().len() == 48);
    received.take(messages).filter(|(_, packet)| is_attitude(packet)).last().unwrap().0
}

#[test]
fn a_run_on_the_virtual_clock_replays_bit_by_bit_in_both_formats_over_serial_and_at_another_node() {
    let folder = tempfile::tempdir().unwrap();
    let link = format!("link={}/configs/links/simulated_serial.toml", env!("CARGO_MANIFEST_DIR"));
    let serial = ["--set", &link];
    let node = ["--set", "link.node=5", "--set", "link.id_base=128", "--set", "session.start=on_run"];
    let long = ["--set", "link.id_bits=29", "--set", "link.id_base=0x18FF0000", "--set", "link.node=5"];
    let long_candump = [&long[..], &["--capture-format", "candump"]].concat();
    for (name, extra) in [
        ("pcapng", &["--capture-format", "pcapng"][..]),
        ("candump", &["--capture-format", "candump"]),
        ("serial", &serial),
        ("node", &node),
        ("29 bits", &long),
        ("29 bits, candump", &long_candump),
    ] {
        let directory = capture(folder.path(), name, &[&["--clock", "virtual"], extra].concat());
        let (status, text) = replay(&directory, &[]);
        assert_eq!(status, 0, "{name}: {text}");
        assert_eq!(text.trim(), format!("{FRAMES} of {FRAMES} frames bit-identical"), "{name}: and no doubt");
        let checksums: Vec<String> = rows(&directory).into_iter().map(|row| row[6].clone()).collect();
        assert!(checksums.windows(2).all(|pair| pair[0] != pair[1]), "the frames differ: {checksums:?}");
    }
}

#[test]
fn a_run_on_the_real_clock_replays_bit_by_bit() {
    let folder = tempfile::tempdir().unwrap();
    let directory = capture(folder.path(), "real", &["--clock", "real", "--set", "timing.deadline_policy=hold"]);
    let (status, text) = replay(&directory, &[]);
    assert_eq!(status, 0, "{text}");
    // A loaded machine may leave frames out; those that went out are compared.
    let delivered = rows(&directory).iter().filter(|row| !row[6].is_empty()).count();
    assert!(delivered > 0 && text.contains(&format!("{delivered} of {delivered} frames bit-identical")), "{text}");
}

#[test]
fn degraded_frames_replay_under_the_load_that_was_written_down() {
    let folder = tempfile::tempdir().unwrap();
    // The planner's time is set below what the frame costs: frames are degraded.
    let extra = ["--clock", "virtual", "--set", "timing.degrade=always", "--set", "camera.exposure.readout_s=0.0003"];
    let directory = capture(folder.path(), "degraded", &extra);
    let degraded = rows(&directory).iter().filter(|row| row[4] != "full").count();
    assert!(degraded > 0, "{:?}", rows(&directory));
    assert_eq!(replay(&directory, &[]).0, 0);
    // On the real clock the load is measured, and reduces the planner's time.
    let extra = ["--clock", "real", "--set", "timing.deadline_policy=late", "--set", "camera.exposure.readout_s=0.001"];
    let directory = capture(folder.path(), "loaded", &extra);
    let (status, text) = replay(&directory, &[]);
    assert_eq!(status, 0, "{text} {:?}", rows(&directory));
}

#[test]
fn a_bit_a_packet_and_a_tail_that_are_not_as_captured_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let directory = capture(folder.path(), "run", &["--clock", "virtual"]);
    let bus = directory.join("bus.pcapng");
    let whole = packets(&bus);
    let place = decisive(&directory, &whole);
    // A fifth of a second of attitudes: a single missing one is interpolated to 1e-5 arcsec, which may change no pixel.
    let is_decisive = |(number, packet): (usize, &CapturedPacket)| {
        let is_attitude = matches!(packet.packet, Packet::Can(frame) if frame.data().len() == 48);
        is_attitude && (place - 24..=place).contains(&number)
    };

    // One bit of the quaternion's first number: the records' own checksums refuse them.
    let mut changed = whole.clone();
    for (number, packet) in whole.iter().enumerate().filter(|(number, packet)| is_decisive((*number, packet))) {
        let Packet::Can(frame) = packet.packet else { panic!("CAN") };
        let mut data = frame.data().to_vec();
        data[8] ^= 1;
        changed[number].packet = Packet::Can(firmware_protocol::can::CanFrame::fd(frame.id(), &data).unwrap());
    }
    rewrite(&bus, CaptureFormat::Pcapng, &changed);
    let (status, text) = replay(&directory, &[]);
    assert_eq!(status, 4, "{text}");
    assert!(
        ["frame 8,", "frame 9,", "frame 10,"].iter().any(|frame| text.contains(&format!("is not: {frame}"))),
        "{text}"
    );

    // The packets are missing.
    let kept = whole.iter().enumerate().filter(|(number, packet)| !is_decisive((*number, packet)));
    let missing: Vec<CapturedPacket> = kept.map(|(_, packet)| *packet).collect();
    assert!(missing.len() < whole.len() - 10, "{} of {}", missing.len(), whole.len());
    rewrite(&bus, CaptureFormat::Pcapng, &missing);
    let session = std::fs::read(directory.join("session.json")).unwrap();
    change_end(&directory, |end| end["packets"] = missing.len().into());
    let (status, text) = replay(&directory, &[]);
    assert_eq!(status, 4, "also when the end record agrees: {text}");
    std::fs::write(directory.join("session.json"), &session).unwrap();

    // Stamps are off by a millisecond: time marks come from stamps.
    let mut shifted = whole.clone();
    for packet in &mut shifted[..place] {
        packet.at = packet.at + base::time::Span::from_ms(1);
    }
    rewrite(&bus, CaptureFormat::Pcapng, &shifted);
    assert_eq!(replay(&directory, &[]).0, 4, "stamps count");

    // The file was cut off in the middle of a block.
    rewrite(&bus, CaptureFormat::Pcapng, &whole);
    let bytes = std::fs::read(&bus).unwrap();
    std::fs::write(&bus, &bytes[..bytes.len() / 2 + 1]).unwrap();
    let (status, text) = replay(&directory, &[]);
    assert!(status == 1 && text.contains("bus.pcapng: capture is cut off at byte "), "{text}");
    // A run that was killed has no end record: the existing part is replayed.
    change_end(&directory, |end| *end = serde_json::Value::Null);
    let (status, text) = replay(&directory, &[]);
    assert!(status == 4 && text.contains("cut off at byte ") && text.contains("the capture holds"), "{text}");
    std::fs::write(directory.join("session.json"), &session).unwrap();

    // The original replays again.
    rewrite(&bus, CaptureFormat::Pcapng, &whole);
    assert_eq!(replay(&directory, &[]).0, 0);
}

#[test]
fn capture_that_is_shorter_than_its_end_record_states_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (format, bus) in [("pcapng", "bus.pcapng"), ("candump", "bus.log")] {
        let directory = capture(folder.path(), format, &["--clock", "virtual", "--capture-format", format]);
        let (bus, frames) = (directory.join(bus), directory.join("frames.csv"));
        let (whole_bus, whole_rows) = (std::fs::read(&bus).unwrap(), std::fs::read_to_string(&frames).unwrap());
        let lines: Vec<&str> = whole_rows.split_inclusive('\n').collect();
        let without = |range: core::ops::Range<usize>| {
            let kept = lines.iter().enumerate().filter(|(number, _)| !range.contains(number));
            kept.map(|(_, line)| *line).collect::<String>()
        };
        // Without its last byte the last line is cut off; all others end where a line ends.
        let cut_in_a_line = whole_rows[..whole_rows.len() - 1].to_owned();
        for (what, rows) in [
            ("the last rows", without(8..lines.len())),
            ("a row in the middle", without(9..10)),
            ("the first row", without(1..2)),
            ("all rows", without(1..lines.len())),
            ("half a row", cut_in_a_line),
        ] {
            std::fs::write(&frames, rows).unwrap();
            let (status, text) = replay(&directory, &[]);
            assert!(status == 1 && text.contains("frames.csv: holds "), "{what}: {text}");
            assert!(text.contains(&format!(" rows, wanted {FRAMES} as its end record")), "{what}: {text}");
        }
        // The same number of rows, but not the same frames.
        let last = lines[FRAMES].replacen(&format!("{}", FRAMES - 1), "77", 1);
        std::fs::write(&frames, format!("{}{last}", without(FRAMES..FRAMES + 1))).unwrap();
        let (status, text) = replay(&directory, &[]);
        assert!(status == 1 && text.contains("the last frame's number"), "{text}");
        std::fs::write(&frames, &whole_rows).unwrap();

        let kind = if format == "pcapng" { CaptureFormat::Pcapng } else { CaptureFormat::Candump };
        let all = packets(&bus);
        let mut fewer = all.clone();
        let _ = fewer.remove(all.len() / 2);
        for (what, left) in [("the last packets", &all[..all.len() - 7]), ("one in the middle", &fewer)] {
            rewrite(&bus, kind, left);
            let (status, text) = replay(&directory, &[]);
            let wanted = format!("holds {} packets, wanted {}", left.len(), all.len());
            assert!(status == 1 && text.contains(&wanted), "{format}, {what}: {text}");
        }
        std::fs::write(&bus, &whole_bus).unwrap();
        let (status, text) = replay(&directory, &[]);
        assert_eq!(
            (status, text.trim()),
            (0, format!("{FRAMES} of {FRAMES} frames bit-identical").as_str()),
            "control"
        );

        // As captured by a version that did not count rows.
        change_end(&directory, |end| drop(end.as_object_mut().unwrap().remove("counted")));
        let (status, text) = replay(&directory, &[]);
        assert!(status == 0 && text.contains("whether frames.csv is complete cannot be checked"), "{text}");
    }
}

#[test]
fn some_frames_are_replayed_and_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let directory = capture(folder.path(), "run", &["--clock", "virtual"]);
    let out = folder.path().join("out");
    let (status, text) = replay(&directory, &["--frames", "5..8", "--out", out.to_str().unwrap()]);
    assert_eq!((status, text.trim()), (0, "3 of 3 frames bit-identical"));
    let files = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut images: Vec<String> = files.filter(|name| name.ends_with(".fits")).collect();
    images.sort();
    assert_eq!(images, ["frame_000005.fits", "frame_000006.fits", "frame_000007.fits"]);
    assert_eq!(replay(&directory, &["--frames", "8..5"]).0, 2);
}

/// Captures one second of a run file of the repository, on the virtual clock.
fn capture_file(folder: &Path, file: &str, settings: &[&str]) -> PathBuf {
    let directory = folder.join("capture");
    let file = format!("{}/configs/{file}", env!("CARGO_MANIFEST_DIR"));
    let (fixed, target) = (["--clock", "virtual", "--backend", "cpu", "--sink", "null", "--quiet"], ["--capture"]);
    let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", setting]).collect();
    let (status, text) =
        starloop(&[&["run", &file], &fixed[..], &settings, &target, &[directory.to_str().unwrap()]].concat());
    assert!(directory.join("session.json").exists() && status != 1, "{text}");
    directory
}

#[test]
fn three_heads_are_replayed_together_alone_and_into_folders() {
    let folder = tempfile::tempdir().unwrap();
    let camera = format!("camera={}/configs/cameras/small_tracker.toml", env!("CARGO_MANIFEST_DIR"));
    let directory = capture_file(folder.path(), "benches/three_heads.toml", &[&camera, "timing.duration_s=1.0"]);
    let out = folder.path().join("out");
    let (status, text) = replay(&directory, &["--out", out.to_str().unwrap()]);
    assert_eq!((status, text.trim()), (0, "3 heads, 30 of 30 frames bit-identical"));
    for head in 0..3 {
        let files = std::fs::read_dir(out.join(format!("head{head}"))).unwrap();
        let names = files.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        assert_eq!(names.filter(|name| name.ends_with(".fits")).count(), 10, "head {head}");
    }
    let (status, text) = replay(&directory, &["--head", "2"]);
    assert_eq!((status, text.trim()), (0, "10 of 10 frames bit-identical"));
    let (status, text) = replay(&directory, &["--head", "3"]);
    assert!(status == 2 && text.contains("--head 3: the run has 3; wanted a number from 0 to 2"), "{text}");

    // One wrong checksum is found, with its head.
    let frames = directory.join("frames.csv");
    let whole = std::fs::read_to_string(&frames).unwrap();
    let line = whole.lines().find(|line| line.starts_with("4,1,")).unwrap();
    let row = line.strip_suffix(',').unwrap();
    let wrong = format!("{}{},", &row[..row.len() - 1], if row.ends_with('0') { '1' } else { '0' });
    std::fs::write(&frames, whole.replace(line, &wrong)).unwrap();
    let (status, text) = replay(&directory, &[]);
    assert!(status == 4 && text.contains("3 heads, 29 of 30 frames bit-identical"), "{text}");
    assert!(text.contains("the first that is not: head 1, frame 4, CRC-32"), "{text}");
}

/// Writes a bench whose attitude, orbit and jitter are files, and these files.
fn bench_of_files(folder: &Path) -> PathBuf {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let turn = |row: i32| {
        let half = 0.0005 * f64::from(row);
        format!("{},{},{},0,0\n", 0.5 * f64::from(row), half.cos(), -half.sin())
    };
    write("slew.csv", &format!("t_s,q_w,q_x,q_y,q_z\n{}", (0..8).map(turn).collect::<String>()));
    let state = |row: i32| {
        let (sin, cos) = (0.0011 * f64::from(row)).sin_cos();
        format!("2026-03-01T12:00:{row:02}Z,{},{},0,{},{},0\n", 7000.0 * cos, 7000.0 * sin, -7.7 * sin, 7.7 * cos)
    };
    let header = "utc,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n";
    write("orbit.csv", &format!("{header}{}", (0..10).map(state).collect::<String>()));
    let shake = |row: i32| format!("{},{},{}\n", 0.001 * f64::from(row), row % 7 - 3, row % 5 - 2);
    write("shake.csv", &format!("t_s,x_arcsec,y_arcsec\n{}", (0..1000).map(shake).collect::<String>()));
    let camera = format!("{}/configs/cameras/small_tracker.toml", env!("CARGO_MANIFEST_DIR"));
    let text = format!(
        "camera = \"{camera}\"\n[timing]\nframe_rate_hz = 10.0\nduration_s = 2.0\nstart_utc = \"2026-03-01T12:00:00Z\"\n\
         [plant]\nkind = \"file\"\nattitude = \"slew.csv\"\n[observer]\nkind = \"file\"\nfile = \"orbit.csv\"\n\
         [jitter]\nseries = \"shake.csv\"\nat_end = \"repeat\"\n[render]\nbackend = \"cpu\"\n"
    );
    write("lab.toml", &text);
    folder.join("lab.toml")
}

#[test]
fn a_capture_is_replayed_elsewhere_without_the_files_of_attitudes_orbits_and_jitter() {
    let [lab, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (bench, directory) = (bench_of_files(lab.path()), lab.path().join("capture"));
    let [bench, target] = [&bench, &directory].map(|path| path.to_str().unwrap());
    let fixed = ["run", bench, "--clock", "virtual", "--sink", "null", "--quiet", "--capture", target];
    let (status, text) = starloop(&fixed);
    assert_eq!(status, 0, "{text}");
    let moved = other.path().join("moved");
    std::fs::rename(&directory, &moved).unwrap();
    drop(lab);
    let (status, text) = replay(&moved, &[]);
    assert_eq!((status, text.trim()), (0, "20 of 20 frames bit-identical"));

    let jitter = std::fs::read_dir(moved.join("data")).unwrap().map(|entry| entry.unwrap().path());
    let jitter = jitter.into_iter().find(|path| path.to_str().unwrap().ends_with("shake.csv")).unwrap();
    let whole = std::fs::read_to_string(&jitter).unwrap();
    std::fs::write(&jitter, whole.replacen("0.001,", "0.0010,", 1)).unwrap();
    let (status, text) = replay(&moved, &[]);
    assert!(status == 1 && text.contains("shake.csv") && text.contains("as packed"), "control: {text}");
    std::fs::remove_file(&jitter).unwrap();
    let (status, text) = replay(&moved, &[]);
    assert!(status == 1 && text.contains("shake.csv"), "{text}");
}

#[test]
fn scenario_with_imaging_faults_is_replayed_and_not_without_its_events() {
    let folder = tempfile::tempdir().unwrap();
    // Of the whole list the first three: false stars by a trigger, bits of pixels, stray light.
    let directory = capture_file(folder.path(), "scenarios/imaging_faults.toml", &["duration_s=216.0"]);
    let (status, text) = replay(&directory, &[]);
    assert_eq!((status, text.trim()), (0, "432 of 432 frames bit-identical"));
    let path = directory.join("session.json");
    let session = std::fs::read_to_string(&path).unwrap();
    for (event, frames) in [("mag = 3.5\\ncount = 30", 40), ("bit = 11\\ncount = 20", 40)] {
        assert!(session.contains(event), "{event}");
        std::fs::write(&path, session.replace(event, &event.replace("count = ", "count = 1"))).unwrap();
        let (status, text) = replay(&directory, &[]);
        assert_eq!(status, 4, "{event}: {text}");
        assert!(text.contains(&format!("{} of 432 frames bit-identical", 432 - frames)), "{event}: {text}");
    }
}

#[test]
fn a_capture_of_someone_else_is_drawn_with_a_bench() {
    let folder = tempfile::tempdir().unwrap();
    let directory = capture(folder.path(), "run", &["--clock", "virtual", "--capture-format", "candump"]);
    let log = directory.join("bus.log");
    let log = log.to_str().unwrap();
    let camera = format!("{}/configs/cameras/small_tracker.toml", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(bench_file()).unwrap();
    let bench = folder.path().join("bench.toml");
    let named = text.lines().find(|line| line.starts_with("camera")).unwrap();
    let text = text.replace(named, &format!("camera = \"{camera}\""));
    let links = format!("link = \"{}/configs/links/", env!("CARGO_MANIFEST_DIR"));
    std::fs::write(&bench, text.replace("link = \"../links/", &links)).unwrap();
    let (status, text) = starloop(&["replay", log, "--bench", bench.to_str().unwrap()]);
    assert_eq!(status, 0, "{text}");
    assert!(text.contains(" frames drawn; nothing to compare"), "{text}");
    let drawn: usize = text.split(' ').next().unwrap().parse().unwrap();
    assert!((FRAMES - 2..=FRAMES).contains(&drawn), "the run drew {FRAMES}: {text}");
    for (arguments, wanted, part) in [
        (vec!["replay", log], 1, "wanted --bench FILE"),
        (vec!["replay", directory.to_str().unwrap(), "--bench", bench.to_str().unwrap()], 2, "holds its own bench"),
        (vec!["replay", "/nonexistent", "--bench", bench.to_str().unwrap()], 1, "cannot read the packets"),
        (vec!["replay", bench.to_str().unwrap(), "--bench", bench.to_str().unwrap()], 1, "capture line 1: "),
    ] {
        let (status, text) = starloop(&arguments);
        assert!(status == wanted && text.contains(part), "{arguments:?}: {text}");
    }
}

#[test]
fn a_damaged_directory_is_refused_with_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let directory = capture(folder.path(), "run", &["--clock", "virtual"]);
    let target = directory.to_str().unwrap();
    let (status, text) =
        starloop(&["run", "--clock", "virtual", "--duration", "1", "--sink", "null", "--capture", target]);
    assert!(status == 1 && text.contains("holds a captured run already"), "{text}");
    let keep = |name: &str| std::fs::read_to_string(directory.join(name)).unwrap();
    let (session, frames) = (keep("session.json"), keep("frames.csv"));
    let bad_row = frames.replacen(",full,", ",full;", 1);
    for (name, text, part) in [
        ("session.json", "{", "session.json: EOF"),
        ("session.json", &session.replace("\"form\": 2", "\"form\": 9"), "form 9, wanted 1 or 2"),
        ("session.json", &session.replace("bus.pcapng", "../bus.pcapng"), "without a folder"),
        ("session.json", &session.replace("bus.pcapng", "none.pcapng"), "none.pcapng: cannot read"),
        ("session.json", &session.replace("\"cpu\"", "\"abacus\""), "wanted cpu, gpu or reference"),
        ("frames.csv", "", "frames.csv:1: wanted frame,head,messages"),
        ("frames.csv", &bad_row, "frames.csv:2: wanted eight fields"),
    ] {
        std::fs::write(directory.join(name), text).unwrap();
        let (status, reported) = replay(&directory, &[]);
        assert!(status == 1 && reported.contains(part), "{name}: {reported}");
        std::fs::write(directory.join("session.json"), &session).unwrap();
        std::fs::write(directory.join("frames.csv"), &frames).unwrap();
    }
    // A run that was cut off: no end in its session, one row and one packet fewer.
    let end = session.find("\"end\"").unwrap();
    std::fs::write(directory.join("session.json"), format!("{}\"end\": null\n}}", &session[..end])).unwrap();
    std::fs::write(directory.join("frames.csv"), &frames[..frames.len() - 5]).unwrap();
    let (status, text) = replay(&directory, &[]);
    assert!(status == 0 && text.contains("19 of 19") && text.contains("the run was cut off"), "{text}");
    std::fs::remove_file(directory.join("frames.csv")).unwrap();
    assert!(replay(&directory, &[]).1.contains("frames.csv: cannot read the frames"));
}

/// Runs another program; returns `None`, and prints a line, when it is not installed.
fn tool(program: &str, arguments: &[&str]) -> Option<String> {
    match Command::new(program).args(arguments).output() {
        Ok(output) if output.status.success() => Some(String::from_utf8_lossy(&output.stdout).into_owned()),
        Ok(output) => panic!("{program}: {}", reported(&output)),
        Err(error) => {
            println!("SKIPPED: {program}: {error}");
            None
        }
    }
}

/// Returns the Python that has the packages of `hil_scripts/requirements*.txt`, if it was installed beside the build;
/// else the system's.
fn python() -> String {
    let beside = std::env::current_exe().unwrap().ancestors().nth(3).unwrap().join("python/bin/python3");
    if beside.exists() { beside.to_str().unwrap().into() } else { "python3".into() }
}

#[test]
fn others_read_what_is_captured() {
    let folder = tempfile::tempdir().unwrap();
    let pcapng = capture(folder.path(), "pcapng", &["--clock", "virtual"]).join("bus.pcapng");
    let candump =
        capture(folder.path(), "candump", &["--clock", "virtual", "--capture-format", "candump"]).join("bus.log");
    let wanted = packets(&pcapng);
    assert!(wanted == packets(&candump) && wanted.len() > 200, "{}", wanted.len());
    let seconds = |packet: &CapturedPacket| {
        let ns = packet.at.to_unix_ns();
        format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
    };
    let Packet::Can(first) = wanted[0].packet else { panic!("CAN") };
    let fields = ["-e", "frame.time_epoch", "-e", "can.id", "-e", "can.len", "-e", "frame.packet_flags_direction"];
    let file = pcapng.to_str().unwrap();
    if let Some(text) = tool("tshark", &[&["-r", file, "-T", "fields"][..], &fields].concat()) {
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), wanted.len());
        let direction = if wanted[0].direction == Direction::Received { 1 } else { 2 };
        let line =
            format!("{}\t{}\t{}\t0x{direction:08x}", seconds(&wanted[0]), first.id().number(), first.data().len());
        assert_eq!(lines[0], line);
    }
    if let Some(text) = tool("capinfos", &["-M", "-c", "-E", file]) {
        assert!(text.contains(&wanted.len().to_string()) && text.contains("socketcan"), "{text}");
    }
    let log = std::fs::File::open(&candump).unwrap();
    match Command::new("log2long").stdin(log).output() {
        Ok(output) => {
            let text = reported(&output);
            assert_eq!(text.lines().count(), wanted.len());
            assert!(text.starts_with(&format!("({})  can0", seconds(&wanted[0]))), "{}", text.lines().next().unwrap());
        }
        Err(error) => println!("SKIPPED: log2long: {error}"),
    }
    let script = "import can,sys\nfor m in can.CanutilsLogReader(sys.argv[1]):\n \
                  print(f'{m.arbitration_id:03X}#{m.data.hex().upper()} {\"R\" if m.is_rx else \"T\"} {m.timestamp:.5f}')";
    let python = python();
    let has_python_can =
        Command::new(&python).args(["-c", "import can"]).output().is_ok_and(|run| run.status.success());
    if !has_python_can {
        return println!("SKIPPED: {python} has no package \"can\"");
    }
    if let Some(text) = tool(&python, &["-c", script, candump.to_str().unwrap()]) {
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), wanted.len());
        for (line, packet) in lines.iter().zip(&wanted) {
            let Packet::Can(frame) = packet.packet else { panic!("CAN") };
            let data: String = frame.data().iter().map(|byte| format!("{byte:02X}")).collect();
            let direction = if packet.direction == Direction::Sent { 'T' } else { 'R' };
            assert!(line.starts_with(&format!("{:03X}#{data} {direction} ", frame.id())), "{line}");
        }
    }
}
