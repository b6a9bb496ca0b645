//! The run summary as text for a terminal: aligned columns, units in the headings.

use crate::report::summary::{HEADINGS, RunSummary, plain_names};
use crate::report::{histogram::Quantiles, sink_line::SinkLine, stages::Stage};
use base::time::{Span, Tai};
use std::collections::BTreeMap;

/// Fewer times than this and the 99.9 % quantile is simply the longest.
const ENOUGH_FOR_P999: u64 = 1_000;
/// Width of the first column.
const NAME_WIDTH: usize = 22;
/// Width of a column of numbers.
const NUMBER_WIDTH: usize = 11;

/// Count of messages of other nodes of a shared bus, of each port.
pub const OF_OTHER_NODES: &str = "messages_of_other_nodes";
/// Time marks of accepted messages that the clock's estimate leaves out.
const MARKS: [&str; 2] = ["late_time_mark", "outlier_time_mark"];

/// Lays out a summary; ends in a line break.
pub fn summary_table(summary: &RunSummary) -> String {
    let mut lines = Vec::new();
    push_run(&mut lines, summary);
    push_frames(&mut lines, summary);
    push_times(&mut lines, summary);
    push_counts(&mut lines, summary);
    push_sinks(&mut lines, summary);
    push_gateways(&mut lines, summary);
    lines.extend(answer_rows(summary));
    push_events(&mut lines, summary);
    push_remarks(&mut lines, summary);
    let trimmed: Vec<&str> = lines.iter().map(|line| line.trim_end()).collect();
    trimmed.join("\n") + "\n"
}

/// Lays out the most important numbers of a summary; ends in a line break.
pub fn short_table(s: &RunSummary) -> String {
    let f = &s.frames;
    let times = |q: &Quantiles| format!("p50 {:.3} ms, p99 {:.3} ms, longest {:.3} ms", q.p50_ms, q.p99_ms, q.max_ms);
    let counts = [
        ("late", f.late),
        ("held", f.held),
        ("dropped", f.dropped),
        ("blank", f.blank),
        ("extrapolated", f.extrapolated),
    ];
    let counts: Vec<String> = counts.iter().filter(|(_, n)| *n > 0).map(|(name, n)| format!(", {n} {name}")).collect();
    let named = |names: &[&str]| names.iter().filter_map(|name| s.link.rejects.get(*name)).sum::<u64>();
    let of_others = s.link.counters.iter().filter(|(name, _)| name.ends_with(OF_OTHER_NODES));
    let (foreign, unused) = (of_others.map(|(_, count)| *count).sum(), named(&MARKS));
    let rejected = s.link.rejects.values().sum::<u64>() - unused;
    let others = [(foreign, "of other nodes"), (unused, "time marks unused")];
    let others: Vec<String> = others.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!(", {n} {what}")).collect();
    let others = others.concat();
    let accepted = s.link.counters.get("attitudes_accepted").copied().unwrap_or(0);
    let mut rows = vec![
        ("bench", format!("{}, camera \"{}\", {} backend", s.bench, s.camera, s.backend)),
        ("frames", format!("{} scheduled, {} delivered{}", f.scheduled, f.delivered, counts.concat())),
        ("release to delivered", times(&s.stages[Stage::ReleaseToDelivered as usize])),
        (
            "attitudes",
            format!("{accepted} accepted, {rejected} messages refused{others}; age {}", times(&s.attitude_age)),
        ),
    ];
    if !s.faults.is_empty() {
        rows.push(("frames with", joined(&s.faults)));
    }
    if !s.degraded.is_empty() {
        rows.push(("degraded, frames", joined(&s.degraded)));
    }
    rows.push(("output", format!("{} {}", s.sink, s.output.as_deref().unwrap_or("(nothing kept)"))));
    rows.push(("run CRC-32", s.run_crc32.clone()));
    let mut lines: Vec<String> = rows.into_iter().map(|(name, value)| format!("{name:<NAME_WIDTH$}{value}")).collect();
    let in_trouble = |row: &&SinkLine| row.dropped + row.refused > 0 || row.is_lost;
    lines.extend(s.sinks.iter().filter(in_trouble).map(|row| {
        format!("{:<NAME_WIDTH$}{} taken, {} dropped, {} refused", row.place, row.frames, row.dropped, row.refused)
    }));
    lines.extend(s.gateways.iter().filter(|row| row.dropped > 0).map(|row| {
        format!("{:<NAME_WIDTH$}dropped {} frames that its client read too slowly", row.gateway, row.dropped)
    }));
    lines.extend(answer_rows(s));
    lines.push("(--details: every stage, counter and event)".into());
    lines.join("\n") + "\n"
}

fn push_run(lines: &mut Vec<String>, s: &RunSummary) {
    let machine = format!("{}, {} hardware threads, {}", s.machine.cpu, s.machine.cores, s.machine.system);
    let length = format!("{:.3} s on the {} clock, {:.3} s of wall time", s.duration_s, s.clock, s.wall_s);
    let rows = [
        ("bench", s.bench.clone()),
        ("camera", s.camera.clone()),
        ("backend", format!("{} ({})", s.backend, s.adapter)),
        ("machine", machine),
        ("start", s.start_utc.clone()),
        ("length", length),
        ("frame period", format!("{:.3} ms", s.frame_period_s * 1e3)),
        ("seed", seeds_text(s)),
        ("output", format!("{} {}", s.sink, s.output.as_deref().unwrap_or("(nothing kept)"))),
        ("run CRC-32", s.run_crc32.clone()),
    ];
    lines.extend(rows.into_iter().map(|(name, value)| format!("{name:<NAME_WIDTH$}{value}")));
}

/// Returns the run's seed, and that of the noise where it is another.
fn seeds_text(s: &RunSummary) -> String {
    if s.noise_seed == s.seed { s.seed.to_string() } else { format!("{}, noise {}", s.seed, s.noise_seed) }
}

fn push_frames(lines: &mut Vec<String>, s: &RunSummary) {
    let f = &s.frames;
    let counts = [
        ("scheduled", f.scheduled),
        ("rendered", f.rendered),
        ("delivered", f.delivered),
        ("late", f.late),
        ("held", f.held),
        ("dropped", f.dropped),
        ("extrapolated", f.extrapolated),
        ("blank", f.blank),
    ];
    // "extrapolated" is wider than a column of times.
    const WIDTH: usize = NUMBER_WIDTH + 2;
    let line = |name: &str, cells: Vec<String>| {
        let cells: String = cells.iter().map(|cell| format!("{cell:>WIDTH$}")).collect();
        format!("{name:<NAME_WIDTH$}{cells}")
    };
    for half in counts.chunks(4) {
        lines.push(String::new());
        lines.push(line("frames", half.iter().map(|(name, _)| (*name).to_owned()).collect()));
        lines.push(line("", half.iter().map(|(_, n)| n.to_string()).collect()));
    }
}

fn push_times(lines: &mut Vec<String>, s: &RunSummary) {
    push_times_heading(lines, "wall time of");
    lines.extend(Stage::ALL.iter().zip(&s.stages).map(|(stage, quantiles)| times_row(stage.name(), quantiles)));
    push_times_heading(lines, "on the run's clock");
    lines.push(times_row("lateness", &s.lateness));
    lines.push(times_row("attitude age", &s.attitude_age));
    lines.push(times_row("prediction horizon", &s.horizon));
    if s.intake.count > 0 {
        lines.push(times_row("bus to history", &s.intake));
    }
    // Two of the names are wider than their column: they are written without their common part.
    const NAMES: [&str; 4] = ["epoch-submitted", "submitted-delivered", "epoch-delivered", "mid-exp.-delivered"];
    let latency = NAMES.into_iter().zip(s.latency.named()).filter(|(_, (_, q))| q.count > 0);
    lines.extend(latency.map(|(name, (_, q))| times_row(name, q)));
}

fn push_times_heading(lines: &mut Vec<String>, name: &str) {
    lines.push(String::new());
    lines.push(row(name, &["count", "mean ms", "p50 ms", "p99 ms", "p99.9 ms", "max ms"].map(String::from)));
}

fn times_row(name: &str, q: &Quantiles) -> String {
    if q.count == 0 {
        return row(name, &["0", "-", "-", "-", "-", "-"].map(String::from));
    }
    let times = [q.mean_ms, q.p50_ms, q.p99_ms, q.p999_ms, q.max_ms].map(|ms| format!("{ms:.3}"));
    row(name, &[&[q.count.to_string()], times.as_slice()].concat())
}

fn row(name: &str, cells: &[String]) -> String {
    let cells: String = cells.iter().map(|cell| format!(" {cell:>NUMBER_WIDTH$}")).collect();
    format!("{name:<NAME_WIDTH$}{cells}")
}

fn push_counts(lines: &mut Vec<String>, s: &RunSummary) {
    let stars = format!("min {}, median {}, max {}", s.stars.min, s.stars.median, s.stars.max);
    let rows = [
        ("stars per frame", stars),
        ("smear method, frames", joined(&s.methods)),
        ("degraded, frames", joined(&s.degraded)),
        ("missed, slots", joined(&s.misses)),
        ("faults, frames", joined(&s.faults)),
        ("link", joined(&s.link.counters)),
        ("link rejects", joined(&plain_names(&s.link.rejects))),
        ("events", joined(&s.event_counts)),
    ];
    lines.push(String::new());
    lines.extend(rows.into_iter().map(|(name, value)| format!("{name:<NAME_WIDTH$}{value}")));
}

/// Adds a row per sink when there are several or one has something to report; failures and outputs below.
fn push_sinks(lines: &mut Vec<String>, s: &RunSummary) {
    let is_plain =
        |row: &SinkLine| row.dropped + row.refused == 0 && row.first_error.is_none() && row.named_counts().is_empty();
    if let [] | [_] = s.sinks.as_slice()
        && s.sinks.iter().all(is_plain)
    {
        return;
    }
    lines.push(String::new());
    let heads = ["frames", "dropped", "refused", "MB", "mean ms", "max ms"].map(String::from);
    lines.push(row("sinks", &heads));
    for sink in &s.sinks {
        let counts = [sink.frames, sink.dropped, sink.refused].map(|count| count.to_string());
        let sizes = [format!("{:.1}", sink.bytes as f64 / 1e6)];
        let delays = [sink.mean_delay, sink.longest_delay].map(|delay| format!("{:.1}", delay.ms()));
        lines.push(row(sink.kind, &[&counts, &sizes[..], &delays].concat()));
        let lost = sink.is_lost.then(|| "broke down: it took nothing from then on".to_owned());
        let counts = sink.named_counts();
        let counts = (!counts.is_empty()).then(|| joined(&counts));
        let output = sink.output.as_ref().map(|output| format!("to {output}"));
        let error = sink.first_error.as_ref().map(|error| format!("first failure: {error}"));
        lines
            .extend([output, counts, lost, error].into_iter().flatten().map(|text| format!("  {} {text}", sink.place)));
    }
}

/// Adds a row per gateway, with the frames it refused below.
fn push_gateways(lines: &mut Vec<String>, s: &RunSummary) {
    if s.gateways.is_empty() {
        return;
    }
    lines.push(String::new());
    lines.push(row("gateways", &HEADINGS.map(String::from)));
    for gateway in &s.gateways {
        lines.push(row(&gateway.gateway, &gateway.cells()));
        lines.extend(gateway.lines());
    }
}

/// Returns a line for each star tracker outside.
fn answer_rows(s: &RunSummary) -> impl Iterator<Item = String> + '_ {
    s.answers.iter().map(|row| format!("{:<NAME_WIDTH$}{}", row.place, row.words()))
}

/// Returns counts by name in words.
pub(super) fn joined(counts: &BTreeMap<String, u64>) -> String {
    let parts: Vec<String> = counts.iter().map(|(name, n)| format!("{name} {n}")).collect();
    if parts.is_empty() { "none".into() } else { parts.join(", ") }
}

fn push_events(lines: &mut Vec<String>, s: &RunSummary) {
    if s.last_events.is_empty() {
        return;
    }
    lines.push(String::new());
    lines.push(format!("last {} events", s.last_events.len()));
    let width = s.last_events.iter().map(|event| event.kind.len()).max().unwrap_or(0);
    for event in &s.last_events {
        let frame = event.frame.map_or_else(|| "-".into(), |n| n.to_string());
        lines.push(format!("  {}  frame {frame:>6}  {:<width$} {}", event.at_utc, event.kind, event.detail));
    }
}

/// Adds the remarks that a reader needs to judge the numbers above.
fn push_remarks(lines: &mut Vec<String>, s: &RunSummary) {
    let mut remarks = Vec::new();
    if s.clock == "virtual" {
        remarks.push(
            "virtual clock: stage times are this machine's, lateness is simulated; neither predicts a bench".into(),
        );
    }
    let delivered = s.stages[Stage::ReleaseToDelivered as usize].count;
    if delivered < ENOUGH_FOR_P999 {
        remarks.push(format!("{delivered} frames delivered: p99.9 is the longest of fewer than {ENOUGH_FOR_P999}"));
    }
    if s.frames.delivered < s.frames.scheduled {
        remarks.push(format!(
            "{} of {} scheduled frames were not delivered",
            s.frames.scheduled - s.frames.delivered,
            s.frames.scheduled
        ));
    }
    if !remarks.is_empty() {
        lines.push(String::new());
        lines.extend(remarks.into_iter().map(|remark: String| format!("note: {remark}")));
    }
}

// The newest events of a run, as plain values of fixed size.
//
// In: events, oldest first, from the run's ledger. Out: the last [`NEWEST_MAX`] of them. No allocation, no text. Test:
// below.

/// Number of events that are reported with their times.
pub const NEWEST_MAX: usize = 24;

/// One event of the ledger.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NewestEvent {
    /// Name of its kind.
    pub kind: &'static str,
    /// Name of the fault or thread; empty in events of other kinds.
    pub what: &'static str,
    /// Instant of the event.
    pub at: Tai,
    /// Frame in which it happened.
    pub frame: Option<u32>,
    /// Duration; its meaning depends on the kind.
    pub span: Span,
}

/// The newest events, in the order in which they happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NewestEvents {
    list: [NewestEvent; NEWEST_MAX],
    count: usize,
}

impl NewestEvents {
    /// No event.
    pub const NONE: Self = Self {
        list: [NewestEvent { kind: "", what: "", at: Tai::from_ns(0), frame: None, span: Span::ZERO }; NEWEST_MAX],
        count: 0,
    };

    /// Returns the events, oldest first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &NewestEvent> {
        let split = if self.count > NEWEST_MAX { self.count % NEWEST_MAX } else { 0 };
        let (newer, older) = self.list[..self.count.min(NEWEST_MAX)].split_at(split);
        older.iter().chain(newer)
    }
}

impl FromIterator<NewestEvent> for NewestEvents {
    fn from_iter<I: IntoIterator<Item = NewestEvent>>(events: I) -> Self {
        events.into_iter().fold(Self::NONE, |mut newest, event| {
            newest.list[newest.count % NEWEST_MAX] = event;
            newest.count += 1;
            newest
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::summary::sample_summary;

    fn line_of<'a>(text: &'a str, name: &str) -> &'a str {
        text.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("no line {name} in\n{text}"))
    }

    #[test]
    fn numbers_are_under_their_headings() {
        let text = summary_table(&sample_summary());
        let heading = line_of(&text, "wall time of");
        let render = line_of(&text, "render");
        let end = |line: &str, word: &str| line.find(word).map(|at| at + word.len());
        for (name, value) in [("count", "600"), ("p99 ms", "1.000"), ("p99.9 ms", "1.500"), ("max ms", "2.000")] {
            assert_eq!(end(heading, name), end(render, value), "{name}\n{heading}\n{render}");
        }
        assert_ne!(end(heading, "p99 ms"), end(render, "1.500"), "the comparison can fail");
    }

    #[test]
    fn events_have_a_blank_behind_the_longest_name() {
        let mut summary = sample_summary();
        let mut event = summary.last_events[0].clone();
        event.kind = "attitude_missing".into();
        event.detail = "531.110 ms".into();
        summary.last_events.push(event);
        let text = summary_table(&summary);
        assert!(text.contains("  attitude_missing 531.110 ms"), "{text}");
    }

    #[test]
    fn reasons_of_refused_messages_are_plain_words() {
        let mut summary = sample_summary();
        summary.link.rejects = [("BadFraming".to_owned(), 2), ("future_time".to_owned(), 5)].into();
        let text = summary_table(&summary);
        assert!(line_of(&text, "link rejects").ends_with("bad framing 2, future time 5"), "{text}");
    }

    #[test]
    fn frame_counts_are_under_their_names() {
        let text = summary_table(&sample_summary());
        let lines: Vec<&str> = text.lines().collect();
        let at = lines.iter().position(|l| l.contains("extrapolated")).unwrap();
        let end = |line: &str, word: &str| line.find(word).map(|at| at + word.len());
        assert_eq!(end(lines[at], "extrapolated"), end(lines[at + 1], "590"), "{text}");
    }

    #[test]
    fn no_line_is_wider_than_a_terminal_of_100_columns_or_ends_in_blanks() {
        for line in summary_table(&sample_summary()).lines() {
            assert!(line.chars().count() <= 100 && line == line.trim_end(), "{line:?}");
        }
    }

    #[test]
    fn each_sink_has_its_line_and_one_alone_without_trouble_has_none() {
        let mut summary = sample_summary();
        summary.gateways.clear();
        let text = summary_table(&summary);
        let heading = line_of(&text, "sinks");
        let row = text.lines().find(|line| line.starts_with("recorder")).unwrap();
        let end = |line: &str, word: &str| line.find(word).map(|at| at + word.len());
        for (name, value) in [("frames", "590"), ("MB", "1234.6"), ("max ms", "310.0")] {
            assert_eq!(end(heading, name), end(row, value), "{name}\n{heading}\n{row}");
        }
        assert!(text.contains("extra_sink[0] first failure: no space") && text.contains("resent"), "{text}");
        let sink = &mut summary.sinks[0];
        (sink.dropped, sink.refused, sink.first_error) = (0, 0, None);
        sink.counts.clear();
        assert!(!summary_table(&summary).contains("refused"));
        summary.sinks.push(summary.sinks[0].clone());
        assert!(summary_table(&summary).contains("refused"), "two");
    }

    #[test]
    fn each_gateway_has_its_line_with_what_it_refused_by_reason() {
        let mut summary = sample_summary();
        let text = summary_table(&summary);
        let (heading, row) = (line_of(&text, "gateways"), line_of(&text, "socketcand"));
        let end = |line: &str, word: &str| line.find(word).map(|at| at + word.len());
        for (name, value) in [("refused", "51"), ("from them", "1234"), ("dropped", " 9")] {
            assert_eq!(end(heading, name), end(row, value), "{name}\n{heading}\n{row}");
        }
        assert!(text.contains("  refused 3 times: http request\n") && text.contains("12 FD frames withheld"), "{text}");
        summary.gateways.clear();
        assert!(!summary_table(&summary).contains("gateways"), "a run without any has no such table");
    }

    #[test]
    fn foreign_packets_and_unused_marks_are_no_refused_messages() {
        let mut summary = sample_summary();
        summary.link.rejects.clear();
        for (name, count) in [("BadCrc", 4), ("outlier_time_mark", 2), ("late_time_mark", 1)] {
            summary.link.rejects.insert(name.into(), count);
        }
        for (name, count) in [("messages_of_other_nodes", 75_580), ("port_1_messages_of_other_nodes", 4)] {
            summary.link.counters.insert(name.into(), count);
        }
        let text = short_table(&summary);
        let line = line_of(&text, "attitudes");
        assert!(line.contains("4 messages refused, 75584 of other nodes, 3 time marks unused;"), "{line}");
        assert!(line_of(&text, "socketcand").contains("dropped 9 frames"), "{text}");
        summary.link.rejects.clear();
        summary.link.counters.clear();
        summary.gateways.clear();
        let text = short_table(&summary);
        assert!(line_of(&text, "attitudes").contains("0 messages refused;") && !text.contains("socketcand"), "{text}");
    }

    #[test]
    fn a_stage_that_never_ran_has_no_times() {
        let text = summary_table(&sample_summary());
        assert!(line_of(&text, "readback").split_whitespace().eq(["readback", "0", "-", "-", "-", "-", "-"]), "{text}");
    }

    #[test]
    fn remarks_appear_only_where_they_apply() {
        let mut summary = sample_summary();
        let text = summary_table(&summary);
        assert!(text.contains("2 of 600 scheduled frames were not delivered"), "{text}");
        assert!(text.contains("p99.9 is the longest") && !text.contains("virtual clock"), "{text}");
        summary.clock = "virtual".into();
        summary.frames.delivered = 600;
        summary.stages[Stage::ReleaseToDelivered as usize].count = 5_000;
        let text = summary_table(&summary);
        assert!(
            text.contains("virtual clock") && !text.contains("not delivered") && !text.contains("longest"),
            "{text}"
        );
    }
}

#[cfg(test)]
mod newest_events_tests {
    use super::*;

    #[test]
    fn the_last_ones_are_reported_in_their_order() {
        let event = |frame: u32| NewestEvent { frame: Some(frame), ..NewestEvents::NONE.list[0] };
        for count in [0, 1, NEWEST_MAX, NEWEST_MAX + 1, 2 * NEWEST_MAX, 3 * NEWEST_MAX - 1] {
            let newest: NewestEvents = (0..count as u32).map(event).collect();
            let frames: Vec<u32> = newest.iter().filter_map(|event| event.frame).collect();
            let wanted: Vec<u32> = (count.saturating_sub(NEWEST_MAX) as u32..count as u32).collect();
            assert_eq!(frames, wanted, "{count} events");
        }
    }
}
