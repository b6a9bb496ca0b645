//! A seed, numbers and layers -> files.
//!
//! Tiles are drawn in parallel, some thousands at a time, and written in order: the bytes depend on the arguments
//! alone. The epoch is J2016.0, as Gaia's.
//!
//! Tile, range of magnitude and seed -> its made-up stars, brightest first.
//!
//! The cumulative count runs with magnitude as time does for a Poisson process: stars are its arrivals. Their number is
//! Poisson, their magnitudes follow the counts, and they come in order; nothing is sorted. Places are even over the
//! tile (HEALPix cells are maps of equal area). Each star is drawn from numbers of its own ([`Stage::SyntheticStars`]).
//!
//! **Plausible, not measured**: the colour is normal about a median that reddens with magnitude. A star is a giant or a
//! dwarf by chance, which with its colour gives its absolute magnitude, and so (without extinction) its parallax; its
//! velocity across the line of sight is normal, 25 km/s in each axis. Tests: `super::tests`.

use crate::synthetic::density::{BRIGHTEST_MAG, Density, FAINTEST_MAG};
use base::random::{Stage, attempt_counter, key, philox};
use base::{refused::Refused, source::direction_from_ra_dec, units::DEG};
use core::f64::consts::{PI, TAU};
use glam::DVec3;
use rayon::prelude::*;
use stars::healpix::CIRCLE;
use stars::layer::{
    Head, LayerReport, LayerWriter, NewStar, StarRecord, UnnamedLayer, layer_name, order_for, tile_records, tiles_of,
};
use std::{fs, path::Path};

/// Epoch of the positions, Julian year.
const EPOCH_YR: f64 = 2016.0;
/// Tiles drawn at a time: some million stars, six millions where the sky is densest.
const TILES_AT_A_TIME: u64 = 4096;
/// Order of the cells over which numbers of the whole sky are summed up.
const SUM_ORDER: u8 = 6;

/// Tiles of a part of the sky are not finer: their table would be larger than their stars.
const REGION_ORDER: u8 = 8;

/// Returns the credits of made-up stars.
pub fn credits(seed: u64) -> String {
    format!("synthetic population, seed {seed}: not real stars; numbers by direction and magnitude as in Gaia DR3")
}

/// A made-up sky.
#[derive(Debug, Clone, PartialEq)]
pub struct Population {
    limits_mag: Vec<f32>,
    scale: f64,
    seed: u64,
    /// Only within so many rad of this direction.
    around: Option<(DVec3, f64)>,
}

impl Population {
    /// Returns the sky of a seed, in layers with these faint ends (G magnitudes, rising). `stars`: how many are
    /// expected in all; as many as were measured when it is left out.
    ///
    /// # Errors
    /// The faint ends when there are none, they do not rise, or one is beyond what a population has.
    pub fn new(limits_mag: &[f32], stars: Option<f64>, seed: u64) -> Result<Self, String> {
        let fits = |limit: &f32| (BRIGHTEST_MAG..=FAINTEST_MAG).contains(&f64::from(*limit));
        let rises = limits_mag.is_sorted_by(|a, b| a < b);
        let Some(last) = limits_mag.last().filter(|_| rises && limits_mag.iter().all(fits)) else {
            return Err(format!("wanted rising magnitudes in {BRIGHTEST_MAG}..{FAINTEST_MAG}, got {limits_mag:?}"));
        };
        let scale = stars.map_or(1.0, |stars| stars / measured_between([BRIGHTEST_MAG, f64::from(*last)]));
        Ok(Self { limits_mag: limits_mag.to_vec(), scale, seed, around: None })
    }

    /// Returns the same stars, but only those of tiles that reach within `radius_rad` of `axis`: a deep sky where one
    /// looks, on a small disk.
    #[must_use]
    pub fn around(self, axis: DVec3, radius_rad: f64) -> Self {
        Self { around: Some((axis, radius_rad)), ..self }
    }

    /// Returns how many stars are expected over the whole sky.
    pub fn expected(&self) -> f64 {
        (0..self.limits_mag.len()).map(|layer| self.draw(layer).1).sum()
    }

    fn is_wanted(&self, order: u8, tile: u64) -> bool {
        let reach_rad = CIRCLE / f64::from(1_u32 << order);
        self.around.is_none_or(|(axis, radius_rad)| axis.angle_between(centre(order, tile)) <= radius_rad + reach_rad)
    }

    /// Writes the layers `out/gNN.starlayer` in the place of those that are there. `progress` gets the share done, 0..1.
    ///
    /// # Errors
    /// When the disk failed.
    pub fn write(&self, out: &Path, progress: &mut dyn FnMut(f64)) -> Result<Vec<LayerReport>, Refused> {
        fs::create_dir_all(out).map_err(Refused::file("cannot make", out))?;
        let draws: Vec<(LayerDraw, f64)> = (0..self.limits_mag.len()).map(|layer| self.draw(layer)).collect();
        let all: f64 = draws.iter().map(|(_, expected)| expected).sum();
        let (mut whole, mut done) = (Vec::new(), 0.0);
        for ((draw, expected), limit) in draws.into_iter().zip(&self.limits_mag) {
            let mut share = |part: f64| progress((done + part * expected) / all);
            whole.push(self.write_layer(&draw, &out.join(layer_name(*limit)), &mut share)?);
            done += expected;
        }
        // None gets its name before all are whole.
        whole.into_iter().map(UnnamedLayer::name).collect()
    }

    /// Returns how a layer is drawn, and how many stars are expected in it.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "float-to-int casts saturate")]
    fn draw(&self, layer: usize) -> (LayerDraw, f64) {
        let from = layer.checked_sub(1).map_or(BRIGHTEST_MAG, |before| f64::from(self.limits_mag[before]));
        let magnitudes = [from, f64::from(self.limits_mag[layer])];
        let expected = measured_between(magnitudes) * self.scale;
        let most_order = if self.around.is_some() { REGION_ORDER } else { u8::MAX };
        let order = order_for(expected as u64).min(most_order);
        (LayerDraw { key: key(self.seed), layer: layer as u32, order, magnitudes, scale: self.scale }, expected)
    }

    fn write_layer(
        &self,
        draw: &LayerDraw,
        path: &Path,
        progress: &mut dyn FnMut(f64),
    ) -> Result<UnnamedLayer, Refused> {
        let credits = credits(self.seed);
        let mut writer = LayerWriter::create(path, draw.order, &credits, false)?;
        let tiles = tiles_of(draw.order) as u64;
        for first in (0..tiles).step_by(usize::try_from(TILES_AT_A_TIME).unwrap_or(usize::MAX)) {
            let drawn: Vec<Vec<StarRecord>> = (first..tiles.min(first + TILES_AT_A_TIME))
                .into_par_iter()
                .map_init(Vec::new, |stars, tile| match self.is_wanted(draw.order, tile) {
                    true => draw_tile(draw, tile, stars),
                    false => Ok(Vec::new()),
                })
                .collect::<Result<_, Refused>>()?;
            for (tile, records) in (first..).zip(drawn) {
                writer.append_tile(tile, records)?;
            }
            progress(first as f64 / tiles as f64);
        }
        let from = if draw.layer == 0 { f32::NEG_INFINITY } else { self.limits_mag[draw.layer as usize - 1] };
        let magnitudes = [from, self.limits_mag[draw.layer as usize]];
        writer.complete(&Head { magnitudes, epoch_yr: EPOCH_YR, credits: &credits, numbering: None })
    }
}

fn draw_tile(draw: &LayerDraw, tile: u64, stars: &mut Vec<NewStar>) -> Result<Vec<StarRecord>, Refused> {
    draw.stars(tile, &Density::towards(centre(draw.order, tile)), stars);
    tile_records(draw.order, tile, stars)
}

/// Returns the number of stars of the whole sky between two magnitudes, as measured.
fn measured_between([from, below]: [f64; 2]) -> f64 {
    let cells = tiles_of(SUM_ORDER) as u64;
    let of_cell = |cell: u64| {
        let density = Density::towards(centre(SUM_ORDER, cell));
        density.brighter_than(below) - density.brighter_than(from)
    };
    (0..cells).map(of_cell).sum::<f64>() * SPHERE_DEG2 / cells as f64
}

fn centre(order: u8, cell: u64) -> DVec3 {
    let (ra, dec) = stars::healpix::centre(order, cell);
    direction_from_ra_dec(ra, dec)
}

/// Step of the table of counts, mag; within a step magnitudes are even, which is off by 1 % of the step's stars at
/// most.
const COUNT_STEP_MAG: f64 = 0.1;
/// Area of the sphere, square degrees.
pub(super) const SPHERE_DEG2: f64 = 4.0 * PI / (DEG * DEG);
/// Velocity across the line of sight, in each axis, km/s.
const VELOCITY_KM_S: f64 = 25.0;
/// One astronomical unit a Julian year, km/s: mas/yr of proper motion times this, over mas of parallax, is km/s.
const AU_PER_YEAR_KM_S: f64 = 4.740_47;
/// No star is closer than 3.3 pc, mas: proper motions stay below what layers hold.
const MOST_PARALLAX_MAS: f64 = 300.0;
/// Spread of colours, mag.
const COLOUR_SPREAD_MAG: f64 = 0.35;
/// Colours of stars, mag.
const COLOURS_MAG: [f64; 2] = [-0.4, 4.5];

/// Values that the tiles of one layer share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LayerDraw {
    pub(super) key: [u32; 2],
    /// Place of the layer among the population's.
    pub(super) layer: u32,
    /// Order of its tiles.
    pub(super) order: u8,
    /// From, and below.
    pub(super) magnitudes: [f64; 2],
    /// Stars for each that was measured.
    pub(super) scale: f64,
}

impl LayerDraw {
    /// Replaces `out` by the stars of a tile.
    pub(super) fn stars(&self, tile: u64, density: &Density, out: &mut Vec<NewStar>) {
        out.clear();
        let [from, below] = self.magnitudes;
        let area_deg2 = SPHERE_DEG2 / (12_u64 << (2 * self.order)) as f64;
        let count = |mag: f64| density.brighter_than(mag) * area_deg2 * self.scale;
        let (last, mut low, mut low_count) = (count(below), from, count(from));
        let (mut high, mut high_count) = (low, low_count);
        let mut arrival = low_count;
        for number in 0_u32.. {
            let [gap, rest @ ..] = self.words(tile, number);
            arrival -= unit(gap).ln();
            if arrival >= last {
                return;
            }
            while high_count <= arrival {
                (low, low_count) = (high, high_count);
                high = (low + COUNT_STEP_MAG).min(below);
                high_count = count(high);
            }
            let mag_g = low + (high - low) * (arrival - low_count) / (high_count - low_count);
            out.push(self.star(tile, number, mag_g, rest));
        }
    }

    /// Returns the eight words of a star's own.
    #[allow(clippy::cast_possible_truncation, reason = "tiles of order 10 are fewer than 2^24")]
    fn words(&self, tile: u64, number: u32) -> [u32; 8] {
        let block = |half: u32| {
            philox(attempt_counter(tile as u32, number, Stage::SyntheticStars, 2 * self.layer + half), self.key)
        };
        let ([a, b, c, d], [e, f, g, h]) = (block(0), block(1));
        [a, b, c, d, e, f, g, h]
    }

    fn star(&self, tile: u64, number: u32, mag_g: f64, [x, y, kind, e, f, g, h]: [u32; 7]) -> NewStar {
        let (ra_rad, dec_rad) = stars::healpix::point(self.order, tile, [unit(x), unit(y)]);
        let [normal, _] = normals([e, f]);
        let bp_rp = (median_colour(mag_g) + COLOUR_SPREAD_MAG * normal).clamp(COLOURS_MAG[0], COLOURS_MAG[1]);
        let parallax_mas = parallax_mas(mag_g, bp_rp, unit(kind));
        let motion = normals([g, h]).map(|n| n * VELOCITY_KM_S / AU_PER_YEAR_KM_S * parallax_mas);
        NewStar {
            source_id: i64::from(number),
            ra_rad: ra_rad.rem_euclid(TAU),
            dec_rad,
            motion_mas_yr: Some(motion),
            parallax_mas: Some(parallax_mas),
            mag_g,
            bp_rp: Some(bp_rp),
        }
    }
}

fn median_colour(mag_g: f64) -> f64 {
    0.8 + 0.07 * (mag_g - 10.0).clamp(-5.0, 12.0)
}

/// Returns a parallax. Half of the stars of 10 mag are giants and a tenth of those of 18, if they are red enough.
fn parallax_mas(mag_g: f64, bp_rp: f64, chance: f64) -> f64 {
    let is_giant = bp_rp > 0.9 && chance < (1.0 - 0.05 * mag_g).clamp(0.1, 0.6);
    let absolute_mag = if is_giant { 0.5 } else { 1.0 + 4.4 * bp_rp };
    (1000.0 / 10.0_f64.powf((mag_g - absolute_mag + 5.0) / 5.0)).min(MOST_PARALLAX_MAS)
}

/// Returns two normal numbers (Box and Muller 1958).
fn normals([a, b]: [u32; 2]) -> [f64; 2] {
    let (size, (sin, cos)) = ((-2.0 * unit(a).ln()).sqrt(), (TAU * unit(b)).sin_cos());
    [size * cos, size * sin]
}

/// Returns a word as a number between 0 and 1, neither of them.
fn unit(word: u32) -> f64 {
    (f64::from(word) + 0.5) / 4_294_967_296.0
}
