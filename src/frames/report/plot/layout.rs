//! Positions of the parts: title, legend, frame, labels, notes, from top to bottom.

use super::axis::Ruler;
use super::{Chart, Style};

/// Width of every chart, px.
pub(super) const WIDTH_PX: f64 = 760.0;
/// Estimated width of a character of 12 px text, px: Helvetica's widest lower-case letters but m and w.
const CHARACTER_PX: f64 = 7.0;
/// Height of a line of text, px.
pub(super) const LINE_PX: f64 = 18.0;
/// Space of the swatch before a name in the legend, px.
pub(super) const SWATCH_PX: f64 = 30.0;
const LEFT_PX: f64 = 76.0;
const RIGHT_PX: f64 = 24.0;
const PLOT_HEIGHT_PX: f64 = 340.0;
/// Ticks and label below the frame.
const BELOW_PX: f64 = 48.0;

/// A name in the legend and the mark before it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    pub(super) name: String,
    /// Style and group; `None` for the ring.
    pub(super) swatch: Option<(Style, usize)>,
    pub(super) x_px: f64,
    pub(super) y_px: f64,
}

/// Places of everything, px from the upper left corner.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    pub(super) legend: Vec<Entry>,
    pub(super) left_px: f64,
    pub(super) right_px: f64,
    pub(super) top_px: f64,
    pub(super) bottom_px: f64,
    pub(super) x: Ruler,
    pub(super) y: Ruler,
    /// Lines of the notes.
    pub(super) notes: Vec<String>,
    pub(super) height_px: f64,
}

impl Layout {
    pub(super) fn of(chart: &Chart) -> Self {
        let [left_px, right_px] = [LEFT_PX, WIDTH_PX - RIGHT_PX];
        let title_px = 34.0;
        let (legend, legend_bottom_px) = legend(chart, left_px, right_px, title_px + LINE_PX);
        let top_px = legend_bottom_px + 12.0;
        let bottom_px = top_px + PLOT_HEIGHT_PX;
        let notes = notes(chart, WIDTH_PX - RIGHT_PX - left_px);
        let height_px = bottom_px + BELOW_PX + LINE_PX * notes.len() as f64 + 12.0;
        let x = Ruler::around(chart.x.scale, chart.drawn().map(|p| p[0]), left_px, right_px);
        let y = Ruler::around(chart.y.scale, chart.drawn().map(|p| p[1]), bottom_px, top_px);
        Self { legend, left_px, right_px, top_px, bottom_px, x, y, notes, height_px }
    }

    /// Returns the base line of the first note, px.
    pub(super) fn notes_px(&self) -> f64 {
        self.bottom_px + BELOW_PX + LINE_PX * 0.75
    }
}

fn text_px(text: &str) -> f64 {
    text.chars().count() as f64 * CHARACTER_PX
}

/// Returns names from left to right, in as many rows as they need; also the base line of the last row.
fn legend(chart: &Chart, left_px: f64, right_px: f64, first_px: f64) -> (Vec<Entry>, f64) {
    let named = chart.series.iter().filter(|series| !series.name.is_empty());
    let series = named.map(|series| (series.name.clone(), Some((series.style, series.group))));
    let has_ring = !chart.ring.is_empty() && chart.series.iter().any(|series| !series.marked.is_empty());
    let ring = has_ring.then(|| (chart.ring.clone(), None));
    let (mut x_px, mut y_px) = (left_px, first_px);
    let mut entries = Vec::new();
    for (name, swatch) in series.chain(ring) {
        let width_px = SWATCH_PX + text_px(&name) + 14.0;
        if x_px > left_px && x_px + width_px > right_px {
            (x_px, y_px) = (left_px, y_px + LINE_PX);
        }
        entries.push(Entry { name, swatch, x_px, y_px });
        x_px += width_px;
    }
    (entries, y_px)
}

/// Returns the notes, and how many points are missing, in lines that fit.
fn notes(chart: &Chart, width_px: f64) -> Vec<String> {
    let left_out = match chart.left_out() {
        0 => None,
        1 => Some("1 point has no place on these axes (zero, negative or not finite) and is left out.".to_owned()),
        n => Some(format!("{n} points have no place on these axes (zero, negative or not finite) and are left out.")),
    };
    chart.notes.iter().cloned().chain(left_out).flat_map(|note| lines_of(&note, width_px)).collect()
}

fn lines_of(text: &str, width_px: f64) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if text_px(line) + text_px(word) + CHARACTER_PX <= width_px => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

// The points that nothing beats.

/// Returns the indices of the points that no other point beats in both coordinates, by ascending x. Of equal points the
/// first counts; points that are not finite are left out.
pub fn pareto_front(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).filter(|i| points[*i].iter().all(|v| v.is_finite())).collect();
    order.sort_by(|a, b| {
        let ([ax, ay], [bx, by]) = (points[*a], points[*b]);
        ax.total_cmp(&bx).then(ay.total_cmp(&by)).then(a.cmp(b))
    });
    let mut lowest = f64::INFINITY;
    order.retain(|i| {
        let is_lower = points[*i][1] < lowest;
        lowest = lowest.min(points[*i][1]);
        is_lower
    });
    order
}

// Shapes and colours of the groups.

/// Okabe and Ito's palette on white, without yellow and with a darker purple: blue, vermilion, green, purple, orange,
/// sky, black.
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#aa4499", "#e69f00", "#56b4e9", "#333333"];
/// About the place of the mark: disc, square, triangle, diamond, triangle down, cross, bar, saltire. One more than there are
/// colours, so that a group that has another one's colour has another shape.
const SHAPES: [&str; 8] = [
    "M-4.5 0a4.5 4.5 0 1 0 9 0a4.5 4.5 0 1 0 -9 0z",
    "M-4 -4h8v8h-8z",
    "M0 -5.2l5 9h-10z",
    "M0 -5.6l5.6 5.6l-5.6 5.6l-5.6 -5.6z",
    "M0 5.2l5 -9h-10z",
    "M-1.6 -5h3.2v3.4h3.4v3.2h-3.4v3.4h-3.2v-3.4h-3.4v-3.2h3.4z",
    "M-5.5 -2h11v4h-11z",
    "M-5 -3l2 -2l3 3l3 -3l2 2l-3 3l3 3l-2 2l-3 -3l-3 3l-2 -2l3 -3z",
];

/// Colour of a group; the eighth begins again.
pub(in crate::report) fn colour(group: usize) -> &'static str {
    COLOURS[group % COLOURS.len()]
}

/// Returns the outline of a group's mark, relative to its place.
pub(super) fn shape(group: usize) -> &'static str {
    SHAPES[group % SHAPES.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let points = [[3.0, 1.0], [1.0, 5.0], [2.0, 2.0], [2.5, 2.0], [2.0, 2.0], [4.0, 0.9], [0.5, f64::NAN]];
        assert_eq!(pareto_front(&points), [1, 2, 0, 5]);
        assert!(pareto_front(&[]).is_empty());
    }

    #[test]
    fn it_agrees_with_comparing_all_pairs() {
        // A fixed scramble along a falling diagonal.
        let point = |i: u32| [f64::from(i * 37 % 101), f64::from(100 + i * 59 % 103) - f64::from(i * 37 % 101)];
        let points: Vec<[f64; 2]> = (0..60).map(point).collect();
        let is_beaten = |p: &[f64; 2]| points.iter().any(|q| q != p && q[0] <= p[0] && q[1] <= p[1]);
        let mut wanted: Vec<usize> = (0..points.len()).filter(|i| !is_beaten(&points[*i])).collect();
        wanted.sort_by(|a, b| points[*a][0].total_cmp(&points[*b][0]));
        assert_eq!(pareto_front(&points), wanted);
        assert!(wanted.len() > 2 && wanted.len() < points.len(), "a front, and points behind it");
    }
}
