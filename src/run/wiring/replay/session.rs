//! `session.json`: all data of a captured run that are not in its packets or frames.
//!
//! Floating-point numbers are stored as text, in the fewest digits that give the same bits again, because not every
//! reader of JSON keeps them. Written when the run starts, with each event that is injected, and again when it ends:
//! without `end` the run was cut off. Form 1 is that of versions that captured one head of a bench; both forms are
//! read.

use super::injected::{Injected, KeptEvent, exact, number, wrong};
use super::{ReplayError, Result, RowCounts, SESSION_FILE};
use base::{input_file::read_text, time::Tai};
use config::{Backend, Document, Event, PackedDocuments, Scenario, Setting, StartTime};
use frames::sink::replace_own_file;
use link::capture::CaptureFormat;
use plan::exposure::cost::CostModel;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::Path};

/// Form of the file.
const FORM: u32 = 2;
/// Forms that are read; another one is refused.
const FORMS_READ: [u32; 2] = [1, FORM];
/// Note about a capture whose end record has no counts of rows.
const UNCOUNTED: &str =
    "captured by a version that did not count its rows: whether frames.csv is complete cannot be checked";
/// Largest file that is read, bytes.
const FILE_MAX: u64 = 16 * 1024 * 1024;

/// A captured run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Session {
    form: u32,
    /// Version that captured it.
    pub starloop_version: String,
    /// True when it ran on the bench clock.
    pub is_real: bool,
    /// When the run's clock started, TAI ns since 1970.
    pub start_tai_ns: i64,
    /// The same in UTC.
    pub start_utc: String,
    /// Seed of the run.
    pub seed: u64,
    /// Seed of the noise of exposures; absent: that of the bench, or `seed`.
    #[serde(default)]
    pub noise_seed: Option<u64>,
    /// Backend: `cpu`, `gpu`, `reference`.
    pub backend: String,
    /// Device it ran on, with its vector level.
    pub adapter: String,
    /// Name of the file of packets.
    pub bus: String,
    /// Duration of the run, s.
    duration_s: String,
    /// Costs that were measured on the machine; absent: the backend's own.
    cost: Option<BTreeMap<String, String>>,
    /// Values changed by the command line, as given.
    settings: Vec<String>,
    /// The run file of any kind, and the files it names.
    #[serde(alias = "bench")]
    run_file: PackedDocuments,
    /// Events of the run that are not in the file, such as random faults.
    #[serde(default)]
    added: Vec<KeptEvent>,
    /// Events injected during the run, in this order.
    #[serde(default)]
    pub(super) injected: Vec<Injected>,
    /// End record; absent when the run was cut off.
    pub end: Option<SessionEnd>,
}

/// End record of a captured run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionEnd {
    /// Packets in the capture.
    pub packets: u64,
    /// Packets that passed and are not in the capture.
    pub packets_lost: u64,
    /// Messages lost between the receiving thread and the frame thread.
    pub messages_lost: u64,
    /// Frames without a row.
    pub rows_lost: u64,
    /// Sums over the rows; absent in captures of versions that did not count them.
    #[serde(default)]
    pub counted: Option<RowCounts>,
    /// Rows of samples.csv; absent where the plant was not in lockstep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<u64>,
    /// Why writing ended early, if it did.
    pub error: Option<String>,
}

/// Data to make a session.
#[derive(Debug, Clone)]
pub struct SessionParams<'a> {
    /// The run file as it is written.
    pub document: &'a Document,
    /// Values changed by the command line, as given.
    pub settings: &'a [String],
    /// The run file as it runs; its duration, seeds, backend and additional events are stored beside it.
    pub scenario: &'a Scenario,
    /// When the run's clock starts.
    pub start: Tai,
    /// True on the bench clock.
    pub is_real: bool,
    /// Name of the backend.
    pub backend: &'a str,
    /// Device the backend runs on.
    pub adapter: String,
    /// Costs measured on the machine, if they are used.
    pub cost: Option<CostModel>,
}

impl Session {
    /// Returns a session that has not ended.
    ///
    /// # Errors
    /// When a file that the run file names cannot be read, or it does not check.
    pub fn new(params: &SessionParams<'_>, format: CaptureFormat) -> Result<Self> {
        let bus = match format {
            CaptureFormat::Candump => "bus.log",
            CaptureFormat::Pcapng => "bus.pcapng",
        };
        let bench = &params.scenario.bench;
        let mut session = Self {
            form: FORM,
            starloop_version: env!("CARGO_PKG_VERSION").into(),
            is_real: params.is_real,
            start_tai_ns: params.start.ns(),
            start_utc: params.start.to_rfc3339(),
            seed: bench.seed,
            noise_seed: bench.noise_seed_given,
            backend: params.backend.into(),
            adapter: params.adapter.clone(),
            bus: bus.into(),
            duration_s: exact(bench.timing.duration_s),
            cost: params.cost.as_ref().map(cost_texts),
            settings: params.settings.to_vec(),
            run_file: params.document.pack()?,
            added: Vec::new(),
            injected: Vec::new(),
            end: None,
        };
        session.added = session.events_beyond_file(&params.scenario.events)?;
        Ok(session)
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, directory: &Path) -> Result<()> {
        let path = directory.join(SESSION_FILE);
        let text = serde_json::to_string_pretty(self).map_err(|why| ReplayError::at(&path, why))?;
        replace_own_file(&path, |out| out.write_all(text.as_bytes()))?;
        Ok(())
    }

    /// Reads the file.
    ///
    /// # Errors
    /// When it cannot be read, is damaged, or has another form.
    pub fn read(directory: &Path) -> Result<Self> {
        let path = directory.join(SESSION_FILE);
        let text = read_text(&path, FILE_MAX).map_err(ReplayError::file(&path, "read the session"))?;
        let damaged = |why: String| ReplayError::at(&path, why);
        let mut session: Self = serde_json::from_str(&text)
            .map_err(|error| damaged(format!("{error}; wanted the session of a captured run")))?;
        if !FORMS_READ.contains(&session.form) {
            let wanted = FORMS_READ.map(|form| form.to_string()).join(" or ");
            return Err(damaged(format!("form {}, wanted {wanted}: another version wrote it", session.form)));
        }
        let has_folder = |name: &str| name.contains(['/', '\\']) || name == "..";
        if has_folder(&session.bus) {
            return Err(damaged(format!("bus is \"{}\", wanted a file name without a folder", session.bus)));
        }
        session.run_file = session.run_file.kept_in(directory);
        Ok(session)
    }

    /// Copies the data files that the run file names into the capture.
    ///
    /// # Errors
    /// When one cannot be read or written.
    pub fn keep_data(&mut self, directory: &Path) -> Result<()> {
        Ok(self.run_file.keep_data(directory)?)
    }

    /// Refuses data files that differ from those of the run.
    ///
    /// # Errors
    /// The first file that is missing or changed.
    pub fn check_data(&self) -> Result<()> {
        Ok(self.run_file.check_data()?)
    }

    /// Returns when the run's clock started.
    pub fn start(&self) -> Tai {
        Tai::from_ns(self.start_tai_ns)
    }

    /// Returns the run file, checked with the run's duration.
    fn checked(&self) -> Result<Scenario> {
        let document = Document::packed(self.run_file.clone())?;
        let settings: Vec<Setting> = self.settings.iter().map(|text| Setting::parse(text)).collect::<Result<_, _>>()?;
        let duration_s = number("duration_s", &self.duration_s)?;
        Ok(Scenario::from_document_lasting(document.with_settings(settings), duration_s)?)
    }

    /// Returns the events of the run that are not in its file.
    fn events_beyond_file(&self, events: &[Event]) -> Result<Vec<KeptEvent>> {
        let (mut of_file, mut added) = (self.checked()?.events, Vec::new());
        for event in events {
            match of_file.iter().position(|known| known == event) {
                Some(place) => drop(of_file.remove(place)),
                None => added.push(KeptEvent::new(event)),
            }
        }
        Ok(added)
    }

    /// Returns the run file as it ran, with all its events except those that were injected.
    ///
    /// # Errors
    /// When it is no longer valid, or a number cannot be parsed.
    pub fn scenario(&self) -> Result<Scenario> {
        let mut scenario = self.checked()?;
        let bench = &mut scenario.bench;
        bench.timing.duration_s = number("duration_s", &self.duration_s)?;
        bench.seed = self.seed;
        bench.noise_seed_given = self.noise_seed.or(bench.noise_seed_given);
        bench.render.backend = match self.backend.as_str() {
            "cpu" => Backend::Cpu,
            "gpu" => Backend::Gpu,
            "reference" => Backend::Reference,
            other => return Err(wrong("backend", other, "cpu, gpu or reference")),
        };
        // On the virtual clock 42 stepped the run: its messages are the samples of the capture.
        if !self.is_real && bench.can_be_driven_by_42() {
            bench.timing.start = StartTime::At(self.start());
            scenario.step_by_plant();
        }
        for added in &self.added {
            scenario.events.push(added.event()?);
        }
        scenario.events.sort_by_key(|event| event.at);
        Ok(scenario)
    }

    /// Returns the costs that were measured on the machine that captured it.
    ///
    /// # Errors
    /// When a number cannot be parsed or is missing.
    pub fn cost(&self) -> Result<Option<CostModel>> {
        let Some(texts) = &self.cost else { return Ok(None) };
        let mut numbers = serde_json::Map::new();
        for (name, text) in texts {
            numbers.insert(name.clone(), number(name, text)?.into());
        }
        let cost = serde_json::from_value(serde_json::Value::Object(numbers));
        cost.map(Some).map_err(|error| wrong("cost", &error.to_string(), "the constants of the cost model"))
    }

    /// Returns reasons to doubt a replay, a sentence each.
    pub fn doubts(&self) -> Vec<String> {
        let Some(end) = &self.end else {
            return vec!["the run was cut off: what was written until then is replayed".into()];
        };
        let lost = [
            (end.packets_lost, "packets are not in the capture"),
            (end.messages_lost, "messages were lost between the receiving thread and the frame thread"),
            (end.rows_lost, "frames have no row"),
        ];
        let lost = lost.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
        let uncounted = end.counted.is_none().then(|| UNCOUNTED.to_owned());
        lost.chain(end.error.clone()).chain(uncounted).collect()
    }
}

/// Returns the fewest digits that give the same bits again.
fn cost_texts(cost: &CostModel) -> BTreeMap<String, String> {
    let value = serde_json::to_value(cost).unwrap_or_default();
    let fields = value.as_object().into_iter().flatten();
    fields.filter_map(|(name, value)| Some((name.clone(), exact(value.as_f64()?)))).collect()
}

#[cfg(test)]
#[path = "session_tests.rs"]
mod tests;
