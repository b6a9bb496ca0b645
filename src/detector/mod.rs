//! Electrons -> digital numbers: one file per effect, one ordered list of stages.
//!
//! In: mean electrons per pixel. Out: u16 DN. Random numbers are Philox words keyed by (seed, frame, pixel, stage): any
//! frame, and any pixel of it, can be replayed alone. A stage whose parameter is zero does nothing and costs nothing.
//! Photon and dark shot noise are one Poisson draw: the sum of two Poisson variables is a Poisson variable.

pub mod adc;
pub mod block;
pub mod cpu;
pub mod elementary;
pub mod full_well;
pub mod gpu;
pub mod params;
pub mod pattern;
pub mod poisson;
pub mod read_noise;

pub use cpu::Detector;
pub use params::DetectorParams;
pub use poisson::PoissonMethod;

/// The stages, named.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// Stray light: the same mean electrons more in every pixel, set frame by frame.
    StrayLight,
    /// Photo-response non-uniformity: mean electrons times `1 + prnu`.
    PhotoResponse,
    /// Dark signal: plus `dark_e_per_s * exposure_s`.
    Dark,
    /// Shot noise of light and dark signal together.
    Shot,
    /// Saturation of the pixel.
    FullWell,
    /// Dark-signal non-uniformity: a fixed offset per pixel.
    Offset,
    /// Read noise.
    ReadNoise,
    /// Gain, black level, rounding, clipping.
    Adc,
}

/// The order in which light becomes numbers: the same on every backend.
pub const ORDER: [Effect; 8] = [
    Effect::StrayLight,
    Effect::PhotoResponse,
    Effect::Dark,
    Effect::Shot,
    Effect::FullWell,
    Effect::Offset,
    Effect::ReadNoise,
    Effect::Adc,
];
