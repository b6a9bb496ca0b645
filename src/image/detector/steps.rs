//! The step of each effect that works pixel by pixel, on one block of pixels.

use crate::detector::block::{BLOCK, Words};
use crate::detector::poisson::{BlockPlace, draw_by};
use crate::detector::{dark_current, line_pattern, nonlinearity, read_noise, readout};
use crate::detector::{effect_order::Effect, outliers::Outlier, stages::Stages};

impl Stages<'_> {
    /// Applies the step of one effect to a block of pixels that begins at pixel `first`.
    #[inline(always)]
    pub(super) fn apply<const FUSED: bool>(
        &self,
        effect: Effect,
        first: usize,
        electrons: &mut [f32; BLOCK],
        words: &Words,
        outliers: &[Outlier],
        dn: &mut [u16; BLOCK],
    ) {
        let c = &self.constants;
        match effect {
            Effect::Background => {
                if c.stray_light_e > 0.0 {
                    electrons.iter_mut().for_each(|e| *e += c.stray_light_e);
                }
                if let Some(shape) = &self.background {
                    shape.add(first, electrons);
                }
            }
            Effect::PhotoResponse => {
                if let Some(map) = &self.patterns.prnu {
                    electrons.iter_mut().zip(&map[first..]).for_each(|(e, prnu)| *e += *e * prnu);
                }
                outliers.iter().for_each(|o| electrons[o.pixel as usize - first] *= o.response);
            }
            Effect::Dark => {
                let factors = self.patterns.dark_factor.as_ref().map(|map| &map[first..]);
                dark_current::add::<FUSED>(electrons, c.dark_e, factors);
            }
            Effect::Shot => {
                let place = BlockPlace { first_pixel: first as u32, frame: self.frame, key: self.key };
                draw_by::<FUSED>(self.poisson, electrons, words.shot(), place);
            }
            Effect::Defects => outliers.iter().for_each(|o| electrons[o.pixel as usize - first] += o.dark_e),
            Effect::ProtonTracks => outliers.iter().for_each(|o| electrons[o.pixel as usize - first] += o.charge_e),
            Effect::FullWell => readout::clip(electrons, c.full_well_e),
            Effect::Nonlinearity => {
                if let Some(pieces) = &c.nonlinearity {
                    nonlinearity::bend::<FUSED>(electrons, pieces);
                }
            }
            Effect::LinePattern => {
                if !self.lines.column_gain.is_empty() {
                    self.lines.apply_columns::<FUSED>(electrons, first, self.width);
                }
                if !self.lines.row_e.is_empty() {
                    line_pattern::add_rows(electrons, &self.lines.row_e, first, self.width);
                }
            }
            Effect::Offset => {
                if let Some(map) = &self.patterns.dsnu_e {
                    electrons.iter_mut().zip(&map[first..]).for_each(|(e, offset)| *e += offset);
                }
            }
            Effect::RowNoise => {
                if !self.rows_e.is_empty() {
                    line_pattern::add_rows(electrons, self.rows_e, first, self.width);
                }
            }
            Effect::ReadNoise => {
                if c.read_noise_e > 0.0 {
                    read_noise::add::<FUSED>(electrons, words, c.read_noise_e);
                }
            }
            Effect::Adc => readout::convert::<FUSED>(electrons, c, dn),
            // These run over whole images, elsewhere.
            Effect::ImageLag | Effect::ChargeTransfer | Effect::Binning | Effect::Stuck | Effect::Window => {}
        }
    }
}
