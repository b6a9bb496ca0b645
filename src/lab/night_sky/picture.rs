//! An image as numbers of the converter, whatever file it came from.

use base::least_squares::median;
use glam::DVec2;

/// Digital numbers of one frame, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns and rows.
    pub size_px: [usize; 2],
    /// Digital numbers.
    pub dn: Vec<f32>,
}

/// An image turned over: one that is mirrored becomes right again by either.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flip {
    /// Left and right change places.
    Columns,
    /// Top and bottom change places.
    Rows,
}

impl Flip {
    /// Returns its word on the command line and in reports.
    pub fn word(self) -> &'static str {
        match self {
            Self::Columns => "columns",
            Self::Rows => "rows",
        }
    }
}

impl Picture {
    /// Returns the value of a pixel; 0 outside the image.
    pub fn at(&self, x: usize, y: usize) -> f64 {
        if x < self.size_px[0] { self.dn.get(y * self.size_px[0] + x).map_or(0.0, |dn| f64::from(*dn)) } else { 0.0 }
    }

    /// Returns the largest value.
    pub fn largest(&self) -> f64 {
        self.dn.iter().fold(0.0, |most: f64, dn| most.max(f64::from(*dn)))
    }

    /// Returns the same image with each pixel passed through `of` with its number.
    pub fn map(&self, of: impl Fn(usize, f32) -> f32) -> Self {
        Self { size_px: self.size_px, dn: self.dn.iter().enumerate().map(|(i, dn)| of(i, *dn)).collect() }
    }

    /// Returns the image with its columns or rows in reverse order.
    pub fn flipped(&self, flip: Flip) -> Self {
        let rows = self.dn.chunks_exact(self.size_px[0].max(1));
        let dn = match flip {
            Flip::Columns => rows.flat_map(|row| row.iter().rev()).copied().collect(),
            Flip::Rows => rows.rev().flatten().copied().collect(),
        };
        Self { size_px: self.size_px, dn }
    }

    /// Returns the middle of the image, px.
    pub fn middle_px(&self) -> [f64; 2] {
        self.size_px.map(|side| 0.5 * (side as f64 - 1.0))
    }

    /// Returns a place in half diagonals from the middle, right and down.
    pub fn half_diagonals(&self, px: [f64; 2]) -> DVec2 {
        let middle = DVec2::from_array(self.middle_px());
        (DVec2::from_array(px) - middle) / (0.5 * (self.size_px[0] as f64).hypot(self.size_px[1] as f64))
    }

    /// Returns true when a square of `half` pixels about a place is inside the image.
    pub fn holds(&self, px: [f64; 2], half: i64) -> bool {
        let half = half as f64 + 0.5;
        (0..2).all(|i| px[i].is_finite() && px[i] >= half && px[i] <= self.size_px[i] as f64 - 1.0 - half)
    }
}

/// Returns the pixels of the square of `half` pixels about a place that is inside the image ([`Picture::holds`]).
pub(crate) fn window(px: [f64; 2], half: i64) -> impl Iterator<Item = [usize; 2]> + Clone {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a place inside the image")]
    let [column, row] = px.map(|v| v.round() as i64);
    let span = move |middle: i64| (middle - half..=middle + half).map(|v| usize::try_from(v).unwrap_or(0));
    span(row).flat_map(move |y| span(column).map(move |x| [x, y]))
}

/// Returns median and spread (1.4826 times the median distance from it, the standard deviation of a Gaussian).
pub(crate) fn robust(values: &mut [f64]) -> [f64; 2] {
    let middle = median(values);
    let mut distances: Vec<f64> = values.iter().map(|value| (value - middle).abs()).collect();
    [middle, GAUSSIAN_OF_MEDIAN * median(&mut distances)]
}

/// Standard deviation of a Gaussian over the median of the distances from its middle.
const GAUSSIAN_OF_MEDIAN: f64 = 1.4826;

/// Returns the root of the mean of squares; not a number of nothing.
pub(crate) fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value * value));
    (sum / count).sqrt()
}

/// Returns the mean; not a number of nothing.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value));
    sum / count
}
