//! [`Chart`] -> SVG text.

use super::axis::Tick;
use super::layout::{Entry, LINE_PX, Layout, SWATCH_PX, WIDTH_PX, colour, shape};
use super::{Chart, Series, Style};
use base::xml::escaped;

/// Lines of an SVG under construction.
#[derive(Default)]
pub(in crate::report) struct Page {
    text: String,
}

impl Page {
    pub(in crate::report) fn line(&mut self, line: &str) {
        self.text.push_str(line);
        self.text.push('\n');
    }

    pub(in crate::report) fn text_at(&mut self, [x, y]: [f64; 2], anchor: &str, text: &str) {
        let text = escaped(text);
        self.line(&format!(r#"<text x="{x:.1}" y="{y:.1}" text-anchor="{anchor}">{text}</text>"#));
    }

    /// Returns the whole document, with its title above on white.
    pub(in crate::report) fn document(&self, [width, height]: [f64; 2], left_px: f64, title: &str) -> String {
        let title = escaped(title);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height:.0}\" \
             viewBox=\"0 0 {width} {height:.0}\" role=\"img\" \
             font-family=\"Helvetica, Arial, 'DejaVu Sans', sans-serif\" font-size=\"12\" fill=\"#222222\">\n\
             <title>{title}</title>\n<rect width=\"{width}\" height=\"{height:.0}\" fill=\"#ffffff\"/>\n\
             <text x=\"{left_px}\" y=\"26\" font-size=\"15\" font-weight=\"bold\">{title}</text>\n{}</svg>\n",
            self.text
        )
    }
}

/// Returns the chart as an SVG document.
pub fn to_svg(chart: &Chart) -> String {
    let layout = Layout::of(chart);
    let mut page = Page::default();
    write_axes(&mut page, chart, &layout);
    for style in [Style::Front, Style::DashedLine, Style::Line, Style::Points] {
        for series in chart.series.iter().filter(|series| series.style == style) {
            write_series(&mut page, chart, &layout, series);
        }
    }
    for series in &chart.series {
        write_rings(&mut page, chart, &layout, series);
    }
    layout.legend.iter().for_each(|entry| write_entry(&mut page, entry));
    for (i, note) in layout.notes.iter().enumerate() {
        let y_px = layout.notes_px() + LINE_PX * i as f64;
        let x_px = layout.left_px;
        page.line(&format!(r##"<text class="note" x="{x_px}" y="{y_px:.1}" fill="#555555">{}</text>"##, escaped(note)));
    }
    page.document([WIDTH_PX, layout.height_px], layout.left_px, &chart.title)
}

fn write_axes(page: &mut Page, chart: &Chart, layout: &Layout) {
    let Layout { left_px, right_px, top_px, bottom_px, .. } = layout;
    for tick in layout.x.ticks() {
        let x = layout.x.px(tick.value);
        page.line(&format!(r#"<path d="M{x:.1} {top_px:.1}V{bottom_px:.1}" stroke="{}"/>"#, grid_colour(&tick)));
        write_tick_label(page, &tick, x, bottom_px + 17.0, "middle");
    }
    for tick in layout.y.ticks() {
        let y = layout.y.px(tick.value);
        page.line(&format!(r#"<path d="M{left_px:.1} {y:.1}H{right_px:.1}" stroke="{}"/>"#, grid_colour(&tick)));
        write_tick_label(page, &tick, left_px - 8.0, y + 4.0, "end");
    }
    let [width, height] = [right_px - left_px, bottom_px - top_px];
    page.line(&format!(
        r##"<rect class="frame" x="{left_px:.1}" y="{top_px:.1}" width="{width:.1}" height="{height:.1}" fill="none" stroke="#888888"/>"##
    ));
    let [middle_x, middle_y] = [0.5 * (left_px + right_px), 0.5 * (top_px + bottom_px)];
    let below = bottom_px + 38.0;
    let (x, y) = (escaped(&chart.x.label), escaped(&chart.y.label));
    page.line(&format!(r#"<text x="{middle_x:.1}" y="{below:.1}" font-size="13" text-anchor="middle">{x}</text>"#));
    page.line(&format!(
        r#"<text transform="translate(22 {middle_y:.1}) rotate(-90)" font-size="13" text-anchor="middle">{y}</text>"#
    ));
}

fn grid_colour(tick: &Tick) -> &'static str {
    if tick.label.is_some() { "#dcdcdc" } else { "#f2f2f2" }
}

fn write_tick_label(page: &mut Page, tick: &Tick, x: f64, y: f64, anchor: &str) {
    tick.label.iter().for_each(|label| page.text_at([x, y], anchor, label));
}

/// Returns the place of a point in the picture, if it has one.
fn place(chart: &Chart, layout: &Layout, point: [f64; 2]) -> Option<[f64; 2]> {
    chart.has_place_for(point).then(|| [layout.x.px(point[0]), layout.y.px(point[1])])
}

fn write_series(page: &mut Page, chart: &Chart, layout: &Layout, series: &Series) {
    if series.style == Style::Points {
        for [x, y] in series.points.iter().filter_map(|point| place(chart, layout, *point)) {
            write_mark(page, "mark", series.group, [x, y]);
        }
        return;
    }
    // A point that is left out interrupts the line.
    for run in series.points.split(|point| !chart.has_place_for(*point)).filter(|run| !run.is_empty()) {
        let places = run.iter().filter_map(|point| place(chart, layout, *point));
        let points: Vec<String> = places.map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        page.line(&format!(r#"<polyline points="{}" {}/>"#, points.join(" "), stroke(series.style, series.group)));
    }
}

fn stroke(style: Style, group: usize) -> String {
    let joined = r#"fill="none" stroke-linejoin="round""#;
    match style {
        Style::Front => {
            format!(r##"{joined} stroke="#f0d060" stroke-width="9" stroke-opacity="0.6" stroke-linecap="round""##)
        }
        Style::DashedLine => {
            format!(r#"{joined} stroke="{}" stroke-width="1.5" stroke-dasharray="6 4""#, colour(group))
        }
        Style::Line | Style::Points => format!(r#"{joined} stroke="{}" stroke-width="2""#, colour(group)),
    }
}

fn write_mark(page: &mut Page, class: &str, group: usize, [x, y]: [f64; 2]) {
    let (shape, colour) = (shape(group), colour(group));
    page.line(&format!(
        r##"<path class="{class}" transform="translate({x:.1} {y:.1})" d="{shape}" fill="{colour}" stroke="#ffffff" stroke-width="0.8"/>"##
    ));
}

fn write_rings(page: &mut Page, chart: &Chart, layout: &Layout, series: &Series) {
    let marked = series.marked.iter().filter_map(|i| series.points.get(*i));
    for [x, y] in marked.filter_map(|point| place(chart, layout, *point)) {
        write_ring(page, "ring", [x, y], 9.0);
    }
}

fn write_ring(page: &mut Page, class: &str, [x, y]: [f64; 2], radius: f64) {
    page.line(&format!(
        r##"<circle class="{class}" cx="{x:.1}" cy="{y:.1}" r="{radius}" fill="none" stroke="#111111" stroke-width="2"/>"##
    ));
}

fn write_entry(page: &mut Page, entry: &Entry) {
    let Entry { name, swatch, x_px, y_px } = entry;
    let (middle_px, axis_px) = (x_px + 11.0, y_px - 4.0);
    match swatch {
        None => write_ring(page, "legend", [middle_px, axis_px], 6.5),
        Some((Style::Points, group)) => write_mark(page, "legend", *group, [middle_px, axis_px]),
        Some((style, group)) => {
            let end_px = x_px + 22.0;
            let stroke = stroke(*style, *group);
            page.line(&format!(r#"<path d="M{x_px:.1} {axis_px:.1}H{end_px:.1}" {stroke}/>"#));
        }
    }
    let text_px = x_px + SWATCH_PX;
    page.line(&format!(r#"<text x="{text_px:.1}" y="{y_px:.1}">{}</text>"#, escaped(name)));
}
