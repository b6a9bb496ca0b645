//! Multiply-add that is fused where the processor has it, and the same on every processor that does.

/// `a * b + c`: rounded once when `FUSED`, else twice. Vector code picks `FUSED` from the processor at run time;
/// emulated fusing would be fifty times slower.
#[inline(always)]
#[must_use]
pub fn mul_add<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}
