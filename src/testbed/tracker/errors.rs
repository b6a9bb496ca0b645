//! Measured and true attitudes -> a tracker's error terms as ECSS-E-ST-60-20C Rev.2 names them, per sensor axis.
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

use super::geometry::Geometry;
use base::axes::{Icrf, Rotation, Sensor};
use glam::DVec3;

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
