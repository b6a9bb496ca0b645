//! A statistical star tracker: true attitude and rate -> what a tracker of given errors says, without pixels.
//!
//! Terms by the names of ECSS-E-ST-60-20C, per sensor axis, 1 sigma, each a rotation vector on top of the truth:
//!
//! * bias: constant; drift: grows with time from the run's begin;
//! * FOV spatial error: a sum of six waves over the attitude with the period of the field, so that it is constant while
//!   the tracker is inertial and slow while it turns;
//! * pixel spatial error: the same with the period of a pixel;
//! * aberration residual: a part of the displacement by the Earth's velocity;
//! * temporal noise: Gaussian, new in each frame; the same all over the sky (`NoiseMethod::Even`), or by the stars that
//!   the field offers (`NoiseMethod::Stars`, `tracker::star_noise`), which spatial errors then follow too;
//! * noise of motion: Gaussian, grows with the rate; smeared stars are less certain along their motion, which is about
//!   the axis of the rate, than across it;
//! * false attitudes: any attitude at all, by chance;
//! * measurement date error: the attitude is of an earlier instant than it says. (A wrong time tag is the caller's.)
//!
//! Life: an attitude is found when the rate has been below its limit and no bright body near the boresight for
//! `acquisition`, in each frame with `acquisition_probability`; it is kept with `tracking_probability` in each frame
//! until the rate is above `lost_above` or a body comes near. Numbers are those of Philox, keyed by the seed and
//! counted by frame: the same frames give the same bits, in whatever order.
//!
//! Limits: the covers of Sun and Moon are cones about directions from the Earth's centre, good to 0.02 deg and 0.6 deg;
//! an observer in a low orbit sees the Moon up to 1 deg from there. The Earth's is about its limb, where the caller says
//! where it is. A dimmer sky and a brighter background are the caller's too (`TrackerModel::expose`). Faults of stars
//! (protons, bad pixels, false stars) are left out: the tracker on pixels has them. Tests: below.

use crate::spacecraft::sun_direction_icrf;
use crate::tracker::{
    ExposedLight, FieldNoise, Mode, Outcome, Reason, Solution, StarNoise, earth_beta, uncorrected_turn,
};
use base::axes::{Icrf, Rotation, Sensor, attitude_of_uniforms};
use base::random::{Stage, counter, key, philox};
use base::time::{Span, Tai};
use base::units::DEG;
use core::f64::consts::{FRAC_1_SQRT_2, TAU};
use glam::{DMat3, DVec2, DVec3};

/// Waves of each spatial error.
const WAVES: usize = 6;
/// "Frame" of the draws that belong to none: places of waves.
const OF_THE_SENSOR: u32 = u32::MAX;
/// Seconds of an hour, by which drift is given.
const HOUR_S: f64 = 3600.0;

/// How the temporal noise depends on where the tracker looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseMethod {
    /// Not at all: the figures hold everywhere.
    Even,
    /// By number, brightness and places of the stars in the field; the figures are the root mean square over the sky.
    Stars,
}

/// Figures of a tracker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelParams {
    /// Constant error.
    pub bias_rad: DVec3,
    /// Error that grows with time, rad per hour.
    pub drift_rad_h: DVec3,
    /// Error that is slow over the field.
    pub fov_spatial_rad: DVec3,
    /// Side of the field: the period of the FOV spatial error.
    pub field_rad: f64,
    /// Part of the largest displacement by aberration that is left in an attitude.
    pub aberration_residual_rad: f64,
    /// Error of the place on a pixel.
    pub pixel_spatial_rad: DVec3,
    /// Angle of a pixel: its period.
    pub pixel_rad: f64,
    /// Temporal noise at rest.
    pub noise_rad: DVec3,
    /// How it depends on where the tracker looks.
    pub noise_method: NoiseMethod,
    /// Temporal noise that a rate adds, in squares: seconds, to be multiplied by the rate across the boresight; about
    /// the axis of the rate, about the axis across it, about the boresight.
    pub noise_rate_s: DVec3,
    /// By how much the instant of the attitude is before the middle of the exposure.
    pub date_error: Span,
    /// How long conditions must hold before an attitude is found.
    pub acquisition: Span,
    /// Chance that a frame gives an attitude then.
    pub acquisition_probability: f64,
    /// Chance that a frame gives an attitude while it tracks.
    pub tracking_probability: f64,
    /// Chance that an attitude is false: any attitude, all equally likely.
    pub false_probability: f64,
    /// Rate up to which it finds an attitude, rad/s.
    pub acquires_below_rad_s: f64,
    /// Rate from which it loses it, rad/s.
    pub lost_above_rad_s: f64,
    /// Half-angle of the cone about the boresight in which the Sun blinds it.
    pub sun_exclusion_rad: f64,
    /// The same of the Moon.
    pub moon_exclusion_rad: f64,
    /// Angle from the boresight to the Earth's limb below which it is blinded, where it sees the Earth
    /// ([`TrackerModel::see_earth`]).
    pub earth_exclusion_rad: f64,
    /// Stars that it says it used; by [`NoiseMethod::Stars`] the most that it uses.
    pub stars: u32,
}

/// The Earth as the tracker sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EarthDisc {
    /// Unit vector to its centre, ICRF.
    pub direction_icrf: DVec3,
    /// Its angular radius.
    pub radius_rad: f64,
}

/// Roots of the covariances of temporal noise, rad: to be multiplied by numbers of standard deviation 1.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Noise {
    at_rest: DMat3,
    of_motion: Option<DMat3>,
}

/// One wave of a spatial error.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Wave {
    along_z: DVec3,
    along_x: DVec3,
    phase: f64,
}

/// A statistical tracker.
#[derive(Debug, Clone)]
pub struct TrackerModel {
    params: ModelParams,
    stars: Option<Box<StarNoise>>,
    seed: [u32; 2],
    start: Tai,
    fov: [[Wave; WAVES]; 3],
    pixel: [[Wave; WAVES]; 3],
    earth: Option<EarthDisc>,
    is_tracking: bool,
    /// Since when its conditions hold.
    good_since: Option<Tai>,
}

impl TrackerModel {
    /// Returns a tracker that is lost in space; its drift begins at `start`, and its noise is even unless there are
    /// `stars`, as [`NoiseMethod::Stars`] wants them.
    pub fn new(params: ModelParams, stars: Option<StarNoise>, seed: u64, start: Tai) -> Self {
        let seed = key(seed);
        let (fov, pixel) = (waves(seed, 0, params.field_rad), waves(seed, 1000, params.pixel_rad));
        let (stars, earth) = (stars.map(Box::new), None);
        Self { params, stars, seed, start, fov, pixel, earth, is_tracking: false, good_since: None }
    }

    /// Forgets the attitude: the next frame is lost in space.
    pub fn forget(&mut self) {
        (self.is_tracking, self.good_since) = (false, None);
    }

    /// Sets where the Earth is from the next frame on.
    pub fn see_earth(&mut self, earth: Option<EarthDisc>) {
        self.earth = earth;
    }

    /// Sets the light of the next frame: fainter stars or a brighter background than those that its noise is given in. No
    /// effect on even noise.
    pub fn expose(&mut self, light: &ExposedLight) {
        if let Some(stars) = &mut self.stars {
            stars.expose(light);
        }
    }

    /// Returns what it says of a frame at `at`, with this true attitude and rate (sensor axes, rad/s).
    pub fn measure(&mut self, frame: u32, at: Tai, truth: &Rotation<Sensor, Icrf>, rate_rad_s: DVec3) -> Outcome {
        let draws = self.uniforms(frame, 0);
        let limit = if self.is_tracking { self.params.lost_above_rad_s } else { self.params.acquires_below_rad_s };
        if self.is_blinded(at, truth) {
            self.forget();
            return Outcome::NoSolution(Reason::StrayLight);
        }
        if rate_rad_s.length() > limit {
            self.forget();
            return Outcome::NoSolution(Reason::TooFewStars);
        }
        let Some(field) = self.field_noise(truth) else {
            self.forget();
            return Outcome::NoSolution(Reason::TooFewStars);
        };
        let since = *self.good_since.get_or_insert(at);
        let mode = if self.is_tracking { Mode::Tracking } else { Mode::LostInSpace };
        let chance = match mode {
            Mode::Tracking => self.params.tracking_probability,
            Mode::LostInSpace if at - since < self.params.acquisition => 0.0,
            Mode::LostInSpace => self.params.acquisition_probability,
        };
        self.is_tracking = draws[0] < chance;
        if !self.is_tracking {
            return Outcome::NoSolution(Reason::NoMatch);
        }
        let noise = self.noise(&field, rate_rad_s);
        let lag_rad = rate_rad_s * -self.params.date_error.s();
        let is_false = draws[1] < self.params.false_probability;
        let near_truth = || truth.rotated_by(self.error_rad(frame, at, truth, (&noise, &field)) + lag_rad);
        Outcome::Solved(Solution {
            at,
            sensor_from_icrf: if is_false { self.any_attitude(frame) } else { near_truth() },
            covariance_rad2: covariance(&noise),
            mode,
            stars: u32::try_from(field.stars).unwrap_or(u32::MAX),
            residual_rms_px: 0.0,
            chi_square_per_dof: 1.0,
            background_dn: f64::NAN,
        })
    }

    /// Returns the noise of the field about an attitude; `None` where too few stars are.
    fn field_noise(&mut self, truth: &Rotation<Sensor, Icrf>) -> Option<FieldNoise> {
        match &mut self.stars {
            Some(stars) => stars.at(truth),
            None => {
                let (factor, spatial) = (DMat3::IDENTITY, DMat3::IDENTITY);
                Some(FieldNoise { factor, spatial, stars: self.params.stars as usize })
            }
        }
    }

    /// Returns the temporal noise in a field, at rest and of motion. A turn about the boresight moves stars by the field's
    /// radius at most, in all directions.
    fn noise(&self, field: &FieldNoise, rate_rad_s: DVec3) -> Noise {
        let at_rest = DMat3::from_diagonal(self.params.noise_rad) * field.factor;
        let [along, across, about] = self.params.noise_rate_s.to_array();
        let (across_rate, roll_rate) = (rate_rad_s.truncate(), 0.5 * self.params.field_rad * rate_rad_s.z);
        let (rate, direction) = (across_rate.length(), across_rate.normalize_or(DVec2::X));
        let roll = roll_rate * along.hypot(across) * FRAC_1_SQRT_2;
        let sigma = DVec3::new((along * rate).hypot(roll), (across * rate).hypot(roll), about * rate.hypot(roll_rate));
        if sigma == DVec3::ZERO {
            return Noise { at_rest, of_motion: None };
        }
        let axes = DMat3::from_cols(direction.extend(0.0), direction.perp().extend(0.0), DVec3::Z);
        let of_motion = axes * DMat3::from_diagonal(sigma) * axes.transpose() * field.factor;
        Noise { at_rest, of_motion: Some(of_motion) }
    }

    /// Returns a random attitude; all are equally likely.
    fn any_attitude(&self, frame: u32) -> Rotation<Sensor, Icrf> {
        let [u, v, w, _] = self.uniforms(frame, 3);
        attitude_of_uniforms([u, v, w])
    }

    fn error_rad(
        &self,
        frame: u32,
        at: Tai,
        truth: &Rotation<Sensor, Icrf>,
        (noise, field): (&Noise, &FieldNoise),
    ) -> DVec3 {
        let params = &self.params;
        let drift = params.drift_rad_h * ((at - self.start).s() / HOUR_S);
        let fov = params.fov_spatial_rad * (field.spatial * spatial(&self.fov, truth));
        let pixel = params.pixel_spatial_rad * (field.spatial * spatial(&self.pixel, truth));
        let aberration = params.aberration_residual_rad * uncorrected_turn(truth.apply(earth_beta(at).normalize()));
        params.bias_rad + drift + fov + pixel + aberration + self.drawn_rad(frame, noise)
    }

    /// Returns the noise of a frame.
    fn drawn_rad(&self, frame: u32, noise: &Noise) -> DVec3 {
        let of_motion = noise.of_motion.map_or(DVec3::ZERO, |root| root * self.gaussians(frame, 2));
        noise.at_rest * self.gaussians(frame, 1) + of_motion
    }

    fn is_blinded(&self, at: Tai, truth: &Rotation<Sensor, Icrf>) -> bool {
        let boresight = truth.inverse().apply(DVec3::Z);
        let is_near = |half_angle_rad: f64, direction: &dyn Fn(Tai) -> DVec3| {
            half_angle_rad > 0.0 && boresight.angle_between(direction(at)) < half_angle_rad
        };
        let is_near_limb = self.earth.is_some_and(|earth| {
            boresight.angle_between(earth.direction_icrf) - earth.radius_rad < self.params.earth_exclusion_rad
        });
        is_near(self.params.sun_exclusion_rad, &sun_direction_icrf)
            || is_near(self.params.moon_exclusion_rad, &moon_direction_icrf)
            || (self.params.earth_exclusion_rad > 0.0 && is_near_limb)
    }

    fn uniforms(&self, frame: u32, block: u32) -> [f64; 4] {
        uniforms(self.seed, frame, block)
    }

    /// Returns independent numbers of standard deviation 1 (Box and Muller 1958).
    fn gaussians(&self, frame: u32, block: u32) -> DVec3 {
        let [a, b, c, d] = self.uniforms(frame, block);
        let pair = |u: f64, v: f64| {
            let radius = (-2.0 * libm::log(u)).sqrt();
            [radius * libm::cos(TAU * v), radius * libm::sin(TAU * v)]
        };
        let ([x, y], [z, _]) = (pair(a, b), pair(c, d));
        DVec3::new(x, y, z)
    }
}

/// Returns the covariance of noise.
fn covariance(noise: &Noise) -> DMat3 {
    let square = |root: DMat3| root * root.transpose();
    square(noise.at_rest) + noise.of_motion.map_or(DMat3::ZERO, square)
}

/// Numbers above 0 and below 1.
fn uniforms(seed: [u32; 2], frame: u32, block: u32) -> [f64; 4] {
    philox(counter(frame, block, Stage::TrackerModel), seed).map(|word| (f64::from(word) + 0.5) / 4_294_967_296.0)
}

/// Waves of a period, of random direction and phase.
fn waves(seed: [u32; 2], first_block: u32, period_rad: f64) -> [[Wave; WAVES]; 3] {
    let direction = |u: f64, v: f64| {
        let (z, turn) = (2.0 * u - 1.0, TAU * v);
        let across = (1.0 - z * z).sqrt();
        DVec3::new(across * libm::cos(turn), across * libm::sin(turn), z) * (TAU / period_rad)
    };
    let mut block = first_block;
    [0, 1, 2].map(|_axis| {
        [(); WAVES].map(|()| {
            let ([a, b, c, d], [phase, ..]) =
                (uniforms(seed, OF_THE_SENSOR, block), uniforms(seed, OF_THE_SENSOR, block + 1));
            block += 2;
            Wave { along_z: direction(a, b), along_x: direction(c, d), phase: TAU * phase }
        })
    })
}

/// Returns a spatial error at an attitude, of standard deviation 1 over all attitudes, per axis.
fn spatial(waves: &[[Wave; WAVES]; 3], truth: &Rotation<Sensor, Icrf>) -> DVec3 {
    let inverse = truth.inverse();
    let (z, x) = (inverse.apply(DVec3::Z), inverse.apply(DVec3::X));
    let sum = |of: &[Wave; WAVES]| {
        let value = |wave: &Wave| libm::cos(wave.along_z.dot(z) + wave.along_x.dot(x) + wave.phase);
        of.iter().map(value).sum::<f64>() * (2.0 / WAVES as f64).sqrt()
    };
    DVec3::new(sum(&waves[0]), sum(&waves[1]), sum(&waves[2]))
}

/// Returns the unit vector from the Earth's centre to the Moon, ICRF: the low-precision formulae of the Astronomical
/// Almanac, section D, good to 0.3 degrees in longitude and 0.2 in latitude, with the precession since J2000.0 taken
/// out of the longitude.
pub fn moon_direction_icrf(at: Tai) -> DVec3 {
    /// Julian days of a century.
    const CENTURY_D: f64 = 36_525.0;
    /// General precession in longitude, degrees per century.
    const PRECESSION_DEG: f64 = 1.396_971;
    const OBLIQUITY_DEG: f64 = 23.439_291;
    let t = at.days_tdb_since_j2000() / CENTURY_D;
    let sin = |constant: f64, rate: f64| libm::sin((constant + rate * t) * DEG);
    let longitude_deg = 218.32 + 481_267.881 * t + 6.29 * sin(135.0, 477_198.87) - 1.27 * sin(259.3, -413_335.36)
        + 0.66 * sin(235.7, 890_534.22)
        + 0.21 * sin(269.9, 954_397.74)
        - 0.19 * sin(357.5, 35_999.05)
        - 0.11 * sin(186.5, 966_404.03)
        - PRECESSION_DEG * t;
    let latitude_deg = 5.13 * sin(93.3, 483_202.02) + 0.28 * sin(228.2, 960_400.89)
        - 0.28 * sin(318.3, 6_003.15)
        - 0.17 * sin(217.6, -407_332.21);
    let [(sin_l, cos_l), (sin_b, cos_b), (sin_e, cos_e)] =
        [longitude_deg, latitude_deg, OBLIQUITY_DEG].map(|angle| libm::sincos(angle * DEG));
    let (x, y, z) = (cos_b * cos_l, cos_b * sin_l, sin_b);
    DVec3::new(x, y * cos_e - z * sin_e, y * sin_e + z * cos_e)
}

#[cfg(test)]
mod tests;
