//! A bench that is drawn for a calibrated display: stars stand where the calibration says, and as bright.

use starloop::base::units::DEG;
use starloop::display::calibration::Calibration;
use starloop::display::luminance_code::luminance;
use starloop::sink::fits::read_image;
use starloop::sink::frame_log::{path_in, read_frame_log};
use starloop::sink::recorder::frame_path;
use starloop::sink::truth::read_truth;
use std::fs::File;
use std::path::Path;
use std::process::{Command, Output};

fn starloop(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_starloop")).args(arguments).current_dir(folder).output().unwrap()
}

fn succeeds(arguments: &[&str], folder: &Path) -> String {
    let output = starloop(arguments, folder);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {said}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn change(file: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "{text}");
    std::fs::write(file, text.replacen(from, to, 1)).unwrap();
}

/// `v_sensor = q v_icrf q*` for right ascension, declination and roll 0: boresight, image up to the north.
fn tracker_direction(ra_deg: f64, dec_deg: f64, star: glam::DVec3) -> glam::DVec3 {
    let (ra, dec) = (ra_deg * DEG, dec_deg * DEG);
    let z = glam::DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
    let north = glam::DVec3::new(-dec.sin() * ra.cos(), -dec.sin() * ra.sin(), dec.cos());
    let east = glam::DVec3::new(-ra.sin(), ra.cos(), 0.0);
    // Image right is west, image down is south.
    glam::DVec3::new(-star.dot(east), -star.dot(north), star.dot(z))
}

#[test]
fn stars_stand_where_the_calibration_says() {
    let folder = tempfile::tempdir().unwrap();
    let told = succeeds(&["calibrate", "display", "simulate", "--out", "."], folder.path());
    assert!(told.contains("display px"), "{told}");
    let checked = succeeds(&["check", "bench.toml"], folder.path());
    // 0.1 s are six refreshes of 60 Hz: no beat. The same tracker at 0.055 s beats, and is warned of.
    assert!(checked.contains("no beat"), "{checked}");
    assert!(checked.contains("stars on the display: ") && checked.contains("mag fit anywhere"), "{checked}");
    change(&folder.path().join("tracker.toml"), "exposure_s = 0.1", "exposure_s = 0.055");
    let beats = succeeds(&["check", "bench.toml"], folder.path());
    assert!(beats.contains("WARNING") && beats.contains("refreshes"), "{beats}");
    let words = ["--clock", "virtual", "--duration", "0.2", "--sink", "recorder", "--out", "run", "--quiet"];
    succeeds(&[&["run", "bench.toml"], &words[..]].concat(), folder.path());
    let run = folder.path().join("run");
    let rows = read_frame_log(File::open(path_in(&run)).unwrap()).unwrap();
    assert_eq!((rows.len(), rows[5].width_px, rows[5].height_px), (12, 640, 480), "frames of the display's size");
    // Two refreshes ahead and the latency that was measured: no attitude of that time has come yet.
    assert!(rows.iter().all(|row| row.horizon_ns > 40_000_000), "{}", rows[5].horizon_ns);
    let calibration = Calibration::read(&folder.path().join("display.toml")).unwrap();
    let geometry = calibration.calibrated().unwrap().geometry;
    let full_e = calibration.light.as_ref().unwrap().full_px_e_per_s / 60.0;
    let stars = read_truth(File::open(frame_path(&run, 5, "truth.csv")).unwrap()).unwrap();
    let image = read_image(File::open(frame_path(&run, 5, "fits")).unwrap()).unwrap();
    let starloop::sink::fits::Pixels::U16(pixels) = image.pixels.as_pixels() else { panic!("16 bits") };
    let mut looked_at = 0;
    for star in &stars {
        let (ra, dec) = (star.ra_deg * DEG, star.dec_deg * DEG);
        let direction = glam::DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
        let wanted = geometry.project(tracker_direction(84.05, -1.2, direction)).unwrap();
        let off_px = (star.x_px - wanted[0]).hypot(star.y_px - wanted[1]);
        // The attitude on the wire is good to 0.02 arcsec, a display pixel is 103.
        assert!(off_px < 2e-3, "star {}: {off_px} display px", star.id);
        let Some(measured) = measured(pixels, [star.x_px, star.y_px], &stars) else { continue };
        looked_at += 1;
        let [x, y, luminance] = measured;
        assert!((x - star.x_px).hypot(y - star.y_px) < 0.01, "star {} is drawn at ({x}, {y})", star.id);
        let steps = star.electrons / 3e4;
        assert!((luminance / steps - 1.0).abs() < 0.01, "star {}: {luminance} steps, {steps} in truth", star.id);
        // Luminance by hand: what the tracker gets of a refresh, over what a full pixel gives.
        let camera_e = luminance / 65_535.0 * full_e;
        assert!(camera_e > 0.0 && camera_e < 10.0 * full_e);
    }
    assert!(looked_at > 3, "{looked_at} of {} stars are bright and alone", stars.len());
}

/// Centroid and light of a star that is bright, unsaturated and alone.
fn measured(pixels: &[u16], [x_px, y_px]: [f64; 2], stars: &[starloop::sink::TruthStar]) -> Option<[f64; 3]> {
    let near = stars.iter().filter(|star| (star.x_px - x_px).hypot(star.y_px - y_px) < 14.0).count();
    let (column, row) = (x_px.round() as i64, y_px.round() as i64);
    if near > 1 || !(6..634).contains(&column) || !(6..474).contains(&row) {
        return None;
    }
    let (mut sums, mut most) = ([0.0; 3], 0);
    for y in row - 5..=row + 5 {
        for x in column - 5..=column + 5 {
            let value = pixels[(y * 640 + x) as usize];
            most = most.max(value);
            // Codes of luminance, in even steps of 1/65535 of full.
            let value = 65_535.0 * luminance(value);
            sums = [sums[0] + value * x as f64, sums[1] + value * y as f64, sums[2] + value];
        }
    }
    (luminance(most) > 0.03 && most < 65_535).then_some([sums[0] / sums[2], sums[1] / sums[2], sums[2]])
}

#[test]
fn a_wrong_calibration_is_refused_before_anything_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    succeeds(&["calibrate", "display", "simulate", "--out", "."], folder.path());
    succeeds(&["check", "bench.toml"], folder.path());
    let refused = |file: &str, from: &str, to: &str, part: &str| {
        let file = folder.path().join(file);
        let whole = std::fs::read_to_string(&file).unwrap();
        change(&file, from, to);
        let output = starloop(&["check", "bench.toml"], folder.path());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && said.contains(part), "{to}: {said}");
        std::fs::write(&file, whole).unwrap();
    };
    refused("bench.toml", "window = [640, 480]", "window = [800, 600]", "640 x 480");
    refused("bench.toml", "name = \"simulated display\"", "name = \"another display\"", "another display");
    refused("bench.toml", "kind = \"display\"", "kind = \"display\"\nbits = 10", "10 bits");
    refused("tracker.toml", "height_px = 560", "height_px = 561", "561");
    refused("display.toml", "valid_days = 90", "valid_days = 91", "edited");
    refused("bench.toml", "display.toml", "no_such.toml", "no_such.toml");
}
