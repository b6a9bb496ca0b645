//! Files of a run beside its frames: events, telemetry and its picture.
//!
//! `events.jsonl`: the events of a run, one JSON object a line, after a line that counts all of them.
//!
//! The ledger of a run keeps its first [`EARLY`] events and its last [`KEPT`]; those between are counted by kind, and
//! the first line says how many they are.

use anyhow::{Context, Result};
use base::{time::Tai, units::ARCSEC};
use frames::report::plot::{Axis, Chart, Series, Style, to_svg};
use frames::{report::EventLine, sink::replace_own_file};
use run::runtime::ledger::{EARLY, KEPT};
use run::runtime::{EventKind, RunRecord};
use run::wiring::{assemble::OnRow, assessment::mode_name};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use testbed::vehicle::TelemetryRow;

/// Name of the file in the folder of a run.
pub(crate) const FILE: &str = "events.jsonl";
/// Version of its form.
const SCHEMA: &str = "starloop.events/1";

/// The first line.
#[derive(Debug, Serialize)]
struct Head {
    schema: &'static str,
    /// All events of the run.
    events: u64,
    /// Events that have a line.
    kept: usize,
    /// Events that are only counted.
    left_out: u64,
    first_kept: usize,
    last_kept: usize,
    counts: BTreeMap<&'static str, u64>,
}

/// Returns the kinds of events that happened, with their numbers.
pub(crate) fn counted(record: &RunRecord) -> impl Iterator<Item = (EventKind, u64)> {
    let all = EventKind::ALL.iter().map(|kind| (*kind, record.ledger.count(*kind)));
    all.filter(|(_, count)| *count > 0)
}

/// Returns the number of events that are only counted.
pub(crate) fn left_out(record: &RunRecord) -> u64 {
    record.ledger.total() - record.ledger.kept().count() as u64
}

/// Returns the text of the file.
///
/// # Errors
/// When an event does not go into JSON.
pub(crate) fn to_json_lines(record: &RunRecord) -> serde_json::Result<String> {
    let lines: Vec<EventLine> = record.kept_events();
    let head = Head {
        schema: SCHEMA,
        events: record.ledger.total(),
        kept: lines.len(),
        left_out: left_out(record),
        first_kept: EARLY,
        last_kept: KEPT,
        counts: counted(record).map(|(kind, count)| (kind.name(), count)).collect(),
    };
    let mut text = serde_json::to_string(&head)? + "\n";
    for line in &lines {
        text.push_str(&serde_json::to_string(line)?);
        text.push('\n');
    }
    Ok(text)
}

// `telemetry.csv` of a run with a spacecraft, and the picture beside it.

/// The telemetry file while it is written.
pub(crate) struct TelemetryFile {
    rows: Arc<Mutex<Rows>>,
    path: PathBuf,
}

/// Where rows go, and the first error of one.
struct Rows {
    out: csv::Writer<Box<dyn Write + Send>>,
    failure: Option<csv::Error>,
    plot: TelemetryPlot,
}

impl TelemetryFile {
    /// Writes what is still buffered, and the picture beside it.
    pub(crate) fn finish(self, title: &str) -> Result<()> {
        let mut rows = self.rows.lock().unwrap_or_else(PoisonError::into_inner);
        let written = rows.failure.take().map_or(Ok(()), Err);
        let written = written.and_then(|()| rows.out.flush().map_err(csv::Error::from));
        written.with_context(|| format!("cannot write {}", self.path.display()))?;
        let svg = rows.plot.svg(title);
        replace_own_file(&self.path.with_extension("svg"), |out| out.write_all(svg.as_bytes()))?;
        Ok(())
    }
}

/// Begins the file of a run whose first exposure is at `zero`; returns it and what takes the rows.
pub(crate) fn telemetry_file(directory: &Path, zero: Tai) -> Result<(TelemetryFile, OnRow)> {
    let path = directory.join("telemetry.csv");
    let file = std::fs::File::create_new(&path).with_context(|| format!("cannot make {}", path.display()))?;
    telemetry_into(Box::new(BufWriter::new(file)), path, zero)
}

fn telemetry_into(out: Box<dyn Write + Send>, path: PathBuf, zero: Tai) -> Result<(TelemetryFile, OnRow)> {
    let mut out = csv::Writer::from_writer(out);
    out.write_record(COLUMNS.map(|(name, _)| name))?;
    let rows = Arc::new(Mutex::new(Rows { out, failure: None, plot: TelemetryPlot::new(zero) }));
    let shared = Arc::clone(&rows);
    let on_row = move |row: &TelemetryRow| {
        let mut rows = shared.lock().unwrap_or_else(PoisonError::into_inner);
        rows.plot.take(row);
        if let Err(error) = rows.out.write_record(COLUMNS.map(|(_, cell)| cell(row, zero))) {
            rows.failure.get_or_insert(error);
        }
    };
    Ok((TelemetryFile { rows, path }, Box::new(on_row)))
}

/// A column: its name, and the cell of a row of a run whose first exposure is at an instant.
type Column = (&'static str, fn(&TelemetryRow, Tai) -> String);

/// Columns of `telemetry.csv`; angles are rotation vectors in body axes.
const COLUMNS: [Column; 26] = [
    ("t_s", |row, zero| format!("{:.3}", (row.at - zero).s())),
    ("mode", |row, _| mode_name(row.mode).to_owned()),
    ("pointing_x_arcsec", |row, _| arcsec(row.pointing_error_rad.x)),
    ("pointing_y_arcsec", |row, _| arcsec(row.pointing_error_rad.y)),
    ("pointing_z_arcsec", |row, _| arcsec(row.pointing_error_rad.z)),
    ("knowledge_x_arcsec", |row, _| row.knowledge_error_rad.map(|error| arcsec(error.x)).unwrap_or_default()),
    ("knowledge_y_arcsec", |row, _| row.knowledge_error_rad.map(|error| arcsec(error.y)).unwrap_or_default()),
    ("knowledge_z_arcsec", |row, _| row.knowledge_error_rad.map(|error| arcsec(error.z)).unwrap_or_default()),
    ("sigma_arcsec", |row, _| arcsec(row.sigma_rad)),
    ("rate_x_arcsec_s", |row, _| arcsec(row.rate_rad_s.x)),
    ("rate_y_arcsec_s", |row, _| arcsec(row.rate_rad_s.y)),
    ("rate_z_arcsec_s", |row, _| arcsec(row.rate_rad_s.z)),
    ("bias_error_x_arcsec_s", |row, _| arcsec(row.bias_error_rad_s.x)),
    ("bias_error_y_arcsec_s", |row, _| arcsec(row.bias_error_rad_s.y)),
    ("bias_error_z_arcsec_s", |row, _| arcsec(row.bias_error_rad_s.z)),
    ("torque_x_n_m", |row, _| format!("{:.9}", row.torque_n_m.x)),
    ("torque_y_n_m", |row, _| format!("{:.9}", row.torque_n_m.y)),
    ("torque_z_n_m", |row, _| format!("{:.9}", row.torque_n_m.z)),
    ("vibration_arcsec", |row, _| arcsec(row.vibration_rad)),
    ("wheel_speed_rad_s", |row, _| format!("{:.6}", row.wheel_speed_rad_s)),
    ("wheel_momentum_n_m_s", |row, _| format!("{:.9}", row.wheel_momentum_n_m_s)),
    ("heads_solved", |row, _| row.heads_solved.to_string()),
    ("no_solution", |row, _| row.no_solution.map(|reason| format!("{reason:?}")).unwrap_or_default()),
    ("stars", |row, _| row.stars.to_string()),
    ("sun_angle_deg", |row, _| row.sun_angle_rad.map(|angle| format!("{:.6}", angle.to_degrees())).unwrap_or_default()),
    ("utc", |row, _| row.at.to_rfc3339()),
];

fn arcsec(rad: f64) -> String {
    format!("{:.6}", rad / ARCSEC)
}

// `telemetry.svg`: pointing and knowledge of a flight over time, as people look at it.
//
// Rows are gathered into at most `BINS` bins of equal length that double when they run out, each with its largest
// values, so that a flight of any length is one small picture and no spike is lost.

/// Most bins of the picture; even.
const BINS: usize = 400;

/// Largest values of one stretch of time, arcsec: pointing error, knowledge error, sigma of the estimate.
type Bin = [Option<f64>; 3];

/// The picture while it grows.
#[derive(Debug)]
pub struct TelemetryPlot {
    zero: Tai,
    bin_s: f64,
    bins: Vec<Bin>,
    modes: Vec<(f64, &'static str)>,
}

impl TelemetryPlot {
    /// Returns a picture without rows; times count from `zero`.
    pub fn new(zero: Tai) -> Self {
        Self { zero, bin_s: 0.1, bins: Vec::with_capacity(BINS), modes: Vec::new() }
    }

    /// Takes one row in.
    pub fn take(&mut self, row: &TelemetryRow) {
        let t_s = (row.at - self.zero).s();
        if t_s < 0.0 {
            return;
        }
        let mode = mode_name(row.mode);
        if self.modes.last().is_none_or(|(_, last)| *last != mode) {
            self.modes.push((t_s, mode));
        }
        while t_s >= self.bin_s * BINS as f64 {
            self.halve();
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to BINS")]
        let bin = (t_s / self.bin_s) as usize;
        self.bins.resize(self.bins.len().max(bin + 1), [None; 3]);
        let values = [
            Some(row.pointing_error_rad.length() / ARCSEC),
            row.knowledge_error_rad.map(|error| error.length() / ARCSEC),
            Some(row.sigma_rad / ARCSEC),
        ];
        self.bins[bin] = largest(self.bins[bin], values);
    }

    /// Bins of twice the length.
    fn halve(&mut self) {
        self.bin_s *= 2.0;
        let halved = self.bins.chunks(2).map(|pair| pair.iter().copied().fold([None; 3], largest)).collect();
        self.bins = halved;
    }

    /// Returns the picture.
    pub fn svg(&self, title: &str) -> String {
        let line = |label: &str, kind: usize, group: usize| {
            let point = |(i, bin): (usize, &Bin)| Some([(i as f64 + 0.5) * self.bin_s, bin[kind]?.max(1e-3)]);
            Series::new(label, Style::Line, group, self.bins.iter().enumerate().filter_map(point).collect())
        };
        let reported: Vec<String> = self.modes.iter().take(8).map(|(t_s, mode)| format!("{t_s:.0} s {mode}")).collect();
        let series = vec![
            line("true attitude to target", 0, 0),
            line("true attitude to estimate", 1, 1),
            line("sigma of the estimate", 2, 2),
        ];
        let x = Axis::linear("time after the first exposure, s");
        let y = Axis::log("angle, arcsec (largest of each stretch)");
        to_svg(&Chart::new(title, x, y, series).noted(format!("modes: {}", reported.join(", "))))
    }
}

fn largest(a: Bin, b: Bin) -> Bin {
    core::array::from_fn(|i| match (a[i], b[i]) {
        (Some(a), Some(b)) => Some(f64::max(a, b)),
        (a, b) => a.or(b),
    })
}

#[cfg(test)]
mod run_events_tests {
    use super::*;
    use base::time::{Span, Tai};

    fn lines_of(events: usize) -> Vec<serde_json::Value> {
        let mut record = RunRecord::default();
        for number in 0..events {
            let number = u32::try_from(number).unwrap();
            record.note(EventKind::Late, Tai::from_ns(i64::from(number)), number, Span::ZERO);
        }
        let text = to_json_lines(&record).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    #[test]
    fn every_event_has_a_line_until_the_ledger_is_full_and_the_first_line_counts_the_rest() {
        let lines = lines_of(EARLY + KEPT);
        assert_eq!((lines.len(), &lines[0]["left_out"]), (1 + EARLY + KEPT, &0.into()));
        let lines = lines_of(EARLY + KEPT + 7);
        assert_eq!((lines.len(), &lines[0]["left_out"]), (1 + EARLY + KEPT, &7.into()), "control");
        assert_eq!(lines[0]["counts"]["late"], EARLY + KEPT + 7);
        assert_eq!((&lines[1]["frame"], &lines[1]["kind"]), (&0.into(), &"late".into()));
        assert_eq!(lines.last().unwrap()["frame"], EARLY + KEPT + 6);
        assert_eq!(lines_of(0).len(), 1, "a run without events has the first line alone");
    }
}

#[cfg(test)]
mod telemetry_file_tests {
    use super::*;

    /// A full disk.
    struct Full;

    impl Write for Full {
        fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
            Err(std::io::ErrorKind::StorageFull.into())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn telemetry_that_only_the_last_flush_writes_is_written_or_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("telemetry.csv");
        let into = |out: Box<dyn Write + Send>| telemetry_into(out, path.clone(), Tai::from_ns(0)).unwrap();
        let (file, _on_row) = into(Box::new(Full));
        let error = format!("{:#}", file.finish("a flight").unwrap_err());
        assert!(error.contains(&format!("cannot write {}", path.display())), "{error}");
        let (file, _on_row) = into(Box::new(std::io::sink()));
        file.finish("a flight").unwrap();
        assert!(folder.path().join("telemetry.svg").exists(), "and the picture");
    }
}

#[cfg(test)]
mod scenario_plot_tests {
    use super::*;
    use base::time::Span;
    use glam::DVec3;
    use testbed::acs::Mode;

    fn row(t_s: f64, pointing_rad: f64) -> TelemetryRow {
        TelemetryRow {
            at: Tai::from_ns(0) + Span::from_s(t_s),
            mode: Mode::FinePointing,
            pointing_error_rad: DVec3::X * pointing_rad,
            knowledge_error_rad: None,
            sigma_rad: 1e-5,
            rate_rad_s: DVec3::ZERO,
            bias_error_rad_s: DVec3::ZERO,
            torque_n_m: DVec3::ZERO,
            vibration_rad: 0.0,
            wheel_speed_rad_s: 0.0,
            wheel_momentum_n_m_s: 0.0,
            heads_solved: 1,
            no_solution: None,
            stars: 10,
            tracker_sigma_rad: None,
            sun_angle_rad: None,
        }
    }

    #[test]
    fn a_long_flight_fits_and_its_spike_is_not_lost() {
        let mut plot = TelemetryPlot::new(Tai::from_ns(0));
        for step in 0..200_000 {
            let spike = if step == 1234 { 1e-2 } else { 1e-5 };
            plot.take(&row(0.1 * f64::from(step), spike));
        }
        assert!(plot.bins.len() <= BINS, "{}", plot.bins.len());
        let largest = plot.bins.iter().filter_map(|bin| bin[0]).fold(0.0, f64::max);
        assert!((largest * ARCSEC - 1e-2).abs() < 1e-12, "{largest} arcsec");
        let svg = plot.svg("a <flight>");
        assert!(svg.contains("a &lt;flight&gt;") && !svg.contains("NaN"));
    }
}
