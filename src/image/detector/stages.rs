//! The pixel-local stages over blocks of pixels while they are in the first-level cache, compiled once per vector
//! level.
//!
//! One pass may run all of [`ORDER`](crate::detector::ORDER), or the stages before or after the neighbours alone; over
//! all pixels, or over those of some regions, with the same bits.
//!
//! [`Ends`] are the inputs and outputs of a pass: mean electrons or charge in, charge or digital numbers out.

use crate::detector::block::{BLOCK, Words};
use crate::detector::{Effect, PoissonMethod};
use crate::detector::{
    background::Shape, conditions::Constants, line_pattern::Lines, outliers::Outliers, pattern::Patterns,
};
use base::region::Regions;
use core::marker::PhantomData;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

/// Blocks one thread takes at a time.
const BLOCKS_PER_TASK: usize = 64;
/// Rows of regions that one thread takes at a time.
const ROWS_PER_TASK: usize = 32;

/// Everything the stages of one frame read.
pub(super) struct Stages<'a> {
    pub(super) constants: Constants,
    /// The part of the background that differs from pixel to pixel.
    pub(super) background: Option<Shape<'a>>,
    pub(super) key: [u32; 2],
    pub(super) frame: u32,
    pub(super) poisson: PoissonMethod,
    pub(super) patterns: &'a Patterns,
    pub(super) lines: &'a Lines,
    /// Noise of the rows, e-; empty when off.
    pub(super) rows_e: &'a [f32],
    /// Columns of the image.
    pub(super) width: usize,
    pub(super) outliers: &'a Outliers,
}

/// Input and output of a pass over blocks.
pub(super) trait Ends: Copy + Sync {
    /// Pixel of the input.
    type In: Copy + Sync;
    /// Pixel of the output.
    type Out: Send;
    /// Loads the electrons of as many pixels from the input.
    fn load(from: &[Self::In], electrons: &mut [f32]);
    /// Stores electrons and digital numbers in the output, which may have fewer pixels.
    fn store(electrons: &[f32], dn: &[u16], to: &mut [Self::Out]);
}

impl Stages<'_> {
    /// Runs `effects` over all pixels, on all threads.
    pub(super) fn run<E: Ends>(&self, _: E, arch: Arch, effects: &[Effect], from: &[E::In], to: &mut [E::Out]) {
        let task = BLOCK * BLOCKS_PER_TASK;
        to.par_chunks_mut(task).zip(from.par_chunks(task)).enumerate().for_each(|(i, (to, from))| {
            let fused = !matches!(arch, Arch::Scalar);
            arch.dispatch(Task::<E> { stages: self, effects, first: i * task, from, to, fused });
        });
    }

    /// Runs `effects` over the pixels of `regions`, on all threads; the others are left as they are.
    pub(super) fn run_in<E: Ends>(
        &self,
        regions: &Regions,
        ends: E,
        arch: Arch,
        effects: &[Effect],
        from: &[E::In],
        to: &mut [E::Out],
    ) {
        if regions.is_whole() {
            return self.run(ends, arch, effects, from, to);
        }
        let task = ROWS_PER_TASK * self.width.max(1);
        to.par_chunks_mut(task).zip(from.par_chunks(task)).enumerate().for_each(|(i, (to, from))| {
            let first_row = i * ROWS_PER_TASK;
            if regions.show_rows(&(first_row..first_row + ROWS_PER_TASK)) {
                let fused = !matches!(arch, Arch::Scalar);
                arch.dispatch(RowsTask::<E> { stages: self, regions, effects, first_row, from, to, fused });
            }
        });
    }

    #[inline(always)]
    pub(super) fn run_task<const FUSED: bool, E: Ends>(
        &self,
        effects: &[Effect],
        first: usize,
        from: &[E::In],
        to: &mut [E::Out],
    ) {
        let mut electrons = [0.0_f32; BLOCK];
        let mut dn = [0_u16; BLOCK];
        let mut words = Words::new();
        for (b, (from, to)) in from.chunks(BLOCK).zip(to.chunks_mut(BLOCK)).enumerate() {
            let first = first + b * BLOCK;
            E::load(from, &mut electrons);
            words.draw(first as u32, self.frame, self.key);
            let outliers = self.outliers.within(first, BLOCK);
            for effect in effects {
                self.apply::<FUSED>(*effect, first, &mut electrons, &words, outliers, &mut dn);
            }
            E::store(&electrons, &dn, to);
        }
    }

    /// Runs the stages over the pixels of regions, in blocks that begin with a run of them. Whatever a stage does to a
    /// pixel depends on the pixel's number alone, and not on its place in a block: the bits are those of
    /// [`Self::run_task`].
    #[inline(always)]
    fn run_rows<const FUSED: bool, E: Ends>(
        &self,
        regions: &Regions,
        effects: &[Effect],
        first_row: usize,
        from: &[E::In],
        to: &mut [E::Out],
    ) {
        let mut electrons = [0.0_f32; BLOCK];
        let mut dn = [0_u16; BLOCK];
        let mut words = Words::new();
        let rows = from.chunks(self.width).zip(to.chunks_mut(self.width));
        for (row, (from, to)) in (first_row..).zip(rows) {
            for run in regions.runs(row, self.width) {
                let mut column = run.start;
                while column < run.end {
                    let pixel = row * self.width + column;
                    // Random words are drawn for pairs of pixels.
                    let lead = pixel % 2;
                    let (first, end) = (pixel - lead, run.end.min(column + BLOCK - lead));
                    let count = end - column;
                    E::load(&from[column..end], &mut electrons[lead..]);
                    electrons[lead + count..].fill(0.0);
                    words.draw(first as u32, self.frame, self.key);
                    let outliers = self.outliers.within(first, BLOCK);
                    for effect in effects {
                        self.apply::<FUSED>(*effect, first, &mut electrons, &words, outliers, &mut dn);
                    }
                    E::store(&electrons[lead..], &dn[lead..], &mut to[column..end]);
                    column = end;
                }
            }
        }
    }
}

/// One task's work, in the shape `pulp` compiles once per vector level.
struct Task<'a, E: Ends> {
    stages: &'a Stages<'a>,
    effects: &'a [Effect],
    first: usize,
    from: &'a [E::In],
    to: &'a mut [E::Out],
    fused: bool,
}

/// One task's work on the pixels of regions, in the same shape.
struct RowsTask<'a, E: Ends> {
    stages: &'a Stages<'a>,
    regions: &'a Regions,
    effects: &'a [Effect],
    first_row: usize,
    from: &'a [E::In],
    to: &'a mut [E::Out],
    fused: bool,
}

impl<E: Ends> NullaryFnOnce for RowsTask<'_, E> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { stages, regions, effects, first_row, from, to, fused } = self;
        if fused {
            stages.run_rows::<true, E>(regions, effects, first_row, from, to);
        } else {
            stages.run_rows::<false, E>(regions, effects, first_row, from, to);
        }
    }
}

impl<E: Ends> NullaryFnOnce for Task<'_, E> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { stages, effects, first, from, to, fused } = self;
        if fused {
            stages.run_task::<true, E>(effects, first, from, to);
        } else {
            stages.run_task::<false, E>(effects, first, from, to);
        }
    }
}

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
