//! Tests that runs of several heads, links and kinds are drawn again to the same bits, faults included, and that a
//! changed capture makes frames differ.

use super::{FRAMES_FILE, ReplayOptions, ReplayOutcome, SESSION_FILE, replay_session};
use crate::wiring::assemble::{Outputs, Run, RunOptions};
use crate::wiring::{stepped::SteppedRun, taps::CaptureOptions};
use base::time::Span;
use config::{Action, Document, Event, Scenario};
use frames::sink::{FaultPixels, FrameFault, ImageFault, NullSink, SendingFault, Sink};
use link::Packet;
use link::capture::{CaptureFormat, CaptureReader, CaptureWriter, CapturedPacket, Direction};
use serde_json::Value;
use std::fs::File;
use std::path::{Path, PathBuf};

/// A slewing bench of one small head: no two frames are alike.
const BENCH: &str = r#"
name = "replayed"
camera = "../cameras/small_tracker.toml"
link = "../links/simulated_can_fd.toml"
seed = 5

[timing]
frame_rate_hz = 10.0
duration_s = 3.0

[flight_computer]
kind = "simulated"
attitude_hz = 50.0
ra_deg = 82.05
dec_deg = -1.2

[flight_computer.slew]
axis = [0.0, -1.0, 0.0]
angle_deg = 4.0
start_s = 0.0
duration_s = 4.0

[render]
backend = "cpu"

[sink]
kind = "null"
"#;

/// Two more heads, the last one slower and later than the others.
const MORE_HEADS: &str = r#"
[[extra_head]]
sensor_from_body = [0.92387953, 0.38268343, 0.0, 0.0]

[[extra_head]]
sensor_from_body = [0.92387953, -0.38268343, 0.0, 0.0]
frame_rate_hz = 5.0
phase_ms = 30.0
"#;

/// Faults of frames and of the bus; true for those whose absence changes images.
const EVENTS: [(&str, bool); 11] = [
    ("at_s = 0.2\nfor_s = 1.0\ndo = \"hot_pixels\"\ne_per_s = 1e6\ncount = 20\nhead = 2", true),
    ("at_s = 0.5\nfor_s = 0.3\ndo = \"frame_torn\"", true),
    ("at_s = 0.7\nfor_s = 0.5\ndo = \"bus_loss\"\nshare = 0.5", false),
    ("at_s = 1.0\nfor_s = 0.3\ndo = \"frame_duplicate\"\nhead = 1", true),
    ("at_s = 1.2\nfor_s = 0.4\ndo = \"frame_late\"\nlate_ms = 250.0", false),
    ("at_s = 1.5\nfor_s = 0.3\ndo = \"frame_drop\"", false),
    ("at_s = 1.8\nfor_s = 0.3\ndo = \"frame_bit_flip\"\nbit = 9\ncount = 20", true),
    ("at_s = 2.0\nfor_s = 0.5\ndo = \"stray_light_ramp\"\nfrom_e_per_s = 0.0\nto_e_per_s = 1e6\nhead = 0", true),
    ("on_trigger = 3\nfor_s = 0.5\ndo = \"false_stars\"\nmag = 2.0\ncount = 5", true),
    ("at_s = 2.3\ndo = \"trigger\"\nnumber = 3", true),
    ("at_s = 2.5\nfor_s = 0.3\ndo = \"defocus_step\"\nsigma_px = 1.5", true),
];

fn bench_with(more: &str) -> String {
    format!("{BENCH}{more}")
}

fn events() -> String {
    EVENTS.iter().map(|(keys, _)| format!("\n[[event]]\n{keys}\n")).collect()
}

/// Captures a run of a file in the place of one below `configs`; `steer` may step it.
fn captured(folder: &Path, place: &str, text: &str, steer: impl FnOnce(&mut SteppedRun)) -> PathBuf {
    let directory = folder.join("capture");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(place).join("replayed.toml");
    let document = Document::from_text(text, &path);
    let scenario = Scenario::from_document(&document).unwrap();
    let mut sinks = |_head: usize| -> Box<dyn Sink> { Box::new(NullSink::new()) };
    let capture = CaptureOptions {
        directory: directory.clone(),
        format: CaptureFormat::Pcapng,
        document: &document,
        settings: &[],
    };
    let options = RunOptions { capture: Some(capture), ..RunOptions::stepped(Outputs::Made(&mut sinks)) };
    let mut run = SteppedRun::of(Run::assemble(&scenario, options).unwrap()).unwrap();
    steer(&mut run);
    run.run_to_end(&mut |_, _, _| true).unwrap();
    assert!(run.end(None).error.is_none());
    directory
}

fn replay(directory: &Path) -> ReplayOutcome {
    replay_session(directory, &ReplayOptions::default(), &mut |_| Ok(None)).unwrap()
}

fn session(directory: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(directory.join(SESSION_FILE)).unwrap()).unwrap()
}

/// Replays with another session, and restores the old one.
fn replay_with(directory: &Path, change: impl FnOnce(&mut Value)) -> ReplayOutcome {
    let (path, mut changed) = (directory.join(SESSION_FILE), session(directory));
    let before = std::fs::read(&path).unwrap();
    change(&mut changed);
    std::fs::write(&path, changed.to_string()).unwrap();
    let outcome = replay(directory);
    std::fs::write(&path, before).unwrap();
    outcome
}

/// Changes the text of the run file.
fn change_file(session: &mut Value, change: impl FnOnce(&str) -> String) {
    let text = &mut session["run_file"][""]["text"];
    *text = change(text.as_str().unwrap()).into();
}

/// Asserts that as many frames as went out are compared, and that all are equal.
fn assert_same(directory: &Path, heads: usize) -> ReplayOutcome {
    let outcome = replay(directory);
    assert_eq!((outcome.differing(), outcome.doubts.as_slice()), (0, &[][..]), "{outcome:?}");
    assert_eq!(outcome.heads.len(), heads);
    let went_out = session(directory)["end"]["counted"]["frames"].as_u64().unwrap();
    assert!(went_out > 0 && outcome.compared() == went_out, "{outcome:?} {went_out}");
    outcome
}

#[test]
fn heads_with_faults_of_frames_replay_bit_by_bit_and_not_without_their_events() {
    let folder = tempfile::tempdir().unwrap();
    let text = bench_with(&(MORE_HEADS.to_owned() + &events()));
    let directory = captured(folder.path(), "benches", &text, |_| ());
    let outcome = assert_same(&directory, 3);
    // Three frames of each fast head are dropped, fewer of the slow one.
    let compared: Vec<u64> = outcome.heads.iter().map(|head| head.compared).collect();
    assert_eq!(compared[..2], [27, 27]);
    assert!((12..15).contains(&compared[2]), "{compared:?}");
    for (place, (keys, is_seen)) in EVENTS.iter().enumerate() {
        let without = replay_with(&directory, |session| {
            change_file(session, |text| text.replace(&format!("[[event]]\n{keys}\n"), ""));
        });
        assert!(without.differing() > 0 || !is_seen, "event {place}: {keys}: {without:?}");
    }
    // The head of an event matters too, and so do frames that go out though they are dropped.
    let other_head = replay_with(&directory, |session| {
        change_file(session, |text| text.replace("count = 20\nhead = 2", "count = 20\nhead = 1"));
    });
    assert!(other_head.heads[1].differing > 0 && other_head.heads[2].differing > 0, "{other_head:?}");
    assert_eq!(other_head.first().unwrap().head, 1, "{other_head:?}");
    let dropped = replay_with(&directory, |session| {
        change_file(session, |text| text.replace("at_s = 1.5\nfor_s = 0.3\n", "at_s = 0.8\nfor_s = 0.3\n"));
    });
    assert!(dropped.doubts.iter().any(|doubt| doubt.contains("it is dropped")), "{dropped:?}");
}

#[test]
fn one_head_and_some_frames_are_replayed_alone() {
    let folder = tempfile::tempdir().unwrap();
    let text = bench_with(&(MORE_HEADS.to_owned() + &events()));
    let directory = captured(folder.path(), "benches", &text, |_| ());
    // The torn frames start at the fourth, which shows a part of the third.
    let options = ReplayOptions { frames: Some(5..9), head: Some(1) };
    let outcome = replay_session(&directory, &options, &mut |head| {
        assert_eq!(head, Some(1));
        Ok(None)
    });
    let outcome = outcome.unwrap();
    assert_eq!((outcome.compared(), outcome.differing(), outcome.drawn()), (4, 0, 4), "{outcome:?}");
    let options = ReplayOptions { frames: None, head: Some(3) };
    let error = replay_session(&directory, &options, &mut |_| Ok(None)).unwrap_err().to_string();
    assert_eq!(error, "--head 3: the run has 3; wanted a number from 0 to 2");
}

#[test]
fn events_from_outside_are_placed_when_they_came() {
    let folder = tempfile::tempdir().unwrap();
    let event = |at_ms, on_trigger, action| {
        let (at, lasts) = (Span::from_ms(at_ms), Span::from_ms(450));
        Event { at, on_trigger, lasts, action }
    };
    let frame = |fault| Action::Frame { head: None, fault };
    let false_stars =
        FrameFault::Image(ImageFault::FalseStars { pixels: FaultPixels { at: None, random: 7 }, mag: 1.0 });
    let directory = captured(folder.path(), "benches", BENCH, |run| {
        let step = |run: &mut SteppedRun, ms| {
            let at = run.times().zero + Span::from_ms(ms);
            run.advance_to(at, &mut |_, _, _| true).unwrap();
        };
        step(run, 1050);
        // The image before the first torn one is not known yet.
        run.inject(&event(0, None, frame(FrameFault::Sending(SendingFault::Torn)))).unwrap();
        run.inject(&event(0, Some(9), frame(false_stars))).unwrap();
        step(run, 1450);
        run.inject(&event(1700, None, frame(FrameFault::Image(ImageFault::StrayLight { e_per_s: 1e6 / 3.0 }))))
            .unwrap();
        let trigger = Event { lasts: Span::ZERO, ..event(2200, None, Action::Trigger { number: 9 }) };
        run.inject(&trigger).unwrap();
    });
    assert_same(&directory, 1);
    let injected = session(&directory)["injected"].as_array().unwrap().len();
    assert_eq!(injected, 4);
    for place in 0..injected {
        let without =
            replay_with(&directory, |session| drop(session["injected"].as_array_mut().unwrap().remove(place)));
        assert!(without.differing() > 0, "{place}: {without:?}");
    }
    let earlier = replay_with(&directory, |session| session["injected"][0]["came_s"] = "-1.0".into());
    assert_eq!(earlier.differing(), 1, "the first torn frame: {earlier:?}");
}

#[test]
fn scenario_with_a_spacecraft_and_imaging_faults_replays_bit_by_bit() {
    let folder = tempfile::tempdir().unwrap();
    let text = "name = \"flown\"\nbench = \"../benches/closed_loop_small.toml\"\nspacecraft = \
                \"../spacecraft/smallsat.toml\"\nduration_s = 6.0\n[initial]\nattitude = \"given\"\nra_deg = 84.05\n\
                dec_deg = -1.2\n[target]\nra_deg = 84.05\ndec_deg = -1.2\n[[event]]\nat_s = 2.0\nfor_s = 2.0\ndo = \
                \"gyro_dropout\"\n[[event]]\nat_s = 3.0\nfor_s = 2.0\ndo = \"missing_stars\"\nshare = 0.5\n";
    let directory = captured(folder.path(), "scenarios", text, |_| ());
    assert_eq!(assert_same(&directory, 1).compared(), 12);
    let remove = |from: &'static str| {
        replay_with(&directory, |session| {
            change_file(session, |text| {
                let begin = text.find(from).unwrap();
                let end = text[begin + 1..].find("[[event]]").map_or(text.len(), |end| begin + 1 + end);
                format!("{}{}", &text[..begin], &text[end..])
            });
        })
    };
    assert!(remove("[[event]]\nat_s = 3.0").differing() >= 4, "they look different");
    // The number of a fault selects the missing stars: a fault aboard counts, though it does not act on frames.
    assert!(remove("[[event]]\nat_s = 2.0").differing() >= 4);
}

#[test]
fn capture_of_the_first_form_replays() {
    let folder = tempfile::tempdir().unwrap();
    let directory = captured(folder.path(), "benches", BENCH, |_| ());
    let path = directory.join(SESSION_FILE);
    let mut first = session(&directory);
    let keys = first.as_object_mut().unwrap();
    let run_file = keys.remove("run_file").unwrap();
    keys.insert("bench".into(), run_file);
    keys.insert("form".into(), 1.into());
    keys.remove("added").unwrap();
    keys.remove("injected").unwrap();
    std::fs::write(&path, first.to_string()).unwrap();
    let frames = directory.join(FRAMES_FILE);
    let table = std::fs::read_to_string(&frames).unwrap();
    let without_heads: String = table
        .lines()
        .map(|line| {
            let mut fields: Vec<&str> = line.split(',').collect();
            fields.remove(1);
            fields.pop();
            fields.join(",") + "\n"
        })
        .collect();
    assert!(without_heads.starts_with("frame,messages,load_bits,"));
    std::fs::write(&frames, &without_heads).unwrap();
    let outcome = replay(&directory);
    assert_eq!((outcome.compared(), outcome.differing(), outcome.doubts.len()), (30, 0, 0), "{outcome:?}");
    std::fs::write(&frames, without_heads.replace(",full,sent,", ",full,sent,f")).unwrap();
    assert!(replay_session(&directory, &ReplayOptions::default(), &mut |_| Ok(None)).is_err(), "control: nine digits");
}

/// Tests a captured run whose attitudes are moved to a second link.
#[test]
fn links_are_played_back_each_through_a_port_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let directory = captured(folder.path(), "benches", BENCH, |_| ());
    let bus = directory.join("bus.pcapng");
    let mut reader = CaptureReader::new(File::open(&bus).unwrap()).unwrap();
    let mut packets: Vec<CapturedPacket> = core::iter::from_fn(|| reader.read().unwrap()).collect();
    let is_attitude = |packet: &Packet| matches!(packet, Packet::Can(frame) if frame.data().len() == 48);
    packets.iter_mut().for_each(|captured| captured.interface = u8::from(is_attitude(&captured.packet)));
    let received: Vec<u8> = packets
        .iter()
        .filter(|packet| packet.direction == Direction::Received)
        .map(|packet| packet.interface)
        .collect();
    // Threads of links are not synchronised: the file has packets of one link after later ones of the other.
    packets.sort_by_key(|captured| captured.at + Span::from_ms(400 * i64::from(captured.interface)));
    let write = |packets: &[CapturedPacket]| {
        let mut writer = CaptureWriter::new(File::create(&bus).unwrap(), CaptureFormat::Pcapng).unwrap();
        packets.iter().for_each(|captured| writer.write(captured).unwrap());
    };
    write(&packets);
    let frames = directory.join(FRAMES_FILE);
    let table = std::fs::read_to_string(&frames).unwrap();
    let by_link = |line: &str| {
        let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        if let Ok(all) = fields[2].parse::<usize>() {
            let second = received[..all].iter().filter(|interface| **interface == 1).count();
            fields[2] = format!("{};{second}", all - second);
        }
        fields.join(",") + "\n"
    };
    std::fs::write(&frames, table.lines().map(by_link).collect::<String>()).unwrap();
    let mut changed = session(&directory);
    change_file(&mut changed, |text| {
        format!("{text}\n[[extra_link]]\nkind = \"simulated\"\nwire = \"can_fd\"\nlatency_us = 50.0\nslcan_tcp = 0\n")
    });
    std::fs::write(directory.join(SESSION_FILE), changed.to_string()).unwrap();
    assert_same(&directory, 1);

    // Controls: all by the first link, and all messages of the first link before any of the second.
    let mut by_one = packets.clone();
    by_one.iter_mut().for_each(|captured| captured.interface = 0);
    write(&by_one);
    let outcome = replay(&directory);
    assert!(outcome.differing() > 0 && outcome.doubts[0].contains("the capture holds"), "{outcome:?}");
    write(&packets);
    assert_same(&directory, 1);
}
