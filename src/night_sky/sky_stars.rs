//! Stars of the catalog -> where they are seen at a time, and those of one field.

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
