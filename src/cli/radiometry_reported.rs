//! A camera's radiometry in words: which model, and the numbers that follow from it.

use config::{Camera, RadiometryModel};
use plan::optics::{StarLight, StarSpectra};

/// Colours for which a band's colour term is printed.
const BLUE_AND_RED: [f64; 2] = [0.0, 2.0];

/// Returns one line.
pub(super) fn radiometry_text(camera: &Camera) -> String {
    let light = camera.star_light();
    match (&camera.band, &light, camera.radiometry.model) {
        (Some(band), StarLight::Band(_), _) => {
            let (from, to) = band.range_nm();
            let [blue, red] = BLUE_AND_RED.map(|color| band.mean_wavelength_nm(&StarSpectra::new().of_color(color)));
            format!(
                "band of {from} to {to} nm, mean {blue:.0} nm for BP-RP = 0 and {red:.0} nm for 2, where magnitudes \
                 are G{:+.3}",
                light.mag_instrument(0.0, BLUE_AND_RED[1])
            )
        }
        (_, _, RadiometryModel::LinearGrey(map)) => format!(
            "linear grey mapping, G = {} to {}: {} to {} DN whatever the exposure",
            map.brightest_mag, map.faintest_mag, map.brightest_grey_dn, map.faintest_grey_dn
        ),
        (_, _, model) => format!(
            "{:.3e} photons / (s m^2) at {} = 0, mean transmission {} and QE {}",
            camera.radiometry.zero_magnitude_photons_per_s_m2,
            if model == RadiometryModel::PhotonsV { "V" } else { "G" },
            camera.optics.transmission,
            camera.detector.quantum_efficiency
        ),
    }
}

/// Returns down to which magnitude a camera is drawn, and who chose it.
pub(super) fn drawn_text(camera: &Camera, limiting_mag: f32) -> String {
    let chosen = if camera.radiometry.limiting_mag.is_none() { " (limiting_mag = \"auto\")" } else { "" };
    format!("drawn down to G = {limiting_mag}{chosen}")
}

/// Returns that magnitude as a number with the digits of the file, or with hundredths.
pub(super) fn drawn_mag(camera: &Camera, limiting_mag: f32) -> f64 {
    camera.radiometry.limiting_mag.unwrap_or_else(|| (f64::from(limiting_mag) * 100.0).round() / 100.0)
}
