//! Read noise, and in quadrature with it amplifier noise: a normal deviate per pixel, by Box and Muller (1958), one
//! pair of words for two pixels.
//! |z| <= 5.6 (23-bit uniforms).
//!
//! *Row noise.* Noise that a row shares: white from row to row, and 1/f along the readout. (frame, seed) -> electrons
//! by row.
//!
//! A row is read in one go (column-parallel readout), so the noise of supplies and references in that moment is common
//! to it. One-sided density over rows, `f` in cycles per row: `S(f) = 2 sigma^2 (1 + corner / f)`, `0 < f <= 1/2`:
//! `sigma` is the rms of the white part alone, `corner` where 1/f equals it.
//!
//! Source of 1/f: a sum of relaxations with rates a factor 4 apart (van der Ziel 1950; Milotti, "1/f noise: a
//! pedagogical review", 2002), each an exact autoregression `x' = a x + sqrt(v (1 - a^2)) z`. Nine of them follow
//! `corner / f` within 1.5 % from 5e-5 to 0.1 cycles per row and 10 % up to 1/2 (a sampled spectrum is flat there);
//! below 3e-6 they are flat. Noise slower than a frame shows as an offset of the frame. Every frame starts again:
//! nothing is carried from one to another, so any frame can be replayed alone. Noise within a row is not modelled.
//!
//! The rows are drawn once on the host; every backend adds the same numbers. Tests: below, and
//! `tests/physics/line_noise.rs`.

use crate::detector::block::{BLOCK, PAIRS, Words};
use crate::detector::elementary::{ln, open_unit, sin_cos_turns, unit};
use base::fused::mul_add;
use base::random::{Stage, attempt_counter, philox};

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

/// Relaxations of the 1/f part.
const POLES: usize = 9;
/// Fastest relaxation, per row; each next is [`RATIO`] times slower.
const FASTEST_PER_ROW: f64 = 1.1;
/// From one relaxation's rate to the next.
const RATIO: f64 = 4.0;
/// Variance of the fastest relaxation divided by that of the others: it replaces all faster ones.
const FASTEST_WEIGHT: f64 = 1.2;
/// Philox blocks of a row: twelve deviates, one for white noise, nine for the relaxations.
const BLOCKS: u32 = 3;

/// Row noise of the readout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowNoise {
    /// White part, e- rms.
    pub e_rms: f64,
    /// Frequency at which the 1/f part equals the white part, cycles per row; 0: white alone.
    pub corner_cycles_per_row: f64,
}

impl RowNoise {
    /// None.
    pub const OFF: Self = Self { e_rms: 0.0, corner_cycles_per_row: 0.0 };

    /// Returns true if row noise is on.
    pub fn is_on(&self) -> bool {
        self.e_rms > 0.0
    }

    /// Returns the one-sided density of the sequence that is drawn, e-^2 per cycle per row.
    pub fn density(&self, cycles_per_row: f64) -> f64 {
        let cos = (core::f64::consts::TAU * cycles_per_row).cos();
        let of_pole = |pole: Pole| {
            let a = pole.keep;
            2.0 * pole.variance_e2 * (1.0 - a * a) / (1.0 - 2.0 * a * cos + a * a)
        };
        2.0 * self.e_rms.powi(2) + self.poles().map(of_pole).iter().sum::<f64>()
    }

    /// Returns the variance of one row's number over many frames, e-^2.
    pub fn variance_e2(&self) -> f64 {
        self.e_rms.powi(2) + self.poles().map(|pole| pole.variance_e2).iter().sum::<f64>()
    }

    fn poles(&self) -> [Pole; POLES] {
        let each_e2 = 2.0 * self.e_rms.powi(2) * self.corner_cycles_per_row * RATIO.ln();
        let mut rate = FASTEST_PER_ROW * RATIO;
        core::array::from_fn(|k| {
            rate /= RATIO;
            Pole { keep: (-rate).exp(), variance_e2: if k == 0 { FASTEST_WEIGHT * each_e2 } else { each_e2 } }
        })
    }

    /// Draws the rows of `frame`, e-.
    #[allow(clippy::cast_possible_truncation, reason = "rows are few; noise is f32")]
    pub fn draw(&self, frame: u32, key: [u32; 2], rows: &mut [f32]) {
        let poles = self.poles();
        let normals = |row: u32, attempt: u32| -> [f32; 4 * BLOCKS as usize] {
            let mut z = [0.0; 4 * BLOCKS as usize];
            for (z, block) in z.chunks_exact_mut(4).zip(0..BLOCKS) {
                let [a, b, c, d] = philox(attempt_counter(frame, row * BLOCKS + block, Stage::RowNoise, attempt), key);
                let ((z0, z1), (z2, z3)) = (normal_pair::<true>(a, b), normal_pair::<true>(c, d));
                z.copy_from_slice(&[z0, z1, z2, z3]);
            }
            z
        };
        let start = normals(0, 1);
        let mut state: [f64; POLES] = core::array::from_fn(|k| poles[k].variance_e2.sqrt() * f64::from(start[k]));
        let kick: [f64; POLES] =
            core::array::from_fn(|k| (poles[k].variance_e2 * (1.0 - poles[k].keep.powi(2))).sqrt());
        for (row, e) in (0..).zip(rows) {
            let [white, others @ ..] = normals(row, 0);
            let mut sum = self.e_rms * f64::from(white);
            for k in 0..POLES {
                sum += state[k];
                state[k] = poles[k].keep * state[k] + kick[k] * f64::from(others[k]);
            }
            *e = sum as f32;
        }
    }
}

/// One relaxation: its factor from row to row, and its variance.
#[derive(Debug, Clone, Copy)]
struct Pole {
    keep: f64,
    variance_e2: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::random::key;

    #[test]
    fn the_density_is_white_plus_one_over_f() {
        let flicker = |f| {
            let noise = RowNoise { e_rms: 3.0, corner_cycles_per_row: 0.2 };
            (noise.density(f) - 18.0) / (18.0 * 0.2 / f)
        };
        for (least, most, within) in [(5e-5, 0.1, 0.015), (0.1, 0.5, 0.10)] {
            for step in 0..=200 {
                let f = least * f64::powf(most / least, f64::from(step) / 200.0);
                assert!((flicker(f) - 1.0).abs() < within, "{f} cycles per row: {}", flicker(f));
            }
        }
        assert_eq!(RowNoise { e_rms: 3.0, corner_cycles_per_row: 0.0 }.density(0.01), 18.0, "white alone");
    }

    #[test]
    fn a_frame_replays_and_another_is_another_draw() {
        let noise = RowNoise { e_rms: 3.0, corner_cycles_per_row: 0.1 };
        let draw = |frame, seed, rows| {
            let mut e = vec![0.0; rows];
            noise.draw(frame, key(seed), &mut e);
            e
        };
        assert_eq!(draw(4, 5, 100), draw(4, 5, 100));
        assert_eq!(draw(4, 5, 100)[..50], draw(4, 5, 50), "a smaller image has the same rows");
        assert_ne!(draw(4, 5, 100), draw(3, 5, 100));
        assert_ne!(draw(4, 5, 100), draw(4, 6, 100));
    }
}
