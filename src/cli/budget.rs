//! `starloop budget`: runs a bench on the real clock and compares the time of every stage with the limits in
//! `[budget]`.
//!
//! Input: a bench. Output: a table, files with `--report`, and an exit status for scripts: 3 when the budget is broken.
//! What is not given in `[budget]` is derived: the whole from the readout time, drawing from the planner's time.

use crate::cli::budget_advice::advice;
use crate::cli::load_threads::LoadThreads;
use crate::cli::report_json::print_json;
use crate::cli::run;
use crate::cli::run_args::{BackendName, CaptureFormatName, ClockKind, RunArgs, SinkKind};
use crate::cli::run_end::Finished;
use crate::cli::{EXIT_DONE, EXIT_OVER_BUDGET, budget_files};
use ::run::runtime::{FrameEngine, RunParams};
use anyhow::Result;
use clap::Args;
use config::Bench;
use frames::report::{BudgetLimits, BudgetReport, Stage, budget_lines, budget_table};
use std::path::PathBuf;

/// Command line of `budget`.
#[derive(Debug, Args)]
#[command(after_help = "Exit status: 0 inside the budget; 3 over it (the stage that broke it is named); 5 the run \
                        ended, but something was lost; 1 the run could not be done; 130, 143 or 129 stopped by Ctrl-C, \
                        SIGTERM or SIGHUP.\n\n\
                        Limits are 99 % quantiles in ms, one key a stage, in the bench's [budget]: wake_ms, receive_ms, \
                        bus_age_ms, arrival_age_ms, correlation_ms, trigger_ms, attitude_ms, sky_ms, plan_ms, upload_ms, render_ms, \
                        detector_ms, readback_ms, handover_ms, queue_ms, sink_ms, total_ms, latency_ms; and missed_frames. Threads: \
                        realtime, priority, affinity.")]
pub struct BudgetArgs {
    /// Bench file (TOML); without one: the built-in loopback bench
    bench: Option<PathBuf>,
    /// Run for this many seconds instead of the bench's duration
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Write budget.json, frames_timing.csv, junit.xml and worst.svg into this directory
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Keep this many threads busy beside the run
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = load_threads)]
    load: usize,
    /// Draw with this backend instead of the bench's
    #[arg(long, value_enum)]
    backend: Option<BackendName>,
    /// Where frames go instead of the bench's sinks
    #[arg(long, value_enum)]
    sink: Option<SinkKind>,
    /// Directory to record into (one without a recording)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Predict with the built-in costs, whatever `starloop calibrate` has measured
    #[arg(long)]
    built_in_costs: bool,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Most threads that `--load` starts.
const MOST_LOAD_THREADS: usize = 1024;

/// Reads a number of busy threads.
fn load_threads(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| *count <= MOST_LOAD_THREADS);
    count.ok_or_else(|| format!("wanted a number of threads from 0 to {MOST_LOAD_THREADS}"))
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &BudgetArgs) -> Result<u8> {
    let load = LoadThreads::start(arguments.load)?;
    let arguments_of_run = run_arguments(arguments);
    let finished = run::perform(&arguments_of_run)?;
    drop(load);
    let report = budget_report(&finished, arguments.load)?;
    // First: output that cannot be written ends the program.
    if let Some(directory) = &arguments.report {
        budget_files::write(directory, &report, &finished.end.record.ring)?;
    }
    if arguments.json {
        print_json("budget", &report)?;
    } else {
        print!("{}", budget_table(&report));
    }
    if let Some(directory) = arguments.report.as_ref().filter(|_| !arguments.json) {
        println!("report in {}", directory.display());
    }
    let is_broken = report.culprit().is_some();
    let reports = finished.reports(arguments_of_run.clock);
    let status = finished.status(&reports, &arguments_of_run)?;
    Ok(if status == EXIT_DONE && is_broken { EXIT_OVER_BUDGET } else { status })
}

fn run_arguments(arguments: &BudgetArgs) -> RunArgs {
    RunArgs {
        bench: arguments.bench.clone(),
        clock: ClockKind::Real,
        duration: arguments.duration,
        backend: arguments.backend,
        seed: None,
        noise_seed: None,
        sink: arguments.sink,
        out: arguments.out.clone(),
        built_in_costs: arguments.built_in_costs,
        report: None,
        random_faults: false,
        settings: Vec::new(),
        control: None,
        capture: None,
        monitor: None,
        monitor_names: Vec::new(),
        capture_format: CaptureFormatName::Pcapng,
        json: false,
        details: false,
        quiet: false,
    }
}

/// Returns the report of a run's time; `load_threads` were busy beside it.
///
/// # Errors
/// When a frame cannot be planned again for advice.
pub(super) fn budget_report(finished: &Finished, load_threads: usize) -> Result<BudgetReport> {
    let record = &finished.end.record;
    let limits = limits(finished.bench(), finished.engine());
    let lines = budget_lines(&limits, &record.stages, &record.ring);
    let summary = finished.summary(ClockKind::Real);
    let render_limit_ms = limits.stage_p99_ms[Stage::Render as usize].unwrap_or(0.0);
    let advice = advice(finished, &lines, render_limit_ms)?;
    Ok(BudgetReport {
        starloop_version: summary.starloop_version,
        bench: summary.bench,
        camera: summary.camera,
        backend: summary.backend,
        adapter: summary.adapter,
        machine: summary.machine,
        duration_s: summary.duration_s,
        load_threads,
        frames: summary.frames,
        lines,
        latency: summary.latency,
        misses: summary.misses,
        degraded: summary.degraded,
        hygiene: finished.end.hygiene.clone(),
        advice,
    })
}

/// Returns the limits of the bench, with those derived from them.
pub(super) fn limits(bench: &Bench, engine: &FrameEngine) -> BudgetLimits {
    let mut limits = BudgetLimits {
        latency_p99_ms: bench.budget.latency_p99_ms,
        missed_frames: u64::from(bench.budget.missed_frames),
        ..BudgetLimits::default()
    };
    limits.stage_p99_ms[Stage::Render as usize] = derived_render_ms(engine);
    for (name, ms) in &bench.budget.stage_p99_ms {
        if let Some(stage) = Stage::named(name) {
            limits.stage_p99_ms[stage as usize] = Some(*ms);
        }
    }
    limits
}

/// Returns the planner's time for drawing; with the detector's where a device does both in one go.
fn derived_render_ms(engine: &FrameEngine) -> Option<f64> {
    let params = engine.params();
    let RunParams { camera, cost, .. } = params;
    let cost = cost.unwrap_or(engine.imager().cost());
    let readout_ms = if engine.imager().is_on_device() { camera.predicted_readout_ms(&cost) } else { 0.0 };
    let limit_ms = params.drawing_budget_ms(&cost) + readout_ms;
    (limit_ms > 0.0).then_some(limit_ms)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::run::runtime::FrameEngine;
    use ::run::wiring::bench_parts;
    use base::time::Tai;

    fn limits_of(bench: &Bench) -> BudgetLimits {
        let params = bench_parts::run_params(bench, Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap()).unwrap();
        limits(bench, &FrameEngine::new(params).unwrap())
    }

    #[test]
    fn load_of_more_threads_than_a_machine_has_use_for_is_refused() {
        for (text, count) in [("0", Ok(0)), ("8", Ok(8)), ("1024", Ok(1024))] {
            assert_eq!(load_threads(text), count);
        }
        for text in ["1025", "4294967296", "99999999999999999999999", "-1", "two", ""] {
            assert_eq!(load_threads(text).unwrap_err(), "wanted a number of threads from 0 to 1024", "{text}");
        }
    }

    #[test]
    fn every_stage_of_the_config_is_a_stage_of_the_report() {
        let mut bench = Bench::built_in().unwrap();
        bench.render.backend = config::Backend::Cpu;
        let limits = limits_of(&bench);
        let of = |stage: Stage| limits.stage_p99_ms[stage as usize];
        let readout_ms = bench.camera.exposure.readout_s * 1e3;
        assert_eq!(of(Stage::ReleaseToDelivered), Some(readout_ms), "the whole is due when it is read out");
        assert!(of(Stage::Render).is_some_and(|ms| ms > 0.0 && ms < readout_ms), "{limits:?}");
        assert_eq!((of(Stage::Sky), limits.missed_frames), (None, 0));
        bench.budget.stage_p99_ms.extend([("sky", 3.0), ("render", 4.0)]);
        let limits = limits_of(&bench);
        assert_eq!(limits.stage_p99_ms[Stage::Sky as usize], Some(3.0));
        assert_eq!(limits.stage_p99_ms[Stage::Render as usize], Some(4.0), "what is given comes first");
        for (name, _) in &bench.budget.stage_p99_ms {
            assert!(Stage::named(name).is_some(), "{name}");
        }
    }
}
