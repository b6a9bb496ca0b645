//! Luminances -> the greys of one refresh, marker patch included. Buffers are made once.

use crate::display::grey::{GreyMaker, Row};
use crate::display::marker::Marker;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::{grey::GreyTable, marker::Corner};

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
