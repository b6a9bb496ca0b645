//! Fits cost constants to measured times of known frames -> [`CostModel`].
//!
//! The model is linear in its constants, so the coefficients of a time are the model's predictions with one constant
//! set to 1 and all others to 0. Least squares of predicted / measured - 1 with no constant below 0, by projected
//! Gauss-Seidel on the normal equations (convex: it converges from any start). Constants that affect no measured time,
//! the number of threads and the readout keep their values. Tests below: known constants are recovered, wrong times are
//! detected.

use crate::exposure::cost::{CostModel, Load};
use crate::exposure::method::Method;

/// Number of constants that are fitted.
const FITTED: usize = 10;
/// Number of Gauss-Seidel sweeps: enough for constants to 1e-3 on exact times of [`FITTED`] unknowns.
const SWEEPS: usize = 100_000;

/// Measured time of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing<'a> {
    /// Pixels of the detector.
    pub pixels: usize,
    /// Method that drew its stars.
    pub method: Method,
    /// Its stars.
    pub load: Load<'a>,
    /// Measured time of drawing, ms.
    pub ms: f64,
}

impl Timing<'_> {
    /// Returns the time that the model predicts for it, ms.
    pub fn predicted_ms(&self, cost: &CostModel) -> f64 {
        let stars_ms = if self.load.stars == 0 { 0.0 } else { cost.stars_ms(self.method, &self.load) };
        cost.empty_frame_ms(self.pixels, self.load.moves) + stars_ms
    }
}

/// Returns the non-negative constants whose predictions are closest to the measured times.
pub fn fit(timings: &[Timing<'_>], usual: &CostModel) -> CostModel {
    let (mut normal, mut right) = ([[0.0; FITTED]; FITTED], [0.0; FITTED]);
    for timing in timings.iter().filter(|timing| timing.ms.is_finite() && timing.ms > 0.0) {
        let row: [f64; FITTED] = core::array::from_fn(|i| {
            let mut unit = [0.0; FITTED];
            unit[i] = 1.0;
            timing.predicted_ms(&with(usual, unit)) / timing.ms
        });
        for i in 0..FITTED {
            right[i] += row[i];
            for j in 0..FITTED {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    let mut constants = of(usual);
    for _ in 0..SWEEPS {
        for i in 0..FITTED {
            if normal[i][i] > 0.0 {
                let slope: f64 = normal[i].iter().zip(constants).map(|(a, x)| a * x).sum();
                constants[i] = (constants[i] + (right[i] - slope) / normal[i][i]).max(0.0);
            }
        }
    }
    with(usual, constants)
}

/// Returns the constants that are fitted.
fn fitted(cost: &mut CostModel) -> [&mut f64; FITTED] {
    [
        &mut cost.frame_ms,
        &mut cost.pixel_ns,
        &mut cost.star_ns,
        &mut cost.motion_ms,
        &mut cost.motion_star_ns,
        &mut cost.splat_ns,
        &mut cost.table_pixel_ns,
        &mut cost.base_pixel_ns,
        &mut cost.kernel_node_ns,
        &mut cost.kernel_entry_ns,
    ]
}

fn of(cost: &CostModel) -> [f64; FITTED] {
    fitted(&mut cost.clone()).map(|constant| *constant)
}

fn with(usual: &CostModel, constants: [f64; FITTED]) -> CostModel {
    let mut cost = *usual;
    for (to, constant) in fitted(&mut cost).into_iter().zip(constants) {
        *to = constant;
    }
    cost
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::PsfModel;

    const TRUE: CostModel = CostModel {
        frame_ms: 0.3,
        pixel_ns: 0.2,
        star_ns: 90.0,
        motion_ms: 0.15,
        motion_star_ns: 30.0,
        splat_ns: 12.0,
        table_pixel_ns: 1.5,
        base_pixel_ns: 3.0,
        kernel_node_ns: 0.08,
        kernel_entry_ns: 0.9,
        threads: 8.0,
        readout_pixel_ns: 2.0,
    };

    /// Returns frames like those that are measured, with the times that `cost` predicts.
    fn timings<'a>(cost: &CostModel, psf: &'a PsfModel, airy: &'a PsfModel) -> Vec<Timing<'a>> {
        let frames = [
            (1 << 18, Method::Static, 0),
            (1 << 22, Method::Static, 0),
            (1 << 20, Method::Static, 20_000),
            (1 << 20, Method::Samples { nodes: 2 }, 20),
            (1 << 20, Method::Samples { nodes: 16 }, 5_000),
            (1 << 20, Method::Samples { nodes: 64 }, 5_000),
            (1 << 20, Method::EffectivePsf { nodes: 16, stretches: 0 }, 16),
            (1 << 20, Method::EffectivePsf { nodes: 256, stretches: 0 }, 16),
            (1 << 20, Method::EffectivePsf { nodes: 16, stretches: 0 }, 20_000),
        ];
        let timing = |(pixels, method, stars)| {
            let load = Load { psf, half_px: 5, extent_px: 1.5, stars, moves: method != Method::Static };
            let mut timing = Timing { pixels, method, load, ms: 1.0 };
            timing.ms = timing.predicted_ms(cost);
            timing
        };
        let mut timings: Vec<_> = frames.into_iter().map(timing).collect();
        let mut last =
            Timing { load: Load { psf: airy, half_px: 40, extent_px: 0.0, stars: 500, moves: false }, ..timings[2] };
        last.ms = last.predicted_ms(cost);
        timings.push(last);
        timings
    }

    #[test]
    fn known_constants_are_recovered_from_a_wrong_start() {
        /// Remaining error of Gauss-Seidel.
        const RELATIVE: f64 = 1e-3;
        let (psf, airy) = (PsfModel::gaussian(0.8), PsfModel::airy(1.5, 0.0));
        let timings = timings(&TRUE, &psf, &airy);
        let usual = CostModel { threads: TRUE.threads, readout_pixel_ns: 2.0, ..CostModel::SOFTWARE_GPU };
        let found = fit(&timings, &usual);
        for (found, wanted) in of(&found).into_iter().zip(of(&TRUE)) {
            assert!((found / wanted - 1.0).abs() < RELATIVE, "{found} for {wanted}");
        }
        assert_eq!((found.threads, found.readout_pixel_ns), (8.0, 2.0), "not fitted");
    }

    #[test]
    fn another_machine_has_other_constants_and_a_wrong_timing_is_seen() {
        let (psf, airy) = (PsfModel::gaussian(0.8), PsfModel::airy(1.5, 0.0));
        let slower = CostModel { splat_ns: 24.0, ..TRUE };
        let found = fit(&timings(&slower, &psf, &airy), &CostModel::CPU);
        assert!((found.splat_ns / 24.0 - 1.0).abs() < 0.01, "{found:?}");
        let mut disturbed = timings(&TRUE, &psf, &airy);
        disturbed[1].ms *= 0.1;
        let found = fit(&disturbed, &CostModel::CPU);
        assert!(of(&found).into_iter().all(|constant| constant >= 0.0), "{found:?}");
        let misfit = |timing: &Timing<'_>| (timing.predicted_ms(&found) / timing.ms - 1.0).abs();
        let worst = disturbed.iter().map(misfit).fold(0.0, f64::max);
        assert!(worst > 0.1, "no constants explain these timings: {worst}");
    }
}
