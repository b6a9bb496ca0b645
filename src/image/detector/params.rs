//! Detector parameters in the terms of EMVA 1288 and ECSS.
//!
//! [`SpatialParams`] has those of the effects that depend on the pixel's place, on its neighbours or on the frame
//! before.

use crate::detector::protons::{ProtonFlux, SensitiveLayer};
use crate::detector::window::{OutputGeometry, Window};
use crate::detector::{
    binning::Binning, binning::BinningKind, blooming::Blooming, charge_transfer::ChargeTransfer, dark_current::DarkLaw,
    defects::DefectPopulation, image_lag::ImageLag, line_pattern::LinePattern, nonlinearity::Nonlinearity,
    pattern::ColourFilter, poisson::PoissonMethod, read_noise::RowNoise, tdi::Tdi,
};
use base::bayer::BayerPattern;

/// One detector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectorParams {
    /// Saturation capacity, e-.
    pub full_well_e: f64,
    /// Electrons per digital number (the reciprocal of EMVA's K).
    pub gain_e_per_dn: f64,
    /// Bits of the ADC, 1 to 16.
    pub bits: u32,
    /// Digital number of zero electrons.
    pub black_level_dn: f64,
    /// Temporal noise of the readout, e- rms.
    pub read_noise_e_rms: f64,
    /// Noise of the amplifiers after the pixel, e- rms; in quadrature with the read noise.
    pub amplifier_noise_e_rms: f64,
    /// Mean dark current at the reference temperature of `dark_law`, e-/s.
    pub dark_e_per_s: f64,
    /// Law by which the dark current follows the detector's temperature.
    pub dark_law: DarkLaw,
    /// Dark-current non-uniformity, rms share of the mean: grows with exposure and temperature.
    pub dark_nonuniformity: f64,
    /// Photo-response non-uniformity, rms share.
    pub prnu: f64,
    /// Dark-signal non-uniformity, e- rms: an offset that does not depend on exposure or temperature.
    pub dsnu_e_rms: f64,
    /// Response to charge.
    pub nonlinearity: Nonlinearity,
    /// Fixed patterns of columns and rows.
    pub line_pattern: LinePattern,
    /// Noise that a row shares.
    pub row_noise: RowNoise,
    /// Rounding of the ADC.
    pub rounding: Rounding,
    /// Method of drawing shot noise; a GPU supports [`PoissonMethod::Auto`] only.
    pub poisson: PoissonMethod,
    /// Defects, protons, and the effects of more than one pixel or one frame.
    pub spatial: SpatialParams,
}

impl DetectorParams {
    /// Shot noise alone, one electron per number, 16 bits: every other effect is off. For `..` in literals.
    pub const QUIET: Self = Self {
        full_well_e: 1e7,
        gain_e_per_dn: 1.0,
        bits: 16,
        black_level_dn: 0.0,
        read_noise_e_rms: 0.0,
        amplifier_noise_e_rms: 0.0,
        dark_e_per_s: 0.0,
        dark_law: DarkLaw::AT_REFERENCE,
        dark_nonuniformity: 0.0,
        prnu: 0.0,
        dsnu_e_rms: 0.0,
        nonlinearity: Nonlinearity::OFF,
        line_pattern: LinePattern::OFF,
        row_noise: RowNoise::OFF,
        rounding: Rounding::Nearest,
        poisson: PoissonMethod::Auto,
        spatial: SpatialParams::OFF,
    };

    /// Returns the largest digital number.
    pub fn largest_dn(&self) -> u16 {
        u16::try_from((1_u32 << self.bits.min(16)) - 1).unwrap_or(u16::MAX)
    }

    /// Returns electrons at which the converter clips.
    pub fn converter_full_e(&self) -> f64 {
        (f64::from(self.largest_dn()) - self.black_level_dn) * self.gain_e_per_dn
    }

    /// Returns the same, when that is below the full well.
    pub fn converter_clips_at_e(&self) -> Option<f64> {
        Some(self.converter_full_e()).filter(|e| *e < self.full_well_e)
    }

    /// Returns electrons of one LSB of a converter that ends where the pixel does: `full well / 2^bits`.
    pub fn lsb_e(full_well_e: f64, bits: u32) -> f64 {
        full_well_e / f64::from(1_u32 << bits.min(16))
    }

    /// Returns the mean dark current at the detector's temperature, e-/s.
    pub fn operating_dark_e_per_s(&self) -> f64 {
        self.dark_e_per_s * self.dark_law.factor()
    }

    /// Returns the noise of a pixel's readout from frame to frame, that which its row shares included, e- rms.
    pub fn temporal_noise_e_rms(&self) -> f64 {
        let row_e2 = if self.row_noise.is_on() { self.row_noise.variance_e2() } else { 0.0 };
        self.readout_noise_e_rms().hypot(row_e2.sqrt())
    }

    /// Returns the white noise of a pixel's readout: read and amplifier noise, e- rms.
    pub fn readout_noise_e_rms(&self) -> f64 {
        if self.amplifier_noise_e_rms == 0.0 {
            return self.read_noise_e_rms;
        }
        self.read_noise_e_rms.hypot(self.amplifier_noise_e_rms)
    }
}

/// Rounding of digital numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Rounding {
    /// The nearest.
    #[default]
    Nearest,
    /// The next below.
    Truncate,
}

impl Rounding {
    /// Returns the number that is added before the fraction is cut off, DN.
    pub const fn dn(self) -> f32 {
        match self {
            Self::Nearest => 0.5,
            Self::Truncate => 0.0,
        }
    }
}

/// Spatial effects that are on; `None`: off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialParams {
    /// Filters before the pixels.
    pub colour_filter: Option<ColourFilter>,
    /// Random defects from the seed.
    pub defects: DefectPopulation,
    /// Layer in which protons leave charge.
    pub layer: SensitiveLayer,
    /// Protons from the first frame on.
    pub protons: Option<ProtonFlux>,
    /// Charge that stays in the pixel.
    pub image_lag: Option<ImageLag>,
    /// Charge above the full well spills; without it the excess is lost.
    pub blooming: Option<Blooming>,
    /// Charge that transfers leave behind.
    pub charge_transfer: Option<ChargeTransfer>,
    /// Squares of pixels become one.
    pub binning: Option<Binning>,
    /// The window that is cut out for the output.
    pub window: Option<Window>,
    /// Time-delayed integration.
    pub tdi: Option<Tdi>,
}

impl SpatialParams {
    /// None of it.
    pub const OFF: Self = Self {
        colour_filter: None,
        defects: DefectPopulation::NONE,
        layer: SensitiveLayer::TYPICAL,
        protons: None,
        image_lag: None,
        blooming: None,
        charge_transfer: None,
        binning: None,
        window: None,
        tdi: None,
    };

    /// Returns the number of images of the whole sensor that its stages keep beside the drawn one.
    pub fn images_kept(&self) -> usize {
        let charge_binning = matches!(self.binning, Some(Binning { kind: BinningKind::Charge { .. }, .. }));
        let stages = [self.image_lag.is_some(), self.charge_transfer.is_some(), charge_binning];
        let stages = stages.into_iter().filter(|is_on| *is_on).count();
        let charge = usize::from(stages > 0 || self.blooming.is_some());
        // The converter's image, if it is not the output itself.
        let converter = usize::from(self.binning.is_some() || self.window.is_some());
        stages + charge + converter
    }

    /// Returns the colours of the output image, from its first pixel; `None` where its pixels have none: without
    /// filters, and where binning adds colours up.
    pub fn output_colours(&self) -> Option<BayerPattern> {
        let first_px = self.window.map_or([0; 2], |window| [window.left_px, window.top_px]);
        let filter = self.colour_filter.filter(|_| self.binning.is_none())?;
        Some(filter.pattern.from_pixel(first_px))
    }

    /// Returns the mapping from the pixels of a sensor to those of the output image.
    pub fn output(&self, sensor_px: [usize; 2]) -> OutputGeometry {
        OutputGeometry::new(sensor_px, self.binning.map_or(1, |binning| binning.factor), self.window)
    }
}
