//! A measured or simulated image of a star -> a pixel-integrated PSF.
//!
//! In: samples, row by row from the top, `samples_per_px` along each side of a pixel; their content ([`Holds`]). Out: a
//! [`PsfGrid`]. In order: the background is subtracted or its absence checked; light on small cells is summed over
//! pixels (a pixel of k x k cells contains exactly their sum); the flux is normalised; the star's place is moved to the
//! grid's middle by the cubic B-spline through the samples. The grid reaches as far as the image does on its nearest
//! side. Limits: the centroid is that of the whole image, so wings that the image cuts off, or noise far out, move it.
//! Tests below make the image of a known PSF, off its middle and on a background, and check that it is recovered.

use crate::optics::{psf::LARGEST_HALF_PX, psf_grid::PsfGrid, psf_grid::Spline};
use base::refused::Refused;

/// Content of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Holds {
    /// The light on its own small cell, `1 / samples_per_px` px wide: an image by finer pixels, or of a ray tracer.
    Light,
    /// The light on a whole pixel centred on it: stars of many frames combined.
    Pixels,
}

/// Background below the star.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Background {
    /// No background: refused when the border shows one.
    None,
    /// The mean of the outermost samples.
    Border,
    /// This level, in the samples' own unit.
    Level(f64),
}

/// Position of the star in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StarAt {
    /// At the image's centroid.
    Centroid,
    /// In the middle of the image.
    Middle,
    /// At this sample, counted from 0; x right, y down.
    Sample([f64; 2]),
}

/// Method of processing an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Samples along each side of a pixel.
    pub samples_per_px: usize,
    /// Content of the samples.
    pub holds: Holds,
    /// Background below the star.
    pub background: Background,
    /// Position of the star.
    pub star_at: StarAt,
    /// Share of the star's light inside the image, without background.
    pub light_inside: f64,
}

/// Largest share of an image's light in its border before a background is suspected.
const MOST_BORDER_SHARE: f64 = 0.02;

impl Measurement {
    /// Returns the PSF of an image of `width` columns.
    ///
    /// # Errors
    /// When the image is too small, not finite, dark, on an unspecified background, or not a PSF.
    pub fn psf(&self, samples: &[f64], width: usize) -> Result<PsfGrid, Refused> {
        let per_px = self.samples_per_px;
        if !(2..=32).contains(&per_px) {
            return Err(Refused(format!(
                "the image has {per_px} samples per pixel, wanted 2 to 32: fewer do not show the star's position in a pixel"
            )));
        }
        let height = samples.len() / width.max(1);
        let too_small = |reach_px: f64| {
            Refused(format!(
                "the image of {width} x {height} samples reaches {reach_px:.2} px from the star, wanted 1.5 px at least; \
                 take a larger image, or check samples_per_px and the star's position"
            ))
        };
        if width.min(height) < 3 * per_px {
            let reach_px = 0.5 * width.min(height) as f64 / per_px as f64;
            return Err(too_small(reach_px));
        }
        if let Some(at) = samples.iter().position(|v| !v.is_finite()) {
            return Err(Refused(format!(
                "the sample at column {column}, row {row} is {got}, wanted a finite number",
                column = at % width,
                row = at / width,
                got = samples[at]
            )));
        }
        let mut light = without_background(samples, [width, height], self.background)?;
        let total: f64 = light.iter().sum();
        // Samples of whole pixels contain every photon as many times as a pixel has samples.
        let shares = match self.holds {
            Holds::Light => total,
            Holds::Pixels => total / (per_px * per_px) as f64,
        };
        light.iter_mut().for_each(|v| *v *= self.light_inside / shares);
        let star = match self.star_at {
            StarAt::Sample(at) => at,
            StarAt::Middle => [width, height].map(|n| 0.5 * (n as f64 - 1.0)),
            StarAt::Centroid => centroid(&light, width),
        };
        let (pixels, [columns, rows], star) = match self.holds {
            Holds::Pixels => (light, [width, height], star),
            Holds::Light => {
                let (pixels, size) = summed_over_pixels(&light, [width, height], per_px);
                // The first pixel's middle is (k - 1) / 2 cells from the first cell.
                (pixels, size, star.map(|v| v - 0.5 * (per_px as f64 - 1.0)))
            }
        };
        let ends = [star[0], columns as f64 - 1.0 - star[0], star[1], rows as f64 - 1.0 - star[1]];
        let reach_px = ends.into_iter().fold(f64::INFINITY, f64::min) / per_px as f64;
        if reach_px.is_nan() || reach_px < 1.5 {
            return Err(too_small(reach_px));
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at least 1")]
        let half_px = ((reach_px - 0.5) as usize).min(LARGEST_HALF_PX);
        let spline = Spline::new(&pixels, columns);
        let oversampling = if per_px.is_multiple_of(2) { per_px } else { 2 * per_px };
        let value = |x: f64, y: f64| spline.at(star[0] + x * per_px as f64, star[1] + y * per_px as f64);
        PsfGrid::sampled(oversampling.min(32), half_px, value)
    }
}

fn without_background(
    samples: &[f64],
    [width, height]: [usize; 2],
    background: Background,
) -> Result<Vec<f64>, Refused> {
    let on_border = |i: usize| {
        let (x, y) = (i % width, i / width);
        x == 0 || y == 0 || x + 1 == width || y + 1 == height
    };
    let ring = || samples.iter().enumerate().filter(|(i, _)| on_border(*i)).map(|(_, v)| *v);
    let border = ring().sum::<f64>() / ring().count() as f64;
    let level = match background {
        Background::None => 0.0,
        Background::Border => border,
        Background::Level(level) => level,
    };
    let light: Vec<f64> = samples.iter().map(|v| v - level).collect();
    let total: f64 = light.iter().sum();
    let brightest = light.iter().copied().fold(0.0, f64::max);
    // No star is as faint as the mean of the remaining light.
    if total <= 0.0 || brightest * light.len() as f64 <= 2.0 * total {
        return Err(Refused(format!("the image holds {total:.3e} in all, wanted a star: more light than background")));
    }
    let share = (border - level) * light.len() as f64 / total;
    if share > MOST_BORDER_SHARE && background == Background::None {
        return Err(Refused(format!(
            "the border of the image is {border:.3e} bright, which makes {:.1} % of its light if it lies \
             under all of it; wanted at most {:.0} %: take the background off (\"border\", or its level)",
            100.0 * share,
            100.0 * MOST_BORDER_SHARE
        )));
    }
    Ok(light)
}

fn centroid(light: &[f64], width: usize) -> [f64; 2] {
    let total: f64 = light.iter().sum();
    let first = light
        .iter()
        .enumerate()
        .fold([0.0; 2], |[x, y], (i, v)| [x + v * (i % width) as f64, y + v * (i / width) as f64]);
    first.map(|v| v / total)
}

/// Returns sums over all squares of `k` x `k` cells.
fn summed_over_pixels(light: &[f64], [width, height]: [usize; 2], k: usize) -> (Vec<f64>, [usize; 2]) {
    let (columns, rows) = (width + 1 - k, height + 1 - k);
    let mut along_x = Vec::with_capacity(columns * height);
    for row in light.chunks_exact(width) {
        along_x.extend(row.windows(k).map(|cells| cells.iter().sum::<f64>()));
    }
    let at = |x: usize, y: usize| (y..y + k).map(|row| along_x[row * columns + x]).sum();
    ((0..columns * rows).map(|i| at(i % columns, i / columns)).collect(), [columns, rows])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::gaussian;

    const PLAIN: Measurement = Measurement {
        samples_per_px: 5,
        holds: Holds::Light,
        background: Background::None,
        star_at: StarAt::Centroid,
        light_inside: 1.0,
    };

    /// Returns the light of a Gaussian of [`SIGMAS`] px on cells of `1 / k` px, about sample `at`, on a level.
    fn cells(k: usize, [width, height]: [usize; 2], at: [f64; 2], level: f64) -> Vec<f64> {
        let along = |i: usize, at: f64, sigma: f64| gaussian::cell(i as f64 - at, sigma * k as f64);
        (0..width * height)
            .map(|i| 700.0 * along(i % width, at[0], SIGMAS[0]) * along(i / width, at[1], SIGMAS[1]) + level)
            .collect()
    }

    const SIGMAS: [f64; 2] = [0.9, 0.6];

    fn wanted(x: f64, y: f64) -> f64 {
        gaussian::cell(x, SIGMAS[0]) * gaussian::cell(y, SIGMAS[1])
    }

    fn worst(grid: &PsfGrid) -> f64 {
        let at = |k: i32| f64::from(k) * 0.17;
        let places = (-20..=20).flat_map(|x| (-20..=20).map(move |y| (at(x), at(y))));
        places.map(|(x, y)| (grid.pixel(x, y) - wanted(x, y)).abs()).fold(0.0, f64::max) / wanted(0.0, 0.0)
    }

    #[test]
    fn the_psf_comes_back_from_its_image() {
        // Off the middle of a rectangular image; even and odd numbers of cells.
        for k in [4, 5, 8] {
            let (size, at) = ([15 * k, 12 * k + 1], [7.3 * k as f64, 5.9 * k as f64]);
            let grid = (Measurement { samples_per_px: k, ..PLAIN }).psf(&cells(k, size, at, 0.0), size[0]).unwrap();
            assert!(worst(&grid) < 3e-4, "{k}: {:e}", worst(&grid));
            let reported = Measurement { samples_per_px: k, star_at: StarAt::Sample(at), ..PLAIN };
            let grid = reported.psf(&cells(k, size, at, 0.0), size[0]).unwrap();
            assert!(worst(&grid) < 3e-4, "{k}: {:e}", worst(&grid));
            let beside = Measurement { star_at: StarAt::Sample([at[0] + 0.1 * k as f64, at[1]]), ..reported };
            let grid = beside.psf(&cells(k, size, at, 0.0), size[0]).unwrap();
            assert!(worst(&grid) > 1e-2, "a tenth of a pixel off must be seen: {:e}", worst(&grid));
        }
    }

    #[test]
    fn samples_of_whole_pixels_are_taken_as_they_are() {
        let (k, width) = (6, 85);
        let at = [41.7, 42.2];
        let samples: Vec<f64> = (0..width * width)
            .map(|i| 3.0 * wanted(((i % width) as f64 - at[0]) / k as f64, ((i / width) as f64 - at[1]) / k as f64))
            .collect();
        let how = Measurement { samples_per_px: k, holds: Holds::Pixels, ..PLAIN };
        let grid = how.psf(&samples, width).unwrap();
        assert!(worst(&grid) < 1e-4, "{:e}", worst(&grid));
        let part = (Measurement { light_inside: 0.9, ..how }).psf(&samples, width).unwrap();
        assert!((part.flux() / grid.flux() - 0.9).abs() < 1e-12);
    }

    #[test]
    fn a_background_is_taken_off_or_refused() {
        let (k, size, at) = (5, [75, 75], [37.0, 37.0]);
        let bright = cells(k, size, at, 0.05);
        let refused = PLAIN.psf(&bright, size[0]).expect_err("a background").to_string();
        assert!(refused.contains("take the background off"), "{refused}");
        for background in [Background::Border, Background::Level(0.05)] {
            let grid = (Measurement { background, ..PLAIN }).psf(&bright, size[0]).unwrap();
            assert!(worst(&grid) < 3e-4, "{background:?}: {:e}", worst(&grid));
        }
    }

    #[test]
    fn invalid_star_image_is_refused() {
        let good = cells(5, [75, 75], [37.0, 37.0], 0.0);
        let refused = |samples: &[f64], how: Measurement| how.psf(samples, 75).expect_err("refused");
        let says = |refused: Refused, words: &str| assert!(refused.0.contains(words), "{refused}");
        says(
            refused(&good, Measurement { samples_per_px: 1, ..PLAIN }),
            "the image has 1 samples per pixel, wanted 2 to 32",
        );
        let small = Measurement { samples_per_px: 32, ..PLAIN };
        says(refused(&good, small), "px from the star, wanted 1.5 px at least");
        let far = Measurement { star_at: StarAt::Sample([2.0, 37.0]), ..PLAIN };
        says(refused(&good, far), "px from the star, wanted 1.5 px at least");
        says(refused(&[1.0; 75 * 75], PLAIN), "in all, wanted a star: more light than background");
        says(refused(&[0.0; 75 * 75], PLAIN), "in all, wanted a star: more light than background");
        let mut broken = good;
        broken[80] = f64::NAN;
        says(refused(&broken, PLAIN), "the sample at column 5, row 1 is NaN");
    }
}
