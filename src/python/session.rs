//! `Session`: a run in process, under the requests of the control socket.

use crate::errors::refused;
use crate::frame::{Drawn, Frame};
use config::{Document, Scenario, Setting};
use frames::report::RunWord;
use frames::sink::{NullSink, Sink};
use pyo3::prelude::*;
use run::wiring::assemble::{Outputs, Run, RunOptions};
use run::wiring::{control::local::LocalSession, run_end::LoopView};
use serde_json::{Value, json};
use starloop::cli::run::report::ScenarioReport;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// A run on the virtual clock.
#[pyclass(frozen)]
pub(crate) struct Session {
    going: Mutex<Option<LocalSession>>,
}

#[pymethods]
impl Session {
    /// Assembles the run of a file, or of one that is built in; `settings` are texts such as "timing.duration_s=2".
    #[new]
    #[pyo3(signature = (path, settings, seed=None))]
    fn new(py: Python<'_>, path: &str, settings: Vec<String>, seed: Option<u64>) -> PyResult<Self> {
        let going = py.detach(|| assembled(path, &settings, seed)).map_err(refused)?;
        Ok(Self { going: Mutex::new(Some(going)) })
    }

    /// Answers one request, a line of JSON; the interpreter lock is released meanwhile.
    fn ask(&self, py: Python<'_>, line: &str) -> PyResult<String> {
        let asked = || {
            let mut going = self.going.lock().unwrap_or_else(PoisonError::into_inner);
            let session = going.as_mut().ok_or("the run is over")?;
            session.ask(line, &mut reported).map(|answer| answer.to_string())
        };
        py.detach(asked).map_err(|why: String| refused(why))
    }

    /// Returns the newest frame of a head; `None` before its first.
    fn frame(&self, py: Python<'_>, head: usize) -> PyResult<Option<Frame>> {
        let newest = || {
            let going = self.going.lock().unwrap_or_else(PoisonError::into_inner);
            going.as_ref().and_then(|session| session.newest(head)).map(Drawn::of)
        };
        py.detach(newest).map(|drawn| Frame::new(py, drawn)).transpose()
    }

    /// Ends the run where it is and returns its report as JSON, and whether its verdict is `ok`.
    fn finish(&self, py: Python<'_>) -> PyResult<(String, bool)> {
        let end = || {
            let session = self.going.lock().unwrap_or_else(PoisonError::into_inner).take().ok_or("the run is over")?;
            let (scenario, end) = session.end();
            let report = ScenarioReport::of(&scenario, &end.view(), 0.0, None);
            Ok::<_, String>((json!(report).to_string(), end.verdict().word == RunWord::Ok))
        };
        py.detach(end).map_err(refused)
    }
}

fn assembled(path: &str, settings: &[String], seed: Option<u64>) -> Result<LocalSession, String> {
    let wrong = |error: config::ConfigError| error.to_string();
    let settings = settings.iter().map(|text| Setting::parse(text)).collect::<Result<_, _>>().map_err(wrong)?;
    let document = Document::open(Path::new(path)).map_err(wrong)?.with_settings(settings);
    let mut scenario = Scenario::from_document(&document).map_err(wrong)?;
    scenario.bench.seed = seed.unwrap_or(scenario.bench.seed);
    let mut sink = |_head: usize| Box::new(NullSink::new()) as Box<dyn Sink>;
    let mut options = RunOptions::stepped(Outputs::Made(&mut sink));
    options.is_controlled = true;
    let run = Run::assemble(&scenario, options).map_err(|error| format!("{error:#}"))?;
    LocalSession::of(run, None).map_err(|error| error.to_string())
}

/// Returns the report of a run under way.
fn reported(scenario: &Scenario, view: &LoopView<'_>) -> Value {
    json!(ScenarioReport::of(scenario, view, 0.0, None))
}
