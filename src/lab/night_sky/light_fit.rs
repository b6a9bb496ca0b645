//! Frame -> what lights and disturbs it: background with its shape, vignetting, noise; stars -> zero point, colour term, and
//! the vignetting where the background, which may be an offset or have a shape of its own, contradicts them.

use crate::measure::PixelNoise;
use crate::newton::{Fitted, linear};
use crate::picture::{Picture, robust};
use base::least_squares::median;
use glam::DVec2;
use plan::optics::{Illumination, illumination::Vignetting};

/// Fall towards the edge by the stars beside that by the background, in units of its error and mag, from which the stars decide.
const EDGE_SIGMA: f64 = 4.0;
const LEAST_EDGE_MAG: f64 = 0.05;
/// Step between places of the background that are fitted, px.
const STEP_PX: usize = 8;
/// Share by which the edge must be darker than the middle to be vignetted.
const LEAST_FALL: f64 = 0.03;
/// Background in units of its noise from which its shape says something about vignetting.
const LEAST_LIGHT: f64 = 3.0;
/// Side of a cell of the photon transfer, px.
const CELL_PX: usize = 32;
/// Spread of stars' magnitudes beside their noise: a floor of their errors.
const MAG_FLOOR: f64 = 0.04;
/// Distance, in units of the spread, beyond which a star counts less (Huber).
const HUBER: f64 = 1.5;

/// Background of a frame, DN: `sky I + uniform (1 + gradient . (u, v) + quadratic (u^2 + v^2))`, u and v in half
/// diagonals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedBackground {
    /// Part that the optics' vignetting acts on, DN in the middle.
    pub sky_dn: f64,
    /// Part with a shape of its own, DN in the middle.
    pub uniform_dn: f64,
    /// Its gradient, a share per half diagonal.
    pub gradient: [f64; 2],
    /// Its growth outwards, a share per half diagonal squared.
    pub quadratic: f64,
}

/// Zero point and colours.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedLight {
    /// Electrons of a star of magnitude 0 and colour 0 in one exposure.
    pub zero_e: f64,
    /// Colour terms.
    pub colour: [f64; 2],
    /// Standard errors of the zero point, mag, and the first colour term.
    pub errors: [f64; 2],
    /// Stars.
    pub stars: usize,
    /// How much fainter the stars say that the image is at half a diagonal than the illumination has it, mag, and its
    /// error.
    pub edge_mag: [f64; 2],
}

/// A star for [`light`].
#[derive(Debug, Clone, Copy)]
pub struct LitStar {
    /// Electrons, divided by the relative illumination.
    pub electrons: f64,
    /// Standard error, mag.
    pub error_mag: f64,
    /// Gaia G.
    pub mag_g: f64,
    /// BP - RP.
    pub bp_rp: f64,
    /// Distance from the middle in half diagonals, squared.
    pub r2: f64,
}

/// Returns the vignetting that the background's fall towards the edge means; `None` where it shows none.
pub fn vignetting(
    picture: &Picture,
    surface: &[f32],
    black_dn: f64,
    pupil_mm: f64,
    edge_tangent: f64,
    noise_dn: f64,
) -> Option<Vignetting> {
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    for_places(picture, |i, at| {
        let r2 = at.length_squared();
        rows.push(vec![1.0, at.x, at.y, r2, r2 * r2]);
        values.push(f64::from(surface[i]) - black_dn);
    });
    let fitted = linear(&rows, &values, &vec![1.0; rows.len()])?.values;
    let profile = |r: f64| 1.0 + (fitted[3] * r * r + fitted[4] * r.powi(4)) / fitted[0];
    if fitted[0] < LEAST_LIGHT * noise_dn || profile(1.0) > 1.0 - LEAST_FALL {
        return None;
    }
    Some(stops_of(&profile, pupil_mm, edge_tangent))
}

/// Returns the vignetting that the stars call for beside the illumination `lit`; `None` where they agree with it.
pub fn vignetting_by_stars(
    light: &FittedLight,
    lit: &Illumination,
    pupil_mm: f64,
    edge_tangent: f64,
) -> Option<Vignetting> {
    let [fall, error] = light.edge_mag;
    if fall.is_nan() || fall.abs() < LEAST_EDGE_MAG || fall.abs() < EDGE_SIGMA * error {
        return None;
    }
    let at = |r: f64| lit.at(DVec2::new(r * edge_tangent, 0.0));
    let profile = |r: f64| (at(r) / at(0.0) * 10_f64.powf(-0.4 * fall * r * r)).min(1.0);
    Some(stops_of(&profile, pupil_mm, edge_tangent))
}

/// Returns the two circles whose fall is nearest to a profile over half a diagonal.
fn stops_of(profile: &impl Fn(f64) -> f64, pupil_mm: f64, edge_tangent: f64) -> Vignetting {
    let of = |window: f64, distance: f64| Vignetting {
        window_radius_mm: window,
        pupil_radius_mm: pupil_mm,
        distance_mm: distance,
    };
    let misfit = |p: [f64; 2]| {
        let lit = Illumination { vignetting: Some(of(p[0], p[1])), cos4: true, unblocked: 1.0 };
        let at = |k: u32| 0.05 * f64::from(k);
        // The area of a ring grows with its radius.
        (1..=20).map(|k| at(k) * (lit.at(DVec2::new(at(k) * edge_tangent, 0.0)) - profile(at(k))).powi(2)).sum::<f64>()
    };
    let mut best = [1.2 * pupil_mm, 0.5 * pupil_mm / edge_tangent];
    let mut steps = [0.1 * pupil_mm, 0.25 * pupil_mm / edge_tangent];
    for _ in 0..60 {
        let before = misfit(best);
        for i in 0..2 {
            for side in [1.0, -1.0] {
                let mut tried = best;
                tried[i] = (tried[i] + side * steps[i]).max(0.2 * pupil_mm);
                if misfit(tried) < misfit(best) {
                    best = tried;
                }
            }
        }
        if misfit(best) >= before {
            steps = steps.map(|step| 0.6 * step);
        }
    }
    of(best[0], best[1])
}

/// Visits places of an image, with their half diagonals.
fn for_places(picture: &Picture, mut visit: impl FnMut(usize, DVec2)) {
    let [width, height] = picture.size_px;
    for y in (STEP_PX / 2..height).step_by(STEP_PX) {
        for x in (STEP_PX / 2..width).step_by(STEP_PX) {
            visit(y * width + x, picture.half_diagonals([x as f64, y as f64]));
        }
    }
}

/// Returns the background's form; `lit` is the relative illumination at a place in half diagonals.
pub fn background(picture: &Picture, surface: &[f32], black_dn: f64, lit: impl Fn(DVec2) -> f64) -> FittedBackground {
    let mut places = Vec::new();
    for_places(picture, |i, at| places.push((at, lit(at), f64::from(surface[i]) - black_dn)));
    let values: Vec<f64> = places.iter().map(|(_, _, dn)| *dn).collect();
    let edge = lit(DVec2::X);
    // The part with a gradient falls towards the edge as the rest does, and must be below 0 nowhere.
    let quadratic = -(1.0 - edge).clamp(0.0, 0.9);
    let rows: Vec<Vec<f64>> = places.iter().map(|(at, lit, _)| vec![*lit, at.x, at.y]).collect();
    let ones = vec![1.0; rows.len()];
    let [mut sky_dn, mut gx, mut gy] =
        linear(&rows, &values, &ones).map_or([0.0; 3], |fitted| [fitted.values[0], fitted.values[1], fitted.values[2]]);
    let steepest = 0.98 + quadratic;
    let mut uniform_dn = 0.0;
    for _ in 0..3 {
        uniform_dn = gx.hypot(gy) / steepest;
        let shape = |at: &DVec2| uniform_dn * (1.0 + quadratic * at.length_squared());
        let rest: Vec<f64> = places.iter().map(|(at, _, dn)| dn - shape(at)).collect();
        if let Some(fitted) = linear(&rows, &rest, &ones) {
            [sky_dn, gx, gy] = [fitted.values[0], fitted.values[1], fitted.values[2]];
        }
    }
    sky_dn = sky_dn.max(0.0);
    let least = 1e-6;
    let share = |g: f64| if uniform_dn > least { (g / uniform_dn).clamp(-1.0, 1.0) } else { 0.0 };
    FittedBackground { sky_dn, uniform_dn, gradient: [share(gx), share(gy)], quadratic }
}

/// Mean and variance of the cells of a frame, DN and DN^2; stars are left out.
pub fn photon_transfer(picture: &Picture) -> Vec<[f64; 2]> {
    let [width, height] = picture.size_px;
    let mut cells = Vec::new();
    for top in (0..height.saturating_sub(CELL_PX - 1)).step_by(CELL_PX) {
        for left in (0..width.saturating_sub(CELL_PX - 1)).step_by(CELL_PX) {
            let rows = || (top..top + CELL_PX).map(move |y| &picture.dn[y * width + left..y * width + left + CELL_PX]);
            let mut values: Vec<f64> = rows().flatten().map(|dn| f64::from(*dn)).collect();
            let [middle, spread] = robust(&mut values);
            let near = |dn: f32| (f64::from(dn) - middle).abs() <= 4.0 * spread.max(1.0);
            let pairs = rows().flat_map(|row| row.windows(2)).filter(|pair| near(pair[0]) && near(pair[1]));
            let [mut count, mut squares, mut sum] = [0.0; 3];
            for pair in pairs {
                count += 1.0;
                sum += 0.5 * f64::from(pair[0] + pair[1]);
                squares += 0.5 * f64::from(pair[1] - pair[0]).powi(2);
            }
            if count > 0.5 * (CELL_PX * CELL_PX) as f64 {
                cells.push([sum / count, squares / count]);
            }
        }
    }
    cells
}

/// Returns the noise of a frame's pixels: the gain where its light changes enough over the frame to say, and the noise
/// without light; `response` is the spread of the pixels' responses, which adds to the variance.
pub fn noise(cells: &[[f64; 2]], start: &PixelNoise, response: f64) -> (PixelNoise, Option<[f64; 2]>) {
    const MOST_GAIN_ERROR: f64 = 0.08;
    let of = |[mean, variance]: [f64; 2]| {
        let light = mean - start.black_dn;
        (light, variance - (response * light).powi(2))
    };
    let points: Vec<(f64, f64)> = cells.iter().map(|cell| of(*cell)).collect();
    let rows: Vec<Vec<f64>> = points.iter().map(|(light, _)| vec![1.0, *light]).collect();
    let values: Vec<f64> = points.iter().map(|(_, variance)| *variance).collect();
    let weight = |variance: f64| (CELL_PX * CELL_PX) as f64 / (3.0 * variance.max(0.05).powi(2));
    let weights: Vec<f64> = values.iter().map(|variance| weight(*variance)).collect();
    let transfer = linear(&rows, &values, &weights).filter(|fitted| fitted.values[1] > 0.0).map(
        |Fitted { values, errors, .. }| {
            let gain = 1.0 / values[1];
            [gain, gain * errors[1] / values[1]]
        },
    );
    // A gain that is known well and is near the camera's is taken.
    let taken = transfer
        .filter(|[gain, error]| error / gain < MOST_GAIN_ERROR && (0.5..2.0).contains(&(gain / start.gain_e_per_dn)));
    let gain_e_per_dn = taken.map_or(start.gain_e_per_dn, |[gain, _]| gain);
    let mut rest: Vec<f64> = points.iter().map(|(light, variance)| variance - light.max(0.0) / gain_e_per_dn).collect();
    let read2 = if rest.is_empty() { start.read_dn.powi(2) } else { median(&mut rest) };
    // The converter's steps are a twelfth of it, and are drawn by themselves.
    let read_dn = (read2 - 1.0 / 12.0).max(0.0).sqrt();
    (PixelNoise { gain_e_per_dn, read_dn, ..*start }, transfer)
}

/// Returns zero point and colour terms of stars; outliers count less. `None` when there are too few.
pub fn light(stars: &[LitStar]) -> Option<FittedLight> {
    const LEAST_STARS: usize = 5;
    const STARS_FOR_SQUARE: usize = 15;
    if stars.len() < LEAST_STARS {
        return None;
    }
    let count = if stars.len() >= STARS_FOR_SQUARE { 3 } else { 2 };
    let row = |star: &LitStar| [1.0, star.bp_rp, star.bp_rp * star.bp_rp][..count].to_vec();
    let value = |star: &LitStar| -2.5 * star.electrons.log10() - star.mag_g;
    let (rows, values): (Vec<_>, Vec<_>) = stars.iter().map(|star| (row(star), value(star))).unzip();
    let errors: Vec<f64> = stars.iter().map(|star| star.error_mag).collect();
    let fitted = huber(&errors, &rows, &values)?;
    let with_edge: Vec<Vec<f64>> =
        rows.iter().zip(stars).map(|(row, star)| row.iter().copied().chain([star.r2]).collect()).collect();
    let edge = huber(&errors, &with_edge, &values);
    let at = |i: usize| fitted.values.get(i).copied().unwrap_or(0.0);
    Some(FittedLight {
        zero_e: 10_f64.powf(-0.4 * at(0)),
        colour: [at(1), at(2)],
        errors: [fitted.errors[0], fitted.errors[1]],
        stars: stars.len(),
        edge_mag: edge.map_or([f64::NAN; 2], |fitted| [fitted.values[count], fitted.errors[count]]),
    })
}

/// Least squares in which a star beyond [`HUBER`] spreads counts by its distance, not its square.
pub(crate) fn huber(errors_mag: &[f64], rows: &[Vec<f64>], values: &[f64]) -> Option<Fitted> {
    let own = |error_mag: &f64| 1.0 / (error_mag * error_mag + MAG_FLOOR * MAG_FLOOR);
    let mut weights: Vec<f64> = errors_mag.iter().map(own).collect();
    let mut fitted = linear(rows, values, &weights)?;
    for _ in 0..12 {
        let rest: Vec<f64> = rows
            .iter()
            .zip(values)
            .map(|(row, value)| value - row.iter().zip(&fitted.values).map(|(a, b)| a * b).sum::<f64>())
            .collect();
        let mut distances: Vec<f64> = rest.iter().map(|value| value.abs()).collect();
        let spread = (1.4826 * median(&mut distances)).max(0.01);
        for ((weight, error), rest) in weights.iter_mut().zip(errors_mag).zip(&rest) {
            *weight = own(error) * (HUBER * spread / rest.abs().max(1e-9)).min(1.0);
        }
        fitted = linear(rows, values, &weights)?;
    }
    // The errors of the fit are those of the scatter that is there.
    let excess = (fitted.chi2 / (values.len() - fitted.values.len()).max(1) as f64).max(1.0).sqrt();
    fitted.errors.iter_mut().for_each(|error| *error *= excess);
    Some(fitted)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stars(fall_mag: f64) -> Vec<LitStar> {
        let of = |i: usize| {
            let r2 = (i * 17 % 40) as f64 / 40.0;
            let (mag_g, bp_rp) = (5.0 + 0.05 * i as f64, (i * 7 % 20) as f64 * 0.1);
            let scatter = 0.02 * ((i * 13 % 5) as f64 - 2.0);
            let electrons = 1e6 * 10_f64.powf(-0.4 * (mag_g + 0.1 * bp_rp + fall_mag * r2 + scatter));
            LitStar { electrons, error_mag: 0.03, mag_g, bp_rp, r2 }
        };
        (0..40).map(of).collect()
    }

    #[test]
    fn the_fall_towards_the_edge_is_that_of_the_stars_where_they_contradict_the_background() {
        const EDGE_TANGENT: f64 = 0.12;
        let fitted = light(&stars(0.8)).unwrap();
        assert!((fitted.edge_mag[0] - 0.8).abs() < 4.0 * fitted.edge_mag[1], "{:?}", fitted.edge_mag);
        let stops = vignetting_by_stars(&fitted, &Illumination::EVEN, 9.0, EDGE_TANGENT).unwrap();
        let lit = Illumination { vignetting: Some(stops), cos4: true, unblocked: 1.0 };
        let fall = -2.5 * lit.at(DVec2::X * EDGE_TANGENT).log10();
        // Two circles do not fall exactly as the square of the distance.
        assert!((fall - 0.8).abs() < 0.1, "{fall} mag at the edge");
        let even = light(&stars(0.0)).unwrap();
        assert_eq!(vignetting_by_stars(&even, &Illumination::EVEN, 9.0, EDGE_TANGENT), None, "control: {even:?}");
    }
}
