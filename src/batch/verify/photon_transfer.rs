//! Photon transfer: flats and darks -> gain, noise, dark current, patterns, linearity, saturation.
//!
//! The procedure of EMVA 1288 Release 4.0 Linear, with our own names for its K (here `1 / gain_e_per_dn`), `mu_p` (here
//! electrons of light: the quantum efficiency is not needed) and so on:
//!
//! 1. *Saturation*: light is doubled until the mean no longer rises; the plateau over the dark level is the capacity.
//! 2. *Photon transfer* (section 6.6): pairs at [`Procedure::levels`] levels; slope of variance over mean, both less their
//!    dark values, up to 70 % of saturation, is `1 / gain`. Weights: a variance errs by its own share.
//! 3. *Linearity* (section 6.7): a line through the means from 5 to 95 % of saturation, weights `1 / y^2`; largest deviation.
//! 4. *Dark* (section 7.1): means of pairs over a series of exposures; slope is the dark current. Variance at no exposure, less
//!    1/12 DN^2, is the read noise.
//! 5. *Patterns* (section 8.2): stacks of darks and of flats at half saturation; `prnu = sqrt(s50^2 - sdark^2) / (mean50 -
//!    meandark)`.
//!
//! *Limits.* A dark noise below 0.4 DN is not visible through the quantisation; the gain is that of a linear detector:
//! for a curved response it is the mean slope. Errors for 512 x 512 pixels and the default procedure: gain 0.2 %, read
//! noise 0.2 %, patterns 0.5 % if they exceed the noise of the stack. Checked by `tests/physics/photon_transfer.rs`.

use crate::verify::flats::{Pair, Pattern, Stack};
use crate::verify::{DataSheet, data_sheet::LightPoint, linear_fit::Line};
use base::image::DnImage;

/// Variance of rounding to whole DN.
pub const QUANTISATION_DN2: f64 = 1.0 / 12.0;
/// Shares of saturation between which linearity is evaluated (EMVA 1288, section 6.7).
const JUDGED: [f64; 2] = [0.05, 0.95];
/// Relative rise of the mean for a doubling of light below which the detector is saturated.
const PLATEAU: f64 = 1e-3;
/// Largest number of doublings from one electron on: no well is deeper.
const MOST_DOUBLINGS: u32 = 34;

/// One flat exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flat {
    /// Mean electrons per pixel from light.
    pub light_e: f64,
    /// Exposure, s.
    pub exposure_s: f64,
    /// Number of the frame: every frame is used once.
    pub frame: u32,
}

/// Scope of the measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Procedure {
    /// Exposure of everything but the dark series, s.
    pub exposure_s: f64,
    /// Longest exposure of the dark series, s.
    pub longest_dark_s: f64,
    /// Levels of light.
    pub levels: u32,
    /// Number of exposures of the dark series, besides zero.
    pub darks: u32,
    /// Number of images of a stack.
    pub stacked: u32,
    /// Share of saturation up to which the photon transfer is fitted (EMVA 1288, section 6.6: 0.7); less for a bent
    /// response.
    pub fitted: f64,
}

impl Procedure {
    /// Returns EMVA's 50 levels and its minimum of 16 stacked images.
    pub fn new(exposure_s: f64, longest_dark_s: f64) -> Self {
        Self { exposure_s, longest_dark_s, levels: 50, darks: 8, stacked: 32, fitted: 0.7 }
    }
}

/// Source of flats: a camera.
struct Laboratory<'a> {
    expose: &'a mut dyn FnMut(Flat, &mut DnImage),
    images: [DnImage; 2],
    frame: u32,
}

/// Measures a detector with `expose`, which returns images of `size_px`.
#[must_use]
pub fn characterise(
    size_px: [usize; 2],
    procedure: &Procedure,
    expose: &mut dyn FnMut(Flat, &mut DnImage),
) -> DataSheet {
    let images = [(); 2].map(|()| DnImage::new(size_px[0], size_px[1]));
    let mut lab = Laboratory { expose, images, frame: 0 };
    let dark = lab.pair(0.0, procedure.exposure_s);
    let (plateau_dn, saturating_e) = lab.saturation(procedure.exposure_s);
    let points = lab.levels(procedure, saturating_e, dark);
    let gain_e_per_dn = 1.0 / transfer(&points, procedure.fitted * (plateau_dn - dark.mean_dn)).slope;
    let [level, noise] = lab.dark_series(procedure);
    let (darks, flats) =
        (lab.stack(0.0, procedure), lab.stack(half_light(&points, plateau_dn - dark.mean_dn), procedure));
    DataSheet {
        gain_e_per_dn,
        black_level_dn: level.offset,
        read_noise_e_rms: (noise.offset - QUANTISATION_DN2).max(0.0).sqrt() * gain_e_per_dn,
        dark_e_per_s: level.slope * gain_e_per_dn,
        dsnu_e_rms: darks.spatial_variance_dn2.max(0.0).sqrt() * gain_e_per_dn,
        dsnu2_se: darks.spatial_variance_se_dn2 * gain_e_per_dn * gain_e_per_dn,
        prnu: prnu(&darks, &flats),
        saturation_e: (plateau_dn - dark.mean_dn) * gain_e_per_dn,
        responsivity: responsivity(&points, plateau_dn - dark.mean_dn).slope * gain_e_per_dn,
        linearity_error: linearity_error(&points, plateau_dn - dark.mean_dn),
        points,
    }
}

impl Laboratory<'_> {
    fn pair(&mut self, light_e: f64, exposure_s: f64) -> Pair {
        for image in &mut self.images {
            (self.expose)(Flat { light_e, exposure_s, frame: self.frame }, image);
            self.frame += 1;
        }
        Pair::of(&self.images[0], &self.images[1])
    }

    /// Returns the mean of a saturated image, DN, and the light that first gave it.
    fn saturation(&mut self, exposure_s: f64) -> (f64, f64) {
        let mut before = self.pair(0.0, exposure_s).mean_dn;
        let dark = before;
        let mut light_e = 1.0;
        for _ in 0..MOST_DOUBLINGS {
            let mean = self.pair(light_e, exposure_s).mean_dn;
            let rises = mean - before > PLATEAU * (mean - dark).max(1.0);
            // The first doublings are below the noise.
            if !rises && mean - dark > 10.0 {
                return (mean, 0.5 * light_e);
            }
            (before, light_e) = (mean, 2.0 * light_e);
        }
        (before, light_e)
    }

    /// Returns pairs at even steps of light up to the first saturated one, minus the dark pair.
    fn levels(&mut self, procedure: &Procedure, saturating_e: f64, dark: Pair) -> Vec<LightPoint> {
        let point = |i: u32| {
            let light_e = saturating_e * f64::from(i) / f64::from(procedure.levels);
            let pair = self.pair(light_e, procedure.exposure_s);
            let (signal_dn, variance_dn2) = (pair.mean_dn - dark.mean_dn, pair.variance_dn2 - dark.variance_dn2);
            LightPoint { light_e, signal_dn, variance_dn2, total_variance_dn2: pair.variance_dn2 }
        };
        (1..=procedure.levels).map(point).collect()
    }

    /// Returns lines of mean and variance over the exposure, without light.
    fn dark_series(&mut self, procedure: &Procedure) -> [Line; 2] {
        let pair = |i: u32| {
            let exposure_s = procedure.longest_dark_s * f64::from(i) / f64::from(procedure.darks);
            (exposure_s, self.pair(0.0, exposure_s))
        };
        let pairs: Vec<(f64, Pair)> = (0..=procedure.darks).map(pair).collect();
        // The error of a variance is a share of itself, that of a mean its noise.
        let means = pairs.iter().map(|(s, pair)| [*s, pair.mean_dn, 1.0 / pair.variance_dn2.max(1e-3)]);
        let variances = pairs.iter().map(|(s, pair)| [*s, pair.variance_dn2, pair.variance_dn2.max(1e-3).powi(-2)]);
        [Line::through(means), Line::through(variances)]
    }

    fn stack(&mut self, light_e: f64, procedure: &Procedure) -> Pattern {
        let image = &mut self.images[0];
        let mut stack = Stack::new(image.pixels().len());
        for _ in 0..procedure.stacked {
            (self.expose)(Flat { light_e, exposure_s: procedure.exposure_s, frame: self.frame }, image);
            self.frame += 1;
            stack.add(image);
        }
        stack.pattern()
    }
}

/// Returns the points between two shares of the saturation signal.
fn between(
    points: &[LightPoint],
    saturation_dn: f64,
    [low, high]: [f64; 2],
) -> impl Iterator<Item = &LightPoint> + Clone {
    points.iter().filter(move |p| (low * saturation_dn..=high * saturation_dn).contains(&p.signal_dn))
}

/// Returns the line of variance over mean.
fn transfer(points: &[LightPoint], most_dn: f64) -> Line {
    let fitted = between(points, most_dn, [0.0, 1.0]);
    Line::through(fitted.map(|p| [p.signal_dn, p.variance_dn2, p.total_variance_dn2.powi(-2)]))
}

/// Returns the line of mean over light.
fn responsivity(points: &[LightPoint], saturation_dn: f64) -> Line {
    let judged = between(points, saturation_dn, JUDGED);
    Line::through(judged.map(|p| [p.light_e, p.signal_dn, p.signal_dn.powi(-2)]))
}

/// Returns the largest relative deviation from the straight line.
fn linearity_error(points: &[LightPoint], saturation_dn: f64) -> f64 {
    let line = responsivity(points, saturation_dn);
    let judged = between(points, saturation_dn, JUDGED);
    judged.map(|p| (p.signal_dn / line.at(p.light_e) - 1.0).abs()).fold(0.0, f64::max)
}

/// Returns the light that gives half of the saturation signal.
fn half_light(points: &[LightPoint], saturation_dn: f64) -> f64 {
    let line = responsivity(points, saturation_dn);
    (0.5 * saturation_dn - line.offset) / line.slope
}

fn prnu(darks: &Pattern, flats: &Pattern) -> f64 {
    let variance = (flats.spatial_variance_dn2 - darks.spatial_variance_dn2).max(0.0);
    variance.sqrt() / (flats.mean_dn - darks.mean_dn)
}
