//! `starloop budget`: runs a bench on the real clock and compares the time of every stage with the limits in
//! `[budget]`.
//!
//! Input: a bench. Output: a table, files with `--report`, and an exit status for scripts: 3 when the budget is broken.
//! What is not given in `[budget]` is derived: the whole from the readout time, drawing from the planner's time.

use crate::cli::run::args::{BACKENDS, ClockKind, RunArgs, SinkKind};
use crate::cli::{EXIT_DONE, EXIT_INCOMPLETE, EXIT_OVER_BUDGET, budget_report, run};
use crate::cli::{budget_report::budget_report, named::one_of, report_json::print_json, run::finished::verdict_line};
use anyhow::{Context, Result};
use clap::Args;
use config::Backend;
use core::sync::atomic::{AtomicBool, Ordering};
use frames::report::budget_table;
use std::{path::PathBuf, sync::Arc, thread::JoinHandle};

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
    #[arg(long, value_parser = one_of(BACKENDS))]
    backend: Option<Backend>,
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
        budget_report::write(directory, &report, &finished.end.record.ring)?;
    }
    if arguments.json {
        print_json("budget", &report)?;
    } else {
        print!("{}", budget_table(&report));
        println!("{}", verdict_line(&finished, arguments_of_run.clock));
    }
    if let Some(directory) = arguments.report.as_ref().filter(|_| !arguments.json) {
        println!("report in {}", directory.display());
    }
    let is_broken = report.culprit().is_some();
    let reports = finished.reports(arguments_of_run.clock);
    let status = finished.status(&reports, &arguments_of_run)?;
    Ok(if matches!(status, EXIT_DONE | EXIT_INCOMPLETE) && is_broken { EXIT_OVER_BUDGET } else { status })
}

fn run_arguments(arguments: &BudgetArgs) -> RunArgs {
    RunArgs {
        bench: arguments.bench.clone(),
        clock: ClockKind::Real,
        duration: arguments.duration,
        backend: arguments.backend,
        sink: arguments.sink,
        out: arguments.out.clone(),
        built_in_costs: arguments.built_in_costs,
        ..RunArgs::default()
    }
}

// Neighbours that keep processors busy while a run is timed: ordinary threads that never sleep.

/// Busy threads, until they are dropped. Start them before the run's threads: they keep the ordinary scheduling of the
/// thread that starts them.
pub(super) struct LoadThreads {
    over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl LoadThreads {
    /// Starts `count` of them.
    ///
    /// # Errors
    /// When the system gives no more threads.
    pub(super) fn start(count: usize) -> Result<Self> {
        let mut load = Self { over: Arc::new(AtomicBool::new(false)), threads: Vec::new() };
        for i in 0..count {
            let over = Arc::clone(&load.over);
            let thread = std::thread::Builder::new()
                .name(format!("load {i}"))
                .spawn(move || keep_busy(&over))
                .with_context(|| format!("--load: thread {i} of {count}"))?;
            load.threads.push(thread);
        }
        Ok(load)
    }
}

impl Drop for LoadThreads {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _it_only_counts = thread.join();
        }
    }
}

fn keep_busy(over: &AtomicBool) {
    let mut count = 0_u64;
    while !over.load(Ordering::Relaxed) {
        for _ in 0..10_000 {
            count = core::hint::black_box(count.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn load_of_more_threads_than_a_machine_has_use_for_is_refused() {
        for (text, count) in [("0", Ok(0)), ("8", Ok(8)), ("1024", Ok(1024))] {
            assert_eq!(load_threads(text), count);
        }
        for text in ["1025", "4294967296", "99999999999999999999999", "-1", "two", ""] {
            assert_eq!(load_threads(text).unwrap_err(), "wanted a number of threads from 0 to 1024", "{text}");
        }
    }
}
