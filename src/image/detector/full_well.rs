//! Saturation: no pixel holds more than its full well (the excess is lost; `blooming` lets it spill instead).

use crate::detector::DetectorParams;

/// Returns the saturation capacity as the inner loops want it, e-.
#[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
pub fn limit_e(params: &DetectorParams) -> f32 {
    params.full_well_e as f32
}

/// Clips every pixel at `full_well_e`.
#[inline(always)]
pub fn clip(electrons: &mut [f32], full_well_e: f32) {
    for e in electrons {
        *e = e.min(full_well_e);
    }
}
