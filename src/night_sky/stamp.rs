//! A PSF's pixel values, tabulated: light of a star in any pixel near it, by cubic interpolation.

use plan::optics::PsfModel;

/// Furthest pixel from a star that has light, px.
pub const REACH_PX: usize = 8;
/// Places per pixel.
const PER_PX: usize = 8;
/// Entries along one axis: places 0 to reach + 2, for the interpolation beyond the ends.
const SIDE: usize = (REACH_PX + 2) * PER_PX;

/// A PSF that is alike on all four sides, as a table.
#[derive(Debug, Clone)]
pub struct Stamp {
    table: Vec<f64>,
}

impl Stamp {
    /// Tabulates a PSF (in the middle of the detector, where it depends on the place).
    pub fn of(psf: &PsfModel) -> Self {
        let at = |i: usize| i as f64 / PER_PX as f64;
        let mut table = vec![0.0; SIDE * SIDE];
        for row in 0..SIDE {
            for column in 0..=row {
                let value = psf.pixel(at(column), at(row));
                table[row * SIDE + column] = value;
                table[column * SIDE + row] = value;
            }
        }
        Self { table }
    }

    /// Returns the share of a star's light in the pixel whose middle is so far from the star, px.
    pub fn at(&self, x_px: f64, y_px: f64) -> f64 {
        let [x, y] = [x_px, y_px].map(|v| v.abs() * PER_PX as f64);
        let most = (REACH_PX * PER_PX) as f64;
        if !(x < most && y < most) {
            return 0.0;
        }
        let (columns, rows) = (weights(x), weights(y));
        let mut sum = 0.0;
        for (k, wy) in rows.1.iter().enumerate() {
            let row = mirrored(rows.0, k) * SIDE;
            for (j, wx) in columns.1.iter().enumerate() {
                sum += wx * wy * self.table[row + mirrored(columns.0, j)];
            }
        }
        sum
    }
}

/// Returns the entry of a place before the first one: the PSF is alike on both sides.
fn mirrored(first: i64, offset: usize) -> usize {
    #[allow(clippy::cast_possible_truncation, reason = "a place of the table")]
    let place = (first + offset as i64).unsigned_abs() as usize;
    place
}

/// Returns the first of four entries and their weights (Lagrange's cubic).
fn weights(at: f64) -> (i64, [f64; 4]) {
    let whole = at.floor();
    let t = at - whole;
    #[allow(clippy::cast_possible_truncation, reason = "a place of the table")]
    let first = whole as i64 - 1;
    let w = [
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    ];
    (first, w)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_the_psf_and_its_light_is_whole() {
        for psf in [PsfModel::gaussian(0.55), PsfModel::halo(0.5, 1.5, 0.3), PsfModel::moffat(1.2, 3.0)] {
            let stamp = Stamp::of(&psf);
            for (x, y) in [(0.0, 0.0), (0.31, -0.77), (-1.49, 2.03), (4.4, -5.1)] {
                assert!((stamp.at(x, y) - psf.pixel(x, y)).abs() < 2e-4, "{x} {y} {psf:?}");
            }
            assert_eq!(stamp.at(9.0, 0.0), 0.0);
        }
        let sum: f64 = (-7..=7)
            .flat_map(|y| (-7..=7).map(move |x| (x, y)))
            .map(|(x, y)| Stamp::of(&PsfModel::gaussian(0.55)).at(f64::from(x) - 0.3, f64::from(y) + 0.2))
            .sum();
        assert!((sum - 1.0).abs() < 1e-3, "{sum}");
    }
}
