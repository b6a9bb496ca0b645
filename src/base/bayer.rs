//! Colour filter arrays after Bayer: which colour each pixel of an image sees.
//!
//! Two rows of two colours repeat over the image; half of the pixels are green. A pattern is named by its first two
//! rows, from the first pixel of the image at the top left.

/// A colour of a filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colour {
    /// Long wavelengths.
    Red,
    /// Those between.
    Green,
    /// Short wavelengths.
    Blue,
}

crate::words! {
    /// Where the colours are.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum BayerPattern {
        /// Red and green, then green and blue.
        Rggb = "RGGB",
        /// Green and red, then blue and green.
        Grbg = "GRBG",
        /// Green and blue, then red and green.
        Gbrg = "GBRG",
        /// Blue and green, then green and red.
        Bggr = "BGGR",
    }
}

impl BayerPattern {
    /// Returns the colour of a pixel.
    pub const fn colour_at(self, column: usize, row: usize) -> Colour {
        let [red_column, red_row] = self.red_at();
        match ((column & 1 == 1) == red_column, (row & 1 == 1) == red_row) {
            (true, true) => Colour::Red,
            (false, false) => Colour::Blue,
            (true, false) | (false, true) => Colour::Green,
        }
    }

    /// Returns the pattern of the part of the image that begins at this column and row.
    #[must_use]
    pub const fn from_pixel(self, [column, row]: [u32; 2]) -> Self {
        let [red_column, red_row] = self.red_at();
        match (red_column != (column & 1 == 1), red_row != (row & 1 == 1)) {
            (false, false) => Self::Rggb,
            (true, false) => Self::Grbg,
            (false, true) => Self::Gbrg,
            (true, true) => Self::Bggr,
        }
    }

    /// Returns whether red is in odd columns and in odd rows, counted from 0.
    const fn red_at(self) -> [bool; 2] {
        match self {
            Self::Rggb => [false, false],
            Self::Grbg => [true, false],
            Self::Gbrg => [false, true],
            Self::Bggr => [true, true],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_spell_the_first_two_rows() {
        for (name, pattern) in BayerPattern::NAMED {
            let letter = |i: usize| match pattern.colour_at(i % 2, i / 2) {
                Colour::Red => 'R',
                Colour::Green => 'G',
                Colour::Blue => 'B',
            };
            assert_eq!((0..4).map(letter).collect::<String>(), name);
            assert_eq!(pattern.name(), name);
        }
    }

    #[test]
    fn a_part_of_an_image_has_the_colours_of_its_pixels() {
        for (_, pattern) in BayerPattern::NAMED {
            for (column, row) in [(0_u32, 0_u32), (1, 0), (0, 1), (1, 1), (2, 5), (7, 4)] {
                let part = pattern.from_pixel([column, row]);
                for (x, y) in [(0_usize, 0_usize), (1, 0), (0, 1), (3, 2)] {
                    let wanted = pattern.colour_at(x + column as usize, y + row as usize);
                    assert_eq!(part.colour_at(x, y), wanted, "{pattern:?} from {column}, {row}");
                }
            }
            assert_ne!(pattern.from_pixel([1, 0]), pattern, "control");
        }
    }
}
