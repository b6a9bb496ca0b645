//! Parts of a run's page: headings, tables, pictures, and how they look in light and dark.

use crate::cli::run_samples::Row;
use base::xml::escaped;
use core::fmt::Write;
use frames::report::plot::{Axis, Chart, Series, Style, to_svg};

const STYLE: &str = ":root{color-scheme:light dark;--ink:#222;--paper:#fff;--line:#d9d9d9;--head:#f3f3f3;--mark:#0072b2}\
@media(prefers-color-scheme:dark){:root{--ink:#e6e6e6;--paper:#16181b;--line:#3a3e44;--head:#22262b;--mark:#56b4e9}}\
body{font:15px/1.45 Helvetica,Arial,'DejaVu Sans',sans-serif;color:var(--ink);background:var(--paper);max-width:64em;margin:1.2em auto;padding:0 1em}\
h1{font-size:1.15em;padding:.6em .8em;border-radius:4px;color:#fff;overflow-wrap:anywhere}.met{background:#00694e}.broken{background:#a83a00}\
h2{font-size:1.05em;margin:1.6em 0 .3em;border-bottom:1px solid var(--line)}.wide{overflow-x:auto}\
table{border-collapse:collapse;font-size:.86em;margin:.4em 0}th,td{text-align:left;padding:.2em .7em;border-bottom:1px solid var(--line);vertical-align:top;overflow-wrap:anywhere}\
th{background:var(--head)}svg{max-width:100%;height:auto}.card{background:#fff;display:inline-block;max-width:100%}\
svg.line{width:760px;font-size:12px;fill:var(--ink)}svg.line .mark{stroke:var(--mark);stroke-width:4;fill:none}svg.line .axis{stroke:var(--ink)}\
figure{display:inline-block;vertical-align:top;margin:.4em 1em .4em 0;max-width:18em}figure img{image-rendering:pixelated;max-width:100%;border:1px solid var(--line)}figcaption{font-size:.8em}";
/// Most points of the chart of the boresight.
const MOST_POINTS: usize = 400;
const ARCSEC_PER_DEG: f64 = 3600.0;

/// The page while it grows.
pub(super) struct Page(String);

impl Page {
    /// Returns a page that begins with a verdict: its first line has it as title, its first words are the heading.
    pub(super) fn begun(verdict: &str, is_good: bool) -> Self {
        let verdict = escaped(verdict);
        let class = if is_good { "met" } else { "broken" };
        Self(format!(
            "<!DOCTYPE html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>{verdict}</title>\n\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
             <meta name=\"starloop-schema\" content=\"starloop.run_page/1\">\n<style>{STYLE}</style></head>\n\
             <body><h1 class=\"{class}\">{verdict}</h1>\n"
        ))
    }

    /// Returns the whole text.
    pub(super) fn end(mut self) -> String {
        self.add("</body></html>");
        self.0
    }

    /// Adds HTML as it is.
    pub(super) fn add(&mut self, html: &str) {
        self.0.push_str(html);
        self.0.push('\n');
    }

    pub(super) fn heading(&mut self, text: &str) {
        self.add(&format!("<h2>{}</h2>", escaped(text)));
    }

    pub(super) fn paragraph(&mut self, text: &str) {
        self.add(&format!("<p>{}</p>", escaped(text)));
    }

    /// Begins a table with its heads.
    pub(super) fn table(&mut self, heads: &[&str]) {
        let heads = cells("th", heads.iter().copied());
        self.add(&format!("<div class=\"wide\"><table><thead><tr>{heads}</tr></thead><tbody>"));
    }

    pub(super) fn row(&mut self, texts: &[String]) {
        self.add(&format!("<tr>{}</tr>", cells("td", texts.iter().map(String::as_str))));
    }

    pub(super) fn end_table(&mut self) {
        self.add("</tbody></table></div>");
    }

    /// Adds an SVG that is drawn on white.
    pub(super) fn picture(&mut self, svg: &str) {
        self.add(&format!("<div class=\"card\">{svg}</div>"));
    }

    /// Adds a PNG, in Base64, with its caption.
    pub(super) fn image(&mut self, png: &str, [width, height]: [usize; 2], caption: &str) {
        let caption = escaped(caption);
        self.add(&format!(
            "<figure><img alt=\"{caption}\" width=\"{width}\" height=\"{height}\" src=\"data:image/png;base64,{png}\">\
             <figcaption>{caption}</figcaption></figure>"
        ));
    }
}

fn cells<'a>(kind: &str, texts: impl Iterator<Item = &'a str>) -> String {
    texts.fold(String::new(), |mut all, text| {
        // Writing to a string cannot fail.
        let _ = write!(all, "<{kind}>{}</{kind}>", escaped(text));
        all
    })
}

/// Returns how far the boresight of recorded frames is from that of the first, as SVG; `None` without frames.
pub(super) fn chart_of_pointing(rows: &[Row]) -> Option<String> {
    let first = rows.first()?;
    let (zero_ns, ra_deg, dec_deg) = (first.mid_exposure_tai_ns, first.ra_deg?, first.dec_deg?);
    let step = rows.len().div_ceil(MOST_POINTS).max(1);
    let of = |measure: &dyn Fn(&Row) -> Option<f64>| -> Vec<[f64; 2]> {
        let point =
            |row: &Row| Some([(row.mid_exposure_tai_ns - zero_ns) as f64 * 1e-9, measure(row)? * ARCSEC_PER_DEG]);
        rows.iter().step_by(step).filter_map(point).collect()
    };
    let across = |row: &Row| Some(turned_deg(row.ra_deg? - ra_deg) * dec_deg.to_radians().cos());
    let up = |row: &Row| Some(row.dec_deg? - dec_deg);
    Some(to_svg(&Chart {
        title: "Boresight of the recorded frames, from that of the first".into(),
        x: Axis::linear("time after the first frame, s"),
        y: Axis::linear("angle, arcsec"),
        series: vec![
            Series::new("right ascension, times cos(declination)", Style::Line, 0, of(&across)),
            Series::new("declination", Style::Line, 1, of(&up)),
        ],
        ring: String::new(),
        notes: vec![format!("first frame: right ascension {ra_deg:.6} deg, declination {dec_deg:.6} deg")],
    }))
}

/// Returns an angle from -180 to 180 deg.
fn turned_deg(deg: f64) -> f64 {
    (deg + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_from_outside_is_no_markup_and_the_first_line_has_the_verdict() {
        let mut page = Page::begun("FAILED: <b>", false);
        page.row(&["<script>".into()]);
        let text = page.end();
        assert!(text.lines().next().unwrap().contains("<title>FAILED: &lt;b&gt;</title>"), "{text}");
        assert!(text.contains("class=\"broken\"") && !text.contains("<script"), "{text}");
        assert!(Page::begun("ok", true).end().contains("class=\"met\""));
    }

    #[test]
    fn boresight_that_crosses_zero_right_ascension_makes_a_small_step() {
        let row = |frame: u32, ra_deg: f64| Row {
            frame,
            mid_exposure_tai_ns: i64::from(frame) * 1_000_000_000,
            ra_deg: Some(ra_deg),
            dec_deg: Some(0.0),
            roll_deg: None,
            stars: None,
        };
        assert!((turned_deg(359.9 - 0.1) + 0.2).abs() < 1e-9);
        let svg = chart_of_pointing(&[row(0, 0.1), row(1, 359.9)]).unwrap();
        assert!(svg.contains("-800") || svg.contains("-700"), "{svg}");
        assert!(!svg.contains("1000000"), "{svg}");
        assert!(chart_of_pointing(&[]).is_none());
    }
}
