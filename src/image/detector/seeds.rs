//! The two seeds of a detector: one for the device itself, one for the random parts of its exposures.

/// Seeds of fixed patterns and of noise.
///
/// Two exposures of one sensor have the same sensor seed and differ in noise seed or frame number. A single number is
/// used for both, as `seed` without `noise_seed` is in a bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seeds {
    /// Seed of fixed patterns (PRNU, DSNU, dark current, columns and rows) and of the places of random defects.
    pub sensor: u64,
    /// Seed of photon, dark, read and row noise, of telegraph signals and of protons.
    pub noise: u64,
}

impl From<u64> for Seeds {
    fn from(seed: u64) -> Self {
        Self { sensor: seed, noise: seed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::{Detector, DetectorConditions, DetectorParams};
    use base::image::{DnImage, Image};

    const SIZE: [usize; 2] = [160, 120];

    /// Returns a flat of 20,000 e- with 1 % PRNU: patterns of 200 e-, noise of 142 e-.
    fn flat(seeds: Seeds, frame: u32) -> DnImage {
        let params = DetectorParams { full_well_e: 1e5, prnu: 0.01, read_noise_e_rms: 10.0, ..DetectorParams::QUIET };
        let mut mean = Image::new(SIZE[0], SIZE[1]);
        mean.pixels_mut().fill(20_000.0);
        let mut dn = DnImage::new(SIZE[0], SIZE[1]);
        Detector::new(params, SIZE[0], SIZE[1], seeds).collect(&mean, frame, &DetectorConditions::dark(0.1), &mut dn);
        dn
    }

    fn correlation(a: &DnImage, b: &DnImage) -> f64 {
        let mean =
            |image: &DnImage| image.pixels().iter().map(|dn| f64::from(*dn)).sum::<f64>() / image.pixels().len() as f64;
        let (mean_a, mean_b) = (mean(a), mean(b));
        let sums = a.pixels().iter().zip(b.pixels()).fold([0.0; 3], |[aa, ab, bb], (a, b)| {
            let (a, b) = (f64::from(*a) - mean_a, f64::from(*b) - mean_b);
            [aa + a * a, ab + a * b, bb + b * b]
        });
        sums[1] / (sums[0] * sums[2]).sqrt()
    }

    #[test]
    fn exposures_of_one_sensor_share_their_pattern_whatever_the_noise_seed() {
        // Five standard errors of a correlation of 19,200 pixels.
        let five_sigma = 5.0 / ((SIZE[0] * SIZE[1]) as f64).sqrt();
        let first = flat(Seeds { sensor: 3, noise: 3 }, 0);
        let by_frame = correlation(&first, &flat(Seeds { sensor: 3, noise: 3 }, 1));
        let by_noise_seed = correlation(&first, &flat(Seeds { sensor: 3, noise: 4 }, 0));
        let wanted = 200.0_f64.powi(2) / (200.0_f64.powi(2) + 20_000.0 + 100.0);
        assert!((by_frame - wanted).abs() < five_sigma, "two frames: {by_frame}, wanted {wanted}");
        assert!((by_noise_seed - wanted).abs() < five_sigma, "two noise seeds: {by_noise_seed}, wanted {wanted}");
        let other = correlation(&first, &flat(Seeds { sensor: 4, noise: 3 }, 0));
        // The same noise words: they correlate where the pattern does not.
        let noise_alone = 20_100.0 / (200.0_f64.powi(2) + 20_100.0);
        assert!((other - noise_alone).abs() < 2.0 * five_sigma, "another sensor, the same noise: {other}");
        let strangers = correlation(&first, &flat(Seeds { sensor: 4, noise: 4 }, 0));
        assert!(strangers.abs() < five_sigma, "nothing in common: {strangers}");
    }

    #[test]
    fn one_number_sets_both_seeds() {
        assert_eq!(flat(Seeds::from(7), 2), flat(Seeds { sensor: 7, noise: 7 }, 2));
        assert_ne!(flat(Seeds::from(7), 2), flat(Seeds { sensor: 7, noise: 8 }, 2), "the noise seed is used");
    }
}
