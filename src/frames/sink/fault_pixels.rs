//! The places of pixels that faults name.

use core::fmt;

/// Pixels of a fault: one given, and others at random by the seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaultPixels {
    /// Column and row.
    pub at: Option<[u32; 2]>,
    /// A number of random pixels.
    pub random: u32,
}

/// Places of defective pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DefectSpots {
    /// Single pixels.
    pub pixels: FaultPixels,
    /// A whole column.
    pub column: Option<u32>,
    /// A whole row.
    pub row: Option<u32>,
}

impl From<FaultPixels> for DefectSpots {
    fn from(pixels: FaultPixels) -> Self {
        Self { pixels, column: None, row: None }
    }
}

impl DefectSpots {
    /// Returns true if a pixel that is given is beyond so many columns and rows.
    pub fn are_outside(&self, [width, height]: [usize; 2]) -> bool {
        let beyond = |place: Option<u32>, side: usize| place.is_some_and(|place| place as usize >= side);
        let [x, y] = [0, 1].map(|axis| self.pixels.at.map(|px| px[axis]));
        [x, self.column].into_iter().any(|x| beyond(x, width)) || [y, self.row].into_iter().any(|y| beyond(y, height))
    }
}

impl fmt::Display for DefectSpots {
    /// Writes the pixels as event files name them.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = |name: &str, number: Option<u32>| number.map(|number| format!("{name} = {number}"));
        let pixel = self.pixels.at.map(|[x, y]| format!("px = [{x}, {y}]"));
        let all = [pixel, line("column", self.column), line("row", self.row)];
        f.write_str(&all.into_iter().flatten().collect::<Vec<_>>().join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_named_and_counted_from_zero() {
        let none = FaultPixels { at: None, random: 5 };
        let all = DefectSpots { pixels: FaultPixels { at: Some([9, 4]), ..none }, column: Some(9), row: Some(4) };
        assert_eq!(all.to_string(), "px = [9, 4], column = 9, row = 4");
        assert!(!all.are_outside([10, 5]));
        assert!(all.are_outside([9, 5]) && all.are_outside([10, 4]));
        let random = DefectSpots::from(none);
        assert_eq!((random.to_string().as_str(), random.are_outside([0, 0])), ("", false));
    }
}
