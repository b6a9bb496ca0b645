//! `[psf]` of a camera file, Moffat, measured and field: what is made of it, and what is refused.

use config::{Camera, ConfigError, Document, Psf};
use frames::sink::fits::card::Header;
use frames::sink::fits::{Pixels, write_image};
use plan::optics::{PsfModel, RoundPsf};
use std::path::Path;

/// Returns the share of a Gaussian's light in the pixel `x` from its middle.
fn cell(x: f64, sigma: f64) -> f64 {
    let edge = |x: f64| 0.5 * libm::erf(x / (sigma * 2.0_f64.sqrt()));
    edge(x + 0.5) - edge(x - 0.5)
}

const CAMERA: &str = "[detector]\nwidth_px = 64\nheight_px = 48\n[optics]\nfocal_length_mm = 25\n";

fn camera_in(directory: &Path, psf: &str) -> Result<Camera, ConfigError> {
    Camera::from_document(&Document::from_text(&format!("{CAMERA}[psf]\n{psf}\n"), &directory.join("cam.toml")))
}

fn made(psf: &str) -> PsfModel {
    made_in(Path::new("lab"), psf)
}

fn made_in(directory: &Path, psf: &str) -> PsfModel {
    match camera_in(directory, psf).unwrap().psf {
        Psf::Made(psf) => psf,
        other @ (Psf::Gaussian { .. } | Psf::Airy { .. } | Psf::Chain(_)) => panic!("{other:?}"),
    }
}

/// Writes a lopsided star on cells of a quarter of a pixel, as a FITS file.
fn write_star(path: &Path, level: f64) {
    let (k, width, height) = (4.0, 61_usize, 49_usize);
    let along = |i: usize, at: f64, sigma: f64| cell(i as f64 - at, sigma * k);
    let star = |x: usize, y: usize| 900.0 * along(x, 31.2, 0.9) * along(y, 22.6, 0.6) + level;
    let pixels: Vec<f32> = (0..width * height).map(|i| star(i % width, i / width) as f32).collect();
    let mut bytes = Vec::new();
    write_image(&mut bytes, width, height, Pixels::F32(&pixels), &Header::default()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn a_moffat_profile_has_the_width_asked_for() {
    let PsfModel::Moffat(moffat) = made("model = \"moffat\"\nfwhm_px = 2.4\nbeta = 3") else { panic!("a Moffat") };
    assert!((moffat.irradiance(1.2) / moffat.irradiance(0.0) - 0.5).abs() < 1e-12);
}

#[test]
fn a_halo_is_read_and_its_keys_belong_to_its_model() {
    let keys = "sigma_px = 0.8\nhalo_sigma_px = 2.5\nhalo_share = 0.2";
    let psf = made(&format!("model = \"halo\"\n{keys}"));
    assert_eq!(psf, PsfModel::halo(0.8, 2.5, 0.2));
    assert_ne!(psf, PsfModel::halo(0.8, 2.5, 0.3), "control");
    for (text, key) in [
        (keys.to_owned(), "halo_sigma_px"),
        ("model = \"halo\"\nsigma_px = 0.2".into(), "sigma_px"),
        ("model = \"halo\"\nsigma_px = 4.0\nhalo_sigma_px = 3.0".into(), "halo_sigma_px"),
        ("model = \"halo\"\nsampling = \"point\"".into(), "sampling"),
    ] {
        let refused = camera_in(Path::new("lab"), &text).expect_err(&text).to_string();
        assert!(refused.contains(key), "{text}: {refused}");
    }
}

#[test]
fn a_measured_psf_is_read_from_beside_the_camera_file() {
    let directory = tempfile::tempdir().unwrap();
    write_star(&directory.path().join("star.fits"), 0.0);
    let text = "model = \"measured\"\nfile = \"star.fits\"\nsamples_per_px = 4";
    let psf = made_in(directory.path(), text);
    for (x, y) in [(0.0, 0.0), (1.3, -0.4), (-2.1, 0.9)] {
        let wanted = cell(x, 0.9) * cell(y, 0.6);
        assert!((psf.pixel(x, y) - wanted).abs() < 1e-4, "({x}, {y}): {} {wanted}", psf.pixel(x, y));
    }
    let aside = made_in(directory.path(), &format!("{text}\nstar_at = [27.2, 22.6]"));
    assert!((aside.pixel(1.0, 0.0) - psf.pixel(0.0, 0.0)).abs() < 1e-4, "the star is a pixel to the left");
    write_star(&directory.path().join("bright.fits"), 0.2);
    let bright = "model = \"measured\"\nfile = \"bright.fits\"\nsamples_per_px = 4";
    let refused = camera_in(directory.path(), bright).expect_err("a background").to_string();
    assert!(refused.contains("psf.file") && refused.contains("border"), "{refused}");
    let psf = made_in(directory.path(), &format!("{bright}\nbackground = \"border\""));
    assert!((psf.pixel(0.0, 0.0) - cell(0.0, 0.9) * cell(0.0, 0.6)).abs() < 1e-3);
    std::fs::write(directory.path().join("star.fits"), b"no image").unwrap();
    let refused = camera_in(directory.path(), text).expect_err("no image").to_string();
    assert!(refused.contains("psf.file") && refused.contains("star.fits"), "{refused}");
}

#[test]
fn a_field_has_its_nodes_in_order() {
    let node = |sigma: f64| format!("[[psf.node]]\nsigma_px = {sigma}\n");
    let text = format!("model = \"field\"\nnodes = [2, 2]\n{}{}{}{}", node(0.5), node(0.6), node(0.7), node(0.8));
    let PsfModel::Field(field) = made(&text) else { panic!("a field") };
    let wanted = [0.5, 0.6, 0.7, 0.8].map(PsfModel::gaussian);
    assert_eq!(field.nodes(), wanted);
    assert_eq!(field.place_px(3), [63.5, 47.5]);
}

#[test]
fn each_rule_has_a_failing_example() {
    let two = "[[psf.node]]\nsigma_px = 0.7\n".repeat(2);
    let four = "[[psf.node]]\nsigma_px = 0.7\n".repeat(3) + "[[psf.node]]\nmodel = \"moffat\"\n";
    for (psf, key, parts) in [
        ("model = \"moffat\"", "psf.fwhm_px", ["missing", "full width"]),
        ("model = \"moffat\"\nfwhm_px = 0.1", "psf.fwhm_px", ["0.7", "full width"]),
        ("model = \"moffat\"\nfwhm_px = 2\nbeta = 1", "psf.beta", ["1.2", "wings"]),
        ("model = \"moffat\"\nfwhm_px = 2\nsigma_px = 1", "psf.sigma_px", ["belongs to", "gaussian"]),
        ("model = \"moffat\"\nfwhm_px = 2\nsampling = \"point\"", "psf.sampling", ["auto or table:S", "exact"]),
        ("fwhm_px = 2", "psf.fwhm_px", ["belongs to", "moffat"]),
        ("file = \"x.fits\"", "psf.file", ["belongs to", "measured"]),
        ("nodes = [2, 2]", "psf.nodes", ["belongs to", "field"]),
        ("model = \"measured\"", "psf.samples_per_px", ["missing", "2 to 32"]),
        ("model = \"measured\"\nsamples_per_px = 4", "psf.file", ["missing", "FITS"]),
        ("model = \"measured\"\nsamples_per_px = 4\nfile = \"no.fits\"", "no.fits", ["cannot be read", "psf.file"]),
        ("model = \"measured\"\nsamples_per_px = 4\nholds = \"dust\"", "psf.holds", ["\"light\"", "\"pixels\""]),
        ("model = \"measured\"\nsamples_per_px = 4\nbackground = \"x\"", "psf.background", ["\"border\"", "level"]),
        ("model = \"measured\"\nsamples_per_px = 4\nstar_at = \"x\"", "psf.star_at", ["\"centroid\"", "[column, row]"]),
        ("model = \"measured\"\nsamples_per_px = 4\nlight_inside = 2", "psf.light_inside", ["0.5 to 1", "share"]),
        ("model = \"field\"", "psf.nodes", ["missing", "2 to 9"]),
        ("model = \"field\"\nnodes = [1, 2]", "psf.nodes", ["[1, 2]", "2 to 9"]),
        (&format!("model = \"field\"\nnodes = [2, 2]\n{two}"), "psf.node", ["2 times", "wanted 4"]),
        (&format!("model = \"field\"\nnodes = [2, 2]\n{four}"), "psf.node[3].fwhm_px", ["missing", "cam.toml"]),
    ] {
        let error = camera_in(Path::new("lab"), psf).expect_err(psf).to_string();
        for part in [key].iter().chain(&parts) {
            assert!(error.contains(part), "\"{part}\" is not in: {error}");
        }
    }
}
