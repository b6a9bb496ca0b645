//! Values changed from the command line reach every file of a scenario, and wrong ones are refused by name.

use super::*;
use std::path::Path;

fn acquisition(settings: &[&str]) -> Result<Scenario, ConfigError> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/scenarios/acquisition.toml");
    let settings = settings.iter().map(|text| Setting::parse(text)).collect::<Result<Vec<_>, _>>()?;
    Scenario::from_document(&Document::open(&path)?.with_settings(settings))
}

#[test]
fn values_reach_the_scenario_and_the_files_it_names() {
    let changed = acquisition(&[
        "control.delay_ms=300",
        "expect.window_s = 30.5",
        "expect.final_mode=fine_pointing",
        "initial.rate_deg_s=[0.0, 0.0, 1.0]",
        "event=[{ at_s = 3.0, do = \"safe\" }]",
        "bench.timing.frame_rate_hz=5",
        "bench.camera=../cameras/small_tracker.toml",
        "bench.camera.detector.width_px=128",
        "bench.link.latency_us=75",
        "spacecraft.control.fine_bandwidth_hz=0.1",
        "spacecraft.wheel[2].initial_speed_rpm=1234",
    ])
    .expect("all right");
    let vehicle = changed.vehicle().expect("flown");
    assert_eq!(vehicle.actuation_delay.ms(), 300.0);
    assert_eq!((changed.expect.window_s, changed.expect.final_mode), (30.5, Some("fine_pointing")));
    assert_eq!(vehicle.initial_rate_rad_s.z, 1.0_f64.to_radians());
    assert_eq!(changed.events.len(), 1);
    assert_eq!(changed.bench.timing.frame_rate_hz, 5.0);
    assert_eq!((changed.bench.camera.detector.width_px, changed.bench.camera.detector.height_px), (128, 256));
    assert_eq!(changed.bench.link.latency_us, 75.0);
    assert_eq!(vehicle.spacecraft.control.fine_bandwidth_hz, 0.1);
    let as_written = acquisition(&[]).expect("the shipped file");
    let written_vehicle = as_written.vehicle().expect("flown");
    assert_ne!(vehicle.spacecraft.params.wheels[2], written_vehicle.spacecraft.params.wheels[2], "a wheel of a list");
    assert_eq!(vehicle.spacecraft.params.wheels[1], written_vehicle.spacecraft.params.wheels[1], "and no other");
}

#[test]
fn later_settings_win_and_items_of_lists_can_be_changed() {
    let events = "event=[{ at_s = 3.0, do = \"safe\" }, { at_s = 4.0, do = \"gyro_dropout\", for_s = 1.0 }]";
    let changed = acquisition(&[events, "event[1].for_s=2.5", "seed=4", "seed=5"]).expect("all right");
    assert_eq!((changed.events[1].lasts.s(), changed.bench.seed), (2.5, 5));
}

#[test]
fn errors_name_the_setting_and_the_nearest_key() {
    let cases: [(&str, &[&str]); 12] = [
        ("control.delay_ns=300", &["unknown key `delay_ns`", "did you mean `delay_ms`"]),
        ("contrl.delay_ms=300", &["unknown key `contrl`", "did you mean `control`"]),
        ("bench.timing.frame_rate=5", &["unknown key `frame_rate`", "frame_rate_hz"]),
        ("bench.camera.detector.bit=5", &["unknown key `bit`", "did you mean `bits`"]),
        ("spacecraft.control.damping=9", &["control.damping is 9", "0.1 to 5"]),
        ("control.delay_ms=soon", &["wanted a number", "soon"]),
        ("control.delay_ms=-1", &["control.delay_ms is -1", "0 to 10000"]),
        ("name.first=x", &["name is a value", "wanted a table"]),
        ("event[3].for_s=1", &["event[3]"]),
        ("spacecraft.wheel[9].initial_speed_rpm=1", &["wheel[9]", "beyond a list of"]),
        ("control.delay_ms", &["a key, `=` and a value"]),
        ("control..delay_ms=1", &["names joined by dots"]),
    ];
    for (text, parts) in cases {
        let error = acquisition(&[text]).expect_err(text).to_string();
        assert!(error.contains("--set"), "{text}: names the command line: {error}");
        for part in parts {
            assert!(error.contains(part), "{text}: says \"{part}\": {error}");
        }
    }
    let error = acquisition(&["control.delay_ms=1; rm"]).expect_err("no value").to_string();
    assert!(error.contains("a TOML value or a word"), "{error}");
}

#[test]
fn a_broken_file_is_still_blamed_on_the_file() {
    let settings = vec![Setting::parse("control.delay_ms=1").expect("a setting")];
    let document = Document::from_text("[control]\ndelay_ms = \"x\"\n", Path::new("lab/run.toml"));
    let error = Scenario::from_document(&document.with_settings(settings)).expect_err("a broken file").to_string();
    assert!(error.contains("lab/run.toml:2"), "{error}");
}
