//! Moments of flat images: the mean, the temporal noise, the spatial pattern.
//!
//! Two images of the same light differ only by their temporal noise, for any fixed pattern:
//! `sigma^2 = 1/2 <(a - b)^2> - 1/2 (<a> - <b>)^2`. The pattern is the remaining variance of the mean of many images:
//! `s^2 = var(mean) - sigma^2 / L`. Source: EMVA 1288 Release 4.0 Linear, sections 6.5 and 8.2. Units: DN, DN^2. Tests below.

use base::image::DnImage;

/// Mean and temporal variance of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Mean of both, DN.
    pub mean_dn: f64,
    /// Temporal variance of one image, DN^2.
    pub variance_dn2: f64,
}

impl Pair {
    /// Returns the moments of two images of the same light.
    pub fn of(a: &DnImage, b: &DnImage) -> Self {
        let count = a.pixels().len() as f64;
        let (mut sum_a, mut sum_b, mut squares) = (0_u64, 0_u64, 0.0);
        for (a, b) in a.pixels().iter().zip(b.pixels()) {
            sum_a += u64::from(*a);
            sum_b += u64::from(*b);
            let difference = f64::from(*a) - f64::from(*b);
            squares += difference * difference;
        }
        let (mean_a, mean_b) = (sum_a as f64 / count, sum_b as f64 / count);
        let step = mean_a - mean_b;
        Self { mean_dn: 0.5 * (mean_a + mean_b), variance_dn2: 0.5 * (squares / count - step * step) }
    }
}

/// Sum of many images of the same light, with their temporal noise.
#[derive(Debug, Clone)]
pub struct Stack {
    sums: Vec<u32>,
    squares: Vec<u64>,
    images: u32,
}

/// Moments of a stack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pattern {
    /// Mean of all pixels, DN.
    pub mean_dn: f64,
    /// Variance of the pixels' own means without their temporal noise, DN^2.
    pub spatial_variance_dn2: f64,
    /// Mean temporal variance of a pixel, DN^2.
    pub temporal_variance_dn2: f64,
    /// Standard error of the spatial variance, DN^2.
    pub spatial_variance_se_dn2: f64,
}

impl Stack {
    /// Returns an empty stack for images of this many pixels.
    pub fn new(pixels: usize) -> Self {
        Self { sums: vec![0; pixels], squares: vec![0; pixels], images: 0 }
    }

    /// Adds an image (65,536 at most).
    pub fn add(&mut self, image: &DnImage) {
        self.images += 1;
        for ((sum, square), dn) in self.sums.iter_mut().zip(&mut self.squares).zip(image.pixels()) {
            *sum += u32::from(*dn);
            *square += u64::from(*dn) * u64::from(*dn);
        }
    }

    /// Returns the mean and temporal variance of one pixel, DN and DN^2.
    pub fn pixel(&self, at: usize) -> [f64; 2] {
        let images = f64::from(self.images);
        let mean = f64::from(self.sums[at]) / images;
        [mean, (self.squares[at] as f64 / images - mean * mean) * images / (images - 1.0)]
    }

    /// Returns the moments of the stack, which needs at least two images.
    pub fn pattern(&self) -> Pattern {
        let count = self.sums.len() as f64;
        let [sum, temporal] = (0..self.sums.len()).map(|at| self.pixel(at)).fold([0.0; 2], add);
        let (mean_dn, temporal_variance_dn2) = (sum / count, temporal / count);
        let spread: f64 = (0..self.sums.len()).map(|at| (self.pixel(at)[0] - mean_dn).powi(2)).sum();
        let spatial_variance_dn2 = spread / (count - 1.0) - temporal_variance_dn2 / f64::from(self.images);
        // The standard error of a variance of `count` normal deviates is the root of 2 / count of itself.
        let spatial_variance_se_dn2 = (2.0 / count).sqrt() * spread / (count - 1.0);
        Pattern { mean_dn, spatial_variance_dn2, temporal_variance_dn2, spatial_variance_se_dn2 }
    }
}

fn add([a, b]: [f64; 2], [c, d]: [f64; 2]) -> [f64; 2] {
    [a + c, b + d]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(pixels: &[u16]) -> DnImage {
        let mut image = DnImage::new(pixels.len(), 1);
        image.pixels_mut().copy_from_slice(pixels);
        image
    }

    #[test]
    fn a_pair_shows_time_and_hides_the_pattern() {
        // Differences -2, 2, 0, 4: mean 1, mean square 6, so 1/2 (6 - 1).
        let pair = Pair::of(&image(&[10, 22, 30, 44]), &image(&[12, 20, 30, 40]));
        assert_eq!(pair, Pair { mean_dn: 26.0, variance_dn2: 2.5 });
        let still = Pair::of(&image(&[1, 500, 9000]), &image(&[1, 500, 9000]));
        assert_eq!(still.variance_dn2, 0.0, "a pattern does not count as noise");
    }

    #[test]
    fn a_stack_takes_both_apart() {
        let mut stack = Stack::new(3);
        for offset in [0, 2, 4, 2] {
            stack.add(&image(&[10 + offset, 20 + offset, 30 + offset]));
        }
        // In time: 0, 2, 4, 2 has a variance of 8 / 3. In space: 10, 20, 30 has 100, and of the noise 8 / 3 / 4 is
        // taken off.
        let pattern = stack.pattern();
        assert_eq!(stack.pixel(1)[0], 22.0);
        assert!((pattern.temporal_variance_dn2 - 8.0 / 3.0).abs() < 1e-12, "{pattern:?}");
        assert!((pattern.spatial_variance_dn2 - (100.0 - 2.0 / 3.0)).abs() < 1e-12, "{pattern:?}");
        assert_eq!(pattern.mean_dn, 22.0);
    }
}
