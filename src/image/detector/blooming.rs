//! Blooming: charge above the full well spills along the column, up and down alike; an anti-blooming drain takes a
//! share.
//!
//! In: charge of every pixel, e-. Out: no pixel above the full well. Of the excess charge of a pixel, `drained_share`
//! is lost at once; one half of the rest goes down the column and one half up, and fills the free capacity of the
//! nearest pixels first. Charge that passes the first or last row is lost. Rows do not exchange charge (channel stops).
//! Where two streams meet in the same free capacity, the result is the mean of serving one first and serving the other
//! first, so a flipped column gives the flipped result. Electrons in = electrons out + drained + lost at the ends, to
//! f32 rounding (tests below).
//!
//! Terms: Janesick, "Scientific charge-coupled devices" (2001), sections 4.2.3 and 4.2.4. Limits: no charge diffuses
//! sideways, the drain does not depend on signal, and spilled charge is not counted in whole electrons.
//! [`FullWell`](crate::detector::Effect::FullWell) is this stage when blooming is on, and a plain clip when it is off.

use crate::detector::Effect;
use crate::detector::effect_order::{FrameAt, NeighbourStage};
use base::image::Image;

/// Loss and spilling of charge above the full well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blooming {
    /// Share of the excess that the anti-blooming drain takes, 0 to 1; at 1 nothing spills.
    pub drained_share: f64,
}

impl Blooming {
    /// Returns the share of the excess that goes each way.
    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    pub fn each_way(&self) -> f32 {
        (0.5 * (1.0 - self.drained_share)) as f32
    }
}

/// The stage with its working memory.
#[derive(Debug)]
pub struct BloomingStage {
    full_well_e: f32,
    each_way: f32,
    over: Vec<bool>,
    column: Column,
}

/// One column while it is spilled.
#[derive(Debug, Default)]
struct Column {
    charge_e: Vec<f32>,
    down_first: Vec<f32>,
    up_first: Vec<f32>,
}

impl BloomingStage {
    /// Returns the stage for images of this size.
    pub fn new(blooming: &Blooming, full_well_e: f32, [width, height]: [usize; 2]) -> Self {
        let row = || vec![0.0; height];
        let column = Column { charge_e: row(), down_first: row(), up_first: row() };
        Self { full_well_e, each_way: blooming.each_way(), over: vec![false; width], column }
    }
}

impl NeighbourStage for BloomingStage {
    fn effect(&self) -> Effect {
        Effect::FullWell
    }

    fn apply<'a>(&'a mut self, charge: &'a mut Image<f32>, _: &FrameAt) -> &'a mut Image<f32> {
        let width = charge.width();
        self.over.fill(false);
        for row in charge.rows() {
            self.over.iter_mut().zip(row).for_each(|(over, e)| *over |= *e > self.full_well_e);
        }
        // Most columns hold no saturated pixel, and are not touched.
        for (x, _) in self.over.iter().enumerate().filter(|(_, over)| **over) {
            let pixels = charge.pixels_mut();
            let column = pixels.iter().skip(x).step_by(width);
            self.column.charge_e.iter_mut().zip(column).for_each(|(to, from)| *to = *from);
            self.column.spill(self.full_well_e, self.each_way);
            let column = pixels.iter_mut().skip(x).step_by(width);
            column.zip(&self.column.charge_e).for_each(|(to, from)| *to = *from);
        }
        charge
    }
}

impl Column {
    /// Spills the excess charge in the same steps as `blooming.wgsl`.
    fn spill(&mut self, full_well_e: f32, each_way: f32) {
        let Self { charge_e, down_first, up_first } = self;
        let rows = charge_e.len();
        let own = |e: f32| (e - full_well_e).max(0.0) * each_way;
        let level = |to: &mut [f32], from: &[f32]| to.iter_mut().zip(from).for_each(|(to, e)| *to = e.min(full_well_e));
        let stream = |to: &mut [f32], y: usize, carry: f32| {
            let taken = carry.min(full_well_e - to[y]);
            to[y] += taken;
            (carry - taken) + own(charge_e[y])
        };
        level(down_first, charge_e);
        (0..rows).fold(0.0, |carry, y| stream(down_first, y, carry));
        (0..rows).rev().fold(0.0, |carry, y| stream(down_first, y, carry));
        level(up_first, charge_e);
        (0..rows).rev().fold(0.0, |carry, y| stream(up_first, y, carry));
        (0..rows).fold(0.0, |carry, y| stream(up_first, y, carry));
        for (e, (a, b)) in charge_e.iter_mut().zip(down_first.iter().zip(&*up_first)) {
            *e = 0.5 * (a + b);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::random::philox;

    const FULL_WELL_E: f32 = 1000.0;
    const AT: FrameAt = FrameAt { frame: 0, exposure_s: 1.0, key: [0; 2] };

    fn bloom(column: &[f32], drained_share: f64) -> Vec<f32> {
        let mut image = Image::new(3, column.len());
        image.pixels_mut().iter_mut().skip(1).step_by(3).zip(column).for_each(|(to, from)| *to = *from);
        let mut stage = BloomingStage::new(&Blooming { drained_share }, FULL_WELL_E, [3, column.len()]);
        stage.apply(&mut image, &AT);
        assert!(image.pixels().iter().step_by(3).all(|e| *e == 0.0), "the columns beside it have none");
        image.pixels().iter().skip(1).step_by(3).copied().collect()
    }

    fn sum(column: &[f32]) -> f64 {
        column.iter().map(|e| f64::from(*e)).sum()
    }

    /// Returns a crowded column: some pixels far above the full well, most below.
    fn crowded(rows: u32, stream: u32) -> Vec<f32> {
        let pixel = |y| {
            let [a, b, ..] = philox([y, stream, 3, 0], [1, 2]).map(|word| word as f32 / 4_294_967_296.0);
            if a < 0.03 { 1000.0 + 15_000.0 * b } else { 900.0 * b }
        };
        (0..rows).map(pixel).collect()
    }

    #[test]
    fn one_bright_pixel_fills_its_neighbours_evenly() {
        let mut column = vec![0.0; 41];
        column[20] = 1000.0 + 2.0 * 3500.0;
        let out = bloom(&column, 0.0);
        for (y, e) in out.iter().enumerate() {
            let wanted = match y.abs_diff(20) {
                0..=3 => 1000.0,
                4 => 500.0,
                _ => 0.0,
            };
            assert_eq!(*e, wanted, "row {y}");
        }
        let drained = bloom(&column, 0.5);
        assert_eq!(sum(&drained), 1000.0 + 3500.0, "half of the excess is drained");
        assert_eq!(drained[22], 750.0);
        assert_eq!(bloom(&column, 1.0), column.iter().map(|e| e.min(1000.0)).collect::<Vec<_>>(), "a clip");
    }

    #[test]
    fn charge_is_kept_drained_or_lost_at_the_ends() {
        for drained_share in [0.0, 0.3, 0.9] {
            for stream in 0..40 {
                // Empty margins: nothing reaches the ends.
                let mut column = vec![0.0; 2000];
                column[900..1100].copy_from_slice(&crowded(200, stream));
                let excess = column.iter().map(|e| f64::from((e - FULL_WELL_E).max(0.0))).sum::<f64>();
                let out = bloom(&column, drained_share);
                let wanted = sum(&column) - drained_share * excess;
                assert!((sum(&out) / wanted - 1.0).abs() < 1e-6, "{} for {wanted}", sum(&out));
                assert!(out.iter().all(|e| *e <= FULL_WELL_E && *e >= 0.0), "no pixel above the full well");
                assert!(excess < 1.0 || (sum(&out) / (wanted + 0.01 * excess) - 1.0).abs() > 1e-6, "negative control");
            }
        }
        // All pixels are saturated: no pixel has free capacity, and only the full wells are left.
        assert_eq!(sum(&bloom(&[5000.0; 30], 0.0)), 30.0 * 1000.0);
        // Two rows from the end: one half fills them and the rest is lost, the other half fills the other side.
        let mut column = vec![0.0; 20];
        column[2] = 1000.0 + 2.0 * 5000.0;
        assert_eq!(sum(&bloom(&column, 0.0)), 1000.0 + 2000.0 + 5000.0);
    }

    #[test]
    fn a_column_turned_over_blooms_turned_over() {
        for stream in 0..40 {
            let column = crowded(300, stream);
            let mut out = bloom(&column.iter().rev().copied().collect::<Vec<_>>(), 0.2);
            out.reverse();
            assert_eq!(out, bloom(&column, 0.2), "column {stream}");
        }
    }

    #[test]
    fn columns_below_the_full_well_stay_as_they_are() {
        let column: Vec<f32> = crowded(100, 1).iter().map(|e| e.min(1000.0)).collect();
        assert_eq!(bloom(&column, 0.0), column);
    }
}
