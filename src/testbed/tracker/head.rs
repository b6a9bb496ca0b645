//! One tracker head: image after image -> attitude or the reason why there is none.
//!
//! Lost in space until a frame is identified, then tracking; after too many frames without an attitude lost in space
//! again. Its buffers are reused; richer fields than ever before may grow one once. Tests: `tests::lost`,
//! `tests::series`.

use super::adjust::{Adjusted, MatchedStar};
use super::centroid::{centre_of_gravity, gaussian_fit};
use super::command::{CameraOrders, CameraWish, Exposed, better_exposure, reached_mid};
use super::detect::{Blob, Detector, PEAK_SIGMA};
use super::identify::{Identifier, Sighting};
use super::params::{Reason, TrackerParams};
use super::track::{Follower, Prediction, refuse_bright, ring_about, set_background, spot_model, trail_of};
use super::{background::BackgroundGrid, guide::GuideStars};
use base::axes::{Icrf, Rotation, Sensor};
use base::time::{Span, Tai};
use base::{image::DnImage, region::Regions};
use glam::{DMat3, DVec2, DVec3};
use std::sync::Arc;

/// Longest gap over which tracking predicts, s.
const LONGEST_GAP_S: f64 = 10.0;
/// Longest gap between two attitudes from which a rate is taken, s.
const LONGEST_RATE_GAP_S: f64 = 2.0;
/// Least excess of the spots' second moment that counts as a trail of unknown rate, px^2: a trail of 3.5 px.
const TRAIL_MOMENT_PX2: f64 = 1.0;
/// Spots whose moments are looked at.
const TRAIL_SPOTS: usize = 9;

/// How an attitude was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Without knowing where the tracker points.
    LostInSpace,
    /// From the previous attitude.
    Tracking,
}

/// An attitude measured from one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// Middle of the exposure.
    pub at: Tai,
    /// The attitude then.
    pub sensor_from_icrf: Rotation<Sensor, Icrf>,
    /// Covariance of its error as a rotation vector in sensor axes, rad^2.
    pub covariance_rad2: DMat3,
    /// How it was found.
    pub mode: Mode,
    /// Stars used.
    pub stars: u32,
    /// Root mean square of the residuals per axis, px.
    pub residual_rms_px: f64,
    /// Residuals against their expected errors; 1 when both agree.
    pub chi_square_per_dof: f64,
    /// Mean background of the image, or in tracking of the windows, DN.
    pub background_dn: f64,
}

/// Result of an image: an attitude, or the reason why not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome {
    /// An attitude.
    Solved(Solution),
    /// None, and why.
    NoSolution(Reason),
}

/// Frames by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TrackerCounts {
    /// Images given.
    pub frames: u64,
    /// Attitudes found lost in space.
    pub lost_in_space: u64,
    /// Attitudes found by tracking.
    pub tracking: u64,
    /// Images without attitude.
    pub none: u64,
    /// How often tracking gave up.
    pub losses: u64,
}

/// The last attitude and what is known of the motion.
#[derive(Debug, Clone, Copy)]
struct Track {
    at: Tai,
    attitude: Rotation<Sensor, Icrf>,
    rate_rad_s: Option<DVec3>,
    misses: u32,
}

/// A star tracker that sees only pixels.
#[derive(Debug, Clone)]
pub struct Tracker {
    params: TrackerParams,
    pub(crate) guide: Arc<GuideStars>,
    grid: BackgroundGrid,
    detector: Detector,
    identifier: Identifier,
    follower: Follower,
    sightings: Vec<Sighting>,
    /// Stars of the last image that gave an attitude, brightest first; outliers are marked unused.
    pub(crate) matches: Vec<MatchedStar>,
    samples: Vec<u16>,
    track: Option<Track>,
    /// Frames by what became of them.
    pub counts: TrackerCounts,
    /// Exposure time of the camera's file, s.
    own_exposure_s: f64,
    /// Parts of the next image that were read out.
    regions: Regions,
}

impl Tracker {
    /// Returns a tracker that is lost in space. `params` are those the guide stars were made with.
    pub fn new(params: TrackerParams, guide: Arc<GuideStars>) -> Self {
        Self {
            grid: BackgroundGrid::new(params.geometry.width_px, params.geometry.height_px),
            detector: Detector::new(&params),
            identifier: Identifier::new(&guide),
            follower: Follower::new(&params),
            sightings: Vec::with_capacity(params.most_stars),
            matches: Vec::with_capacity(params.most_stars),
            samples: Vec::with_capacity(4096),
            track: None,
            counts: TrackerCounts::default(),
            own_exposure_s: params.exposure_s,
            regions: Regions::WHOLE,
            params,
            guide,
        }
    }

    /// Measures the attitude at the middle of an exposure. `beta` is the observer's barycentric velocity over the speed
    /// of light, ICRF axes; `rate_rad_s` the rate of the sensor axes with respect to ICRF, in sensor axes, if a gyro
    /// measures it. Without it, the rate is taken from the last two attitudes, and lost in space from the spots' shape.
    pub fn measure(&mut self, image: &DnImage, mid_exposure: Tai, beta: DVec3, rate_rad_s: Option<DVec3>) -> Outcome {
        self.counts.frames += 1;
        self.matches.clear();
        let geometry = &self.params.geometry;
        let outcome = if (image.width(), image.height()) != (geometry.width_px, geometry.height_px) {
            Err(Reason::ImageSize)
        } else if let Some(track) = self.track.filter(|track| is_usable(track, mid_exposure)) {
            self.track_on(image, mid_exposure, beta, rate_rad_s, track)
        } else {
            self.track = None;
            self.find(image, mid_exposure, beta, rate_rad_s)
        };
        self.count(outcome)
    }

    /// Takes how the image was exposed that is measured next, and those after it, where it is not as the camera's file
    /// says.
    pub fn expose(&mut self, exposed: &Exposed) {
        self.params.exposure_s = exposed.exposure_s;
        self.regions = exposed.regions;
    }

    /// Returns what it asks of the camera after [`Self::measure`] of an image, from an instant on; the other arguments
    /// are those of that image.
    pub fn wish(
        &mut self,
        orders: &CameraOrders,
        (image, mid_exposure): (&DnImage, Tai),
        (outcome, from): (&Outcome, Tai),
        (beta, rate_rad_s): (DVec3, Option<DVec3>),
    ) -> CameraWish {
        let exposure = orders.exposure_s.and_then(|limits_s| match (outcome, self.track) {
            (Outcome::Solved(Solution { background_dn, .. }), _) => {
                better_exposure(&self.params, image, &self.matches, *background_dn, limits_s)
            }
            (Outcome::NoSolution(_), None) => Some(Span::from_s(self.own_exposure_s)),
            (Outcome::NoSolution(_), Some(_)) => None,
        });
        let exposed_s = self.params.exposure_s;
        let next_s = exposure.map_or(exposed_s, |exposure| exposure.s());
        let at = reached_mid(orders, mid_exposure, exposed_s, from, next_s);
        let regions = orders.windows.then(|| self.windows_at(at, beta, rate_rad_s));
        CameraWish { from, exposure, regions }
    }

    /// Windows around the stars as they are predicted; the whole image when the last one gave no attitude.
    fn windows_at(&mut self, at: Tai, beta: DVec3, rate_rad_s: Option<DVec3>) -> Regions {
        let Some(track) = self.track.filter(|track| track.misses == 0) else { return Regions::WHOLE };
        let Some(rate_rad_s) = rate_rad_s.or(track.rate_rad_s) else { return Regions::WHOLE };
        let attitude = track.attitude.rotated_by(rate_rad_s * (at - track.at).s());
        self.follower.windows(&self.params, &self.guide, &Prediction { attitude, rate_rad_s, beta })
    }

    /// Forgets the attitude: the next image is lost in space.
    pub fn forget(&mut self) {
        self.track = None;
    }

    fn count(&mut self, outcome: Result<Solution, Reason>) -> Outcome {
        match outcome {
            Ok(solution) => {
                match solution.mode {
                    Mode::LostInSpace => self.counts.lost_in_space += 1,
                    Mode::Tracking => self.counts.tracking += 1,
                }
                Outcome::Solved(solution)
            }
            Err(reason) => {
                self.counts.none += 1;
                self.matches.clear();
                Outcome::NoSolution(reason)
            }
        }
    }

    fn track_on(
        &mut self,
        image: &DnImage,
        at: Tai,
        beta: DVec3,
        rate_rad_s: Option<DVec3>,
        track: Track,
    ) -> Result<Solution, Reason> {
        let known = rate_rad_s.or(track.rate_rad_s);
        let rate = known.unwrap_or(DVec3::ZERO);
        let attitude = track.attitude.rotated_by(rate * (at - track.at).s());
        let prediction = Prediction { attitude, rate_rad_s: rate, beta };
        let mut followed =
            self.follower.follow(&self.params, &self.guide, (image, &self.regions), &prediction, &mut self.matches);
        if let (Ok((found, _)), None) = (&followed, known) {
            // The stars were measured as points; now that the motion is known, as trails.
            let gap_s = (at - track.at).s().max(self.params.exposure_s);
            let rate_rad_s = track.attitude.rotation_vector_to(&found.attitude) / gap_s;
            let again = Prediction { attitude: found.attitude, rate_rad_s, beta };
            followed =
                self.follower.follow(&self.params, &self.guide, (image, &self.regions), &again, &mut self.matches);
        }
        let solved = followed.and_then(|(found, background_dn)| self.accept(found, at, Mode::Tracking, background_dn));
        match solved {
            Ok(solution) => {
                let gap_s = (at - track.at).s();
                let turned = track.attitude.rotation_vector_to(&solution.sensor_from_icrf);
                let rate_rad_s = (gap_s > 0.0 && gap_s < LONGEST_RATE_GAP_S).then(|| turned / gap_s);
                self.track = Some(Track { at, attitude: solution.sensor_from_icrf, rate_rad_s, misses: 0 });
                Ok(solution)
            }
            // Nothing was known of the motion, so the miss says nothing: look again everywhere.
            Err(_) if known.is_none() => self.find(image, at, beta, rate_rad_s),
            Err(reason) => {
                let misses = track.misses + 1;
                self.track = (misses < self.params.most_misses).then_some(Track { misses, ..track });
                self.counts.losses += u64::from(self.track.is_none());
                Err(reason)
            }
        }
    }

    /// Returns the lost in space. Two attitudes in a row give a rate.
    fn find(&mut self, image: &DnImage, at: Tai, beta: DVec3, rate_rad_s: Option<DVec3>) -> Result<Solution, Reason> {
        let before = self.track.take();
        if !self.regions.is_whole() {
            // Windows were for stars that are not there.
            return Err(Reason::TooFewStars);
        }
        self.grid.measure(image, PEAK_SIGMA);
        let background_dn = self.grid.mean_level_dn();
        refuse_bright(&self.params, background_dn)?;
        self.sight(image, rate_rad_s)?;
        let Self { params, guide, identifier, sightings, matches, .. } = self;
        let found = identifier.identify(params, guide, beta, sightings, matches)?;
        let solution = self.accept(found, at, Mode::LostInSpace, background_dn)?;
        let rate_rad_s = before.filter(|before| (at - before.at).s() < LONGEST_RATE_GAP_S).map(|before| {
            before.attitude.rotation_vector_to(&solution.sensor_from_icrf) / (at - before.at).s().max(1e-6)
        });
        self.track = Some(Track { at, attitude: solution.sensor_from_icrf, rate_rad_s, misses: 0 });
        Ok(solution)
    }

    /// Finds and measures the spots of the whole image.
    fn sight(&mut self, image: &DnImage, rate_rad_s: Option<DVec3>) -> Result<(), Reason> {
        self.sightings.clear();
        let blobs = self.detector.find(image, &self.grid, self.params.most_stars)?;
        let unknown_trail_px = trail_of_blobs(blobs, self.params.pixel_psf_sigma_px());
        for blob in blobs {
            let direction = self.params.geometry.direction(blob.place_px);
            let trail_px = rate_rad_s.map_or(unknown_trail_px, |rate| trail_of(&self.params, rate, direction));
            let mut model = spot_model(&self.params, trail_px);
            let mut background = self.grid.at(blob.place_px.x, blob.place_px.y);
            if let Some(around) = ring_about(image, blob.place_px, model.half_px(), &mut self.samples) {
                background.level_dn = around.level_dn;
            }
            set_background(&mut model, background);
            let start = centre_of_gravity(image, blob.place_px, &model).unwrap_or(blob.place_px);
            if let Some(spot) = gaussian_fit(image, start, &model) {
                let direction = self.params.geometry.direction(spot.place_px);
                self.sightings.push(Sighting { spot, direction });
            }
        }
        Ok(())
    }

    fn accept(&self, found: Adjusted, at: Tai, mode: Mode, background_dn: f64) -> Result<Solution, Reason> {
        if found.used < self.params.fewest_stars {
            return Err(Reason::TooFewStars);
        }
        if found.chi_square_per_dof > self.params.most_chi_square_per_dof {
            return Err(Reason::ResidualTooLarge);
        }
        Ok(Solution {
            at,
            sensor_from_icrf: found.attitude,
            covariance_rad2: found.covariance_rad2,
            mode,
            stars: u32::try_from(found.used).unwrap_or(u32::MAX),
            residual_rms_px: found.residual_rms_px,
            chi_square_per_dof: found.chi_square_per_dof,
            background_dn,
        })
    }
}

fn is_usable(track: &Track, at: Tai) -> bool {
    (0.0..LONGEST_GAP_S).contains(&(at - track.at).s())
}

/// Returns the trail that the brightest spots share, from the median excess of their second moments over a spot's: a
/// line of length L has L^2 / 12 along itself. Zero when it is short.
fn trail_of_blobs(blobs: &[Blob], sigma_px: f64) -> DVec2 {
    let bright = &blobs[..blobs.len().min(TRAIL_SPOTS)];
    let median = |index: usize| {
        let mut values = [0.0; TRAIL_SPOTS];
        for (value, blob) in values.iter_mut().zip(bright) {
            *value = blob.moments_px2[index];
        }
        let values = &mut values[..bright.len()];
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let (xx, xy, yy) = (median(0) - sigma_px * sigma_px, median(1), median(2) - sigma_px * sigma_px);
    let along = 0.5 * (xx + yy) + (0.5 * (xx - yy)).hypot(xy);
    if along < TRAIL_MOMENT_PX2 {
        return DVec2::ZERO;
    }
    let direction = 0.5 * (2.0 * xy).atan2(xx - yy);
    DVec2::from_angle(direction) * (12.0 * along).sqrt()
}
