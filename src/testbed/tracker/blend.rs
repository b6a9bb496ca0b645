//! A guide star and a neighbour -> how far the neighbour pulls the star's measured place.
//!
//! First order of the weighted least-squares fit of [`super::centroid`] with a star `f` at the origin and a neighbour
//! `g` at distance `d`: `pull = sum(w f' g) / sum(w f'^2)`, `w = 1 / (noise^2 + f)`. A faint star's pull falls off as
//! `d exp(-d^2 / 4 s^2)`; a bright star's fit counts its wings, and is pulled by all that lies in the window. The
//! flux is not known to a tracker, so it is taken from the limiting magnitude: a star there has a ratio of ten. For
//! merged stars the pull is that of the common centre of light, `r / (1 + r)` of the distance for the flux ratio `r`.
//! Test: `a_neighbour_pulls_as_predicted`.

use super::params::TrackerParams;
use core::f64::consts::TAU;

/// Signal-to-noise ratio of a star at the limiting magnitude.
const LIMIT_SIGNAL_TO_NOISE: f64 = 10.0;
/// Points of the sum per pixel.
const POINTS_PER_PX: f64 = 2.0;

/// The spot and noise that decide a pull.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blend {
    sigma_px: f64,
    half_px: f64,
    noise_e: f64,
    limit_e: f64,
    limiting_mag: f64,
}

impl Blend {
    pub(super) fn new(params: &TrackerParams) -> Self {
        let sigma_px = params.pixel_psf_sigma_px();
        let noise_e = params.detector.read_noise_e_rms.max(0.3 * params.detector.gain_e_per_dn);
        // A spot's noise is that of its 4 pi s^2 effective pixels.
        let limit_e = LIMIT_SIGNAL_TO_NOISE * noise_e * (2.0 * TAU).sqrt() * sigma_px;
        let half_px = (3.0 * params.psf_sigma_px + 0.5).ceil() + 0.5;
        Self { sigma_px, half_px, noise_e, limit_e, limiting_mag: params.limiting_mag }
    }

    /// Returns the pull towards a neighbour, px, on a star of magnitude `mag_g` by one `ratio` times as bright.
    pub(super) fn pull_px(&self, mag_g: f64, ratio: f64, distance_px: f64) -> f64 {
        let flux_e = self.limit_e * 10f64.powf(-0.4 * (mag_g - self.limiting_mag));
        let variance = self.sigma_px * self.sigma_px;
        let peak_e = flux_e / (TAU * variance);
        let step = 1.0 / POINTS_PER_PX;
        let (mut moved, mut stiffness) = (0.0, 0.0);
        let mut y = -self.half_px;
        while y <= self.half_px {
            let mut x = -self.half_px;
            while x <= self.half_px {
                let star = peak_e * (-0.5 * (x * x + y * y) / variance).exp();
                let away = x - distance_px;
                let neighbour = ratio * peak_e * (-0.5 * (away * away + y * y) / variance).exp();
                let slope = star * x / variance;
                let weight = 1.0 / (self.noise_e * self.noise_e + star);
                moved += weight * slope * neighbour;
                stiffness += weight * slope * slope;
                x += step;
            }
            y += step;
        }
        moved / stiffness / (1.0 + ratio)
    }
}
