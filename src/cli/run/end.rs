//! The end of a run: its verdict and files, also as JUnit XML.
//!
//! How a run ends: verdict, tables, its files of results, what it lost, its exit status.

use crate::cli::junit::{self, Case};
use crate::cli::run::args::{ClockKind, RunArgs};
use crate::cli::run::finished::{Finished, verdict_line};
use crate::cli::run::report::{ScenarioReport, table};
use crate::cli::run::{files, page};
use crate::cli::{EXIT_DONE, EXIT_FAILED, EXIT_INCOMPLETE, EXIT_LOST, EXIT_NOT_MET, signals};
use crate::cli::{report_json::print_json, run::control::Client, terminal::plain_text};
use anyhow::{Context, Result};
use frames::report::{Losses, RunSummary, RunVerdict, RunWord, short_table, summary_table};
use frames::sink::replace_own_file;

/// Group of a run's test cases.
const CLASS: &str = "run";

/// Results of a run, as printed and sent.
pub(crate) struct Reports {
    /// Expectations, faults and the spacecraft; `None` for a run without any of them.
    scenario: Option<ScenarioReport>,
    summary: RunSummary,
}

impl Finished {
    /// Returns what is printed and sent; made once, when no file of the run can be lost any more.
    pub(crate) fn reports(&self, clock: ClockKind) -> Reports {
        Reports { scenario: self.report(), summary: self.summary(clock) }
    }

    /// Returns what became of expectations, faults and the spacecraft; `None` for a run without any of them.
    fn report(&self) -> Option<ScenarioReport> {
        let is_judged = self.scenario.vehicle().is_some()
            || !self.end.faults.is_empty()
            || !self.end.assessment.verdicts(None, &self.end.record).is_empty();
        is_judged.then(|| {
            let (end, refusals) = (&self.end, self.client.as_ref().map(Client::refusals));
            ScenarioReport::of(&self.scenario, &end.view(), self.wall_s, refusals).ended(end)
        })
    }

    /// Writes `events.jsonl` and `summary.json`, and `scenario.json` where there is something to judge; a file that cannot be written is a
    /// loss.
    ///
    /// # Errors
    /// When a report does not go into JSON.
    pub(crate) fn write_files(&mut self, arguments: &RunArgs) -> Result<()> {
        let Some(directory) = self.directory.clone() else { return Ok(()) };
        let events = files::to_json_lines(&self.end.record)?;
        self.write(&directory.join(files::FILE), &events);
        if let Some(report) = self.report() {
            let json = serde_json::to_string_pretty(&report)?;
            self.write(&directory.join("scenario.json"), &json);
        }
        let json = self.summary(arguments.clock).to_json_pretty()?;
        self.write(&directory.join("summary.json"), &json);
        Ok(())
    }

    /// Writes `report.html`, the last file of a run; one that cannot be written is a loss.
    pub(crate) fn write_page(&mut self, clock: ClockKind) {
        let Some(directory) = self.directory.clone() else { return };
        let page = page::page(self, self.report().as_ref(), clock);
        self.write(&directory.join(page::FILE), &page);
    }

    /// Writes the verdict as JUnit; a file that cannot be written is a loss.
    pub(crate) fn write_junit(&mut self, path: &std::path::Path) {
        let text = to_junit(&self.scenario.name, &self.end.verdict(), self.report().as_ref(), self.wall_s);
        self.write(path, &text);
    }

    fn write(&mut self, path: &std::path::Path, text: &str) {
        if let Err(error) = replace_own_file(path, |out| out.write_all(text.as_bytes())) {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            self.end.losses.note_file(&name, error);
        }
    }

    /// Prints the verdict and a table, or the report as JSON, unless the run is quiet.
    ///
    /// # Errors
    /// When a report does not go into JSON.
    pub(crate) fn print(&self, reports: &Reports, arguments: &RunArgs) -> Result<()> {
        let Reports { scenario, summary } = reports;
        if arguments.json {
            match scenario {
                Some(report) => print_json("scenario", report)?,
                None => print_json("run", summary)?,
            }
            return Ok(());
        }
        if arguments.quiet {
            return Ok(());
        }
        println!("{}", verdict_line(self, arguments.clock));
        let is_flown = self.scenario.vehicle().is_some();
        if arguments.details && !is_flown {
            println!("{}", summary_table(summary));
        } else if !is_flown {
            print!("{}", short_table(summary));
        }
        if let Some(report) = scenario {
            print!("{}", table(report, arguments.details, is_flown));
        }
        if arguments.details && is_flown {
            println!("{}", summary_table(summary));
        }
        Ok(())
    }

    /// Returns the exit status, and prints what was lost, also when the run is quiet. A client that waits for the end
    /// gets it.
    ///
    /// # Errors
    /// With why the run ended early, if it did.
    pub(crate) fn status(self, reports: &Reports, arguments: &RunArgs) -> Result<u8> {
        let was_lost = say_losses(&self.end.losses);
        let verdict = &reports.summary.verdict;
        if arguments.quiet && !arguments.json && verdict.word > RunWord::Ok && verdict.word < RunWord::Lost {
            eprintln!("starloop: {}: {}", verdict.word, plain_text(&verdict.reasons_line()));
        }
        let (holds, is_complete) = (self.end.holds(), verdict.word == RunWord::Ok);
        let (name, seed) = (&self.scenario.name, self.scenario.bench.seed);
        let report = match &reports.scenario {
            Some(report) => serde_json::to_value(report)?,
            None => serde_json::to_value(&reports.summary)?,
        };
        let is_broken = self.end.error.is_some();
        let mut status = match (was_lost, self.was_interrupted, holds) {
            (true, _, _) => EXIT_LOST,
            (false, true, _) => signals::exit_status(),
            (false, false, false) => EXIT_NOT_MET,
            (false, false, true) if is_complete => EXIT_DONE,
            (false, false, true) => EXIT_INCOMPLETE,
        };
        if let Some(client) = self.client {
            if client.is_gone() && arguments.clock == ClockKind::Virtual && !self.was_interrupted {
                let now_s = self.end.simulated_s;
                eprintln!("starloop: the control client went away at {now_s} s; what was finished by then is written");
                status = EXIT_FAILED;
            }
            client.close(report, if is_broken { EXIT_FAILED } else { status });
        }
        if let Some(error) = self.end.error {
            let why = "the run ended early; everything finished before is kept";
            return Err(error).context(why);
        }
        if self.was_interrupted {
            eprintln!("starloop: stopped by {}; everything finished before is kept", signals::cause());
        } else if !holds {
            let failed = verdict.reasons.iter().find(|reason| reason.word == RunWord::Failed);
            let failure = failed.map_or("an expectation was not met", |reason| reason.text.as_str());
            eprintln!("starloop: \"{name}\" failed: {failure}; seed {seed} repeats it");
        }
        Ok(status)
    }
}

/// Prints what was lost on one line; false when nothing was.
pub(crate) fn say_losses(losses: &Losses) -> bool {
    if !losses.is_empty() {
        eprintln!("starloop: {}", plain_text(&losses.to_string()));
    }
    !losses.is_empty()
}

/// Returns the JUnit document of `run --junit`: a test case for the verdict, each expectation and each invariant. `report` is
/// `None` for a run without expectations, faults and a spacecraft.
fn to_junit(name: &str, verdict: &RunVerdict, report: Option<&ScenarioReport>, wall_s: f64) -> String {
    let failure = (verdict.word != RunWord::Ok).then(|| format!("{}: {}", verdict.word, verdict.reasons_line()));
    let mut cases = vec![Case::new(CLASS, "verdict", failure)];
    if let Some(report) = report {
        cases.extend(report.verdicts.iter().map(|one| Case::of_expectation(CLASS, one)));
        cases.extend(report.invariants.iter().map(|one| Case::of_invariant(CLASS, one)));
    }
    junit::document(name, Some(wall_s), &cases)
}
