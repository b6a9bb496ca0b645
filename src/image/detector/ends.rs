//! The inputs and outputs of the passes over blocks: mean electrons or charge in, charge or digital numbers out.

use crate::detector::stages::Ends;
use core::marker::PhantomData;

/// A mean electron image's pixel.
pub(super) trait Mean: Copy + Sync {
    /// Returns the value in single precision.
    fn single(self) -> f32;
}

impl Mean for f32 {
    #[inline(always)]
    fn single(self) -> f32 {
        self
    }
}

impl Mean for f64 {
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    fn single(self) -> f32 {
        self as f32
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
