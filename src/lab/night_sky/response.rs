//! Light of stars against the catalog's magnitudes -> whether the image's numbers are linear, and the exponent that makes them so.
//!
//! An image with a response curve, `DN = (light)^(1 / gamma)`, makes bright stars too faint beside faint ones: magnitudes change
//! with brightness. The slope is fitted beside zero point, colour and the fall towards the edge; where it is significant, the
//! exponent is searched that takes it away. Light is the sum over 7 x 7 px, which does not depend on a PSF. Limits: a power of
//! the whole range, one for the frame. Tests: below; a drawn frame with a curve in `tests/night_sky`.

use crate::measure::{Plate, Spot};
use crate::{light_fit::huber, picture::window};

/// Least SNR of a star, and least number of stars and magnitudes between them.
const LEAST_SNR: f64 = 20.0;
const LEAST_STARS: usize = 12;
const LEAST_RANGE_MAG: f64 = 1.5;
/// Slope in units of its error, and mag per mag, from which an image is not linear.
const LEAST_SIGMA: f64 = 5.0;
const LEAST_SLOPE: f64 = 0.05;
/// Exponents that are searched, and halvings of the search.
const GAMMAS: [f64; 2] = [0.4, 4.0];
const HALVINGS: u32 = 24;
/// Half-width of the square whose light is summed, px.
const HALF_PX: i64 = 3;

/// A star for [`response`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tone {
    pub spot: Spot,
    pub mag_g: f64,
    pub bp_rp: f64,
    /// Distance from the middle in half diagonals, squared.
    pub r2: f64,
}

/// How the image's numbers follow the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Response {
    /// Change of the magnitudes, mag per mag, and its standard error.
    pub slope: [f64; 2],
    /// Exponent that makes the image linear, and its standard error, where it is not.
    pub gamma: Option<[f64; 2]>,
}

/// Returns the response of a frame by its unsaturated single stars; `None` when they are too few or too alike.
pub(crate) fn response(plate: &Plate<'_>, stars: &[Tone]) -> Option<Response> {
    let good: Vec<Tone> =
        stars.iter().filter(|star| star.spot.snr() > LEAST_SNR && !star.spot.is_saturated).copied().collect();
    let (least, most) = good.iter().fold((f64::MAX, f64::MIN), |(a, b), star| (a.min(star.mag_g), b.max(star.mag_g)));
    if good.len() < LEAST_STARS || most - least < LEAST_RANGE_MAG {
        return None;
    }
    let slope = slope(plate, &good, 1.0)?;
    let is_curved = slope[0].abs() > LEAST_SIGMA * slope[1] && slope[0].abs() > LEAST_SLOPE;
    Some(Response { slope, gamma: if is_curved { gamma(plate, &good) } else { None } })
}

/// Returns the exponent whose slope is 0, and its error.
fn gamma(plate: &Plate<'_>, stars: &[Tone]) -> Option<[f64; 2]> {
    let at = |gamma: f64| slope(plate, stars, gamma);
    let [mut low, mut high] = GAMMAS;
    // A larger exponent makes bright stars brighter: the slope grows.
    if at(low)?[0] > 0.0 || at(high)?[0] < 0.0 {
        return None;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if at(middle)?[0] < 0.0 { low = middle } else { high = middle }
    }
    let gamma = 0.5 * (low + high);
    let step = 0.05 * gamma;
    let steepness = (at(gamma + step)?[0] - at(gamma - step)?[0]) / (2.0 * step);
    Some([gamma, at(gamma)?[1] / steepness.abs().max(1e-6)])
}

/// Returns the slope of magnitudes over magnitudes with the image's numbers raised to `gamma`, and its error.
fn slope(plate: &Plate<'_>, stars: &[Tone], gamma: f64) -> Option<[f64; 2]> {
    let noise = plate.noise;
    let range = noise.most_dn - noise.black_dn;
    let linear = |dn: f64| range * ((dn - noise.black_dn).max(0.0) / range).powf(gamma);
    let width = plate.picture.size_px[0];
    let light = |spot: &Spot| -> f64 {
        window(spot.px, HALF_PX)
            .map(|[x, y]| {
                let beside = f64::from(plate.background[y * width + x]) + spot.beside_dn;
                linear(plate.picture.at(x, y)) - linear(beside)
            })
            .sum()
    };
    let middle = stars.iter().map(|star| star.mag_g).sum::<f64>() / stars.len() as f64;
    let lit: Vec<(&Tone, f64)> =
        stars.iter().map(|star| (star, light(&star.spot))).filter(|(_, light)| *light > 0.0).collect();
    let rows: Vec<Vec<f64>> = lit.iter().map(|(star, _)| vec![1.0, star.bp_rp, star.r2, star.mag_g - middle]).collect();
    let values: Vec<f64> = lit.iter().map(|(star, light)| -2.5 * light.log10() - star.mag_g).collect();
    // The sum over 49 pixels has about twice the noise of the fit.
    let errors: Vec<f64> = lit.iter().map(|(star, _)| 2.2 / star.spot.snr()).collect();
    let fitted = huber(&errors, &rows, &values)?;
    // Negative: bright stars are too faint.
    Some([fitted.values[3], fitted.errors[3]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{measure::PixelNoise, picture::Picture};

    /// Side of a star's own square, and columns of squares.
    const SIDE_PX: usize = 12;
    const ACROSS: usize = 6;
    const RANGE_DN: f64 = 4095.0;
    const SKY_DN: f64 = 150.0;

    /// Returns a frame of 36 stars of G = 3 to 6.5 with colours and noise, and the stars.
    fn frame(gamma: f64) -> (Picture, Vec<f32>, Vec<Tone>) {
        #[allow(clippy::cast_possible_truncation, reason = "digital numbers")]
        let encoded = |dn: f64| (RANGE_DN * (dn / RANGE_DN).powf(1.0 / gamma)) as f32;
        let side = SIDE_PX * ACROSS;
        let mut light = vec![SKY_DN; side * side];
        let mut stars = Vec::new();
        for i in 0..ACROSS * ACROSS {
            let px = [i % ACROSS, i / ACROSS].map(|k| (k * SIDE_PX) as f64 + 5.6);
            let (mag_g, bp_rp) = (3.0 + 0.1 * i as f64, (i * 7 % 20) as f64 * 0.1);
            let scatter = 0.03 * ((i * 13 % 5) as f64 - 2.0);
            let flux = 12_000.0 * 10_f64.powf(-0.4 * (mag_g - 3.0 + 0.1 * bp_rp + scatter));
            for [x, y] in window(px, 5) {
                let r2 = (x as f64 - px[0]).powi(2) + (y as f64 - px[1]).powi(2);
                light[y * side + x] += flux * (-0.5 * r2).exp() / core::f64::consts::TAU;
            }
            let spot = Spot {
                px,
                flux_dn: flux,
                flux_error_dn: flux / 60.0,
                place_error_px: 0.02,
                beside_dn: 0.0,
                is_saturated: false,
                is_placed: true,
            };
            stars.push(Tone { spot, mag_g, bp_rp, r2: (i % 7) as f64 / 7.0 });
        }
        let dn: Vec<f32> = light.into_iter().map(encoded).collect();
        (Picture { size_px: [side; 2], dn }, vec![encoded(SKY_DN); side * side], stars)
    }

    fn found(gamma: f64) -> Response {
        let (picture, background, stars) = frame(gamma);
        let noise = PixelNoise { gain_e_per_dn: 2.7, read_dn: 2.0, black_dn: 0.0, most_dn: RANGE_DN };
        response(&Plate { picture: &picture, background: &background, noise }, &stars).unwrap()
    }

    #[test]
    fn the_exponent_of_a_curve_comes_back_and_a_linear_image_has_none() {
        for gamma in [1.5, 2.2, 0.7] {
            let found = found(gamma);
            let [got, error] = found.gamma.unwrap();
            assert!((got - gamma).abs() < 4.0 * error && error < 0.1 * gamma, "{gamma}: {found:?}");
            assert!(found.slope[0] * (gamma - 1.0) < 0.0, "{found:?}");
        }
        let linear = found(1.0);
        assert!(linear.gamma.is_none() && linear.slope[0].abs() < 4.0 * linear.slope[1], "control: {linear:?}");
    }
}
