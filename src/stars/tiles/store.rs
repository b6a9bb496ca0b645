//! Decoded tiles in memory: found by their name, the least lately used given up first.
//!
//! Bounded by stars and by tiles. A hand goes round the slots and gives up the first whose tile no field has wanted
//! since the hand's last turn (the clock algorithm: nearly least lately used, in constant time, without lists).
//! Everything is allocated when the store is made, except for the blocks, which come from the reader and go back there.
//!
//! [`TileStar`]: a star of a tile as frames want it: everything about it that does not change from frame to frame.

use crate::layer::{LayerSet, TileId};
use crate::numbering::stored_number;
use base::refused::Refused;
use base::source::{CatalogSource, ProperMotion};
use core::fmt;
use glam::DVec3;
use std::{collections::HashMap, sync::Arc};

/// Most tiles in memory.
pub(super) const MOST_TILES: usize = 1 << 17;

/// State of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// It is in this slot.
    Held(u32),
    /// The field lacks it: it has been asked for.
    Lacking,
    /// A coming field may want it: it has been asked for, behind those that are lacking.
    Ahead,
}

#[derive(Debug)]
struct Slot {
    /// `None`: the slot is free.
    tile: Option<TileId>,
    /// The latest field that wanted it.
    wanted_in: u64,
    stars: Vec<TileStar>,
}

/// Tiles in memory.
#[derive(Debug)]
pub(super) struct Store {
    places: HashMap<TileId, Place>,
    slots: Vec<Slot>,
    free: Vec<u32>,
    most_stars: u64,
    stars: u64,
    hand: usize,
}

impl Store {
    /// Makes a store for this many stars and tiles.
    pub(super) fn new(most_stars: u64, tiles: usize) -> Self {
        // Tiles that are asked for have names too.
        let places = HashMap::with_capacity(2 * tiles);
        let (slots, free) = (Vec::with_capacity(tiles), Vec::with_capacity(tiles));
        Self { places, slots, free, most_stars, stars: 0, hand: 0 }
    }

    pub(super) fn place(&self, tile: TileId) -> Option<Place> {
        self.places.get(&tile).copied()
    }

    /// Records that a tile has been asked for, as lacking or ahead; returns false when the list is full.
    pub(super) fn ask(&mut self, tile: TileId, place: Place) -> bool {
        let has_space = self.places.len() < 2 * MOST_TILES || self.places.contains_key(&tile);
        if has_space {
            self.places.insert(tile, place);
        }
        has_space
    }

    /// Returns tiles that are to come.
    pub(super) fn asked(&self) -> usize {
        self.places.len() - (self.slots.len() - self.free.len())
    }

    /// Forgets a tile that does not come.
    pub(super) fn forget(&mut self, tile: TileId) {
        self.places.remove(&tile);
    }

    pub(super) fn stars(&self, slot: u32) -> &[TileStar] {
        &self.slots[slot as usize].stars
    }

    /// Records that field number `field` wants the tile of a slot.
    pub(super) fn want(&mut self, slot: u32, field: u64) {
        self.slots[slot as usize].wanted_in = field;
    }

    /// Returns whether all of the field's tiles fit: true as long as their stars and their number are below this.
    pub(super) fn has_space(&self, stars: u64, tiles: usize) -> bool {
        stars <= self.most_stars && tiles <= MOST_TILES
    }

    /// Returns stars in memory.
    #[cfg(test)]
    pub(super) fn held_stars(&self) -> u64 {
        self.stars
    }

    /// Takes a tile in, wanted by field number `field`, and gives up others through `give_up` when the store is full;
    /// tiles that this field wants stay. Returns its slot; `None`, with the block given up, when it cannot fit.
    pub(super) fn insert(
        &mut self,
        tile: TileId,
        stars: Vec<TileStar>,
        field: u64,
        mut give_up: impl FnMut(Vec<TileStar>),
    ) -> Option<u32> {
        let more = stars.len() as u64;
        let mut steps = 2 * self.slots.len();
        while steps > 0 && !self.fits(more) {
            // Tiles that the field before wanted are passed over in the first turn.
            let oldest = field.saturating_sub(u64::from(steps > self.slots.len()));
            if let Some(block) = self.step(oldest) {
                give_up(block);
            }
            steps -= 1;
        }
        if !self.fits(more) {
            self.places.remove(&tile);
            give_up(stars);
            return None;
        }
        self.stars += more;
        let slot = Slot { tile: Some(tile), wanted_in: field, stars };
        let place = match self.free.pop() {
            Some(place) => {
                self.slots[place as usize] = slot;
                place
            }
            None => {
                self.slots.push(slot);
                to_u32(self.slots.len() - 1)
            }
        };
        self.places.insert(tile, Place::Held(place));
        Some(place)
    }

    fn fits(&self, more: u64) -> bool {
        self.stars + more <= self.most_stars && (!self.free.is_empty() || self.slots.len() < MOST_TILES)
    }

    /// Moves the hand on by a slot and empties it when no field from `oldest` on has wanted it.
    fn step(&mut self, oldest: u64) -> Option<Vec<TileStar>> {
        self.hand = (self.hand + 1) % self.slots.len();
        let slot = &mut self.slots[self.hand];
        let tile = slot.tile.filter(|_| slot.wanted_in < oldest)?;
        slot.tile = None;
        let block = core::mem::take(&mut slot.stars);
        self.places.remove(&tile);
        self.stars -= block.len() as u64;
        self.free.push(to_u32(self.hand));
        Some(block)
    }
}

#[allow(clippy::cast_possible_truncation, reason = "at most MOST_TILES slots")]
fn to_u32(slot: usize) -> u32 {
    slot as u32
}

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
