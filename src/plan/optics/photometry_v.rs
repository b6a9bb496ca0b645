//! Johnson V of a star from Gaia's G and BP-RP, for data sheets and users of V.
//!
//! `G - V` is a polynomial of BP-RP: Gaia DR3 documentation, section 5.5.1, table 5.9 (Johnson-Cousins; Riello et al.
//! 2021, A&A 649, A3, appendix C). Valid for -0.5 < BP-RP < 5 (clamped), scatter of the stars about it 0.030 mag.

use crate::optics::radiometry::COLOR_RANGE;

/// Coefficients of 1, x, x^2, x^3 with x = BP-RP.
const G_MINUS_V: [f64; 4] = [-0.02704, 0.01424, -0.2156, 0.01426];

/// Returns `G - V` of a star of this colour; a missing colour is taken as 0.
pub fn g_minus_v(bp_rp: f64) -> f64 {
    let x = if bp_rp.is_finite() { bp_rp.clamp(COLOR_RANGE.0, COLOR_RANGE.1) } else { 0.0 };
    let [c0, c1, c2, c3] = G_MINUS_V;
    c0 + x * (c1 + x * (c2 + x * c3))
}

/// Returns the V magnitude of a star.
pub fn mag_v(mag_g: f64, bp_rp: f64) -> f64 {
    mag_g - g_minus_v(bp_rp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_has_its_published_v() {
        // Sun: V = -26.76, G = -26.90, BP-RP = 0.82 (Willmer 2018; Casagrande and VandenBerg 2018).
        assert!((mag_v(-26.90, 0.82) + 26.76).abs() < 0.03, "{}", mag_v(-26.90, 0.82));
    }

    #[test]
    fn colours_are_clamped_and_missing_ones_neutral() {
        assert_eq!(g_minus_v(f64::NAN), G_MINUS_V[0]);
        assert_eq!(g_minus_v(7.0), g_minus_v(5.0));
        assert!((g_minus_v(1.0) - (-0.02704 + 0.01424 - 0.2156 + 0.01426)).abs() < 1e-15);
    }
}
