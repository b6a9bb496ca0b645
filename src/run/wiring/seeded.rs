//! Random numbers from a seed, for starts and schedules.

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Returns `N` numbers, uniform in `0..1`.
pub fn uniforms<const N: usize>(seed: u64) -> [f64; N] {
    let mut dice = StdRng::seed_from_u64(seed);
    core::array::from_fn(|_| dice.random())
}
