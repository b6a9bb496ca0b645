//! Tile, range of magnitude and seed -> its made-up stars, brightest first.
//!
//! The cumulative count runs with magnitude as time does for a Poisson process: stars are its arrivals. Their number is
//! Poisson, their magnitudes follow the counts, and they come in order; nothing is sorted. Places are even over the
//! tile (HEALPix cells are maps of equal area). Each star is drawn from numbers of its own ([`Stage::SyntheticStars`]).
//!
//! **Plausible, not measured**: the colour is normal about a median that reddens with magnitude. A star is a giant or a
//! dwarf by chance, which with its colour gives its absolute magnitude, and so (without extinction) its parallax; its
//! velocity across the line of sight is normal, 25 km/s in each axis. Tests: `super::tests`.

use super::density::Density;
use base::random::{Stage, attempt_counter, philox};
use base::units::DEG;
use core::f64::consts::{PI, TAU};
use stars::layer::NewStar;

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
