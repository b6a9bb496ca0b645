//! A camera file with what was fitted in place of what it said: everything else stays, comments do not.

use crate::light_fit::{FittedBackground, FittedLight};
use crate::{geometry::Geometry, measure::PixelNoise, psf_fit::Shape};
use config::Camera;
use plan::optics::illumination::Vignetting;
use sky::astrometry::BrownConrady;
use toml::{Table, Value};

/// All that was fitted.
#[derive(Debug, Clone)]
pub struct Fit<'a> {
    /// Geometry.
    pub geometry: &'a Geometry,
    /// PSF; `None` where the camera's own is kept.
    pub shape: Option<Shape>,
    /// Zero point and colours; `None` where the camera's are kept.
    pub light: Option<&'a FittedLight>,
    /// Vignetting; `None` where the camera's illumination is kept.
    pub vignetting: Option<Vignetting>,
    /// Background.
    pub background: &'a FittedBackground,
    /// Noise.
    pub noise: PixelNoise,
}

/// Returns the read noise of the file, e- rms: the measured one, less what is drawn from its other keys.
fn read_noise_e(noise: PixelNoise, camera: &Camera) -> f64 {
    let (measured_e, params) = (noise.read_dn * noise.gain_e_per_dn, &camera.detector.params);
    let drawn_e2 = params.dsnu_e_rms.powi(2) + params.amplifier_noise_e_rms.powi(2);
    (measured_e.powi(2) - drawn_e2).max(0.0).sqrt()
}

/// Returns the text of the fitted camera file.
///
/// # Errors
/// When the text of `camera` is not TOML.
pub fn fitted(text: &str, camera: &Camera, name: &str, fit: &Fit<'_>) -> Result<String, toml::de::Error> {
    let mut file: Table = text.parse()?;
    file.insert("name".into(), Value::String(name.into()));
    let pitch_mm = camera.detector.pixel_pitch_um * 1e-3;
    let exposure_s = camera.exposure.exposure_s;
    set(&mut file, "optics", "focal_length_mm", fit.geometry.focal_px * pitch_mm);
    set_row(&mut file, "optics", "principal_point_px", &fit.geometry.centre_px);
    file.insert("distortion".into(), Value::Table(distortion(fit.geometry)));
    if let Some(shape) = fit.shape {
        file.insert("psf".into(), Value::Table(psf(shape)));
        file.remove("mtf");
    }
    let gain = fit.noise.gain_e_per_dn;
    set(&mut file, "detector", "gain_e_per_dn", gain);
    set(&mut file, "detector", "read_noise_e_rms", read_noise_e(fit.noise, camera));
    let mut zero_e = camera.star_light().electrons(0.0, 0.0, exposure_s);
    if let Some(light) = fit.light {
        set(&mut file, "radiometry", "color_c1", light.colour[0]);
        set(&mut file, "radiometry", "color_c2", light.colour[1]);
        // The product of transmission and exposure is known, not each: the one that may be more than 1 is the exposure.
        let factor = light.zero_e / zero_e;
        let transmission = camera.optics.transmission * factor;
        if transmission <= 1.0 {
            set(&mut file, "optics", "transmission", transmission);
        } else {
            set(&mut file, "exposure", "exposure_s", exposure_s * factor);
        }
        zero_e = light.zero_e;
    }
    if let Some(Vignetting { window_radius_mm, pupil_radius_mm, distance_mm }) = fit.vignetting {
        let mut table = Table::new();
        table.insert("cos4".into(), Value::Boolean(true));
        table.insert("window_radius_mm".into(), number(window_radius_mm));
        table.insert("window_distance_mm".into(), number(distance_mm));
        table.insert("pupil_radius_mm".into(), number(pupil_radius_mm));
        file.insert("illumination".into(), Value::Table(table));
    }
    let exposure_s =
        file.get("exposure").and_then(|table| table.get("exposure_s")).and_then(Value::as_float).unwrap_or(exposure_s);
    let arcsec2 = (fit.geometry.focal_px.recip().to_degrees() * 3600.0).powi(2);
    file.insert("background".into(), Value::Table(background(fit, gain, exposure_s, zero_e, arcsec2)));
    Ok(format!("# Written by `starloop compare`: fitted to one frame of the real sky.\n\n{file}"))
}

/// Returns a number with as many digits as a fit has, and more.
fn number(value: f64) -> Value {
    let text = format!("{value:.9e}");
    Value::Float(text.parse().unwrap_or(value))
}

fn table<'a>(file: &'a mut Table, section: &str) -> Option<&'a mut Table> {
    file.entry(section).or_insert_with(|| Value::Table(Table::new())).as_table_mut()
}

fn set(file: &mut Table, section: &str, key: &str, value: f64) {
    if let Some(table) = table(file, section) {
        table.insert(key.into(), number(value));
    }
}

fn set_row(file: &mut Table, section: &str, key: &str, values: &[f64]) {
    if let Some(table) = table(file, section) {
        table.insert(key.into(), Value::Array(values.iter().copied().map(number).collect()));
    }
}

/// Returns the distortion: Brown and Conrady's, or with a stretch the same as a polynomial.
fn distortion(geometry: &Geometry) -> Table {
    let BrownConrady { k1, k2, k3, p1, p2 } = geometry.distortion;
    let mut table = Table::new();
    let [e1, e2] = geometry.stretch;
    if e1 == 0.0 && e2 == 0.0 {
        for (key, value) in [("k1", k1), ("k2", k2), ("k3", k3), ("p1", p1), ("p2", p2)] {
            table.insert(key.into(), number(value));
        }
        return table;
    }
    // r^7 is beyond a polynomial of degree five: a fit to stars has no k3.
    let radial = |along: [usize; 2]| {
        let [i, j] = along;
        [(i + 2, j, k1), (i, j + 2, k1), (i + 4, j, k2), (i + 2, j + 2, 2.0 * k2), (i, j + 4, k2)]
    };
    let x = radial([1, 0]).into_iter().chain([(1, 0, e1), (0, 1, e2), (1, 1, 2.0 * p1), (2, 0, 3.0 * p2), (0, 2, p2)]);
    let y = radial([0, 1]).into_iter().chain([(1, 0, e2), (0, 1, -e1), (2, 0, p1), (0, 2, 3.0 * p1), (1, 1, 2.0 * p2)]);
    table.insert("model".into(), Value::String("polynomial".into()));
    for (key, terms) in [("x", x.collect::<Vec<_>>()), ("y", y.collect())] {
        #[allow(clippy::cast_possible_wrap, reason = "exponents up to 5")]
        let row = |(i, j, value): (usize, usize, f64)| {
            Value::Array(vec![Value::Integer(i as i64), Value::Integer(j as i64), number(value)])
        };
        let rows = terms.into_iter().filter(|(_, _, value)| *value != 0.0).map(row).collect();
        table.insert(key.into(), Value::Array(rows));
    }
    table
}

fn psf(shape: Shape) -> Table {
    let (model, keys): (&str, Vec<(&str, f64)>) = match shape {
        Shape::Gaussian { sigma_px } => ("gaussian", vec![("sigma_px", sigma_px)]),
        Shape::Moffat { fwhm_px, beta } => ("moffat", vec![("fwhm_px", fwhm_px), ("beta", beta)]),
        Shape::Halo { sigma_px, halo_sigma_px, share } => {
            ("halo", vec![("sigma_px", sigma_px), ("halo_sigma_px", halo_sigma_px), ("halo_share", share)])
        }
    };
    let mut table = Table::new();
    table.insert("model".into(), Value::String(model.into()));
    keys.into_iter().for_each(|(key, value)| {
        table.insert(key.into(), number(value));
    });
    table
}

fn background(fit: &Fit<'_>, gain: f64, exposure_s: f64, zero_e: f64, arcsec2: f64) -> Table {
    let FittedBackground { sky_dn, uniform_dn, gradient, quadratic, .. } = *fit.background;
    let mut table = Table::new();
    if uniform_dn > 0.0 {
        table.insert("uniform_e_per_s".into(), number(uniform_dn * gain / exposure_s));
        table.insert("gradient".into(), Value::Array(gradient.into_iter().map(number).collect()));
        table.insert("quadratic".into(), number(quadratic));
    }
    if sky_dn > 0.0 && zero_e > 0.0 {
        // The light of a square arcsecond against that of a star of magnitude 0.
        let mag = -2.5 * (sky_dn * gain / arcsec2 / zero_e).log10();
        table.insert("mag_per_arcsec2".into(), number(mag));
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::axes::Rotation;
    use config::Document;
    use glam::DVec3;
    use run::wiring::camera_parts::camera_params;
    use std::path::Path;

    const START: &str = "cameras/imx265_35mm.toml";

    fn geometry(stretch: [f64; 2]) -> Geometry {
        let distortion = BrownConrady { k1: 0.11, k2: -0.2, k3: 0.0, p1: 3e-4, p2: -2e-4 };
        Geometry { attitude: Rotation::IDENTITY, focal_px: 5114.0, centre_px: [510.0, 385.0], distortion, stretch }
    }

    fn written(geometry: &Geometry) -> Camera {
        let document = Document::built_in(START).unwrap();
        let camera = Camera::from_document(&document).unwrap();
        let background = FittedBackground { sky_dn: 150.0, uniform_dn: 60.0, gradient: [0.1, 0.4], quadratic: -0.3 };
        let light = FittedLight { zero_e: 9e5, colour: [0.02, 0.05], errors: [0.01; 2], stars: 30, edge_mag: [0.0; 2] };
        let noise = PixelNoise { gain_e_per_dn: 2.75, read_dn: 1.6, black_dn: 0.0, most_dn: 4095.0 };
        let vignetting = Vignetting { window_radius_mm: 12.0, pupil_radius_mm: 9.2, distance_mm: 80.0 };
        let shape = Some(Shape::Moffat { fwhm_px: 1.1, beta: 2.3 });
        let fit =
            Fit { geometry, shape, light: Some(&light), vignetting: Some(vignetting), background: &background, noise };
        let text = fitted(document.text(), &camera, "fitted", &fit).unwrap();
        Camera::from_document(&Document::from_text(&text, Path::new("fitted.toml"))).unwrap()
    }

    #[test]
    fn the_written_camera_puts_stars_where_the_fitted_geometry_does() {
        for stretch in [[0.0; 2], [2e-4, -3e-4]] {
            let geometry = geometry(stretch);
            let params = camera_params(&written(&geometry)).unwrap();
            for (x, y) in [(0.0, 0.0), (0.09, 0.06), (-0.08, 0.07), (0.03, -0.07)] {
                let direction = DVec3::new(x, y, 1.0).normalize();
                let (wanted, got) = (geometry.place(direction).unwrap(), params.geometry.project(direction).unwrap());
                let off = (wanted[0] - got[0]).hypot(wanted[1] - got[1]);
                assert!(off < 1e-5, "{stretch:?}: {off} px");
            }
        }
        let plain = camera_params(&written(&geometry([0.0; 2]))).unwrap();
        let moved = plain.geometry.project(DVec3::new(0.09, 0.06, 1.0)).unwrap();
        let stretched = geometry([2e-4, -3e-4]).place(DVec3::new(0.09, 0.06, 1.0)).unwrap();
        assert!((moved[0] - stretched[0]).hypot(moved[1] - stretched[1]) > 0.01, "control: the stretch moves stars");
    }

    #[test]
    fn the_written_camera_has_the_fitted_light_and_background() {
        let camera = written(&geometry([0.0; 2]));
        let exposure_s = camera.exposure.exposure_s;
        let zero_e = camera.star_light().electrons(0.0, 0.0, exposure_s);
        assert!((zero_e / 9e5 - 1.0).abs() < 1e-6, "{zero_e}");
        let params = camera_params(&camera).unwrap();
        let dn = |e_per_s: f64| e_per_s * exposure_s / 2.75;
        assert!((dn(params.background.sky_e_per_s) - 150.0).abs() < 0.1, "{}", dn(params.background.sky_e_per_s));
        assert!((dn(params.background.uniform_e_per_s) - 60.0).abs() < 1e-6);
        let (read_e, offsets_e) = (params.detector.read_noise_e_rms, params.detector.dsnu_e_rms);
        assert!(
            offsets_e > 0.0 && (read_e.hypot(offsets_e) - 1.6 * 2.75).abs() < 1e-6,
            "{read_e}: noise is drawn once"
        );
    }
}
