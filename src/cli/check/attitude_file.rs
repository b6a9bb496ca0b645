//! `starloop check`, files of attitudes: what a file is, what is between its rows and how wrong that may be, where the
//! run has no attitude.
//!
//! The error is what the file itself shows: every second row, interpolated from the others (`histories::attitude`).

use crate::cli::facts::Facts;
use base::time::{Span, Tai};
use base::units::ARCSEC;
use config::{Bench, FilePlant, Plant};
use histories::{AttitudeHistory, Times};
use run::runtime::RunParams;

/// Most frames that are looked at.
const MOST_FRAMES: u32 = 100_000;

/// Writes the section about the attitudes of a file; nothing for another plant.
pub(super) fn write_files(facts: &mut Facts, bench: &Bench, plant: &Plant, params: &RunParams) {
    let Plant::File(file) = plant else { return };
    let history = &file.history;
    let name = history.name.as_deref().map_or_else(String::new, |name| format!(" of {name}"));
    facts.line("attitude file");
    let (rows, segments) = (history.rows(), history.segments().len());
    facts.named("format").line(format_args!(
        "{}{name}: {rows} rows in {segments} segments, {}",
        history.format,
        span(history)
    ));
    for method in methods(history) {
        facts.fact("between rows", method);
    }
    match history.interpolation_error_rad().map(|rad| rad / ARCSEC) {
        None => facts.more("too few rows to see how far it errs"),
        Some(arcsec) => {
            let budget = bench.accuracy.los_arcsec;
            facts.more(format_args!(
                "errs by less than {arcsec:.2e} arcsec: so far every second row is missed by the others"
            ));
            if arcsec > budget {
                facts.warning(format_args!(
                    "the attitudes of the file err by up to {arcsec:.1e} arcsec between rows, more than \
                     accuracy.los_arcsec = {budget}: give denser rows, or rates with them"
                ));
            }
        }
    }
    for note in &history.notes {
        facts.fact("note", note);
    }
    for warning in &history.warnings {
        facts.warning(warning);
    }
    write_missing(facts, file, params);
    facts.line("");
}

/// Returns the methods of its segments, each once.
fn methods(history: &AttitudeHistory) -> Vec<String> {
    let mut all: Vec<String> = history.segments().iter().map(|segment| segment.method().to_string()).collect();
    all.sort();
    all.dedup();
    all
}

fn span(history: &AttitudeHistory) -> String {
    let [first, last] = history.span_ns();
    match history.times {
        Times::Absolute => format!("{} to {}", Tai::from_ns(first), Tai::from_ns(last)),
        Times::FromZero => format!("{} to {} s of its own", first as f64 * 1e-9, last as f64 * 1e-9),
    }
}

/// Warns of frames whose exposure is not wholly within the file.
fn write_missing(facts: &mut Facts, file: &FilePlant, params: &RunParams) {
    let profile = file.profile(params.first_exposure);
    let exposure = Span::from_s(params.camera.exposure_s);
    let is_missing = |number: &u32| {
        let start = params.exposure_start(*number);
        profile.at(start).is_none() || profile.at(start + exposure).is_none()
    };
    let step = params.frames.div_ceil(MOST_FRAMES).max(1) as usize;
    let frames = || (0..params.frames).step_by(step);
    let (looked_at, missing) = (frames().count(), frames().filter(is_missing).count());
    if missing > 0 {
        facts.warning(format_args!(
            "{missing} of {looked_at} frames begin or end where the file has no attitude: attitude.stale_policy says \
             what becomes of them"
        ));
    }
    let rests = frames().filter(|number| {
        let start = params.exposure_start(*number);
        profile.rests_at(start) || profile.rests_at(start + exposure)
    });
    let rests = if file.outside_is_given { 0 } else { rests.count() };
    if rests > 0 {
        facts.warning(format_args!(
            "{rests} of {looked_at} frames begin or end before or after the rows of the file, where the body rests: \
             give a longer file or a shorter run, or plant.outside = \"rest\""
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::{Document, Scenario};
    use run::wiring::bench_parts;

    /// Returns a turn that accelerates evenly, as rows so many seconds apart.
    fn report(step_s: f64, seconds: f64) -> String {
        report_with(step_s, seconds, "outside = \"none\"\n")
    }

    fn report_with(step_s: f64, seconds: f64, outside: &str) -> String {
        let mut rows = String::from("t_s,q_w,q_x,q_y,q_z\n");
        let count = (seconds / step_s) as u32;
        for t_s in (0..=count).map(|i| f64::from(i) * step_s) {
            // Half of the angle that 1e-4 rad/s^2 make.
            let (sin, cos) = (0.5 * 0.5 * 1e-4 * t_s * t_s).sin_cos();
            rows += &format!("{t_s},{cos},0,{},0\n", -sin);
        }
        report_of(&rows, outside)
    }

    /// Returns the section about a table.
    fn report_of(rows: &str, outside: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("x.csv"), rows).unwrap();
        let text = format!("[plant]\nkind = \"file\"\nattitude = \"x.csv\"\n{outside}");
        let scenario = Scenario::from_document(&Document::from_text(&text, &folder.path().join("lab.toml"))).unwrap();
        let params = bench_parts::run_params(&scenario.bench, Tai::from_ns(0)).unwrap();
        let mut facts = Facts::indented();
        write_files(&mut facts, &scenario.bench, &scenario.plant, &params);
        facts.text()
    }

    /// Rows `h` apart miss those between them by `a h^2 / 2`; the budget is that of the bench.
    #[test]
    fn the_error_of_sparse_rows_is_a_warning_and_that_of_dense_ones_is_not() {
        let los_arcsec = Bench::built_in().unwrap().accuracy.los_arcsec;
        let edge_s = (2.0 * los_arcsec * ARCSEC / 1e-4).sqrt();
        for (part, warns) in [(0.8, false), (1.3, true)] {
            let text = report(part * edge_s, 20.0);
            assert!(text.contains("slerp") && text.contains("errs by less than"), "{text}");
            assert_eq!(text.contains("WARNING      the attitudes of the file err by up to"), warns, "{part}: {text}");
        }
    }

    #[test]
    fn doubts_of_the_reader_are_warnings() {
        let rows = |skipped: core::ops::Range<i32>| {
            let kept = (0..60).filter(|t_s| !skipped.contains(t_s)).map(|t_s| format!("{t_s},1,0,0,0\n"));
            report_of(&format!("t_s,q_w,q_x,q_y,q_z\n{}", kept.collect::<String>()), "outside = \"none\"\n")
        };
        let text = rows(20..47);
        assert!(text.contains("\n  WARNING      rows are missing after row 20 of segment 1"), "{text}");
        assert!(!rows(0..0).contains("WARNING"), "control: {}", rows(0..0));
    }

    #[test]
    fn a_file_that_ends_before_the_run_is_a_warning_unless_its_end_is_stated() {
        let ends = |outside| report_with(0.05, 5.02, outside).contains("where the body rests");
        assert!(ends("") && !ends("outside = \"rest\"\n") && !ends("outside = \"none\"\n"));
        assert!(!report_with(0.05, 20.0, "").contains("where the body rests"), "control");
    }

    #[test]
    fn frames_without_attitude_are_counted() {
        let text = report(0.05, 5.02);
        assert!(text.contains("50 of 100 frames begin or end"), "{text}");
        assert!(!report(0.05, 20.0).contains("begin or end"), "control");
    }
}
