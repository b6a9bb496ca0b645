//! Layers that join at their magnitudes -> one sky, read tile by tile.
//!
//! Each layer must begin at the magnitude at which the one before ends, so that no star comes twice and none is
//! missing; all are of one epoch. A star's `id` is its place in its layer after the stars of the layers before. Layers
//! that begin beyond the limiting magnitude are left closed. A catalog in memory is a sky of one layer. Tests: `tests`.

use super::{layout::tiles_of, open::Layer};
use crate::{StarIndex, catalog::Catalog};
use base::source::{CatalogSource, direction_from_ra_dec};
use base::{refused::Refused, source_id::SourceId};
use glam::DVec3;
use std::path::PathBuf;

/// A tile of one of the layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileId {
    /// Which layer, from the brightest.
    pub layer: u8,
    /// HEALPix cell of the layer's order, nested.
    pub tile: u32,
}

/// One of the layers.
#[derive(Debug)]
enum Part {
    File(Layer),
    Memory(Catalog),
}

impl Part {
    fn index(&self) -> &StarIndex {
        match self {
            Self::File(layer) => layer.index(),
            Self::Memory(catalog) => catalog.index(),
        }
    }
}

/// Layers of one sky.
#[derive(Debug)]
pub struct LayerSet {
    parts: Vec<Part>,
    limiting_mag: f32,
    /// Number of the first star of each layer.
    first_ids: Vec<u32>,
}

impl LayerSet {
    /// Opens the layers in any order, for stars not fainter than `limiting_mag` (Gaia G).
    ///
    /// # Errors
    /// When a layer cannot be read or is damaged at its head, they do not join, their epochs differ, or none is so
    /// bright.
    pub fn open(paths: &[PathBuf], limiting_mag: f32) -> Result<Self, Refused> {
        let mut layers = paths.iter().map(|path| Layer::open(path)).collect::<Result<Vec<_>, _>>()?;
        layers.sort_by(|a, b| a.index().magnitudes[0].total_cmp(&b.index().magnitudes[0]));
        for pair in layers.windows(2) {
            let [before, after] = [0, 1].map(|place| pair[place].index());
            let (below, from) = (before.magnitudes[1], after.magnitudes[0]);
            if (below - from).abs() > 0.0 {
                return Err(Refused::at(
                    pair[1].path(),
                    format_args!(
                        "begins at G = {from}, and the layer before it ends at {below}: wanted layers of one import, each where the one \
         before ends"
                    ),
                ));
            }
            let (wanted, got) = (before.epoch_yr, after.epoch_yr);
            if (wanted - got).abs() > 0.0 {
                return Err(Refused::at(
                    pair[1].path(),
                    format_args!(
                        "epoch wanted J{wanted} as of the layers before, got J{got}; import them with one --epoch"
                    ),
                ));
            }
        }
        match layers.first() {
            None => {
                return Err(Refused(
                    "no layer was named: wanted at least one file as `starloop catalog import` writes them".to_owned(),
                ));
            }
            Some(first) if first.index().magnitudes[0] > limiting_mag => {
                let [from, _] = first.index().magnitudes;
                return Err(Refused::at(
                    first.path(),
                    format_args!(
                        "the brightest layer begins at G = {from}, and the camera sees stars to {limiting_mag}: wanted the brighter \
         layers too"
                    ),
                ));
            }
            Some(_) => {}
        }
        layers.retain(|layer| layer.index().magnitudes[0] <= limiting_mag);
        Ok(Self::of(layers.into_iter().map(Part::File).collect(), limiting_mag))
    }

    /// Returns the stars of a catalog in memory, those not fainter than `limiting_mag` (Gaia G).
    pub fn of_catalog(catalog: Catalog, limiting_mag: f32) -> Self {
        Self::of(vec![Part::Memory(catalog)], limiting_mag)
    }

    fn of(parts: Vec<Part>, limiting_mag: f32) -> Self {
        let mut next = 0_u64;
        let first_ids = parts.iter().map(|part| {
            #[allow(clippy::cast_possible_truncation, reason = "numbers distinguish stars of one field: they may wrap")]
            let first = next as u32;
            next += part.index().stars();
            first
        });
        Self { first_ids: first_ids.collect(), parts, limiting_mag }
    }

    /// Facts and tiles of the layers, brightest first.
    pub fn layers(&self) -> impl ExactSizeIterator<Item = &StarIndex> {
        self.parts.iter().map(Part::index)
    }

    /// Returns true when no file has to be read for a star.
    pub fn is_in_memory(&self) -> bool {
        self.parts.iter().all(|part| matches!(part, Part::Memory(_)))
    }

    /// Magnitudes from which stars are there (minus infinity: no bright star is missing), and below which all are.
    pub fn magnitudes(&self) -> [f32; 2] {
        let (from, below) = (self.layers().next(), self.layers().last());
        [from.map_or(f32::INFINITY, |index| index.magnitudes[0]), below.map_or(f32::MIN, |index| index.magnitudes[1])]
    }

    /// Returns the magnitude below which a field of this radius has no more than `most_stars` stars, wherever it is: the
    /// end of the last layer with which the field about its densest tile has no more. The brightest layer always counts.
    pub fn faintest_of_fields(&self, radius_rad: f64, most_stars: u64) -> f32 {
        let fits = |layers: &usize| self.stars_of_densest_field(*layers, radius_rad) <= most_stars;
        let fitting = (1..=self.parts.len()).rev().find(fits).unwrap_or(1);
        self.layers().nth(fitting - 1).map_or(f32::MIN, |index| index.magnitudes[1])
    }

    /// Returns the stars of the first so many layers about the densest tile of the last of them.
    fn stars_of_densest_field(&self, layers: usize, radius_rad: f64) -> u64 {
        let Some(last) = self.layers().take(layers).last() else { return 0 };
        let densest = last.stars_of_tiles().zip(0..).max().map_or(0, |(_, tile)| tile);
        let (lon_rad, lat_rad) = crate::healpix::centre(last.order, densest);
        let axis = direction_from_ra_dec(lon_rad, lat_rad);
        let mut stars = 0;
        for index in self.layers().take(layers) {
            index.tiles_of_cone(axis, radius_rad, |tile| stars += index.stars_of_tile(tile));
        }
        stars
    }

    /// Returns the Julian year to which the positions refer.
    pub fn epoch_yr(&self) -> f64 {
        self.layers().next().map_or(f64::NAN, |index| index.epoch_yr)
    }

    /// Returns a proper motion that no star exceeds, mas/yr.
    pub fn fastest_mas_yr(&self) -> f64 {
        self.layers().map(|index| index.fastest_mas_yr).fold(0.0, f64::max)
    }

    /// Replaces `tiles` by those with stars that may lie within `radius_rad` of `axis` (a unit vector), layer by layer,
    /// brightest layer first. Allocates only when `tiles` must grow.
    pub fn tiles_of_cone(&self, axis: DVec3, radius_rad: f64, tiles: &mut Vec<TileId>) {
        tiles.clear();
        for (layer, index) in (0..).zip(self.layers()) {
            index.tiles_of_cone(axis, radius_rad, |tile| {
                #[allow(clippy::cast_possible_truncation, reason = "12.6 million cells at the finest order")]
                tiles.push(TileId { layer, tile: tile as u32 });
            });
        }
    }

    /// Returns stars of a tile, those too faint among them.
    pub fn stars_of(&self, tile: TileId) -> u64 {
        self.parts[usize::from(tile.layer)].index().stars_of_tile(u64::from(tile.tile))
    }

    /// Appends the stars of a tile that are not too faint, brightest first; `bytes` is scratch.
    ///
    /// # Errors
    /// When the tile cannot be read or is damaged.
    pub fn read(&self, tile: TileId, bytes: &mut Vec<u8>, stars: &mut Vec<CatalogSource>) -> Result<(), Refused> {
        let (layer, cell) = (usize::from(tile.layer), u64::from(tile.tile));
        match &self.parts[layer] {
            Part::File(file) => file.read_tile(cell, self.limiting_mag, self.first_ids[layer], bytes, stars),
            Part::Memory(catalog) => {
                stars.extend(catalog.bright_of_tile(cell, self.limiting_mag));
                Ok(())
            }
        }
    }

    /// Returns where the star with this `id` is: its tile, and its place in it. In skies of more than 2^32 stars `id`s
    /// come twice: the star found may be another one of the same `id`.
    pub fn place_of(&self, id: u32) -> Option<(TileId, usize)> {
        let number = self.first_ids.partition_point(|first| *first <= id).checked_sub(1)?;
        let (index, place) = (self.parts[number].index(), u64::from(id - self.first_ids[number]));
        let tile = index.tile_of(place)?;
        let within = usize::try_from(place - index.places(tile).start).ok()?;
        Some((TileId { layer: u8::try_from(number).ok()?, tile: u32::try_from(tile).ok()? }, within))
    }

    /// Returns the name in its source catalog of a star of a layer, by its stored number.
    pub fn source_id(&self, layer: u8, number: i64) -> Option<SourceId> {
        self.parts[usize::from(layer)].index().source_id(number)
    }

    /// Returns every tile with stars, layer by layer.
    pub fn all_tiles(&self) -> impl Iterator<Item = TileId> {
        (0..).zip(self.layers()).flat_map(move |(layer, of)| {
            let all = (0..tiles_of(of.order)).map(move |tile| {
                #[allow(clippy::cast_possible_truncation, reason = "12.6 million cells at the finest order")]
                let tile = tile as u32;
                TileId { layer, tile }
            });
            all.filter(|tile| self.stars_of(*tile) > 0)
        })
    }
}
