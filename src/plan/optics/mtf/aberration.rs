//! Small aberrations of any kind, given by their RMS wavefront error.
//!
//! Frequency -> factor `1 - (W / 0.18)^2 [1 - 4 (v - 1/2)^2]`, `W` in waves rms, `v` the share of the diffraction
//! cutoff. Source: Shannon, The Art and Science of Optical Design (1997) and Applied Optics and Optical Engineering
//! (1983): a fit to many lenses. Domain: `0 <= W <= 0.18`, where the middle of the band reaches 0; a larger error is
//! refused. The test compares its loss with Marechal's for small errors.

/// Largest RMS wavefront error of the fit, waves.
pub const LARGEST_RMS_WAVES: f64 = 0.18;

/// Returns the factor at the share `v` of the diffraction cutoff; 1 beyond the cutoff, where diffraction passes
/// nothing.
///
/// `None`: `rms_waves` is outside the domain.
pub fn mtf(v: f64, rms_waves: f64) -> Option<f64> {
    (0.0..=LARGEST_RMS_WAVES).contains(&rms_waves).then(|| in_domain(v, rms_waves))
}

/// Returns the same for an error that is known to be in the domain.
pub(super) fn in_domain(v: f64, rms_waves: f64) -> f64 {
    if v >= 1.0 {
        return 1.0;
    }
    let (share, middle) = (rms_waves / LARGEST_RMS_WAVES, v - 0.5);
    1.0 - share * share * (1.0 - 4.0 * middle * middle)
}

/// Returns the slope at frequency 0 against the share of the cutoff.
pub(super) fn slope_at_zero(rms_waves: f64) -> f64 {
    let share = rms_waves / LARGEST_RMS_WAVES;
    -4.0 * share * share
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::mtf::diffraction;
    use core::f64::consts::TAU;

    /// Returns the volume under the transfer function with and without aberrations: Strehl's ratio.
    fn strehl(rms_waves: f64) -> f64 {
        let volume = |rms: f64| -> f64 {
            let n = 2000;
            let ring = |i: i32| {
                let v = (f64::from(i) + 0.5) / f64::from(n);
                v * diffraction::at_share_of_cutoff(v, 0.0) * in_domain(v, rms)
            };
            (0..n).map(ring).sum()
        };
        volume(rms_waves) / volume(0.0)
    }

    #[test]
    fn loss_agrees_with_marechal_for_small_errors() {
        // Marechal (1947): Strehl = 1 - (2 pi W)^2. The fit was made for the curve, not its volume: 0.57 of that loss.
        for waves in [0.01, 0.03, 0.05] {
            let (fit, marechal) = (1.0 - strehl(waves), (TAU * waves).powi(2));
            let ratio = fit / marechal;
            assert!((0.4..1.1).contains(&ratio), "W {waves}: {fit} against {marechal}");
        }
    }

    #[test]
    fn its_domain_has_an_edge() {
        assert!(mtf(0.5, LARGEST_RMS_WAVES).is_some_and(|factor| factor.abs() < 1e-15), "the last one");
        assert_eq!(mtf(0.5, 0.1801), None, "too large");
        assert_eq!(mtf(0.5, -0.01), None, "negative");
        assert_eq!(mtf(0.5, f64::NAN), None, "none");
        assert_eq!(mtf(0.25, 0.09), Some(1.0 - 0.25 * 0.75), "by hand");
        assert!((mtf(0.0, 0.1).unwrap() - 1.0).abs() < 1e-15, "1 at 0");
        assert!((in_domain(1e-7, 0.1) - 1.0 - 1e-7 * slope_at_zero(0.1)).abs() < 1e-13, "slope");
    }
}
