//! Frames of a tracker or a camera -> centroids and fluxes of dots, levels of flats.
//!
//! Dots: background and noise are the frame's median and its median absolute deviation; pixels above both eight
//! standard deviations and a twentieth of the brightest are joined into spots; the centroid is the centre of light in a
//! disc around the spot, less the median of the ring around the disc, three times over. Limits: spots that touch the
//! edge are left out; spots closer than their discs disturb each other (the plan keeps dots apart). A spot with a pixel
//! at the camera's end is marked as saturated. Levels: medians of 8 x 8 blocks, so that a hot pixel or a mote does not
//! count; a median at the camera's end is marked. Tests below.

use super::{measurement::Sight, pattern::Pattern};
use base::image::{DnImage, Image};
use base::least_squares::median;

/// Standard deviations above the background.
const THRESHOLD_SIGMA: f64 = 8.0;
/// Share of the brightest pixel's height above the background.
const THRESHOLD_SHARE: f64 = 0.05;
/// Fewest pixels of a spot; a hot pixel has one.
const FEWEST_PIXELS: usize = 4;
/// Most pixels of a spot: more pixels are not a dot.
const MOST_PIXELS: usize = 10_000;
/// Most spots of a frame.
const MOST_SPOTS: usize = 20_000;
/// Disc beyond a spot's own radius, px.
const BEYOND_PX: f64 = 3.0;
/// Width of the ring, px.
const RING_PX: f64 = 3.0;
const ROUNDS: usize = 3;
/// Share of a full well above which a pixel counts as full, because read noise scatters full pixels around it.
const FULL_WELL_SHARE: f64 = 0.98;
/// Blocks along a side.
pub const BLOCKS: usize = 8;

/// Digital numbers to electrons per second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameScale {
    /// Electrons per digital number.
    pub gain_e_per_dn: f64,
    /// Digital number of no charge.
    pub black_level_dn: f64,
    /// Exposure, seconds.
    pub exposure_s: f64,
    /// Largest digital number of the camera.
    pub largest_dn: u16,
    /// Saturation capacity of its pixels, electrons.
    pub full_well_e: f64,
}

impl FrameScale {
    /// Returns a frame in electrons per second.
    pub fn applied(&self, frame: &DnImage) -> Image<f64> {
        let mut scaled = Image::new(frame.width(), frame.height());
        let scale = self.gain_e_per_dn / self.exposure_s;
        let to = |dn: &u16| (f64::from(*dn) - self.black_level_dn) * scale;
        scaled.pixels_mut().iter_mut().zip(frame.pixels()).for_each(|(e, dn)| *e = to(dn));
        scaled
    }

    /// Returns the least value of a pixel that is at the camera's end, electrons per second.
    pub fn saturated_from(&self) -> f64 {
        // Half a number below the largest, so that rounding does not matter.
        let converter_e = (f64::from(self.largest_dn) - 0.5 - self.black_level_dn) * self.gain_e_per_dn;
        converter_e.min(FULL_WELL_SHARE * self.full_well_e) / self.exposure_s
    }
}

/// Returns the sights in a frame of a pattern; pixels in electrons per second, those from `saturated_from` on are
/// saturated.
pub fn sights_of_frame(pattern: Pattern, frame: &Image<f64>, saturated_from: f64) -> Vec<Sight> {
    let at = |px| Sight { pattern, tracker_px: Some(px), flux: None, luminance: None, dot: None, is_saturated: false };
    match pattern {
        Pattern::Dots | Pattern::DotsBit(_) => spots(frame)
            .into_iter()
            .map(|spot| Sight { flux: Some(spot.flux), is_saturated: spot.most >= saturated_from, ..at(spot.px) })
            .collect(),
        Pattern::Dark | Pattern::Level(_) => blocks(frame)
            .map(|(px, level)| Sight { luminance: Some(level), is_saturated: level >= saturated_from, ..at(px) })
            .collect(),
        Pattern::Marker(_) => Vec::new(),
    }
}

/// A dot as a frame shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Centroid, px.
    pub px: [f64; 2],
    /// Light above the surroundings.
    pub flux: f64,
    /// Its brightest pixel, surroundings included.
    pub most: f64,
}

/// Middles and medians of blocks.
fn blocks(frame: &Image<f64>) -> impl Iterator<Item = ([f64; 2], f64)> + '_ {
    let edge = |i: usize, side: usize| i * side / BLOCKS;
    (0..BLOCKS * BLOCKS).filter_map(move |block| {
        let [i, j] = [block % BLOCKS, block / BLOCKS];
        let (left, right) = (edge(i, frame.width()), edge(i + 1, frame.width()));
        let (top, bottom) = (edge(j, frame.height()), edge(j + 1, frame.height()));
        let rows = frame.rows().skip(top).take(bottom - top);
        let mut values: Vec<f64> = rows.flat_map(|row| row[left..right].iter().copied()).collect();
        let middle = [0.5 * (left + right - 1) as f64, 0.5 * (top + bottom - 1) as f64];
        (!values.is_empty()).then(|| (middle, median(&mut values)))
    })
}

/// Returns the spots of a frame.
pub fn spots(frame: &Image<f64>) -> Vec<Spot> {
    let mut values: Vec<f64> = frame.pixels().iter().copied().filter(|v| v.is_finite()).collect();
    if values.is_empty() {
        return Vec::new();
    }
    let background = median(&mut values);
    let brightest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    values.iter_mut().for_each(|v| *v = (*v - background).abs());
    let sigma = 1.4826 * median(&mut values);
    let height = (THRESHOLD_SIGMA * sigma).max(THRESHOLD_SHARE * (brightest - background));
    if height.is_nan() || height <= 0.0 {
        return Vec::new();
    }
    let groups = groups(frame, background + height);
    groups.iter().filter_map(|group| measured(frame, group, background)).collect()
}

/// Returns pixels above a threshold that touch by their sides, as lists of places.
fn groups(frame: &Image<f64>, threshold: f64) -> Vec<Vec<usize>> {
    let (width, height) = (frame.width(), frame.height());
    let mut is_waiting: Vec<bool> = frame.pixels().iter().map(|v| *v > threshold).collect();
    let mut groups = Vec::new();
    for first in 0..is_waiting.len() {
        if !is_waiting[first] {
            continue;
        }
        is_waiting[first] = false;
        let (mut group, mut next) = (vec![first], 0);
        while next < group.len() {
            let (x, y) = (group[next] % width, group[next] / width);
            next += 1;
            let sides = [(x > 0).then(|| (x - 1, y)), (x + 1 < width).then(|| (x + 1, y))];
            let ends = [(y > 0).then(|| (x, y - 1)), (y + 1 < height).then(|| (x, y + 1))];
            for (x, y) in sides.into_iter().chain(ends).flatten() {
                if core::mem::take(&mut is_waiting[y * width + x]) {
                    group.push(y * width + x);
                }
            }
        }
        if (FEWEST_PIXELS..=MOST_PIXELS).contains(&group.len()) && groups.len() < MOST_SPOTS {
            groups.push(group);
        }
    }
    groups
}

fn measured(frame: &Image<f64>, group: &[usize], background: f64) -> Option<Spot> {
    let width = frame.width();
    let most = group.iter().map(|at| frame.pixels()[*at]).fold(f64::NEG_INFINITY, f64::max);
    let weights = group.iter().map(|at| (frame.pixels()[*at] - background, *at));
    let [sum, sum_x, sum_y] = weights.fold([0.0; 3], |[s, x, y], (weight, at)| {
        [s + weight, x + weight * (at % width) as f64, y + weight * (at / width) as f64]
    });
    let radius = (group.len() as f64 / core::f64::consts::PI).sqrt() + BEYOND_PX;
    let mut centre = [sum_x / sum, sum_y / sum];
    let mut flux = 0.0;
    for _ in 0..ROUNDS {
        (centre, flux) = centre_of_light(frame, centre, radius)?;
    }
    (flux > 0.0).then_some(Spot { px: centre, flux, most })
}

fn centre_of_light(frame: &Image<f64>, [x, y]: [f64; 2], radius: f64) -> Option<([f64; 2], f64)> {
    let outer = radius + RING_PX;
    let (left, right, top, bottom) = (x - outer, x + outer, y - outer, y + outer);
    if !(left >= 0.0 && top >= 0.0 && right <= frame.width() as f64 - 1.0 && bottom <= frame.height() as f64 - 1.0) {
        return None;
    }
    let (mut disc, mut ring) = (Vec::new(), Vec::new());
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to lie in the frame")]
    let (columns, rows) = (left.ceil() as usize..=right as usize, top.ceil() as usize..=bottom as usize);
    for row in rows {
        for column in columns.clone() {
            let [dx, dy] = [column as f64 - x, row as f64 - y];
            let r = dx.hypot(dy);
            let value = frame.get(column, row)?;
            if r <= radius {
                disc.push([dx, dy, value]);
            } else if r <= outer {
                ring.push(value);
            }
        }
    }
    let around = median(&mut ring);
    let [sum, sum_x, sum_y] = disc.iter().fold([0.0; 3], |[s, sx, sy], [dx, dy, value]| {
        let light = value - around;
        [s + light, sx + light * dx, sy + light * dy]
    });
    let moved = [x + sum_x / sum, y + sum_y / sum];
    (sum > 0.0 && moved[0].is_finite() && moved[1].is_finite()).then_some((moved, sum))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaussians sampled finely enough that their sums are their integrals.
    fn frame(spots: &[([f64; 2], f64)], level: f64, noise: f64) -> Image<f64> {
        let mut image = Image::new(120, 90);
        let width = image.width();
        for (at, value) in image.pixels_mut().iter_mut().enumerate() {
            let (x, y) = ((at % width) as f64, (at / width) as f64);
            let of = |(c, flux): &([f64; 2], f64)| {
                let r2 = (x - c[0]).powi(2) + (y - c[1]).powi(2);
                flux * (-0.5 * r2 / 2.25).exp() / (core::f64::consts::TAU * 2.25)
            };
            // A fixed wild sequence in place of noise.
            *value = level + spots.iter().map(of).sum::<f64>() + noise * (12.9898 * at as f64).sin();
        }
        image
    }

    const TRUTH: [([f64; 2], f64); 3] = [([20.3, 30.7], 9000.0), ([60.0, 45.5], 5000.0), ([99.1, 70.2], 7000.0)];

    #[test]
    fn centroids_and_fluxes_are_found() {
        let found = spots(&frame(&TRUTH, 100.0, 1.0));
        assert_eq!(found.len(), 3, "{found:?}");
        for (Spot { px, flux, .. }, (wanted_px, wanted)) in found.iter().zip(TRUTH) {
            assert!(
                (px[0] - wanted_px[0]).hypot(px[1] - wanted_px[1]) < 0.02,
                "{px:?} for {wanted_px:?}: four times the noise"
            );
            assert!((flux / wanted - 1.0).abs() < 0.01, "{flux} for {wanted}");
        }
    }

    #[test]
    fn edge_hot_pixels_and_noise_are_not_spots() {
        let mut image = frame(&[([1.0, 40.0], 9000.0), TRUTH[1]], 10.0, 1.0);
        let at = 10 * image.width() + 100;
        image.pixels_mut()[at] = 5000.0;
        assert_eq!(spots(&image).len(), 1);
        assert_eq!(spots(&frame(&[], 10.0, 1.0)), [], "noise alone");
        assert_eq!(spots(&frame(&[], 10.0, 0.0)), [], "nothing at all");
        assert_eq!(spots(&Image::new(0, 0)), []);
    }

    #[test]
    fn levels_are_medians_of_blocks() {
        let mut image = frame(&[], 50.0, 0.0);
        image.pixels_mut()[7] = 1e6;
        let sights = sights_of_frame(Pattern::Level(3), &image, 51.0);
        assert_eq!(sights.len(), BLOCKS * BLOCKS);
        assert!(sights.iter().all(|sight| sight.luminance == Some(50.0)));
        assert!(sights_of_frame(Pattern::Marker(true), &image, 51.0).is_empty());
        assert!(sights.iter().all(|sight| !sight.is_saturated), "one hot pixel is not a saturated level");
        assert!(sights_of_frame(Pattern::Level(3), &image, 50.0).iter().all(|sight| sight.is_saturated));
    }

    #[test]
    fn a_spot_at_the_cameras_end_is_marked() {
        let mut image = frame(&TRUTH, 100.0, 1.0);
        let end = 100.0 + 0.9 * 9000.0 / (core::f64::consts::TAU * 2.25);
        image.pixels_mut().iter_mut().for_each(|value| *value = value.min(end));
        let marked = |from: f64| -> Vec<bool> {
            sights_of_frame(Pattern::Dots, &image, from).iter().map(|sight| sight.is_saturated).collect()
        };
        assert_eq!((marked(end), marked(end + 1.0)), (vec![true, false, false], vec![false; 3]));
        let scale = FrameScale {
            gain_e_per_dn: 2.0,
            black_level_dn: 100.0,
            exposure_s: 0.5,
            largest_dn: 4095,
            full_well_e: 1e9,
        };
        let ends: Vec<bool> =
            [4094_u16, 4095].map(|dn| (f64::from(dn) - 100.0) * 2.0 / 0.5 >= scale.saturated_from()).into();
        assert_eq!(ends, [false, true], "the converter's last number");
        let shallow = FrameScale { full_well_e: 1000.0, ..scale };
        assert_eq!(shallow.saturated_from(), 1960.0, "98 % of the well in half a second");
    }
}
