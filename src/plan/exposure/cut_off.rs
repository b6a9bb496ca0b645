//! Star cut-off: stars that stay below a share of the noise in every pixel, and the light lost by leaving them out.
//!
//! In: sources' electrons and places. Out: the limit in electrons below which a star is left out, and a bound of the
//! light missing in any pixel: faint stars add up where they crowd, so the bound is summed over cells of a footprint's
//! width and the four cells that any footprint can touch. Test below; the planner's property test in `tests/physics`.

use crate::exposure::plan::CutOff;

/// Number of times the limit is halved before no star is left out.
const HALVINGS: u32 = 6;

/// Sums over cells, kept from frame to frame.
#[derive(Debug, Default)]
pub struct CutOffCells {
    columns: usize,
    rows: usize,
    cell_px: f64,
    sums: Vec<f64>,
}

impl CutOffCells {
    /// Sets a detector of `size_px` and footprints that reach `reach_px` from a star's mean place.
    pub fn resize(&mut self, size_px: [usize; 2], reach_px: f64) {
        self.cell_px = 2.0 * reach_px + 1.0;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a detector's side in cells")]
        let cells = |side: usize| ((side as f64 + 2.0 * reach_px) / self.cell_px).ceil() as usize + 2;
        (self.columns, self.rows) = (cells(size_px[0]), cells(size_px[1]));
        self.sums.clear();
        self.sums.resize(self.columns * self.rows, 0.0);
    }

    /// Chooses the limit: no pixel may lack more than `allowed_e` when a star gives any pixel at most `peak` of its
    /// light. `stars` yields electrons and mean places. Returns the limit and what is left out.
    pub fn choose(
        &mut self,
        allowed_e: f64,
        peak: f64,
        stars: impl Iterator<Item = (f64, [f64; 2])> + Clone,
    ) -> (f64, CutOff) {
        let mut limit_e = allowed_e / peak;
        if !stars.clone().any(|(electrons, _)| electrons < limit_e) {
            return (0.0, CutOff::default());
        }
        for _ in 0..HALVINGS {
            let cut = self.left_out(peak, stars.clone().filter(|(electrons, _)| *electrons < limit_e));
            if cut.stars == 0 {
                break;
            }
            if cut.most_in_pixel_e <= allowed_e {
                return (limit_e, cut);
            }
            limit_e *= 0.5;
        }
        (0.0, CutOff::default())
    }

    /// Returns the light lost by leaving out `stars`.
    pub fn left_out(&mut self, peak: f64, stars: impl Iterator<Item = (f64, [f64; 2])>) -> CutOff {
        self.sums.fill(0.0);
        let mut cut = CutOff::default();
        for (electrons, [x, y]) in stars {
            let at = |v: f64, cells: usize| {
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
                let i = ((v / self.cell_px) + 1.0).floor().clamp(0.0, cells as f64 - 1.0) as usize;
                i
            };
            let cell = at(y, self.rows) * self.columns + at(x, self.columns);
            self.sums[cell] += electrons;
            cut.stars += 1;
            cut.electrons += electrons;
        }
        cut.most_in_pixel_e = peak * self.most_in_four_cells();
        cut
    }

    fn most_in_four_cells(&self) -> f64 {
        let mut most = 0.0_f64;
        for row in 1..self.rows {
            for column in 1..self.columns {
                let at = row * self.columns + column;
                let sums = [at, at - 1, at - self.columns, at - self.columns - 1].map(|i| self.sums[i]);
                most = most.max(sums.iter().sum());
            }
        }
        most
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(stars: &[(f64, [f64; 2])], allowed_e: f64) -> (f64, CutOff) {
        let mut cells = CutOffCells::default();
        cells.resize([64, 64], 4.0);
        cells.choose(allowed_e, 0.25, stars.iter().copied())
    }

    #[test]
    fn stars_below_the_limit_are_left_out_and_crowds_are_kept() {
        let outlier = [(3.0, [10.0, 10.0]), (3.0, [50.0, 50.0]), (500.0, [30.0, 30.0])];
        let (limit_e, cut) = chosen(&outlier, 1.0);
        assert!((limit_e, cut.stars) == (4.0, 2) && cut.most_in_pixel_e <= 1.0, "{limit_e} {cut:?}");
        let crowd: Vec<_> = (0..100).map(|i| (3.0, [20.0 + 0.01 * f64::from(i), 20.0])).collect();
        assert_eq!(chosen(&crowd, 1.0), (0.0, CutOff::default()), "300 e- in one place are too bright to leave out");
        assert_eq!(chosen(&[(5.0, [1.0, 1.0])], 1.0).0, 0.0, "nothing below the limit");
    }

    #[test]
    fn a_crowd_across_the_border_of_cells_is_seen_whole() {
        let pair = [(3.9, [8.99, 8.99]), (3.9, [9.01, 9.01])];
        let (_, cut) = chosen(&pair, 1.0);
        assert_eq!(cut.stars, 0, "together 7.8 e-, peak 1.95 e-: {cut:?}");
    }
}
