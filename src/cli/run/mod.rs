//! `starloop run`: a bench or a scenario from its first frame to its summary.

pub mod args;
mod control;
pub(crate) mod end;
pub mod files;
pub(crate) mod finished;
mod page;
mod page_parts;
pub mod report;

use crate::cli::run::args::{ClockKind, RunArgs};
use crate::cli::run::control::{Client, Controlled, control_steered, control_stepped, listen, steering};
use crate::cli::run::files::{TelemetryFile, telemetry_file};
use crate::cli::terminal::{Monitor, sender};
use crate::cli::{
    NO_THREADS, budget_report, budget_report::budget_report, calibrate::costs_here, check::warning_line, named,
    named::warn_of_wcs, provenance, run::finished::Finished, signals, start_threads, thread_count,
};
use anyhow::{Context, Result, bail};
use base::clock::{Clock, Monotonic, Stopwatch};
use base::time::Tai;
use batch::campaign::{check_time_for_faults, episode_scenario};
use config::{Bench, Document, Scenario, Setting, StartTime};
use core::sync::atomic::{AtomicBool, Ordering};
use frames::report::{HygieneLine, Losses};
use link::{WireFormat, capture::CaptureFormat};
use run::runtime::{Hygiene, HygieneParams, Imager};
use run::wiring::assemble::{Outputs, Run, RunOptions};
use run::wiring::forty_two::{self, FortyTwo};
use run::wiring::memory::{RunForm, RunMemory};
use run::wiring::taps::{CaptureOptions, LiveOptions};
use run::{wiring::sinks::run_directory, wiring::verdict::CutShort};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Runs the command; the exit status.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &RunArgs) -> Result<u8> {
    if arguments.report.is_some() && arguments.clock == ClockKind::Virtual {
        bail!(
            "--report: got the virtual clock, on which nothing takes time; wanted --clock real, or --junit FILE.xml for the verdict"
        );
    }
    // A report that cannot be written is known before the run, not after it.
    arguments.report.iter().try_for_each(|directory| named::make_folder("--report", directory))?;
    let mut finished = perform(arguments)?;
    finished.write_files(arguments)?;
    if let Some(directory) = &arguments.report {
        write_budget(directory, &mut finished);
    }
    finished.write_page(arguments.clock);
    if let Some(path) = &arguments.junit {
        finished.write_junit(path);
    }
    // Losses are reported and the controlling client gets its answer even when the output cannot be written.
    let reports = finished.reports(arguments.clock);
    let printed = finished.print(&reports, arguments);
    let status = finished.status(&reports, arguments)?;
    printed.map(|()| status)
}

/// Writes the files of `--report`; what cannot be written is a loss of the run.
fn write_budget(directory: &Path, finished: &mut Finished) {
    let report = budget_report(finished, 0);
    let written = report.and_then(|report| budget_report::write(directory, &report, &finished.end.record.ring));
    if let Err(error) = written {
        finished.end.losses.note_file("budget.json", format!("{error:#}"));
    }
}

/// Runs a bench or a scenario from its first frame to its last.
///
/// # Errors
/// When the run could not begin.
pub(crate) fn perform(arguments: &RunArgs) -> Result<Finished> {
    // First: from here on a signal ends the run in order, however much of it is made.
    let stop = signals::stop();
    let RunInput { document, mut scenario } = input(arguments)?;
    let is_driven = is_driven(&scenario.bench, arguments)?;
    // An address that cannot be listened on is reported before anything is made.
    let listener = arguments.control.map(listen).transpose()?;
    let say = !arguments.quiet;
    say_left_out(&scenario);
    // First, because the first drawing starts the drawing threads.
    let is_real = arguments.clock == ClockKind::Real;
    let hygiene = if is_real {
        Some(prepared_hygiene(&scenario, say)?)
    } else {
        start_threads()?;
        None
    };
    let sinks = arguments.sinks(&scenario.bench);
    // Before any folder is made: a run that does not fit leaves nothing behind.
    RunMemory::of(&scenario.bench, &sinks, RunForm { is_real, has_view: arguments.monitor.is_some() }).check()?;
    let plant = if is_driven { Some(meet_plant(&mut scenario, &stop)?) } else { None };
    let was_there = arguments.out.as_deref().is_some_and(Path::exists);
    let directory = directory(&scenario, arguments)?;
    let own_folder = directory.clone().filter(|_| !was_there);
    let mut costs = |imager: &Imager| costs_here(imager, arguments.built_in_costs).measured;
    let capture = arguments.capture.as_ref().map(|directory| CaptureOptions {
        directory: directory.clone(),
        format: arguments.capture_format,
        document: &document,
        settings: &arguments.settings,
    });
    check_capture(arguments, &scenario)?;
    let live = arguments
        .monitor
        .map(|address| LiveOptions { address: address.socket(), names: arguments.monitor_names.clone() });
    let steering = listener.as_ref().filter(|_| is_real).map(|_| steering(&scenario, directory.as_deref()));
    let options = RunOptions {
        clock: arguments.clock,
        outputs: Outputs::Configured { sinks: &sinks, directory: directory.clone() },
        costs: Some(&mut costs),
        hygiene,
        capture,
        live,
        steering: steering.clone(),
        is_controlled: listener.is_some() || plant.is_some(),
    };
    let mut run = Run::assemble(&scenario, options).inspect_err(|_| leave_nothing(own_folder.as_deref()))?;
    if say {
        announce(&run, arguments);
    }
    let telemetry = telemetry(&mut run, directory.as_deref())?;
    run.connect().inspect_err(|_| leave_nothing(own_folder.as_deref()))?;
    run.notes().iter().for_each(|note| eprintln!("{note}"));
    let mut wall = Stopwatch::start();
    let monitor = Monitor::start(say)?;
    let mut progress = sender(monitor.updates.clone(), run.numbers(), run.frames());
    let Controlled { mut end, client } = match (listener, steering) {
        (None, _) => {
            let end = match plant {
                Some(plant) => plant.drive(run, &stop, &mut progress)?,
                None => run.fly(&stop, &mut progress)?,
            };
            Controlled { end, client: None }
        }
        (Some(listener), None) => control_stepped(listener, run, directory.as_deref(), &stop, &mut progress)?,
        (Some(listener), Some(steering)) => control_steered(listener, run, steering, &stop, &mut progress)?,
    };
    let wall_s = wall.lap().s();
    drop(progress);
    let ended = end.times.end;
    if !monitor.finish() {
        end.note_lost_thread("monitor", ended);
    }
    let asked_to_finish = client.as_ref().is_some_and(|client| client.asked_to_finish());
    let was_interrupted = stop.load(Ordering::SeqCst) && !asked_to_finish && !end.was_over;
    let is_gone = client.as_ref().is_some_and(Client::is_gone) && !is_real;
    // A run that its client let come to its end has no frames still to come.
    let was_finished = asked_to_finish && end.simulated_s < (end.times.end - end.times.zero).s();
    end.cut_short = match (was_finished, was_interrupted, is_gone) {
        (true, _, _) => Some(CutShort::Finished),
        (false, true, _) => Some(CutShort::Interrupted),
        (false, false, true) => Some(CutShort::ClientGone),
        (false, false, false) => end.cut_short,
    };
    finish_files(telemetry, directory.as_deref(), (&document, arguments), &scenario, &mut end.losses);
    Ok(Finished { scenario, end, client, wall_s, was_interrupted, directory })
}

/// Finishes the files of the run's folder; what cannot be written is a loss.
fn finish_files(
    telemetry: Option<TelemetryFile>,
    directory: Option<&Path>,
    (document, arguments): (&Document, &RunArgs),
    scenario: &Scenario,
    losses: &mut Losses,
) {
    let telemetry = telemetry.map(|file| file.finish(&title(scenario))).transpose();
    telemetry.unwrap_or_else(|error| {
        losses.note_file("telemetry.csv", format!("{error:#}"));
        None
    });
    if let Some(directory) = directory {
        provenance::keep(directory, (document, &arguments.settings), scenario, losses);
    }
}

/// Returns whether 42 drives the clock of the run.
fn is_driven(bench: &Bench, arguments: &RunArgs) -> Result<bool> {
    let is_driven = arguments.clock == ClockKind::Virtual && bench.can_be_driven_by_42();
    if bench.timing.start == StartTime::Plant && !is_driven {
        bail!(
            "timing.start_utc: got \"plant\", wanted a time or \"now\": only 42 (link.encoding = \"42\", time = \"tag\") with \
             --clock virtual gives a run its start"
        );
    }
    if is_driven && arguments.control.is_some() {
        bail!("--control: got a bench whose clock 42 drives; wanted one of the two");
    }
    Ok(is_driven)
}

/// Waits for 42 and its first message, and says which sky it has if the bench has that of another day.
fn meet_plant(scenario: &mut Scenario, stop: &AtomicBool) -> Result<FortyTwo> {
    let start = scenario.bench.timing.start;
    let plant = forty_two::meet(scenario, stop)?.context("stopped before 42 sent a message")?;
    if let StartTime::At(at) = start {
        let apart = plant.start() - at;
        if apart.s().abs() > 1.0 {
            eprintln!(
                "starloop: 42 is at {}, the bench at {}: Sun, planets and orbits are those of the bench; start_utc = \"plant\" \
                 takes 42's",
                plant.start().to_rfc3339(),
                at.to_rfc3339()
            );
        }
    }
    Ok(plant)
}

fn say_left_out(scenario: &Scenario) {
    if scenario.events_left_out > 0 {
        let all = scenario.events_left_out + scenario.events.len();
        eprintln!("starloop: {} of {all} events come after the end of this run: left out", scenario.events_left_out);
    }
}

/// Refuses a form of capture that cannot hold the run's packets.
fn check_capture(arguments: &RunArgs, scenario: &Scenario) -> Result<()> {
    let mut links = core::iter::once(&scenario.bench.link).chain(&scenario.bench.extra_links);
    let is_candump = arguments.capture.is_some() && arguments.capture_format == CaptureFormat::Candump;
    if is_candump && links.any(|link| matches!(link.wire, WireFormat::Serial | WireFormat::Plain)) {
        bail!(
            "--capture-format candump: got a bench with a serial line or a plain link; wanted pcapng: a candump log holds CAN only"
        );
    }
    Ok(())
}

/// Returns the file of telemetry, where a spacecraft is flown and files are kept.
fn telemetry(run: &mut Run, directory: Option<&Path>) -> Result<Option<TelemetryFile>> {
    let Some(directory) = directory.filter(|_| run.scenario.vehicle().is_some()) else { return Ok(None) };
    let (file, on_row) = telemetry_file(directory, run.times.zero)?;
    run.on_row(on_row);
    Ok(Some(file))
}

fn title(scenario: &Scenario) -> String {
    format!("{}: seed {}", scenario.name, scenario.bench.seed)
}

/// Applies the bench's real-time settings and prints those the system refused.
fn prepared_hygiene(scenario: &Scenario, say: bool) -> Result<Arc<Hygiene>> {
    let config::Budget { realtime, priority, affinity, .. } = scenario.bench.budget.clone();
    let report: fn(&HygieneLine) = |line| {
        if !line.got {
            eprintln!("starloop: not granted: {}: {}", line.what, line.detail);
        }
    };
    let hygiene = Hygiene::new(HygieneParams { realtime, priority, affinity });
    let hygiene = Arc::new(if say { hygiene.announcing(report) } else { hygiene });
    hygiene.prepare(thread_count()).context(NO_THREADS)?;
    Ok(hygiene)
}

/// Returns where files go: only when the command line or a sink wants any. A scenario over a bench has a folder of its
/// own name.
fn directory(scenario: &Scenario, arguments: &RunArgs) -> Result<Option<PathBuf>> {
    let settings = arguments.sinks(&scenario.bench);
    let stamp = stamp(Monotonic::start().now());
    let directory = run_directory(&settings, arguments.out.as_deref(), &stamp);
    let is_over_bench = arguments.out.is_none() && scenario.name != scenario.bench.name;
    let directory = match directory {
        Some(_) if is_over_bench => Some(PathBuf::from("out").join(&scenario.name).join(stamp)),
        directory => directory,
    };
    let is_wanted_at_once = arguments.out.is_some() || scenario.vehicle().is_some();
    if let Some(directory) = directory.as_ref().filter(|_| is_wanted_at_once) {
        named::make_folder("--out", directory)?;
    }
    Ok(directory)
}

/// Removes the new folder of a run that could not begin, if nothing or only empty tables and folders are in it.
fn leave_nothing(folder: Option<&Path>) {
    let Some(folder) = folder else { return };
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        match path.symlink_metadata() {
            Ok(about) if about.is_dir() => leave_nothing(Some(&path)),
            Ok(about) if about.is_file() && about.len() == 0 && entry.file_name() == "frames.csv" => {
                let _ = std::fs::remove_file(&path); // what stays is seen below
            }
            Ok(_) | Err(_) => {}
        }
    }
    let _ = std::fs::remove_dir(folder); // refused where anything is in it
}

/// Returns a directory name that sorts by time, such as `20261120T123456.789Z`.
fn stamp(at: Tai) -> String {
    let text = at.to_rfc3339();
    let seconds = text.split('.').next().unwrap_or_default();
    let milliseconds = text.split('.').nth(1).and_then(|fraction| fraction.get(..3)).unwrap_or("000");
    format!("{}.{milliseconds}Z", seconds.replace(['-', ':'], ""))
}

/// Prints what is about to run.
fn announce(run: &Run, arguments: &RunArgs) {
    let (scenario, engine) = (&run.scenario, &run.heads[0].engine);
    // On the virtual clock the backend changes how long a run takes, and nothing else.
    if let Some(note) = engine.drawer.imager.note.as_ref().filter(|_| arguments.clock == ClockKind::Real) {
        eprintln!("{note}");
    }
    engine.wcs.iter().map(|wcs| wcs.lens_error_px()).for_each(warn_of_wcs);
    let only_built_in = arguments.built_in_costs || arguments.clock == ClockKind::Virtual;
    let warnings = warning_line(scenario, &engine.drawer.imager, only_built_in);
    warnings.iter().for_each(|line| eprintln!("starloop: {line}"));
    let is_built_in = scenario.bench.defaulted.iter().any(|value| value.key == "camera");
    let kind = if scenario.vehicle().is_some() { "scenario" } else { "bench" };
    let time = match arguments.clock {
        ClockKind::Real => "real",
        ClockKind::Virtual => "simulated",
    };
    eprintln!(
        "{kind} \"{}\": {} frames at {} Hz, {} s of {time} time, seed {}, camera \"{}\"{}, {} backend ({})",
        scenario.name,
        run.frames(),
        scenario.bench.timing.frame_rate_hz,
        scenario.bench.timing.duration_s,
        scenario.bench.seed,
        engine.params.camera.name,
        if is_built_in { " (built in: the bench names none)" } else { "" },
        engine.drawer.imager.name(),
        engine.drawer.imager.description(),
    );
}

// The command line of `run` and the file that it names -> the scenario that is run.

/// The run and its file.
pub(crate) struct RunInput {
    /// With the values that the command line sets.
    pub(crate) document: Document,
    pub(crate) scenario: Scenario,
}

/// Reads the file, or the bench of the binary, with the command line's changes.
pub(crate) fn input(arguments: &RunArgs) -> Result<RunInput> {
    let document = match &arguments.bench {
        Some(path) => Document::open(path)?,
        None => Bench::built_in_document()?,
    };
    let settings = arguments.settings.iter().map(|text| Setting::parse(text)).collect::<Result<_, _>>()?;
    let document = document.with_settings(settings);
    let mut scenario = match duration_s(arguments)? {
        Some(duration_s) => Scenario::from_document_lasting(document.clone(), duration_s)?,
        None => Scenario::from_document(&document)?,
    };
    change_bench(&mut scenario.bench, arguments);
    if arguments.random_faults {
        if scenario.vehicle().is_none() {
            bail!("--random-faults: got a bench; wanted a run with a spacecraft, which such faults could upset");
        }
        check_time_for_faults(&scenario).context("--random-faults")?;
        scenario = episode_scenario(&scenario, scenario.bench.seed);
    }
    Ok(RunInput { document, scenario })
}

fn change_bench(bench: &mut Bench, arguments: &RunArgs) {
    if let Some(backend) = arguments.backend {
        bench.render.backend = backend;
    }
    bench.seed = arguments.seed.unwrap_or(bench.seed);
    bench.noise_seed_given = arguments.noise_seed.or(bench.noise_seed_given);
}

/// Returns the duration given by `--duration`.
fn duration_s(arguments: &RunArgs) -> Result<Option<f64>> {
    match arguments.duration {
        Some(duration_s) if !(duration_s.is_finite() && duration_s > 0.0) => {
            bail!("--duration: got {duration_s}, wanted seconds above 0")
        }
        given => Ok(given),
    }
}

#[cfg(test)]
mod tests {
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

    #[test]
    fn the_folder_of_a_run_that_could_not_begin_is_removed_with_those_of_its_heads() {
        let base = tempfile::tempdir().unwrap();
        let run = base.path().join("run");
        let tables = ["head0/frames.csv", "head1/extra_sink_0/frames.csv"].map(|table| run.join(table));
        let write = |table: &PathBuf, text: &str| {
            std::fs::create_dir_all(table.parent().unwrap()).unwrap();
            std::fs::write(table, text).unwrap();
        };
        tables.iter().for_each(|table| write(table, ""));
        leave_nothing(Some(&run));
        assert!(!run.exists());
        write(&tables[0], "frame\n");
        write(&tables[1], "");
        leave_nothing(Some(&run));
        assert!(tables[0].exists() && !tables[1].exists(), "control: a table with a line stays");
    }
}
