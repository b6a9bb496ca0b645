//! `report.html`: a run on one page that needs no other file, written after the run has ended.

use crate::cli::run::finished::{Finished, verdict_line};
use crate::cli::run::page_parts::{Recording, Sample, begun, chart_of_pointing, recording, timeline};
use crate::cli::{budget_report::limits, provenance, run::args::ClockKind, run::files, run::report::ScenarioReport};
use base::input_file::{DATA_BYTES, read_bytes, read_text};
use frames::report::{BudgetLine, FrameEnd, Page, answer_lines, budget_lines};
use performance::provenance::Provenance;

/// Name of the file in the folder of a run.
pub(crate) const FILE: &str = "report.html";
/// Largest page, bytes.
const MOST_BYTES: usize = 300_000;
/// Most rows of a table.
const MOST_ROWS: usize = 60;

/// Returns the page; one that would be larger than [`MOST_BYTES`] is without pictures of frames, and says so.
pub(crate) fn page(finished: &Finished, report: Option<&ScenarioReport>, clock: ClockKind) -> String {
    let recording = recording(finished);
    let samples = recording.as_ref().map(Recording::samples).unwrap_or_default();
    let whole = with_samples(finished, report, clock, recording.as_ref(), Some(&samples));
    if whole.len() <= MOST_BYTES {
        return whole;
    }
    with_samples(finished, report, clock, recording.as_ref(), None)
}

fn with_samples(
    finished: &Finished,
    report: Option<&ScenarioReport>,
    clock: ClockKind,
    recording: Option<&Recording>,
    samples: Option<&[Sample]>,
) -> String {
    let verdict = verdict_line(finished, clock);
    let mut page = begun(&verdict, verdict.starts_with("ok"));
    if finished.was_interrupted {
        page.paragraph("The run was stopped by a signal; everything finished before is kept.");
    }
    if let Some(error) = &finished.end.error {
        page.paragraph(&format!("The run ended early: {error}"));
    }
    if !finished.end.losses.is_empty() {
        page.paragraph(&finished.end.losses.to_string());
    }
    write_what_ran(&mut page, finished, clock);
    write_verdicts(&mut page, report);
    write_frames(&mut page, finished);
    write_timing(&mut page, finished, clock);
    write_events(&mut page, finished);
    write_pointing(&mut page, finished, recording);
    write_samples(&mut page, samples);
    write_provenance(&mut page, finished);
    page.end()
}

fn write_what_ran(page: &mut Page, finished: &Finished, clock: ClockKind) {
    let summary = finished.summary(clock);
    page.heading("What ran");
    let (simulated_s, wall_s) = (finished.end.simulated_s, finished.wall_s);
    let (clock, period_ms) = (summary.clock, 1e3 * summary.frame_period_s);
    page.values([
        ("run", summary.bench),
        ("camera", summary.camera),
        ("backend", format!("{} ({})", summary.backend, summary.adapter)),
        ("first slot", summary.start_utc),
        ("time", format!("{simulated_s:.3} s on the {clock} clock in {wall_s:.3} s; a frame every {period_ms:.3} ms")),
        ("seeds", format!("{} of the run, {} of the noise", summary.seed, summary.noise_seed)),
        ("CRC-32 of the frames", summary.run_crc32),
    ]);
}

fn write_verdicts(page: &mut Page, report: Option<&ScenarioReport>) {
    let Some(report) = report else { return };
    if !report.verdicts.is_empty() || !report.violation_lines.is_empty() {
        page.heading("Expectations");
        page.table(&["what", "wanted", "got", "verdict"]);
        for verdict in report.verdicts.iter().take(MOST_ROWS) {
            let word = if verdict.passed { "met" } else { "NOT MET" };
            page.row(&[verdict.name.into(), verdict.wanted.clone(), verdict.got.clone(), word.into()]);
        }
        for line in report.violation_lines.iter().take(MOST_ROWS) {
            page.row(&["invariant".into(), "holds".into(), line.clone(), "BROKEN".into()]);
        }
        page.end_table();
    }
    if !report.faults.is_empty() {
        page.heading("Faults");
        page.table(&["fault", "from, s", "until, s", "hits"]);
        for fault in report.faults.iter().take(MOST_ROWS) {
            let second = |s: f64| if s.is_finite() { format!("{s:.3}") } else { "-".into() };
            page.row(&[fault.name.into(), second(fault.from_s), second(fault.until_s), fault.hits.to_string()]);
        }
        page.end_table();
    }
}

fn write_frames(page: &mut Page, finished: &Finished) {
    let (frames, account) = (&finished.end.record.frames, finished.end.account());
    page.heading("Frames");
    page.table(&["what became of the promised frames", "frames"]);
    FrameEnd::ALL.iter().for_each(|end| page.row(&[end.words().into(), account.of(*end).count.to_string()]));
    page.row(&["all".into(), account.scheduled().to_string()]);
    page.end_table();
    let counts = [
        ("rendered", frames.rendered),
        ("delivered", frames.delivered),
        ("late", frames.late),
        ("held", frames.held),
        ("dropped", frames.dropped),
        ("extrapolated", frames.extrapolated),
        ("partly extrapolated", frames.partly_extrapolated),
        ("jitter missing", frames.jitter_missing),
        ("blank", frames.blank),
    ];
    page.table(&["count", "frames"]);
    counts.iter().for_each(|(name, count)| page.row(&[(*name).into(), count.to_string()]));
    page.end_table();
    page.table(&["sink", "kind", "taken", "dropped", "refused", "output"]);
    for line in finished.end.sink_lines.iter().take(MOST_ROWS) {
        let numbers = [line.frames, line.dropped, line.refused].map(|count| count.to_string());
        let [taken, dropped, refused] = numbers;
        let output = line.output.clone().unwrap_or_default();
        page.row(&[line.place.clone(), line.kind.into(), taken, dropped, refused, output]);
    }
    page.end_table();
}

fn write_timing(page: &mut Page, finished: &Finished, clock: ClockKind) {
    page.heading("Time of each stage");
    let is_real = clock == ClockKind::Real;
    if is_real {
        page.paragraph("Limits are those of [budget], for the 99 % quantile; below 100 frames for the longest.");
    } else {
        page.paragraph(
            "No limit applies on the virtual clock: ages are simulated, the other times are those of this machine.",
        );
    }
    let limits = limits(finished.bench(), finished.engine());
    let record = &finished.end.record;
    let mut lines = budget_lines(&limits, &record.stages, &record.ring);
    lines.extend(answer_lines(&finished.end.answers));
    page.table(&["stage", "limit, ms", "count", "p50, ms", "p99, ms", "longest, ms", "verdict"]);
    for line in lines.iter().filter(|line| line.times.is_some_and(|times| times.count > 0) || is_real) {
        page.row(&timing_cells(line, is_real));
    }
    page.end_table();
}

fn timing_cells(line: &BudgetLine, is_real: bool) -> [String; 7] {
    let times = line.times.unwrap_or_default();
    let ms = |ms: f64| if times.count > 0 { format!("{ms:.3}") } else { "-".into() };
    let count = line.slots.unwrap_or(times.count);
    let limit = line.limit.filter(|_| is_real).map_or_else(|| "-".into(), |limit| format!("{limit:.3}"));
    let verdict = if is_real { line.verdict.name() } else { "-" };
    [
        line.name.into(),
        limit,
        count.to_string(),
        ms(times.p50_ms),
        ms(times.p99_ms),
        ms(times.max_ms),
        verdict.to_owned(),
    ]
}

fn write_events(page: &mut Page, finished: &Finished) {
    let record = &finished.end.record;
    page.heading("Events");
    let (total, missing) = (record.ledger.total(), files::left_out(record));
    let (first, last) = (run::runtime::ledger::EARLY, run::runtime::ledger::KEPT);
    let rest = match missing {
        0 => format!("all of them are in {}", files::FILE),
        _ => format!(
            "the first {first} and the last {last} are in {}; the {missing} between are only counted",
            files::FILE
        ),
    };
    page.paragraph(&if total == 0 { "No events.".into() } else { format!("Events: {total}; {rest}.") });
    if let Some(picture) = timeline(record, finished.end.times.zero, finished.end.times.end) {
        page.add(&picture);
    }
    if total > 0 {
        page.table(&["event", "count", "meaning"]);
        for (kind, count) in files::counted(record).take(MOST_ROWS) {
            page.row(&[kind.name().into(), count.to_string(), kind.meaning().into()]);
        }
        page.end_table();
    }
}

/// Writes the picture of the telemetry of a flight; of a run without a spacecraft the boresight of its recorded frames.
fn write_pointing(page: &mut Page, finished: &Finished, recording: Option<&Recording>) {
    let flown = finished.scenario.vehicle().and(finished.directory.as_ref());
    let flown = flown.and_then(|folder| read_text(&folder.join("telemetry.svg"), DATA_BYTES).ok());
    let picture = flown.or_else(|| chart_of_pointing(&recording?.rows));
    page.heading("Pointing");
    match picture {
        Some(picture) => page.picture(&picture),
        None => page.paragraph("Not known: neither a flight nor recorded frames."),
    }
}

fn write_samples(page: &mut Page, samples: Option<&[Sample]>) {
    page.heading("Frames of the run");
    let Some(samples) = samples else {
        page.paragraph("Left out: the page would be larger than 300 kB.");
        return;
    };
    if samples.is_empty() {
        page.paragraph("None is recorded as FITS.");
    }
    for Sample { row, png, size: [width, height], shrink } in samples {
        let degrees = |value: Option<f64>| value.map_or_else(|| "-".into(), |deg| format!("{deg:.5}"));
        let caption = format!(
            "frame {}: right ascension {} deg, declination {} deg, roll {} deg, {} stars; each pixel is the brightest of {shrink} x {shrink}",
            row.frame,
            degrees(row.ra_deg),
            degrees(row.dec_deg),
            degrees(row.roll_deg),
            row.stars.map_or_else(|| "-".into(), |stars| stars.to_string()),
        );
        page.image(&base::base64::encode(png), [*width, *height], &caption);
    }
}

fn write_provenance(page: &mut Page, finished: &Finished) {
    let text =
        finished.directory.as_ref().and_then(|folder| read_bytes(&folder.join(provenance::FILE), DATA_BYTES).ok());
    match text.and_then(|text| serde_json::from_slice::<Provenance>(&text).ok()) {
        Some(from) => from.write(page, MOST_ROWS),
        None => {
            page.heading("Provenance");
            page.paragraph("provenance.json could not be read.");
        }
    }
}
