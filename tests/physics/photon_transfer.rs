//! A laboratory that sees digital numbers only finds what the camera file says, in the manner of EMVA 1288.
//!
//! The laboratory (`batch::verify`) knows the light and the exposure time, nothing else. Promised: gain, read noise,
//! DSNU, PRNU and full well within [`SHEET_REL`] of the file, dark current within [`DARK_REL`].

use base::image::{DnImage, ElectronImage, Image};
use batch::verify::data_sheet::{LightPoint, Stated};
use batch::verify::{DataSheet, Flat, Procedure, characterise};
use config::{Camera, Document};
use image::detector::{DarkLaw, Detector, DetectorConditions, DetectorParams, LinePattern, Nonlinearity, RowNoise};
use run::wiring::camera_parts::camera_params;

/// Required relative error of the procedure.
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

/// Returns the data sheet of a detector from its frames.
fn sheet(params: DetectorParams, exposure_s: f64, seed: u64) -> DataSheet {
    let longest_dark_s = DARK_SIGNAL_E / (params.dark_e_per_s * params.dark_law.factor());
    sheet_by(&Procedure::new(exposure_s, longest_dark_s), params, seed)
}

fn sheet_by(procedure: &Procedure, params: DetectorParams, seed: u64) -> DataSheet {
    let mut detector = Detector::new(params, SIZE, SIZE, seed);
    let mut light: ElectronImage = Image::new(SIZE, SIZE);
    characterise([SIZE; 2], procedure, &mut |flat: Flat, image: &mut DnImage| {
        light.pixels_mut().fill(flat.light_e as f32);
        detector.collect(&light, flat.frame, &DetectorConditions::dark(flat.exposure_s), image);
    })
}

/// Returns the lines on which a sheet and a file disagree.
fn disagreements(sheet: &DataSheet, file: &DetectorParams, exposure_s: f64) -> Vec<String> {
    let lines = sheet.compare(&Stated::of(file, exposure_s));
    assert!(lines.iter().all(|line| line.most <= if line.name == "dark current" { DARK_REL } else { SHEET_REL }));
    let off = lines.iter().filter(|line| !line.holds());
    off.map(|line| format!("{}: {} for {}", line.name, line.measured, line.file)).collect()
}

/// Returns the largest relative difference between the measured response and the one stated by a file, from 5 to 95 %
/// of saturation. Both are relative to their own slope at the first point of that range.
fn response_error(points: &[LightPoint], saturation_e: f64, seen_e: impl Fn(f64) -> f64) -> f64 {
    let judged = points.iter().filter(|p| (0.05..=0.95).contains(&(p.light_e / saturation_e)));
    let ratio = |p: &LightPoint| p.signal_dn / seen_e(p.light_e);
    let first = judged.clone().next().map_or(f64::NAN, ratio);
    judged.map(|p| (ratio(p) / first - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn photon_transfer_finds_what_the_camera_files_say() {
    for (name, seed) in [("cameras/cubesat_tracker.toml", 3), ("cameras/star_tracker_20deg.toml", 4)] {
        let (params, exposure_s) = built_in(name);
        let sheet = sheet(params, exposure_s, seed);
        println!("{name}: {:?}", DataSheet { points: Vec::new(), ..sheet.clone() });
        assert_eq!(disagreements(&sheet, &params, exposure_s), [""; 0], "{name}");
        assert!(sheet.linearity_error < 2e-3, "{name}: {}", sheet.linearity_error);
    }
}

#[test]
fn a_detector_that_is_not_what_its_file_says_is_found_out() {
    let (file, exposure_s) = built_in("cameras/cubesat_tracker.toml");
    let off = |params: DetectorParams, what: &str| {
        let found = disagreements(&sheet(params, exposure_s, 5), &file, exposure_s);
        assert!(found.iter().any(|line| line.starts_with(what)), "{what}: {found:?}");
    };
    off(DetectorParams { gain_e_per_dn: 1.02 * file.gain_e_per_dn, ..file }, "gain");
    off(DetectorParams { read_noise_e_rms: 1.03 * file.read_noise_e_rms, ..file }, "read noise");
    off(DetectorParams { dark_e_per_s: 1.03 * file.dark_e_per_s, ..file }, "dark current");
    off(DetectorParams { dsnu_e_rms: 1.03 * file.dsnu_e_rms, prnu: 1.03 * file.prnu, ..file }, "PRNU");
}

#[test]
fn everything_that_adds_to_noise_and_patterns_is_found_in_their_sums() {
    let (file, exposure_s) = built_in("cameras/cubesat_tracker.toml");
    let file = DetectorParams {
        amplifier_noise_e_rms: 4.0,
        row_noise: RowNoise { e_rms: 1.0, corner_cycles_per_row: 0.0 },
        line_pattern: LinePattern { column_e_rms: 1.5, column_gain_rms: 0.004, row_e_rms: 0.5 },
        dark_nonuniformity: 0.1,
        dark_law: DarkLaw { reference_c: 25.0, operating_c: 46.0, doubling_k: 7.0 },
        ..file
    };
    // 512 columns and rows are few: their own patterns are known to 3 %, which the sums feel.
    let sheet = sheet(file, exposure_s, 6);
    let stated = Stated::of(&file, exposure_s);
    assert_eq!(stated.dark_e_per_s, 8.0 * file.dark_e_per_s, "three doublings");
    for line in sheet.compare(&stated) {
        let most = if ["DSNU", "PRNU"].contains(&line.name) { 0.04 } else { line.most };
        assert!(line.error().abs() <= most, "{line:?}");
    }
}

#[test]
fn a_bent_response_is_found_as_the_file_states_it() {
    let (file, exposure_s) = built_in("cameras/cubesat_tracker.toml");
    let knots = [[8e3, 8e3], [2e4, 1.92e4], [3.27e4, 2.9e4]];
    let file = DetectorParams { nonlinearity: Nonlinearity::through(&knots).unwrap(), ..file };
    // The photon transfer below the first knot: there the response is straight.
    let procedure = Procedure { fitted: 0.2, levels: 100, ..Procedure::new(exposure_s, 20.0) };
    let sheet = sheet_by(&procedure, file, 7);
    assert!((sheet.gain_e_per_dn / file.gain_e_per_dn - 1.0).abs() < SHEET_REL, "{}", sheet.gain_e_per_dn);
    assert!((sheet.saturation_e / 2.9e4 - 1.0).abs() < SHEET_REL, "{}", sheet.saturation_e);
    // Straight lines through the knots, written afresh.
    let seen = |e: f64| {
        let line = |[a, fa]: [f64; 2], [b, fb]: [f64; 2]| fa + (e - a) * (fb - fa) / (b - a);
        if e < 8e3 {
            e
        } else if e < 2e4 {
            line(knots[0], knots[1])
        } else {
            line(knots[1], knots[2])
        }
    };
    let error = response_error(&sheet.points, 3.27e4, seen);
    assert!(error < SHEET_REL, "{error}");
    assert!(response_error(&sheet.points, 3.27e4, |e| e) > 0.05, "a straight line is not what is found");
    assert!((sheet.linearity_error - 0.0).abs() > 0.02, "nor is it straight: {}", sheet.linearity_error);
}
