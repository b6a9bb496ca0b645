//! Changes of a run file by the command line, and its refusals: nothing is flown here.

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

fn scenario(words: &[&str]) -> Result<Scenario> {
    input(&arguments(words)).map(|input| input.scenario)
}

#[test]
fn a_duration_is_set_before_events_and_expectations_are_checked() {
    let file = shipped("scenarios/stray_light.toml");
    let of = |words: &[&str]| scenario(&[&[file.as_str()], words].concat());
    let error = format!("{:#}", of(&["--duration", "50"]).unwrap_err());
    assert!(error.contains("expect.window_s is 60") && error.contains("the run lasts 50 s"), "{error}");
    let short = of(&["--duration", "180", "--set", "duration_s=200"]).unwrap();
    assert_eq!((short.bench.timing.duration_s, short.events.len(), short.events_left_out), (180.0, 2, 1));
    for wrong in ["0", "-1", "nan", "inf"] {
        let error = of(&[&format!("--duration={wrong}")]).unwrap_err().to_string();
        assert!(error.contains("--duration: got"), "{error}");
    }
}

#[test]
fn a_bench_is_cut_to_a_duration_and_counts_the_events_that_it_leaves_out() {
    let file = shipped("benches/gateways_faults.toml");
    let whole = scenario(&[&file]).unwrap();
    let short = scenario(&[&file, "--duration", "22"]).unwrap();
    assert_eq!((whole.events.len(), whole.events_left_out), (4, 0));
    assert_eq!((short.events.len(), short.events_left_out), (3, 1), "the frame at 25 s never comes");
    assert_eq!(short.bench.timing.duration_s, 22.0);
    let slewing = shipped("benches/loopback.toml");
    assert_eq!(scenario(&[&slewing, "--duration", "0.2"]).unwrap().bench.timing.duration_s, 0.2);
}

#[test]
fn random_faults_need_time_and_a_spacecraft() {
    let file = shipped("scenarios/campaign.toml");
    let of = |words: &[&str]| scenario(&[&[file.as_str(), "--random-faults"], words].concat());
    assert!(!of(&[]).unwrap().events.is_empty());
    let error = format!("{:#}", of(&["--duration", "1000"]).unwrap_err());
    assert!(error.contains("--random-faults") && error.contains("wanted more than 1200"), "{error}");
    let error = scenario(&[&shipped("benches/loopback.toml"), "--random-faults"]).err().unwrap().to_string();
    assert!(error.contains("--random-faults: got a bench; wanted a run with a spacecraft"), "{error}");
}

#[test]
fn options_that_would_do_nothing_are_refused() {
    let flown = shipped("scenarios/acquisition.toml");
    for (words, parts) in [
        (vec![flown.as_str(), "--clock", "virtual", "--report", "r"], ["--report", "wanted --clock real"]),
        (vec!["--clock", "virtual", "--report", "r"], ["--report", "wanted --clock real"]),
    ] {
        let error = run(&arguments(&words)).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{words:?}: {error}");
    }
}
