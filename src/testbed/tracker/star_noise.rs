//! The stars that a field offers -> the temporal noise of an attitude there, without pixels: the method "stars" of the
//! statistical tracker.
//!
//! * Place of a star: the weighted least-squares fit of a Gaussian spot whose pixels have shot noise, a background's
//!   noise and, in the weights only, the pattern of responses. Its variance is that of the normal equations in polar
//!   coordinates about the spot. Without the pattern it is the bound of Cramér and Rao for a spot on a detector (Winick,
//!   J. Opt. Soc. Am. A 3 (1986), 1809): `s^2 / F` of a bright star, `8 pi s^4 b / F^2` of a faint one.
//! * Attitude: the covariance of weighted least squares over all stars (Shuster and Oh, J. Guidance and Control 4
//!   (1981), 70), with the slopes of the places as the camera has them.
//!
//! * Errors that are the same in each frame (the pattern of responses, the floor of places) have the same weights and a
//!   variance of their own, which does not fall with the light of a star: spatial errors follow the field by it.
//!
//! Domain: spots of 0.6 px and wider (below, the phase of the pixel decides), nothing else in the window, at rest; light
//! of sky, streaks and bodies is left out. Saturated pixels count as a
//! disc that is left out. Stars below five standard deviations of their flux do not count. Bound: a place's standard
//! deviation within 5 % of that of `gaussian_fit`, an attitude's within 20 % of the built-in tracker's own estimate.
//! Tests: `tests/star_noise.rs`, on both sides of the edge.
//!
//! Beside the prediction, the terms of measured errors: measured and true attitudes -> terms as ECSS-E-ST-60-20C Rev.2 names them, per sensor axis.
//!
//! The series is a row of **stations**: runs of samples with one true attitude (to a hundredth of a pixel). With `m`
//! samples each, and the mean error `e_i` of station `i`:
//!
//! * bias: the mean of all `e_i`;
//! * noise equivalent angle (temporal noise): the pooled standard deviation within stations, `m - 1` degrees of freedom
//!   each;
//! * FOV spatial error (slow over the field): what neighbouring stations share, the covariance of `e_i` and `e_i+1`
//!   about the bias; noise of different stations does not enter it;
//! * pixel spatial error (of the sub-pixel position): what is left of the variance of `e_i` after the FOV spatial error
//!   and the noise of a mean of `m` samples.
//!
//! Assumptions: neighbouring stations are some pixels apart, by no whole number of pixels, and close against the field.
//! Without repeats at stations, noise and pixel spatial error cannot be separated: the first then contains both, and
//! the second is `None`. Variances that come out negative are zero. Tests: `terms_are_distinguished`,
//! `noise_agrees_with_prediction`.

use crate::tracker::guide::{Expected, GuideStars};
use crate::{tracker::geometry::Geometry, tracker::params::TrackerParams};
use base::axes::{Icrf, Rotation, Sensor, attitude_of_uniforms};
use core::f64::consts::{PI, TAU};
use glam::{DMat3, DVec2, DVec3};
use std::sync::Arc;

/// Least flux of a star that counts, in its standard deviations, as in tracking.
const LEAST_FLUX_SIGMA: f64 = 5.0;
/// Points of the integral over a spot.
const POINTS: usize = 96;
/// Attitudes over which the mean is taken, spread evenly.
const SKY_ATTITUDES: u32 = 1000;
/// Least determinant of a covariance in units of its diagonal: below it an axis is as good as free.
const LEAST_DETERMINANT: f64 = 1e-9;

/// Light of stars and background in one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExposedLight {
    /// Electrons of a star of magnitude 0.
    pub zero_magnitude_e: f64,
    /// Noise of a pixel without stars, electrons rms.
    pub background_sigma_e: f64,
    /// Mean light of a pixel without stars beyond the usual, electrons: it takes of the full well.
    pub background_e: f64,
}

/// Weight and variance of a star's place, per axis.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    weight_px2: f64,
    variance_px2: f64,
    /// Variance over detectors of what is the same in each frame.
    spatial_px2: f64,
}

/// Noise of an attitude, in units of the mean over the sky.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldNoise {
    /// Turns three independent numbers of variance 1 into the noise about x, y and z, in units of the root mean square
    /// over the sky.
    pub factor: DMat3,
    /// The same for errors that are the same in each frame.
    pub spatial: DMat3,
    /// Stars.
    pub stars: usize,
}

/// Noise of a tracker by the stars that it sees.
#[derive(Debug, Clone)]
pub struct StarNoise {
    guide: Arc<GuideStars>,
    geometry: Geometry,
    most_stars: usize,
    fewest_stars: usize,
    spot: SpotLight,
    light: ExposedLight,
    /// Of the guide stars that are bright enough.
    places: Vec<Place>,
    /// The root mean square over the sky, about x, y and z, rad.
    pub sky_sigma_rad: DVec3,
    sky_spatial_rad: DVec3,
    expected: Vec<Expected>,
}

/// Covariances of an attitude, rad^2.
struct Covariances {
    noise: DMat3,
    spatial: DMat3,
    stars: usize,
}

impl StarNoise {
    /// Makes the noise of a tracker with these parameters.
    pub fn new(params: &TrackerParams, guide: Arc<GuideStars>, light: &ExposedLight) -> Self {
        let spot = SpotLight::new(params, light);
        let mut noise = Self {
            guide,
            geometry: params.geometry,
            most_stars: params.most_stars,
            fewest_stars: params.fewest_stars,
            spot,
            light: *light,
            places: Vec::new(),
            sky_sigma_rad: DVec3::ONE,
            sky_spatial_rad: DVec3::ONE,
            expected: Vec::with_capacity(params.most_stars),
        };
        noise.find_places();
        let attitudes = (0..SKY_ATTITUDES).map(spread_attitude);
        let seen: Vec<Covariances> = attitudes.filter_map(|attitude| noise.covariances(&attitude)).collect();
        let rms = |of: fn(&Covariances) -> &DMat3| {
            let sum: DVec3 = seen.iter().map(|seen| diagonal(of(seen))).sum();
            (sum / seen.len() as f64).map(f64::sqrt)
        };
        if !seen.is_empty() {
            noise.sky_sigma_rad = rms(|seen| &seen.noise);
            noise.sky_spatial_rad = rms(|seen| &seen.spatial);
        }
        noise
    }

    /// Changes the light: fainter stars, a brighter background. The root mean square over the sky stays that of the light
    /// before, in which noise is given.
    pub fn expose(&mut self, light: &ExposedLight) {
        if *light != self.light {
            self.light = *light;
            self.find_places();
        }
    }

    /// Finds the stars that are bright enough, and the noise of their places.
    fn find_places(&mut self) {
        let Self { guide, spot, light, places, .. } = self;
        let spot = spot.under(light);
        places.clear();
        if spot.saturation_e <= 0.0 {
            return;
        }
        let fluxes_e = guide.stars.iter().map(|star| light.zero_magnitude_e * 10_f64.powf(-0.4 * star.mag_g));
        let least_e = spot.least_flux_e();
        places.extend(fluxes_e.take_while(|flux_e| *flux_e > least_e).map(|flux_e| spot.place(flux_e)));
    }

    /// Returns the noise at an attitude; `None` where too few stars are.
    pub fn at(&mut self, attitude: &Rotation<Sensor, Icrf>) -> Option<FieldNoise> {
        let Covariances { noise, spatial, stars } = self.covariances(attitude)?;
        let root = |covariance_rad2: DMat3, sky_rad: DVec3| {
            let scale = DMat3::from_diagonal(sky_rad.recip());
            lower_root(&(scale * covariance_rad2 * scale))
        };
        // A detector without a pattern has no errors that follow it.
        let spatial = root(spatial, self.sky_spatial_rad).unwrap_or(DMat3::IDENTITY);
        Some(FieldNoise { factor: root(noise, self.sky_sigma_rad)?, spatial, stars })
    }

    /// Returns the covariance of an attitude's noise, rad^2, and the number of its stars.
    pub fn covariance_rad2(&mut self, attitude: &Rotation<Sensor, Icrf>) -> Option<(DMat3, usize)> {
        self.covariances(attitude).map(|Covariances { noise, stars, .. }| (noise, stars))
    }

    fn covariances(&mut self, attitude: &Rotation<Sensor, Icrf>) -> Option<Covariances> {
        // Aberration shifts all stars by less than a pixel: it decides nothing here.
        let (most, geometry) = (self.most_stars, &self.geometry);
        self.guide.in_field(self.places.len(), most, attitude, DVec3::ZERO, geometry, &mut self.expected);
        if self.expected.len() < self.fewest_stars {
            return None;
        }
        let (mut information, mut noise, mut spatial) = (DMat3::ZERO, DMat3::ZERO, DMat3::ZERO);
        for expected in &self.expected {
            let Some((_, turn)) = geometry.pixel_and_turn(attitude.apply(expected.apparent_icrf)) else { continue };
            let Place { weight_px2, variance_px2, spatial_px2 } = self.places[expected.star];
            let slopes = squares(turn) * weight_px2;
            information += slopes;
            noise += slopes * (weight_px2 * variance_px2);
            spatial += slopes * (weight_px2 * spatial_px2);
        }
        let size = diagonal(&information);
        if information.determinant() < LEAST_DETERMINANT * size.x * size.y * size.z {
            return None;
        }
        let inverse = information.inverse();
        let [noise, spatial] = [noise, spatial].map(|sum| inverse * sum * inverse);
        Some(Covariances { noise, spatial, stars: self.expected.len() })
    }
}

fn squares(turn: [DVec2; 3]) -> DMat3 {
    let row = |a: DVec2| DVec3::new(a.dot(turn[0]), a.dot(turn[1]), a.dot(turn[2]));
    DMat3::from_cols(row(turn[0]), row(turn[1]), row(turn[2]))
}

fn diagonal(matrix: &DMat3) -> DVec3 {
    DVec3::new(matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z)
}

/// Returns the lower triangular root of a positive matrix (Cholesky).
fn lower_root(matrix: &DMat3) -> Option<DMat3> {
    let (x, y, z) = (matrix.x_axis, matrix.y_axis, matrix.z_axis);
    let xx = x.x.sqrt();
    let (yx, zx) = (x.y / xx, x.z / xx);
    let yy = (y.y - yx * yx).sqrt();
    let zy = (y.z - zx * yx) / yy;
    let zz = (z.z - zx * zx - zy * zy).sqrt();
    let root = DMat3::from_cols(DVec3::new(xx, yx, zx), DVec3::new(0.0, yy, zy), DVec3::new(0.0, 0.0, zz));
    root.is_finite().then_some(root)
}

/// Returns one of a row of attitudes that fill all attitudes evenly, from Halton's sequence (Numer. Math. 2 (1960), 84).
fn spread_attitude(number: u32) -> Rotation<Sensor, Icrf> {
    attitude_of_uniforms([2, 3, 5].map(|base| radical_inverse(number + 1, base)))
}

/// Returns the digits of a number in a base, mirrored at the point.
fn radical_inverse(mut number: u32, base: u32) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0);
    while number > 0 {
        digit /= f64::from(base);
        value += f64::from(number % base) * digit;
        number /= base;
    }
    value
}

/// Spot, background and detector, which decide the noise of a place besides the star's flux.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SpotLight {
    variance_px2: f64,
    background_e2: f64,
    prnu: f64,
    /// Electrons of a pixel that is full.
    full_e: f64,
    /// Those that a star may add.
    saturation_e: f64,
    floor_px2: f64,
    /// Edge of the window, in units of `r^2 / (2 s^2)`.
    edge: f64,
}

impl SpotLight {
    fn new(params: &TrackerParams, light: &ExposedLight) -> Self {
        let variance_px2 = params.pixel_psf_sigma_px().powi(2);
        let d = &params.detector;
        let half_px = (3.0 * params.psf_sigma_px + 0.5).ceil() + 0.5;
        Self {
            variance_px2,
            background_e2: light.background_sigma_e.powi(2),
            prnu: params.prnu,
            full_e: (f64::from(d.saturation_dn) - d.black_level_dn) * d.gain_e_per_dn,
            saturation_e: 0.0,
            floor_px2: params.centroid_floor_px.powi(2),
            edge: 0.5 * half_px * half_px / variance_px2,
        }
        .under(light)
    }

    /// Returns the same spot in other light.
    fn under(&self, light: &ExposedLight) -> Self {
        let (background_e2, saturation_e) = (light.background_sigma_e.powi(2), self.full_e - light.background_e);
        Self { background_e2, saturation_e, ..*self }
    }

    /// Returns the flux of a star that just counts: `F^2 = n^2 (F + 4 pi s^2 b)`, for the effective area of the spot.
    fn least_flux_e(&self) -> f64 {
        let half = 0.5 * LEAST_FLUX_SIGMA * LEAST_FLUX_SIGMA;
        let background_e2 = 4.0 * PI * self.variance_px2 * self.background_e2;
        half + (half * half + 2.0 * half * background_e2).sqrt()
    }

    /// Returns weight and variance of the place of a star of `flux_e`.
    ///
    /// With `u = r^2 / (2 s^2)` and the peak `p`, a pixel has the mean `m = p exp(-u)`; the mean square of the slope
    /// over a ring is `m^2 r^2 / (2 s^4)`, and a ring's area `2 pi s^2 du`: sums over pixels are integrals
    /// `2 pi m^2 u du` over the variance. Midpoint rule.
    fn place(&self, flux_e: f64) -> Place {
        let peak_e = flux_e / (TAU * self.variance_px2);
        let from = (peak_e / self.saturation_e).ln().clamp(0.0, self.edge);
        let step = (self.edge - from) / POINTS as f64;
        let (mut stiffness, mut noise, mut spatial) = (0.0, 0.0, 0.0);
        for point in 0..POINTS {
            let u = from + (point as f64 + 0.5) * step;
            let mean_e = peak_e * (-u).exp();
            let variance_e2 = mean_e + self.background_e2;
            let pattern_e2 = (self.prnu * mean_e).powi(2);
            let assumed_e2 = variance_e2 + pattern_e2;
            let slope = 2.0 * PI * mean_e * mean_e * u * step / assumed_e2;
            stiffness += slope;
            noise += slope * variance_e2 / assumed_e2;
            spatial += slope * pattern_e2 / assumed_e2;
        }
        // Nothing is left of a spot that saturates its window.
        let stiffness = stiffness.max(f64::MIN_POSITIVE);
        Place {
            weight_px2: 1.0 / (1.0 / stiffness + self.floor_px2),
            variance_px2: noise / stiffness / stiffness,
            spatial_px2: spatial / stiffness / stiffness + self.floor_px2,
        }
    }
}

#[cfg(test)]
impl StarNoise {
    /// Returns the standard deviation of the place of a star of `flux_e`, px.
    pub(super) fn place_sigma_px(params: &TrackerParams, light: &ExposedLight, flux_e: f64) -> f64 {
        SpotLight::new(params, light).place(flux_e).variance_px2.sqrt()
    }
}

/// Two true attitudes closer than this are one station, px.
const ONE_STATION_PX: f64 = 0.01;
/// Fewest stations that define a spatial error.
const FEWEST_STATIONS: usize = 3;

/// One measured attitude and the true one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudePair {
    /// The attitude measured by the tracker.
    pub measured: Rotation<Sensor, Icrf>,
    /// The true attitude.
    pub truth: Rotation<Sensor, Icrf>,
}

/// The error terms, rad, 1 sigma, about the sensor's X, Y and Z axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorTerms {
    /// Mean error.
    pub bias_rad: DVec3,
    /// Noise equivalent angle.
    pub nea_rad: DVec3,
    /// Slow over the field.
    pub fov_spatial_rad: DVec3,
    /// Of the sub-pixel position; `None` when no station has repeats.
    pub pixel_spatial_rad: Option<DVec3>,
    /// Stations of the series.
    pub stations: usize,
    /// Samples of the series.
    pub samples: usize,
}

struct Station {
    mean: DVec3,
    /// Sum of squares about the mean.
    scatter: DVec3,
    samples: f64,
}

/// Returns the error terms of a series in order of time; `None` with fewer than three stations.
pub fn error_terms(series: &[AttitudePair], geometry: &Geometry) -> Option<ErrorTerms> {
    let reach_rad = ONE_STATION_PX * geometry.ifov_rad();
    let same = |a: &AttitudePair, b: &AttitudePair| a.truth.rotation_vector_to(&b.truth).length() <= reach_rad;
    let stations: Vec<_> = series.chunk_by(same).map(station).collect();
    if stations.len() < FEWEST_STATIONS {
        return None;
    }
    let count = stations.len() as f64;
    let bias_rad = stations.iter().map(|s| s.mean).sum::<DVec3>() / count;
    let spread = stations.iter().map(|s| square(s.mean - bias_rad)).sum::<DVec3>() / (count - 1.0);
    let shared = stations.windows(2).map(|two| (two[0].mean - bias_rad) * (two[1].mean - bias_rad));
    let fov = (shared.sum::<DVec3>() / (count - 1.0)).max(DVec3::ZERO);
    let freedom = series.len() as f64 - count;
    let rest = (spread - fov).max(DVec3::ZERO);
    let (noise, pixel_spatial_rad) = if freedom > 0.0 {
        let noise = stations.iter().map(|s| s.scatter).sum::<DVec3>() / freedom;
        let mean_inverse = stations.iter().map(|s| 1.0 / s.samples).sum::<f64>() / count;
        (noise, Some(root((rest - noise * mean_inverse).max(DVec3::ZERO))))
    } else {
        (rest, None)
    };
    let (nea_rad, fov_spatial_rad) = (root(noise), root(fov));
    Some(ErrorTerms {
        bias_rad,
        nea_rad,
        fov_spatial_rad,
        pixel_spatial_rad,
        stations: stations.len(),
        samples: series.len(),
    })
}

/// Returns the noise equivalent angle, rad about X, Y and Z, of `stars` stars spread evenly over the field, each with
/// the place's error `sigma_px` per axis: `sigma ifov / sqrt(N)` across, and about the boresight the same over the
/// stars' root mean square distance from it in tangent coordinates (Liebe, "Accuracy performance of star trackers: a
/// tutorial", IEEE Trans. AES 38 (2002), 587, with a uniform rectangle in place of his mean distance).
pub fn predicted_nea_rad(geometry: &Geometry, stars: u32, sigma_px: f64) -> DVec3 {
    let across_rad = sigma_px * geometry.ifov_rad() / f64::from(stars).sqrt();
    let width = geometry.width_px as f64 / geometry.focal_px[0];
    let height = geometry.height_px as f64 / geometry.focal_px[1];
    let distance = ((width * width + height * height) / 12.0).sqrt();
    DVec3::new(across_rad, across_rad, across_rad / distance)
}

fn station(samples: &[AttitudePair]) -> Station {
    let count = samples.len() as f64;
    let error = |pair: &AttitudePair| pair.truth.rotation_vector_to(&pair.measured);
    let mean = samples.iter().map(error).sum::<DVec3>() / count;
    let scatter = samples.iter().map(|pair| square(error(pair) - mean)).sum();
    Station { mean, scatter, samples: count }
}

fn root(variance: DVec3) -> DVec3 {
    DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt())
}

fn square(v: DVec3) -> DVec3 {
    v * v
}
