//! Catalog, epoch -> the guide stars a tracker knows the sky by, brightest first, with their pair index.
//!
//! * proper motion carries each star to the epoch, linearly (for 60 years and the fastest star within 0.1 arcsec);
//! * a star with a brighter neighbour in its spot is left out; a fainter neighbour pulls the spot's centre ([`Blend`]).
//!   That pull is added to the star's place when it is small or the two are merged; otherwise the star is left out;
//! * the brightest stars, [`PATTERN_STARS_PER_FIELD`] to a field on average, are the pattern stars, whose pairs are
//!   indexed.
//!
//! Parallax is left out: 0.77 arcsec for the nearest star, below 0.1 arcsec for all but some 300 guide stars. Tests:
//! `doubles_are_merged_or_left_out`, `proper_motion_is_carried`, `fields_have_pattern_stars`.
//!
//! Directions of pattern stars -> every pair within the field, found by its angle.
//!
//! The k-vector of Mortari & Neta, "k-vector range searching techniques", AAS 00-128 (2000): pairs are sorted by angle,
//! and a straight line from the least to the largest angle gives, for each of its steps, how many pairs lie below. A
//! range of angles is then read off without a search. Test: `pair_ranges_agree_with_brute_force`.
//!
//! Velocity of the observer -> apparent directions; time -> velocity of the Earth.
//!
//! Aberration: the relativistic addition of velocities (Urban & Seidelmann, *Explanatory Supplement to the
//! Astronomical Almanac*, 3rd ed. 2013, eq. 7.38), complete, so its own error is rounding. Earth: the low-precision Sun
//! of the *Astronomical Almanac*, section C ("low precision formulas for the Sun", 0.01 deg in 1950..2050), with the
//! longitude carried back from the equinox of date to J2000.0 and differentiated. Left out: the Sun about the
//! barycentre (13 m/s), the Earth about the Earth-Moon barycentre (12 m/s), together below 0.02 arcsec; light
//! deflection (4 mas at 90 degrees from the Sun). Test: `earth_velocity_gives_the_published_aberration`.

use crate::{tracker::centroid::Blend, tracker::geometry::Geometry, tracker::params::TrackerParams};
use base::axes::{Icrf, Rotation, Sensor};
use base::units::{AU_KM, DAY_S, DEG, MAS, SPEED_OF_LIGHT_KM_S};
use base::{refused::Refused, source::CatalogSource, time::Tai};
use core::f64::consts::PI;
use glam::{DVec2, DVec3};
use stars::catalog::Catalog;

/// Mean number of pattern stars in a field; the emptiest fields have about a third of it.
const PATTERN_STARS_PER_FIELD: f64 = 28.0;
/// Most pattern stars: bounds the pair index of narrow fields.
const MOST_PATTERN_STARS: usize = 12_000;
/// Fewest guide stars of the whole sky that make a tracker.
const FEWEST_GUIDE_STARS: usize = 100;
/// Neighbours fainter than a guide star by more than this pull it by less than 0.02 spot widths, mag.
const FAINTEST_NEIGHBOUR_MAG: f64 = 4.0;
/// Reach of a neighbour, in spot widths: the window and half a spot more.
const BLEND_SIGMA: f64 = 5.0;
/// Largest sum of pulls that is corrected, px: first order and the guessed flux leave a fifth of it.
const MOST_PULL_PX: f64 = 0.03;
/// Distance within which two stars count as one spot, px: there the formula is exact to first order.
const MERGED_PX: f64 = 0.5;
/// Most that merged neighbours add to a star's brightness, mag.
const MERGER_MAG: f64 = 1.0;
/// Width added to the field's cone for aberration, rad.
const CONE_MARGIN_RAD: f64 = 2e-4;

/// One guide star.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuideStar {
    /// Row of the catalog.
    pub id: u32,
    /// Barycentric direction at the epoch, unit vector, ICRF axes.
    pub direction_icrf: DVec3,
    /// Gaia G magnitude.
    pub mag_g: f64,
}

/// A guide star where an attitude puts it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Expected {
    /// Place in the guide list.
    pub(super) star: usize,
    /// Apparent direction, ICRF axes.
    pub(super) apparent_icrf: DVec3,
    /// Place, px.
    pub(super) place_px: DVec2,
}

/// The guide stars of one camera at one epoch, brightest first; shared by heads of the same design.
#[derive(Debug, Clone)]
pub struct GuideStars {
    /// All guide stars, brightest first.
    pub stars: Vec<GuideStar>,
    /// The apparent directions of the pattern stars for the observer of [`Self::pattern_beta`].
    pub(super) pattern_directions: Vec<DVec3>,
    pub(super) pattern_beta: DVec3,
    pub(super) pairs: PairIndex,
    cone_cos: f64,
}

impl GuideStars {
    /// Chooses and moves the stars, and indexes the pairs of the brightest.
    ///
    /// # Errors
    /// When a parameter is out of range or the catalog has too few stars above the limiting magnitude.
    pub fn new(catalog: &Catalog, params: &TrackerParams, epoch: Tai) -> Result<Self, Refused> {
        params.check()?;
        let years = epoch.years_since_j2000() + 2000.0 - catalog.index().epoch_yr;
        let mut stars = guide_stars(catalog, params, years);
        if stars.len() < FEWEST_GUIDE_STARS {
            let (wanted, got) = (FEWEST_GUIDE_STARS, stars.len());
            return Err(Refused(format!(
                "guide stars brighter than G {limiting_mag}: wanted at least {wanted}, got {got}; raise limiting_mag",
                limiting_mag = params.limiting_mag
            )));
        }
        stars.sort_unstable_by(|a, b| a.mag_g.total_cmp(&b.mag_g).then(a.id.cmp(&b.id)));
        let corner_rad = params.geometry.corner_rad();
        let pattern_beta = earth_beta(epoch);
        let pattern = &stars[..pattern_count(&params.geometry).min(stars.len())];
        let pattern_directions: Vec<_> = pattern.iter().map(|s| apparent(s.direction_icrf, pattern_beta)).collect();
        let shortest_rad = 2.0 * MERGED_PX.max(params.psf_sigma_px * BLEND_SIGMA) * params.geometry.ifov_rad();
        let pairs = PairIndex::new(&pattern_directions, shortest_rad, (2.0 * corner_rad).min(PI));
        let cone_cos = (corner_rad + CONE_MARGIN_RAD).cos();
        Ok(Self { stars, pattern_directions, pattern_beta, pairs, cone_cos })
    }

    /// Returns how many of them, the brightest, are in the pair index.
    pub fn pattern_stars(&self) -> usize {
        self.pattern_directions.len()
    }

    /// Replaces `out` by the brightest `most` of the first `among` stars on the image, brightest first.
    pub(super) fn in_field(
        &self,
        among: usize,
        most: usize,
        attitude: &Rotation<Sensor, Icrf>,
        beta: DVec3,
        geometry: &Geometry,
        out: &mut Vec<Expected>,
    ) {
        out.clear();
        let boresight = attitude.inverse().apply(DVec3::Z);
        for (star, guide) in self.stars.iter().take(among).enumerate() {
            if guide.direction_icrf.dot(boresight) < self.cone_cos {
                continue;
            }
            let apparent_icrf = apparent(guide.direction_icrf, beta);
            let place = geometry.pixel(attitude.apply(apparent_icrf)).filter(|place| geometry.holds(*place, 0.0));
            if let Some(place_px) = place {
                out.push(Expected { star, apparent_icrf, place_px });
                if out.len() == most {
                    return;
                }
            }
        }
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
fn pattern_count(geometry: &Geometry) -> usize {
    let fields = 4.0 * PI / geometry.field_sr();
    (PATTERN_STARS_PER_FIELD * fields).clamp(50.0, MOST_PATTERN_STARS as f64) as usize
}

fn guide_stars(catalog: &Catalog, params: &TrackerParams, years: f64) -> Vec<GuideStar> {
    let faintest = params.limiting_mag + FAINTEST_NEIGHBOUR_MAG;
    let mut stars: Vec<_> = catalog
        .sources()
        .iter()
        .filter(|source| f64::from(source.mag_g) <= faintest)
        .map(|source| GuideStar { id: source.id, direction_icrf: moved(source, years), mag_g: f64::from(source.mag_g) })
        .collect();
    stars.sort_unstable_by(|a, b| a.direction_icrf.z.total_cmp(&b.direction_icrf.z).then(a.id.cmp(&b.id)));
    let pixel_rad = params.geometry.ifov_rad();
    let reach_rad = BLEND_SIGMA * params.pixel_psf_sigma_px() * pixel_rad;
    let spot = SpotOnSky { blend: Blend::new(params), reach_rad, pixel_rad };
    (0..stars.len()).filter_map(|at| spot.photocentre(&stars, at, params.limiting_mag)).collect()
}

/// Returns a source's direction `years` after the catalog's epoch.
fn moved(source: &CatalogSource, years: f64) -> DVec3 {
    let at = source.direction_icrf;
    let (Some(motion), Some(east)) = (source.proper_motion, DVec3::Z.cross(at).try_normalize()) else { return at };
    let north = at.cross(east);
    let across_mas_yr = east * f64::from(motion.pm_ra_cosdec_mas_yr) + north * f64::from(motion.pm_dec_mas_yr);
    let rate_mas_yr = across_mas_yr + at * f64::from(motion.radial_mas_yr);
    (at + rate_mas_yr * (years * MAS)).normalize()
}

struct SpotOnSky {
    blend: Blend,
    reach_rad: f64,
    pixel_rad: f64,
}

impl SpotOnSky {
    /// Returns the star `at` of a list sorted by z, where its spot's centre lies, or `None` when it cannot serve.
    fn photocentre(&self, stars: &[GuideStar], at: usize, limiting_mag: f64) -> Option<GuideStar> {
        let star = stars[at];
        if star.mag_g > limiting_mag + MERGER_MAG {
            return None;
        }
        let (mut pull, mut unsure_px, mut flux) = (DVec3::ZERO, 0.0, 1.0);
        let near_in_z = |other: &&GuideStar| (other.direction_icrf.z - star.direction_icrf.z).abs() <= self.reach_rad;
        let before = stars[..at].iter().rev().take_while(near_in_z);
        for other in before.chain(stars[at + 1..].iter().take_while(near_in_z)) {
            let apart = other.direction_icrf - star.direction_icrf;
            let distance = apart.length();
            if distance > self.reach_rad {
                continue;
            }
            let ratio = 10f64.powf(-0.4 * (other.mag_g - star.mag_g));
            let distance_px = distance / self.pixel_rad;
            // Within half the reach a brighter star pulls by 0.2 px and more: no need of the sum.
            if (other.mag_g, other.id) < (star.mag_g, star.id) && distance < 0.5 * self.reach_rad {
                return None;
            }
            let pull_px = self.blend.pull_px(star.mag_g, ratio, distance_px);
            if distance_px < MERGED_PX {
                flux += ratio;
            } else {
                unsure_px += pull_px;
            }
            if unsure_px > MOST_PULL_PX {
                return None;
            }
            pull += pull_px / distance_px.max(f64::MIN_POSITIVE) * apart;
        }
        let mag_g = star.mag_g - 2.5 * flux.log10();
        (mag_g <= limiting_mag).then(|| GuideStar {
            id: star.id,
            direction_icrf: (star.direction_icrf + pull).normalize(),
            mag_g,
        })
    }
}

/// All pairs of a list of directions in a range of angles, sorted by angle.
#[derive(Debug, Clone)]
pub(super) struct PairIndex {
    angles_rad: Vec<f64>,
    stars: Vec<[u32; 2]>,
    below: Vec<u32>,
    first_rad: f64,
    step_rad: f64,
}

impl PairIndex {
    /// Indexes the pairs with angles from `shortest_rad` to `longest_rad`.
    pub(super) fn new(directions: &[DVec3], shortest_rad: f64, longest_rad: f64) -> Self {
        let mut pairs = collect(directions, shortest_rad, longest_rad);
        pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let angles_rad: Vec<f64> = pairs.iter().map(|pair| pair.0).collect();
        let stars = pairs.into_iter().map(|pair| pair.1).collect();
        let (first_rad, last_rad) = (shortest_rad, longest_rad);
        let steps = angles_rad.len().max(1);
        let step_rad = (last_rad - first_rad).max(f64::MIN_POSITIVE) / steps as f64;
        let mut below = Vec::with_capacity(steps + 1);
        let mut count = 0_usize;
        for step in 0..=steps {
            let line = first_rad + step as f64 * step_rad;
            while angles_rad.get(count).is_some_and(|angle| *angle < line) {
                count += 1;
            }
            below.push(u32::try_from(count).unwrap_or(u32::MAX));
        }
        Self { angles_rad, stars, below, first_rad, step_rad }
    }

    /// Returns the pairs whose angle is within `tolerance_rad` of `angle_rad`.
    pub(super) fn within(&self, angle_rad: f64, tolerance_rad: f64) -> &[[u32; 2]] {
        let (low, high) = (angle_rad - tolerance_rad, angle_rad + tolerance_rad);
        let mut start = self.line_below(low);
        while self.angles_rad.get(start).is_some_and(|angle| *angle < low) {
            start += 1;
        }
        let mut end = self.line_below(high).max(start);
        while self.angles_rad.get(end).is_some_and(|angle| *angle <= high) {
            end += 1;
        }
        &self.stars[start..end]
    }

    /// Returns how many pairs certainly lie below an angle.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the line's steps")]
    fn line_below(&self, angle_rad: f64) -> usize {
        let last = self.below.len() - 1;
        // One step down: rounding of the line must not skip a pair.
        let step = ((angle_rad - self.first_rad) / self.step_rad - 1.0).clamp(0.0, last as f64) as usize;
        self.below[step] as usize
    }
}

fn collect(directions: &[DVec3], shortest_rad: f64, longest_rad: f64) -> Vec<(f64, [u32; 2])> {
    let chord2 = |angle: f64| 4.0 * (angle / 2.0).sin().powi(2);
    let (shortest2, longest2) = (chord2(shortest_rad), chord2(longest_rad));
    let mut pairs = Vec::new();
    for (a, one) in (0_u32..).zip(directions) {
        for (b, other) in (a + 1..).zip(&directions[a as usize + 1..]) {
            let distance2 = one.distance_squared(*other);
            if (shortest2..=longest2).contains(&distance2) {
                pairs.push((angle_of_chord(distance2.sqrt()), [a, b]));
            }
        }
    }
    pairs
}

/// Returns the angle between unit vectors a chord apart, rad: exact for small angles, unlike the arc cosine.
pub(super) fn angle_of_chord(chord: f64) -> f64 {
    2.0 * (0.5 * chord).min(1.0).asin()
}

/// General precession in longitude, deg per day: 50.2880 arcsec per Julian year (IAU 2006, Capitaine et al. 2003).
const PRECESSION_DEG_D: f64 = 50.2880 / 3600.0 / 365.25;
/// Obliquity of the ecliptic at J2000.0, deg (IAU 2006: 84381.406 arcsec).
const OBLIQUITY_DEG: f64 = 84381.406 / 3600.0;

/// Returns the apparent unit direction (ICRF axes) of a unit direction, for an observer with the velocity `beta` = v/c
/// (ICRF axes, with respect to the barycentre).
pub fn apparent(direction: DVec3, beta: DVec3) -> DVec3 {
    let inverse_lorentz = (1.0 - beta.length_squared()).max(0.0).sqrt();
    let along = direction.dot(beta);
    let sum = direction * inverse_lorentz + beta * (1.0 + along / (1.0 + inverse_lorentz));
    (sum / (1.0 + along)).normalize()
}

/// Returns the error, about x and y of the sensor, of an attitude that knows nothing of aberration; `beta` in sensor axes.
/// Directions near the boresight move by `beta` across it, and the frame that holds them fixed turns the other way.
pub fn uncorrected_turn(beta: DVec3) -> DVec3 {
    DVec3::new(beta.y, -beta.x, 0.0)
}

/// Returns the velocity of the Earth's centre about the Sun over the speed of light, ICRF axes; error below 0.1 arcsec
/// (5e-7).
pub fn earth_beta(at: Tai) -> DVec3 {
    let days = at.days_tdb_since_j2000();
    let anomaly_rate = 0.985_600_3 * DEG;
    let anomaly = 357.528 * DEG + anomaly_rate * days;
    let mean_longitude = 280.460 + (0.985_647_4 - PRECESSION_DEG_D) * days;
    let (sin_g, cos_g) = anomaly.sin_cos();
    let (sin_2g, cos_2g) = (2.0 * anomaly).sin_cos();
    let longitude = (mean_longitude + 1.915 * sin_g + 0.020 * sin_2g) * DEG;
    let longitude_rate = (0.985_647_4 - PRECESSION_DEG_D) * DEG + (1.915 * cos_g + 0.040 * cos_2g) * DEG * anomaly_rate;
    let radius_au = 1.000_14 - 0.016_71 * cos_g - 0.000_14 * cos_2g;
    let radius_rate = (0.016_71 * sin_g + 0.000_28 * sin_2g) * anomaly_rate;
    // The Earth is opposite the Sun.
    let (sin_l, cos_l) = longitude.sin_cos();
    let velocity_au_d = -DVec3::new(
        radius_rate * cos_l - radius_au * longitude_rate * sin_l,
        radius_rate * sin_l + radius_au * longitude_rate * cos_l,
        0.0,
    );
    let (sin_e, cos_e) = (OBLIQUITY_DEG * DEG).sin_cos();
    let equatorial = DVec3::new(velocity_au_d.x, velocity_au_d.y * cos_e, velocity_au_d.y * sin_e);
    equatorial * (AU_KM / DAY_S / SPEED_OF_LIGHT_KM_S)
}
