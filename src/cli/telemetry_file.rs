//! `telemetry.csv` of a run with a spacecraft, and the picture beside it.

use crate::cli::scenario_plot::TelemetryPlot;
use anyhow::{Context, Result};
use base::{time::Tai, units::ARCSEC};
use frames::sink::replace_own_file;
use run::wiring::{assemble::OnRow, assessment::mode_name};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use testbed::vehicle::TelemetryRow;

/// The telemetry file while it is written.
pub(super) struct TelemetryFile {
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
    pub(super) fn finish(self, title: &str) -> Result<()> {
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
pub(super) fn telemetry_file(directory: &Path, zero: Tai) -> Result<(TelemetryFile, OnRow)> {
    let path = directory.join("telemetry.csv");
    let file = std::fs::File::create_new(&path).with_context(|| format!("cannot make {}", path.display()))?;
    telemetry_into(Box::new(BufWriter::new(file)), path, zero)
}

fn telemetry_into(out: Box<dyn Write + Send>, path: PathBuf, zero: Tai) -> Result<(TelemetryFile, OnRow)> {
    let mut out = csv::Writer::from_writer(out);
    out.write_record(COLUMNS)?;
    let rows = Arc::new(Mutex::new(Rows { out, failure: None, plot: TelemetryPlot::new(zero) }));
    let shared = Arc::clone(&rows);
    let on_row = move |row: &TelemetryRow| {
        let mut rows = shared.lock().unwrap_or_else(PoisonError::into_inner);
        rows.plot.take(row);
        if let Err(error) = rows.out.write_record(cells(row, zero)) {
            rows.failure.get_or_insert(error);
        }
    };
    Ok((TelemetryFile { rows, path }, Box::new(on_row)))
}

/// Columns of `telemetry.csv`; angles are rotation vectors in body axes.
const COLUMNS: [&str; 26] = [
    "t_s",
    "mode",
    "pointing_x_arcsec",
    "pointing_y_arcsec",
    "pointing_z_arcsec",
    "knowledge_x_arcsec",
    "knowledge_y_arcsec",
    "knowledge_z_arcsec",
    "sigma_arcsec",
    "rate_x_arcsec_s",
    "rate_y_arcsec_s",
    "rate_z_arcsec_s",
    "bias_error_x_arcsec_s",
    "bias_error_y_arcsec_s",
    "bias_error_z_arcsec_s",
    "torque_x_n_m",
    "torque_y_n_m",
    "torque_z_n_m",
    "vibration_arcsec",
    "wheel_speed_rad_s",
    "wheel_momentum_n_m_s",
    "heads_solved",
    "no_solution",
    "stars",
    "sun_angle_deg",
    "utc",
];

fn cells(row: &TelemetryRow, zero: Tai) -> Vec<String> {
    let mut cells = vec![format!("{:.3}", (row.at - zero).s()), mode_name(row.mode).to_owned()];
    let arcsec = |v: glam::DVec3| v.to_array().map(|x| format!("{:.6}", x / ARCSEC));
    cells.extend(arcsec(row.pointing_error_rad));
    cells.extend(row.knowledge_error_rad.map_or([const { String::new() }; 3], arcsec));
    cells.push(format!("{:.6}", row.sigma_rad / ARCSEC));
    cells.extend(arcsec(row.rate_rad_s));
    cells.extend(arcsec(row.bias_error_rad_s));
    cells.extend(row.torque_n_m.to_array().map(|x| format!("{x:.9}")));
    cells.push(format!("{:.6}", row.vibration_rad / ARCSEC));
    cells.push(format!("{:.6}", row.wheel_speed_rad_s));
    cells.push(format!("{:.9}", row.wheel_momentum_n_m_s));
    cells.push(row.heads_solved.to_string());
    cells.push(row.no_solution.map_or_else(String::new, |reason| format!("{reason:?}")));
    cells.push(row.stars.to_string());
    cells.push(row.sun_angle_rad.map_or_else(String::new, |angle| format!("{:.6}", angle.to_degrees())));
    cells.push(row.at.to_rfc3339());
    cells
}

#[cfg(test)]
mod tests {
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
