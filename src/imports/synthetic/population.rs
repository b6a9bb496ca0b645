//! A seed, numbers and layers -> files.
//!
//! Tiles are drawn in parallel, some thousands at a time, and written in order: the bytes depend on the arguments
//! alone. The epoch is J2016.0, as Gaia's.

use super::density::{BRIGHTEST_MAG, Density, FAINTEST_MAG};
use super::star::{LayerDraw, SPHERE_DEG2};
use base::{random::key, refused::Refused, source::direction_from_ra_dec};
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
