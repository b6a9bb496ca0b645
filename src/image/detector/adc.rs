//! Quantisation: `DN = floor(e / gain + black level + 1/2)`, clipped to `0 ..= 2^bits - 1`.
//!
//! Rounding is usual: the black level then is the mean DN of a dark pixel. A converter that truncates leaves out the
//! half, and its numbers are half a DN lower in the mean. Quantisation noise 1/12 DN^2 either way (EMVA 1288, section
//! 2.5). A converter matched to the pixel has `gain = full well / 2^bits` (one LSB).

use crate::detector::{block::BLOCK, constants::Constants};
use base::fused::{mul_add, whole_bits};

/// Converts a block.
#[inline(always)]
pub fn convert<const FUSED: bool>(electrons: &[f32; BLOCK], constants: &Constants, out: &mut [u16; BLOCK]) {
    for (dn, e) in out.iter_mut().zip(electrons) {
        let x = mul_add::<FUSED>(*e, constants.dn_per_e, constants.black_dn + constants.rounding_dn).floor();
        #[allow(clippy::cast_possible_truncation, reason = "the low 16 bits are wanted: 0..=65535 by the clamp")]
        let value = whole_bits(x.max(0.0).min(constants.largest_dn)) as u16;
        *dn = value;
    }
}
