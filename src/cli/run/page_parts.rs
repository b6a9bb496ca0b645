//! Parts of a run's page: its charts, recorded frames as small pictures.

use crate::cli::run::finished::Finished;
use base::input_file::{DATA_BYTES, InputFile};
use base::{image::DnImage, time::Tai, units::ARCSEC_PER_DEG, xml::escaped};
use core::fmt::Write;
use frames::report::Page;
use frames::report::plot::{Axis, Chart, Series, Style, to_svg};
use frames::sink::{fits::FitsImage, png::write_dn_for_people, recorder::frame_path};
use run::runtime::{EventKind, RunRecord};
use serde::Deserialize;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// The name by which programs know the page of a run.
const SCHEMA: &str = "<meta name=\"starloop-schema\" content=\"starloop.run_page/1\">\n";
/// Most points of the chart of the boresight.
const MOST_POINTS: usize = 400;

/// Returns a page that begins with a verdict: its first line has it as title, its first words are the heading.
pub(crate) fn begun(verdict: &str, is_good: bool) -> Page {
    Page::begun(verdict, if is_good { "met" } else { "broken" }, SCHEMA)
}

/// Returns how far the boresight of recorded frames is from that of the first, as SVG; `None` without frames.
pub(crate) fn chart_of_pointing(rows: &[Row]) -> Option<String> {
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
    let series = vec![
        Series::new("right ascension, times cos(declination)", Style::Line, 0, of(&across)),
        Series::new("declination", Style::Line, 1, of(&up)),
    ];
    let (x, y) = (Axis::linear("time after the first frame, s"), Axis::linear("angle, arcsec"));
    let chart = Chart::new("Boresight of the recorded frames, from that of the first", x, y, series);
    let first = format!("first frame: right ascension {ra_deg:.6} deg, declination {dec_deg:.6} deg");
    Some(to_svg(&chart.noted(first)))
}

/// Returns an angle from -180 to 180 deg.
fn turned_deg(deg: f64) -> f64 {
    (deg + 180.0).rem_euclid(360.0) - 180.0
}

// Recorded frames of a run for its report: boresight of each, and three of them as small pictures.

/// Longest side of a picture, px.
const SIDE_PX: usize = 200;
/// Largest picture, bytes: noise does not compress, so a larger one is shrunk further.
const MOST_PNG_BYTES: usize = 45_000;

/// A line of `frames.csv`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Row {
    pub(crate) frame: u32,
    pub(crate) mid_exposure_tai_ns: i64,
    pub(crate) ra_deg: Option<f64>,
    pub(crate) dec_deg: Option<f64>,
    pub(crate) roll_deg: Option<f64>,
    pub(crate) stars: Option<u64>,
}

/// The recording of a run's first recorder.
#[derive(Debug)]
pub(crate) struct Recording {
    folder: PathBuf,
    pub(crate) rows: Vec<Row>,
}

/// A frame as a small picture.
#[derive(Debug)]
pub(crate) struct Sample {
    pub(crate) row: Row,
    pub(crate) png: Vec<u8>,
    /// Columns and rows of the picture.
    pub(crate) size: [usize; 2],
    /// Pixels of the frame along each side of one of the picture.
    pub(crate) shrink: usize,
}

/// Returns the recording of the first sink that wrote files; `None` when none did.
pub(crate) fn recording(finished: &Finished) -> Option<Recording> {
    let recorder = finished.end.sink_lines.iter().find(|line| line.kind == "recorder")?;
    let folder = PathBuf::from(recorder.output.as_ref()?);
    let mut table = csv::Reader::from_reader(InputFile::open(&folder.join("frames.csv"), DATA_BYTES).ok()?);
    // A last line that was cut is not a frame.
    let rows = table.deserialize().filter_map(Result::ok).collect();
    Some(Recording { folder, rows })
}

impl Recording {
    /// Returns the first, the middle and the last frame, those that are recorded as FITS.
    pub(crate) fn samples(&self) -> Vec<Sample> {
        let Some(last) = self.rows.len().checked_sub(1) else { return Vec::new() };
        let mut places = vec![0, last / 2, last];
        places.dedup();
        places.into_iter().filter_map(|place| sample(&self.folder, &self.rows[place])).collect()
    }
}

fn sample(folder: &Path, row: &Row) -> Option<Sample> {
    let file = InputFile::open(&frame_path(folder, row.frame, "fits"), DATA_BYTES).ok()?;
    let image = FitsImage::read(BufReader::new(file)).ok()?;
    let longest = image.width.max(image.height);
    let mut shrink = longest.div_ceil(SIDE_PX).max(1);
    loop {
        let small = shrunk(&image, shrink);
        let mut png = Vec::new();
        write_dn_for_people(&mut png, &small).ok()?;
        if png.len() <= MOST_PNG_BYTES || shrink >= longest {
            return Some(Sample { row: row.clone(), png, size: [small.width(), small.height()], shrink });
        }
        shrink *= 2;
    }
}

/// Returns the image with `shrink` x `shrink` pixels as one, the brightest of them: no star is lost.
fn shrunk(image: &FitsImage, shrink: usize) -> DnImage {
    let size = [image.width.div_ceil(shrink), image.height.div_ceil(shrink)];
    let mut small = DnImage::new(size[0], size[1]);
    let pixels = image.top_row_first();
    for (place, value) in pixels.iter().enumerate() {
        let (x, y) = (place % image.width / shrink, place / image.width / shrink);
        let pixel = &mut small.pixels_mut()[y * size[0] + x];
        // A float-to-int cast saturates.
        *pixel = (*pixel).max(value.round() as u16);
    }
    small
}

// Events of a run on a time line, as SVG inside a page: a row for each kind, a mark for each bin of time that has some.

/// Most rows: the kinds that happened most often come first.
const MOST_ROWS: usize = 16;
/// Bins of time.
const BINS: usize = 120;
const LEFT_PX: f64 = 190.0;
const WIDTH_PX: f64 = 760.0;
const ROW_PX: f64 = 22.0;
const TOP_PX: f64 = 12.0;

/// Returns the picture of a run from `zero` to `end`; `None` for one without events. Colours are those of the page.
pub(crate) fn timeline(record: &RunRecord, zero: Tai, end: Tai) -> Option<String> {
    let mut kinds: Vec<(EventKind, u64)> = crate::cli::run::files::counted(record).collect();
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
mod run_page_parts_tests {
    use super::*;

    #[test]
    fn text_from_outside_is_no_markup_and_the_first_line_has_the_verdict() {
        let mut page = begun("FAILED: <b>", false);
        page.row(&["<script>"]);
        let text = page.end();
        assert!(text.lines().next().unwrap().contains("<title>FAILED: &lt;b&gt;</title>"), "{text}");
        assert!(text.contains("class=\"broken\"") && !text.contains("<script"), "{text}");
        assert!(begun("ok", true).end().contains("class=\"met\""));
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

#[cfg(test)]
mod run_samples_tests {
    use super::*;
    use frames::sink::fits::{Header, image::OwnedPixels};

    #[test]
    fn brightest_of_each_block_is_kept_also_at_the_edge() {
        let mut pixels = vec![3_u16; 5 * 3];
        (pixels[1], pixels[14]) = (40, 70);
        let image = FitsImage { width: 5, height: 3, pixels: OwnedPixels::U16(pixels), header: Header::default() };
        let small = shrunk(&image, 2);
        assert_eq!((small.width(), small.height(), small.pixels()), (3, 2, &[40, 3, 3, 3, 3, 70][..]));
        assert_ne!(shrunk(&image, 1).pixels(), small.pixels(), "the comparison can fail");
    }
}

#[cfg(test)]
mod run_timeline_tests {
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
