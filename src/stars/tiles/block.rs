//! The stars of one tile as frames want them: everything about a star that does not change from frame to frame.

use crate::layer::{LayerError, LayerSet, TileId};
use crate::numbering::stored_number;
use base::source::CatalogSource;
use base::units::MAS;
use core::fmt;
use glam::DVec3;
use std::sync::Arc;

/// A star of a tile: 64 bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileStar {
    /// Barycentric direction at the layers' epoch, unit vector, ICRF axes.
    pub direction_icrf: DVec3,
    /// Electrons it leaves in one exposure.
    pub electrons: f64,
    /// How its direction changes, rad per Julian year, ICRF axes: zero when it is unknown.
    pub rate_icrf: [f32; 3],
    /// Parallax, rad: zero when it is unknown.
    pub parallax_rad: f32,
    /// Its number in its source catalog as its layer stores it; [`NO_NUMBER`](crate::numbering::NO_NUMBER) when it has
    /// none.
    pub number: i64,
    /// Number of the star among the layers' stars.
    pub id: u32,
    /// Magnitude in the instrument's band.
    pub mag: f32,
}

/// G and BP - RP -> electrons in one exposure, and magnitude in the instrument's band.
#[derive(Clone)]
pub struct Light(Arc<dyn Fn(f32, f32) -> (f64, f32) + Send + Sync>);

impl Light {
    /// By this law.
    pub fn new(law: impl Fn(f32, f32) -> (f64, f32) + Send + Sync + 'static) -> Self {
        Self(Arc::new(law))
    }
}

impl fmt::Debug for Light {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Light")
    }
}

/// Turns tiles of a file into stars for frames; its buffers are used again.
#[derive(Debug)]
pub(super) struct Decoder {
    layers: Arc<LayerSet>,
    light: Light,
    bytes: Vec<u8>,
    stars: Vec<CatalogSource>,
}

impl Decoder {
    pub(super) fn new(layers: Arc<LayerSet>, light: Light) -> Self {
        Self { layers, light, bytes: Vec::new(), stars: Vec::new() }
    }

    /// Replaces `block` by the stars of a tile that are not too faint, brightest first.
    ///
    /// # Errors
    /// When the tile cannot be read or is damaged.
    pub(super) fn read(&mut self, tile: TileId, block: &mut Vec<TileStar>) -> Result<(), LayerError> {
        self.stars.clear();
        self.layers.read(tile, &mut self.bytes, &mut self.stars)?;
        block.clear();
        block.reserve_exact(self.stars.len());
        block.extend(self.stars.iter().map(|star| tile_star(star, &self.light)));
        Ok(())
    }
}

#[allow(clippy::cast_possible_truncation, reason = "rates and parallaxes to 1e-7 of themselves")]
fn tile_star(star: &CatalogSource, light: &Light) -> TileStar {
    let (electrons, mag) = (light.0)(star.mag_g, star.bp_rp);
    let direction = star.direction_icrf;
    let east = DVec3::new(-direction.y, direction.x, 0.0).normalize_or_zero();
    let north = direction.cross(east);
    let rate = star.proper_motion.map_or(DVec3::ZERO, |motion| {
        let across = east * f64::from(motion.pm_ra_cosdec_mas_yr) + north * f64::from(motion.pm_dec_mas_yr);
        (across + direction * f64::from(motion.radial_mas_yr)) * MAS
    });
    TileStar {
        direction_icrf: direction,
        electrons,
        rate_icrf: rate.as_vec3().to_array(),
        parallax_rad: (f64::from(star.parallax_mas.unwrap_or(0.0)) * MAS) as f32,
        number: stored_number(star.source_id),
        id: star.id,
        mag,
    }
}
