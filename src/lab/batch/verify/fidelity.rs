//! A field of stars for measurements, and how faithful its noisy frames are.
//!
//! Fidelity by brightness: signal-to-noise ratio, centroid, energy and background of many noisy frames compared with
//! analytic truth.
//!
//! In: an instrument, and a function that draws and reads out plans. Out: [`Fidelity`], the table by which
//! dense-star-field simulators have been judged (errors of SNR, centroid, background mean and sigma, energy
//! concentration; stars by brightness, background in places of 20 x 20 px), here compared with truth instead of a
//! telescope.
//!
//! Truth, independent code here: electrons of a pixel = star x PSF integral over it (f64) x its own response + dark +
//! its own offset; variance = light + dark + read noise^2 + gain^2 / 12; SNR of a window = signal over the root of the
//! sum of variances; centroid error of a window = root of `sum (x - c)^2 variance / signal^2`. It knows the pixels' own
//! responses and offsets, as for a telescope with flat-fielded images.
//!
//! *Limits.* Stars are static and well separated; pixels stay below saturation. The statistical error is reported:
//! `*_se` is one standard error. *Validation.* `tests/physics/fidelity.rs`.

use crate::verify::data_sheet::Stated;
use base::{image::DnImage, random::philox};
use image::detector::line_pattern::Lines;
use image::detector::{Detector, Patterns};
use plan::exposure::{Source, SourcePlace};
use plan::optics::PsfModel;
use serde::Serialize;
use std::sync::Arc;

/// Parameters of the frames that truth needs.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// PSF.
    pub psf: PsfModel,
    /// Electrons of a pixel without light.
    pub dark_e: f64,
    /// White noise of a pixel's readout, e- rms.
    pub read_noise_e_rms: f64,
    /// Noise shared by a row, e- rms; taken as independent from row to row, which does not apply to 1/f noise.
    pub row_noise_e_rms: f64,
    /// Spread of the pixels' dark means, e- rms.
    pub dsnu_e_rms: f64,
    /// Electrons per digital number.
    pub gain_e_per_dn: f64,
    /// Digital number of no electrons.
    pub black_level_dn: f64,
    /// Response, dark current and offset of every pixel.
    pub patterns: Patterns,
    /// Gain and offset of every column and row.
    pub lines: Lines,
    /// Columns.
    pub width_px: usize,
}

/// Response, dark current and offset of one pixel.
struct Own {
    response: f64,
    dark_e: f64,
    gain: f64,
    offset_e: f64,
}

impl Truth {
    /// Returns the truth about frames of `detector` with this exposure, whose stars have this PSF. Its response must be
    /// linear, and all effects of neighbours off.
    pub fn of(detector: &Detector, psf: PsfModel, exposure_s: f64) -> Self {
        let (params, stated) = (detector.params(), Stated::of(detector.params(), exposure_s));
        Self {
            psf,
            dark_e: stated.dark_e_per_s * exposure_s,
            read_noise_e_rms: params.readout_noise_e_rms(),
            row_noise_e_rms: (stated.read_noise_e_rms.powi(2) - params.readout_noise_e_rms().powi(2)).max(0.0).sqrt(),
            dsnu_e_rms: stated.dsnu_e_rms,
            gain_e_per_dn: params.gain_e_per_dn,
            black_level_dn: params.black_level_dn,
            patterns: detector.patterns().clone(),
            lines: detector.lines().clone(),
            width_px: detector.size_px()[0],
        }
    }

    /// Returns the electrons of a star whose window has this signal-to-noise ratio: the larger root of `S^2 = snr^2
    /// (S + n v)`.
    pub fn electrons_for_snr(&self, snr: f64) -> f64 {
        let pixels = (2 * HALF_PX + 1).pow(2) as f64;
        let noise = pixels * (self.dark_e + self.white_noise_e2());
        0.5 * (snr * snr + (snr.powi(4) + 4.0 * snr * snr * noise).sqrt())
    }

    /// Returns the variance of a pixel that does not depend on its charge, e-^2.
    fn white_noise_e2(&self) -> f64 {
        self.read_noise_e_rms.powi(2) + self.gain_e_per_dn.powi(2) / 12.0
    }

    fn own(&self, [x, y]: [usize; 2]) -> Own {
        let at = |map: &Option<Arc<[f32]>>| {
            map.as_ref().and_then(|map| map.get(y * self.width_px + x)).copied().map(f64::from)
        };
        let line = |lines: &[f32], i: usize| lines.get(i).copied().map(f64::from);
        let Patterns { prnu, dsnu_e, dark_factor } = &self.patterns;
        let Lines { column_gain, column_e, row_e } = &self.lines;
        Own {
            response: 1.0 + at(prnu).unwrap_or(0.0),
            dark_e: self.dark_e * at(dark_factor).unwrap_or(1.0),
            gain: line(column_gain, x).unwrap_or(1.0),
            offset_e: at(dsnu_e).unwrap_or(0.0) + line(column_e, x).unwrap_or(0.0) + line(row_e, y).unwrap_or(0.0),
        }
    }
}

/// Stars of one brightness.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FidelityRow {
    /// Electrons of each star.
    pub electrons: f64,
    /// Number of stars.
    pub stars: usize,
    /// True signal-to-noise ratio in the window, mean of the stars.
    pub snr: f64,
    /// Relative error of the measured one.
    pub snr_error: f64,
    /// Its standard error.
    #[serde(skip)]
    pub snr_se: f64,
    /// Mean distance of the centroid from truth, along the worse axis, px.
    pub centroid_bias_px: f64,
    /// Its standard error.
    #[serde(rename = "centroid_bias_standard_error_px")]
    pub centroid_bias_se_px: f64,
    /// True scatter of a centroid along one axis, px rms.
    pub scatter_px: f64,
    /// Relative error of the measured one (NaN if noise biases the centroid: SNR below [`LEAST_CENTROID_SNR`]).
    pub scatter_error: f64,
    /// True share of the light in the window.
    pub energy: f64,
    /// Relative error of the measured one.
    pub energy_error: f64,
}

/// Background in empty places.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BackgroundRow {
    /// Number of places.
    pub places: usize,
    /// True mean above the black level, e-.
    pub mean_e: f64,
    /// Relative error of the measured mean (black level included, as in an image).
    pub mean_error: f64,
    /// True spread, e- rms.
    pub sigma_e: f64,
    /// Relative error of the measured one.
    pub sigma_error: f64,
    /// Its standard error.
    pub sigma_se: f64,
}

/// The whole table.
#[derive(Debug, Clone, PartialEq)]
pub struct Fidelity {
    /// Rows by brightness, in the order of the field's.
    pub rows: Vec<FidelityRow>,
    /// Empty places.
    pub background: BackgroundRow,
    /// Frames that were taken.
    pub frames: u32,
}

/// Smallest SNR at which the ratio of first moment and signal is a centroid.
pub const LEAST_CENTROID_SNR: f64 = 10.0;

/// Sums over frames of one star's window.
#[derive(Debug, Clone)]
struct StarSums {
    /// The pixels, with their true light and their electrons without it.
    truth: Vec<([usize; 2], [f64; 2])>,
    signal_e: f64,
    centroid_px: [f64; 2],
    /// Sums of signal, its square, and squares of the centroid's distance.
    signal: [f64; 2],
    distance2: [f64; 2],
    /// Sum of every pixel's electrons.
    pixels_e: Vec<f64>,
}

impl StarSums {
    fn new(star: &FieldStar, electrons: f64, truth: &Truth) -> Self {
        let pixel = |at: [usize; 2]| {
            let [x, y] = [at[0] as f64 - star.px[0], at[1] as f64 - star.px[1]];
            let own = truth.own(at);
            let light_e = electrons * truth.psf.pixel_of(star.px, x, y) * own.response;
            (at, [own.gain * light_e, own.gain * own.dark_e + own.offset_e])
        };
        let truth: Vec<_> = star.window().map(pixel).collect();
        let (signal_e, centroid_px) = moments(truth.iter().map(|(at, [light, _])| (*at, *light)));
        let pixels_e = vec![0.0; truth.len()];
        Self { truth, signal_e, centroid_px, signal: [0.0; 2], distance2: [0.0; 2], pixels_e }
    }

    fn add(&mut self, image: &DnImage, truth: &Truth) {
        for (sum, (at, _)) in self.pixels_e.iter_mut().zip(&self.truth) {
            *sum += electrons_at(image, *at, truth);
        }
        let pixels = self.truth.iter().map(|(at, [_, without])| (*at, electrons_at(image, *at, truth) - without));
        let (signal, centroid) = moments(pixels);
        self.signal[0] += signal;
        self.signal[1] += signal * signal;
        for (sum, (c, wanted)) in self.distance2.iter_mut().zip(centroid.iter().zip(self.centroid_px)) {
            *sum += (c - wanted).powi(2);
        }
    }

    /// Returns true variance of the window's signal, and of its centroid along both axes.
    fn variances(&self, truth: &Truth) -> (f64, [f64; 2]) {
        let mut variances = (0.0, [0.0; 2]);
        // Effect of a pixel's noise on the centroid, along both axes.
        let lever = |at: &[usize; 2], i: usize| (at[i] as f64 - self.centroid_px[i]) / self.signal_e;
        for (at, [light, _]) in &self.truth {
            let own = truth.own(*at);
            // The column's gain multiplies the noise of its counts.
            let variance = own.gain * (light + own.gain * own.dark_e) + truth.white_noise_e2();
            variances.0 += variance;
            (0..2).for_each(|i| variances.1[i] += lever(at, i).powi(2) * variance);
        }
        let row_variance = truth.row_noise_e_rms.powi(2);
        for row in self.truth.chunk_by(|(a, _), (b, _)| a[1] == b[1]).filter(|_| row_variance > 0.0) {
            variances.0 += (row.len() as f64).powi(2) * row_variance;
            for i in 0..2 {
                variances.1[i] += row.iter().map(|(at, _)| lever(at, i)).sum::<f64>().powi(2) * row_variance;
            }
        }
        variances
    }

    /// Returns the difference of the mean centroid of all frames from the true one, px.
    fn bias_px(&self, frames: f64) -> [f64; 2] {
        let pixels = self.truth.iter().zip(&self.pixels_e);
        let mean = pixels.map(|((at, [_, without]), sum)| (*at, sum / frames - without));
        let centroid = moments(mean).1;
        [centroid[0] - self.centroid_px[0], centroid[1] - self.centroid_px[1]]
    }
}

fn electrons_at(image: &DnImage, [x, y]: [usize; 2], truth: &Truth) -> f64 {
    let dn = image.get(x, y).map_or(f64::NAN, f64::from);
    (dn - truth.black_level_dn) * truth.gain_e_per_dn
}

/// Returns sum and centroid.
fn moments(pixels: impl Iterator<Item = ([usize; 2], f64)>) -> (f64, [f64; 2]) {
    let [sum, x, y] =
        pixels.fold([0.0; 3], |[sum, x, y], (at, e)| [sum + e, x + e * at[0] as f64, y + e * at[1] as f64]);
    (sum, [x / sum, y / sum])
}

/// Draws `frames` frames of `field` with `read_out` and compares them with truth.
///
/// # Errors
/// Those of `read_out`.
pub fn measure<E>(
    field: &StarField,
    truth: &Truth,
    size_px: [usize; 2],
    frames: u32,
    mut read_out: impl FnMut(u32, &mut DnImage) -> Result<(), E>,
) -> Result<Fidelity, E> {
    let mut stars: Vec<StarSums> =
        field.stars.iter().map(|star| StarSums::new(star, field.electrons[star.bin], truth)).collect();
    let mut background = [0.0; 2];
    let mut image = DnImage::new(size_px[0], size_px[1]);
    for frame in 0..frames {
        read_out(frame, &mut image)?;
        stars.iter_mut().for_each(|star| star.add(&image, truth));
        for region in &field.regions {
            let [mean, variance] = spread(&image, *region, truth);
            background = [background[0] + mean, background[1] + variance];
        }
    }
    let of_bin =
        |bin: usize| field.stars.iter().zip(&stars).filter(move |(star, _)| star.bin == bin).map(|(_, sums)| sums);
    let rows = (0..field.electrons.len())
        .map(|bin| row(field.electrons[bin], &of_bin(bin).collect::<Vec<_>>(), frames, truth))
        .collect();
    Ok(Fidelity { rows, background: background_row(background, field.regions.len(), frames, truth), frames })
}

/// Returns mean and variance over one empty place, e-.
fn spread(image: &DnImage, [left, top]: [usize; 2], truth: &Truth) -> [f64; 2] {
    let pixels = (0..REGION_PX * REGION_PX).map(|i| [left + i % REGION_PX, top + i / REGION_PX]);
    let count = (REGION_PX * REGION_PX) as f64;
    let [sum, squares] = pixels.fold([0.0; 2], |[sum, squares], at| {
        let e = electrons_at(image, at, truth) - truth.dark_e;
        [sum + e, squares + e * e]
    });
    let mean = sum / count;
    [mean + truth.dark_e, (squares - count * mean * mean) / (count - 1.0)]
}

fn background_row(sums: [f64; 2], places: usize, frames: u32, truth: &Truth) -> BackgroundRow {
    let count = places as f64 * f64::from(frames);
    let offset_e = truth.black_level_dn * truth.gain_e_per_dn;
    let temporal = truth.dark_e + truth.white_noise_e2() + truth.row_noise_e_rms.powi(2);
    let fixed = truth.dsnu_e_rms.powi(2);
    let sigma_e = (temporal + fixed).sqrt();
    let pixels = (REGION_PX * REGION_PX) as f64 * places as f64;
    // The fixed part of the variance is the same in every frame.
    let variance_se =
        ((2.0 / pixels) * (fixed * fixed + temporal * (temporal + 2.0 * fixed) / f64::from(frames))).sqrt();
    BackgroundRow {
        places,
        mean_e: truth.dark_e,
        mean_error: (sums[0] / count + offset_e) / (truth.dark_e + offset_e) - 1.0,
        sigma_e,
        sigma_error: (sums[1] / count).sqrt() / sigma_e - 1.0,
        sigma_se: 0.5 * variance_se / (sigma_e * sigma_e),
    }
}

fn row(electrons: f64, stars: &[&StarSums], frames: u32, truth: &Truth) -> FidelityRow {
    let (count, taken) = (stars.len() as f64, f64::from(frames));
    let mean = |value: &dyn Fn(&StarSums) -> f64| stars.iter().map(|star| value(star)).sum::<f64>() / count;
    let snr = mean(&|star| star.signal_e / star.variances(truth).0.sqrt());
    let signal_error = mean(&|star| star.signal[0] / taken / star.signal_e) - 1.0;
    let noise = mean(&|star| {
        let signal = star.signal[0] / taken;
        (star.signal[1] - taken * signal * signal) / (taken - 1.0) / star.variances(truth).0
    });
    let scatter2 = mean(&|star| star.variances(truth).1.iter().sum::<f64>() / 2.0);
    let measured2 = mean(&|star| star.distance2.iter().sum::<f64>() / 2.0 / taken);
    let bias = |axis: usize| mean(&|star| star.bias_px(taken)[axis]);
    FidelityRow {
        electrons,
        stars: stars.len(),
        snr,
        snr_error: (1.0 + signal_error) / noise.sqrt() - 1.0,
        // Noise contributes 1 / sqrt(2 n); the signal 1 / (SNR sqrt(n)).
        snr_se: ((0.5 + snr.powi(-2)) / (count * taken)).sqrt(),
        centroid_bias_px: bias(0).abs().max(bias(1).abs()),
        centroid_bias_se_px: (scatter2 / (count * taken)).sqrt(),
        scatter_px: scatter2.sqrt(),
        scatter_error: if snr < LEAST_CENTROID_SNR { f64::NAN } else { (measured2 / scatter2).sqrt() - 1.0 },
        energy: mean(&|star| star.signal_e) / electrons,
        energy_error: signal_error,
    }
}

// A field for measurements: stars of a few brightnesses at random pixel phases, well separated, and empty places.
//
// In: the detector's size, electrons of each brightness, a seed. Out: sources for a planner, with the cell of each
// star. The detector is divided into cells of [`CELL_PX`]; brightnesses and empty cells are assigned at random, so
// that each is spread over all quadrants.

/// Side of the cell around a star or an empty place, px.
pub const CELL_PX: usize = 40;
/// Side of an empty place whose background is measured, px (the published comparison's).
pub const REGION_PX: usize = 20;
/// Half-width of the window around a star that is measured, px.
pub const HALF_PX: i64 = 3;

/// One star.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldStar {
    /// Index of its brightness.
    pub bin: usize,
    /// Its position.
    pub px: [f64; 2],
}

/// Stars and empty places.
#[derive(Debug, Clone, PartialEq)]
pub struct StarField {
    /// Electrons of each brightness.
    pub electrons: Vec<f64>,
    /// Stars.
    pub stars: Vec<FieldStar>,
    /// Top left pixel of every empty place.
    pub regions: Vec<[usize; 2]>,
}

impl StarField {
    /// Returns as many cells as fit a detector of `size_px`, assigned to the brightnesses and to empty places.
    pub fn new(size_px: [usize; 2], electrons: Vec<f64>, seed: u32) -> Self {
        let [columns, rows] = size_px.map(|side| side / CELL_PX);
        let mut cells: Vec<u32> = (0..).take(columns * rows).collect();
        cells.sort_by_key(|cell| philox([*cell, 1, 0, 0], [seed, 0])[0]);
        let mut field = Self { stars: Vec::new(), regions: Vec::new(), electrons };
        let kinds = field.electrons.len() + 1;
        for (i, cell) in cells.into_iter().enumerate() {
            let corner = [cell as usize % columns * CELL_PX, cell as usize / columns * CELL_PX];
            if i % kinds == field.electrons.len() {
                field.regions.push(corner.map(|v| v + (CELL_PX - REGION_PX) / 2));
                continue;
            }
            let off = philox([cell, 2, 0, 0], [seed, 0]).map(|word| f64::from(word) / 4_294_967_296.0 - 0.5);
            let middle = |v: usize, off: f64| (v + CELL_PX / 2) as f64 + off;
            field.stars.push(FieldStar { bin: i % kinds, px: [middle(corner[0], off[0]), middle(corner[1], off[1])] });
        }
        field
    }

    /// Returns its stars for a planner.
    pub fn sources(&self) -> Vec<Source> {
        let source = |(id, star): (u32, &FieldStar)| Source {
            id,
            electrons: self.electrons[star.bin],
            mag: f32::NAN,
            place: SourcePlace::Pixel(star.px),
        };
        (0..).zip(&self.stars).map(source).collect()
    }
}

impl FieldStar {
    /// Returns the pixels of its window, by row.
    pub fn window(&self) -> impl Iterator<Item = [usize; 2]> + Clone + use<> {
        #[allow(clippy::cast_possible_truncation, reason = "a place on a detector")]
        let [column, row] = self.px.map(|v| v.round() as i64);
        let span = |middle: i64| (middle - HALF_PX..=middle + HALF_PX).filter_map(|v| usize::try_from(v).ok());
        span(row).flat_map(move |y| span(column).map(move |x| [x, y]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightnesses_and_empty_places_are_dealt_out_evenly_and_stay_apart() {
        let field = StarField::new([1024, 800], vec![1e3, 1e4, 1e5], 7);
        assert_eq!(field.stars.len() + field.regions.len(), 25 * 20);
        for bin in 0..3 {
            let of_bin: Vec<_> = field.stars.iter().filter(|star| star.bin == bin).collect();
            assert_eq!(of_bin.len(), 125);
            let left = of_bin.iter().filter(|star| star.px[0] < 512.0).count();
            assert!((40..=85).contains(&left), "both halves: {left}");
        }
        for (i, star) in field.stars.iter().enumerate() {
            let apart = |other: &FieldStar| (star.px[0] - other.px[0]).abs().max((star.px[1] - other.px[1]).abs());
            assert!(field.stars[..i].iter().all(|other| apart(other) > CELL_PX as f64 - 1.5));
            assert_eq!(star.window().count(), 49);
        }
        assert_ne!(field, StarField::new([1024, 800], vec![1e3, 1e4, 1e5], 8), "follows the seed");
    }
}
