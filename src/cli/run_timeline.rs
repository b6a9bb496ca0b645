//! Events of a run on a time line, as SVG inside a page: a row for each kind, a mark for each bin of time that has some.

use base::time::Tai;
use base::xml::escaped;
use core::fmt::Write;
use run::runtime::{EventKind, RunRecord};

/// Most rows: the kinds that happened most often come first.
const MOST_ROWS: usize = 16;
/// Bins of time.
const BINS: usize = 120;
const LEFT_PX: f64 = 190.0;
const WIDTH_PX: f64 = 760.0;
const ROW_PX: f64 = 22.0;
const TOP_PX: f64 = 12.0;

/// Returns the picture of a run from `zero` to `end`; `None` for one without events. Colours are those of the page.
pub(super) fn timeline(record: &RunRecord, zero: Tai, end: Tai) -> Option<String> {
    let mut kinds: Vec<(EventKind, u64)> = crate::cli::run_events::counted(record).collect();
    if kinds.is_empty() {
        return None;
    }
    kinds.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
    kinds.truncate(MOST_ROWS);
    // Before the first exposure messages and links have events too.
    let from = record.ledger.kept().map(|event| event.at).fold(zero, Tai::min);
    let until = record.ledger.kept().map(|event| event.at).fold(end, Tai::max);
    let length_s = (until - from).s().max(1e-9);
    let bin_px = (WIDTH_PX - LEFT_PX - 12.0) / BINS as f64;
    let bottom_px = TOP_PX + ROW_PX * kinds.len() as f64;
    let mut svg = format!(
        "<svg class=\"line\" viewBox=\"0 0 {WIDTH_PX} {:.0}\" role=\"img\" aria-label=\"events on a time line\">\n",
        bottom_px + 40.0
    );
    for (row, (kind, count)) in kinds.iter().enumerate() {
        let mut filled = [false; BINS];
        for event in record.ledger.kept().filter(|event| event.kind == *kind) {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to BINS")]
            let bin = ((event.at - from).s() / length_s * BINS as f64) as usize;
            filled[bin.min(BINS - 1)] = true;
        }
        let top_px = TOP_PX + ROW_PX * row as f64;
        let mut marks = String::new();
        for bin in (0..BINS).filter(|bin| filled[*bin]) {
            // Writing to a string cannot fail.
            let _ = write!(marks, "M{:.1} {:.1}v14", LEFT_PX + (bin as f64 + 0.5) * bin_px, top_px + 4.0);
        }
        let middle_px = top_px + 15.0;
        // Writing to a string cannot fail.
        let _ = writeln!(
            svg,
            "<text x=\"{:.0}\" y=\"{middle_px:.1}\" text-anchor=\"end\">{} ({count})</text><path class=\"mark\" d=\"{marks}\"><title>{}</title></path>",
            LEFT_PX - 8.0,
            kind.name(),
            escaped(kind.meaning()),
        );
    }
    write_axis(&mut svg, bottom_px, [(from - zero).s(), (until - zero).s()]);
    svg.push_str("</svg>");
    Some(svg)
}

/// Writes the axis of time with its two ends.
fn write_axis(svg: &mut String, bottom_px: f64, [from_s, until_s]: [f64; 2]) {
    let right_px = WIDTH_PX - 12.0;
    let text_px = bottom_px + 20.0;
    // Writing to a string cannot fail.
    let _ = writeln!(
        svg,
        "<path class=\"axis\" d=\"M{LEFT_PX} {bottom_px:.1}H{right_px}\"/><text x=\"{LEFT_PX}\" y=\"{text_px:.1}\">{from_s:.2} s</text>\
         <text x=\"{:.0}\" y=\"{text_px:.1}\" text-anchor=\"middle\">after the first exposure</text>\
         <text x=\"{right_px}\" y=\"{text_px:.1}\" text-anchor=\"end\">{until_s:.2} s</text>",
        0.5 * (LEFT_PX + right_px),
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Span;

    #[test]
    fn events_are_where_their_time_is_and_a_run_without_any_has_no_picture() {
        let zero = Tai::from_ns(0);
        let end = zero + Span::from_s(12.0);
        let mut record = RunRecord::default();
        assert!(timeline(&record, zero, end).is_none());
        record.note(EventKind::Late, zero + Span::from_s(6.01), 60, Span::ZERO);
        let svg = timeline(&record, zero, end).unwrap();
        let bin_px = (WIDTH_PX - LEFT_PX - 12.0) / BINS as f64;
        let wanted = |bin: f64| format!("d=\"M{:.1} 16.0v14\"", LEFT_PX + (bin + 0.5) * bin_px);
        assert!(svg.contains(&wanted(60.0)) && svg.contains("late (1)"), "{svg}");
        assert!(!svg.contains(&wanted(61.0)), "the comparison can fail");
        record.note(EventKind::Fault, zero - Span::from_s(1.0), 0, Span::ZERO);
        let svg = timeline(&record, zero, end).unwrap();
        assert!(svg.contains("-1.00 s") && !svg.contains("NaN"), "{svg}");
    }
}
