//! Pixels about a rough place -> a star's place, flux and their covariance.
//!
//! Two named methods: [`centre_of_gravity`] with an iterated Gaussian window (SExtractor's "windowed positions", Bertin
//! 2010), and [`gaussian_fit`], weighted least squares of a pixel-integrated Gaussian spot, drawn out along the trail
//! of the exposure (equal-weight points on a straight line). The fit is unbiased over the pixel phase, when the spot's
//! width is right, and its covariance is the inverse of its normal matrix; it is the tracker's method. The weights
//! follow the model, not the data: pixels that happen to be bright must not count less. Saturated pixels are left out.
//! Tests: `fit_has_no_pixel_phase_error`, `centre_of_gravity_has_its_known_pixel_phase_error`,
//! `fit_covariance_is_true`.
//!
//! How far a neighbour pulls a guide star's measured place ([`Blend`]) is the first order of the weighted least-squares fit with a star `f` at the origin and a neighbour
//! `g` at distance `d`: `pull = sum(w f' g) / sum(w f'^2)`, `w = 1 / (noise^2 + f)`. A faint star's pull falls off as
//! `d exp(-d^2 / 4 s^2)`; a bright star's fit counts its wings, and is pulled by all that lies in the window. The
//! flux is not known to a tracker, so it is taken from the limiting magnitude: a star there has a ratio of ten. For
//! merged stars the pull is that of the common centre of light, `r / (1 + r)` of the distance for the flux ratio `r`.
//! Test: `a_neighbour_pulls_as_predicted`.

use crate::tracker::params::TrackerParams;
use base::image::DnImage;
use core::f64::consts::{FRAC_1_SQRT_2, PI, TAU};
use glam::DVec2;

/// Widest window, px: spots of sigma 4 px, or trails of 12 px.
const WIDEST: usize = 25;
/// Most points that represent a trail.
const MOST_TRAIL_POINTS: usize = 16;
/// Distance of a trail's points in spot widths: the aliasing of a Gaussian sampled so is exp(-2 pi^2 / 1.5^2) = 2e-4.
const TRAIL_STEP_SIGMA: f64 = 1.5;
/// Gauss-Newton steps; from half a pixel away four reach 1e-4 px.
const FIT_STEPS: usize = 8;
/// Where the fit stops, px: what is left is this times the relative noise, a hundredth of the star's own error.
const FIT_STOP_PX: f64 = 2e-3;
/// Largest step of the fit, px: beyond it the linear model means nothing.
const LONGEST_STEP_PX: f64 = 0.7;
/// Furthest a fit may end from where it began, px, besides half its trail.
const FURTHEST_PX: f64 = 2.5;
/// Steps of the windowed centre of gravity.
const GRAVITY_STEPS: usize = 12;

/// Shape of the spot of a star, and the noise of its pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SpotModel {
    /// Standard deviation of the Gaussian spot before the pixels, px.
    pub(super) psf_sigma_px: f64,
    /// From the start to the end of the exposure's trail, px.
    pub(super) trail_px: DVec2,
    /// Electrons per DN.
    pub(super) gain_e_per_dn: f64,
    /// Background, DN.
    pub(super) background_dn: f64,
    /// Noise of one background pixel, electrons.
    pub(super) background_sigma_e: f64,
    /// Pixel response non-uniformity, relative.
    pub(super) prnu: f64,
    /// DN from which a pixel is saturated.
    pub(super) saturation_dn: u16,
}

/// A measured star image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Place, px.
    pub place_px: DVec2,
    /// Covariance of the place: xx, xy, yy, px^2.
    pub covariance_px2: [f64; 3],
    /// Flux, electrons.
    pub flux_e: f64,
    /// Standard deviation of the flux, electrons.
    pub flux_sigma_e: f64,
    /// Whether pixels were left out because they are saturated.
    pub saturated: bool,
}

impl Spot {
    /// Returns the standard deviation of the place per axis, px (root mean square of both axes).
    pub fn sigma_px(&self) -> f64 {
        (0.5 * (self.covariance_px2[0] + self.covariance_px2[2])).sqrt()
    }
}

impl SpotModel {
    /// Returns the half-width of the window that holds the spot, px.
    pub(super) fn half_px(&self) -> usize {
        let reach = 3.0 * self.psf_sigma_px + 0.5 + 0.5 * self.trail_px.abs().max_element();
        to_index(reach.ceil()).clamp(2, WIDEST / 2)
    }

    fn trail_points(&self) -> usize {
        let points = self.trail_px.length() / (TRAIL_STEP_SIGMA * self.psf_sigma_px);
        to_index(points.ceil()).clamp(1, MOST_TRAIL_POINTS)
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates; callers clamp")]
fn to_index(value: f64) -> usize {
    value as usize
}

/// A square window of the image.
struct Window<'a> {
    image: &'a DnImage,
    left: usize,
    top: usize,
    width: usize,
}

impl<'a> Window<'a> {
    /// Returns the window about a place; `None` when it leaves the image.
    fn about(image: &'a DnImage, place_px: DVec2, half_px: usize) -> Option<Self> {
        let half = half_px as f64;
        let corner = place_px.round() - half;
        let last = place_px.round() + half;
        let inside =
            corner.x >= 0.0 && corner.y >= 0.0 && last.x < image.width() as f64 && last.y < image.height() as f64;
        inside.then(|| Self { image, left: to_index(corner.x), top: to_index(corner.y), width: 2 * half_px + 1 })
    }

    fn line(&self, row: usize) -> &'a [u16] {
        let start = (self.top + row) * self.image.width() + self.left;
        &self.image.pixels()[start..start + self.width]
    }
}

/// Returns the windowed centre of gravity about `start_px`: the window is the spot's own Gaussian, widened by the
/// trail. `None` when the window leaves the image or the iteration does not settle.
pub(super) fn centre_of_gravity(image: &DnImage, start_px: DVec2, model: &SpotModel) -> Option<DVec2> {
    let window = Window::about(image, start_px, model.half_px())?;
    let variance = model.psf_sigma_px.powi(2) + 1.0 / 12.0 + model.trail_px.length_squared() / 12.0;
    let mut place = start_px;
    for _ in 0..GRAVITY_STEPS {
        let (mut sum, mut first) = (0.0, DVec2::ZERO);
        for row in 0..window.width {
            for (column, dn) in window.line(row).iter().enumerate() {
                let offset = DVec2::new((window.left + column) as f64, (window.top + row) as f64) - place;
                let weight = (-0.5 * offset.length_squared() / variance).exp();
                let light = weight * (f64::from(*dn) - model.background_dn);
                sum += light;
                first += light * offset;
            }
        }
        // A Gaussian seen through its own window shows half of its displacement.
        let step = 2.0 * first / sum;
        if sum.is_nan() || sum <= 0.0 || step.length() > 2.0 * window.width as f64 {
            return None;
        }
        place += step;
        if step.length_squared() < FIT_STOP_PX * FIT_STOP_PX {
            break;
        }
    }
    (place.distance(start_px) <= model.half_px() as f64).then_some(place)
}

/// Pixel integrals of the spot and their derivatives along one axis, for one point of the trail.
#[derive(Clone, Copy)]
struct Profile {
    light: [f64; WIDEST],
    slope: [f64; WIDEST],
}

impl Profile {
    const DARK: Self = Self { light: [0.0; WIDEST], slope: [0.0; WIDEST] };

    /// Integrals of a Gaussian at `place` (in window pixels) over the pixels `0..width`.
    fn fill(&mut self, place: f64, sigma: f64, width: usize) {
        let scale = FRAC_1_SQRT_2 / sigma;
        let peak = scale / PI.sqrt();
        let edge = |pixel: usize| {
            let u = (pixel as f64 - 0.5 - place) * scale;
            (0.5 * libm::erf(u), peak * (-u * u).exp())
        };
        let mut before = edge(0);
        for pixel in 0..width {
            let after = edge(pixel + 1);
            self.light[pixel] = after.0 - before.0;
            self.slope[pixel] = before.1 - after.1;
            before = after;
        }
    }
}

/// The normal equations of place and flux: unknowns are dx, dy (px) and the relative flux.
#[derive(Default)]
struct Normal {
    matrix: [f64; 6],
    right: [f64; 3],
    saturated: bool,
}

/// Returns the weighted least-squares fit of place and flux, from `start_px`. `None` when the window leaves the image,
/// the fit runs away or no light is there.
pub(super) fn gaussian_fit(image: &DnImage, start_px: DVec2, model: &SpotModel) -> Option<Spot> {
    let window = Window::about(image, start_px, model.half_px())?;
    let mut place = start_px;
    let mut flux_e = rough_flux_e(&window, model);
    let mut across = [Profile::DARK; MOST_TRAIL_POINTS];
    let mut down = [Profile::DARK; MOST_TRAIL_POINTS];
    let points = model.trail_points();
    let furthest_px = FURTHEST_PX + 0.5 * model.trail_px.length();
    for step in 0..FIT_STEPS {
        if flux_e.is_nan() || flux_e <= 0.0 {
            return None;
        }
        fill_profiles(&window, model, place, &mut across[..points], &mut down[..points]);
        let normal = normal_equations(&window, model, flux_e, &across[..points], &down[..points]);
        let inverse = inverse3(&normal.matrix)?;
        let d = times3(&inverse, &normal.right);
        let shift = DVec2::new(d[0], d[1]);
        place += shift.clamp_length_max(LONGEST_STEP_PX);
        flux_e += d[2];
        if place.is_nan() || place.distance(start_px) > furthest_px {
            return None;
        }
        if shift.length() < FIT_STOP_PX || step + 1 == FIT_STEPS {
            let [xx, xy, _, yy, _, ff] = inverse;
            let settled = shift.length() < 0.05;
            return (settled && flux_e > 0.0).then(|| Spot {
                place_px: place,
                covariance_px2: [xx, xy, yy],
                flux_e,
                flux_sigma_e: ff.sqrt(),
                saturated: normal.saturated,
            });
        }
    }
    None
}

fn rough_flux_e(window: &Window<'_>, model: &SpotModel) -> f64 {
    let sum: u32 = (0..window.width).flat_map(|row| window.line(row)).map(|dn| u32::from(*dn)).sum();
    let pixels = (window.width * window.width) as f64;
    // Noise may bring the sum to nothing; the fit then starts from a spot of one sigma.
    ((f64::from(sum) - pixels * model.background_dn) * model.gain_e_per_dn).max(model.background_sigma_e)
}

fn fill_profiles(
    window: &Window<'_>,
    model: &SpotModel,
    place_px: DVec2,
    across: &mut [Profile],
    down: &mut [Profile],
) {
    let local = place_px - DVec2::new(window.left as f64, window.top as f64);
    let points = across.len() as f64;
    for (point, (x, y)) in across.iter_mut().zip(down).enumerate() {
        let along = (point as f64 + 0.5) / points - 0.5;
        let centre = local + along * model.trail_px;
        x.fill(centre.x, model.psf_sigma_px, window.width);
        y.fill(centre.y, model.psf_sigma_px, window.width);
    }
}

fn normal_equations(
    window: &Window<'_>,
    model: &SpotModel,
    flux_e: f64,
    across: &[Profile],
    down: &[Profile],
) -> Normal {
    let share = 1.0 / across.len() as f64;
    let background_variance = model.background_sigma_e.powi(2);
    let mut normal = Normal::default();
    for row in 0..window.width {
        for (column, dn) in window.line(row).iter().enumerate() {
            if *dn >= model.saturation_dn {
                normal.saturated = true;
                continue;
            }
            let (mut light, mut slope_x, mut slope_y) = (0.0, 0.0, 0.0);
            for (x, y) in across.iter().zip(down) {
                light += x.light[column] * y.light[row];
                slope_x += x.slope[column] * y.light[row];
                slope_y += x.light[column] * y.slope[row];
            }
            let mean_e = flux_e * light * share;
            let variance = background_variance + mean_e + (model.prnu * mean_e).powi(2);
            let residual = (f64::from(*dn) - model.background_dn) * model.gain_e_per_dn - mean_e;
            normal.add([flux_e * slope_x * share, flux_e * slope_y * share, light * share], residual, 1.0 / variance);
        }
    }
    normal
}

impl Normal {
    fn add(&mut self, slope: [f64; 3], residual: f64, weight: f64) {
        let [a, b, c] = slope;
        let products = [a * a, a * b, a * c, b * b, b * c, c * c];
        for (sum, product) in self.matrix.iter_mut().zip(products) {
            *sum += weight * product;
        }
        for (sum, s) in self.right.iter_mut().zip(slope) {
            *sum += weight * s * residual;
        }
    }
}

/// Returns the inverse of a symmetric positive 3 x 3 matrix given as xx, xy, xz, yy, yz, zz, in the same order.
fn inverse3(m: &[f64; 6]) -> Option<[f64; 6]> {
    let [xx, xy, xz, yy, yz, zz] = *m;
    let (a, b, c) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
    let determinant = xx * a + xy * b + xz * c;
    if determinant.is_nan() || determinant <= 0.0 {
        return None;
    }
    let (d, e, f) = (xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy);
    Some([a, b, c, d, e, f].map(|cofactor| cofactor / determinant))
}

fn times3(m: &[f64; 6], v: &[f64; 3]) -> [f64; 3] {
    let [xx, xy, xz, yy, yz, zz] = *m;
    let [x, y, z] = *v;
    [xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z]
}

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
