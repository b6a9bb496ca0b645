//! What the effects cost: shares of the time that a pixel takes with shot and read noise, PRNU and DSNU.
//!
//! Processor time on one thread of the CPU backend, 512 x 512 pixels, where that pixel takes 4.9 ns (`cargo bench --bench
//! effects`, least of 80 frames, good to 3 % of the pixel). An effect that is off, truncation, amplifier noise and a
//! temperature cost nothing. On a device the shares are smaller: its memory is the limit.

use crate::detector::{DetectorParams, Patterns};

/// The passes apart, for neighbour stages or for who keeps the charge: two more trips to memory, words drawn twice.
pub const TWO_PASSES: f64 = 0.30;
/// A map of the dark current.
const DARK_FACTOR: f64 = 0.04;
/// Three thresholds.
const NONLINEARITY: f64 = 0.03;
/// A gain and an offset by column.
const COLUMNS: f64 = 0.03;
/// An offset by row: a fixed pattern, or noise.
const ROWS: f64 = 0.02;
/// Drawing one row's noise, in pixels of readout: 0.4 us.
const ROW_NOISE_PX: f64 = 80.0;

/// One effect that is on, and what it adds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectCost {
    /// Name for people.
    pub name: &'static str,
    /// Share of a pixel's readout without it.
    pub share: f64,
}

/// The effects that are on and cost time, in the order of light.
pub fn effect_costs(
    params: &DetectorParams,
    patterns: &Patterns,
    width_px: usize,
) -> impl Iterator<Item = EffectCost> + use<> {
    let lines = params.line_pattern;
    let has_dark_map = params.dark_nonuniformity > 0.0 || patterns.dark_factor.is_some();
    [
        ("dark non-uniformity", DARK_FACTOR, has_dark_map),
        ("nonlinearity", NONLINEARITY, params.nonlinearity.is_on()),
        ("columns", COLUMNS, lines.has_columns()),
        ("rows", ROWS, lines.row_e_rms > 0.0),
        ("row noise", ROWS + ROW_NOISE_PX / width_px.max(1) as f64, params.row_noise.is_on()),
    ]
    .into_iter()
    .filter(|(_, _, is_on)| *is_on)
    .map(|(name, share, _)| EffectCost { name, share })
}

/// By how much longer the readout takes than without the effects; exactly 1 when all are off.
#[must_use]
pub fn factor(params: &DetectorParams, patterns: &Patterns, width_px: usize) -> f64 {
    1.0 + effect_costs(params, patterns, width_px).map(|cost| cost.share).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::{Nonlinearity, RowNoise};

    #[test]
    fn off_costs_nothing_and_on_is_told() {
        let none = Patterns::default();
        assert_eq!(factor(&DetectorParams::QUIET, &none, 1024), 1.0, "exactly: plans stay the same");
        let free = DetectorParams { amplifier_noise_e_rms: 5.0, ..DetectorParams::QUIET };
        assert_eq!(factor(&free, &none, 1024), 1.0, "one draw with the read noise");
        let row_noise = RowNoise { e_rms: 1.0, corner_cycles_per_row: 0.0 };
        let nonlinearity = Nonlinearity::through(&[[1000.0, 990.0]]).expect("rising");
        let params = DetectorParams { row_noise, nonlinearity, ..DetectorParams::QUIET };
        let names: Vec<&str> = effect_costs(&params, &none, 1000).map(|cost| cost.name).collect();
        assert_eq!(names, ["nonlinearity", "row noise"]);
        assert!((factor(&params, &none, 1000) - 1.13).abs() < 1e-12);
        let map = Patterns { dark_factor: Some([1.0_f32].into()), ..none };
        assert!(factor(&DetectorParams::QUIET, &map, 1000) > 1.0);
    }
}
