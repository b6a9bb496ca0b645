//! Luminances -> the greys of one refresh, marker patch included. Buffers are made once.

use crate::display::error::{DisplayError, of};
use crate::display::grey::{GreyMaker, Row};

/// Greys as they are to be shown, row by row from the top.
#[derive(Debug)]
pub struct Picture {
    size_px: [usize; 2],
    greys: Vec<u16>,
    marker: Option<Marker>,
    white: u16,
}

impl Picture {
    /// Returns a black picture; `white` is the brightest grey.
    pub fn new(size_px: [usize; 2], marker: Option<Marker>, white: u16) -> Self {
        Self { size_px, greys: vec![0; size_px[0] * size_px[1]], marker, white }
    }

    /// Returns columns and rows.
    pub fn size_px(&self) -> [usize; 2] {
        self.size_px
    }

    /// Returns all greys.
    pub fn greys(&self) -> &[u16] {
        &self.greys
    }

    /// Makes the greys of a frame's luminances, and the marker over them. Gives how many pixels wanted more light than
    /// there is.
    pub fn compose(&mut self, luminances: &[u16], maker: &GreyMaker, refresh: u64, marker_is_white: bool) -> u64 {
        let width = self.size_px[0].max(1);
        let rows = self.greys.chunks_exact_mut(width).zip(luminances.chunks_exact(width));
        let made = rows.enumerate().map(|(y, (greys, luminances))| maker.make(luminances, greys, Row { y, refresh }));
        let clipped = made.sum();
        if let Some(marker) = &self.marker {
            marker.draw(&mut self.greys, self.size_px, if marker_is_white { self.white } else { 0 });
        }
        clipped
    }
}

// The marker patch: a square in a corner that is black and white by turns, for a photodiode.
//
// It turns over with every new frame that is shown, and stays while a frame is repeated: each edge that the photodiode
// sees belongs to one [`crate::display::Submitted`], whatever the refresh rate.

/// A corner of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Corner {
    /// Corner of pixel (0, 0).
    #[default]
    TopLeft,
    /// The end of the first row.
    TopRight,
    /// The beginning of the last row.
    BottomLeft,
    /// The last pixel.
    BottomRight,
}

/// A square for a photodiode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Marker {
    /// Its side, px.
    pub size_px: u32,
    /// Corner of the marker.
    pub corner: Corner,
}

impl Marker {
    /// Checks that the marker fits on frames of this size (columns, rows).
    ///
    /// # Errors
    /// When it is empty or does not fit.
    pub fn check(&self, image_px: [u32; 2]) -> Result<(), DisplayError> {
        if self.size_px == 0 || self.size_px > image_px[0].min(image_px[1]) {
            return Err(DisplayError::refuse(format!(
                "a marker of {} px on frames of {} px: wanted 1 px up to the shorter side",
                self.size_px,
                of(image_px)
            )));
        }
        Ok(())
    }

    /// Sets its square to `grey` in an image of `size_px` (columns, rows), row by row from the top.
    pub fn draw(&self, greys: &mut [u16], size_px: [usize; 2], grey: u16) {
        let [width, height] = size_px;
        let side = (self.size_px as usize).min(width).min(height);
        let left = if matches!(self.corner, Corner::TopLeft | Corner::BottomLeft) { 0 } else { width - side };
        let top = if matches!(self.corner, Corner::TopLeft | Corner::TopRight) { 0 } else { height - side };
        for row in greys.chunks_exact_mut(width.max(1)).skip(top).take(side) {
            row[left..left + side].fill(grey);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::{grey::GreyTable, picture::Corner};

    #[test]
    fn each_pixel_has_the_grey_of_its_luminance_save_under_the_marker() {
        let maker = GreyMaker::nearest(&GreyTable::linear(8));
        let marker = Marker { size_px: 1, corner: Corner::BottomRight };
        let mut picture = Picture::new([3, 2], Some(marker), 255);
        picture.compose(&[0, 257, 514, 65_535, 128, 129], &maker, 0, true);
        assert_eq!(picture.greys(), [0, 1, 2, 255, 0, 255]);
        picture.compose(&[0, 257, 514, 65_535, 129, 129], &maker, 0, false);
        assert_eq!(picture.greys(), [0, 1, 2, 255, 1, 0]);
    }
}

#[cfg(test)]
mod marker_tests {
    use super::*;

    #[test]
    fn each_corner_has_its_square_and_nothing_else_changes() {
        let corners = [
            (Corner::TopLeft, [[1, 1, 0], [1, 1, 0], [0, 0, 0], [0, 0, 0]]),
            (Corner::TopRight, [[0, 1, 1], [0, 1, 1], [0, 0, 0], [0, 0, 0]]),
            (Corner::BottomLeft, [[0, 0, 0], [0, 0, 0], [1, 1, 0], [1, 1, 0]]),
            (Corner::BottomRight, [[0, 0, 0], [0, 0, 0], [0, 1, 1], [0, 1, 1]]),
        ];
        for (corner, wanted) in corners {
            let mut greys = [0_u16; 12];
            Marker { size_px: 2, corner }.draw(&mut greys, [3, 4], 1);
            assert_eq!(greys.as_slice(), wanted.as_flattened(), "{corner:?}");
        }
    }

    #[test]
    fn it_must_fit() {
        let marker = |size_px| Marker { size_px, corner: Corner::TopLeft };
        assert!(marker(3).check([3, 4]).is_ok());
        assert!(marker(4).check([3, 4]).is_err() && marker(0).check([3, 4]).is_err());
    }
}
