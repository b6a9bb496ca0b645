//! The detector on the CPU: every stage over a block of pixels while it is in the first-level cache.

use crate::base::image::{DnImage, Image};
use crate::base::random::{Stage, key};
use crate::detector::block::{BLOCK, Words};
use crate::detector::params::Constants;
use crate::detector::poisson::{BlockPlace, draw_by};
use crate::detector::{DetectorParams, Effect, ORDER, PoissonMethod, adc, full_well, pattern, read_noise};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

/// Blocks one thread takes at a time.
const BLOCKS_PER_TASK: usize = 64;

/// A detector with its fixed patterns.
#[derive(Debug)]
pub struct Detector {
    params: DetectorParams,
    seed: u64,
    stray_light_e: f32,
    prnu: Option<Vec<f32>>,
    dsnu_e: Option<Vec<f32>>,
    arch: Arch,
}

/// Everything the stages of one frame read.
struct Exposure<'a> {
    constants: Constants,
    key: [u32; 2],
    frame: u32,
    poisson: PoissonMethod,
    prnu: Option<&'a [f32]>,
    dsnu_e: Option<&'a [f32]>,
}

impl Detector {
    /// A detector of this size; `seed` fixes its patterns and its noise.
    #[must_use]
    pub fn new(params: DetectorParams, width_px: usize, height_px: usize, seed: u64) -> Self {
        let pixels = width_px * height_px;
        Self {
            params,
            seed,
            stray_light_e: 0.0,
            prnu: pattern::normal_map(pixels, params.prnu, seed, Stage::Prnu),
            dsnu_e: pattern::normal_map(pixels, params.dsnu_e_rms, seed, Stage::Dsnu),
            arch: Arch::new(),
        }
    }

    /// Parameters.
    #[must_use]
    pub fn params(&self) -> &DetectorParams {
        &self.params
    }

    /// Stray light of the frames from here on: mean electrons more in every pixel.
    pub fn set_stray_light_e(&mut self, stray_light_e: f32) {
        self.stray_light_e = stray_light_e;
    }

    /// Seed.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Fixed patterns: PRNU (share) and DSNU (e-), where switched on.
    #[must_use]
    pub fn patterns(&self) -> (Option<&[f32]>, Option<&[f32]>) {
        (self.prnu.as_deref(), self.dsnu_e.as_deref())
    }

    /// Reads `mean` electrons out as frame `frame`.
    pub fn collect(&self, mean: &Image<f32>, frame: u32, exposure_s: f64, out: &mut DnImage) {
        self.collect_from(mean.pixels(), frame, exposure_s, out, |source, block| {
            block[..source.len()].copy_from_slice(source);
        });
    }

    /// The same from an image in double precision.
    pub fn collect_precise(&self, mean: &Image<f64>, frame: u32, exposure_s: f64, out: &mut DnImage) {
        self.collect_from(mean.pixels(), frame, exposure_s, out, |source, block| {
            for (e, mean) in block.iter_mut().zip(source) {
                *e = *mean as f32;
            }
        });
    }

    fn collect_from<T: Copy + Sync>(
        &self,
        mean: &[T],
        frame: u32,
        exposure_s: f64,
        out: &mut DnImage,
        load: impl Fn(&[T], &mut [f32; BLOCK]) + Sync + Copy,
    ) {
        let exposure = Exposure {
            constants: Constants::new(&self.params, exposure_s, self.stray_light_e),
            key: key(self.seed),
            frame,
            poisson: self.params.poisson,
            prnu: self.prnu.as_deref(),
            dsnu_e: self.dsnu_e.as_deref(),
        };
        let task = BLOCK * BLOCKS_PER_TASK;
        let arch = self.arch;
        out.pixels_mut().par_chunks_mut(task).zip(mean.par_chunks(task)).enumerate().for_each(|(i, (out, mean))| {
            let fused = !matches!(arch, Arch::Scalar);
            arch.dispatch(ReadOut { exposure: &exposure, first: i * task, mean, out, load, fused });
        });
    }
}

/// One task's work, in the shape `pulp` compiles once per vector level.
struct ReadOut<'a, T, L> {
    exposure: &'a Exposure<'a>,
    first: usize,
    mean: &'a [T],
    out: &'a mut [u16],
    load: L,
    fused: bool,
}

impl<T: Copy, L: Fn(&[T], &mut [f32; BLOCK])> NullaryFnOnce for ReadOut<'_, T, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { exposure, first, mean, out, load, fused } = self;
        if fused {
            exposure.read_out::<true, T>(first, mean, out, load);
        } else {
            exposure.read_out::<false, T>(first, mean, out, load);
        }
    }
}

impl Exposure<'_> {
    #[inline(always)]
    fn read_out<const FUSED: bool, T: Copy>(
        &self,
        first: usize,
        mean: &[T],
        out: &mut [u16],
        load: impl Fn(&[T], &mut [f32; BLOCK]),
    ) {
        let mut electrons = [0.0_f32; BLOCK];
        let mut dn = [0_u16; BLOCK];
        let mut words = Words::new();
        for (b, (mean, out)) in mean.chunks(BLOCK).zip(out.chunks_mut(BLOCK)).enumerate() {
            let first = first + b * BLOCK;
            load(mean, &mut electrons);
            words.draw(first as u32, self.frame, self.key);
            for effect in ORDER {
                self.apply::<FUSED>(effect, first, &mut electrons, &words, &mut dn);
            }
            out.copy_from_slice(&dn[..out.len()]);
        }
    }

    #[inline(always)]
    fn apply<const FUSED: bool>(
        &self,
        effect: Effect,
        first: usize,
        electrons: &mut [f32; BLOCK],
        words: &Words,
        dn: &mut [u16; BLOCK],
    ) {
        let c = &self.constants;
        match effect {
            Effect::StrayLight if c.stray_light_e > 0.0 => electrons.iter_mut().for_each(|e| *e += c.stray_light_e),
            Effect::StrayLight => {}
            Effect::PhotoResponse => {
                if let Some(map) = self.prnu {
                    electrons.iter_mut().zip(&map[first..]).for_each(|(e, prnu)| *e += *e * prnu);
                }
            }
            Effect::Dark => electrons.iter_mut().for_each(|e| *e += c.dark_e),
            Effect::Shot => {
                let place = BlockPlace { first_pixel: first as u32, frame: self.frame, key: self.key };
                draw_by::<FUSED>(self.poisson, electrons, &words.shot, place);
            }
            Effect::FullWell => full_well::clip(electrons, c.full_well_e),
            Effect::Offset => {
                if let Some(map) = self.dsnu_e {
                    electrons.iter_mut().zip(&map[first..]).for_each(|(e, offset)| *e += offset);
                }
            }
            Effect::ReadNoise if c.read_noise_e > 0.0 => read_noise::add::<FUSED>(electrons, words, c.read_noise_e),
            Effect::ReadNoise => {}
            Effect::Adc => adc::convert::<FUSED>(electrons, c, dn),
        }
    }
}
