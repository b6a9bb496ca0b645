//! `session.json`: everything about a captured run that is not in its packets or frames.
//!
//! Floating-point numbers stand as text, in the fewest digits that give the same bits again, as not every reader of JSON
//! keeps them. Written when the run begins, and again when it ends: without `end` the run was cut off.

use super::{ReplayError, RowCounts, SESSION_FILE};
use base::time::Tai;
use config::{Backend, Bench, Document, PackedDocuments, Scenario, Setting};
use frames::sink::replace_own_file;
use link::capture::CaptureFormat;
use plan::exposure::cost::CostModel;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

/// Form of the file; another one is refused.
const FORM: u32 = 1;
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
    /// The same for people.
    pub start_utc: String,
    /// Seed of the run.
    pub seed: u64,
    /// Seed of the noise of exposures; absent: that of the bench, or `seed`.
    #[serde(default)]
    pub noise_seed: Option<u64>,
    /// What drew: `cpu`, `gpu`, `reference`.
    pub backend: String,
    /// What it ran on; its vector level with it.
    pub adapter: String,
    /// Name of the file of packets.
    pub bus: String,
    /// Duration of the run, s.
    duration_s: String,
    /// Costs that were measured on the machine; absent: the backend's own.
    cost: Option<BTreeMap<String, String>>,
    /// Values changed by the command line, as given.
    settings: Vec<String>,
    /// The bench and the files it names.
    bench: PackedDocuments,
    /// How the run ended; absent: it was cut off.
    pub end: Option<SessionEnd>,
}

/// What the capture of a run came to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionEnd {
    /// Packets in the capture.
    pub packets: u64,
    /// Packets that passed and are not in it.
    pub packets_lost: u64,
    /// Messages lost between the receiving thread and the frame thread.
    pub messages_lost: u64,
    /// Frames without a row.
    pub rows_lost: u64,
    /// What the rows add up to; absent in captures of versions that did not count them.
    #[serde(default)]
    pub counted: Option<RowCounts>,
    /// Why writing ended early, if it did.
    pub error: Option<String>,
}

/// What a session is made of.
#[derive(Debug, Clone)]
pub struct SessionParams<'a> {
    /// The bench as it stands in its file.
    pub document: &'a Document,
    /// Values changed by the command line, as given.
    pub settings: &'a [String],
    /// The run as it goes.
    pub scenario: &'a Scenario,
    /// When the run's clock starts.
    pub start: Tai,
    /// True on the bench clock.
    pub is_real: bool,
    /// Name of the backend.
    pub backend: &'a str,
    /// What it runs on.
    pub adapter: String,
    /// Costs measured on the machine, where they are used.
    pub cost: Option<CostModel>,
}

impl Session {
    /// A session that has not ended.
    ///
    /// # Errors
    /// When a file that the bench names cannot be read.
    pub fn new(params: &SessionParams<'_>, format: CaptureFormat) -> Result<Self, ReplayError> {
        let bus = match format {
            CaptureFormat::Candump => "bus.log",
            CaptureFormat::Pcapng => "bus.pcapng",
        };
        Ok(Self {
            form: FORM,
            starloop_version: env!("CARGO_PKG_VERSION").into(),
            is_real: params.is_real,
            start_tai_ns: params.start.ns(),
            start_utc: params.start.to_rfc3339(),
            seed: params.scenario.bench.seed,
            noise_seed: params.scenario.bench.noise_seed_given,
            backend: params.backend.into(),
            adapter: params.adapter.clone(),
            bus: bus.into(),
            duration_s: exact(params.scenario.bench.timing.duration_s),
            cost: params.cost.as_ref().map(cost_texts),
            settings: params.settings.to_vec(),
            bench: params.document.pack()?,
            end: None,
        })
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, directory: &Path) -> Result<(), ReplayError> {
        let path = directory.join(SESSION_FILE);
        let refuse = |why: serde_json::Error| ReplayError::Session { path: path.clone(), why: why.to_string() };
        let text = serde_json::to_string_pretty(self).map_err(refuse)?;
        replace_own_file(&path, |out| out.write_all(text.as_bytes()))?;
        Ok(())
    }

    /// Reads the file.
    ///
    /// # Errors
    /// When it cannot be read, is damaged, or has another form.
    pub fn read(directory: &Path) -> Result<Self, ReplayError> {
        let path = directory.join(SESSION_FILE);
        let refuse = |source| ReplayError::File { path: path.clone(), doing: "read the session", source };
        let mut text = String::new();
        let file = std::fs::File::open(&path).map_err(refuse)?;
        file.take(FILE_MAX).read_to_string(&mut text).map_err(refuse)?;
        let damaged = |why: String| ReplayError::Session { path: path.clone(), why };
        let session: Self = serde_json::from_str(&text)
            .map_err(|error| damaged(format!("{error}; wanted the session of a captured run")))?;
        if session.form != FORM {
            return Err(damaged(format!("form {}, wanted {FORM}: another version wrote it", session.form)));
        }
        let has_folder = |name: &str| name.contains(['/', '\\']) || name == "..";
        if has_folder(&session.bus) {
            return Err(damaged(format!("bus is \"{}\", wanted a file name without a folder", session.bus)));
        }
        Ok(session)
    }

    /// When the run's clock started.
    #[must_use]
    pub fn start(&self) -> Tai {
        Tai::from_ns(self.start_tai_ns)
    }

    /// The bench as it ran.
    ///
    /// # Errors
    /// When it no longer checks, or a number is none.
    pub fn bench(&self) -> Result<Bench, ReplayError> {
        let settings = self.settings.iter().map(|text| Setting::parse(text)).collect::<Result<_, _>>()?;
        let mut bench = Bench::from_document(&Document::packed(self.bench.clone())?.with_settings(settings))?;
        bench.timing.duration_s = number("duration_s", &self.duration_s)?;
        bench.seed = self.seed;
        bench.noise_seed_given = self.noise_seed.or(bench.noise_seed_given);
        bench.render.backend = match self.backend.as_str() {
            "cpu" => Backend::Cpu,
            "gpu" => Backend::Gpu,
            "reference" => Backend::Reference,
            other => return Err(wrong("backend", other, "cpu, gpu or reference")),
        };
        Ok(bench)
    }

    /// Costs that were measured on the machine that captured it.
    ///
    /// # Errors
    /// When a number is none or one is missing.
    pub fn cost(&self) -> Result<Option<CostModel>, ReplayError> {
        let Some(texts) = &self.cost else { return Ok(None) };
        let mut numbers = serde_json::Map::new();
        for (name, text) in texts {
            numbers.insert(name.clone(), number(name, text)?.into());
        }
        let cost = serde_json::from_value(serde_json::Value::Object(numbers));
        cost.map(Some).map_err(|error| wrong("cost", &error.to_string(), "the constants of the cost model"))
    }

    /// What makes a replay doubtful, a sentence each.
    #[must_use]
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

/// The fewest digits that give the same bits again.
fn exact(value: f64) -> String {
    format!("{value:?}")
}

fn number(name: &str, text: &str) -> Result<f64, ReplayError> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| wrong(name, text, "a finite number"))
}

fn wrong(name: &str, got: &str, wanted: &str) -> ReplayError {
    ReplayError::Session { path: SESSION_FILE.into(), why: format!("{name} is \"{got}\", wanted {wanted}") }
}

fn cost_texts(cost: &CostModel) -> BTreeMap<String, String> {
    let value = serde_json::to_value(cost).unwrap_or_default();
    let fields = value.as_object().into_iter().flatten();
    fields.filter_map(|(name, value)| Some((name.clone(), exact(value.as_f64()?)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_comes_back_bit_by_bit() {
        let document = Bench::built_in_document().unwrap();
        let settings = ["timing.frame_rate_hz=12.5".to_owned(), "camera.exposure.exposure_s=0.03".to_owned()];
        let parsed = settings.iter().map(|text| Setting::parse(text).unwrap()).collect();
        let document = document.with_settings(parsed);
        let mut bench = Bench::from_document(&document).unwrap();
        bench.timing.duration_s = 0.1 + 0.2;
        bench.seed = u64::MAX;
        bench.noise_seed_given = Some(u64::MAX - 1);
        bench.render.backend = Backend::Cpu;
        let cost = CostModel { pixel_ns: 1.0 / 3.0, threads: f64::MIN_POSITIVE, ..CostModel::CPU };
        let params = SessionParams {
            document: &document,
            settings: &settings,
            bench: &bench,
            start: Tai::from_ns(1_790_000_000_123_456_789),
            is_real: true,
            backend: "cpu",
            adapter: "2 threads, vector level V3".into(),
            cost: Some(cost),
        };
        let folder = tempfile::tempdir().unwrap();
        let session = Session::new(&params, CaptureFormat::Pcapng).unwrap();
        session.write(folder.path()).unwrap();
        let read = Session::read(folder.path()).unwrap();
        assert_eq!(read, session);
        assert_eq!(read.cost().unwrap(), Some(cost));
        assert_eq!(read.start(), params.start);
        assert_eq!(read.doubts().len(), 1, "it has not ended");
        let again = read.bench().unwrap();
        assert_eq!(again.noise_seed(), u64::MAX - 1);
        assert_eq!((again.camera, again.timing, again.seed), (bench.camera, bench.timing, bench.seed));
        assert_eq!((again.name, again.link, again.attitude), (bench.name, bench.link, bench.attitude));
    }

    #[test]
    fn another_form_and_damage_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = Session::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains("session.json: cannot read"), "{error}");
        for (text, why) in [("", "EOF"), ("{}", "missing field"), ("[1", "wanted the session"), ("\u{1}", "expected")] {
            std::fs::write(folder.path().join(SESSION_FILE), text).unwrap();
            let error = Session::read(folder.path()).unwrap_err().to_string();
            assert!(error.contains(why) && error.contains("session.json"), "{text}: {error}");
        }
    }
}
