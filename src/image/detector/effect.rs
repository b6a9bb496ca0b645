//! The effects, named, in the order in which light becomes numbers, the step of each that works pixel by pixel, and
//! which of them need more than one pixel.
//!
//! The effects before the neighbour stages make charge, those after them read it out. When no neighbour stage is on,
//! all runs in one pass, block by block. Random words are counted by (frame, pixel, stage), not by pass: both forms
//! draw the same numbers (`image::detector::cpu`'s tests, `tests/gpu/passes.rs`).

use crate::detector::block::{BLOCK, Words};
use crate::detector::outliers::Outlier;
use crate::detector::poisson::{BlockPlace, draw_by};
use crate::detector::stages::Stages;
use crate::detector::{adc, dark_current, full_well, line_pattern, nonlinearity, read_noise};

/// The stages, named.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// Stray light and background: mean electrons more in every pixel.
    Background,
    /// Photo-response non-uniformity and colour filter: mean electrons times `response (1 + prnu)`.
    PhotoResponse,
    /// Dark signal: plus dark current times exposure.
    Dark,
    /// Pixels with a dark signal or a response of their own.
    Defects,
    /// Shot noise of light and dark signal together.
    Shot,
    /// Charge that particles leave.
    ProtonTracks,
    /// Charge that an earlier frame left.
    ImageLag,
    /// Saturation of the pixel; excess charge is lost, or blooms.
    FullWell,
    /// Charge that a transfer leaves behind.
    ChargeTransfer,
    /// Sums of pixels, and of stages of time-delayed integration.
    Binning,
    /// Response of the output to charge.
    Nonlinearity,
    /// Gain and offset of every column, offset of every row: fixed patterns.
    LinePattern,
    /// Dark-signal non-uniformity: a fixed offset per pixel.
    Offset,
    /// Noise that a row shares.
    RowNoise,
    /// Read noise and amplifier noise.
    ReadNoise,
    /// Gain, black level, rounding, clipping.
    Adc,
    /// Pixels, columns and rows whose number never changes.
    Stuck,
    /// The window that is cut out for the output.
    Window,
}

/// The order in which light becomes numbers: the same on every backend.
pub const ORDER: [Effect; 18] = [
    Effect::Background,
    Effect::PhotoResponse,
    Effect::Dark,
    Effect::Defects,
    Effect::Shot,
    Effect::ProtonTracks,
    Effect::ImageLag,
    Effect::FullWell,
    Effect::ChargeTransfer,
    Effect::Binning,
    Effect::Nonlinearity,
    Effect::LinePattern,
    Effect::Offset,
    Effect::RowNoise,
    Effect::ReadNoise,
    Effect::Adc,
    Effect::Stuck,
    Effect::Window,
];

/// The three parts of [`ORDER`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// Light and dark signal -> counted electrons, pixel by pixel.
    Charge,
    /// Electrons -> electrons, from pixel to pixel or from frame to frame.
    Neighbours,
    /// Electrons -> digital numbers, pixel by pixel.
    Readout,
}

impl Effect {
    /// Returns the part of the chain that it belongs to.
    #[must_use]
    pub const fn part(self) -> Part {
        match self {
            Self::Background | Self::PhotoResponse | Self::Dark | Self::Defects | Self::Shot | Self::ProtonTracks => {
                Part::Charge
            }
            Self::ImageLag | Self::FullWell | Self::ChargeTransfer | Self::Binning => Part::Neighbours,
            Self::Nonlinearity
            | Self::LinePattern
            | Self::Offset
            | Self::RowNoise
            | Self::ReadNoise
            | Self::Adc
            | Self::Stuck
            | Self::Window => Part::Readout,
        }
    }
}

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
            Effect::FullWell => full_well::clip(electrons, c.full_well_e),
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
            Effect::Adc => adc::convert::<FUSED>(electrons, c, dn),
            // These run over whole images, elsewhere.
            Effect::ImageLag | Effect::ChargeTransfer | Effect::Binning | Effect::Stuck | Effect::Window => {}
        }
    }
}

/// Returns the effects of one part, in order.
#[must_use]
pub fn effects_of(part: Part) -> &'static [Effect] {
    let start = ORDER.iter().position(|effect| effect.part() == part).unwrap_or(ORDER.len());
    let length = ORDER.iter().filter(|effect| effect.part() == part).count();
    ORDER.get(start..start + length).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_follow_one_another_and_hold_all_effects() {
        assert!(ORDER.is_sorted_by_key(|effect| effect.part()), "charge, neighbours, readout");
        let parts = [Part::Charge, Part::Neighbours, Part::Readout].map(effects_of);
        assert_eq!(parts.concat(), ORDER);
        assert_eq!(parts[0].last(), Some(&Effect::ProtonTracks));
        assert_eq!(parts[2].first(), Some(&Effect::Nonlinearity));
    }
}
