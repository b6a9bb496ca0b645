//! Who moves the spacecraft: every form of file, and what each kind refuses.

use super::*;
use crate::{Bench, Document, Scenario};
use std::path::Path;

/// A run file beside the shipped benches.
fn run_file(text: &str) -> Result<Scenario, ConfigError> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/benches");
    Scenario::from_document(&Document::from_text(text, &folder.join("lab.toml")))
}

fn refused(text: &str) -> String {
    run_file(text).expect_err(text).to_string()
}

const FLOWN: &str = "spacecraft = \"../spacecraft/smallsat.toml\"\n[observer]\nkind = \"circular_orbit\"\n\
                     altitude_km = 550.0\ninclination_deg = 97.6\nraan_deg = 0.0\nargument_of_latitude_deg = 0.0\n\
                     [plant.pointing]\nra_deg = 84.0\ndec_deg = -1.2\n";

#[test]
fn a_bench_has_the_plant_that_it_names_or_the_usual_one() {
    assert_eq!(run_file("").unwrap().plant, Plant::FlightComputer);
    assert_eq!(run_file("[plant]\nkind = \"flight_computer\"\n").unwrap().plant, Plant::FlightComputer);
    let doors = "[link]\nkind = \"simulated\"\nslcan_tcp = 0\n";
    for text in ["[plant]\nkind = \"outside\"\n", "[flight_computer]\nkind = \"external\"\n"] {
        let scenario = run_file(&format!("{doors}{text}")).unwrap();
        assert_eq!(scenario.plant, Plant::Outside, "{text}");
        assert!(scenario.bench.flight_computer.is_external, "{text}");
    }
}

#[test]
fn a_bench_with_a_spacecraft_is_a_scenario_in_one_file() {
    let scenario = run_file(FLOWN).unwrap();
    let vehicle = scenario.vehicle().expect("flown");
    assert_eq!((vehicle.target.ra_deg, vehicle.initial), (84.0, None));
    assert_eq!(scenario.expect.window_s, 2.5, "expectations have their defaults");
    let text = format!("{FLOWN}[plant.tracker]\ndelay_ms = 2001.0\n");
    assert!(refused(&text).contains("plant.tracker.delay_ms is 2001"), "{}", refused(&text));
    let no_target = FLOWN.replace("ra_deg", "roll_deg");
    assert!(refused(&no_target).contains("plant.pointing.ra_deg is missing"), "{}", refused(&no_target));
    let text = FLOWN.replace("circular_orbit", "geocentre").replace("altitude_km = 550.0\n", "");
    assert!(!refused(&text).is_empty());
}

#[test]
fn an_attitude_history_is_read_and_refused_by_line() {
    let folder = tempfile::tempdir().unwrap();
    let read = |rows: &str| {
        std::fs::write(folder.path().join("attitude.csv"), rows).unwrap();
        let text = "[plant]\nkind = \"file\"\nattitude = \"attitude.csv\"\n";
        Scenario::from_document(&Document::from_text(text, &folder.path().join("lab.toml")))
    };
    let scenario = read("t_s,qw,qx,qy,qz\n# a comment\n0.0,1,0,0,0\n2.5 0 1 0 0 # later\n").unwrap();
    let Plant::File(table) = &scenario.plant else { panic!("{:?}", scenario.plant) };
    assert_eq!(table.span_s(), [0.0, 2.5]);
    for (rows, part) in [
        ("0.0,1,0,0\n", "attitude.csv:1"),
        ("0.0,1,0,0,0\n1.0,2,0,0,0\n", "attitude.csv:2"),
        ("1.0,1,0,0,0\n0.0,1,0,0,0\n", "rising times"),
        ("", "0 rows"),
    ] {
        let error = read(rows).expect_err(rows).to_string();
        assert!(error.contains("plant.attitude") && error.contains(part), "{rows:?}: {error}");
    }
    assert!(refused("[plant]\nkind = \"file\"\n").contains("plant.attitude"));
    assert!(refused("[plant]\nattitude = \"x.csv\"\n").contains("plant.attitude is given"));
}

#[test]
fn heads_of_a_vehicle_have_one_timing() {
    let head = "[[extra_head]]\nsensor_from_body = [0.0, 1.0, 0.0, 0.0]\n";
    let with = |line: &str| run_file(&format!("{FLOWN}{head}{line}"));
    assert_eq!(with("").unwrap().bench.head_count(), 2, "control");
    for line in ["frame_rate_hz = 5.0\n", "phase_ms = 10.0\n"] {
        let error = with(line).expect_err(line).to_string();
        assert!(error.contains("heads with one frame rate, phase and exposure time"), "{line}: {error}");
    }
}

#[test]
fn kinds_that_contradict_the_file_are_refused() {
    for (text, part) in [
        ("[plant]\nkind = \"vehicle\"\n", "name its file: spacecraft"),
        ("spacecraft = \"x.toml\"\n[plant]\nkind = \"outside\"\n", "plant.kind is \"outside\""),
        ("[plant]\nkind = \"outside\"\n[flight_computer]\nkind = \"simulated\"\n", "say different things"),
        ("[plant]\nkind = \"flight_computer\"\n[plant.pointing]\nra_deg = 1.0\n", "plant.pointing is given"),
        ("[plant]\nkind = \"vehicel\"\n", "did you mean \"vehicle\""),
    ] {
        assert!(refused(text).contains(part), "{text}: {}", refused(text));
    }
}

#[test]
fn a_plant_outside_without_a_bus_that_leads_out_is_flown_in_lockstep() {
    for (link, is_lockstep) in [("", true), ("[link]\nkind = \"simulated\"\nslcan_tcp = 0\n", false)] {
        let outside = run_file(&format!("{link}[plant]\nkind = \"outside\"\n")).unwrap();
        assert_eq!(outside.bench.is_lockstep(), is_lockstep, "{link}");
        assert!(!run_file(link).unwrap().bench.is_lockstep(), "control: a flight computer inside");
    }
    let door = refused("[plant]\nkind = \"outside\"\n[[extra_link]]\nkind = \"simulated\"\n");
    assert!(door.contains("extra_link[0].kind"), "{door}");
}

#[test]
fn a_bench_takes_faults_of_bus_and_frames_and_refuses_those_aboard() {
    let events = "[[event]]\nat_s = 1.0\nfor_s = 2.0\ndo = \"frame_drop\"\n[[event]]\nat_s = 0.5\nfor_s = 1.0\n\
                  do = \"bus_silence\"\n[[event]]\non_trigger = 7\nfor_frames = 3\ndo = \"frame_blank\"\n";
    let scenario = run_file(events).unwrap();
    let words: Vec<&str> = scenario.events.iter().map(|event| event.action.word()).collect();
    assert_eq!(words, ["frame_blank", "bus_silence", "frame_drop"], "in order of time");
    for word in ["do = \"safe\"", "do = \"gyro_dropout\"\nfor_s = 1.0"] {
        let error = refused(&format!("[[event]]\nat_s = 1.0\n{word}\n"));
        assert!(error.contains("event[0].do") && error.contains("spacecraft = "), "{word}: {error}");
    }
    let late = "[timing]\nduration_s = 3.0\n[[event]]\nat_s = 3.0\nfor_s = 1.0\ndo = \"frame_drop\"\n";
    assert!(refused(late).contains("it would never come"));
}

#[test]
fn a_bench_expects_frames_and_refuses_to_expect_pointing() {
    let scenario = run_file("[expect]\nlate_frames_at_most = 0\ntriggers_at_least = 2\n").unwrap();
    assert_eq!((scenario.expect.frames.late_at_most, scenario.expect.frames.triggers_at_least), (Some(0), Some(2)));
    assert_eq!(scenario.expect.frames.dropped_at_most, None);
    assert!(refused("[expect]\npointing_arcsec = 5.0\n").contains("expect.pointing_arcsec is given"));
    assert!(refused("[expect]\nlate_frames_at_most = -1\n").contains("late_frames_at_most is -1"));
}

#[test]
fn heads_have_cameras_rates_and_phases_of_their_own() {
    let text = "[[head]]\nsensor_from_body = [1.0, 0.0, 0.0, 0.0]\nframe_rate_hz = 4.0\n[[head]]\n\
                sensor_from_body = [0.0, 1.0, 0.0, 0.0]\ncamera = \"../cameras/small_tracker.toml\"\n\
                frame_rate_hz = 5.0\nphase_ms = 20.0\n";
    let bench = run_file(text).unwrap().bench;
    assert_eq!((bench.head_count(), bench.timing.frame_rate_hz), (2, 4.0));
    let second = bench.of_head(1);
    assert_ne!(second.camera, bench.camera);
    assert_eq!((second.timing.frame_rate_hz, second.timing.phase), (5.0, Span::from_ms(20)));
    assert_eq!((second.seed, bench.of_head(0).seed), (bench.seed + 1, bench.seed), "noise of its own");
    assert_eq!(bench.of_head(0).camera, bench.camera);
    let both = format!("{text}[[extra_head]]\nsensor_from_body = [1.0, 0.0, 0.0, 0.0]\n");
    assert!(refused(&both).contains("extra_head is given"), "{}", refused(&both));
    let fast = text.replace("frame_rate_hz = 5.0", "frame_rate_hz = 5000.0");
    assert!(refused(&fast).contains("head[1].frame_rate_hz is 5000"), "{}", refused(&fast));
}

#[test]
fn a_packed_run_file_holds_the_cameras_of_its_heads() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/benches");
    let text = "[[extra_head]]\nsensor_from_body = [0.0, 1.0, 0.0, 0.0]\ncamera = \"../cameras/small_tracker.toml\"\n";
    let document = Document::from_text(text, &folder.join("lab.toml"));
    let packed = Document::packed(document.pack().unwrap()).unwrap();
    let of = |document: &Document| Bench::from_document(document).unwrap().extra_heads;
    assert_eq!(of(&packed), of(&document));
    assert_eq!(of(&packed).len(), 1);
}
