//! The folder of one case: `frames.csv` with the truth, `tracker_log.csv`, `case.json`; and that of a plan, with
//! `plan.json`.

use crate::metric::{Settings, refuse_all};
use crate::record::{Case, FalseLimit, TruthRow, Use};
use crate::{log::read_log, log_form::LogForm, poses::MountingDrift, provenance::Paperwork};
use anyhow::{Context, Result, bail};
use base::input_file::{DATA_BYTES, InputFile, SETTINGS_BYTES, read_text};
use frames::sink::frame_log::{path_in, read_frame_log};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of a tracker's log in the folder of a case.
pub const LOG: &str = "tracker_log.csv";
/// Name of a case's description in its folder.
pub const CASE: &str = "case.json";
/// Name of a plan's description in its folder.
pub const PLAN: &str = "plan.json";

/// Description of a case, beside its frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseFile {
    /// Its name.
    pub name: String,
    /// Purpose, which decides its metrics.
    pub purpose: Use,
    /// Numbers that describe it.
    pub conditions: BTreeMap<String, f64>,
    /// Frames that show one attitude.
    pub frames_per_attitude: u32,
    /// Drift of the mounting: the truth is that of the axes the sensor is aligned to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mounting_drift: Option<MountingDrift>,
}

/// Description of a flown plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlanFile {
    /// Its name.
    pub name: String,
    /// The tracker under test, in words.
    pub tracker: String,
    /// The camera.
    pub camera: String,
    /// Of intervals.
    pub confidence: f64,
    /// Of performances.
    pub probability: f64,
    /// Beyond it a solution is false, across the boresight, arcsec.
    pub false_directional_arcsec: f64,
    /// The same about the boresight.
    pub false_rotational_arcsec: f64,
    /// Largest temporal noise that exclusion angles allow.
    #[serde(default)]
    pub exclusion_noise_arcsec: Option<f64>,
    /// Images that the program under test got, in words, where there were others than FITS.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub images: Option<String>,
    /// Folders of the cases.
    pub cases: Vec<String>,
    /// Unit, author and date in the head of the report.
    #[serde(default)]
    pub document: Paperwork,
    /// Statements of the plan about the logs of its tracker.
    #[serde(default)]
    pub log: LogForm,
}

impl PlanFile {
    /// Reads the description of a flown plan; `None` where the folder is not that of one.
    ///
    /// # Errors
    /// When it is there and cannot be read.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(PLAN);
        if !path.exists() {
            return Ok(None);
        }
        let text = read_text(&path, SETTINGS_BYTES).with_context(|| path.display().to_string())?;
        let read: Self = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        refuse_all(&read.settings().errors()).with_context(|| path.display().to_string())?;
        Ok(Some(read))
    }

    /// Returns what numbers are said with.
    pub fn settings(&self) -> Settings {
        let false_limit = FalseLimit {
            directional_arcsec: self.false_directional_arcsec,
            rotational_arcsec: self.false_rotational_arcsec,
        };
        let exclusion_noise_arcsec = self.exclusion_noise_arcsec;
        Settings { confidence: self.confidence, probability: self.probability, false_limit, exclusion_noise_arcsec }
    }
}

/// Reads the case in a folder, with the log in it or another one, in the form that is stated beside it.
///
/// # Errors
/// With what is missing or cannot be read.
pub fn read_case(folder: &Path, log: Option<&Path>, stated: &LogForm) -> Result<Case> {
    let path = folder.join(CASE);
    let described = if path.exists() {
        let text = read_text(&path, SETTINGS_BYTES).with_context(|| path.display().to_string())?;
        serde_json::from_str::<CaseFile>(&text).with_context(|| path.display().to_string())?
    } else {
        let name = folder.file_name().map_or_else(|| "run".to_owned(), |name| name.to_string_lossy().into_owned());
        CaseFile {
            name,
            purpose: Use::Run,
            conditions: BTreeMap::new(),
            frames_per_attitude: u32::MAX,
            mounting_drift: None,
        }
    };
    let mut truth = read_truth(folder, described.frames_per_attitude)?;
    if let Some(drift) = described.mounting_drift {
        drift.check().with_context(|| path.display().to_string())?;
        align(&mut truth, &drift);
    }
    let log = log.map_or_else(|| folder.join(LOG), PathBuf::from);
    let rows = read_log(&log, stated)?;
    if rows.is_empty() {
        bail!("{}: got no row, wanted one for each solution at least", log.display());
    }
    let CaseFile { name, purpose, conditions, .. } = described;
    Ok(Case { name, purpose, conditions, truth, log: rows })
}

/// Turns the sensor's attitudes to those of the axes that it is aligned to; the drift begins with the first frame.
fn align(truth: &mut [TruthRow], drift: &MountingDrift) {
    let zero_ns = truth.first().map_or(0, |row| row.mid_ns);
    for row in truth {
        row.attitude = drift.aligned(row.attitude, (row.mid_ns - zero_ns) as f64 * 1e-9);
    }
}

fn read_truth(folder: &Path, frames_per_attitude: u32) -> Result<Vec<TruthRow>> {
    let path = path_in(folder);
    let file = InputFile::open(&path, DATA_BYTES).with_context(|| {
        format!("{}: wanted the folder of a recorded run, with frames.csv (--sink recorder)", folder.display())
    })?;
    let rows: Vec<FrameRow> = read_frame_log(file).with_context(|| path.display().to_string())?;
    let mut truth: Vec<TruthRow> = rows.iter().map(|row| truth_of(row, frames_per_attitude.max(1))).collect();
    truth.sort_by_key(|row| row.frame);
    if truth.is_empty() {
        bail!("{}: got no frame, wanted some", path.display());
    }
    Ok(truth)
}

/// The columns of `frames.csv` that are read.
#[derive(Deserialize)]
struct FrameRow {
    frame: u32,
    mid_exposure_tai_ns: i64,
    exposure_s: f64,
    qw: f64,
    qx: f64,
    qy: f64,
    qz: f64,
    rate_x_deg_s: f64,
    rate_y_deg_s: f64,
    rate_z_deg_s: f64,
    faults: String,
}

fn truth_of(row: &FrameRow, frames_per_attitude: u32) -> TruthRow {
    TruthRow {
        frame: row.frame,
        mid_ns: row.mid_exposure_tai_ns,
        exposure_s: row.exposure_s,
        attitude: DQuat::from_xyzw(row.qx, row.qy, row.qz, row.qw).normalize(),
        rate_rad_s: DVec3::new(row.rate_x_deg_s, row.rate_y_deg_s, row.rate_z_deg_s).map(f64::to_radians),
        group: row.frame / frames_per_attitude,
        has_fault: !matches!(row.faults.as_str(), "none" | ""),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(confidence: &str) -> Result<Option<PlanFile>> {
        let folder = tempfile::tempdir()?;
        let text = format!(
            "{{\"name\": \"p\", \"tracker\": \"t\", \"camera\": \"c\", \"confidence\": {confidence}, \"probability\": 0.997, \
             \"false_directional_arcsec\": 360.0, \"false_rotational_arcsec\": 3600.0, \"cases\": []}}"
        );
        std::fs::write(folder.path().join(PLAN), text)?;
        PlanFile::read(folder.path())
    }

    #[test]
    fn a_confidence_that_no_interval_has_is_refused() {
        assert!(written("0.95").unwrap().is_some(), "control");
        for wrong in ["1e308", "1.0", "0.0", "-3"] {
            let refused = format!("{:#}", written(wrong).unwrap_err());
            assert!(
                refused.contains("plan.json: confidence: got ") && refused.contains("wanted 0.5 to 0.999999"),
                "{refused}"
            );
        }
    }
}
