//! Multiply-add that is fused where the processor has it, and the same on every processor that does.

/// Adding this to a float of magnitude below 2^22 leaves its nearest integer in the low bits.
const INTEGER_MAGIC: f32 = 12_582_912.0; // 1.5 * 2^23

/// Returns the low bits of a whole number below 2^22 in magnitude, in two's complement (take as many as 22 of them).
/// An `as` cast saturates, and so does not vectorise.
#[inline(always)]
pub fn whole_bits(whole: f32) -> u32 {
    (whole + INTEGER_MAGIC).to_bits()
}

/// Returns `a * b + c`, rounded once when `FUSED`, else twice. Vector code picks `FUSED` from the processor at run
/// time; emulated fusing would be fifty times slower.
#[inline(always)]
pub fn mul_add<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}
