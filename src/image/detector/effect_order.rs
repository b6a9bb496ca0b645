//! The effects, named, in the order in which light becomes numbers, and which of them need more than one pixel. The
//! step of each that works pixel by pixel: `steps`.
//!
//! The effects before the neighbour stages make charge, those after them read it out. When no neighbour stage is on,
//! all runs in one pass, block by block. Random words are counted by (frame, pixel, stage), not by pass: both forms
//! draw the same numbers (`image::detector::cpu`'s tests, `tests/gpu/passes.rs`).
//!
//! [`NeighbourStage`] is the trait of stages that need more than one pixel or an earlier frame.

use base::image::Image;
use core::fmt::Debug;

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

/// Returns the effects of one part, in order.
pub fn effects_of(part: Part) -> &'static [Effect] {
    let start = ORDER.iter().position(|effect| effect.part() == part).unwrap_or(ORDER.len());
    let length = ORDER.iter().filter(|effect| effect.part() == part).count();
    ORDER.get(start..start + length).unwrap_or_default()
}

/// The frame to which the charge belongs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameAt {
    /// Number of the frame: random words are counted by it.
    pub frame: u32,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Key of the seed.
    pub key: [u32; 2],
}

/// One stage.
pub trait NeighbourStage: Debug + Send + Sync {
    /// Returns which effect it is: stages run in the order of [`crate::detector::ORDER`].
    fn effect(&self) -> Effect;

    /// Changes the charge, e- per pixel, and returns the image that the next stage goes on with: the same one, or one
    /// of the stage's own where the size changes.
    fn apply<'a>(&'a mut self, charge: &'a mut Image<f32>, at: &FrameAt) -> &'a mut Image<f32>;

    /// Clears its state from frame to frame.
    fn reset(&mut self) {}
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
