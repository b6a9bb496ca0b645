//! Star images for the tests, drawn afresh: own projection, aberration, space motion, error function, noise.

use super::super::{DetectorFigures, Geometry, TrackerParams};
use base::axes::{Icrf, Rotation, Sensor};
use base::source::{direction_from_ra_dec, ra_dec_rad};
use base::{image::DnImage, time::Tai, units::MAS};
use core::f64::consts::TAU;
use glam::{DVec2, DVec3};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use stars::catalog::Catalog;

/// Numbers in the noise pool: drawing a Gaussian for every pixel of every frame would take most of the tests' time.
const POOL: usize = 1 << 20;
/// Half-width of a star's stamp, px: 6 sigma of the widest spot here.
const STAMP_PX: i64 = 6;
/// Width of a stamp, px.
const STAMP_WIDTH: usize = 13;

/// A camera as it is; the tracker knows only `params`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Camera {
    pub(super) params: TrackerParams,
    /// Electrons of a star of G = 0 in one exposure.
    pub(super) zero_magnitude_e: f64,
    pub(super) dark_e: f64,
    pub(super) dsnu_e_rms: f64,
    pub(super) prnu: f64,
    /// Points in time an exposure is made of.
    pub(super) steps: usize,
}

impl Camera {
    /// Returns the camera of 1024 x 1024, 20 degrees: configs/cameras/star_tracker_20deg.toml.
    pub(super) fn wide() -> Self {
        let detector =
            DetectorFigures { gain_e_per_dn: 25.1, black_level_dn: 100.0, read_noise_e_rms: 55.0, saturation_dn: 4095 };
        let params =
            TrackerParams { prnu: 0.008, ..TrackerParams::new(Geometry::centred(1024, 1024, 2903.0), detector, 0.65) };
        Self { params, zero_magnitude_e: 1.12e6, dark_e: 19.0, dsnu_e_rms: 27.5, prnu: 0.008, steps: 1 }
    }

    /// Returns a camera of 256 x 256, 20 degrees: four times coarser pixels.
    pub(super) fn coarse() -> Self {
        let wide = Self::wide();
        let params = TrackerParams {
            prnu: 0.008,
            ..TrackerParams::new(Geometry::centred(256, 256, 725.75), wide.params.detector, 0.8)
        };
        Self { params, ..wide }
    }

    /// Returns the camera of 1936 x 1216, 13 x 8.2 degrees, with distortion: configs/cameras/cubesat_tracker.toml.
    pub(super) fn narrow() -> Self {
        let detector =
            DetectorFigures { gain_e_per_dn: 8.15, black_level_dn: 60.0, read_noise_e_rms: 6.83, saturation_dn: 4095 };
        let geometry =
            Geometry { distortion: [-0.05, 0.0, 0.0, 0.0, 0.0], ..Geometry::centred(1936, 1216, 50.0 / 5.86e-3) };
        let params =
            TrackerParams { limiting_mag: 8.0, exposure_s: 0.2, ..TrackerParams::new(geometry, detector, 0.9) };
        let zero_magnitude_e = 3.2e10 * 0.5 * 0.85 * TAU / 8.0 * 0.025 * 0.025 * 0.2;
        Self { params, zero_magnitude_e, dark_e: 1.0, dsnu_e_rms: 1.0, prnu: 0.01, steps: 1 }
    }
}

/// Parameters of one drawn frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shot {
    pub(super) attitude: Rotation<Sensor, Icrf>,
    pub(super) rate_rad_s: DVec3,
    pub(super) beta: DVec3,
    /// Light everywhere, electrons.
    pub(super) sky_e: f64,
    /// Share of the stars that are not drawn.
    pub(super) missing: f64,
    /// Stars that no catalog has.
    pub(super) false_stars: usize,
    /// Pixels full of charge.
    pub(super) hot_pixels: usize,
}

impl Shot {
    pub(super) fn still(attitude: Rotation<Sensor, Icrf>, beta: DVec3) -> Self {
        Self { attitude, rate_rad_s: DVec3::ZERO, beta, sky_e: 0.0, missing: 0.0, false_stars: 0, hot_pixels: 0 }
    }
}

/// Draws frames from a seed.
pub(super) struct Painter {
    camera: Camera,
    stars: Vec<(DVec3, f64)>,
    pool: Vec<f32>,
    random: StdRng,
    electrons: Vec<f64>,
}

impl Painter {
    /// Returns the catalog's stars at a time, to a magnitude beyond the tracker's limit.
    pub(super) fn new(camera: Camera, catalog: &Catalog, at: Tai, seed: u64) -> Self {
        let years = at.years_since_j2000() + 2000.0 - catalog.index().epoch_yr;
        let faintest = camera.params.limiting_mag + 1.0;
        let bright = catalog.sources().iter().filter(|source| f64::from(source.mag_g) < faintest);
        let stars = bright
            .map(|source| {
                let [ra, dec] = ra_dec_rad(source.direction_icrf);
                let (east, north) = source.proper_motion.map_or((0.0, 0.0), |motion| {
                    (f64::from(motion.pm_ra_cosdec_mas_yr), f64::from(motion.pm_dec_mas_yr))
                });
                let moved = direction_from_ra_dec(ra + east * MAS * years / dec.cos(), dec + north * MAS * years);
                (moved, camera.zero_magnitude_e * 10f64.powf(-0.4 * f64::from(source.mag_g)))
            })
            .collect();
        let mut random = StdRng::seed_from_u64(seed);
        let pool = (0..POOL).map(|_| narrow(gaussian(&mut random))).collect();
        Self { camera, stars, pool, random, electrons: Vec::new() }
    }

    /// Returns a frame of the sky.
    pub(super) fn shoot(&mut self, shot: &Shot) -> DnImage {
        let g = self.camera.params.geometry;
        self.electrons.clear();
        self.electrons.resize(g.width_px * g.height_px, 0.0);
        let cone = (g.corner_rad() + 0.02).cos();
        let boresight = shot.attitude.inverse().apply(DVec3::Z);
        for index in 0..self.stars.len() {
            let (direction, flux_e) = self.stars[index];
            if direction.dot(boresight) > cone && !(shot.missing > 0.0 && self.random.random::<f64>() < shot.missing) {
                let seen = shot.attitude.apply(aberrated(direction, shot.beta));
                self.add_trail(seen, shot.rate_rad_s, flux_e);
            }
        }
        for _ in 0..shot.false_stars {
            let [x, y, mag] = [(); 3].map(|()| self.random.random::<f64>());
            let place = DVec2::new(x * g.width_px as f64, y * g.height_px as f64);
            self.add_star(place, self.camera.zero_magnitude_e * 10f64.powf(-0.4 * (2.0 + 2.0 * mag)));
        }
        self.read_out(shot)
    }

    /// Returns a frame of given stars: place (px) and electrons.
    pub(super) fn paint(&mut self, stars: &[(DVec2, f64)], sky_e: f64) -> DnImage {
        let g = self.camera.params.geometry;
        self.electrons.clear();
        self.electrons.resize(g.width_px * g.height_px, 0.0);
        for (place, flux_e) in stars {
            self.add_star(*place, *flux_e);
        }
        let nowhere = Rotation::IDENTITY;
        self.read_out(&Shot { sky_e, ..Shot::still(nowhere, DVec3::ZERO) })
    }

    /// Returns a frame of given stars without any noise.
    pub(super) fn paint_quietly(&mut self, stars: &[(DVec2, f64)]) -> DnImage {
        let Camera { params, .. } = self.camera;
        let g = params.geometry;
        self.electrons.clear();
        self.electrons.resize(g.width_px * g.height_px, 0.0);
        for (place, flux_e) in stars {
            self.add_star(*place, *flux_e);
        }
        let mut image = DnImage::new(g.width_px, g.height_px);
        for (dn, light) in image.pixels_mut().iter_mut().zip(&self.electrons) {
            *dn = digital(params.detector.black_level_dn + light / params.detector.gain_e_per_dn, u16::MAX);
        }
        image
    }

    fn add_trail(&mut self, seen: DVec3, rate_rad_s: DVec3, flux_e: f64) {
        let steps = self.camera.steps;
        for step in 0..steps {
            let time_s = ((step as f64 + 0.5) / steps as f64 - 0.5) * self.camera.params.exposure_s;
            // A star moves against the sensor: v' = -w x v, to second order of the turn.
            let turn = rate_rad_s * time_s;
            let first = -turn.cross(seen);
            let moved = seen + first - 0.5 * turn.cross(first);
            if let Some(place) = project(&self.camera.params.geometry, moved) {
                self.add_star(place, flux_e / steps as f64);
            }
        }
    }

    fn add_star(&mut self, place: DVec2, flux_e: f64) {
        let g = self.camera.params.geometry;
        let scale = 1.0 / (core::f64::consts::SQRT_2 * self.camera.params.psf_sigma_px);
        let share = |pixel: i64, centre: f64| {
            let offset = pixel as f64 - centre;
            0.5 * (erf((offset + 0.5) * scale) - erf((offset - 0.5) * scale))
        };
        let (left, top) = (whole(place.x) - STAMP_PX, whole(place.y) - STAMP_PX);
        let mut columns = [0.0; STAMP_WIDTH];
        for (column, light) in (left..).zip(&mut columns) {
            *light = share(column, place.x);
        }
        for y in top.max(0)..(top + 2 * STAMP_PX + 1).min(g.height_px as i64) {
            let row = flux_e * share(y, place.y);
            for (x, light) in (left..).zip(&columns).filter(|(x, _)| (0..g.width_px as i64).contains(x)) {
                let at = usize::try_from(y).unwrap() * g.width_px + usize::try_from(x).unwrap();
                self.electrons[at] += row * light;
            }
        }
    }

    fn read_out(&mut self, shot: &Shot) -> DnImage {
        let Camera { params, dark_e, dsnu_e_rms, prnu, .. } = self.camera;
        let (g, d) = (params.geometry, params.detector);
        let mut image = DnImage::new(g.width_px, g.height_px);
        let level_e = dark_e + shot.sky_e;
        let quiet_e = (d.read_noise_e_rms.powi(2) + level_e).sqrt();
        for (y, line) in image.pixels_mut().chunks_exact_mut(g.width_px).enumerate() {
            let noise = usize::try_from(self.random.random::<u32>()).unwrap() % (POOL - g.width_px);
            let offsets = y * 4099 % (POOL - g.width_px);
            let gains = (y * 7013 + POOL / 2) % (POOL - g.width_px);
            for (x, dn) in line.iter_mut().enumerate() {
                let light = self.electrons[y * g.width_px + x] * (1.0 + prnu * f64::from(self.pool[gains + x]));
                let mut e = level_e + dsnu_e_rms * f64::from(self.pool[offsets + x]);
                e += quiet_e * f64::from(self.pool[noise + x]);
                if light > 1e-3 {
                    e += poisson(&mut self.random, light);
                }
                *dn = digital(d.black_level_dn + e / d.gain_e_per_dn, d.saturation_dn);
            }
        }
        for _ in 0..shot.hot_pixels {
            let at = usize::try_from(self.random.random::<u32>()).unwrap() % image.pixels().len();
            image.pixels_mut()[at] = d.saturation_dn;
        }
        image
    }
}

/// Returns the pinhole with Brown-Conrady distortion, by its formula.
pub(super) fn project(g: &Geometry, v: DVec3) -> Option<DVec2> {
    if v.z <= 0.0 {
        return None;
    }
    let (x, y) = (v.x / v.z, v.y / v.z);
    let [k1, k2, p1, p2, k3] = g.distortion;
    let r2 = x * x + y * y;
    let radial = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3);
    let bent_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
    let bent_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
    Some(DVec2::new(g.principal_point_px[0] + g.focal_px[0] * bent_x, g.principal_point_px[1] + g.focal_px[1] * bent_y))
}

/// Returns the aberration to second order: Stumpff, "On the relativistic treatment of aberration", A&A 84 (1980), 257.
pub(super) fn aberrated(u: DVec3, beta: DVec3) -> DVec3 {
    let along = u.dot(beta);
    let across = beta - along * u;
    (u + across - 0.5 * along * across).normalize()
}

/// Returns the error function by its series (Abramowitz & Stegun 7.1.6); from 4.5 on it is 1 to 2e-10.
pub(super) fn erf(x: f64) -> f64 {
    if x.abs() > 4.5 {
        return x.signum();
    }
    let (mut term, mut sum, mut odd) = (x, x, 1.0);
    while term.abs() > 1e-12 * sum.abs() {
        odd += 2.0;
        term *= 2.0 * x * x / odd;
        sum += term;
    }
    2.0 / core::f64::consts::PI.sqrt() * (-x * x).exp() * sum
}

pub(super) fn gaussian(random: &mut StdRng) -> f64 {
    let (radius, turn): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - radius).ln()).sqrt() * (TAU * turn).cos()
}

/// Draws a Poisson number: Knuth's product of uniforms below 30, a rounded Gaussian above (skew 0.18 and less).
fn poisson(random: &mut StdRng, mean: f64) -> f64 {
    if mean > 30.0 {
        return (mean + mean.sqrt() * gaussian(random)).round();
    }
    let (limit, mut product, mut count) = ((-mean).exp(), 1.0, -1.0);
    while product > limit {
        product *= random.random::<f64>();
        count += 1.0;
    }
    count
}

/// Returns a random attitude, uniform over all rotations.
pub(super) fn random_attitude(random: &mut StdRng) -> Rotation<Sensor, Icrf> {
    let [w, x, y, z] = [(); 4].map(|()| gaussian(random));
    Rotation::from_quat(glam::DQuat::from_xyzw(x, y, z, w))
}

#[allow(clippy::cast_possible_truncation, reason = "places are near the image")]
fn whole(value: f64) -> i64 {
    value.round() as i64
}
#[allow(clippy::cast_possible_truncation, reason = "noise needs no more digits")]
fn narrow(value: f64) -> f32 {
    value as f32
}
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the converter's range")]
fn digital(dn: f64, saturation_dn: u16) -> u16 {
    dn.round().clamp(0.0, f64::from(saturation_dn)) as u16
}
