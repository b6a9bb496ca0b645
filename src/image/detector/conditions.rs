//! The conditions of a detector in one frame: passed with each exposure, and not kept; and, with its parameters, the
//! numbers of the inner loops.

use crate::{
    detector::DetectorParams, detector::background::Background, detector::nonlinearity::Pieces,
    detector::protons::ProtonFlux,
};
use base::region::Regions;

/// The conditions of one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectorConditions {
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Light besides that of the image: sky, stray light.
    pub background: Background,
    /// Temperature above that of the parameters, K.
    pub warmer_k: f64,
    /// Protons in place of those of the parameters; a flux that [`ProtonFlux::checked`] refuses is none.
    pub protons: Option<ProtonFlux>,
    /// Gain beyond that of the parameters: `DN = e / gain_e_per_dn * gain_factor`, 1 for none. Read and amplifier noise
    /// are given at the input, in e-, and stay what they are: in DN they grow with the gain. Stuck pixels keep their
    /// number.
    pub gain_factor: f64,
    /// Black level in place of that of the parameters, DN.
    pub black_level_dn: Option<f64>,
    /// Parts of the image that are read out, in its pixels; the others are 0. Pixels that are read out have the bits
    /// that they have in the whole image.
    pub regions: Regions,
}

impl DetectorConditions {
    /// Returns an exposure without background, at the temperature and with the protons of the parameters.
    pub const fn dark(exposure_s: f64) -> Self {
        Self::lit(exposure_s, Background::DARK)
    }

    /// Returns the same with background light.
    pub const fn lit(exposure_s: f64, background: Background) -> Self {
        Self {
            exposure_s,
            background,
            warmer_k: 0.0,
            protons: None,
            gain_factor: 1.0,
            black_level_dn: None,
            regions: Regions::WHOLE,
        }
    }

    /// Returns the electrons per digital number and the black level of this exposure.
    pub fn gain_and_black(&self, params: &DetectorParams) -> [f64; 2] {
        [params.gain_e_per_dn / self.gain_factor, self.black_level_dn.unwrap_or(params.black_level_dn)]
    }
}

/// The parameters as the inner loops (and the GPU) want them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constants {
    /// Stray light of one exposure, e-.
    pub stray_light_e: f32,
    /// Dark signal of one exposure, e-.
    pub dark_e: f32,
    /// Saturation capacity, e-.
    pub full_well_e: f32,
    /// Read and amplifier noise, e- rms.
    pub read_noise_e: f32,
    /// Digital numbers per electron.
    pub dn_per_e: f32,
    /// Black level, DN.
    pub black_dn: f32,
    /// Number that is added before the fraction is cut off, DN.
    pub rounding_dn: f32,
    /// Largest digital number.
    pub largest_dn: f32,
    /// Response to charge, where there is one.
    pub nonlinearity: Option<Pieces>,
}

impl Constants {
    /// Returns the numbers of one exposure with so many electrons of background in every pixel.
    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    pub fn new(params: &DetectorParams, conditions: &DetectorConditions, stray_light_e: f32) -> Self {
        let [gain_e_per_dn, black_level_dn] = conditions.gain_and_black(params);
        let dark_e_per_s = params.dark_e_per_s * params.dark_law.warmer_by(conditions.warmer_k).factor();
        Self {
            stray_light_e,
            dark_e: (dark_e_per_s * conditions.exposure_s) as f32,
            full_well_e: params.full_well_e as f32,
            read_noise_e: params.readout_noise_e_rms() as f32,
            dn_per_e: (1.0 / gain_e_per_dn) as f32,
            black_dn: black_level_dn as f32,
            rounding_dn: params.rounding.dn(),
            largest_dn: f32::from(params.largest_dn()),
            nonlinearity: params.nonlinearity.is_on().then(|| params.nonlinearity.pieces()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::binning::{Binning, BinningKind};
    use crate::detector::readout::Levels;
    use crate::detector::{Detector, PoissonMethod, SpatialParams};
    use base::image::{DnImage, Image};

    const SIZE: [usize; 2] = [256, 256];
    const PARAMS: DetectorParams = DetectorParams {
        gain_e_per_dn: 2.0,
        black_level_dn: 100.0,
        read_noise_e_rms: 12.0,
        poisson: PoissonMethod::Auto,
        ..DetectorParams::QUIET
    };

    fn frame(params: DetectorParams, light_e: f32, conditions: &DetectorConditions) -> DnImage {
        let mut detector = Detector::new(params, SIZE[0], SIZE[1], 3);
        let mut light = Image::new(SIZE[0], SIZE[1]);
        light.pixels_mut().fill(light_e);
        let [width, height] = detector.output().geometry().size_px;
        let mut dn = DnImage::new(width, height);
        detector.collect(&light, 1, conditions, &mut dn);
        dn
    }

    fn mean_and_rms(dn: &DnImage) -> [f64; 2] {
        let count = dn.pixels().len() as f64;
        let mean = dn.pixels().iter().map(|dn| f64::from(*dn)).sum::<f64>() / count;
        let variance = dn.pixels().iter().map(|dn| (f64::from(*dn) - mean).powi(2)).sum::<f64>() / count;
        [mean, variance.sqrt()]
    }

    fn set(gain_factor: f64, black_level_dn: Option<f64>) -> DetectorConditions {
        DetectorConditions { gain_factor, black_level_dn, ..DetectorConditions::dark(0.1) }
    }

    #[test]
    fn gain_scales_light_and_noise_and_black_level_is_added() {
        /// Five standard errors of a standard deviation from 65,536 samples.
        const RMS_TOLERANCE: f64 = 5.0 / 362.0;
        let light_e = 900.0_f32;
        let noise_e = (900.0_f64 + 144.0).sqrt();
        for (factor, black) in [(1.0, None), (1.0, Some(40.0)), (4.0, Some(250.0)), (0.5, None)] {
            let [mean, rms] = mean_and_rms(&frame(PARAMS, light_e, &set(factor, black)));
            let (dn_per_e, black) = (factor / 2.0, black.unwrap_or(100.0));
            let mean_tolerance = 5.0 * noise_e * dn_per_e / 256.0;
            assert!((mean - (black + 900.0 * dn_per_e)).abs() < mean_tolerance, "factor {factor}: mean {mean}");
            let expected = (noise_e * dn_per_e).hypot(1.0 / 12.0_f64.sqrt());
            assert!((rms / expected - 1.0).abs() < RMS_TOLERANCE, "factor {factor}: {rms} DN, wanted {expected}");
            let [_, dark_rms] = mean_and_rms(&frame(PARAMS, 0.0, &set(factor, black.into())));
            let expected = (12.0 * dn_per_e).hypot(1.0 / 12.0_f64.sqrt());
            assert!(
                (dark_rms / expected - 1.0).abs() < RMS_TOLERANCE,
                "read noise is 12 e- at any gain: {dark_rms} DN"
            );
        }
    }

    #[test]
    fn settings_equal_to_the_parameters_leave_all_bits_unchanged() {
        let plain = frame(PARAMS, 300.0, &DetectorConditions::dark(0.1));
        assert_eq!(frame(PARAMS, 300.0, &set(1.0, Some(100.0))), plain);
        let other = DetectorParams { gain_e_per_dn: 0.5, black_level_dn: 7.0, ..PARAMS };
        assert_eq!(frame(PARAMS, 300.0, &set(4.0, Some(7.0))), frame(other, 300.0, &set(1.0, None)));
        // Negative controls.
        assert_ne!(frame(PARAMS, 300.0, &set(1.001, None)), plain);
        assert_ne!(frame(PARAMS, 300.0, &set(1.0, Some(101.0))), plain);
    }

    #[test]
    fn levels_of_an_exposure_are_those_of_its_pixels() {
        let binning = |kind| SpatialParams { binning: Some(Binning { factor: 2, kind }), ..SpatialParams::OFF };
        for kind in [BinningKind::Charge { full_well_e: 1e7 }, BinningKind::DigitalSum, BinningKind::DigitalMean] {
            let params = DetectorParams { spatial: binning(kind), ..PARAMS };
            let conditions = set(3.0, Some(60.0));
            let levels = Levels::of_exposure(&params, &conditions);
            let [mean, _] = mean_and_rms(&frame(params, 400.0, &conditions));
            let electrons = (mean - levels.black_level_dn) * levels.gain_e_per_dn;
            // Shot and read noise of the mean of all pixels, and the half DN by which a rounded mean of four is biased.
            let tolerance = 5.0 * 4.0 * (400.0_f64 + 144.0).sqrt() / 256.0 + 0.5 * levels.gain_e_per_dn;
            assert!((electrons - 1600.0).abs() < tolerance, "{kind:?}: {electrons} e-");
            assert_eq!(Levels::of_exposure(&params, &set(1.0, None)), Levels::of_output(&params), "{kind:?}");
            // Negative control: the levels of the parameters do not fit.
            let wrong = Levels::of_output(&params);
            assert!(((mean - wrong.black_level_dn) * wrong.gain_e_per_dn - 1600.0).abs() > tolerance, "{kind:?}");
        }
    }
}
