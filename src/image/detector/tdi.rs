//! Time-delayed integration: charge is shifted along the columns with the image, and `stages` exposures add up.
//!
//! The image of one line period moves by one row; each of the `stages` rows adds `line_s` of exposure to the same
//! packet, so signal, dark signal and their variance grow by `stages`, and read noise comes once: shot-noise-limited
//! SNR grows by `sqrt(stages)`. Every output pixel of a column has passed the same `stages` pixels: fixed patterns are
//! one number per column, with `1 / sqrt(stages)` of the pixels' spread.
//!
//! How it is drawn: as one exposure of `stages * line_s` in which the frame moves with the image; what motion is left
//! is the motion of the line of sight in that exposure, which the planner draws as any other. What the discrete steps
//! and a mismatch of scan rate cost in sharpness is a link of a chain PSF (`[mtf]`, `plan::optics::mtf::motion`).
//! Source: Holst, "CCD Arrays, Cameras and Displays", 1998, section 10.3.
//!
//! Not modelled: that a frame's rows are exposed one after another (all rows share one exposure window), and the partly
//! integrated rows at the start and end of a scan. Tests: below and `tests/physics/detector_spatial.rs`.

use crate::detector::pattern::Patterns;
use std::sync::Arc;

/// A detector in TDI mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tdi {
    /// Rows that add up.
    pub stages: u32,
}

impl Tdi {
    /// Returns the exposure of a packet, s.
    pub fn exposure_s(&self, line_s: f64) -> f64 {
        f64::from(self.stages) * line_s
    }

    /// Returns the fixed patterns as a packet meets them: the same for all rows of a column, the mean over the stages.
    /// Where the sensor has fewer rows than there are stages, the spread is that of so many stages all the same.
    pub fn patterns(&self, pixels: &Patterns, width: usize) -> Patterns {
        let along = |map: &Option<Arc<[f32]>>, middle| map.as_ref().map(|map| self.along_columns(map, width, middle));
        Patterns {
            prnu: along(&pixels.prnu, 0.0),
            dsnu_e: along(&pixels.dsnu_e, 0.0),
            dark_factor: along(&pixels.dark_factor, 1.0),
        }
    }

    fn along_columns(&self, map: &[f32], width: usize, middle: f64) -> Arc<[f32]> {
        let rows = map.len() / width.max(1);
        let averaged = rows.min(self.stages as usize).max(1);
        let share = (averaged as f64 / f64::from(self.stages)).sqrt();
        let column = |x: usize| {
            let sum: f64 = (0..averaged).map(|y| f64::from(map[y * width + x]) - middle).sum();
            #[allow(clippy::cast_possible_truncation, reason = "patterns are f32")]
            let mean = (middle + share * sum / averaged as f64) as f32;
            mean
        };
        let one: Vec<f32> = (0..width).map(column).collect();
        (0..rows).flat_map(|_| one.iter().copied()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TDI: Tdi = Tdi { stages: 32 };

    #[test]
    fn patterns_are_means_along_the_stages() {
        let map: Arc<[f32]> = (0..64 * 50).map(|i| ((i * 7919) % 1009) as f32 - 504.0).collect();
        let pixels = Patterns { prnu: Some(Arc::clone(&map)), ..Patterns::default() };
        let columns = TDI.patterns(&pixels, 64);
        let prnu = columns.prnu.expect("on");
        assert!(columns.dsnu_e.is_none());
        let by_hand = (0..32).map(|y| f64::from(map[y * 64 + 5])).sum::<f64>() / 32.0;
        for y in [0, 20, 49] {
            assert!((f64::from(prnu[y * 64 + 5]) - by_hand).abs() < 1e-4, "row {y}");
        }
        // More stages than rows: spread as of so many.
        let spread = |of: &[f32]| (of[..64].iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / 64.0).sqrt();
        let many = Tdi { stages: 200 }.patterns(&pixels, 64).prnu.expect("on");
        let all = Tdi { stages: 50 }.patterns(&pixels, 64).prnu.expect("on");
        assert!((spread(&many) / spread(&all) - 0.5).abs() < 1e-5);
    }

    #[test]
    fn stages_add_up() {
        assert!((TDI.exposure_s(0.01) - 0.32).abs() < 1e-12);
    }
}
