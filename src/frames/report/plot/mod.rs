//! Charts as SVG: accuracy against speed, error against a parameter.
//!
//! Input: plain numbers and names ([`Chart`]). Output: one SVG text, 760 px wide, on white, the same for the same
//! input. Text is 12 px sans-serif; colour-blind readers can distinguish the colours (Okabe and Ito 2008), and every
//! group has a shape of its own besides. The legend is above the frame, so it never covers a point.
//!
//! *Limits.* Points without a place on a logarithmic axis (zero, negative) or on any (not finite) are left out and
//! counted below the chart. Text widths are estimated (7 px a character). *Validation.* `tests.rs` reads the SVG back.
//!
//! Tour: `axis` (values -> px, ticks) -> `layout` (positions of the parts, shapes and colours) -> `svg`.

mod axis;
mod layout;
mod svg;
#[cfg(test)]
mod tests;

pub(super) use axis::round_above;
pub(super) use layout::colour;
pub use layout::pareto_front;
pub(super) use svg::Page;
pub use svg::to_svg;

/// Spacing of values along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal ratios, equal lengths; positive values only.
    Log,
    /// Equal differences, equal lengths.
    Linear,
    /// The same from 0 to 1, whatever the values are.
    Share,
}

/// One axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Quantity of the axis, with its unit.
    pub label: String,
    /// Spacing of the values.
    pub scale: Scale,
}

/// Style of a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// One mark per point.
    Points,
    /// A line through the points.
    Line,
    /// A dashed line: a bound, a budget.
    DashedLine,
    /// A broad band behind everything else: a Pareto front.
    Front,
}

/// Points of one name.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Style of the series.
    pub style: Style,
    /// Series of one group share colour and shape (a method's error, and its bound).
    pub group: usize,
    /// `[x, y]`, in the order in which a line runs through them.
    pub points: Vec<[f64; 2]>,
    /// Indices of points that get a ring; those beyond the end are ignored.
    pub marked: Vec<usize>,
}

/// A chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Title.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series that are drawn.
    pub series: Vec<Series>,
    /// Meaning of a ring, in the legend.
    pub ring: String,
    /// Lines below the chart.
    pub notes: Vec<String>,
}

impl Axis {
    /// Returns a logarithmic axis.
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Log }
    }

    /// Returns a linear axis.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Linear }
    }

    /// Returns an axis of shares, from 0 to 1.
    pub fn share(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Share }
    }

    fn has_place_for(&self, value: f64) -> bool {
        value.is_finite() && (self.scale != Scale::Log || value > 0.0)
    }
}

impl Series {
    /// Returns a series without rings.
    pub fn new(name: impl Into<String>, style: Style, group: usize, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), style, group, points, marked: Vec::new() }
    }
}

impl Chart {
    /// Returns a chart of series, without the meaning of a ring and without notes.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis, series: Vec<Series>) -> Self {
        Self { title: title.into(), x, y, series, ring: String::new(), notes: Vec::new() }
    }

    /// Returns the chart with one line more below it.
    #[must_use]
    pub fn noted(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    fn has_place_for(&self, point: [f64; 2]) -> bool {
        self.x.has_place_for(point[0]) && self.y.has_place_for(point[1])
    }

    /// Returns all points that are drawn.
    fn drawn(&self) -> impl Iterator<Item = [f64; 2]> {
        self.series.iter().flat_map(|series| series.points.iter().copied()).filter(|point| self.has_place_for(*point))
    }

    fn left_out(&self) -> usize {
        // A point without any number is a gap in a line.
        let points = self.series.iter().flat_map(|series| &series.points).filter(|[x, y]| !(x.is_nan() && y.is_nan()));
        points.count() - self.drawn().count()
    }
}
