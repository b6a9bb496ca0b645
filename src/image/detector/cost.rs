//! The cost of the effects: their shares of the time that a pixel takes with shot and read noise, PRNU and DSNU.
//!
//! Pixel-local effects: processor time on one thread, 512 x 512 pixels, where that pixel takes 4.9 ns (least of 80
//! frames; good to 6 % of the pixel, below which a share is rounded up). Effects of neighbours: the last table of
//! `starloop chart`, 1024 x 1024, two threads, with the passes apart that they need; of several together the sum is too
//! much. An effect that is off, truncation, amplifier noise and a temperature cost nothing. On a device the shares are
//! others: its memory is the limit.

use crate::detector::{DetectorParams, Patterns};
use crate::detector::{binning::BinningKind, block::BLOCK, defects::DefectPopulation};
use base::region::Regions;

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

/// One pixel in a thousand, looked for in every block.
const DEFECTS: f64 = 0.1;
/// Tracks of a storm.
const PROTONS: f64 = 0.3;
/// An image of the remaining charge.
const IMAGE_LAG: f64 = 1.0;
/// Every column looked at.
const BLOOMING: f64 = 0.7;
/// Delays along both axes.
const CHARGE_TRANSFER: f64 = 2.9;
/// Sums of squares.
const CHARGE_BINNING: f64 = 0.5;

/// One effect that is on, and its cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectCost {
    /// Name for people.
    pub name: &'static str,
    /// Share of a pixel's readout without it.
    pub share: f64,
}

/// Returns the effects that are on and cost time, in the order of light.
pub fn effect_costs(
    params: &DetectorParams,
    patterns: &Patterns,
    width_px: usize,
) -> impl Iterator<Item = EffectCost> + use<> {
    let lines = params.line_pattern;
    let spatial = params.spatial;
    let charge_is_binned = spatial.binning.is_some_and(|binning| matches!(binning.kind, BinningKind::Charge { .. }));
    let has_dark_map = params.dark_nonuniformity > 0.0 || patterns.dark_factor.is_some();
    [
        ("dark non-uniformity", DARK_FACTOR, has_dark_map),
        ("defects", DEFECTS, spatial.defects != DefectPopulation::NONE),
        ("protons", PROTONS, spatial.protons.is_some()),
        ("image lag", IMAGE_LAG, spatial.image_lag.is_some()),
        ("blooming", BLOOMING, spatial.blooming.is_some()),
        ("charge transfer", CHARGE_TRANSFER, spatial.charge_transfer.is_some()),
        ("binning of charge", CHARGE_BINNING, charge_is_binned),
        ("nonlinearity", NONLINEARITY, params.nonlinearity.is_on()),
        ("columns", COLUMNS, lines.has_columns()),
        ("rows", ROWS, lines.row_e_rms > 0.0),
        ("row noise", ROWS + ROW_NOISE_PX / width_px.max(1) as f64, params.row_noise.is_on()),
    ]
    .into_iter()
    .filter(|(_, _, is_on)| *is_on)
    .map(|(name, share, _)| EffectCost { name, share })
}

/// Returns the ratio of the readout time with the effects to that without; exactly 1 when all are off.
pub fn factor(params: &DetectorParams, patterns: &Patterns, width_px: usize) -> f64 {
    1.0 + effect_costs(params, patterns, width_px).map(|cost| cost.share).sum::<f64>()
}

/// Returns the share of the whole readout's time that these regions of the sensor take: each run of their pixels takes
/// whole blocks. Effects of neighbours take the whole image.
pub fn share_of(params: &DetectorParams, regions: &Regions, sensor_px: [usize; 2]) -> f64 {
    let [width, height] = sensor_px;
    let spatial = &params.spatial;
    let charge_is_binned = spatial.binning.is_some_and(|binning| matches!(binning.kind, BinningKind::Charge { .. }));
    let has_lag = spatial.image_lag.is_some() || spatial.blooming.is_some() || spatial.charge_transfer.is_some();
    if regions.is_whole() || charge_is_binned || has_lag {
        return 1.0;
    }
    let pixels = regions.sum_over_runs(sensor_px, |run, _| run.len().next_multiple_of(BLOCK));
    (pixels as f64 / (width * height).max(1) as f64).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::charge_transfer::ChargeTransfer;
    use crate::detector::{Nonlinearity, RowNoise, SpatialParams};
    use base::region::Region;

    #[test]
    fn off_costs_nothing_and_on_is_reported() {
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

    #[test]
    fn windows_cost_their_blocks_unless_charge_moves_in_the_whole_image() {
        let window = |left_px| Region { left_px, top_px: 100, width_px: 32, height_px: 32 };
        let regions = Regions::of(&[window(0), window(500)]).expect("two");
        let share = share_of(&DetectorParams::QUIET, &regions, [1024, 1024]);
        assert_eq!(share, 2.0 * 32.0 * 256.0 / (1024.0 * 1024.0), "a block for each run of 32 pixels");
        assert_eq!(share_of(&DetectorParams::QUIET, &Regions::WHOLE, [1024, 1024]), 1.0);
        let transfer = Some(ChargeTransfer::NONE);
        let moving = DetectorParams {
            spatial: SpatialParams { charge_transfer: transfer, ..SpatialParams::OFF },
            ..DetectorParams::QUIET
        };
        assert_eq!(share_of(&moving, &regions, [1024, 1024]), 1.0);
    }
}
