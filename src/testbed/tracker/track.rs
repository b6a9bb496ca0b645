//! A predicted attitude and an image -> the stars near their predicted places.
//!
//! Two passes that touch only windows. First, peaks near the brightest stars vote for the common shift (the
//! prediction's error); hot pixels and neighbours do not agree on one. The attitude of the stars that do puts every
//! other star within a fraction of a pixel, where it is measured at once. Tests: `tracking_follows_a_slew`,
//! `a_wrong_prediction_is_reported`.

use super::adjust::{Adjusted, MatchedStar, adjust};
use super::background::{Background, RING_PX, ring};
use super::centroid::{Spot, SpotModel, centre_of_gravity, gaussian_fit};
use super::command::{is_read, window};
use super::detect::hot_share;
use super::guide::{Expected, GuideStars};
use super::params::{Reason, TrackerParams};
use base::axes::{Icrf, Rotation, Sensor};
use base::image::DnImage;
use base::region::{REGIONS_MAX, Region, Regions};
use glam::{DVec2, DVec3};

/// Stars searched in the first pass.
const SEARCHED: usize = 12;
/// Least height of a searched spot's 3 x 3 sum, in standard deviations of such a sum.
const SEARCH_SIGMA: f64 = 7.0;
/// Least flux of a measured spot, in its standard deviations.
const LEAST_FLUX_SIGMA: f64 = 5.0;
/// Furthest a peak may be from the common shift, px: rounding to pixels, and the prediction's error in roll.
const COMMON_SHIFT_PX: f64 = 2.0;
/// Peaks that vote for one star.
const MOST_PEAKS: usize = 3;
/// Least distance of two such peaks, px.
const PEAKS_APART_PX: f64 = 3.0;
/// Share of the searched stars that must be found.
const LEAST_SHARE: f64 = 0.34;
/// Furthest a spot of the second pass may be from its predicted place, px, besides 4 sigma.
const SECOND_PASS_PX: f64 = 0.3;

/// Where the sensor was and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Prediction {
    pub(super) attitude: Rotation<Sensor, Icrf>,
    /// Rate in sensor axes, rad/s.
    pub(super) rate_rad_s: DVec3,
    /// Velocity of the observer over c, ICRF axes.
    pub(super) beta: DVec3,
}

/// A place that may be an expected star.
#[derive(Debug, Clone, Copy)]
struct Peak {
    /// Place in the list of expected stars.
    expected: usize,
    place_px: DVec2,
    /// From the expected place.
    shift_px: DVec2,
    around: Background,
}

/// Follows stars; keeps its buffers.
#[derive(Debug, Clone)]
pub(super) struct Follower {
    expected: Vec<Expected>,
    peaks: Vec<Peak>,
    hot_share: f64,
    samples: Vec<u16>,
}

/// Pooled background statistics of the windows.
#[derive(Debug, Clone, Copy, Default)]
struct Pool {
    level_dn: f64,
    variance_dn2: f64,
    rings: f64,
}

impl Pool {
    fn add(&mut self, background: Background) {
        self.level_dn += background.level_dn;
        self.variance_dn2 += background.sigma_dn.powi(2);
        self.rings += 1.0;
    }

    fn mean(&self) -> Background {
        let rings = self.rings.max(1.0);
        Background { level_dn: self.level_dn / rings, sigma_dn: (self.variance_dn2 / rings).sqrt() }
    }
}

impl Follower {
    pub(super) fn new(params: &TrackerParams) -> Self {
        Self {
            expected: Vec::with_capacity(params.most_stars),
            peaks: Vec::with_capacity(SEARCHED * MOST_PEAKS),
            hot_share: hot_share(params.psf_sigma_px),
            samples: Vec::with_capacity(4096),
        }
    }

    /// Measures the predicted stars; `matches` then holds them, and the mean background is returned with the attitude.
    pub(super) fn follow(
        &mut self,
        params: &TrackerParams,
        guide: &GuideStars,
        (image, regions): (&DnImage, &Regions),
        prediction: &Prediction,
        matches: &mut Vec<MatchedStar>,
    ) -> Result<(Adjusted, f64), Reason> {
        matches.clear();
        self.list_expected(params, guide, prediction, &prediction.attitude);
        self.keep_read(params, regions, prediction, params.search_radius_px);
        let background = self.search(params, image, prediction).mean();
        refuse_bright(params, background.level_dn)?;
        self.measure_agreeing(params, image, prediction, matches);
        let wanted = LEAST_SHARE * self.expected.len().min(SEARCHED) as f64;
        if matches.len() < 3 || (matches.len() as f64) < wanted {
            return Err(Reason::TooFewStars);
        }
        let rough = adjust(&params.geometry, &prediction.attitude, matches, params.centroid_floor_px.max(0.02))
            .ok_or(Reason::NoMatch)?;
        self.list_expected(params, guide, prediction, &rough.attitude);
        self.keep_read(params, regions, prediction, 0.0);
        self.measure(params, image, prediction, background.sigma_dn, matches);
        if matches.len() < params.fewest_stars {
            return Err(Reason::TooFewStars);
        }
        let found = adjust(&params.geometry, &rough.attitude, matches, params.centroid_floor_px);
        found.map(|found| (found, background.level_dn)).ok_or(Reason::NoMatch)
    }

    fn list_expected(
        &mut self,
        params: &TrackerParams,
        guide: &GuideStars,
        prediction: &Prediction,
        attitude: &Rotation<Sensor, Icrf>,
    ) {
        let most = params.most_stars;
        guide.in_field(usize::MAX, most, attitude, prediction.beta, &params.geometry, &mut self.expected);
    }

    /// Leaves only the stars around which all was read out that is looked at when they are searched so far about their
    /// places.
    fn keep_read(&mut self, params: &TrackerParams, regions: &Regions, prediction: &Prediction, search_px: f64) {
        if !regions.is_whole() {
            let reach_px = |expected: &Expected| reach_px(params, prediction, expected, search_px);
            self.expected.retain(|expected| is_read(params, regions, expected.place_px, reach_px(expected)));
        }
    }

    /// Returns a window around each of the brightest stars at their predicted places.
    pub(super) fn windows(&mut self, params: &TrackerParams, guide: &GuideStars, prediction: &Prediction) -> Regions {
        self.list_expected(params, guide, prediction, &prediction.attitude);
        let mut list = [Region::default(); REGIONS_MAX];
        let of_star = |expected: &Expected| {
            window(params, expected.place_px, reach_px(params, prediction, expected, params.search_radius_px))
        };
        let windows = self.expected.iter().filter_map(of_star);
        let count = list.iter_mut().zip(windows).map(|(place, window)| *place = window).count();
        Regions::of(&list[..count]).unwrap_or(Regions::WHOLE)
    }

    /// Returns the first pass: peaks about the brightest stars, within the search radius.
    fn search(&mut self, params: &TrackerParams, image: &DnImage, prediction: &Prediction) -> Pool {
        let mut pool = Pool::default();
        self.peaks.clear();
        for (at, expected) in self.expected.iter().take(SEARCHED).enumerate() {
            let model = spot_model(params, trail_px(params, prediction, expected.apparent_icrf));
            let half_px = model.half_px() + to_index(params.search_radius_px);
            let Some(around) = ring_about(image, expected.place_px, half_px, &mut self.samples) else { continue };
            pool.add(around);
            let found = brightest(image, expected.place_px, params.search_radius_px, around, self.hot_share);
            for place_px in found.into_iter().flatten() {
                let shift_px = place_px - expected.place_px;
                self.peaks.push(Peak { expected: at, place_px, shift_px, around });
            }
        }
        pool
    }

    /// Measures the peaks that agree with the shift most stars agree on, one for each star.
    fn measure_agreeing(
        &self,
        params: &TrackerParams,
        image: &DnImage,
        prediction: &Prediction,
        matches: &mut Vec<MatchedStar>,
    ) {
        let agrees = |a: &Peak, b: &Peak| a.shift_px.distance(b.shift_px) < COMMON_SHIFT_PX;
        let votes = |peak: &Peak| self.peaks.iter().filter(|other| agrees(peak, other)).count();
        // The first of equals: the brightest star's brightest peak.
        let mut best: Option<(usize, &Peak)> = None;
        for peak in &self.peaks {
            let count = votes(peak);
            if best.is_none_or(|(most, _)| count > most) {
                best = Some((count, peak));
            }
        }
        let Some((_, common)) = best else { return };
        let mut last = usize::MAX;
        for peak in self.peaks.iter().filter(|peak| agrees(peak, common)) {
            if peak.expected == last {
                continue;
            }
            last = peak.expected;
            let expected = &self.expected[peak.expected];
            let mut model = spot_model(params, trail_px(params, prediction, expected.apparent_icrf));
            set_background(&mut model, peak.around);
            let start = centre_of_gravity(image, peak.place_px, &model).unwrap_or(peak.place_px);
            if let Some(spot) = gaussian_fit(image, start, &model).filter(is_sure) {
                matches.push(matched(expected, spot));
            }
        }
    }

    /// Makes the second pass: measures every star at its place.
    fn measure(
        &mut self,
        params: &TrackerParams,
        image: &DnImage,
        prediction: &Prediction,
        sigma_dn: f64,
        matches: &mut Vec<MatchedStar>,
    ) {
        matches.clear();
        for expected in &self.expected {
            let mut model = spot_model(params, trail_px(params, prediction, expected.apparent_icrf));
            let Some(around) = ring_about(image, expected.place_px, model.half_px(), &mut self.samples) else {
                continue;
            };
            set_background(&mut model, Background { level_dn: around.level_dn, sigma_dn });
            let Some(spot) = gaussian_fit(image, expected.place_px, &model).filter(is_sure) else { continue };
            let reach = SECOND_PASS_PX + 4.0 * spot.sigma_px();
            if spot.place_px.distance(expected.place_px) < reach {
                matches.push(matched(expected, spot));
            }
        }
    }
}

/// Returns how far from a star's place pixels are looked at, px: its spot, the ring around it, and where it is
/// searched.
fn reach_px(params: &TrackerParams, prediction: &Prediction, expected: &Expected, search_px: f64) -> f64 {
    let model = spot_model(params, trail_px(params, prediction, expected.apparent_icrf));
    (model.half_px() + RING_PX) as f64 + search_px
}

/// Returns the too bright a background hides the stars: more than 0.7 of the range above black.
pub(super) fn refuse_bright(params: &TrackerParams, level_dn: f64) -> Result<(), Reason> {
    let d = &params.detector;
    let share = (level_dn - d.black_level_dn) / (f64::from(d.saturation_dn) - d.black_level_dn);
    match share {
        share if share > 0.98 => Err(Reason::Saturated),
        share if share > 0.7 => Err(Reason::StrayLight),
        _ => Ok(()),
    }
}

fn is_sure(spot: &Spot) -> bool {
    spot.flux_e > LEAST_FLUX_SIGMA * spot.flux_sigma_e
}

fn matched(expected: &Expected, spot: Spot) -> MatchedStar {
    let Expected { star, apparent_icrf, place_px } = *expected;
    MatchedStar { star, apparent_icrf, spot, residual_px: spot.place_px - place_px, used: true }
}

/// Returns a star's way over the image during the exposure, px.
fn trail_px(params: &TrackerParams, prediction: &Prediction, apparent_icrf: DVec3) -> DVec2 {
    trail_of(params, prediction.rate_rad_s, prediction.attitude.apply(apparent_icrf))
}

/// Returns the way over the image, during an exposure, of a direction in sensor axes, px.
pub(super) fn trail_of(params: &TrackerParams, rate_rad_s: DVec3, direction: DVec3) -> DVec2 {
    let turn = rate_rad_s * params.exposure_s;
    params
        .geometry
        .pixel_and_turn(direction)
        .map_or(DVec2::ZERO, |(_, slope)| slope[0] * turn.x + slope[1] * turn.y + slope[2] * turn.z)
}

/// Returns the spot without its background.
pub(super) fn spot_model(params: &TrackerParams, trail_px: DVec2) -> SpotModel {
    let d = &params.detector;
    SpotModel {
        psf_sigma_px: params.psf_sigma_px,
        trail_px,
        gain_e_per_dn: d.gain_e_per_dn,
        background_dn: d.black_level_dn,
        background_sigma_e: d.read_noise_e_rms,
        prnu: params.prnu,
        saturation_dn: d.saturation_dn,
    }
}

pub(super) fn set_background(model: &mut SpotModel, background: Background) {
    model.background_dn = background.level_dn;
    model.background_sigma_e = background.sigma_dn * model.gain_e_per_dn;
}

/// Returns the ring about a place; `None` outside the image.
pub(super) fn ring_about(
    image: &DnImage,
    place_px: DVec2,
    half_px: usize,
    buffer: &mut Vec<u16>,
) -> Option<Background> {
    let last = DVec2::new(image.width() as f64 - 1.0, image.height() as f64 - 1.0);
    let place = place_px.round();
    if !(place.cmpge(DVec2::ZERO).all() && place.cmple(last).all()) {
        return None;
    }
    ring(image, to_index(place.x), to_index(place.y), half_px, buffer)
}

/// Returns the pixels within a radius whose 3 x 3 sums are largest and above the noise, brightest first; hot pixels are
/// skipped.
fn brightest(
    image: &DnImage,
    place_px: DVec2,
    radius_px: f64,
    around: Background,
    hot_share: f64,
) -> [Option<DVec2>; MOST_PEAKS] {
    let (width, height) = (image.width(), image.height());
    let low = (place_px - radius_px).round().max(DVec2::ONE);
    let high = (place_px + radius_px).round().min(DVec2::new(width as f64 - 2.0, height as f64 - 2.0));
    let columns = to_index(low.x)..to_index(high.x) + 1;
    let pixels = image.pixels();
    let mut best: [Option<(f64, DVec2)>; MOST_PEAKS] = [None; MOST_PEAKS];
    for y in to_index(low.y)..to_index(high.y) + 1 {
        for x in columns.clone() {
            let at = y * width + x;
            let sum_of = |at: usize| u32::from(pixels[at - 1]) + u32::from(pixels[at]) + u32::from(pixels[at + 1]);
            let sum = sum_of(at - width) + sum_of(at) + sum_of(at + width);
            let light = f64::from(sum) - 9.0 * around.level_dn;
            let own = f64::from(pixels[at]) - around.level_dn;
            // Pixels on a star's flank, and around a hot pixel, hold little of their neighbourhood.
            if light > SEARCH_SIGMA * 3.0 * around.sigma_dn && own > 0.1 * light && own < hot_share * light {
                offer(&mut best, light, DVec2::new(x as f64, y as f64));
            }
        }
    }
    best.map(|peak| peak.map(|(_, place)| place))
}

/// Puts a peak into a list of the brightest, in the place of a fainter one close to it.
fn offer(best: &mut [Option<(f64, DVec2)>; MOST_PEAKS], light: f64, place_px: DVec2) {
    let close = best.iter().position(|slot| slot.is_some_and(|(_, other)| other.distance(place_px) < PEAKS_APART_PX));
    let end = match close {
        Some(at) if best[at].is_some_and(|(other, _)| other >= light) => return,
        Some(at) => at,
        None => MOST_PEAKS - 1,
    };
    let rank = best[..end].iter().position(|slot| slot.is_none_or(|(other, _)| other < light)).unwrap_or(end);
    if best[rank..=end].iter().any(Option::is_none) || best[end].is_none_or(|(other, _)| other < light) {
        best[rank..=end].rotate_right(1);
        best[rank] = Some((light, place_px));
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates; places are on the image")]
fn to_index(value: f64) -> usize {
    value as usize
}
