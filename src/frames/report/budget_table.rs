//! The budget as text for a terminal: a table of lines, misses by cause, unavailable settings, proposed changes.

use crate::report::budget::{BudgetLine, BudgetReport};
use crate::report::table::joined;

/// Below this count the 99 % quantile is the longest time.
const ENOUGH_FOR_P99: u64 = 100;

/// Lays out a report; ends in a line break.
pub fn budget_table(report: &BudgetReport) -> String {
    let mut lines = vec![
        format!(
            "budget of \"{}\": {:.1} s on the real clock, {} backend ({})",
            report.bench, report.duration_s, report.backend, report.adapter
        ),
        format!(
            "machine: {}, {} hardware threads, {}; busy threads beside the run: {}",
            report.machine.cpu, report.machine.cores, report.machine.system, report.load_threads
        ),
        String::new(),
        row(["stage", "budget ms", "p50 ms", "p99 ms", "p99.9 ms", "max ms"].map(String::from), "verdict"),
    ];
    lines.extend(report.lines.iter().map(line));
    lines.push(String::new());
    push_counts(&mut lines, report);
    let (obtained, asked) = (report.hygiene.iter().filter(|h| h.got).count(), report.hygiene.len());
    lines.push(format!("real-time scheduling and memory: {obtained} of {asked} requested settings obtained"));
    lines.extend(report.hygiene.iter().filter(|h| !h.got).map(|h| format!("unavailable: {}: {}", h.what, h.detail)));
    let few = report.frames.delivered < ENOUGH_FOR_P99;
    lines.extend(few.then(|| format!("note: with fewer than {ENOUGH_FOR_P99} frames p99 is the longest time")));
    lines.push(String::new());
    match report.culprit() {
        None => lines.push("the budget is met".into()),
        Some(culprit) => {
            lines.push(format!("the budget is BROKEN: {culprit}"));
            lines.extend(report.broken().filter_map(BudgetLine::complaint).map(|complaint| format!("  {complaint}")));
        }
    }
    lines.extend(report.advice.iter().map(|advice| format!("  {advice}")));
    let trimmed: Vec<&str> = lines.iter().map(|line| line.trim_end()).collect();
    trimmed.join("\n") + "\n"
}

fn line(line: &BudgetLine) -> String {
    let number = |value: f64| format!("{value:.3}");
    let limit = line.limit.map_or_else(|| "-".to_owned(), |limit| limit_text(line, limit));
    let cells = match (&line.times, line.slots) {
        (Some(q), _) if q.count > 0 => [q.p50_ms, q.p99_ms, q.p999_ms, q.max_ms].map(number),
        (_, Some(slots)) => [slots.to_string(), String::new(), String::new(), "slots".to_owned()],
        _ => core::array::from_fn(|_| "-".to_owned()),
    };
    let [p50, p99, p999, max] = cells;
    row([line.name.to_owned(), limit, p50, p99, p999, max], line.verdict.name())
}

fn limit_text(line: &BudgetLine, limit: f64) -> String {
    if line.slots.is_some() { format!("{limit:.0}") } else { format!("{limit:.3}") }
}

fn row([name, limit, p50, p99, p999, max]: [String; 6], verdict: &str) -> String {
    format!("{name:<22}{limit:>11}{p50:>11}{p99:>11}{p999:>11}{max:>11}  {verdict}")
}

fn push_counts(lines: &mut Vec<String>, report: &BudgetReport) {
    let f = &report.frames;
    lines.push(format!(
        "slots {}, drawn {}, delivered {}; late {}, held {}, dropped {}",
        f.scheduled, f.rendered, f.delivered, f.late, f.held, f.dropped
    ));
    lines.push(format!("missed by cause: {}", joined(&report.misses)));
    lines.push(format!("degraded, frames: {}", joined(&report.degraded)));
    for (name, q) in report.latency.named().into_iter().filter(|(_, q)| q.count > 0) {
        let [p50, p99, p999, max] = [q.p50_ms, q.p99_ms, q.p999_ms, q.max_ms];
        lines.push(format!("{name:<26} p50 {p50:.3}  p99 {p99:.3}  p99.9 {p999:.3}  max {max:.3} ms"));
    }
}
