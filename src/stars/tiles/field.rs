//! Where the camera looks -> the stars of the tiles there.

use super::reader::{Answer, Reader};
use super::store::{Decoder, Light, MOST_TILES, Place, Store, TileStar};
use crate::layer::{LayerSet, TileId};
use base::{refused::Refused, source_id::SourceId};
use core::ops::Range;
use glam::DVec3;
use std::sync::Arc;

/// Tiles of one field for which memory is reserved at the start.
const TILES_RESERVED: usize = 16_384;

/// Tiles and stars missing from a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Shortfall {
    /// Tiles that were not read in time.
    pub late_tiles: u64,
    /// Stars of these tiles, those too faint for the camera among them.
    pub late_stars: u64,
    /// Stars of the faintest layers, left out because all of them would not fit into memory; likewise.
    pub crowded_out_stars: u64,
}

/// Layers and those of their tiles that are in memory.
#[derive(Debug)]
pub struct TileSky {
    layers: Arc<LayerSet>,
    store: Store,
    /// Reads in line; `None` once there is a reader.
    decoder: Option<Decoder>,
    reader: Option<Reader>,
    /// Fields so far.
    field: u64,
    /// Stars of the latest.
    field_stars: u64,
    tiles: Vec<TileId>,
    ahead: Vec<TileId>,
    /// Slots of the field's tiles.
    slots: Vec<u32>,
    /// Places of the tiles of a layer.
    places: Vec<Option<Place>>,
    /// Of each layer, stars of the tiles that were read, and those of them that were not too faint: how many stars a
    /// tile will have that has not come yet.
    decoded: Vec<[u64; 2]>,
}

impl TileSky {
    /// Returns stars of `layers` by their `light`, at most so many in memory.
    pub fn new(layers: Arc<LayerSet>, light: Light, most_stars: u64) -> Self {
        let decoder = Some(Decoder::new(Arc::clone(&layers), light));
        let [tiles, ahead] = [(); 2].map(|()| Vec::with_capacity(TILES_RESERVED));
        let slots = Vec::with_capacity(TILES_RESERVED);
        let decoded = vec![[0; 2]; layers.layers().len()];
        let all_tiles = layers.all_tiles().take(MOST_TILES).count();
        let mut sky = Self {
            layers,
            decoded,
            store: Store::new(most_stars, all_tiles),
            decoder,
            reader: None,
            field: 0,
            field_stars: 0,
            tiles,
            ahead,
            slots,
            places: Vec::with_capacity(TILES_RESERVED),
        };
        if sky.layers.is_in_memory() {
            sky.hold_all();
        }
        sky
    }

    /// Decodes every tile, so that no field waits for one; a tile that does not come is read when a field wants it.
    fn hold_all(&mut self) {
        let layers = Arc::clone(&self.layers);
        for tile in layers.all_tiles() {
            let _ = self.find(tile, None);
        }
    }

    /// Returns the layers.
    pub fn layers(&self) -> &LayerSet {
        &self.layers
    }

    /// Starts a thread that reads files; from here on tiles not read in time are missing.
    ///
    /// # Errors
    /// When the system has no thread for it.
    pub fn read_ahead(&mut self) -> std::io::Result<()> {
        if self.layers.is_in_memory() {
            return Ok(());
        }
        if let Some(decoder) = self.decoder.take() {
            self.reader = Some(Reader::start(decoder)?);
        }
        Ok(())
    }

    /// Returns true when the thread that reads has broken down: tiles that are not in memory stay missing.
    pub fn has_lost_reader(&self) -> bool {
        self.reader.as_ref().is_some_and(Reader::is_lost)
    }

    /// Returns the field within `radius_rad` of `axis` (a unit vector): what it lacks. Its stars are in
    /// [`Self::blocks`] then.
    ///
    /// # Errors
    /// When a tile cannot be read or is damaged.
    pub fn take_field(&mut self, axis: DVec3, radius_rad: f64) -> Result<Shortfall, Refused> {
        self.field += 1;
        self.take_answers()?;
        self.layers.tiles_of_cone(axis, radius_rad, &mut self.tiles);
        self.slots.clear();
        let mut shortfall = Shortfall::default();
        self.field_stars = 0;
        let mut first = 0;
        while first < self.tiles.len() {
            let layer = self.tiles[first].layer;
            let end = first + self.tiles[first..].partition_point(|tile| tile.layer == layer);
            let before = self.slots.len();
            match self.take_layer(first..end, &mut shortfall)? {
                Fit::Whole => first = end,
                Fit::TooMany => {
                    // This layer and all fainter ones.
                    self.slots.truncate(before);
                    let left = &self.tiles[first..];
                    shortfall.crowded_out_stars += left.iter().map(|tile| self.layers.stars_of(*tile)).sum::<u64>();
                    break;
                }
            }
        }
        Ok(shortfall)
    }

    /// Returns the field's tiles of one layer.
    fn take_layer(&mut self, range: Range<usize>, shortfall: &mut Shortfall) -> Result<Fit, Refused> {
        let mut places = core::mem::take(&mut self.places);
        places.clear();
        places.extend(self.tiles[range.clone()].iter().map(|tile| self.store.place(*tile)));
        let fit = self.take_tiles(range, &places, shortfall);
        self.places = places;
        fit
    }

    fn take_tiles(
        &mut self,
        range: Range<usize>,
        places: &[Option<Place>],
        shortfall: &mut Shortfall,
    ) -> Result<Fit, Refused> {
        if self.reader.is_some() && !self.may_fit(&self.tiles[range.clone()], places) {
            return Ok(Fit::TooMany);
        }
        // Tiles in memory stay there while their neighbours are read.
        for place in places {
            if let Some(Place::Held(slot)) = place {
                self.store.want(*slot, self.field);
            }
        }
        for (number, place) in range.zip(places) {
            let tile = self.tiles[number];
            match self.find(tile, *place)? {
                Found::Slot(slot) => {
                    self.slots.push(slot);
                    self.field_stars += self.store.stars(slot).len() as u64;
                }
                Found::NoSpace => return Ok(Fit::TooMany),
                Found::Late => {
                    shortfall.late_tiles += 1;
                    shortfall.late_stars += self.layers.stars_of(tile);
                    self.field_stars += self.stars_to_come(tile);
                }
            }
            if !self.store.has_space(self.field_stars, self.slots.len()) {
                return Ok(Fit::TooMany);
            }
        }
        Ok(Fit::Whole)
    }

    /// Returns whether tiles fit beside those of the brighter layers, as far as is known: nothing is asked for in
    /// vain.
    fn may_fit(&self, tiles: &[TileId], places: &[Option<Place>]) -> bool {
        let stars = tiles.iter().zip(places).map(|(tile, place)| self.expected_stars(*tile, *place));
        self.store.has_space(self.field_stars + stars.sum::<u64>(), self.slots.len() + tiles.len())
    }

    /// Returns stars of a tile that has this place: those that it has, or will have.
    fn expected_stars(&self, tile: TileId, place: Option<Place>) -> u64 {
        match place {
            Some(Place::Held(slot)) => self.store.stars(slot).len() as u64,
            Some(Place::Lacking | Place::Ahead) | None => self.stars_to_come(tile),
        }
    }

    /// Returns stars that a tile will have when it is read, by the tiles of its layer that were: none as long as
    /// nothing is known.
    fn stars_to_come(&self, tile: TileId) -> u64 {
        let [all, kept] = self.decoded[usize::from(tile.layer)];
        let stars = u128::from(self.layers.stars_of(tile)) * u128::from(kept) / u128::from(all.max(1));
        u64::try_from(stars).unwrap_or(u64::MAX)
    }

    /// Returns a tile of the present field that has this place in the store.
    fn find(&mut self, tile: TileId, place: Option<Place>) -> Result<Found, Refused> {
        if let Some(Place::Held(slot)) = place {
            return Ok(Found::Slot(slot));
        }
        if let Some(decoder) = &mut self.decoder {
            let mut block = Vec::new();
            decoder.read(tile, &mut block)?;
            return Ok(self.store.insert(tile, block, self.field, drop).map_or(Found::NoSpace, Found::Slot));
        }
        if place != Some(Place::Lacking) {
            self.ask(tile, Place::Lacking);
        }
        Ok(Found::Late)
    }

    /// Announces a field that may come: asks for its tiles, as far as they fit into memory beside those of the present
    /// field.
    pub fn look_ahead(&mut self, axis: DVec3, radius_rad: f64) {
        if self.reader.is_none() {
            return;
        }
        let mut ahead = core::mem::take(&mut self.ahead);
        self.layers.tiles_of_cone(axis, radius_rad, &mut ahead);
        // The cone has the present field within it.
        let mut stars = 0;
        for (number, tile) in ahead.iter().enumerate() {
            let place = self.store.place(*tile);
            stars += self.expected_stars(*tile, place);
            if !self.store.has_space(stars, number) {
                break;
            }
            match place {
                // It stays until then.
                Some(Place::Held(slot)) => self.store.want(slot, self.field),
                Some(Place::Lacking | Place::Ahead) => {}
                None => self.ask(*tile, Place::Ahead),
            }
        }
        self.ahead = ahead;
    }

    fn ask(&mut self, tile: TileId, place: Place) {
        let Some(reader) = &self.reader else { return };
        if self.store.ask(tile, place) && !reader.ask(tile, self.field, place == Place::Lacking) {
            self.store.forget(tile);
        }
    }

    /// Takes in what has been read; how many tiles are still to come.
    ///
    /// # Errors
    /// When a tile cannot be read or is damaged.
    pub fn settle(&mut self) -> Result<usize, Refused> {
        self.take_answers()?;
        Ok(self.store.asked())
    }

    /// Takes in what has been read.
    fn take_answers(&mut self) -> Result<(), Refused> {
        let Some(reader) = &self.reader else { return Ok(()) };
        reader.begin(self.field);
        while let Some(Answer { tile, stars }) = reader.answer() {
            match (stars, self.store.place(tile)) {
                // Asked for ahead and then again as lacking: one of the two was first.
                (Some(stars), Some(Place::Held(_))) => reader.give_back(stars?),
                (None, Some(Place::Held(_))) => {}
                (Some(stars), _) => {
                    let stars = stars?;
                    let [all, kept] = &mut self.decoded[usize::from(tile.layer)];
                    *all += self.layers.stars_of(tile);
                    *kept += stars.len() as u64;
                    self.store.insert(tile, stars, self.field, |block| reader.give_back(block));
                }
                (None, _) => self.store.forget(tile),
            }
        }
        Ok(())
    }

    /// Returns the stars of the field's tiles, brightest layer first, those of a tile together and brightest first.
    pub fn blocks(&self) -> impl Iterator<Item = &[TileStar]> {
        self.slots.iter().map(|slot| self.store.stars(*slot))
    }

    /// Returns one of these blocks.
    pub fn block(&self, number: usize) -> &[TileStar] {
        self.store.stars(self.slots[number])
    }

    /// Returns the name in its source catalog of a star of the field, by its `id`; `None` when it has none, or is not
    /// in memory.
    pub fn source_id(&self, id: u32) -> Option<SourceId> {
        let (tile, place) = self.layers.place_of(id)?;
        let Some(Place::Held(slot)) = self.store.place(tile) else { return None };
        let star = self.store.stars(slot).get(place).filter(|star| star.id == id)?;
        self.layers.source_id(tile.layer, star.number)
    }

    #[cfg(test)]
    pub(super) fn tiles_of_the_field(&self) -> &[TileId] {
        &self.tiles
    }

    /// Returns what a field would lack, without asking for anything.
    #[cfg(test)]
    pub(super) fn would_be_late(&self, axis: DVec3, radius_rad: f64) -> Shortfall {
        let mut tiles = Vec::new();
        self.layers.tiles_of_cone(axis, radius_rad, &mut tiles);
        let is_late = |tile: &&TileId| !matches!(self.store.place(**tile), Some(Place::Held(_)));
        Shortfall { late_tiles: tiles.iter().filter(is_late).count() as u64, ..Shortfall::default() }
    }

    #[cfg(test)]
    pub(super) fn held_stars(&self) -> u64 {
        self.store.held_stars()
    }
}

/// Whether the tiles of a layer fit into memory.
enum Fit {
    Whole,
    TooMany,
}

enum Found {
    Slot(u32),
    /// The field's own tiles fill the memory.
    NoSpace,
    /// Not read yet.
    Late,
}
