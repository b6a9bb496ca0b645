//! Tests a bench that is drawn for a calibrated display: stars are at the places and have the brightness given by the
//! calibration, and the frames report the tracker's own pointing.

use base::units::DEG;
use frames::sink::fits::{Pixels, read_image};
use frames::sink::frame_log::{path_in, read_frame_log};
use frames::sink::{TruthStar, recorder::frame_path, truth::read_truth};
use glam::{DQuat, DVec2, DVec3};
use outputs::display::{calibration::Calibration, luminance_code::luminance};
use std::fs::File;
use std::path::{Path, PathBuf};
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

/// Returns the files of a simulated bench with a calibrated display.
fn bench() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let reported = succeeds(&["calibrate", "display", "simulate", "--out", "."], folder.path());
    assert!(reported.contains("display px"), "{reported}");
    folder
}

/// The columns of `frames.csv` that are looked at.
#[derive(serde::Deserialize)]
struct FrameRow {
    frame: u32,
    exposure_s: f64,
    qw: f64,
    qx: f64,
    qy: f64,
    qz: f64,
    ra_deg: f64,
    dec_deg: f64,
    roll_deg: f64,
    rate_x_deg_s: f64,
    rate_y_deg_s: f64,
    rate_z_deg_s: f64,
    horizon_ns: i64,
    width_px: usize,
    height_px: usize,
}

/// A recorded run, and its frames.csv.
struct Run {
    folder: PathBuf,
    rows: Vec<FrameRow>,
    calibration: Calibration,
}

impl Run {
    fn of(bench: &Path, name: &str, duration_s: &str) -> Self {
        let words = ["run", "bench.toml", "--clock", "virtual", "--sink", "recorder", "--quiet"];
        succeeds(&[&words[..], &["--duration", duration_s, "--out", name]].concat(), bench);
        let rows = read_frame_log(File::open(path_in(&bench.join(name))).unwrap()).unwrap();
        let calibration = Calibration::read(&bench.join("display.toml")).unwrap();
        Self { folder: bench.join(name), rows, calibration }
    }

    fn stars(&self, number: u32) -> Vec<TruthStar> {
        read_truth(File::open(frame_path(&self.folder, number, "truth.csv")).unwrap()).unwrap()
    }

    fn pixels(&self, number: u32) -> Vec<u16> {
        let image = read_image(File::open(frame_path(&self.folder, number, "fits")).unwrap()).unwrap();
        let Pixels::U16(pixels) = image.pixels.as_pixels() else { panic!("16 bits") };
        pixels.to_vec()
    }

    /// Returns isolated stars of a frame, with their measurements.
    fn seen(&self, number: u32) -> Vec<(TruthStar, Seen)> {
        let (stars, pixels) = (self.stars(number), self.pixels(number));
        stars.iter().filter_map(|star| Some((*star, measured(&pixels, [star.x_px, star.y_px], &stars)?))).collect()
    }

    /// Returns the light of a star in the tracker, e-/s, by its pixels and by its magnitude: from the calibration's
    /// values alone.
    fn light_e_per_s(&self, star: &TruthStar, seen: &Seen) -> [f64; 2] {
        let light = self.calibration.light.as_ref().unwrap();
        let by_magnitude = light.zero_point_e_per_s * 10_f64.powf(-0.4 * f64::from(star.mag));
        [seen.luminance / 65_535.0 * light.full_px_e_per_s, by_magnitude]
    }
}

/// Tests that the spacecraft's own tracker sees the sky at its own rate, and that the display shows it to a tracker in
/// front.
#[test]
fn a_display_is_in_a_closed_loop_in_which_the_tracker_inside_sees_the_sky() {
    let folder = bench();
    let spacecraft = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/spacecraft/smallsat.toml");
    let mut text = std::fs::read_to_string(folder.path().join("bench.toml")).unwrap();
    text.push_str("\n[observer]\nkind = \"circular_orbit\"\naltitude_km = 550.0\ninclination_deg = 97.6\n");
    std::fs::write(folder.path().join("bench.toml"), text).unwrap();
    let pointing = "ra_deg = 84.0\ndec_deg = -1.2\n";
    let scenario = format!(
        "bench = \"bench.toml\"\nspacecraft = \"{}\"\nduration_s = 2.0\n[target]\n{pointing}[initial]\n\
         attitude = \"given\"\n{pointing}[expect]\nwindow_s = 0.5\n",
        spacecraft.display()
    );
    std::fs::write(folder.path().join("scenario.toml"), scenario).unwrap();
    let words = ["run", "scenario.toml", "--clock", "virtual", "--sink", "recorder", "--json", "--out", "loop"];
    let report: serde_json::Value = serde_json::from_str(&succeeds(&words, folder.path())).unwrap();
    let rows = read_frame_log(File::open(path_in(&folder.path().join("loop"))).unwrap()).unwrap();
    let scheduled = report["frames"]["scheduled"].as_u64().unwrap();
    // The display has 60 frames a second for 2 s; the tracker, with its exposures of 0.1 s one after another, 10.
    assert_eq!((rows.len(), scheduled), (120, 120 + 20), "the display's are recorded: {}", report["frames"]);
    assert!(report["attitudes_used"].as_u64().unwrap() > 0, "the tracker inside has attitudes: {report}");
    assert!(report["tracker_availability"].as_f64().unwrap() > 0.2, "{report}");
    let seen = Run {
        folder: folder.path().join("loop"),
        rows,
        calibration: Calibration::read(&folder.path().join("display.toml")).unwrap(),
    };
    assert!(!seen.seen(seen.rows.len() as u32 - 1).is_empty(), "and the display has stars");
}

/// Returns the unit vector of a star.
fn direction(star: &TruthStar) -> DVec3 {
    let [ra, dec] = star.apparent_deg.map(|deg| deg * DEG);
    DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin())
}

/// Returns `v_sensor = q v_icrf q*` for right ascension, declination and roll 0: boresight, image up to the north.
fn tracker_direction(ra_deg: f64, dec_deg: f64, star: DVec3) -> DVec3 {
    let (ra, dec) = (ra_deg * DEG, dec_deg * DEG);
    let z = DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
    let north = DVec3::new(-dec.sin() * ra.cos(), -dec.sin() * ra.sin(), dec.cos());
    let east = DVec3::new(-ra.sin(), ra.cos(), 0.0);
    // Image right is west, image down is south.
    DVec3::new(-star.dot(east), -star.dot(north), star.dot(z))
}

#[test]
fn stars_lie_where_the_calibration_says_and_are_as_bright() {
    let folder = bench();
    let checked = succeeds(&["check", "bench.toml"], folder.path());
    // 0.1 s are six refreshes of 60 Hz: no beat. The same tracker at 0.055 s beats, and a warning is printed.
    assert!(checked.contains("no beat"), "{checked}");
    assert!(checked.contains("stars on the display: ") && checked.contains("mag fit anywhere"), "{checked}");
    assert!(checked.contains("measured by the calibration") && checked.contains("every 167 s"), "{checked}");
    change(&folder.path().join("tracker.toml"), "exposure_s = 0.1", "exposure_s = 0.055");
    let beats = succeeds(&["check", "bench.toml"], folder.path());
    assert!(beats.contains("WARNING") && beats.contains("refreshes"), "{beats}");
    let run = Run::of(folder.path(), "run", "0.2");
    let rows = &run.rows;
    assert_eq!((rows.len(), rows[5].width_px, rows[5].height_px), (12, 640, 480), "frames of the display's size");
    let refresh_s = 1.0 / 60.0;
    let latency_s = run.calibration.latency.as_ref().unwrap().median_ns as f64 * 1e-9;
    for row in rows {
        // Started 1.5 refreshes, 8 ms and the latency before the light; the newest attitude is then 0 to 11 ms old.
        let waited_s = row.horizon_ns as f64 * 1e-9 - (2.0 * refresh_s + 0.008 + latency_s);
        assert!((0.0..0.011).contains(&waited_s), "frame {}: {waited_s}", row.frame);
        // Of the tracker, not of the drawn axes: the display is rolled by 8 degrees before it.
        let off_deg = [row.ra_deg - 84.05, row.dec_deg + 1.2, row.roll_deg].map(f64::abs);
        assert!(off_deg.iter().all(|off| *off < 2e-5), "frame {}: {off_deg:?}", row.frame);
        assert!((row.exposure_s - refresh_s).abs() < 1e-9);
    }
    let geometry = run.calibration.calibrated().unwrap().geometry;
    for star in run.stars(5) {
        let wanted = geometry.project(tracker_direction(84.05, -1.2, direction(&star))).unwrap();
        let off_px = (star.x_px - wanted[0]).hypot(star.y_px - wanted[1]);
        // The attitude on the wire is good to 0.02 arcsec, a display pixel is 103.
        assert!(off_px < 2e-3, "star {}: {off_px} display px", star.id);
    }
    let seen = run.seen(5);
    assert!(seen.len() > 3, "{} of {} stars are bright and alone", seen.len(), run.stars(5).len());
    for (star, seen) in &seen {
        assert!((seen.x_px - star.x_px).hypot(seen.y_px - star.y_px) < 0.01, "star {} is drawn at {seen:?}", star.id);
        let [shown, wanted] = run.light_e_per_s(star, seen);
        assert!((shown / wanted - 1.0).abs() < 0.01, "star {} of {} mag: {shown} e-/s for {wanted}", star.id, star.mag);
    }
    assert!(seen.iter().any(|(star, _)| (3.0..5.0).contains(&star.mag)), "a star of about 4 mag is among them");
}

#[test]
fn a_slew_is_integrated_refresh_by_refresh_and_reported_in_the_trackers_axes() {
    let folder = bench();
    let slew = "\n[flight_computer.slew]\naxis = [1.0, 0.0, 0.0]\nangle_deg = 1.0\nduration_s = 1.0\nstart_s = 0.0\n";
    change(&folder.path().join("bench.toml"), "\n[sink]", &format!("{slew}\n[sink]"));
    let run = Run::of(folder.path(), "run", "0.5");
    let geometry = run.calibration.calibrated().unwrap().geometry;
    let row = &run.rows[27];
    // 1 deg in 1 s with ramps of half a second: 2 deg/s at the middle. About the tracker's own x.
    assert!((row.rate_x_deg_s.abs() - 2.0).abs() < 0.2, "{} deg/s", row.rate_x_deg_s);
    assert!(row.rate_y_deg_s.hypot(row.rate_z_deg_s) < 1e-3, "{} {}", row.rate_y_deg_s, row.rate_z_deg_s);
    let sensor_from_icrf = DQuat::from_xyzw(row.qx, row.qy, row.qz, row.qw);
    for star in run.stars(27) {
        // Passive: v_sensor = q v_icrf q*, with the attitude in frames.csv for mid-exposure.
        let wanted = geometry.project(sensor_from_icrf * direction(&star)).unwrap();
        let off_px = (star.x_px - wanted[0]).hypot(star.y_px - wanted[1]);
        // The mean place over the exposure and the place at its middle differ by the acceleration: 12 deg/s^2 at most.
        assert!(off_px < 0.01, "star {}: {off_px} display px", star.id);
    }
    // From frame to frame a star moves by the rate times a refresh, and each is smeared along that direction by as
    // much.
    let step_px = row.rate_x_deg_s.abs() / 60.0 * 3600.0 / geometry.arcsec_per_px();
    let before = run.stars(26);
    let (mut looked_at, mut smear_px2) = (0, 0.0);
    for (star, seen) in run.seen(27) {
        assert!((seen.x_px - star.x_px).hypot(seen.y_px - star.y_px) < 0.02, "star {}: {seen:?}", star.id);
        let Some(earlier) = before.iter().find(|earlier| earlier.id == star.id) else { continue };
        let way = DVec2::new(star.x_px - earlier.x_px, star.y_px - earlier.y_px);
        // The map's scale differs over the field, the rate is still rising, and from one prediction to the next its
        // horizon changes by up to a sample's age.
        assert!((way.length() / step_px - 1.0).abs() < 0.1, "star {}: {way} px, {step_px} px a frame", star.id);
        let (along, across) = (way.normalize(), way.normalize().perp());
        smear_px2 += seen.variance_px2(along) - seen.variance_px2(across);
        looked_at += 1;
    }
    assert!(looked_at > 2, "{looked_at} stars");
    let wanted_px2 = step_px * step_px / 12.0;
    let got_px2 = smear_px2 / f64::from(looked_at);
    assert!((got_px2 / wanted_px2 - 1.0).abs() < 0.15, "smear {got_px2} px^2, {wanted_px2} of a line of {step_px} px");
}

#[test]
fn a_mirrored_display_is_drawn_for_unmirrored_and_pointing_stays_the_trackers() {
    let folder = bench();
    let path = folder.path().join("display.toml");
    let mut calibration = Calibration::read(&path).unwrap();
    calibration.geometry.mirrored = true;
    calibration.write(&path).unwrap();
    change(
        &folder.path().join("bench.toml"),
        "name = \"simulated display\"",
        "name = \"simulated display\"\nduty = 0.25",
    );
    let run = Run::of(folder.path(), "run", "0.1");
    let row = &run.rows[5];
    assert!((row.ra_deg - 84.05).abs() < 2e-5 && (row.dec_deg + 1.2).abs() < 2e-5, "{} {}", row.ra_deg, row.dec_deg);
    assert!((row.exposure_s - 0.25 / 60.0).abs() < 1e-9, "a flash of a quarter of a refresh: {}", row.exposure_s);
    let geometry = run.calibration.calibrated().unwrap().geometry;
    for star in run.stars(5) {
        let [x, y] = geometry.project(tracker_direction(84.05, -1.2, direction(&star))).unwrap();
        // The display mirrors columns when it shows them.
        let off_px = (star.x_px - (639.0 - x)).hypot(star.y_px - y);
        assert!(off_px < 2e-3, "star {}: {off_px} display px", star.id);
    }
    let seen = run.seen(5);
    assert!(!seen.is_empty());
    for (star, seen) in &seen {
        let [shown, wanted] = run.light_e_per_s(star, seen);
        assert!(
            (shown / wanted - 1.0).abs() < 0.01,
            "light does not depend on how long it is emitted: {shown} {wanted}"
        );
    }
}

/// Measurement of a star: centroid, light in steps of luminance, second moments.
#[derive(Debug, Clone, Copy)]
struct Seen {
    x_px: f64,
    y_px: f64,
    luminance: f64,
    xx_px2: f64,
    xy_px2: f64,
    yy_px2: f64,
}

impl Seen {
    /// Returns the spread of the light along a direction.
    fn variance_px2(&self, along: DVec2) -> f64 {
        along.x * along.x * self.xx_px2 + 2.0 * along.x * along.y * self.xy_px2 + along.y * along.y * self.yy_px2
    }
}

/// Measures a star that is bright, unsaturated and isolated.
fn measured(pixels: &[u16], [x_px, y_px]: [f64; 2], stars: &[TruthStar]) -> Option<Seen> {
    let near = stars.iter().filter(|star| (star.x_px - x_px).hypot(star.y_px - y_px) < 14.0).count();
    let (column, row) = (x_px.round() as i64, y_px.round() as i64);
    if near > 1 || !(6..634).contains(&column) || !(6..474).contains(&row) {
        return None;
    }
    let (mut sum, mut most, mut first, mut second) = (0.0, 0, DVec2::ZERO, [0.0; 3]);
    for y in row - 5..=row + 5 {
        for x in column - 5..=column + 5 {
            let value = pixels[(y * 640 + x) as usize];
            most = most.max(value);
            // Codes of luminance, in even steps of 1/65535 of full.
            let (value, from) = (65_535.0 * luminance(value), DVec2::new((x - column) as f64, (y - row) as f64));
            sum += value;
            first += value * from;
            second = [
                second[0] + value * from.x * from.x,
                second[1] + value * from.x * from.y,
                second[2] + value * from.y * from.y,
            ];
        }
    }
    let mean = first / sum;
    let [xx, xy, yy] = second.map(|moment| moment / sum);
    (luminance(most) > 0.03 && most < 65_535).then_some(Seen {
        x_px: column as f64 + mean.x,
        y_px: row as f64 + mean.y,
        luminance: sum,
        xx_px2: xx - mean.x * mean.x,
        xy_px2: xy - mean.x * mean.y,
        yy_px2: yy - mean.y * mean.y,
    })
}

#[test]
fn a_wrong_calibration_is_refused_before_anything_is_shown() {
    let folder = bench();
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
    refused("bench.toml", "name = \"simulated display\"", "", "sink.name");
    // A tracker of the same geometry with another aperture has other electrons per magnitude.
    refused("tracker.toml", "aperture_mm = 20.0", "aperture_mm = 20.1", "e-/s of magnitude 0");
    refused("bench.toml", "[sink]", "[[target]]\nposition_px = [9.0, 9.0]\nmag = 3.0\n\n[sink]", "[[target]]");
    refused("bench.toml", "duration_s = 10.0", "duration_s = 10.0\nahead_ms = 50.0", "timing.ahead_ms");
    let another = "[[extra_sink]]\nkind = \"display\"\ncalibration = \"display.toml\"\nname = \"a\"\n\n[sink]";
    refused("bench.toml", "[sink]", another, "extra_sink[0].calibration");
    refused("display.toml", "valid_days = 90", "valid_days = 91", "edited");
    refused("bench.toml", "display.toml", "no_such.toml", "no_such.toml");
}
