//! The end of the readout: saturation, quantisation, and the scale of the numbers.
//!
//! *Saturation.* No pixel holds more than its full well (the excess is lost; `blooming` lets it spill instead).
//!
//! *Quantisation.* `DN = floor(e / gain + black level + 1/2)`, clipped to `0 ..= 2^bits - 1`.
//!
//! Rounding is usual: the black level then is the mean DN of a dark pixel. A converter that truncates leaves out the
//! half, and its numbers are half a DN lower in the mean. Quantisation noise 1/12 DN^2 either way (EMVA 1288, section
//! 2.5). A converter matched to the pixel has `gain = full well / 2^bits` (one LSB).
//!
//! *Levels.* The scale of an output image's numbers: after gain, black level and binning.

use crate::detector::binning::{Binning, BinningKind};
use crate::detector::{DetectorConditions, DetectorParams};
use crate::detector::{block::BLOCK, conditions::Constants};
use base::fused::{mul_add, whole_bits};

/// Returns the saturation capacity as the inner loops want it, e-.
#[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
pub fn limit_e(params: &DetectorParams) -> f32 {
    params.full_well_e as f32
}

/// Clips every pixel at `full_well_e`.
#[inline(always)]
pub fn clip(electrons: &mut [f32], full_well_e: f32) {
    for e in electrons {
        *e = e.min(full_well_e);
    }
}

/// Converts a block.
#[inline(always)]
pub fn convert<const FUSED: bool>(electrons: &[f32; BLOCK], constants: &Constants, out: &mut [u16; BLOCK]) {
    for (dn, e) in out.iter_mut().zip(electrons) {
        let x = mul_add::<FUSED>(*e, constants.dn_per_e, constants.black_dn + constants.rounding_dn).floor();
        #[allow(clippy::cast_possible_truncation, reason = "the low 16 bits are wanted: 0..=65535 by the clamp")]
        let value = whole_bits(x.max(0.0).min(constants.largest_dn)) as u16;
        *dn = value;
    }
}

/// Scale of the numbers of the output image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Levels {
    /// Electrons, of all pixels that became one, per digital number.
    pub gain_e_per_dn: f64,
    /// Digital number of no electrons.
    pub black_level_dn: f64,
    /// Read noise of one output pixel, e- rms.
    pub read_noise_e_rms: f64,
    /// Electrons at which one output pixel saturates, spread evenly.
    pub full_well_e: f64,
    /// Largest digital number.
    pub largest_dn: f64,
    /// Pixels that became one.
    pub pixels: f64,
    /// Temperature of the detector, degrees Celsius.
    pub temperature_c: f64,
}

impl Levels {
    /// Returns those of this detector's output, at the gain and black level of its parameters.
    pub fn of_output(params: &DetectorParams) -> Self {
        Self::of_exposure(params, &DetectorConditions::dark(0.0))
    }

    /// Returns those of one exposure, at its own gain and black level.
    pub fn of_exposure(params: &DetectorParams, conditions: &DetectorConditions) -> Self {
        let [gain_e_per_dn, black_level_dn] = conditions.gain_and_black(params);
        let pixel = Self {
            gain_e_per_dn,
            black_level_dn,
            read_noise_e_rms: params.readout_noise_e_rms(),
            full_well_e: params.full_well_e,
            largest_dn: f64::from(params.largest_dn()),
            pixels: 1.0,
            temperature_c: params.dark_law.operating_c + conditions.warmer_k,
        };
        params.spatial.binning.map_or(pixel, |binning| pixel.binned(binning))
    }

    /// Returns these levels after binning.
    #[must_use]
    pub fn binned(self, binning: Binning) -> Self {
        let pixels = f64::from(binning.factor * binning.factor);
        let all_wells_e = pixels * self.full_well_e;
        // Every pixel is read: noises add in quadrature.
        let read_noise_e_rms = self.read_noise_e_rms * pixels.sqrt();
        match binning.kind {
            BinningKind::Charge { full_well_e } => Self { full_well_e: full_well_e.min(all_wells_e), pixels, ..self },
            BinningKind::DigitalSum => Self {
                black_level_dn: self.black_level_dn * pixels,
                read_noise_e_rms,
                full_well_e: all_wells_e,
                largest_dn: (self.largest_dn * pixels).min(f64::from(u16::MAX)),
                pixels,
                ..self
            },
            BinningKind::DigitalMean => Self {
                gain_e_per_dn: self.gain_e_per_dn * pixels,
                read_noise_e_rms,
                full_well_e: all_wells_e,
                pixels,
                ..self
            },
        }
    }
}
