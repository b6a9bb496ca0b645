//! Layers that join at their magnitudes -> one sky, read tile by tile.
//!
//! Each layer must begin at the magnitude at which the one before ends, so that no star comes twice and none is missing;
//! all are of one epoch. A star's `id` is its place in its layer after the stars of the layers before. Layers that begin
//! beyond the limiting magnitude are left closed. Tests: `tests`.

use super::cover::cells_of_cone;
use super::error::LayerError;
use super::layout::tiles_of;
use super::open::Layer;
use base::source::CatalogSource;
use base::units::MAS;
use glam::DVec3;
use std::path::PathBuf;

/// Added to a cone: stars at a cell's edge may be stored half a step beyond it, rad.
pub(super) const ROUNDING_RAD: f64 = MAS;

/// A tile of one of the layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileId {
    /// Which layer, from the brightest.
    pub layer: u8,
    /// HEALPix cell of the layer's order, nested.
    pub tile: u32,
}

/// Layers of one sky.
#[derive(Debug)]
pub struct LayerSet {
    layers: Vec<Layer>,
    limiting_mag: f32,
    /// Number of the first star of each layer.
    first_ids: Vec<u32>,
    crc32: u32,
    credits: String,
}

impl LayerSet {
    /// Opens the layers in any order, for stars not fainter than `limiting_mag` (Gaia G).
    ///
    /// # Errors
    /// When a layer cannot be read or is damaged at its head, they do not join, their epochs differ, or none is so bright.
    pub fn open(paths: &[PathBuf], limiting_mag: f32) -> Result<Self, LayerError> {
        let mut layers = paths.iter().map(|path| Layer::open(path)).collect::<Result<Vec<_>, _>>()?;
        layers.sort_by(|a, b| a.magnitudes()[0].total_cmp(&b.magnitudes()[0]));
        for pair in layers.windows(2) {
            let (below, from) = (pair[0].magnitudes()[1], pair[1].magnitudes()[0]);
            if (below - from).abs() > 0.0 {
                return Err(LayerError::Joint { path: pair[1].path().into(), below, from });
            }
            let (wanted, got) = (pair[0].epoch_yr(), pair[1].epoch_yr());
            if (wanted - got).abs() > 0.0 {
                return Err(LayerError::Epochs { path: pair[1].path().into(), wanted, got });
            }
        }
        match layers.first() {
            None => return Err(LayerError::NoLayer),
            Some(first) if first.magnitudes()[0] > limiting_mag => {
                let [from, _] = first.magnitudes();
                return Err(LayerError::NoneSoBright { path: first.path().into(), from, limiting_mag });
            }
            Some(_) => {}
        }
        layers.retain(|layer| layer.magnitudes()[0] <= limiting_mag);
        let (mut first_ids, mut next) = (Vec::with_capacity(layers.len()), 0_u64);
        let mut crc = crc32fast::Hasher::new();
        let mut credits: Vec<&str> = Vec::new();
        for layer in &layers {
            #[allow(clippy::cast_possible_truncation, reason = "numbers tell stars of one field apart: they may wrap")]
            first_ids.push(next as u32);
            next += layer.stars();
            crc.update(&layer.crc32().to_le_bytes());
            if !layer.credits().is_empty() && !credits.contains(&layer.credits()) {
                credits.push(layer.credits());
            }
        }
        let credits = credits.join(" ");
        Ok(Self { limiting_mag, first_ids, crc32: crc.finalize(), credits, layers })
    }

    /// The layers, brightest first.
    #[must_use]
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Faintest stars that are read, Gaia G.
    #[must_use]
    pub fn limiting_mag(&self) -> f32 {
        self.limiting_mag
    }

    /// Magnitude from which stars are there: the begin of the brightest layer; minus infinity when no bright star is missing.
    #[must_use]
    pub fn from_mag(&self) -> f32 {
        self.layers.first().map_or(f32::INFINITY, |layer| layer.magnitudes()[0])
    }

    /// Magnitude below which all stars are: the end of the faintest layer.
    #[must_use]
    pub fn below_mag(&self) -> f32 {
        self.layers.last().map_or(f32::NEG_INFINITY, |layer| layer.magnitudes()[1])
    }

    /// Julian year to which the positions refer.
    #[must_use]
    pub fn epoch_yr(&self) -> f64 {
        self.layers.first().map_or(f64::NAN, Layer::epoch_yr)
    }

    /// No star is faster, mas/yr.
    #[must_use]
    pub fn fastest_mas_yr(&self) -> f64 {
        self.layers.iter().map(Layer::fastest_mas_yr).fold(0.0, f64::max)
    }

    /// Fingerprint of all layers.
    #[must_use]
    pub fn crc32(&self) -> u32 {
        self.crc32
    }

    /// Credits their stars ask for, each once.
    #[must_use]
    pub fn credits(&self) -> &str {
        &self.credits
    }

    /// Replaces `tiles` by those with stars that may lie within `radius_rad` of `axis` (a unit vector), layer by layer,
    /// brightest layer first. Allocates only when `tiles` must grow.
    pub fn tiles_of_cone(&self, axis: DVec3, radius_rad: f64, tiles: &mut Vec<TileId>) {
        tiles.clear();
        for (number, layer) in (0..).zip(&self.layers) {
            cells_of_cone(layer.order(), axis, radius_rad + ROUNDING_RAD, |cell| {
                #[allow(clippy::cast_possible_truncation, reason = "12.6 million cells at the finest order")]
                let tile = TileId { layer: number, tile: cell as u32 };
                if self.stars_of(tile) > 0 {
                    tiles.push(tile);
                }
            });
        }
    }

    /// Stars of a tile, those too faint among them.
    #[must_use]
    pub fn stars_of(&self, tile: TileId) -> u64 {
        let layer = &self.layers[usize::from(tile.layer)];
        layer.stars_of_tile(u64::from(tile.tile))
    }

    /// Appends the stars of a tile that are not too faint, brightest first; `bytes` is scratch.
    ///
    /// # Errors
    /// When the tile cannot be read or is damaged.
    pub fn read(&self, tile: TileId, bytes: &mut Vec<u8>, stars: &mut Vec<CatalogSource>) -> Result<(), LayerError> {
        let number = usize::from(tile.layer);
        self.layers[number].read_tile(u64::from(tile.tile), self.limiting_mag, self.first_ids[number], bytes, stars)
    }

    /// Where the star with this `id` is: its tile, and its place in it. In skies of more than 2^32 stars `id`s come twice: the
    /// star found may be another one of the same `id`.
    #[must_use]
    pub fn place_of(&self, id: u32) -> Option<(TileId, usize)> {
        let number = self.first_ids.partition_point(|first| *first <= id).checked_sub(1)?;
        let (layer, place) = (&self.layers[number], u64::from(id - self.first_ids[number]));
        let tile = layer.tile_of(place)?;
        let within = usize::try_from(place - layer.places(tile).start).ok()?;
        Some((TileId { layer: u8::try_from(number).ok()?, tile: u32::try_from(tile).ok()? }, within))
    }

    /// Every tile with stars, layer by layer.
    pub fn all_tiles(&self) -> impl Iterator<Item = TileId> {
        (0..).zip(&self.layers).flat_map(move |(layer, of)| {
            let all = (0..tiles_of(of.order())).map(move |tile| {
                #[allow(clippy::cast_possible_truncation, reason = "12.6 million cells at the finest order")]
                let tile = tile as u32;
                TileId { layer, tile }
            });
            all.filter(|tile| self.stars_of(*tile) > 0)
        })
    }
}
