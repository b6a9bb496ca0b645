//! Absorption of light in silicon at 300 K.
//!
//! Wavelength (nm) -> absorption coefficient `4 pi k / lambda`, 1/um. Source of the extinction coefficient `k`: Green,
//! Solar Energy Materials and Solar Cells 92, 1305 (2008). Between rows `ln k` is linear in wavelength: at most 5 % off
//! between 400 and 1000 nm, below the differences of published tables. Domain: 300 to 1100 nm; other wavelengths have
//! no value. Cold silicon absorbs less red light: not modelled.

use core::f64::consts::PI;

/// Wavelength, nm; extinction coefficient.
const EXTINCTION: [(f64, f64); 26] = [
    (300.0, 4.234),
    (320.0, 3.303),
    (340.0, 2.977),
    (350.0, 2.938),
    (360.0, 2.966),
    (370.0, 2.171),
    (380.0, 0.946),
    (390.0, 0.445),
    (400.0, 0.296),
    (420.0, 0.176),
    (440.0, 0.107),
    (460.0, 0.071381),
    (480.0, 0.055004),
    (500.0, 0.044165),
    (550.0, 0.027968),
    (600.0, 0.019934),
    (650.0, 0.014431),
    (700.0, 0.010528),
    (750.0, 0.0078185),
    (800.0, 0.0054113),
    (850.0, 0.003612),
    (900.0, 0.0021701),
    (950.0, 0.0011793),
    (1000.0, 0.0005093),
    (1050.0, 0.0001362),
    (1100.0, 3.0637e-5),
];

/// Returns the absorption coefficient, 1/um; `None` outside 300 to 1100 nm.
pub fn absorption_per_um(wavelength_nm: f64) -> Option<f64> {
    let pair = EXTINCTION.windows(2).find(|pair| (pair[0].0..=pair[1].0).contains(&wavelength_nm))?;
    let ((from, low), (to, high)) = (pair[0], pair[1]);
    let share = (wavelength_nm - from) / (to - from);
    let extinction = (low.ln() * (1.0 - share) + high.ln() * share).exp();
    Some(4.0 * PI * extinction / (wavelength_nm * 1e-3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_what_others_have_measured_and_the_table_ends() {
        // Green and Keevers, Progress in Photovoltaics 3, 189 (1995): another compilation, 1/cm.
        for (nm, per_cm) in [(450.0, 2.55e4), (500.0, 1.11e4), (600.0, 4.14e3), (700.0, 1.90e3), (900.0, 3.06e2)] {
            let ratio = absorption_per_um(nm).unwrap() * 1e4 / per_cm;
            assert!((ratio - 1.0).abs() < 0.1, "{nm} nm: {ratio}");
        }
        // Rows of the source that are not in the table here.
        for (nm, k) in [(410.0, 0.227), (520.0, 3.6415e-2), (680.0, 1.1905e-2), (830.0, 4.2734e-3), (980.0, 7.4866e-4)]
        {
            let ratio = absorption_per_um(nm).unwrap() * nm * 1e-3 / (4.0 * PI * k);
            assert!((ratio - 1.0).abs() < 0.05, "{nm} nm: {ratio}");
        }
        assert!(absorption_per_um(1100.0).is_some() && absorption_per_um(300.0).is_some(), "inside");
        assert!(absorption_per_um(299.9).is_none() && absorption_per_um(1100.1).is_none(), "outside");
    }
}
