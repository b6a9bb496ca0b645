//! A laboratory that sees digital numbers only finds what the camera file says, in the manner of EMVA 1288.
//!
//! The laboratory (`starloop::verify`) knows the light and the exposure time, nothing else. Promised: gain, read noise, DSNU, PRNU
//! and full well within [`SHEET_REL`] of the file, dark current within [`DARK_REL`].

use starloop::base::image::{DnImage, ElectronImage, Image};
use starloop::config::{Camera, Document};
use starloop::detector::{Detector, DetectorParams};
use starloop::verify::data_sheet::Stated;
use starloop::verify::{DataSheet, Flat, Procedure, characterise};
use starloop::wiring::camera_parts::camera_params;

/// What the procedure must find, relative.
const SHEET_REL: f64 = 0.01;
/// The same for the dark current.
const DARK_REL: f64 = 0.02;
/// Side of the images, px.
const SIZE: usize = 512;
/// Dark signal at the end of the dark series, e-.
const DARK_SIGNAL_E: f64 = 100.0;

pub(crate) fn built_in(name: &str) -> (DetectorParams, f64) {
    let camera = Camera::from_document(&Document::built_in(name).unwrap()).unwrap();
    (camera_params(&camera).unwrap().detector, camera.exposure.exposure_s)
}

/// The data sheet of a detector from its frames.
fn sheet(params: DetectorParams, exposure_s: f64, seed: u64) -> DataSheet {
    let mut detector = Detector::new(params, SIZE, SIZE, seed);
    let mut light: ElectronImage = Image::new(SIZE, SIZE);
    let procedure = Procedure::new(exposure_s, DARK_SIGNAL_E / params.dark_e_per_s);
    characterise([SIZE; 2], &procedure, &mut |flat: Flat, image: &mut DnImage| {
        light.pixels_mut().fill(flat.light_e as f32);
        detector.collect(&light, flat.frame, flat.exposure_s, image);
    })
}

/// What a sheet and a file do not agree on.
fn disagreements(sheet: &DataSheet, file: &DetectorParams) -> Vec<String> {
    let range_e = (f64::from(file.largest_dn()) - file.black_level_dn) * file.gain_e_per_dn;
    let stated = Stated {
        gain_e_per_dn: file.gain_e_per_dn,
        black_level_dn: file.black_level_dn,
        read_noise_e_rms: file.read_noise_e_rms,
        dark_e_per_s: file.dark_e_per_s,
        dsnu_e_rms: file.dsnu_e_rms,
        prnu: file.prnu,
        saturation_e: file.full_well_e.min(range_e),
    };
    let lines = sheet.compare(&stated);
    assert!(lines.iter().all(|line| line.most <= if line.name == "dark current" { DARK_REL } else { SHEET_REL }));
    let off = lines.iter().filter(|line| !line.holds());
    off.map(|line| format!("{}: {} for {}", line.name, line.measured, line.file)).collect()
}

#[test]
fn photon_transfer_finds_what_the_camera_files_say() {
    for (name, seed) in [("cameras/cubesat_tracker.toml", 3), ("cameras/star_tracker_20deg.toml", 4)] {
        let (params, exposure_s) = built_in(name);
        let sheet = sheet(params, exposure_s, seed);
        println!("{name}: {:?}", DataSheet { points: Vec::new(), ..sheet.clone() });
        assert_eq!(disagreements(&sheet, &params), [""; 0], "{name}");
        assert!(sheet.linearity_error < 2e-3, "{name}: {}", sheet.linearity_error);
    }
}

#[test]
fn a_detector_that_is_not_what_its_file_says_is_found_out() {
    let (file, exposure_s) = built_in("cameras/cubesat_tracker.toml");
    let off = |params: DetectorParams, what: &str| {
        let found = disagreements(&sheet(params, exposure_s, 5), &file);
        assert!(found.iter().any(|line| line.starts_with(what)), "{what}: {found:?}");
    };
    off(DetectorParams { gain_e_per_dn: 1.02 * file.gain_e_per_dn, ..file }, "gain");
    off(DetectorParams { read_noise_e_rms: 1.03 * file.read_noise_e_rms, ..file }, "read noise");
    off(DetectorParams { dark_e_per_s: 1.03 * file.dark_e_per_s, ..file }, "dark current");
    off(DetectorParams { dsnu_e_rms: 1.03 * file.dsnu_e_rms, prnu: 1.03 * file.prnu, ..file }, "PRNU");
}
