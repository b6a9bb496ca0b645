//! Mean electrons more in every pixel: stray light and the sky's background.
//!
//! `e += c + gx u + gy v + q (u^2 + v^2) + sky I(x, y)`, with `u = (x - (w - 1) / 2) / r`, `v = (y - (h - 1) / 2) / r`, `r`
//! half the image's diagonal, so that corners are 1 away; and `I` the relative illumination of each pixel, a map given
//! once ([`Detector::set_illumination_map`](crate::detector::Detector::set_illumination_map)); without one it is 1.
//! Every number may change from frame to frame. All zero: the stage is left out. Only `c`: one addition per pixel.
//! A level below zero counts as no light (the shot stage takes it so).
//! Single precision: within 1e-6 of the largest term. GPU: `charge.wgsl`, the same steps.
//! Tests: below against the formula in f64; `tests/gpu/background.rs`.

/// Mean electrons of one exposure, beside the stars'.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Background {
    /// Electrons in the middle of the image, e-.
    pub uniform_e: f32,
    /// More towards the right and towards the bottom, e- per half diagonal.
    pub gradient_e: [f32; 2],
    /// More away from the middle, e- per half diagonal squared.
    pub quadratic_e: f32,
    /// From the sky, on the axis, e-: multiplied by the relative illumination of every pixel.
    pub sky_e: f32,
}

impl Background {
    /// None.
    pub const DARK: Self = Self { uniform_e: 0.0, gradient_e: [0.0; 2], quadratic_e: 0.0, sky_e: 0.0 };

    /// Returns the same in every pixel.
    pub const fn uniform(uniform_e: f32) -> Self {
        Self { uniform_e, ..Self::DARK }
    }

    /// Returns this background with `more_e` electrons more in every pixel.
    #[must_use]
    pub fn and_uniform(self, more_e: f32) -> Self {
        Self { uniform_e: self.uniform_e + more_e, ..self }
    }

    /// Returns the part that is equal in every pixel, e-; it includes the sky without a map of the illumination.
    pub(super) fn level_e(&self, has_map: bool) -> f32 {
        if has_map { self.uniform_e } else { self.uniform_e + self.sky_e }
    }

    /// Returns true if it differs from pixel to pixel.
    pub(super) fn is_shaped(&self, has_map: bool) -> bool {
        self.gradient_e != [0.0; 2] || self.quadratic_e != 0.0 || (has_map && self.sky_e != 0.0)
    }
}

/// A background over an image of one size.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape<'a> {
    pub(super) background: Background,
    pub(super) size_px: [usize; 2],
    /// Relative illumination of every pixel.
    pub(super) illumination: Option<&'a [f32]>,
}

/// Returns offset and scale from pixels to half diagonals: `(x + offset[0]) * scale`, `(y + offset[1]) * scale`.
#[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
pub(super) fn normalisation(size_px: [usize; 2]) -> ([f32; 2], f32) {
    let [width, height] = size_px.map(|side| side as f64);
    let offset = [width, height].map(|side| (-0.5 * (side - 1.0)) as f32);
    (offset, (2.0 / width.hypot(height)) as f32)
}

impl Shape<'_> {
    /// Adds the part that differs from pixel to pixel to pixels `first` and following, row by row.
    #[inline(always)]
    pub(super) fn add(&self, first: usize, electrons: &mut [f32]) {
        let Self { background, size_px: [width, _], illumination } = *self;
        if background.gradient_e != [0.0; 2] || background.quadratic_e != 0.0 {
            let (offset, scale) = normalisation(self.size_px);
            let (mut x, mut y, mut rest) = (first % width, first / width, &mut *electrons);
            while !rest.is_empty() {
                let (row, next) = rest.split_at_mut((width - x).min(rest.len()));
                add_row(&background, offset, scale, [x, y], row);
                (x, y, rest) = (0, y + 1, next);
            }
        }
        if let (Some(map), true) = (illumination, background.sky_e != 0.0) {
            let here = map.get(first..).unwrap_or_default();
            electrons.iter_mut().zip(here).for_each(|(e, lit)| *e += background.sky_e * lit);
        }
    }
}

#[inline(always)]
fn add_row(background: &Background, offset: [f32; 2], scale: f32, [x, y]: [usize; 2], row: &mut [f32]) {
    let Background { gradient_e: [gx, gy], quadratic_e: q, .. } = *background;
    let v = (y as f32 + offset[1]) * scale;
    let of_row = (q * v + gy) * v;
    for (i, e) in row.iter_mut().enumerate() {
        let u = ((x as u32).wrapping_add(i as u32).cast_signed() as f32 + offset[0]) * scale;
        *e += (q * u + gx) * u + of_row;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::{Detector, DetectorConditions, DetectorParams};
    use base::image::{DnImage, Image};

    const SIZE: [usize; 2] = [301, 203];
    const LIT: Background = Background { uniform_e: 100.0, gradient_e: [-30.0, 20.0], quadratic_e: 15.0, sky_e: 50.0 };

    fn map() -> Vec<f32> {
        (0..SIZE[0] * SIZE[1]).map(|i| 1.0 - (i % SIZE[0]) as f32 / 600.0).collect()
    }

    /// Returns the formula, in double precision.
    fn wanted_e(background: &Background, x: usize, y: usize, lit: f32) -> f64 {
        let half_diagonal = 0.5 * (SIZE[0] as f64).hypot(SIZE[1] as f64);
        let [u, v] =
            [(x, SIZE[0]), (y, SIZE[1])].map(|(at, side)| (at as f64 - 0.5 * (side as f64 - 1.0)) / half_diagonal);
        let [gx, gy] = background.gradient_e.map(f64::from);
        f64::from(background.uniform_e)
            + gx * u
            + gy * v
            + f64::from(background.quadratic_e) * (u * u + v * v)
            + f64::from(background.sky_e) * f64::from(lit)
    }

    #[test]
    fn blocks_of_any_place_add_the_formula() {
        let map = map();
        let shape = Shape { background: LIT, size_px: SIZE, illumination: Some(&map) };
        let pixels = SIZE[0] * SIZE[1];
        let mut image = vec![LIT.level_e(true); pixels];
        let mut first = 0;
        // Pieces that begin and end anywhere in a row, shorter and longer than one.
        for length in [1, 300, 2, 700, 256, 64].into_iter().cycle() {
            let end = (first + length).min(pixels);
            shape.add(first, &mut image[first..end]);
            first = end;
            if first == pixels {
                break;
            }
        }
        let mut worst = 0.0_f64;
        for (i, e) in image.iter().enumerate() {
            worst = worst.max((f64::from(*e) - wanted_e(&LIT, i % SIZE[0], i / SIZE[0], map[i])).abs());
        }
        // Six roundings of numbers below 256: half of 2^-16 each.
        assert!(worst < 6.0 * 0.5 / 65_536.0, "{worst}");
        let turned = Background { gradient_e: [20.0, -30.0], ..LIT };
        let off = (wanted_e(&turned, 0, 0, 1.0) - wanted_e(&LIT, 0, 0, 1.0)).abs();
        assert!(off > 1.0, "control: the gradient's direction shows");
    }

    #[test]
    fn a_detector_draws_it() {
        let params = DetectorParams { gain_e_per_dn: 1.0, ..DetectorParams::QUIET };
        let mut detector = Detector::new(params, SIZE[0], SIZE[1], 3);
        let mean = Image::<f32>::new(SIZE[0], SIZE[1]);
        let mut dn = DnImage::new(SIZE[0], SIZE[1]);
        let sum = |dn: &DnImage| dn.pixels().iter().map(|dn| f64::from(*dn)).sum::<f64>();
        let mut draw = |detector: &mut Detector, background| {
            detector.collect(&mean, 1, &DetectorConditions::lit(0.1, background), &mut dn);
            sum(&dn)
        };
        assert_eq!(draw(&mut detector, Background::DARK), 0.0, "no light, no dark signal");
        let pixels = (SIZE[0] * SIZE[1]) as f64;
        let wanted = |lit: &dyn Fn(usize) -> f32| -> f64 {
            (0..SIZE[0] * SIZE[1]).map(|i| wanted_e(&LIT, i % SIZE[0], i / SIZE[0], lit(i))).sum()
        };
        // Five standard deviations of the sum of Poisson numbers.
        let (got, flat) = (draw(&mut detector, LIT), wanted(&|_| 1.0));
        assert!((got - flat).abs() < 5.0 * flat.sqrt(), "without a map the sky is even: {got} {flat}");
        let lit = map();
        detector.set_illumination_map(Some(lit.clone()));
        let (got, vignetted) = (draw(&mut detector, LIT), wanted(&|i| lit[i]));
        assert!((got - vignetted).abs() < 5.0 * vignetted.sqrt(), "{got} {vignetted}");
        assert!((flat - vignetted).abs() > 20.0 * flat.sqrt(), "control: the map shows");
        let more = draw(&mut detector, LIT.and_uniform(7.0));
        assert!((more - vignetted - 7.0 * pixels).abs() < 5.0 * more.sqrt(), "stray light comes on top");
    }

    #[test]
    fn a_level_background_is_the_stray_light_it_always_was() {
        let params = DetectorParams { read_noise_e_rms: 5.0, ..DetectorParams::QUIET };
        let mean = Image::<f32>::new(SIZE[0], SIZE[1]);
        let read = |background: Background| {
            let mut dn = DnImage::new(SIZE[0], SIZE[1]);
            let conditions = DetectorConditions::lit(0.1, background);
            Detector::new(params, SIZE[0], SIZE[1], 3).collect(&mean, 1, &conditions, &mut dn);
            dn
        };
        let stray = read(Background::DARK.and_uniform(12.5));
        assert_eq!(read(Background::uniform(12.5)), stray);
        assert_ne!(read(Background::uniform(12.6)), stray, "control");
    }
}
