//! Real, drawn and difference side by side, as PNG.

use crate::picture::{Picture, robust};
use frames::sink::png::write_grey8;
use std::io;

/// Spreads above the middle that are white.
const WHITE_SPREADS: f64 = 40.0;
/// Spreads of the difference that are white or black.
const DIFFERENCE_SPREADS: f64 = 5.0;
/// Columns between two pictures, px.
const GAP_PX: usize = 4;

/// Returns real | drawn | difference as a PNG file; `shrink` pixels of each side become one, the brightest of them for
/// the two images (stars stay visible), their mean for the difference.
///
/// # Errors
/// When the picture cannot be encoded.
pub fn side_by_side(real: &Picture, drawn: &Picture, shrink: usize) -> io::Result<Vec<u8>> {
    let mut sample: Vec<f64> = real.dn.iter().step_by(5).map(|dn| f64::from(*dn)).collect();
    let [middle, spread] = robust(&mut sample);
    let spread = spread.max(1.0);
    // The same greys for both: asinh shows faint and bright stars.
    let white = (WHITE_SPREADS / 3.0).asinh();
    let grey = |dn: f64| (255.0 * (0.12 + 0.88 * ((dn - middle) / (3.0 * spread)).asinh() / white)).clamp(0.0, 255.0);
    let difference = real.map(|i, dn| dn - drawn.dn[i]);
    let mut sample: Vec<f64> = difference.dn.iter().step_by(5).map(|dn| f64::from(*dn)).collect();
    let [_, noise] = robust(&mut sample);
    let of_difference = |dn: f64| (127.5 * (1.0 + dn / (DIFFERENCE_SPREADS * noise.max(0.5)))).clamp(0.0, 255.0);
    let highest = |values: &[f64]| values.iter().fold(f64::MIN, |a, b| a.max(*b));
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let [width, height] = real.size_px.map(|side| side / shrink.max(1));
    let total = 3 * width + 2 * GAP_PX;
    let mut bytes = vec![255; total * height];
    let mut put = |number: usize, picture: &Picture, of: &dyn Fn(&[f64]) -> f64, grey: &dyn Fn(f64) -> f64| {
        let mut block = Vec::with_capacity(shrink * shrink);
        for y in 0..height {
            for x in 0..width {
                block.clear();
                (0..shrink)
                    .for_each(|dy| (0..shrink).for_each(|dx| block.push(picture.at(x * shrink + dx, y * shrink + dy))));
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
                {
                    bytes[y * total + number * (width + GAP_PX) + x] = grey(of(&block)) as u8;
                }
            }
        }
    };
    put(0, real, &highest, &grey);
    put(1, drawn, &highest, &grey);
    put(2, &difference, &mean, &of_difference);
    let mut png = Vec::new();
    write_grey8(&mut png, [total, height], &bytes)?;
    Ok(png)
}
