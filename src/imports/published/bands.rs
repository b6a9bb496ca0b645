//! Magnitudes of Hipparcos and Tycho-2 -> Gaia G and BP - RP.
//!
//! | relation | domain | spread, mag |
//! |---|---|---|
//! | G - Hp by V - I | -0.3 to 4 | 0.015 |
//! | BP - RP by V - I (Gaia DR3 documentation, sec. 5.5.1) | -0.3 to 4 | 0.06 |
//! | G - VT by BT - VT | -0.3 to 2.2 | 0.04 |
//! | BP - RP by BT - VT | -0.3 to 2.2 | 0.05 |
//!
//! All but the second were fitted to single stars of both catalogs; that of VT to 290,000 to VT = 10, within 0.01 mag
//! of their medians up to BT - VT = 1.8 and 0.06 beyond. Beyond its domain a colour is taken as the domain's end:
//! polynomials run away there. Without a colour a star is taken to have that of a middling one, and its own stays
//! unknown. Tests: `tests` (ends of the domains, known stars), and on real rows `hil_scripts/test_catalog.py`.

/// G - Hp by V - I.
const G_HP_BY_VI: [f64; 4] = [-0.019_64, -0.278_74, -0.180_7, 0.045_9];
/// BP - RP by V - I.
const BP_RP_BY_VI: [f64; 4] = [-0.032_98, 1.259, -0.127_9, 0.016_31];
/// Domain of V - I, mag.
const VI_DOMAIN_MAG: [f64; 2] = [-0.3, 4.0];
/// G - VT by BT - VT.
const G_VT_BY_BTVT: [f64; 5] = [-0.011_03, -0.164_53, -0.355_8, 0.319_58, -0.107_18];
/// BP - RP by BT - VT.
const BP_RP_BY_BTVT: [f64; 5] = [0.021_56, 1.324_74, -0.167_37, -0.240_53, 0.118_22];
/// Domain of BT - VT, mag.
const BTVT_DOMAIN_MAG: [f64; 2] = [-0.3, 2.2];
/// V - I of a star of unknown colour, mag.
const MIDDLING_VI_MAG: f64 = 0.7;
/// BT - VT of a star of unknown colour, mag.
const MIDDLING_BTVT_MAG: f64 = 0.7;

/// Returns the g and BP - RP by what Hipparcos measured.
pub(super) fn of_hipparcos(hp_mag: f64, vi_mag: Option<f64>) -> (f64, Option<f64>) {
    let [low, high] = VI_DOMAIN_MAG;
    let vi = vi_mag.map(|vi| vi.clamp(low, high));
    let g = hp_mag + polynomial(&G_HP_BY_VI, vi.unwrap_or(MIDDLING_VI_MAG));
    (g, vi.map(|vi| polynomial(&BP_RP_BY_VI, vi)))
}

/// Returns the g and BP - RP by what Tycho measured; `None` when it measured neither band.
pub(super) fn of_tycho(bt_mag: Option<f64>, vt_mag: Option<f64>) -> Option<(f64, Option<f64>)> {
    let [low, high] = BTVT_DOMAIN_MAG;
    let colour = bt_mag.zip(vt_mag).map(|(bt, vt)| (bt - vt).clamp(low, high));
    let vt = vt_mag.or(bt_mag.map(|bt| bt - MIDDLING_BTVT_MAG))?;
    let g = vt + polynomial(&G_VT_BY_BTVT, colour.unwrap_or(MIDDLING_BTVT_MAG));
    Some((g, colour.map(|colour| polynomial(&BP_RP_BY_BTVT, colour))))
}

fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_measured_by_both_come_out() {
        // Gaia's documentation gives the Sun's colour as BP - RP = 0.82, G - V = -0.17 about; V - I = 0.70, BT - VT = 0.73,
        // Hp - V = 0.13, VT - V = 0.07 (Hipparcos, vol. 1, sec. 1.3).
        let (g, colour) = of_hipparcos(5.13, Some(0.70));
        assert!((g - 4.83).abs() < 0.05 && (colour.unwrap() - 0.82).abs() < 0.04, "{g} {colour:?}");
        let (g, colour) = of_tycho(Some(5.80), Some(5.07)).unwrap();
        assert!((g - 4.83).abs() < 0.05 && (colour.unwrap() - 0.84).abs() < 0.05, "{g} {colour:?}");
        // A white star has one magnitude in all bands.
        let (g, colour) = of_hipparcos(6.0, Some(0.0));
        assert!((g - 6.0).abs() < 0.03 && colour.unwrap().abs() < 0.04);
        let (g, colour) = of_tycho(Some(6.0), Some(6.0)).unwrap();
        assert!((g - 6.0).abs() < 0.03 && colour.unwrap().abs() < 0.04);
    }

    #[test]
    fn beyond_their_domains_relations_stay_constant() {
        for ([low, high], of) in [
            (VI_DOMAIN_MAG, (|x| of_hipparcos(9.0, Some(x))) as fn(f64) -> (f64, Option<f64>)),
            (BTVT_DOMAIN_MAG, |x| of_tycho(Some(9.0 + x), Some(9.0)).unwrap()),
        ] {
            let apart = |a: f64, b: f64| (of(a).0 - of(b).0).abs() + (of(a).1.unwrap() - of(b).1.unwrap()).abs();
            assert!(apart(high + 3.0, high) < 1e-9 && apart(low - 3.0, low) < 1e-9);
            assert!(apart(high - 0.1, high) > 0.05 && apart(low + 0.1, low) > 0.05, "control: they move inside");
            let colours: Vec<f64> =
                (0..=100).map(|i| of(low + (high - low) * f64::from(i) / 100.0).1.unwrap()).collect();
            assert!(colours.is_sorted(), "redder is redder");
            let greens: Vec<f64> = (0..=100).map(|i| of(low + (high - low) * f64::from(i) / 100.0).0).collect();
            assert!(greens.iter().all(|g| (6.0..9.1).contains(g)), "{greens:?}");
        }
    }

    #[test]
    fn one_band_gives_a_magnitude_and_no_colour() {
        assert_eq!(of_tycho(None, None), None);
        let (from_vt, none) = of_tycho(None, Some(9.0)).unwrap();
        let (from_bt, also_none) = of_tycho(Some(9.7), None).unwrap();
        assert!(none.is_none() && also_none.is_none() && (from_vt - from_bt).abs() < 1e-9);
        assert!((from_vt - of_tycho(Some(9.7), Some(9.0)).unwrap().0).abs() < 1e-9);
        assert!(of_hipparcos(9.0, None).1.is_none());
    }
}
