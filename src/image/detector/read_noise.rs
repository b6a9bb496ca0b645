//! Read noise, and in quadrature with it amplifier noise: a normal deviate per pixel, by Box and Muller (1958), one
//! pair of words for two pixels.
//! |z| <= 5.6 (23-bit uniforms).

use crate::detector::block::{BLOCK, PAIRS, Words};
use crate::detector::elementary::{ln, open_unit, sin_cos_turns, unit};
use base::fused::mul_add;

/// Adds `sigma_e` times a standard normal deviate to every pixel.
#[inline(always)]
pub fn add<const FUSED: bool>(electrons: &mut [f32; BLOCK], words: &Words, sigma_e: f32) {
    let mut even = [0.0_f32; PAIRS];
    let mut odd = [0.0_f32; PAIRS];
    for i in 0..PAIRS {
        let (a, b) = normal_pair::<FUSED>(words.read_a[i], words.read_b[i]);
        even[i] = a;
        odd[i] = b;
    }
    for (pair, (a, b)) in electrons.chunks_exact_mut(2).zip(even.iter().zip(&odd)) {
        pair[0] = mul_add::<FUSED>(sigma_e, *a, pair[0]);
        pair[1] = mul_add::<FUSED>(sigma_e, *b, pair[1]);
    }
}

/// Returns two independent standard normal deviates from two words.
#[inline(always)]
pub fn normal_pair<const FUSED: bool>(a: u32, b: u32) -> (f32, f32) {
    let radius = (-2.0 * ln::<FUSED>(open_unit(a))).sqrt();
    let (sin, cos) = sin_cos_turns::<FUSED>(unit(b));
    (radius * cos, radius * sin)
}
