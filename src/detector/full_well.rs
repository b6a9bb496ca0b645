//! Saturation: no pixel holds more than its full well (the excess is lost; blooming is not modelled here).

use crate::detector::block::BLOCK;

/// Clips every pixel at `full_well_e`.
#[inline(always)]
pub fn clip(electrons: &mut [f32; BLOCK], full_well_e: f32) {
    for e in electrons {
        *e = e.min(full_well_e);
    }
}
