//! What the command line makes of a scenario, and what it refuses: nothing is flown here.

use super::*;
use clap::Parser;

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    run: RunArgs,
}

fn arguments(words: &[&str]) -> RunArgs {
    Line::parse_from([&["run"], words].concat()).run
}

fn shipped(name: &str) -> String {
    format!("{}/configs/{name}", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn a_duration_is_set_before_events_and_expectations_are_checked() {
    let file = shipped("scenarios/stray_light.toml");
    let of = |words: &[&str]| scenario(&arguments(&[&[file.as_str()], words].concat()));
    let error = format!("{:#}", of(&["--duration", "50"]).unwrap_err());
    assert!(error.contains("expect.window_s is 60") && error.contains("the run lasts 50 s"), "{error}");
    let short = of(&["--duration", "180", "--set", "duration_s=200"]).unwrap().unwrap();
    assert_eq!((short.bench.timing.duration_s, short.events.len(), short.events_left_out), (180.0, 2, 1));
    for wrong in ["0", "-1", "nan", "inf"] {
        let error = of(&[&format!("--duration={wrong}")]).unwrap_err().to_string();
        assert!(error.contains("--duration: got"), "{error}");
    }
}

#[test]
fn random_faults_need_time() {
    let file = shipped("scenarios/campaign.toml");
    let of = |words: &[&str]| scenario(&arguments(&[&[&file, "--random-faults"], words].concat()));
    assert!(!of(&[]).unwrap().unwrap().events.is_empty());
    let error = format!("{:#}", of(&["--duration", "1000"]).unwrap_err());
    assert!(error.contains("--random-faults") && error.contains("wanted more than 1200"), "{error}");
}

#[test]
fn options_that_would_do_nothing_are_refused() {
    let (bench, flown) = (shipped("benches/loopback.toml"), shipped("scenarios/acquisition.toml"));
    for (words, parts) in [
        (vec![bench.as_str(), "--json"], ["--json: got a bench", "summary.json"]),
        (vec!["--json"], ["--json: got a bench", "scenario file"]),
        (vec![bench.as_str(), "--random-faults"], ["--random-faults: got a bench", "scenario file"]),
        (vec![flown.as_str(), "--clock", "real", "--report", "r"], ["--report: got a scenario", "wanted a bench"]),
        (vec![flown.as_str(), "--clock", "real", "--control", "127.0.0.1:0"], ["--control", "--clock virtual"]),
    ] {
        let error = run(&arguments(&words)).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{words:?}: {error}");
    }
}
