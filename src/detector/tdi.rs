//! Time-delayed integration: charge is shifted along the columns with the image, and `stages` exposures add up.
//!
//! The image of one line period moves by one row; each of the `stages` rows adds `line_s` of exposure to the same packet,
//! so signal, dark signal and their variance grow by `stages`, and read noise comes once: shot-noise-limited SNR grows by
//! `sqrt(stages)`. Every output pixel of a column has passed the same `stages` pixels: fixed patterns are one number per
//! column, with `1 / sqrt(stages)` of the pixels' spread.
//!
//! How it is drawn: as one exposure of `stages * line_s` in which the frame moves with the image; what motion is left
//! (the mismatch) is the motion of the line of sight in that exposure, which the planner draws as any other. What the
//! discrete steps and a mismatch of scan rate cost in sharpness is told as an MTF along the columns:
//! `|sinc(f / phases)|` for moves of `1 / phases` px while the image moves on evenly, and
//! `|sin(pi f d N) / (N sin(pi f d))|` for `N` stages each displaced by `d` px more than the one before (Wong, Yao and
//! Schlig, IBM J. Res. Dev. 36 (1992) 83; Holst, "CCD Arrays, Cameras and Displays", 1998, section 10.3).
//!
//! Not modelled: that a frame's rows are exposed one after another (all rows share one exposure window), and the partly
//! integrated rows at the start and end of a scan. Held by the tests below and `tests/physics/detector_output.rs`.

/// A detector in TDI mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tdi {
    /// Rows that add up.
    pub stages: u32,
    /// Steps in which charge moves from row to row.
    pub phases: u32,
}

impl Tdi {
    /// Exposure of a packet, s.
    #[must_use]
    pub fn exposure_s(&self, line_s: f64) -> f64 {
        f64::from(self.stages) * line_s
    }

    /// Spread of a fixed pattern over the columns, as a share of its spread over the pixels.
    #[must_use]
    pub fn pattern_share(&self) -> f64 {
        1.0 / f64::from(self.stages).sqrt()
    }

    /// MTF of the discrete moves along the columns, at a frequency in cycles/px.
    #[must_use]
    pub fn step_mtf(&self, cycles_per_px: f64) -> f64 {
        let x = core::f64::consts::PI * cycles_per_px / f64::from(self.phases);
        if x == 0.0 { 1.0 } else { (x.sin() / x).abs() }
    }

    /// MTF of a scan that is off by `mismatch_px` from each stage to the next.
    #[must_use]
    pub fn mismatch_mtf(&self, cycles_per_px: f64, mismatch_px: f64) -> f64 {
        let x = core::f64::consts::PI * cycles_per_px * mismatch_px;
        let n = f64::from(self.stages);
        if x.sin().abs() < 1e-12 { 1.0 } else { ((n * x).sin() / (n * x.sin())).abs() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TDI: Tdi = Tdi { stages: 32, phases: 4 };

    /// Modulation of a sine that is averaged over displacements.
    fn averaged(cycles_per_px: f64, displacements: impl Iterator<Item = f64> + Clone) -> f64 {
        let n = displacements.clone().count() as f64;
        let turn = core::f64::consts::TAU * cycles_per_px;
        let part = |of: fn(f64) -> f64| displacements.clone().map(|d| of(turn * d)).sum::<f64>() / n;
        part(f64::cos).hypot(part(f64::sin))
    }

    #[test]
    fn both_mtfs_are_those_of_averaged_sines() {
        for cycles_per_px in [0.05, 0.2, 0.5] {
            let steps = (0..10_000).map(|i| (f64::from(i) + 0.5) / 10_000.0 / 4.0);
            assert!((TDI.step_mtf(cycles_per_px) - averaged(cycles_per_px, steps)).abs() < 1e-7);
            for mismatch_px in [0.001, 0.01, 0.1] {
                let stages = (0..32).map(|i| f64::from(i) * mismatch_px);
                let wanted = averaged(cycles_per_px, stages);
                assert!((TDI.mismatch_mtf(cycles_per_px, mismatch_px) - wanted).abs() < 1e-9);
                assert!((TDI.mismatch_mtf(cycles_per_px, 1.1 * mismatch_px) - wanted).abs() > 1e-9, "negative control");
            }
        }
        assert_eq!(TDI.step_mtf(0.0), 1.0);
        assert_eq!(TDI.mismatch_mtf(0.3, 0.0), 1.0);
    }

    #[test]
    fn stages_add_up() {
        assert!((TDI.exposure_s(0.01) - 0.32).abs() < 1e-12);
        assert!((TDI.pattern_share() - 0.176_776_695).abs() < 1e-9);
    }
}
