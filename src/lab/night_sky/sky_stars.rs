//! Stars of the catalog -> where they are seen at a time, those of one field where a geometry puts them, and those that a
//! geometry is fitted to.

use crate::geometry::{Geometry, Tie};
use crate::{detect::Detection, measure::Spot};
use base::{refused::Refused, source::CatalogSource, source_id::SourceId, time::Tai};
use glam::DVec3;
use sky::astrometry::{ApparentPlaces, Vantage};
use sky::observer::{Observer, ObserverTrack};
use stars::Sky;

/// A star as it is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyStar {
    /// Its number among the catalog's stars.
    pub id: u32,
    /// Its name in its source catalog.
    pub name: Option<SourceId>,
    /// Apparent direction, unit vector, ICRF axes.
    pub direction: DVec3,
    /// Gaia G.
    pub mag_g: f64,
    /// Gaia BP - RP.
    pub bp_rp: f64,
}

/// Where and when stars are looked at.
#[derive(Debug, Clone)]
pub struct When {
    /// Middle of the exposure; without one, the catalog's directions at its own epoch are taken as they are.
    pub at: Option<Tai>,
    /// Julian year of the catalog.
    pub epoch_yr: f64,
}

/// TAI of J2000.0 as it matters here: a year has this many seconds.
const JULIAN_YEAR_S: f64 = 365.25 * 86_400.0;

impl When {
    /// Returns the time: that of the exposure, or the catalog's epoch.
    pub fn time(&self) -> Tai {
        self.at.unwrap_or_else(|| {
            let zero = Tai::from_unix_ns(0);
            zero + base::time::Span::from_s((self.epoch_yr - 2000.0 - zero.years_since_j2000()) * JULIAN_YEAR_S)
        })
    }

    /// Returns who looks: from the Earth at a known time, else from the barycentre, which has no aberration.
    pub fn observer(&self) -> Observer {
        if self.at.is_some() { Observer::Geocentre } else { Observer::Barycentre }
    }

    /// Returns what moves the stars of the catalog to where they are seen.
    ///
    /// # Errors
    /// When the Earth's place cannot be computed.
    pub fn places(&self) -> Result<ApparentPlaces, Refused> {
        let at = self.time();
        let vantage = Vantage::of(&ObserverTrack::new(self.observer(), at), at, true)?;
        Ok(ApparentPlaces::new(self.epoch_yr, at, &vantage))
    }
}

/// Returns a source of the catalog as it is seen.
pub fn seen(source: &CatalogSource, places: &ApparentPlaces) -> SkyStar {
    SkyStar {
        id: source.id,
        name: source.source_id,
        direction: places.of(source).normalize(),
        mag_g: f64::from(source.mag_g),
        bp_rp: f64::from(source.bp_rp),
    }
}

/// Returns the stars within `radius_rad` of `axis`, brightest first.
///
/// # Errors
/// When a tile of a layer cannot be read.
pub fn of_field(sky: &Sky, places: &ApparentPlaces, axis: DVec3, radius_rad: f64) -> Result<Vec<SkyStar>, Refused> {
    let (mut tiles, mut bytes, mut sources) = (Vec::new(), Vec::new(), Vec::new());
    // Aberration and proper motion move stars by less than this.
    let margin_rad = 1e-3;
    sky.layers.tiles_of_cone(axis, radius_rad + margin_rad, &mut tiles);
    for tile in tiles {
        sky.layers.read(tile, &mut bytes, &mut sources)?;
    }
    let mut stars: Vec<SkyStar> = sources.iter().map(|source| seen(source, places)).collect();
    stars.retain(|star| star.direction.dot(axis) >= radius_rad.cos());
    stars.sort_by(|a, b| a.mag_g.total_cmp(&b.mag_g));
    Ok(stars)
}

/// Most stars that are measured: of deep layers the brightest.
const MOST_STARS: usize = 4000;
/// Stars of the catalog so near are one star for the image, px.
const MERGED_PX: f64 = 1.6;
/// Another star so near, with this share of the light, is in a star's pixels.
const BLEND_PX: f64 = 6.0;
const BLEND_SHARE: f64 = 0.05;
/// Least SNR of the stars that the geometry is fitted to.
pub(crate) const TIE_SNR: f64 = 10.0;
/// Error of the places of stars besides noise, px.
const PLACE_FLOOR_PX: f64 = 0.03;

/// A star of the field, where the geometry puts it.
#[derive(Debug, Clone)]
pub(crate) struct FieldStar {
    pub star: SkyStar,
    pub px: [f64; 2],
    /// Numbers of the catalog's stars that it is made of.
    pub members: Vec<u32>,
    pub is_blended: bool,
}

/// Returns the stars on the image, brightest first; stars that the image cannot separate as one.
pub(crate) fn on_image(stars: Vec<SkyStar>, geometry: &Geometry) -> Vec<FieldStar> {
    let mut field: Vec<FieldStar> = Vec::new();
    for star in stars.into_iter().take(MOST_STARS) {
        let Some(px) = geometry.place(star.direction) else { continue };
        match field.iter_mut().find(|other| (other.px[0] - px[0]).hypot(other.px[1] - px[1]) < MERGED_PX) {
            Some(other) => merge(other, &star, px),
            None => field.push(FieldStar { star, px, members: vec![star.id], is_blended: false }),
        }
    }
    let lights: Vec<([f64; 2], f64)> = field.iter().map(|one| (one.px, 10_f64.powf(-0.4 * one.star.mag_g))).collect();
    for (i, one) in field.iter_mut().enumerate() {
        let disturbs = |(k, (px, light)): (usize, &([f64; 2], f64))| {
            k != i && (px[0] - one.px[0]).hypot(px[1] - one.px[1]) < BLEND_PX && *light > BLEND_SHARE * lights[i].1
        };
        one.is_blended = lights.iter().enumerate().any(disturbs);
    }
    field
}

/// Adds a star to one that the image cannot separate from it.
fn merge(one: &mut FieldStar, other: &SkyStar, px: [f64; 2]) {
    let light = |mag: f64| 10_f64.powf(-0.4 * mag);
    let [a, b] = [one.star.mag_g, other.mag_g].map(light);
    let share = b / (a + b);
    one.star.direction = one.star.direction.lerp(other.direction, share).normalize();
    one.star.bp_rp += share * (other.bp_rp - one.star.bp_rp);
    one.star.mag_g = -2.5 * (a + b).log10();
    one.px = [0, 1].map(|i| one.px[i] + share * (px[i] - one.px[i]));
    one.members.push(other.id);
}

/// Returns detections with the stars of the field near them.
pub(crate) fn ties_of_detections(field: &[FieldStar], found: &[Detection], radius_px: f64) -> Vec<Tie> {
    let mut ties = Vec::new();
    for detection in found {
        let distance = |one: &FieldStar| (one.px[0] - detection.px[0]).hypot(one.px[1] - detection.px[1]);
        let nearest = field.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let near = nearest.filter(|one| distance(one) < radius_px);
        let error_px = (1.0 / detection.sigma).hypot(0.05);
        ties.extend(near.map(|one| Tie { direction: one.star.direction, px: detection.px, error_px }));
    }
    ties
}

/// Returns the measured stars that a geometry is fitted to.
pub(crate) fn ties_of_spots(field: &[FieldStar], spots: &[Option<Spot>]) -> Vec<Tie> {
    let of = |(one, spot): (&FieldStar, &Option<Spot>)| {
        let spot = spot
            .as_ref()
            .filter(|spot| spot.is_placed && spot.snr() > TIE_SNR && !spot.is_saturated && !one.is_blended)?;
        Some(Tie { direction: one.star.direction, px: spot.px, error_px: spot.place_error_px.hypot(PLACE_FLOOR_PX) })
    };
    field.iter().zip(spots).filter_map(of).collect()
}
