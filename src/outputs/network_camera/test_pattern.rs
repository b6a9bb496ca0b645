//! Test patterns: numbers that follow from a pixel's place and the frame's number, in place of the detector's.
//!
//! A ramp counts digital numbers: `DN = (x, y or x + y) mod 2^bits` from the first pixel of the sensor's image; a
//! moving one adds the frame's number. A client thus knows each bit of each frame. Frames of a pattern are marked in
//! their chunk data (ChunkTestPattern, ChunkAttitudeOrigin) and counted, so they are not mistaken for the sky. Other
//! outputs of the run, such as a recorder, do not have the pattern: it is made after the detector, in the camera's
//! interface.
//!
//! Names: GenICam SFNC; the diagonal ramp is our own. Proven by `hil_scripts/tests/test_network_camera.py`.

base::words! {
    /// Image that a camera sends in place of its own.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub enum TestPattern {
        /// The detector's image.
        #[default]
        Off = "Off",
        /// Zeros.
        Black = "Black",
        /// Full scale.
        White = "White",
        /// One number more with each column.
        GreyHorizontalRamp = "GreyHorizontalRamp",
        /// One number more with each row.
        GreyVerticalRamp = "GreyVerticalRamp",
        /// The same by columns, and one more with each frame.
        GreyHorizontalRampMoving = "GreyHorizontalRampMoving",
        /// The same by rows, and one more with each frame.
        GreyVerticalRampMoving = "GreyVerticalRampMoving",
        /// One number more with each column, each row and each frame.
        GreyDiagonalRampMoving = "GreyDiagonalRampMoving",
    }
}

impl TestPattern {
    /// Returns the pattern of a number in the register.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::NAMED.get(usize::try_from(number).ok()?).map(|(_, pattern)| *pattern)
    }

    /// Draws the pattern over an image of frame `number`, of columns `width_px` and pixels of so many bits.
    pub(super) fn draw(self, number: u32, width_px: usize, bits: u32, pixels: &mut [u16]) {
        // Steps of one column, one row and one frame, and the first pixel.
        let (along_x, along_y, first) = match self {
            Self::Off => return,
            Self::Black => (0, 0, 0),
            Self::White => (0, 0, u32::MAX),
            Self::GreyHorizontalRamp => (1, 0, 0),
            Self::GreyVerticalRamp => (0, 1, 0),
            Self::GreyHorizontalRampMoving => (1, 0, number),
            Self::GreyVerticalRampMoving => (0, 1, number),
            Self::GreyDiagonalRampMoving => (1, 1, number),
        };
        let full = u32::from(u16::MAX) >> 16_u32.saturating_sub(bits);
        let mut row_dn = first;
        for row in pixels.chunks_mut(width_px.max(1)) {
            let mut dn = row_dn;
            for pixel in row {
                // At most 16 bits are left.
                *pixel = u16::try_from(dn & full).unwrap_or(u16::MAX);
                dn = dn.wrapping_add(along_x);
            }
            row_dn = row_dn.wrapping_add(along_y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(pattern: TestPattern, number: u32) -> Vec<u16> {
        let mut pixels = vec![7; 6];
        pattern.draw(number, 3, 2, &mut pixels);
        pixels
    }

    #[test]
    fn patterns_by_hand() {
        for (pattern, wanted) in [
            (TestPattern::Off, [7; 6]),
            (TestPattern::Black, [0; 6]),
            (TestPattern::White, [3; 6]),
            (TestPattern::GreyHorizontalRamp, [0, 1, 2, 0, 1, 2]),
            (TestPattern::GreyVerticalRamp, [0, 0, 0, 1, 1, 1]),
            (TestPattern::GreyHorizontalRampMoving, [2, 3, 0, 2, 3, 0]),
            (TestPattern::GreyVerticalRampMoving, [2, 2, 2, 3, 3, 3]),
            (TestPattern::GreyDiagonalRampMoving, [2, 3, 0, 3, 0, 1]),
        ] {
            assert_eq!(drawn(pattern, 6), wanted, "{pattern:?}");
        }
        let mut deep = vec![0; 2];
        TestPattern::White.draw(0, 2, 16, &mut deep);
        assert_eq!(deep, [u16::MAX; 2]);
    }

    #[test]
    fn numbers_and_names_are_those_of_the_table() {
        for (number, (name, pattern)) in (0..).zip(TestPattern::NAMED) {
            assert_eq!((TestPattern::from_number(number), pattern.name()), (Some(pattern), name));
        }
        assert_eq!(TestPattern::from_number(8), None);
    }
}
