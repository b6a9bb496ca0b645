//! Dark current: density or rate at a reference temperature -> electrons of one exposure at another temperature.
//!
//! * From a density: `t J A / q` electrons, `J` A/cm^2, `A` the pixel's area (Holst, "CCD Arrays, Cameras and Displays").
//! * Doubling law: `rate(T) = rate(T0) 2^((T - T0)/D)` (EMVA 1288). `D` follows from the activation energy `E`, as
//!   `T^2 k ln 2 / E`: 4.8 K for diffusion (the whole band gap, 1.12 eV) and 9.6 K for generation in the depleted layer
//!   (half of it) at 300 K; [`DOUBLING_K`] lies between. The law holds to a few per cent over 20 K about the reference,
//!   not from room temperature to deep cooling: give the rate at a near temperature.
//! * Non-uniformity: pixel `i` has `1 + n_i` times the mean rate, `n_i` normal, never below zero. It grows with exposure
//!   and temperature as the dark current does; `dsnu_e_rms` is an offset that does not.
//!
//! Tests: below, and `tests/physics/dark_current.rs`.

use crate::detector::block::BLOCK;
use base::fused::mul_add;

/// Charge of an electron, C: exact by the definition of the ampere (SI, 2019).
const ELECTRON_C: f64 = 1.602_176_634e-19;
/// Doubling temperature where none is given, K.
pub const DOUBLING_K: f64 = 7.0;

/// Dependence of the dark current on temperature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DarkLaw {
    /// Temperature at which the rate was given, degrees Celsius.
    pub reference_c: f64,
    /// The detector's temperature, degrees Celsius.
    pub operating_c: f64,
    /// Rise that doubles the rate, K.
    pub doubling_k: f64,
}

impl DarkLaw {
    /// The detector is as warm as when the rate was measured.
    pub const AT_REFERENCE: Self = Self { reference_c: 20.0, operating_c: 20.0, doubling_k: DOUBLING_K };

    /// Returns the law of a detector that is warmer than this one.
    #[must_use]
    pub fn warmer_by(self, warmer_k: f64) -> Self {
        Self { operating_c: self.operating_c + warmer_k, ..self }
    }

    /// Returns the rate over the rate at the reference; exactly 1 there.
    pub fn factor(&self) -> f64 {
        ((self.operating_c - self.reference_c) / self.doubling_k).exp2()
    }

    /// Returns electrons per second of one square pixel from a current density.
    pub fn e_per_s_of_density(na_per_cm2: f64, pixel_pitch_um: f64) -> f64 {
        let area_cm2 = (pixel_pitch_um * 1e-4).powi(2);
        na_per_cm2 * 1e-9 * area_cm2 / ELECTRON_C
    }
}

/// Adds the dark signal: the same to all pixels, or times each pixel's factor.
#[inline(always)]
pub fn add<const FUSED: bool>(electrons: &mut [f32; BLOCK], dark_e: f32, factors: Option<&[f32]>) {
    match factors {
        None => electrons.iter_mut().for_each(|e| *e += dark_e),
        Some(factors) => {
            electrons.iter_mut().zip(factors).for_each(|(e, factor)| *e = mul_add::<FUSED>(dark_e, *factor, *e));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubling_is_doubling() {
        let law = DarkLaw { reference_c: 20.0, operating_c: 27.0, doubling_k: 7.0 };
        assert!((law.factor() - 2.0).abs() < 1e-15);
        assert!((DarkLaw { operating_c: -1.0, ..law }.factor() - 0.125).abs() < 1e-15, "three halvings");
        assert_eq!(DarkLaw::AT_REFERENCE.factor(), 1.0, "exactly: images stay the same");
        assert!((DarkLaw { doubling_k: 8.0, ..law }.factor() - 2.0).abs() > 0.1, "another law is another factor");
    }

    #[test]
    fn density_is_charge_over_the_elementary_charge() {
        // 1 nA/cm^2 is 62.4 e-/s per square micrometre: 1e-9 * 1e-8 / 1.602e-19.
        let e_per_s = DarkLaw::e_per_s_of_density;
        assert!((e_per_s(1.0, 1.0) - 62.415).abs() < 1e-3);
        assert!((e_per_s(0.01, 18.0) / (0.01 * 324.0 * 62.415_09) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_default_lies_between_diffusion_and_depletion() {
        let doubling_k = |energy_ev: f64| 300.0_f64.powi(2) * 8.617_333e-5 * core::f64::consts::LN_2 / energy_ev;
        let [diffusion, depletion] = [doubling_k(1.12), doubling_k(0.56)];
        assert!((diffusion - 4.8).abs() < 0.05 && (depletion - 9.6).abs() < 0.05, "{diffusion} {depletion}");
        assert!((diffusion..depletion).contains(&DOUBLING_K));
    }
}
