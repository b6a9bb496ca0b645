//! Calibrated parameters of a tracker: geometry, detector figures, spot width, limits.
//!
//! Checked once, by [`TrackerParams::check`], when the guide stars are made. Test: `bad_parameters_are_refused`.

use crate::tracker::geometry::Geometry;
use base::refused::Refused;

/// Detector figures from the tracker's calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectorFigures {
    /// Electrons per digital number.
    pub gain_e_per_dn: f64,
    /// Mean DN without light.
    pub black_level_dn: f64,
    /// Temporal noise without light, electrons rms.
    pub read_noise_e_rms: f64,
    /// DN from which a pixel counts as saturated.
    pub saturation_dn: u16,
}

/// Parameters of a [`super::Tracker`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerParams {
    /// Pixel grid, focal length, principal point, distortion.
    pub geometry: Geometry,
    /// Detector figures.
    pub detector: DetectorFigures,
    /// Pixel response non-uniformity, relative, 1 sigma: part of the error of a bright star's place.
    pub prnu: f64,
    /// Standard deviation of the Gaussian spot before the pixels, px.
    pub psf_sigma_px: f64,
    /// Faintest star the tracker expects to see, Gaia G.
    pub limiting_mag: f64,
    /// Length of an exposure, s: with the rate, the length of a trail.
    pub exposure_s: f64,
    /// Most stars measured in a frame, brightest first.
    pub most_stars: usize,
    /// Fewest stars of an attitude in tracking.
    pub fewest_stars: usize,
    /// How far from its predicted place a star is looked for in tracking, px.
    pub search_radius_px: f64,
    /// Frames without attitude after which tracking gives up.
    pub most_misses: u32,
    /// Bound on the probability that an accepted lost-in-space match is chance, per frame.
    pub false_match_probability: f64,
    /// Error of a place that no figure above explains (spot shape, calibration), px, 1 sigma and per axis.
    pub centroid_floor_px: f64,
    /// Largest accepted chi-square per degree of freedom of an attitude.
    pub most_chi_square_per_dof: f64,
}

impl TrackerParams {
    /// Parameters with the usual limits; every field may be changed afterwards.
    pub fn new(geometry: Geometry, detector: DetectorFigures, psf_sigma_px: f64) -> Self {
        Self {
            geometry,
            detector,
            prnu: 0.01,
            psf_sigma_px,
            limiting_mag: 7.0,
            exposure_s: 0.1,
            most_stars: 60,
            fewest_stars: 4,
            search_radius_px: 8.0,
            most_misses: 3,
            false_match_probability: 1e-6,
            centroid_floor_px: 0.001,
            most_chi_square_per_dof: 6.0,
        }
    }

    /// Returns the standard deviation of the spot with the pixel's own width (variance 1/12 px^2), px.
    pub fn pixel_psf_sigma_px(&self) -> f64 {
        (self.psf_sigma_px * self.psf_sigma_px + 1.0 / 12.0).sqrt()
    }

    /// # Errors
    /// The first parameter that is out of range.
    pub fn check(&self) -> Result<(), Refused> {
        let (g, d) = (&self.geometry, &self.detector);
        let checks = [
            ("width_px", "32..=16384", g.width_px as f64, 32.0, 16384.0),
            ("height_px", "32..=16384", g.height_px as f64, 32.0, 16384.0),
            ("focal_px.x", "10..=1e6", g.focal_px[0], 10.0, 1e6),
            ("focal_px.y", "10..=1e6", g.focal_px[1], 10.0, 1e6),
            ("principal_point_px.x", "within the image", g.principal_point_px[0], 0.0, g.width_px as f64),
            ("principal_point_px.y", "within the image", g.principal_point_px[1], 0.0, g.height_px as f64),
            ("gain_e_per_dn", "1e-3..=1e4", d.gain_e_per_dn, 1e-3, 1e4),
            ("black_level_dn", "0..=saturation_dn", d.black_level_dn, 0.0, f64::from(d.saturation_dn)),
            ("read_noise_e_rms", "0..=1e5", d.read_noise_e_rms, 0.0, 1e5),
            ("prnu", "0..=0.5", self.prnu, 0.0, 0.5),
            ("psf_sigma_px", "0.3..=4", self.psf_sigma_px, 0.3, 4.0),
            ("limiting_mag", "0..=20", self.limiting_mag, 0.0, 20.0),
            ("exposure_s", "0..=100", self.exposure_s, 0.0, 100.0),
            ("most_stars", "4..=1000", self.most_stars as f64, 4.0, 1000.0),
            ("fewest_stars", "3..=most_stars", self.fewest_stars as f64, 3.0, self.most_stars as f64),
            ("search_radius_px", "2..=100", self.search_radius_px, 2.0, 100.0),
            ("false_match_probability", "1e-15..=1e-2", self.false_match_probability, 1e-15, 1e-2),
            ("centroid_floor_px", "0..=1", self.centroid_floor_px, 0.0, 1.0),
            ("most_chi_square_per_dof", "1..=1e6", self.most_chi_square_per_dof, 1.0, 1e6),
        ];
        for (name, wanted, got, low, high) in checks {
            if !(low..=high).contains(&got) {
                return Err(Refused(format!("tracker parameter {name}: wanted {wanted}, got {got}")));
            }
        }
        g.check()
    }
}

/// Why a frame gave no attitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Reason {
    /// The image has other dimensions than the detector.
    #[error("the image is not of the detector's size")]
    ImageSize,
    /// Fewer spots than an identification needs.
    #[error("too few stars")]
    TooFewStars,
    /// No pattern of the catalog fits the spots.
    #[error("no pattern of the catalog fits")]
    NoMatch,
    /// A pattern fits, yet too few stars confirm it to exclude chance.
    #[error("a pattern fits but chance is not excluded")]
    Ambiguous,
    /// Stars match, but not within their errors.
    #[error("the residuals are larger than the stars' errors")]
    ResidualTooLarge,
    /// Most of the image is at the end of the converter's range.
    #[error("the image is saturated")]
    Saturated,
    /// The background leaves too little range for stars, or is too structured to find stars in it.
    #[error("the background is too bright or too uneven")]
    StrayLight,
    /// A tracker outside gave none, and its protocol has no reason.
    #[error("the tracker outside gave no attitude")]
    NotSaid,
}
