//! The stars of one tile as frames want them: everything about a star that does not change from frame to frame.

use crate::layer::{LayerSet, TileId};
use crate::numbering::stored_number;
use base::refused::Refused;
use base::source::{CatalogSource, ProperMotion};
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
    /// Proper motion: zero when it is unknown.
    pub motion: ProperMotion,
    /// Parallax, mas: zero when it is unknown.
    pub parallax_mas: f32,
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
    /// Makes the light of stars by this law of magnitude and colour.
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
    pub(super) fn read(&mut self, tile: TileId, block: &mut Vec<TileStar>) -> Result<(), Refused> {
        self.stars.clear();
        self.layers.read(tile, &mut self.bytes, &mut self.stars)?;
        block.clear();
        block.reserve_exact(self.stars.len());
        block.extend(self.stars.iter().map(|star| tile_star(star, &self.light)));
        Ok(())
    }
}

fn tile_star(star: &CatalogSource, light: &Light) -> TileStar {
    let (electrons, mag) = (light.0)(star.mag_g, star.bp_rp);
    TileStar {
        direction_icrf: star.direction_icrf,
        electrons,
        motion: star.proper_motion.unwrap_or_default(),
        parallax_mas: star.parallax_mas.unwrap_or(0.0),
        number: stored_number(star.source_id),
        id: star.id,
        mag,
    }
}
