//! Bright stars -> the PSF that fits them best: a Gaussian, a Moffat profile, or a Gaussian with a halo.
//!
//! Each candidate's parameters are searched by steps that get smaller; each star has its own light, place and
//! background beside. Where two are nearly as good, the one with fewer parameters is taken.

use crate::measure::{Plate, Spot};
use crate::{figures::energy_weight, measure::Stamp, picture::window};
use plan::optics::PsfModel;

/// Half-width of the square that is fitted, px.
const HALF_PX: i64 = 4;
/// Least SNR of a star.
const LEAST_SNR: f64 = 20.0;
/// Most stars.
const MOST_STARS: usize = 60;
/// Least number of them.
const LEAST_STARS: usize = 4;
/// Part of a pixel's light that a round PSF cannot give, so that the brightest stars do not decide alone.
const FORM_ERROR: f64 = 0.03;
/// Difference of the light within 3 x 3 or 5 x 5 px of 7 x 7, all stars together, that costs [`SHARE_COST`] of chi^2.
const SHARE_ERROR: f64 = 0.01;
const SHARE_COST: f64 = 0.05;
/// Gain of chi^2 per pixel that is worth more parameters.
const WORTH: f64 = 0.01;

/// A PSF by its numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Standard deviation.
    Gaussian {
        /// px.
        sigma_px: f64,
    },
    /// Core with wings.
    Moffat {
        /// Full width at half maximum, px.
        fwhm_px: f64,
        /// Exponent.
        beta: f64,
    },
    /// Two Gaussians.
    Halo {
        /// Of the core, px.
        sigma_px: f64,
        /// Of the halo, px.
        halo_sigma_px: f64,
        /// Share of the light in the halo.
        share: f64,
    },
}

/// A fitted PSF.
#[derive(Debug, Clone)]
pub struct FittedPsf {
    /// Its form.
    pub shape: Shape,
    /// Its table.
    pub stamp: Stamp,
    /// Mean squared residual of the stars' pixels in units of their noise.
    pub chi2_per_pixel: f64,
    /// Stars that it was fitted to.
    pub stars: usize,
}

impl Shape {
    /// Returns the PSF.
    pub fn model(&self) -> PsfModel {
        match *self {
            Self::Gaussian { sigma_px } => PsfModel::gaussian(sigma_px),
            Self::Moffat { fwhm_px, beta } => PsfModel::moffat(alpha_px(fwhm_px, beta), beta),
            Self::Halo { sigma_px, halo_sigma_px, share } => PsfModel::halo(sigma_px, halo_sigma_px, share),
        }
    }

    fn of(kind: usize, p: &[f64]) -> Option<Self> {
        // The limits of the keys of `[psf]`.
        let within = |value: f64, low: f64, high: f64| (low..=high).contains(&value);
        match kind {
            0 => within(p[0], 0.3, 12.0).then_some(Self::Gaussian { sigma_px: p[0] }),
            1 => (within(p[0], 0.7, 40.0) && within(p[1], 1.25, 5.0))
                .then_some(Self::Moffat { fwhm_px: p[0], beta: p[1] }),
            _ => (within(p[0], 0.3, 12.0) && within(p[1], 1.05 * p[0], 4.0) && within(p[2], 0.0, 0.7))
                .then_some(Self::Halo { sigma_px: p[0], halo_sigma_px: p[1], share: p[2] }),
        }
    }
}

/// Returns the scale of a Moffat profile of this width.
fn alpha_px(fwhm_px: f64, beta: f64) -> f64 {
    0.5 * fwhm_px / (2_f64.powf(1.0 / beta) - 1.0).sqrt()
}

/// Returns the best PSF for the brightest isolated, unsaturated spots; `None` when there are too few.
pub fn fit(plate: &Plate<'_>, spots: &[Spot], start_sigma_px: f64) -> Option<FittedPsf> {
    let mut chosen: Vec<Spot> = spots.iter().filter(|spot| is_good(spot, spots)).copied().collect();
    chosen.sort_by(|a, b| b.flux_dn.total_cmp(&a.flux_dn));
    chosen.truncate(MOST_STARS);
    if chosen.len() < LEAST_STARS {
        return None;
    }
    let sigma = start_sigma_px;
    let starts = [
        (vec![sigma], vec![0.1]),
        (vec![(1.8 * sigma).max(0.75), 2.5], vec![0.2, 0.5]),
        (vec![(0.85 * sigma).max(0.32), 1.9 * sigma, 0.3], vec![0.1, 0.3, 0.15]),
    ];
    let mut best: Option<FittedPsf> = None;
    for (kind, (start, steps)) in starts.into_iter().enumerate() {
        let tried = search(plate, &chosen, kind, start, steps);
        let is_better =
            |before: &FittedPsf, now: &FittedPsf| now.chi2_per_pixel < before.chi2_per_pixel * (1.0 - WORTH);
        if let Some(now) = tried
            && best.as_ref().is_none_or(|before| is_better(before, &now))
        {
            best = Some(now);
        }
    }
    best
}

/// Returns true when a spot is bright, not full, and far from others that matter.
fn is_good(spot: &Spot, all: &[Spot]) -> bool {
    let disturbs = |other: &&Spot| {
        let apart = (other.px[0] - spot.px[0]).hypot(other.px[1] - spot.px[1]);
        apart > 0.0 && apart < 9.0 && other.flux_dn > 0.02 * spot.flux_dn
    };
    spot.is_placed && !spot.is_saturated && spot.snr() >= LEAST_SNR && !all.iter().any(|other| disturbs(&other))
}

fn search(plate: &Plate<'_>, spots: &[Spot], kind: usize, start: Vec<f64>, mut steps: Vec<f64>) -> Option<FittedPsf> {
    let mut here = start;
    let of = |p: &[f64]| {
        let shape = Shape::of(kind, p)?;
        let stamp = Stamp::of(&shape.model());
        let chi2_per_pixel = chi2(plate, spots, &stamp);
        chi2_per_pixel.is_finite().then_some(FittedPsf { shape, stamp, chi2_per_pixel, stars: spots.len() })
    };
    let mut best = of(&here)?;
    for _ in 0..6 {
        let mut moves = 0;
        loop {
            let before = best.chi2_per_pixel;
            for i in 0..here.len() {
                for side in [1.0, -1.0] {
                    let mut tried = here.clone();
                    tried[i] += side * steps[i];
                    if let Some(now) = of(&tried)
                        && now.chi2_per_pixel < best.chi2_per_pixel
                    {
                        (here, best) = (tried, now);
                        break;
                    }
                }
            }
            moves += 1;
            if best.chi2_per_pixel >= before || moves > 12 {
                break;
            }
        }
        steps.iter_mut().for_each(|step| *step *= 0.45);
    }
    Some(best)
}

/// Returns the mean squared residual of the stars' pixels, each star with its best light, place and background; and
/// what it costs that the light of all stars together is spread otherwise.
fn chi2(plate: &Plate<'_>, spots: &[Spot], stamp: &Stamp) -> f64 {
    let mut light = [[0.0; 3]; 2];
    let mut sum = 0.0;
    let weight = energy_weight(spots.iter().map(|spot| spot.flux_dn));
    for spot in spots {
        let (own, shares) = star_chi2(plate, spot, stamp);
        sum += own;
        (0..2).for_each(|of| (0..3).for_each(|square| light[of][square] += weight(spot.flux_dn) * shares[of][square]));
    }
    let share = |of: usize, square: usize| light[of][square] / light[of][2];
    let cost = |square: usize| SHARE_COST * ((share(0, square) - share(1, square)) / SHARE_ERROR).powi(2);
    sum / spots.len() as f64 + cost(0) + cost(1)
}

/// Returns a star's mean squared residual, and its light within 3 x 3, 5 x 5 and 7 x 7 px, real and by the PSF.
fn star_chi2(plate: &Plate<'_>, spot: &Spot, stamp: &Stamp) -> (f64, [[f64; 3]; 2]) {
    const STEP_PX: f64 = 0.02;
    let width = plate.picture.size_px[0];
    let (mut px, mut flux, mut level) = (spot.px, spot.flux_dn, spot.beside_dn);
    let mut chi2 = f64::NAN;
    let mut light = [[0.0; 3]; 2];
    for round in 0..4 {
        let (mut rows, mut values, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        chi2 = 0.0;
        light = [[0.0; 3]; 2];
        for [x, y] in window(spot.px, HALF_PX) {
            let i = y * width + x;
            let (dx, dy) = (x as f64 - px[0], y as f64 - px[1]);
            let share = stamp.at(dx, dy);
            let slope =
                |ax: f64, ay: f64| flux * (stamp.at(dx - ax, dy - ay) - stamp.at(dx + ax, dy + ay)) / (2.0 * STEP_PX);
            let rest = f64::from(plate.picture.dn[i] - plate.background[i]) - level - flux * share;
            let mean = f64::from(plate.background[i]) + level + (flux * share).max(0.0);
            let weight = 1.0 / (plate.noise.variance(mean) + (FORM_ERROR * flux * share).powi(2));
            chi2 += weight * rest * rest;
            let off = (x as f64 - spot.px[0].round()).abs().max((y as f64 - spot.px[1].round()).abs());
            for square in (0..3).filter(|square| off < [1.5, 2.5, 3.5][*square]) {
                light[0][square] += rest + level - spot.beside_dn + flux * share;
                light[1][square] += flux * share;
            }
            rows.push(vec![share, slope(STEP_PX, 0.0), slope(0.0, STEP_PX), 1.0]);
            values.push(rest);
            weights.push(weight);
        }
        chi2 /= values.len() as f64;
        if round == 3 {
            break;
        }
        let Some(step) = crate::newton::linear(&rows, &values, &weights) else { return (f64::NAN, light) };
        flux = (flux + step.values[0]).max(0.0);
        px = [px[0] + step.values[1].clamp(-0.3, 0.3), px[1] + step.values[2].clamp(-0.3, 0.3)];
        level += step.values[3];
    }
    (chi2, light)
}
