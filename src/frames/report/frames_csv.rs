//! The frame ring as CSV: one row per frame, times in ms after its release, empty where there was nothing.

use crate::report::frame_record::{FrameRecord, MissCause};
use crate::report::{ReportError, stages::Stage};
use base::time::{Span, Tai};
use base::units::ARCSEC;

/// Word for a bound that is not known.
const UNKNOWN: &str = "unknown";

/// Returns the rows, with a heading.
///
/// # Errors
/// [`ReportError::Csv`] when they cannot be expressed.
pub fn frames_csv<'a>(records: impl IntoIterator<Item = &'a FrameRecord>) -> Result<Vec<u8>, ReportError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(heading())?;
    for record in records {
        writer.write_record(row(record))?;
    }
    writer.into_inner().map_err(|error| ReportError::Csv(error.into_error().into()))
}

fn heading() -> Vec<String> {
    let names = [
        "frame",
        "head",
        "exposure_start_tai_ns",
        "release_tai_ns",
        "due_ms",
        "commanded_ms",
        "woken_ms",
        "finished_ms",
    ];
    let more =
        ["submitted_ms", "delivered_ms", "lateness_ms", "fate", "cause", "rung", "method", "origin", "horizon_ms"];
    let last = ["end_horizon_ms", "jitter_missing_ms", "pointing_bound_arcsec", "load"];
    let names = names.into_iter().chain(more).chain(last).map(String::from);
    names.chain(Stage::ALL.iter().map(|stage| format!("{}_ms", stage.name()))).collect()
}

fn row(record: &FrameRecord) -> Vec<String> {
    let ms = |span: Span| format!("{:.6}", span.ms());
    let after = |at: Option<Tai>| at.map(|at| ms(at - record.release)).unwrap_or_default();
    let bound = record.pointing_bound_rad.map_or_else(|| UNKNOWN.to_owned(), |rad| format!("{:.6}", rad / ARCSEC));
    let cells = [
        record.number.to_string(),
        record.head.to_string(),
        record.exposure_start.ns().to_string(),
        record.release.ns().to_string(),
        after(Some(record.due)),
        after(record.commanded),
        after(Some(record.woken)),
        after(record.finished),
        after(record.submitted),
        after(record.delivered),
        ms(record.lateness),
        record.fate.name().to_owned(),
        record.cause.map(MissCause::name).unwrap_or_default().to_owned(),
        record.degradation.to_owned(),
        record.method.to_owned(),
        record.origin.to_owned(),
        ms(record.horizon),
        ms(record.end_horizon),
        ms(record.jitter_missing),
        bound,
        format!("{:.4}", record.load),
    ];
    let stages = Stage::ALL.iter().map(|stage| record.times.get(*stage).map(ms).unwrap_or_default());
    cells.into_iter().chain(stages).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame_record::sample_record;

    #[test]
    fn rows_hold_what_the_records_hold() {
        let missed = FrameRecord { cause: Some(MissCause::SinkBusy), delivered: None, ..sample_record(7) };
        let known = FrameRecord {
            pointing_bound_rad: Some(0.5 * ARCSEC),
            end_horizon: Span::from_ms(12),
            jitter_missing: Span::from_ms(14),
            ..sample_record(8)
        };
        let text = frames_csv([&missed, &known]).unwrap();
        let mut reader = csv::Reader::from_reader(&text[..]);
        let names = reader.headers().unwrap().clone();
        let rows: Vec<_> = reader.records().map(Result::unwrap).collect();
        let cell = |i: usize, name: &str| rows[i][names.iter().position(|n| n == name).unwrap()].to_owned();
        assert_eq!((cell(0, "frame"), cell(1, "frame")), ("7".into(), "8".into()));
        assert_eq!((cell(0, "cause"), cell(1, "cause")), ("sink busy".into(), String::new()));
        assert_eq!((cell(0, "delivered_ms"), cell(1, "delivered_ms")), (String::new(), "36.000000".into()));
        assert_eq!((cell(0, "commanded_ms"), cell(0, "due_ms")), ("-40.000000".into(), "80.000000".into()));
        assert_eq!((cell(1, "end_horizon_ms"), cell(1, "jitter_missing_ms")), ("12.000000".into(), "14.000000".into()));
        let bounds = [0, 1].map(|i| cell(i, "pointing_bound_arcsec"));
        assert_eq!(bounds, [UNKNOWN, "0.500000"], "never a made-up number");
        assert_eq!((cell(0, "render_ms"), cell(0, "readback_ms")), ("20.000000".into(), String::new()));
    }
}
