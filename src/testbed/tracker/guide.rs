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

use super::aberration::{apparent, earth_beta};
use super::{blend::Blend, geometry::Geometry, pairs::PairIndex, params::TrackerParams};
use base::axes::{Icrf, Rotation, Sensor};
use base::{refused::Refused, source::CatalogSource, time::Tai, units::MAS};
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
    stars: Vec<GuideStar>,
    pattern_directions: Vec<DVec3>,
    pattern_beta: DVec3,
    pairs: PairIndex,
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

    /// Returns all guide stars, brightest first.
    pub fn stars(&self) -> &[GuideStar] {
        &self.stars
    }

    /// Returns how many of them, the brightest, are in the pair index.
    pub fn pattern_stars(&self) -> usize {
        self.pattern_directions.len()
    }

    pub(super) fn pairs(&self) -> &PairIndex {
        &self.pairs
    }

    /// Returns the apparent directions of the pattern stars for the observer of [`Self::pattern_beta`].
    pub(super) fn pattern_directions(&self) -> &[DVec3] {
        &self.pattern_directions
    }

    pub(super) fn pattern_beta(&self) -> DVec3 {
        self.pattern_beta
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
