//! Source of the spacecraft's motion: every form of file, and the keys that each kind refuses.

use super::*;
use crate::scenario::OutsideTrackers;
use crate::{Begins, Bench, Document, FilePlant, Scenario};
use std::path::Path;

/// Returns a run file beside the shipped benches.
fn run_file(text: &str) -> Result<Scenario> {
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
    let gateway_ports = "[link]\nkind = \"simulated\"\nslcan_tcp = 0\n";
    for text in ["[plant]\nkind = \"outside\"\n", "[flight_computer]\nkind = \"external\"\n"] {
        let scenario = run_file(&format!("{gateway_ports}{text}")).unwrap();
        assert_eq!(scenario.plant, Plant::Outside, "{text}");
        assert!(scenario.bench.flight_computer.is_external, "{text}");
    }
}

#[test]
fn trackers_beside_a_plant_outside_have_the_defaults_of_their_table() {
    let outside = "[link]\nkind = \"simulated\"\n[plant]\nkind = \"outside\"\n";
    let trackers = |keys: &str| run_file(&format!("{outside}{keys}")).unwrap().trackers;
    assert_eq!(trackers("[plant.tracker]\n"), Some(OutsideTrackers::default()));
    assert_ne!(trackers("[plant.tracker]\ndelay_ms = 60.0\n"), Some(OutsideTrackers::default()));
    assert_eq!(trackers(""), None);
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
    let Plant::File(file) = &scenario.plant else { panic!("{:?}", scenario.plant) };
    assert_eq!(file.history.span_ns(), [0, 2_500_000_000]);
    assert_eq!((file.begins, file.rests_outside), (Begins::FirstExposure, true));
    for (rows, part) in [
        ("0.0,1,0,0\n", "attitude.csv:1"),
        ("0.0,1,0,0,0\n1.0,2,0,0,0\n", "attitude.csv:2"),
        ("1.0,1,0,0,0\n0.0,1,0,0,0\n", "row 2 is not after the one before it; wanted rising times: sort the rows"),
        ("", "0 rows: no attitude; wanted one row at least"),
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
        let waits = format!("[session]\nstart = \"on_run\"\n{link}[plant]\nkind = \"outside\"\n");
        match run_file(&waits) {
            Ok(_) => assert!(!is_lockstep, "{link}"),
            Err(error) => assert!(is_lockstep && error.to_string().contains("can send RUN"), "{link}: {error}"),
        }
    }
    let gateway_port = refused("[plant]\nkind = \"outside\"\n[[extra_link]]\nkind = \"simulated\"\n");
    assert!(gateway_port.contains("extra_link[0].kind"), "{gateway_port}");
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
fn events_that_name_what_the_run_does_not_have_are_refused() {
    let camera = "camera = \"../cameras/small_tracker.toml\"\n";
    for (lines, parts) in [
        ("do = \"frame_drop\"\nhead = 3\n", ["event[0].head is 3", "less than 1"]),
        ("do = \"stuck_pixels\"\ndn = 4000\npx = [6400, 480]\n", ["event[0].px is [6400, 480]", "256 x 256"]),
        ("do = \"hot_pixels\"\ne_per_s = 1e4\ncolumn = 9000\n", ["event[0].column is 9000", "less than 256"]),
        ("do = \"stuck_pixels\"\ndn = 65000\npx = [64, 48]\n", ["event[0].dn is 65000", "at most 4095"]),
        ("do = \"frame_bit_flip\"\nbit = 15\n", ["event[0].bit is 15", "less than 12"]),
        ("do = \"false_stars\"\nmag = 3.0\npx = [5000, 10]\n", ["event[0].px is [5000, 10]", "256 x 256"]),
    ] {
        let error = refused(&format!("{camera}[[event]]\nat_s = 1.0\nfor_s = 1.0\n{lines}"));
        assert!(parts.iter().all(|part| error.contains(part)), "{lines}: {error}");
    }
    let wheel = format!("{FLOWN}[[event]]\nat_s = 1.0\ndo = \"wheel_failure\"\nwheel = 7\n");
    assert!(refused(&wheel).contains("event[0].wheel is 7; wanted less than 4"), "{}", refused(&wheel));
}

#[test]
fn a_bench_expects_frames_and_refuses_to_expect_pointing() {
    let scenario = run_file("[expect]\nlate_frames_at_most = 0\ntriggers_at_least = 2\n").unwrap();
    assert_eq!((scenario.expect.frames.limits.late, scenario.expect.frames.triggers_at_least), (Some(0), Some(2)));
    assert_eq!(scenario.expect.frames.limits.dropped, None);
    let pointing = refused("[expect]\npointing_arcsec = 5.0\n");
    assert!(pointing.contains("expect.pointing_arcsec is given") && pointing.contains("spacecraft"), "{pointing}");
    for (line, part) in [
        ("final_mode = \"pointing\"", "expect.final_mode is \"pointing\"; wanted one of \"any\", \"fine_pointing\""),
        ("fine_pointing_within_s = 1000.0", "is 1000; wanted a number above 0, up to 10: seconds after the first"),
    ] {
        let error = refused(&format!("{FLOWN}[expect]\n{line}\n"));
        assert!(error.contains("lab.toml:12") && error.contains(part), "{error}");
    }
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
    for wrong in ["[1.0, 1.0, 0.0, 0.0]", "[0.0, 0.0, 90.0]"] {
        let error = refused(&format!("[[head]]\nsensor_from_body = {wrong}\n"));
        assert!(error.contains("lab.toml:2") && error.contains("head[0].sensor_from_body is"), "{error}");
    }
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

/// Attitudes of a standard message, ten seconds of them.
const AEM: &str = "CCSDS_AEM_VERS = 2.0\nMETA_START\nOBJECT_NAME = SAT\nOBJECT_ID = 2026-001A\nREF_FRAME_A = GCRF\nREF_FRAME_B = \
                   SC_BODY_1\nTIME_SYSTEM = UTC\nSTART_TIME = 2026-03-01T00:00:00\nSTOP_TIME = 2026-03-01T00:00:10\nATTITUDE_TYPE \
                   = QUATERNION\nMETA_STOP\nDATA_START\n2026-03-01T00:00:00 0 0 0 1\n2026-03-01T00:00:10 0 1 0 0\nDATA_STOP\n";

#[test]
fn a_message_is_laid_upon_the_run_by_its_own_times_or_at_the_first_exposure() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("x.aem"), AEM).unwrap();
    let read = |lines: &str| {
        let text = format!("[plant]\nkind = \"file\"\nattitude = \"x.aem\"\n{lines}");
        Scenario::from_document(&Document::from_text(&text, &folder.path().join("lab.toml")))
    };
    let file = |lines: &str| match read(lines).unwrap_or_else(|error| panic!("{error}")).plant {
        Plant::File(file) => file,
        other @ (Plant::Outside | Plant::FlightComputer | Plant::Vehicle(_)) => panic!("{other:?}"),
    };
    let [first, later] = ["2026-03-01T00:00:00Z", "2026-03-01T00:00:05Z"].map(|text| Tai::from_rfc3339(text).unwrap());
    let own = file("");
    assert_eq!((own.begins, own.rests_outside), (Begins::Utc, false));
    let turn = |file: &FilePlant, zero, at| file.profile(zero).at(at).map(|truth| truth.body_from_icrf.wxyz()[2].abs());
    let half = core::f64::consts::FRAC_1_SQRT_2;
    assert!((turn(&own, first, later).unwrap() - half).abs() < 1e-12, "half of the turn after half of the time");
    assert!((turn(&own, later, later).unwrap() - half).abs() < 1e-12, "whatever the first exposure");
    let shifted = file("begins = \"first_exposure\"\n[timing]\nstart_utc = \"2030-01-01T00:00:00Z\"\n");
    assert!(turn(&shifted, later, later).unwrap() < 1e-12, "its first row");
    assert_eq!(turn(&shifted, later, first), None, "nothing before it");
    assert!(turn(&file("outside = \"rest\"\n"), first, first - Span::from_s(1.0)).is_some());
    let error = read("[timing]\nstart_utc = \"2030-01-01T00:00:00Z\"\n").unwrap_err().to_string();
    assert!(error.contains("plant.attitude") && error.contains("start_utc = \"2026-02-28T23:59:59"), "{error}");
    for (lines, part) in [
        ("sense = \"icrf_from_body\"\n", "states its own frames"),
        ("begins = \"noon\"\n", "plant.begins"),
        ("outside = \"hold\"\n", "plant.outside"),
    ] {
        let error = read(lines).expect_err(lines).to_string();
        assert!(error.contains(part), "{lines}: {error}");
    }
    std::fs::write(folder.path().join("x.aem"), AEM.replace("QUATERNION", "MATRIX")).unwrap();
    let error = read("").unwrap_err().to_string();
    assert!(error.contains("x.aem:10: ") && error.contains("SPIN/NUTATION"), "{error}");
    std::fs::write(folder.path().join("x.aem"), "0 1 0 0 0\n").unwrap();
    assert!(read("begins = \"utc\"\n").unwrap_err().to_string().contains("a zero of its own"));
}

#[test]
fn a_kernel_that_is_missing_or_packed_is_the_mistake_and_not_its_clock() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.bc.gz"), b"\x1f\x8b\x08\0").unwrap();
    std::fs::write(folder.path().join("a.csv"), "t_s,qw,qx,qy,qz\n0.0,1,0,0,0\n1.0,1,0,0,0\n").unwrap();
    for (file, part) in [
        ("none.bc", "plant.attitude"),
        ("a.bc.gz", "packed by gzip"),
        ("a.csv", "wanted no plant.kernels here"), // control: a table takes no kernels
    ] {
        let text = format!("[plant]\nkind = \"file\"\nattitude = \"{file}\"\nkernels = [\"clock.tsc\"]\n");
        let document = Document::from_text(&text, &folder.path().join("lab.toml"));
        let error = Scenario::from_document(&document).expect_err(file).to_string();
        assert!(error.contains(part), "{file}: {error}");
    }
}
