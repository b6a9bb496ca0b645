//! Luminance -> grey.
//!
//! Luminance is u16, 65535 the full luminance of the display. A grey is a whole number, 0 to `2^bits - 1`, as it goes
//! to the monitor. A [`GreyTable`] holds the grey, with its fraction, at evenly spaced luminances; in between it is
//! linear. [`GreyMaker`] is what the presenter calls, a row at a time: the nearest grey of a table, or another function
//! of a row, such as temporal dithering.

use crate::display::error::DisplayError;

/// Fewest entries of a table: with a gamma of 2.2 and 8 bits, linear steps between them err by 0.2 grey in the darkest
/// two, and by less than 0.01 from the twentieth on.
pub const FEWEST_ENTRIES: usize = 4096;
/// One entry for each luminance.
pub const MOST_ENTRIES: usize = 65_536;

/// Greys by luminance.
#[derive(Debug, Clone, PartialEq)]
pub struct GreyTable {
    bits: u32,
    entries: Vec<f32>,
}

impl GreyTable {
    /// Returns a table of greys at luminances 0, 1/(n-1), ..., 1 of the full one.
    ///
    /// # Errors
    /// When there are fewer than 4096 or more than 65536 entries, or `bits` is neither 8 nor 10, or an entry is not a
    /// number from 0 to `2^bits - 1`, or one is less than that before it.
    pub fn new(bits: u32, entries: Vec<f32>) -> Result<Self, DisplayError> {
        let refuse = |wanted: &str, got: String| Err(refused(wanted, got));
        if bits != 8 && bits != 10 {
            return refuse("8 or 10 bits", bits.to_string());
        }
        if !(FEWEST_ENTRIES..=MOST_ENTRIES).contains(&entries.len()) {
            return refuse("4096 to 65536 entries", entries.len().to_string());
        }
        let most = most_of(bits);
        if let Some(at) = entries.iter().position(|grey| !(0.0..=most).contains(grey)) {
            return refuse("greys from 0 to 2^bits - 1", format!("{} in entry {at}", entries[at]));
        }
        if let Some(at) = entries.windows(2).position(|pair| pair[1] < pair[0]) {
            return refuse("greys that never fall", format!("{} after {}", entries[at + 1], entries[at]));
        }
        Ok(Self { bits, entries })
    }

    /// Greys in proportion to luminance: right for a display whose response is linear, which no monitor's is by
    /// itself.
    pub fn linear(bits: u32) -> Self {
        let most = most_of(bits);
        let entries = (0..FEWEST_ENTRIES).map(|i| most * (i as f32 / (FEWEST_ENTRIES - 1) as f32)).collect();
        Self { bits, entries }
    }

    /// Greys of a display whose luminance is this power of the grey, one entry for each luminance.
    ///
    /// # Errors
    /// When the power is not from 0.1 to 10, or `bits` is neither 8 nor 10.
    pub fn by_gamma(bits: u32, gamma: f64) -> Result<Self, DisplayError> {
        if !(0.1..=10.0).contains(&gamma) {
            return Err(refused("a gamma from 0.1 to 10", gamma));
        }
        let most = f64::from(most_of(bits));
        let entries = (0..=u16::MAX).map(|i| (most * (f64::from(i) / 65_535.0).powf(1.0 / gamma)) as f32).collect();
        Self::new(bits, entries)
    }

    /// Returns bits of a grey.
    pub fn bits(&self) -> u32 {
        self.bits
    }

    /// Returns the grey of a luminance, with its fraction.
    pub fn grey(&self, luminance: u16) -> f64 {
        let steps = self.entries.len() - 1;
        // Whole numbers as far as they go, so that entries are met exactly.
        let scaled = usize::from(luminance) * steps;
        let (below, part) = (scaled / 65_535, (scaled % 65_535) as f64 / 65_535.0);
        let low = f64::from(self.entries[below]);
        let high = f64::from(self.entries[(below + 1).min(steps)]);
        low + (high - low) * part
    }

    /// Returns the nearest whole grey of a luminance; halves go up.
    pub fn nearest(&self, luminance: u16) -> u16 {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 1023 by the table's checks")]
        let grey = (self.grey(luminance) + 0.5).floor() as u16;
        grey
    }
}

fn most_of(bits: u32) -> f32 {
    ((1_u32 << bits.min(16)) - 1) as f32
}

/// Row and refresh for which greys are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// Row of the frame, from the top.
    pub y: usize,
    /// Refreshes since the display was opened.
    pub refresh: u64,
}

/// Luminances of a row -> greys of the same length, and how many pixels wanted more light than there is.
type MakeRow = Box<dyn Fn(&[u16], &mut [u16], Row) -> u64 + Send>;

/// Makes greys, a row at a time.
pub struct GreyMaker {
    bits: u32,
    changes_by_refresh: bool,
    make: MakeRow,
}

impl GreyMaker {
    /// Returns the nearest grey of a table.
    pub fn nearest(table: &GreyTable) -> Self {
        let greys: Vec<u16> = (0..=u16::MAX).map(|luminance| table.nearest(luminance)).collect();
        let make = move |luminances: &[u16], out: &mut [u16], _: Row| {
            for (grey, luminance) in out.iter_mut().zip(luminances) {
                *grey = greys[usize::from(*luminance)];
            }
            0
        };
        Self { bits: table.bits(), changes_by_refresh: false, make: Box::new(make) }
    }

    /// Makes greys by any function of a row and a refresh. `changes_by_refresh`: frames that are repeated are made
    /// again at each refresh. `make` returns how many pixels wanted more light than the display has; greys above
    /// `2^bits - 1` show as the brightest.
    #[must_use]
    pub fn by_row(
        bits: u32,
        changes_by_refresh: bool,
        make: impl Fn(&[u16], &mut [u16], Row) -> u64 + Send + 'static,
    ) -> Self {
        Self { bits, changes_by_refresh, make: Box::new(make) }
    }

    /// Returns bits of a grey.
    pub fn bits(&self) -> u32 {
        self.bits
    }

    /// Returns whether a repeated frame has other greys.
    pub fn changes_by_refresh(&self) -> bool {
        self.changes_by_refresh
    }

    /// Greys of one row; gives how many pixels wanted more light than there is.
    pub fn make(&self, luminances: &[u16], greys: &mut [u16], row: Row) -> u64 {
        (self.make)(luminances, greys, row)
    }
}

impl core::fmt::Debug for GreyMaker {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { bits, changes_by_refresh, .. } = self;
        write!(f, "GreyMaker {{ bits: {bits}, changes_by_refresh: {changes_by_refresh} }}")
    }
}

fn refused(wanted: &str, got: impl core::fmt::Display) -> DisplayError {
    DisplayError::refuse(format!("grey table: wanted {wanted}, got {got}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_linear_table_meets_both_ends_and_rounds_to_the_nearest() {
        for bits in [8, 10] {
            let table = GreyTable::linear(bits);
            let most = (1_u64 << bits) - 1;
            for luminance in 0..=u16::MAX {
                // In whole numbers: floor(l * most / 65535 + 1/2).
                let wanted = (2 * u64::from(luminance) * most + 65_535) / (2 * 65_535);
                let grey = u64::from(table.nearest(luminance));
                // 65535 / 2 is not a whole number, and no luminance lies within 1e-5 of a border between two greys.
                assert_eq!(grey, wanted, "{bits} bits, luminance {luminance}");
            }
        }
    }

    #[test]
    fn entries_are_met_and_joined_by_lines() {
        let entries: Vec<f32> = (0..=65_535_u32).map(|i| (i / 300) as f32).collect();
        let table = GreyTable::new(8, entries).unwrap();
        assert_eq!((table.grey(299), table.grey(300)), (0.0, 1.0));
        let mut coarse = vec![0.0; 4096];
        coarse[4095] = 200.0;
        let table = GreyTable::new(8, coarse).unwrap();
        let half = table.grey(65_535 - 8);
        assert!((half - 100.0).abs() < 0.04, "half way into the last step: {half}");
    }

    #[test]
    fn tables_that_are_none_are_refused() {
        let good = || vec![1.0_f32; 4096];
        assert!(GreyTable::new(8, good()).is_ok());
        let with = |at: usize, value: f32| {
            let mut entries = good();
            entries[at] = value;
            entries
        };
        for (bits, entries, part) in [
            (9, good(), "8 or 10"),
            (8, vec![1.0; 4095], "4096"),
            (8, vec![1.0; 65_537], "65536"),
            (8, with(4095, 255.5), "entry 4095"),
            (8, with(7, f32::NAN), "entry 7"),
            (8, with(0, -0.1), "entry 0"),
            (8, with(9, 0.5), "never fall"),
        ] {
            let text = GreyTable::new(bits, entries).unwrap_err().to_string();
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(GreyTable::new(8, with(4095, 255.0)).is_ok(), "the other side of the edge");
    }

    #[test]
    fn a_maker_by_row_sees_row_and_refresh() {
        let maker = GreyMaker::by_row(8, true, |luminances, greys, row| {
            for (grey, luminance) in greys.iter_mut().zip(luminances) {
                *grey = luminance / 257 + (row.y as u16) + (row.refresh as u16);
            }
            7
        });
        let mut greys = [0; 2];
        let clipped = maker.make(&[257, 514], &mut greys, Row { y: 3, refresh: 10 });
        assert_eq!((greys, clipped), ([14, 15], 7));
        assert!(maker.changes_by_refresh());
    }
}
