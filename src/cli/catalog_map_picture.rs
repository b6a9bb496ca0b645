//! A density map -> a PNG: the sky as an ellipse, below it the colours with their densities.

use crate::cli::lettering::{LETTER_PX, dots, width_px};
use imports::density_map::{DensityMap, direction_at};
use std::io::{self, Write};

/// Size of the sky, pixels.
const SKY_PX: [usize; 2] = [1440, 720];
/// Between the sky and the edges, and the legend.
const MARGIN_PX: usize = 16;
/// Height of the legend's colours, pixels.
const BAR_PX: usize = 14;
/// Dots of letters are so many pixels wide.
const LETTER_SCALE: usize = 2;
/// Behind everything.
const PAPER: [u8; 3] = [255, 255, 255];
/// Colour of places without stars.
const EMPTY: [u8; 3] = [0, 0, 0];
/// Letters and lines.
const INK: [u8; 3] = [40, 40, 40];
/// Colours from sparse to dense, evenly apart: from black over violet and orange to light yellow, brighter all the way,
/// so that the picture reads in grey too.
const COLOURS: [[u8; 3]; 9] = [
    [4, 4, 20],
    [31, 12, 72],
    [85, 15, 109],
    [136, 34, 106],
    [186, 54, 85],
    [227, 89, 51],
    [249, 140, 10],
    [249, 201, 50],
    [252, 255, 164],
];

/// Writes the picture: `what` names the densities in its legend.
///
/// # Errors
/// When the output fails.
pub(super) fn write_png(out: impl Write, map: &DensityMap, is_galactic: bool, what: &str) -> io::Result<()> {
    let width = SKY_PX[0] + 2 * MARGIN_PX;
    let text_px = LETTER_SCALE * LETTER_PX[1];
    let height = SKY_PX[1] + 4 * MARGIN_PX + BAR_PX + 2 * text_px;
    let mut canvas = Canvas { width, pixels: vec![PAPER; width * height] };
    let scale = Scale::of(map);
    for y in 0..SKY_PX[1] {
        for x in 0..SKY_PX[0] {
            let across = |at: usize, size: usize| (at as f64 + 0.5) / size as f64 * 2.0 - 1.0;
            if let Some(direction) = direction_at(across(x, SKY_PX[0]), -across(y, SKY_PX[1]), is_galactic) {
                canvas.set([x + MARGIN_PX, y + MARGIN_PX], scale.colour(map.density(direction)));
            }
        }
    }
    canvas.legend(&scale, SKY_PX[1] + 2 * MARGIN_PX, what);
    canvas.write(out)
}

/// Densities -> colours, by their logarithm.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scale {
    log10: [f64; 2],
}

impl Scale {
    fn of(map: &DensityMap) -> Self {
        let [low, high] = map.range().unwrap_or([1.0, 10.0]).map(f64::log10);
        // Half a decade at least: the small noise of an even sky must not fill the range of colours.
        Self { log10: [low, high.max(low + 0.5)] }
    }

    fn colour(&self, density: f64) -> [u8; 3] {
        if density > 0.0 {
            self.colour_at((density.log10() - self.log10[0]) / (self.log10[1] - self.log10[0]))
        } else {
            EMPTY
        }
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two colours, and two places")]
    fn colour_at(&self, share: f64) -> [u8; 3] {
        let place = share.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
        let first = (place as usize).min(COLOURS.len() - 2);
        let part = place - first as f64;
        core::array::from_fn(|i| {
            let [a, b] = [COLOURS[first][i], COLOURS[first + 1][i]].map(f64::from);
            (a + (b - a) * part).round() as u8
        })
    }

    /// Densities to be labelled, with their share of the scale: powers of ten, with 2 and 5 between them on a short
    /// scale.
    #[allow(clippy::cast_possible_truncation, reason = "decades of densities are few")]
    fn marks(&self) -> Vec<(f64, String)> {
        let [low, high] = self.log10;
        let steps: &[f64] = if high - low < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let decades = (low.floor() as i32)..=(high.ceil() as i32);
        let densities = decades.flat_map(|decade| steps.iter().map(move |step| step * 10.0_f64.powi(decade)));
        let inside = densities.filter(|density| (low..=high).contains(&density.log10()));
        inside.map(|density| ((density.log10() - low) / (high - low), number(density))).collect()
    }
}

/// Returns a density as text without needless digits, such as 0.05, 2 or 20000: 1, 2 or 5 times a power of ten.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few digits")]
fn number(density: f64) -> String {
    let digits = (-density.log10().floor()).max(0.0) as usize;
    format!("{density:.digits$}")
}

struct Canvas {
    width: usize,
    pixels: Vec<[u8; 3]>,
}

impl Canvas {
    fn set(&mut self, [x, y]: [usize; 2], colour: [u8; 3]) {
        if x < self.width
            && let Some(pixel) = self.pixels.get_mut(y * self.width + x)
        {
            *pixel = colour;
        }
    }

    /// Draws the colours from `top` on over half the width, their densities below, and their name.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places within the picture")]
    fn legend(&mut self, scale: &Scale, top: usize, what: &str) {
        let (left, length) = (self.width / 4, self.width / 2);
        for x in 0..length {
            let colour = scale.colour_at(x as f64 / length as f64);
            (0..BAR_PX).for_each(|y| self.set([left + x, top + y], colour));
        }
        let below = top + BAR_PX + MARGIN_PX / 2;
        for (share, text) in scale.marks() {
            let x = left + (share * length as f64) as usize;
            (0..BAR_PX + MARGIN_PX / 4).for_each(|y| self.set([x, top + y], INK));
            self.text([x, below], &text);
        }
        self.text([self.width / 2, below + LETTER_SCALE * LETTER_PX[1] + MARGIN_PX / 2], what);
    }

    /// Draws text about the middle `x`, down from `y`.
    fn text(&mut self, [x, y]: [usize; 2], text: &str) {
        let left = x.saturating_sub(LETTER_SCALE * width_px(text) / 2);
        for [across, down] in dots(text) {
            for part in 0..LETTER_SCALE * LETTER_SCALE {
                let (dx, dy) = (part % LETTER_SCALE, part / LETTER_SCALE);
                self.set([left + across * LETTER_SCALE + dx, y + down * LETTER_SCALE + dy], INK);
            }
        }
    }

    fn write(&self, mut out: impl Write) -> io::Result<()> {
        let side = |n: usize| u32::try_from(n).map_err(|e| io::Error::new(io::ErrorKind::InvalidInput, e));
        let height = self.pixels.len() / self.width;
        let mut encoder = png::Encoder::new(&mut out, side(self.width)?, side(height)?);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())?;
        Ok(writer.finish()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stars::catalog::Catalog;

    #[test]
    fn colours_brighten_with_density_and_marks_are_round() {
        let scale = Scale { log10: [-0.5, 3.2] };
        let light = |density: f64| scale.colour(density).iter().map(|c| u32::from(*c)).sum::<u32>();
        assert!(
            (0..37)
                .all(|i| light(10.0_f64.powf(-0.5 + 0.1 * f64::from(i)))
                    < light(10.0_f64.powf(-0.4 + 0.1 * f64::from(i))))
        );
        assert_eq!((scale.colour(0.0), scale.colour(1e9), scale.colour(1e-9)), (EMPTY, COLOURS[8], COLOURS[0]));
        let names = |scale: &Scale| scale.marks().into_iter().map(|(_, name)| name).collect::<Vec<_>>();
        assert_eq!(names(&scale), ["1", "10", "100", "1000"]);
        assert_eq!(names(&Scale { log10: [-1.4, 0.5] }), ["0.05", "0.1", "0.2", "0.5", "1", "2"]);
        assert!((scale.marks()[1].0 - 1.5 / 3.7).abs() < 1e-9);
    }

    #[test]
    fn the_picture_is_a_png_of_the_sky() {
        let mut map = DensityMap::default();
        map.add_catalog(&Catalog::built_in().unwrap(), 99.0);
        let mut bytes = Vec::new();
        write_png(&mut bytes, &map.coarsened(), true, "stars per square degree").unwrap();
        let mut reader = png::Decoder::new(io::Cursor::new(&bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        let (width, at) = (info.width as usize, |x: usize, y: usize, width: usize| {
            [0, 1, 2].map(|i| pixels[3 * (y * width + x) + i])
        });
        assert_eq!(at(2, 2, width), PAPER, "beside the ellipse");
        let light = |pixel: [u8; 3]| pixel.iter().map(|c| u32::from(*c)).sum::<u32>();
        let mean = |y: usize| (300..1100).map(|x| light(at(x, y, width))).sum::<u32>() / 800;
        assert!(mean(MARGIN_PX + 360) > mean(MARGIN_PX + 100) + 60, "the Milky Way lies across it");
        write_png(&mut Vec::new(), &DensityMap::default(), false, "none").unwrap();
    }
}
