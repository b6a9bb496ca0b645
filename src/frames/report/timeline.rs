//! The worst frames as a chart: one row per frame, one bar per stage from its release, the deadline as a line.
//!
//! Input: frame records. Output: one SVG text on white, the same for the same input; colours of the other charts, the
//! second round of them lighter. *Limits.* Bars follow one after another as the stages followed each other; the queue
//! begins where the frame was handed over. Text widths are estimated. *Validation.* the tests parse it as XML and
//! measure the bars.

use crate::report::frame_record::{FrameRecord, MissCause};
use crate::report::plot::{Page, colour, round_above};
use crate::report::stages::Stage;
use base::time::{Span, Tai};

const WIDTH_PX: f64 = 960.0;
const LEFT_PX: f64 = 300.0;
const RIGHT_PX: f64 = 24.0;
const MARGIN_PX: f64 = 16.0;
const ROW_PX: f64 = 26.0;
const BAR_PX: f64 = 16.0;
const LINE_PX: f64 = 18.0;
/// Estimated width of a character of 12 px text, px.
const CHARACTER_PX: f64 = 7.0;
const SWATCH_PX: f64 = 18.0;
/// Bars of colours used a second time.
const LIGHT: f64 = 0.4;
/// Ticks aimed at along the axis.
const TICKS: f64 = 8.0;

/// One bar: a stage, and from when to when after the release, ms.
struct Bar {
    stage: Stage,
    from_ms: f64,
    to_ms: f64,
}

/// Draws the records in the order given.
pub fn timeline_svg(title: &str, records: &[FrameRecord]) -> String {
    let rows: Vec<Vec<Bar>> = records.iter().map(bars).collect();
    let due_ms = records.iter().map(|record| (record.due - record.release).ms()).fold(0.0, f64::max);
    let end_ms = rows.iter().flatten().map(|bar| bar.to_ms).fold(due_ms, f64::max).max(1e-3) * 1.04;
    let px = |ms: f64| LEFT_PX + ms.max(0.0) / end_ms * (WIDTH_PX - LEFT_PX - RIGHT_PX);
    let mut page = Page::default();
    let legend_bottom_px = write_legend(&mut page, &rows);
    let top_px = legend_bottom_px + 28.0;
    let bottom_px = top_px + ROW_PX * records.len().max(1) as f64;
    write_axis(&mut page, end_ms, [top_px, bottom_px], px);
    for (i, (record, bars)) in records.iter().zip(&rows).enumerate() {
        let y_px = top_px + ROW_PX * i as f64;
        write_row(&mut page, record, bars, y_px, px);
        write_deadline(&mut page, record, (y_px, i == 0), px);
    }
    if records.is_empty() {
        page.text_at([LEFT_PX + 12.0, top_px + 17.0], "start", "no frames");
    }
    page.document([WIDTH_PX, bottom_px + 56.0], MARGIN_PX, title)
}

/// Returns the stages of one frame, one after another; queue and sink from the moment of their handing over.
fn bars(record: &FrameRecord) -> Vec<Bar> {
    let after_ms = |at: Tai| (at - record.release).ms();
    let mut from_ms = 0.0;
    let mut bars = Vec::new();
    for stage in Stage::OF_A_FRAME {
        let Some(time) = record.times.get(stage).filter(|time| *time > Span::ZERO) else { continue };
        if stage == Stage::Queue {
            from_ms = record.submitted.map_or(from_ms, |at| after_ms(at).max(from_ms));
        }
        bars.push(Bar { stage, from_ms, to_ms: from_ms + time.ms() });
        from_ms += time.ms();
    }
    bars
}

fn fill(stage: Stage) -> (&'static str, f64) {
    const COLOURS: usize = 7;
    // Drawing, reading out and sending come first: their colours are the strongest.
    const ORDER: [Stage; 12] = [
        Stage::Render,
        Stage::Wake,
        Stage::Detector,
        Stage::Sink,
        Stage::Plan,
        Stage::Sky,
        Stage::Queue,
        Stage::Upload,
        Stage::Handover,
        Stage::Readback,
        Stage::Receive,
        Stage::Attitude,
    ];
    let place = ORDER.iter().position(|known| *known == stage).unwrap_or(0);
    (colour(place), if place < COLOURS { 1.0 } else { LIGHT })
}

fn write_legend(page: &mut Page, rows: &[Vec<Bar>]) -> f64 {
    let (mut x_px, mut y_px) = (MARGIN_PX, 50.0);
    let has_run = |stage: &Stage| rows.iter().flatten().any(|bar| bar.stage == *stage);
    for stage in Stage::OF_A_FRAME.into_iter().filter(has_run) {
        let width_px = SWATCH_PX + stage.name().len() as f64 * CHARACTER_PX + 16.0;
        if x_px + width_px > WIDTH_PX - RIGHT_PX {
            (x_px, y_px) = (MARGIN_PX, y_px + LINE_PX);
        }
        let (colour, opacity) = fill(stage);
        page.line(&format!(
            "<rect x=\"{x_px:.1}\" y=\"{:.1}\" width=\"12\" height=\"12\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>",
            y_px - 10.5
        ));
        page.text_at([x_px + SWATCH_PX, y_px], "start", stage.name());
        x_px += width_px;
    }
    y_px
}

fn write_axis(page: &mut Page, end_ms: f64, [top_px, bottom_px]: [f64; 2], px: impl Fn(f64) -> f64) {
    let step_ms = round_above(end_ms / TICKS);
    let digits = if step_ms < 0.1 { 2 } else { usize::from(step_ms < 1.0) };
    let mut ms = 0.0;
    while ms <= end_ms {
        let x_px = px(ms);
        page.line(&format!("<path d=\"M{x_px:.1} {top_px:.1}V{bottom_px:.1}\" stroke=\"#dcdcdc\"/>"));
        page.text_at([x_px, bottom_px + 17.0], "middle", &format!("{ms:.digits$}"));
        ms += step_ms;
    }
    let middle_px = 0.5 * (px(0.0) + px(end_ms));
    page.text_at([middle_px, bottom_px + 38.0], "middle", "ms after the release (end of the exposure)");
}

fn write_row(page: &mut Page, record: &FrameRecord, bars: &[Bar], y_px: f64, px: impl Fn(f64) -> f64) {
    let lateness_ms = record.lateness.ms();
    let when =
        if lateness_ms > 0.0 { format!("{lateness_ms:.1} ms late") } else { format!("{:.1} ms early", -lateness_ms) };
    let label = match record.cause.map(MissCause::name) {
        Some(cause) => format!("{}: {when}, {}: {cause}", record.number, record.fate.name()),
        None => format!("{}: {when}, {}", record.number, record.fate.name()),
    };
    page.text_at([LEFT_PX - 10.0, y_px + 17.0], "end", &label);
    let bar_px = y_px + 0.5 * (ROW_PX - BAR_PX);
    for bar in bars {
        let (colour, opacity) = fill(bar.stage);
        let (x_px, width_px) = (px(bar.from_ms), (px(bar.to_ms) - px(bar.from_ms)).max(0.3));
        page.line(&format!(
            "<rect class=\"{}\" x=\"{x_px:.2}\" y=\"{bar_px:.1}\" width=\"{width_px:.2}\" height=\"{BAR_PX}\" \
             fill=\"{colour}\" fill-opacity=\"{opacity}\"><title>{} {:.3} ms</title></rect>",
            bar.stage.name(),
            bar.stage.name(),
            bar.to_ms - bar.from_ms
        ));
    }
}

fn write_deadline(page: &mut Page, record: &FrameRecord, (y_px, is_first): (f64, bool), px: impl Fn(f64) -> f64) {
    let x_px = px((record.due - record.release).ms());
    page.line(&format!(
        "<path class=\"deadline\" d=\"M{x_px:.2} {y_px:.1}v{ROW_PX}\" stroke=\"#cc0000\" stroke-width=\"2\"/>"
    ));
    if is_first {
        page.line(&format!(
            "<text x=\"{x_px:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#cc0000\">deadline</text>",
            y_px - 6.0
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame_record::{Fate, sample_record};

    fn number(node: roxmltree::Node<'_, '_>, name: &str) -> f64 {
        node.attribute(name).unwrap().parse().unwrap()
    }

    #[test]
    fn bars_are_as_long_as_their_stages_and_the_deadline_lies_where_it_is() {
        let late = FrameRecord {
            lateness: Span::from_ms(12),
            fate: Fate::Held,
            cause: Some(MissCause::Stage(Stage::Render)),
            ..sample_record(3)
        };
        let svg = timeline_svg("worst <frames> & \"more\"", &[late, sample_record(4)]);
        let document = roxmltree::Document::parse(&svg).expect("well-formed");
        let of_class = |class: &str| -> Vec<_> {
            document.descendants().filter(|node| node.attribute("class") == Some(class)).collect()
        };
        let [render, detector] = ["render", "detector"].map(|stage| of_class(stage)[0]);
        let ratio = number(render, "width") / number(detector, "width");
        assert!((ratio - 20.0 / 8.0).abs() < 0.02, "{ratio}");
        assert!((number(render, "x") + number(render, "width") - number(detector, "x")).abs() < 0.02, "end to end");
        let deadlines = of_class("deadline");
        assert_eq!((deadlines.len(), of_class("readback").len()), (2, 0), "one per row; what did not run is absent");
        let x_px: f64 = deadlines[0].attribute("d").unwrap()[1..].split(' ').next().unwrap().parse().unwrap();
        let per_ms = number(render, "width") / 20.0;
        assert!((x_px - (LEFT_PX + 80.0 * per_ms)).abs() < 0.5, "{x_px}");
        assert!(svg.contains("held: render") && svg.contains("12.0 ms late"), "{svg}");
    }

    #[test]
    fn chart_without_frames_or_times_is_valid() {
        roxmltree::Document::parse(&timeline_svg("none", &[])).expect("well-formed");
        let at = Tai::from_ns(0);
        let empty = FrameRecord::released(0, [at; 3], [at; 2]);
        let svg = timeline_svg("nothing", &[empty]);
        assert!(roxmltree::Document::parse(&svg).is_ok() && !svg.contains("NaN"), "{svg}");
        assert!(roxmltree::Document::parse(&svg.replace("</svg>", "")).is_err(), "the comparison can fail");
    }
}
