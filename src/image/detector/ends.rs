//! The inputs and outputs of the passes over blocks: mean electrons or charge in, charge or digital numbers out.

use crate::detector::stages::Ends;
use core::marker::PhantomData;

/// A mean electron image's pixel.
pub(super) trait Mean: Copy + Sync {
    /// Returns the value in single precision.
    fn single(self) -> f32;
}

/// Numbers nearer to zero count as none, e-: below it products with patterns and gains would be denormal numbers, which
/// are slow; no digital number depends on so little.
const LEAST_E: f32 = 1e-30;

impl Mean for f32 {
    #[inline(always)]
    fn single(self) -> f32 {
        if self.abs() < LEAST_E { 0.0 } else { self }
    }
}

impl Mean for f64 {
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    fn single(self) -> f32 {
        if self.abs() < f64::from(LEAST_E) { 0.0 } else { self as f32 }
    }
}

/// Mean electrons -> digital numbers: all stages.
#[derive(Debug, Clone, Copy)]
pub(super) struct MeanToDn<T>(pub(super) PhantomData<T>);

/// Mean electrons -> charge.
#[derive(Debug, Clone, Copy)]
pub(super) struct MeanToCharge<T>(pub(super) PhantomData<T>);

/// Charge -> digital numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChargeToDn;

#[inline(always)]
fn load<T: Mean>(from: &[T], electrons: &mut [f32]) {
    for (e, mean) in electrons.iter_mut().zip(from) {
        *e = mean.single();
    }
}

impl<T: Mean> Ends for MeanToDn<T> {
    type In = T;
    type Out = u16;
    #[inline(always)]
    fn load(from: &[T], electrons: &mut [f32]) {
        load(from, electrons);
    }
    #[inline(always)]
    fn store(_: &[f32], dn: &[u16], to: &mut [u16]) {
        to.copy_from_slice(&dn[..to.len()]);
    }
}

impl<T: Mean> Ends for MeanToCharge<T> {
    type In = T;
    type Out = f32;
    #[inline(always)]
    fn load(from: &[T], electrons: &mut [f32]) {
        load(from, electrons);
    }
    #[inline(always)]
    fn store(electrons: &[f32], _: &[u16], to: &mut [f32]) {
        to.copy_from_slice(&electrons[..to.len()]);
    }
}

impl Ends for ChargeToDn {
    type In = f32;
    type Out = u16;
    #[inline(always)]
    fn load(from: &[f32], electrons: &mut [f32]) {
        load(from, electrons);
    }
    #[inline(always)]
    fn store(_: &[f32], dn: &[u16], to: &mut [u16]) {
        to.copy_from_slice(&dn[..to.len()]);
    }
}

#[cfg(test)]
mod tests {
    use crate::detector::{Detector, DetectorConditions, DetectorParams, PoissonMethod};
    use base::image::{DnImage, Image};

    const SIZE: [usize; 2] = [301, 20];

    #[test]
    fn means_too_small_to_count_are_read_as_darkness() {
        let noisy = DetectorParams {
            prnu: 0.01,
            dsnu_e_rms: 2.0,
            read_noise_e_rms: 3.0,
            black_level_dn: 100.0,
            ..DetectorParams::QUIET
        };
        for params in PoissonMethod::ALL.map(|poisson| DetectorParams { poisson, ..noisy }) {
            let read = |mean_e: f64, keeps_charge: bool| {
                let mut detector = Detector::new(params, SIZE[0], SIZE[1], 3);
                if keeps_charge {
                    detector.keep_charge();
                }
                let (mut mean, mut dn) = (Image::<f64>::new(SIZE[0], SIZE[1]), DnImage::new(SIZE[0], SIZE[1]));
                mean.pixels_mut().fill(mean_e);
                detector.collect_precise(&mean, 1, &DetectorConditions::dark(0.1), &mut dn);
                dn
            };
            let dark = read(0.0, false);
            for mean_e in [1e-9, 1e-20, 1e-30, 1e-35, 1e-40, 1e-300, -1e-40] {
                assert_eq!(read(mean_e, false), dark, "{mean_e} e-, {}", params.poisson);
                assert_eq!(read(mean_e, true), dark, "{mean_e} e-, two passes, {}", params.poisson);
            }
            assert_ne!(read(0.1, false), dark, "control");
        }
    }
}
