//! Files of `--report DIR`: budget.json, frames_timing.csv, junit.xml, worst.svg. Each is complete or absent.

use crate::cli::folder;
use anyhow::Result;
use frames::report::{BudgetReport, FrameRing, frames_csv, timeline_svg, to_junit};
use frames::sink::replace_own_file;
use std::path::Path;

/// Frames in worst.svg.
const WORST: usize = 16;

/// Writes the four files.
///
/// # Errors
/// When the directory or a file cannot be written.
pub(super) fn write(directory: &Path, report: &BudgetReport, ring: &FrameRing) -> Result<()> {
    folder::make("--report", directory)?;
    let worst = ring.worst(WORST);
    let title = format!("{}: the {} worst of {} frames", report.bench, worst.len(), ring.total());
    let files = [
        ("budget.json", report.to_json_pretty()?.into_bytes()),
        ("frames_timing.csv", frames_csv(ring.last())?),
        ("junit.xml", to_junit(report).into_bytes()),
        ("worst.svg", timeline_svg(&title, &worst).into_bytes()),
    ];
    for (name, bytes) in files {
        replace_own_file(&directory.join(name), |out| out.write_all(&bytes))?;
    }
    Ok(())
}
