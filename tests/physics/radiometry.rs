//! Radiometry against others' measurements: Gaia's published figures, the mean colours of stars, two measured spectra.

use plan::optics::star_spectrum::GaiaBand;
use plan::optics::{Band, BandRadiometry, Spectrum, StarSpectra, StarSpectrum, spectral_weights};

/// Planck's constant, J s (SI).
const PLANCK_J_S: f64 = 6.626_070_15e-34;
/// Step of the sums in this file, nm.
const STEP_NM: f64 = 0.25;

/// Returns the sum over wavelength by the trapezoid rule: nothing of the crate's quadrature.
fn sum(from_nm: f64, to_nm: f64, f: impl Fn(f64) -> f64) -> f64 {
    let steps = ((to_nm - from_nm) / STEP_NM).round() as usize;
    let at = |i: usize| f(from_nm + STEP_NM * i as f64);
    STEP_NM * ((1..steps).map(at).sum::<f64>() + 0.5 * (at(0) + at(steps)))
}

/// Returns the straight lines through values at equal steps.
fn table(first_nm: f64, step_nm: f64, values: &[f64]) -> impl Fn(f64) -> f64 + '_ {
    move |nm| {
        let at = (nm - first_nm) / step_nm;
        if at < 0.0 || at > (values.len() - 1) as f64 {
            return 0.0;
        }
        let below = (at as usize).min(values.len() - 2);
        values[below] + (at - below as f64) * (values[below + 1] - values[below])
    }
}

#[test]
fn the_coarse_passbands_are_gaias() {
    // Pivot wavelengths: Riello et al. 2021, table 3. Integrals: of the published tables at every nanometre.
    for (band, pivot_nm, integral_nm) in
        [(GaiaBand::g(), 621.79, 317.325), (GaiaBand::bp(), 510.97, 175.056), (GaiaBand::rp(), 776.91, 212.974)]
    {
        let moment = |power: i32| sum(300.0, 1100.0, |nm| band.response.at(nm) * nm.powi(power));
        let pivot = (moment(1) / moment(-1)).sqrt();
        assert!((pivot - pivot_nm).abs() < 0.3, "{pivot} {pivot_nm}");
        assert!((moment(0) / integral_nm - 1.0).abs() < 2e-3, "{} {integral_nm}", moment(0));
        assert!((pivot - pivot_nm * 1.001).abs() > 0.3, "the comparison can fail");
    }
}

/// Johnson-Cousins passbands (Bessell 1990, PASP 102, 1181, table 2; every other value, from these wavelengths in steps
/// of 20 nm; they weigh energy), flux density of magnitude 0, Jy (Bessell, Castelli and Plez 1998, table A2), and `G -
/// band` as a polynomial of BP-RP (Gaia DR3 documentation, table 5.9).
struct Johnson {
    name: &'static str,
    first_nm: f64,
    energy: &'static [f64],
    zero_jy: f64,
    g_minus: &'static [f64],
    /// Largest difference up to BP-RP = 2.6, and up to 4.
    tolerance_mag: [f64; 2],
}

const JOHNSON: [Johnson; 3] = [
    Johnson {
        name: "V",
        first_nm: 460.0,
        energy: &[0.0, 0.03, 0.458, 0.967, 0.973, 0.792, 0.574, 0.359, 0.197, 0.081, 0.025, 0.013, 0.0],
        zero_jy: 3636.0,
        g_minus: &[-0.02704, 0.01424, -0.2156, 0.01426],
        tolerance_mag: [0.05, 0.11],
    },
    Johnson {
        name: "R",
        first_nm: 540.0,
        energy: &[
            0.0, 0.23, 0.91, 1.0, 0.96, 0.9, 0.81, 0.72, 0.61, 0.51, 0.4, 0.308, 0.224, 0.14, 0.096, 0.052, 0.024,
            0.012, 0.0,
        ],
        zero_jy: 3064.0,
        g_minus: &[-0.02275, 0.3961, -0.1243, -0.01396, 0.003775],
        tolerance_mag: [0.075, 0.075],
    },
    Johnson {
        name: "I",
        first_nm: 700.0,
        energy: &[0.0, 0.232, 0.785, 0.965, 0.99, 1.0, 0.99, 0.95, 0.86, 0.56, 0.15, 0.0],
        zero_jy: 2416.0,
        g_minus: &[0.01753, 0.76, -0.0991],
        tolerance_mag: [0.055, 0.125],
    },
];

impl Johnson {
    /// Returns the magnitude of a star of G = 0 with this spectrum.
    fn mag(&self, star: &StarSpectrum) -> f64 {
        let photons = |nm: f64| table(self.first_nm, 20.0, self.energy)(nm) / nm;
        let to_nm = self.first_nm + 20.0 * (self.energy.len() - 1) as f64;
        let counted = sum(self.first_nm, to_nm, |nm| photons(nm) * star.photons_per_s_m2_nm(nm));
        // A flat flux density per frequency is zero_jy / (h lambda) photons per wavelength.
        let zero = sum(self.first_nm, to_nm, |nm| photons(nm) * self.zero_jy * 1e-26 / (PLANCK_J_S * nm));
        -2.5 * (counted / zero).log10()
    }

    /// Returns the documentation's magnitude of a star of G = 0.
    fn published(&self, bp_rp: f64) -> f64 {
        -self.g_minus.iter().rev().fold(0.0, |sum, coefficient| sum * bp_rp + coefficient)
    }
}

/// Returns the largest difference of the model's magnitudes from the published ones over colours, mag; colours shifted
/// by `shift`.
fn worst(band: &Johnson, to_color: f64, shift: f64) -> f64 {
    let spectra = StarSpectra::new();
    let colors = (0..).map(|i| -0.4 + 0.1 * f64::from(i)).take_while(|color| *color <= to_color + 1e-9);
    colors.map(|c| (band.mag(&spectra.of_color(c + shift)) - band.published(c)).abs()).fold(0.0, f64::max)
}

#[test]
fn light_in_johnsons_bands_is_that_of_mean_stars() {
    for band in &JOHNSON {
        let [near, far] = [2.6, 4.0].map(|to_color| worst(band, to_color, 0.0));
        println!("{}: {near:.3} mag up to BP-RP = 2.6, {far:.3} up to 4", band.name);
        assert!(near < band.tolerance_mag[0] && far < band.tolerance_mag[1], "{}: {near} {far}", band.name);
        assert!(worst(band, 2.6, 0.25) > band.tolerance_mag[0], "{}: the comparison can fail", band.name);
    }
}

/// Photons per wavelength of two measured stars, means over 10 nm about 320 to 1100 nm, in units of that at 550 nm:
/// Vega (CALSPEC alpha_lyr_stis_011) and the Sun (the Kurucz 1993 spectrum of the same library).
const VEGA: [f64; 79] = [
    0.5609, 0.5663, 0.5670, 0.5689, 0.5694, 0.6119, 0.9816, 1.4772, 1.5271, 1.4537, 1.6794, 1.3936, 1.4706, 1.4752,
    1.4189, 1.3698, 1.2588, 1.0795, 1.2096, 1.1663, 1.1131, 1.0742, 1.0371, 1.0000, 0.9651, 0.9324, 0.8998, 0.8675,
    0.8384, 0.8096, 0.7823, 0.7575, 0.7313, 0.6887, 0.6166, 0.6656, 0.6466, 0.6280, 0.6091, 0.5896, 0.5732, 0.5561,
    0.5402, 0.5249, 0.5096, 0.4959, 0.4789, 0.4691, 0.4564, 0.4442, 0.4312, 0.4205, 0.4106, 0.3995, 0.3973, 0.3882,
    0.3974, 0.3872, 0.3720, 0.4001, 0.3590, 0.3764, 0.3781, 0.3441, 0.3388, 0.3532, 0.3456, 0.3367, 0.3099, 0.2983,
    0.3138, 0.3062, 0.2990, 0.2916, 0.2850, 0.2764, 0.2709, 0.2407, 0.2469,
];
const SUN: [f64; 79] = [
    0.2274, 0.3102, 0.2733, 0.3483, 0.3360, 0.3913, 0.3884, 0.3849, 0.5494, 0.6746, 0.6876, 0.6197, 0.7470, 0.8622,
    0.9059, 0.9274, 0.9583, 0.9120, 0.9345, 0.9546, 0.9060, 0.9569, 0.9806, 1.0000, 1.0011, 1.0161, 1.0324, 1.0209,
    1.0302, 1.0150, 1.0002, 1.0039, 1.0003, 0.9872, 0.9570, 0.9891, 0.9821, 0.9744, 0.9626, 0.9529, 0.9368, 0.9326,
    0.9182, 0.9200, 0.9136, 0.8988, 0.8951, 0.8831, 0.8755, 0.8662, 0.8496, 0.8446, 0.8333, 0.8157, 0.8149, 0.7957,
    0.7964, 0.7894, 0.7792, 0.7731, 0.7639, 0.7620, 0.7493, 0.7441, 0.7326, 0.7279, 0.7203, 0.7129, 0.7054, 0.6930,
    0.6883, 0.6820, 0.6736, 0.6658, 0.6568, 0.6438, 0.6354, 0.6244, 0.6235,
];

fn silicon() -> Spectrum {
    Spectrum::share(vec![[350.0, 0.1], [450.0, 0.5], [600.0, 0.65], [800.0, 0.45], [1000.0, 0.08], [1050.0, 0.0]])
        .unwrap()
}

fn bands() -> [(&'static str, Band, f64); 4] {
    let cut =
        |from: f64, to: f64| Band::new(Spectrum::share(vec![[from, 1.0], [to, 1.0]]).unwrap(), silicon()).unwrap();
    // Share by which electrons may be off: a whole detector far less than a filter that ends at Vega's Paschen jump.
    [
        ("silicon", Band::with_flat_transmission(0.8, silicon()).unwrap(), 0.005),
        ("500 to 600 nm", cut(500.0, 600.0), 0.045),
        ("700 to 900 nm", cut(700.0, 900.0), 0.03),
        ("850 to 950 nm", cut(850.0, 950.0), 0.06),
    ]
}

#[test]
fn electrons_of_measured_spectra_are_those_predicted_from_two_magnitudes() {
    for (star, photons) in [("Vega", VEGA), ("the Sun", SUN)] {
        let spectrum = table(320.0, 10.0, &photons);
        let through = |band: &GaiaBand| sum(320.0, 1100.0, |nm| spectrum(nm) * band.response.at(nm));
        let mag = |band: GaiaBand| band.mag(through(&band));
        let (mag_g, bp_rp) = (mag(GaiaBand::g()), mag(GaiaBand::bp()) - mag(GaiaBand::rp()));
        for (name, band, tolerance) in bands() {
            let measured = sum(320.0, 1100.0, |nm| spectrum(nm) * band.response(nm));
            let predict = |bp_rp: f64| BandRadiometry::new(&band, 1.0).electrons(mag_g, bp_rp, 1.0) / measured - 1.0;
            let error = predict(bp_rp);
            println!("{star}, BP-RP {bp_rp:.3}, {name}: {:+.2} %", 100.0 * error);
            assert!(error.abs() < tolerance, "{star}, {name}: {error}");
            // Over the whole of silicon colour hardly matters (it is nearly Gaia's G); in a part of it, it does.
            assert!(name == "silicon" || predict(bp_rp + 0.6).abs() > tolerance, "{star}, {name}: it can fail");
        }
    }
}

#[test]
fn a_bands_electrons_are_the_integral_over_its_spectrum() {
    let aperture_m2 = 0.004;
    for (name, band, _) in bands() {
        for bp_rp in [-0.3, 0.0, 0.82, 2.3] {
            let star = StarSpectra::new().of_color(bp_rp);
            let (from, to) = band.range_nm();
            let exact = aperture_m2 * sum(from, to, |nm| band.response(nm) * star.photons_per_s_m2_nm(nm));
            let ours = BandRadiometry::new(&band, aperture_m2).electrons(7.5, bp_rp, 0.2);
            let exact = exact * 0.2 * 10_f64.powf(-0.4 * 7.5);
            assert!((ours / exact - 1.0).abs() < 2e-5, "{name}, {bp_rp}: {}", ours / exact - 1.0);
        }
    }
}

#[test]
fn weights_are_the_electrons_of_their_part_of_the_band() {
    let (_, band, _) = &bands()[0];
    let star = StarSpectra::new().of_color(1.1);
    let electrons = |from, to| sum(from, to, |nm| band.response(nm) * star.photons_per_s_m2_nm(nm));
    let weights = spectral_weights(band, 1.1, 7);
    for (i, weight) in (0..).zip(&weights) {
        let from = 350.0 + 100.0 * f64::from(i);
        let share = electrons(from, from + 100.0) / electrons(350.0, 1050.0);
        assert!((weight.weight - share).abs() < 1e-5, "{i}: {} {share}", weight.weight);
        assert!((from..from + 100.0).contains(&weight.wavelength_nm), "{i}: {}", weight.wavelength_nm);
    }
    assert_eq!(weights.len(), 7);
}
