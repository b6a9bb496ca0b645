//! Real and drawn frame, both measured alike -> the figures by which a simulation is judged.

use crate::detect::noise_dn;
use crate::measure::{Plate, Spot};
use crate::picture::{Picture, mean, rms, robust, window};
use base::source_id::SourceId;
use serde::Serialize;

/// Half-widths of the squares whose light is compared: 3 x 3, 5 x 5, and the whole, 7 x 7.
const ENERGY_HALF_PX: [i64; 3] = [1, 2, 3];
/// Half-width of the square of a signal-to-noise ratio: 5 x 5.
const SNR_HALF_PX: i64 = 2;
/// Side of the places in which the background is compared, px (that of the published comparison).
const PLACE_PX: usize = 20;
/// Width of a ring of the profile, px.
const RING_PX: f64 = 0.5;
/// Rings of the profile.
const RINGS: usize = 12;
/// Least SNR of stars whose energy and profile are compared.
const ENERGY_SNR: f64 = 20.0;
/// Most stars of the energy.
const MOST_STARS: usize = 100;

/// A star of both frames.
#[derive(Debug, Clone, Copy)]
pub struct Pair {
    /// As it was measured on the real frame.
    pub real: Spot,
    /// As it was measured on the drawn frame.
    pub drawn: Spot,
    /// Where it was drawn, px.
    pub truth_px: [f64; 2],
    /// With how much light, DN.
    pub truth_dn: f64,
    /// Gaia G.
    pub mag_g: f64,
    /// BP - RP.
    pub bp_rp: f64,
    /// Another star's light is in its pixels.
    pub is_blended: bool,
    /// Its name in its source catalog.
    pub name: Option<SourceId>,
}

/// A star of the comparison.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StarRow {
    /// Gaia G.
    pub mag_g: f64,
    /// BP - RP.
    pub bp_rp: f64,
    /// Place in the real frame, px.
    pub x_px: f64,
    /// Row.
    pub y_px: f64,
    /// Real less drawn, px.
    pub dx_px: f64,
    /// Real less drawn, px.
    pub dy_px: f64,
    /// Magnitude of the real star less that of the drawn one.
    pub dmag: f64,
    /// SNR of the fit in the real frame.
    pub snr: f64,
    /// Measured on the drawn frame, less what was drawn there, px: what noise and method do.
    pub drawn_dx_px: f64,
    /// The same.
    pub drawn_dy_px: f64,
    /// The same, mag.
    pub drawn_dmag: f64,
    /// Name in the source catalog.
    pub name: Option<String>,
    /// Its place or its magnitude is far off: it is not in the judged figures.
    pub is_outlier: bool,
}

impl StarRow {
    /// Returns the row of a pair, for now no outlier.
    pub fn of(pair: &Pair) -> Self {
        let mag = |flux: f64| -2.5 * (flux / pair.truth_dn).log10();
        Self {
            mag_g: pair.mag_g,
            bp_rp: pair.bp_rp,
            x_px: pair.real.px[0],
            y_px: pair.real.px[1],
            dx_px: pair.real.px[0] - pair.truth_px[0],
            dy_px: pair.real.px[1] - pair.truth_px[1],
            dmag: mag(pair.real.flux_dn),
            snr: pair.real.snr(),
            drawn_dx_px: pair.drawn.px[0] - pair.truth_px[0],
            drawn_dy_px: pair.drawn.px[1] - pair.truth_px[1],
            drawn_dmag: mag(pair.drawn.flux_dn),
            name: pair.name.map(|name| name.to_string()),
            is_outlier: false,
        }
    }
}

/// Figures of a bin of magnitudes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SnrRow {
    /// Middle of the bin, Gaia G.
    pub mag_g: f64,
    /// Stars.
    pub stars: usize,
    /// Mean SNR in the real frame.
    pub real: f64,
    /// Mean SNR in the drawn frame.
    pub drawn: f64,
}

/// Figures of the background.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BackgroundFigures {
    /// Places of 20 x 20 px without stars.
    pub places: usize,
    /// Mean of the real frame, DN.
    pub real_mean_dn: f64,
    /// Mean of the drawn frame, DN.
    pub drawn_mean_dn: f64,
    /// Rms over the places of the relative difference of the means.
    pub mean_difference_rms: f64,
    /// Noise of the real frame, DN rms.
    pub real_noise_dn: f64,
    /// Noise of the drawn frame, DN rms.
    pub drawn_noise_dn: f64,
    /// Drawn over real, all places.
    pub noise_ratio: f64,
    /// The same in the darker and the brighter half of the places.
    pub noise_ratio_dark_bright: [f64; 2],
}

/// Shares of the light.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EnergyFigures {
    /// Stars.
    pub stars: usize,
    /// Share of the light of 7 x 7 px within 3 x 3 and 5 x 5 px, real.
    pub real: [f64; 2],
    /// The same, drawn.
    pub drawn: [f64; 2],
    /// Standard error of the real shares.
    pub errors: [f64; 2],
    /// Mean share of the light per square pixel in rings of half a pixel, real.
    pub real_profile: Vec<f64>,
    /// The same, drawn.
    pub drawn_profile: Vec<f64>,
}

/// Returns the ratio of light to noise of a star in 5 x 5 px, the noise from that of the frame beside.
pub fn snr(plate: &Plate<'_>, spot: &Spot, noise_dn: f64) -> f64 {
    let sum: f64 = light(plate, spot, SNR_HALF_PX).map(|(_, dn)| dn).sum();
    let pixels = (2 * SNR_HALF_PX + 1).pow(2) as f64;
    sum / (sum.max(0.0) / plate.noise.gain_e_per_dn + pixels * noise_dn * noise_dn).sqrt()
}

/// Returns SNR by magnitude of both frames: a bin for each magnitude.
pub fn snr_rows(real: &Plate<'_>, drawn: &Plate<'_>, pairs: &[Pair]) -> Vec<SnrRow> {
    let noise = [real, drawn].map(|plate| noise_dn(plate.picture));
    let good = pairs.iter().filter(|pair| !pair.is_blended && !pair.real.is_saturated && !pair.drawn.is_saturated);
    #[allow(clippy::cast_possible_truncation, reason = "a magnitude")]
    let binned: Vec<(i64, f64, f64)> = good
        .map(|pair| (pair.mag_g.floor() as i64, snr(real, &pair.real, noise[0]), snr(drawn, &pair.drawn, noise[1])))
        .collect();
    let (first, last) = binned.iter().fold((i64::MAX, i64::MIN), |(a, b), row| (a.min(row.0), b.max(row.0)));
    let row = |bin: i64| {
        let of: Vec<_> = binned.iter().filter(|row| row.0 == bin).collect();
        let row = SnrRow {
            mag_g: bin as f64 + 0.5,
            stars: of.len(),
            real: mean(of.iter().map(|row| row.1)),
            drawn: mean(of.iter().map(|row| row.2)),
        };
        (row.stars > 0).then_some(row)
    };
    if binned.is_empty() { Vec::new() } else { (first..=last).filter_map(row).collect() }
}

/// Returns the background of places without stars; `stars` are places of all that are known or found, px.
pub fn background(real: &Picture, drawn: &Picture, stars: &[[f64; 2]]) -> BackgroundFigures {
    let [width, height] = real.size_px;
    let mut places = Vec::new();
    for top in (0..height.saturating_sub(PLACE_PX - 1)).step_by(PLACE_PX) {
        for left in (0..width.saturating_sub(PLACE_PX - 1)).step_by(PLACE_PX) {
            let is_near = |px: &[f64; 2]| {
                let off = |i: usize, low: usize| px[i] > low as f64 - 6.0 && px[i] < (low + PLACE_PX) as f64 + 5.0;
                off(0, left) && off(1, top)
            };
            if !stars.iter().any(is_near) {
                places.push([real, drawn].map(|picture| place_of(picture, [left, top])));
            }
        }
    }
    places.sort_by(|a, b| a[0].0.total_cmp(&b[0].0));
    let noise = |of: &[[(f64, f64); 2]], which: usize| mean(of.iter().map(|place| place[which].1.powi(2))).sqrt();
    let ratio = |of: &[[(f64, f64); 2]]| noise(of, 1) / noise(of, 0);
    let halves = places.split_at(places.len() / 2);
    BackgroundFigures {
        places: places.len(),
        real_mean_dn: mean(places.iter().map(|place| place[0].0)),
        drawn_mean_dn: mean(places.iter().map(|place| place[1].0)),
        mean_difference_rms: rms(places.iter().map(|place| (place[1].0 - place[0].0) / place[0].0.max(1.0))),
        real_noise_dn: noise(&places, 0),
        drawn_noise_dn: noise(&places, 1),
        noise_ratio: ratio(&places),
        noise_ratio_dark_bright: [ratio(halves.0), ratio(halves.1)],
    }
}

/// Returns mean and noise of a place: the spread about a plane.
fn place_of(picture: &Picture, [left, top]: [usize; 2]) -> (f64, f64) {
    let middle = 0.5 * (PLACE_PX as f64 - 1.0);
    let pixels = || (0..PLACE_PX).flat_map(|y| (0..PLACE_PX).map(move |x| (x, y)));
    let at = |(x, y): (usize, usize)| picture.at(left + x, top + y);
    let level = mean(pixels().map(at));
    let moment: f64 = (0..PLACE_PX).map(|x| (x as f64 - middle).powi(2)).sum::<f64>() * PLACE_PX as f64;
    let slope = |of: fn((usize, usize)) -> usize| {
        pixels().map(|p| (of(p) as f64 - middle) * (at(p) - level)).sum::<f64>() / moment
    };
    let [across, down] = [slope(|p| p.0), slope(|p| p.1)];
    let rest = |p: (usize, usize)| at(p) - level - across * (p.0 as f64 - middle) - down * (p.1 as f64 - middle);
    let mut values: Vec<f64> = pixels().map(rest).collect();
    // A spot without a star of the catalog may be a star all the same, or a hot pixel.
    let [_, spread] = robust(&mut values);
    let limit = 4.0 * spread.max(0.5);
    let kept = || values.iter().filter(|value| value.abs() <= limit);
    let freedom = (kept().count().max(4) - 3) as f64;
    (level, (kept().map(|value| value * value).sum::<f64>() / freedom).sqrt())
}

/// Most weight of a star's energy, in units of that of the median star: the brightest does not decide alone.
const MOST_WEIGHT: f64 = 4.0;

/// Returns the weight of a star's energy: by its light, as the noise is alike for all.
pub(crate) fn energy_weight(fluxes: impl Iterator<Item = f64>) -> impl Fn(f64) -> f64 {
    let mut all: Vec<f64> = fluxes.collect();
    let middle = base::least_squares::median(&mut all).max(f64::MIN_POSITIVE);
    move |flux| (flux / middle).min(MOST_WEIGHT)
}

/// Returns the shares of light near the stars' middles, and mean profiles.
pub fn energy(real: &Plate<'_>, drawn: &Plate<'_>, pairs: &[Pair]) -> EnergyFigures {
    let is_good = |pair: &&Pair| {
        !pair.is_blended
            && pair.real.is_placed
            && pair.drawn.is_placed
            && !pair.real.is_saturated
            && !pair.drawn.is_saturated
            && pair.real.snr() >= ENERGY_SNR
    };
    let mut stars: Vec<&Pair> = pairs.iter().filter(is_good).collect();
    stars.sort_by(|a, b| b.real.flux_dn.total_cmp(&a.real.flux_dn));
    stars.truncate(MOST_STARS);
    let lights: Vec<[[f64; 3]; 2]> =
        stars.iter().map(|pair| [squares(real, &pair.real), squares(drawn, &pair.drawn)]).collect();
    // Shares of the light of all stars together, weighted.
    let weight = energy_weight(stars.iter().map(|pair| pair.real.flux_dn));
    let weights: Vec<f64> = stars.iter().map(|pair| weight(pair.real.flux_dn)).collect();
    let weighted =
        |frame: usize, square: usize| lights.iter().zip(&weights).map(move |(star, w)| w * star[frame][square]);
    let sum = |frame: usize, square: usize| weighted(frame, square).sum::<f64>();
    let of = |frame: usize, square: usize| sum(frame, square) / sum(frame, 2);
    let error = |square: usize| {
        let rest = weighted(0, square).zip(weighted(0, 2)).map(|(part, whole)| part - of(0, square) * whole);
        (lights.len() as f64).sqrt() * rms(rest) / sum(0, 2)
    };
    EnergyFigures {
        stars: stars.len(),
        real: [of(0, 0), of(0, 1)],
        drawn: [of(1, 0), of(1, 1)],
        errors: [error(0), error(1)],
        real_profile: profile(real, stars.iter().map(|pair| &pair.real)),
        drawn_profile: profile(drawn, stars.iter().map(|pair| &pair.drawn)),
    }
}

fn light<'a>(plate: &'a Plate<'_>, spot: &'a Spot, half: i64) -> impl Iterator<Item = ([usize; 2], f64)> + 'a {
    let width = plate.picture.size_px[0];
    window(spot.px, half).map(move |[x, y]| {
        ([x, y], plate.picture.at(x, y) - f64::from(plate.background[y * width + x]) - spot.beside_dn)
    })
}

fn squares(plate: &Plate<'_>, spot: &Spot) -> [f64; 3] {
    ENERGY_HALF_PX.map(|half| light(plate, spot, half).map(|(_, dn)| dn).sum::<f64>())
}

fn profile<'a>(plate: &Plate<'_>, spots: impl Iterator<Item = &'a Spot>) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); RINGS];
    for spot in spots {
        for ([x, y], dn) in light(plate, spot, 6) {
            let r = (x as f64 - spot.px[0]).hypot(y as f64 - spot.px[1]);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a ring")]
            if let Some(ring) = sums.get_mut((r / RING_PX) as usize) {
                // Bright stars count by what they say.
                *ring = (ring.0 + dn, ring.1 + spot.flux_dn);
            }
        }
    }
    sums.into_iter().map(|(light, weight)| if weight > 0.0 { light / weight } else { f64::NAN }).collect()
}

/// Returns the radius of the middle of a ring of a profile, px.
pub fn ring_px(ring: usize) -> f64 {
    (ring as f64 + 0.5) * RING_PX
}
