//! Tests of calibration files: reading back, and refusals.

use super::*;
use crate::display::response::GreyLevel;

const NOW: &str = "2026-03-11T00:00:00Z";

fn now() -> Tai {
    Tai::from_rfc3339(NOW).unwrap()
}

fn sample() -> Calibration {
    let level =
        |i: u32| GreyLevel { grey: f64::from(i) * 15.0, luminance: (f64::from(i) / 17.0).powf(2.2), sigma: 0.1 + 0.2 };
    Calibration {
        format: FORMAT,
        measured_utc: "2026-03-01T00:00:00.000000Z".into(),
        made_utc: "2026-03-09T00:00:00.000000Z".into(),
        valid_days: 30,
        starloop_version: "0.1.0".into(),
        plan_crc32: "00c0ffee".into(),
        display: DisplayIdentity { name: "EV 27 #114".into(), width_px: 320, height_px: 200, bits: 8 },
        tracker: TrackerIdentity {
            name: "ST".into(),
            width_px: 512,
            height_px: 512,
            geometry_crc32: "0badcafe".into(),
        },
        geometry: GeometryParameters {
            mirrored: true,
            drawn_from_sensor: [1.0, 0.0, 0.0, 0.0],
            focal_px: [1000.0 / 3.0, 333.0],
            principal_point_px: [159.5, 99.5],
            degree: 3,
            terms: vec![(3, 0, -0.01, 1e-7), (0, 1, 1.0 / 7.0, 0.0)],
            covered_px: vec![[10.0, 10.0], [300.0, 10.0], [300.0, 190.0], [10.0, 190.0]],
        },
        response: ResponseParameters { bits: 8, black_share: 0.001, level: (0..=17).map(level).collect() },
        flat: FlatParameters { degree: 1, coefficient: vec![0.9, 0.05, 0.05] },
        light: Some(Light {
            full_px_e_per_s: 1234.5,
            zero_point_e_per_s: 1e7,
            spot_sigma_px: 0.7,
            brightest_mag: 8.37,
        }),
        latency: Some(Latency::given(base::time::Span::from_ms(20), base::time::Span::from_ms(2))),
        residual: Residuals {
            dots_used: 190,
            dots_left_out: 2,
            dots_saturated: 1,
            coverage: 0.93,
            rms_px: 0.011,
            max_px: 0.03,
            rms_arcsec: 0.7,
            map_error_px: 0.005,
            response_mag: 0.001,
            flat_mag_rms: 0.002,
        },
    }
}

fn written(calibration: &Calibration) -> (tempfile::TempDir, std::path::PathBuf, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("display.toml");
    calibration.write(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    (folder, path, text)
}

#[test]
fn a_file_reads_back_bit_by_bit() {
    let (_folder, path, text) = written(&sample());
    assert_eq!(Calibration::read(&path).unwrap(), sample());
    std::fs::write(&path, text.replace("[display]", "# looked at on Monday\n\n[display]")).unwrap();
    assert_eq!(Calibration::read(&path).unwrap(), sample(), "comments may be added");
    let bare = Calibration { light: None, latency: None, ..sample() };
    let (_folder, path, _) = written(&bare);
    assert_eq!(Calibration::read(&path).unwrap(), bare);
}

#[test]
fn any_changed_number_is_damage() {
    let (_folder, path, text) = written(&sample());
    let mut tried = 0;
    for (at, _) in text.match_indices(" = ") {
        let value = at + 3;
        let Some(digit) = text[value..].find(|c: char| c.is_ascii_digit()).map(|offset| value + offset) else {
            continue;
        };
        if text[value..digit].contains('\n') {
            continue;
        }
        let other = if &text[digit..=digit] == "7" { "6" } else { "7" };
        let mut changed = text.clone();
        changed.replace_range(digit..=digit, other);
        std::fs::write(&path, &changed).unwrap();
        let error = Calibration::read(&path).unwrap_err().to_string();
        assert!(error.contains("display.toml") || error.contains("wanted"), "{error}");
        tried += 1;
    }
    assert!(tried > 30, "{tried} numbers were changed");
}

#[test]
fn files_other_than_calibrations_are_refused() {
    let (_folder, path, text) = written(&sample());
    let sum = sample().sum().unwrap();
    for (wrong, reported) in [
        (String::new(), "missing field"),
        (text[..text.len() / 2].to_owned(), "calibration"),
        (text.replace(&sum, "00000000"), "damaged or edited"),
        (text.lines().skip(1).collect::<Vec<_>>().join("\n"), "got none"),
        (text.replace("format = 2", "format = 1"), "reads format 2"),
        (text.replace("valid_days", "valid_weeks"), "valid_weeks"),
        ("\u{0}".into(), "calibration"),
    ] {
        std::fs::write(&path, &wrong).unwrap();
        let error = Calibration::read(&path).unwrap_err().to_string();
        assert!(error.contains(reported) && error.lines().count() == 1, "{error}");
    }
    assert!(Calibration::read(&path.with_file_name("none")).is_err());
}

#[test]
fn a_file_of_something_else_is_refused_with_what_to_do() {
    let good = sample();
    let admit =
        |calibration: &Calibration, now: Tai| calibration.admit(&sample().display, Some(&sample().tracker), now);
    assert!(admit(&good, now()).is_ok());
    type Change = fn(&mut Calibration);
    let changes: [(Change, &str); 7] = [
        (|c| c.display.name = "another".into(), "display: wanted EV 27 #114, got another"),
        (|c| c.display.width_px = 640, "resolution: wanted 320 x 200 px, got 640 x 200 px"),
        (|c| c.display.bits = 10, "depth of greys"),
        (|c| c.tracker.name = "ST2".into(), "tracker camera"),
        (|c| c.tracker.width_px = 1024, "detector size"),
        (|c| c.tracker.geometry_crc32 = "1".into(), "tracker geometry"),
        (|c| c.measured_utc = "yesterday".into(), "not a time"),
    ];
    for (change, reported) in changes {
        let mut other = sample();
        change(&mut other);
        let error = admit(&other, now()).unwrap_err().to_string();
        assert!(error.contains(reported), "{error}");
    }
    assert!(good.admit(&good.display, None, now()).is_ok(), "a tracker that is not asked for");
}

#[test]
fn both_edges_of_its_time() {
    let at = |text: &str| sample().admit(&sample().display, None, Tai::from_rfc3339(text).unwrap());
    assert!(at("2026-03-31T00:00:00Z").is_ok(), "thirty days");
    let stale = at("2026-03-31T00:01:00Z").unwrap_err().to_string();
    assert!(stale.contains("calibrate again") && stale.contains("0 to 30 days, got 30.0"), "{stale}");
    assert!(at("2026-02-28T00:00:00Z").is_ok(), "a clock that is a day behind");
    assert!(at("2026-02-27T23:59:00Z").is_err());
}

#[test]
fn the_age_counts_from_the_measurement() {
    let fitted_late = Calibration { made_utc: "2026-03-29T00:00:00Z".into(), ..sample() };
    let now = Tai::from_rfc3339("2026-04-01T00:00:00Z").unwrap();
    assert!(fitted_late.admit(&sample().display, None, now).is_err(), "fitted three days ago, measured 31");
    assert!((fitted_late.age_days(now).unwrap() - 31.0).abs() < 1e-9);
}

#[test]
fn a_plan_that_was_made_again_is_reported() {
    let plan = crate::display::calibration::plan::tests::sample();
    let good = Calibration { plan_crc32: plan.crc32(), ..sample() };
    assert!(good.admit_plan(&plan).is_ok());
    let reported = sample().admit_plan(&plan).unwrap_err().to_string();
    assert!(reported.contains("another plan") && reported.contains("00c0ffee"), "{reported}");
}
