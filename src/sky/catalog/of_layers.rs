//! Layers on disk -> a catalog in memory, down to a magnitude: for fields that need more than the built-in catalog and no
//! more than memory holds.
//!
//! All stars of the layers not fainter than the limit are read, checked, and put into tiles as those of a packed catalog;
//! their `id` is their place in this catalog. Layers are the whole sky of the run: the built-in catalog is not added to
//! them, and each must begin at the magnitude at which the one before ends, so that no star comes twice and none is missing. Tests: `layers_are_a_catalog_in_memory`, `what_does_not_fit_is_refused`.

use super::cone::Tile;
use super::error::CatalogError;
use super::layout::{TILE_ORDER, TILES};
use super::open::{Catalog, total_mas_yr};
use super::{CatalogSource, ra_dec_rad};
use crate::sky::layer::Layer;
use std::path::PathBuf;

/// Most stars in memory: some half a gigabyte.
pub const MOST_IN_MEMORY: u64 = 8_000_000;

impl Catalog {
    /// The stars of `layers` not fainter than `limiting_mag` (Gaia G); without layers the built-in catalog.
    ///
    /// # Errors
    /// When a layer cannot be read or is damaged, their epochs differ, or there are too many stars for memory.
    pub fn of(layers: &[PathBuf], limiting_mag: f32) -> Result<Self, CatalogError> {
        if layers.is_empty() { Self::built_in() } else { Self::of_layers(layers, limiting_mag, MOST_IN_MEMORY) }
    }

    pub(super) fn of_layers(layers: &[PathBuf], limiting_mag: f32, most: u64) -> Result<Self, CatalogError> {
        let mut layers = layers.iter().map(|path| Layer::open(path)).collect::<Result<Vec<_>, _>>()?;
        layers.sort_by(|a, b| a.magnitudes()[0].total_cmp(&b.magnitudes()[0]));
        for pair in layers.windows(2) {
            let (below, from) = (pair[0].magnitudes()[1], pair[1].magnitudes()[0]);
            if (below - from).abs() > 0.0 {
                return Err(CatalogError::Joint { path: pair[1].path().to_path_buf(), below, from });
            }
        }
        let Some(first) = layers.first() else { return Self::built_in() };
        if first.magnitudes()[0] > limiting_mag {
            let [from, _] = first.magnitudes();
            return Err(CatalogError::NoneSoBright { path: first.path().to_path_buf(), from, limiting_mag });
        }
        let epoch_yr = first.epoch_yr();
        let (mut sources, mut bytes, mut credits, mut crc) =
            (Vec::new(), Vec::new(), Vec::new(), crc32fast::Hasher::new());
        for layer in layers.iter().filter(|layer| layer.magnitudes()[0] <= limiting_mag) {
            if (layer.epoch_yr() - epoch_yr).abs() > 0.0 {
                let (path, got) = (layer.path().to_path_buf(), layer.epoch_yr());
                return Err(CatalogError::Epochs { path, wanted: epoch_yr, got });
            }
            for (tile, stars) in (0..).zip(layer.stars_of_tiles()) {
                if stars > 0 {
                    layer.read_tile(tile, limiting_mag, 0, &mut bytes, &mut sources)?;
                }
                if sources.len() as u64 > most {
                    return Err(CatalogError::Memory { path: layer.path().to_path_buf(), limiting_mag, most });
                }
            }
            crc.update(&layer.crc32().to_le_bytes());
            if !credits.contains(&layer.credits()) {
                credits.push(layer.credits());
            }
        }
        Self::of_sources(sources, epoch_yr, crc.finalize(), credits.join(" "))
    }

    fn of_sources(
        mut sources: Vec<CatalogSource>,
        epoch_yr: f64,
        crc32: u32,
        credits: String,
    ) -> Result<Self, CatalogError> {
        let tile_of = |star: &CatalogSource| {
            let [ra, dec] = ra_dec_rad(star.direction_icrf);
            cdshealpix::nested::hash(TILE_ORDER, ra, dec)
        };
        // Stable: stars of one tile and magnitude stay in the layers' order.
        sources.sort_by_cached_key(|star| (tile_of(star), MagnitudeOrder(star.mag_g)));
        let first = |tile: usize| sources.partition_point(|star| tile_of(star) < tile as u64);
        let firsts: Vec<usize> = (0..=TILES).map(first).collect();
        (0..).zip(&mut sources).for_each(|(id, star)| star.id = id);
        let tiles = (0..TILES)
            .map(|tile| Tile::new(tile, firsts[tile], firsts[tile + 1], &sources))
            .collect::<Result<_, _>>()?;
        let fastest_mas_yr = sources.iter().filter_map(|s| s.proper_motion).map(total_mas_yr).fold(0.0, f64::max);
        Ok(Self { epoch_yr, crc32, credits, fastest_mas_yr, sources, tiles })
    }
}

/// Magnitudes in order, none of which is not a number.
#[derive(PartialEq)]
struct MagnitudeOrder(f32);

impl Eq for MagnitudeOrder {}

impl PartialOrd for MagnitudeOrder {
    fn partial_cmp(&self, other: &Self) -> Option<core::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for MagnitudeOrder {
    fn cmp(&self, other: &Self) -> core::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}
