//! Shipped files load; every rule has a failing example; what is wrong is said with file, line, key and advice.

use super::*;
use ::link::WireFormat;
use plan::{attitude::StalePolicy, exposure::Degradation};
use proptest::prelude::*;
use std::path::Path;

mod effects;
mod rules;

/// The least a camera needs.
const MINIMAL_CAMERA: &str = "[detector]\nwidth_px = 640\nheight_px = 480\n[optics]\nfocal_length_mm = 25\n";

fn camera(text: &str) -> Result<Camera, ConfigError> {
    Camera::from_document(&Document::from_text(text, Path::new("lab/cam.toml")))
}

fn bench(text: &str) -> Result<Bench, ConfigError> {
    Bench::from_document(&Document::from_text(text, Path::new("lab/bench.toml")))
}

/// Returns the minimal camera with a section added.
fn camera_with(section: &str, line: &str) -> Result<Camera, ConfigError> {
    let header = format!("[{section}]\n");
    let text = if MINIMAL_CAMERA.contains(&header) {
        MINIMAL_CAMERA.replace(&header, &format!("{header}{line}\n"))
    } else {
        format!("{MINIMAL_CAMERA}{header}{line}\n")
    };
    camera(&text)
}

/// Asserts a refusal that names the file, the key, and each of `parts`.
fn assert_refused<T: std::fmt::Debug>(outcome: Result<T, ConfigError>, key: &str, parts: &[&str]) {
    let error = outcome.expect_err(key).to_string();
    assert!(error.contains("lab/"), "names the file: {error}");
    assert!(error.contains(key), "names {key}: {error}");
    for part in parts {
        assert!(error.contains(part), "says \"{part}\": {error}");
    }
}

#[test]
fn every_built_in_configuration_loads() {
    for path in Document::built_in_paths() {
        let document = Document::built_in(path).expect("in the list");
        match path.split('/').next() {
            Some("cameras") => drop(Camera::from_document(&document).expect(path)),
            Some("benches") => drop(Bench::from_document(&document).expect(path)),
            Some("scenarios") => drop(Scenario::from_document(&document).expect(path)),
            Some("spacecraft") => drop(Spacecraft::from_document(&document).expect(path)),
            // Link files load with a bench; each is named by one.
            other => assert_eq!(other, Some("links"), "{path}"),
        }
    }
}

#[test]
fn every_shipped_file_is_built_in_and_loads_from_disk() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let mut seen = 0;
    for folder in ["benches", "cameras", "links", "scenarios", "spacecraft"] {
        for entry in std::fs::read_dir(root.join(folder)).expect("a folder of configs") {
            let path = entry.expect("an entry").path();
            let name = format!("{folder}/{}", path.file_name().expect("a file").to_string_lossy());
            assert!(Document::built_in_paths().any(|known| known == name), "{name} is not compiled in");
            match folder {
                "benches" => drop(Bench::load(&path).expect(&name)),
                "cameras" => drop(Camera::load(&path).expect(&name)),
                "scenarios" => drop(Scenario::load(&path).expect(&name)),
                "spacecraft" => drop(Spacecraft::load(&path).expect(&name)),
                _ => {
                    let is_simulated = std::fs::read_to_string(&path).expect(&name).contains("kind = \"simulated\"");
                    let computer = if is_simulated { "simulated" } else { "external" };
                    let path = path.display().to_string();
                    let text = format!("link = {path:?}\n[flight_computer]\nkind = \"{computer}\"");
                    drop(bench(&text).expect(&name));
                }
            }
            seen += 1;
        }
    }
    assert_eq!(seen, Document::built_in_paths().count());
}

#[test]
fn the_built_in_bench_is_the_loopback() {
    let bench = Bench::built_in().expect("the built-in bench");
    assert_eq!((bench.name.as_str(), bench.camera.name.as_str()), ("loopback", "20 degree star tracker"));
    assert_eq!((bench.timing.frames(), bench.link.wire), (100, WireFormat::CanFd));
    assert_eq!(bench.flight_computer.jitter_lines.len(), 3);
    let wheel = bench.flight_computer.known_lines().nth(2).unwrap();
    assert_eq!((wheel.frequency_hz, wheel.amplitude_rad.x), (53.0, 6.0 * base::units::ARCSEC));
    let slew = bench.flight_computer.slew.expect("a slew");
    assert_eq!((slew.axis, slew.angle_deg), ([0.0, -1.0, 0.0], 2.0));
}

#[test]
fn shipped_cameras_have_the_scale_they_claim_and_do_not_clip() {
    let load = |name: &str| Camera::from_document(&Document::built_in(name).expect("built in")).expect(name);
    let tracker = load("cameras/star_tracker_20deg.toml");
    assert!((tracker.fov_deg()[0] - 20.0).abs() < 0.01, "{:?} deg", tracker.fov_deg());
    let telescope = load("cameras/wide_field_telescope.toml");
    assert!((telescope.ifov_arcsec() - 1.0).abs() < 1e-3, "{} arcsec", telescope.ifov_arcsec());
    for camera in [tracker, telescope, load("cameras/cubesat_tracker.toml")] {
        assert_eq!(camera.detector.params.converter_clips_at_e(), None, "{}", camera.name);
        assert!(camera.zero_point_e_per_s() > 1e6, "{}: {}", camera.name, camera.zero_point_e_per_s());
    }
}

#[test]
fn a_minimal_camera_is_completed_and_says_so() {
    let camera = camera(MINIMAL_CAMERA).expect("enough");
    assert_eq!(camera.name, "cam");
    assert_eq!(camera.optics.principal_point_px, [319.5, 239.5]);
    assert_eq!(camera.psf, Psf::Gaussian { sigma_px: 0.7 });
    assert_eq!(camera.detector.params.converter_clips_at_e(), None, "the default gain fits");
    for key in ["name", "detector.gain_e_per_dn", "optics.aperture_mm", "psf.sigma_px", "exposure.exposure_s"] {
        assert!(camera.defaulted.iter().any(|d| d.key == key), "{key} in {:?}", camera.defaulted);
    }
    assert!(camera.defaulted.iter().all(|d| d.key != "optics.focal_length_mm"), "what is given is not defaulted");
}

#[test]
fn a_camera_that_clips_says_where() {
    let camera = camera_with("detector", "gain_e_per_dn = 1.0").expect("allowed, and reported");
    assert_eq!(camera.detector.params.converter_clips_at_e(), Some(4095.0 - 64.0));
}

#[test]
fn airy_takes_its_defaults_from_the_optics() {
    let text = format!("{MINIMAL_CAMERA}aperture_mm = 10\nobscuration = 0.3\n[psf]\nmodel = \"airy\"\n");
    let wanted = Psf::Airy { f_number: 2.5, wavelength_nm: 620.0, obscuration: 0.3 };
    assert_eq!(camera(&text).expect("enough").psf, wanted);
}

#[test]
fn an_unknown_key_has_file_line_and_the_nearest_known_one() {
    let text = MINIMAL_CAMERA.replace("focal_length_mm", "focal_lenght_mm");
    let wanted = ["lab/cam.toml:5", "did you mean `focal_length_mm`?", "aperture_mm"];
    assert_refused(camera(&text), "unknown key `focal_lenght_mm`", &wanted);
    let no_unit = MINIMAL_CAMERA.replace("focal_length_mm", "focal");
    assert_refused(camera(&no_unit), "`focal`", &["did you mean `focal_length_mm`?"]);
    assert_refused(bench("seed = 1\n[link]\nbitrate = 5"), "`bitrate`", &["bench.toml:3", "`bit_rate`?"]);
    assert_refused(bench("[timing]\nframe_rate_Hz = 5"), "`frame_rate_Hz`", &["bench.toml:2", "`frame_rate_hz`?"]);
    assert_refused(bench("[timings]\nframe_rate_hz = 5"), "unknown key `timings`", &["bench.toml:1", "`timing`?"]);
    assert_refused(camera_with("distortion", "K1 = -0.05"), "unknown key `K1`", &["cam.toml:7", "`k1`?"]);
    let jitter = "[[flight_computer.jitter_line]]\nfrequency = 3";
    assert_refused(bench(jitter), "`frequency`", &["bench.toml:2", "`frequency_hz`?"]);
    let far = camera_with("psf", "zzz = 1").expect_err("unknown").to_string();
    assert!(!far.contains("did you mean") && far.contains("sigma_px"), "nothing is near, all are listed: {far}");
}

#[test]
fn wrong_types_and_broken_toml_show_the_line() {
    let quoted = MINIMAL_CAMERA.replace("= 25", "= \"25\"");
    assert_refused(camera(&quoted), "focal_length_mm", &["cam.toml:5", "is \"25\"; wanted a number"]);
    assert_refused(camera("[detector\nwidth_px = 3"), "[detector", &["cam.toml:1"]);
    assert_refused(bench("[mounting]\nsensor_from_body = [1, 0, 0]"), "sensor_from_body", &["bench.toml:2", "4"]);
    assert_refused(bench("timing = 3"), "timing", &["bench.toml:1", "wanted a table"]);
    assert_refused(bench("link = 7"), "link", &["[link] table or the path"]);
    assert_refused(bench("camera = 7"), "camera", &["bench.toml:1", "wanted", "7"]);
    assert_refused(bench("seed = 1.5"), "seed", &["bench.toml:1", "wanted a whole number", "1.5"]);
}

#[test]
fn shot_noise_is_drawn_as_the_camera_file_says() {
    use image::detector::PoissonMethod;
    let of = |line: &str| camera_with("detector", line).expect("a camera").detector.params.poisson;
    assert_eq!(of(""), PoissonMethod::Auto, "the default");
    for method in PoissonMethod::ALL {
        assert_eq!(of(&format!("poisson = \"{method}\"")), method);
    }
}

#[test]
fn each_rule_of_sinks_has_a_failing_example() {
    for (text, key, parts) in [
        ("[sink]\nkind = \"null\"\nfits = true", "sink.fits", ["unknown key", "kind = \"null\""]),
        ("[sink]\nfit = true", "sink.fit", ["did you mean `fits`", "png_every"]),
        ("[sink]\nfits = 3", "sink.fits is 3", ["bench.toml:2", "true or false"]),
        ("[sink]\nqueue = 0", "sink.queue", ["whole number from 1", "memory"]),
        ("[sink]\nqueue = \"two\"", "sink.queue", ["bench.toml:2", "whole number"]),
        ("[sink]\nkind = \"recordr\"", "sink.kind is \"recordr\"", ["did you mean \"recorder\"", "null"]),
        ("[[extra_sink]]\nfits = true", "extra_sink[0].kind", ["missing", "in addition to [sink]"]),
        (
            "[sink]\ndirectory = \"a/b\"\n[[extra_sink]]\nkind = \"recorder\"\ndirectory = \"./a//b\"",
            "extra_sink[0].directory",
            ["which sink has", "no other sink"],
        ),
        (
            "[[extra_sink]]\nkind = \"shared_memory\"\n[[extra_sink]]\nkind = \"shared_memory\"",
            "extra_sink[1].path",
            ["which extra_sink[0] has", "no other sink"],
        ),
        (
            "[[extra_sink]]\nkind = \"null\"\n[[extra_sink]]\nkind = \"null\"\nfits = true",
            "extra_sink[1].fits",
            ["bench.toml:5", "unknown key"],
        ),
        ("[sink]\nkind = \"shared_memory\"\npath = \"\"", "sink.path", ["empty", "/dev/shm"]),
        ("[sink]\nkind = \"shared_memory\"\nslots = 65", "sink.slots", ["from 2 to 64", "memory"]),
        (
            "[sink]\nkind = \"iceoryx2\"\nslots = 1",
            if cfg!(feature = "iceoryx2") { "sink.slots" } else { "sink.kind" },
            if cfg!(feature = "iceoryx2") {
                ["from 2 to 64", "memory"]
            } else {
                ["was built with", "--features iceoryx2"]
            },
        ),
        (
            "[sink]\nkind = \"display\"\nbits = 9",
            if cfg!(feature = "display") { "sink.bits" } else { "sink.kind" },
            if cfg!(feature = "display") { ["8 or 10", "monitor"] } else { ["was built with", "--features display"] },
        ),
        ("[sink]\ndirectory = \" \"", "sink.directory", ["empty", "working directory"]),
        ("[sink]\npng_every = -1", "sink.png_every", ["whole number", "PNG"]),
    ] {
        assert_refused(bench(text), key, &parts);
    }
}

#[test]
fn jitter_lines_are_checked_one_by_one() {
    let good = "[[flight_computer.jitter_line]]\nfrequency_hz = 50\namplitude_arcsec = [1, 0, 0]\n";
    let bad = "[[flight_computer.jitter_line]]\nfrequency_hz = 50\namplitude_arcsec = [1, nan, 0]\n";
    let wanted = ["bench.toml:6", "arcseconds"];
    assert_refused(bench(&format!("{good}{bad}")), "flight_computer.jitter_line[1].amplitude_arcsec", &wanted);
    let bare = "[[flight_computer.jitter_line]]\nfrequency_hz = 50\n";
    assert_refused(bench(bare), "flight_computer.jitter_line[0].amplitude_arcsec", &["missing"]);
    let sampled = format!("[flight_computer]\njitter_source = \"samples\"\njitter_sample_hz = 80\n{good}");
    assert_refused(
        bench(&sampled),
        "flight_computer.jitter_sample_hz",
        &["twice the highest jitter line (50 Hz)", "raise it", "bench.toml:3"],
    );
    assert!(bench(&sampled.replace("= 80", "= 101")).is_ok(), "enough samples");
}

#[test]
fn element_sets_are_checked_by_their_checksums() {
    let lines = [
        "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
        "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
    ];
    let text = |a: &str, b: &str| format!("[observer]\nkind = \"tle\"\nline1 = \"{a}\"\nline2 = \"{b}\"\n");
    let observer = bench(&text(lines[0], lines[1])).expect("a valid set").observer;
    assert_eq!(observer, Observer::Tle { line1: lines[0].into(), line2: lines[1].into(), max_age_days: 30.0 });
    let typo = lines[1].replace("51.6416", "51.6417");
    let unchanged = "copy both lines of the element set unchanged";
    assert_refused(bench(&text(lines[0], &typo)), "observer.line2", &["checksum", unchanged, "bench.toml:4"]);
    let cut = &lines[0][..45];
    assert_refused(bench(&text(cut, lines[1])), "observer.line1", &["69 characters", unchanged, "bench.toml:3"]);
    let other = lines[1].replace("25544", "25553");
    assert_refused(bench(&text(lines[0], &other)), "observer.line2", &["the catalogue number of line1"]);
}

#[test]
fn a_bench_of_nothing_runs_on_the_built_in_camera() {
    let bench = bench("").expect("all has a default");
    assert_eq!(bench.camera.name, "20 degree star tracker");
    assert_eq!(bench.attitude.estimate.policy, StalePolicy::Hold, "simulated runs go on");
    assert!(bench.attitude.history.capacity >= 210, "1 s of age, 1 s of margin, 0.1 s of exposure at 100 Hz");
    assert!(bench.defaulted.iter().any(|d| d.key == "camera" && d.value.contains("built-in")), "and it is listed");
}

/// With hardware a frame is right or missing, never a frozen sky or one without motion, unless a key says otherwise.
#[test]
fn frames_with_hardware_are_right_or_missing_unless_a_key_says_otherwise() {
    let usual = bench("").expect("all has a default");
    assert_eq!(usual.attitude.policy_on_real_clock, StalePolicy::Drop);
    assert_eq!((usual.timing.deadline_policy, usual.timing.degrade_to), (DeadlinePolicy::Drop, Degradation::Budget10));
    let text =
        "[timing]\ndeadline_policy = \"hold\"\ndegrade_to = \"motion-out\"\n[attitude]\nstale_policy = \"hold\"\n";
    let asked = bench(text).expect("legal");
    assert_eq!(
        (asked.attitude.policy_on_real_clock, asked.attitude.estimate.policy),
        (StalePolicy::Hold, StalePolicy::Hold)
    );
    assert_eq!((asked.timing.deadline_policy, asked.timing.degrade_to), (DeadlinePolicy::Hold, Degradation::MotionOut));
    for path in Document::built_in_paths().filter(|path| path.starts_with("benches/")) {
        let bench = Document::built_in(path).and_then(|document| Bench::from_document(&document)).expect("legal");
        assert_ne!(bench.attitude.policy_on_real_clock, StalePolicy::Hold, "{path}");
        assert_ne!(bench.timing.deadline_policy, DeadlinePolicy::Hold, "{path}");
        assert!(bench.timing.degrade_to <= Degradation::Budget10, "{path}");
    }
}

#[test]
fn paths_are_relative_to_the_file_that_names_them() {
    let root = tempfile::tempdir().expect("a temporary directory");
    let write = |name: &str, text: &str| {
        let path = root.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a parent")).expect("a directory");
        std::fs::write(&path, text).expect("a file");
        path
    };
    write("cams/one.toml", MINIMAL_CAMERA);
    write("links/slow.toml", "latency_us = 7.0\n");
    let path = write("benches/b.toml", "camera = \"../cams/one.toml\"\nlink = \"../links/slow.toml\"\n");
    let bench = Bench::load(&path).expect("both are found");
    assert_eq!((bench.camera.name.as_str(), bench.link.latency_us), ("one", 7.0));
    assert!(bench.defaulted.iter().any(|d| d.key == "link.wire"), "the link's defaults are listed");
    let lost = write("benches/c.toml", "camera = \"two.toml\"\n");
    let error = Bench::load(&lost).expect_err("no such camera").to_string();
    assert!(error.contains("two.toml") && error.contains("c.toml") && error.contains("camera"), "{error}");
    write("links/slow.toml", "latency = 7.0\n");
    let error = Bench::load(&path).expect_err("unknown key in the link").to_string();
    assert!(error.contains("slow.toml:1") && error.contains("`latency_us`?"), "{error}");
}

#[test]
fn a_missing_file_is_named() {
    let error = Bench::load(Path::new("nowhere/b.toml")).expect_err("no file").to_string();
    assert!(error.starts_with("nowhere/b.toml: cannot be read"), "{error}");
    let error = Document::built_in("benches/x.toml").expect_err("no such").to_string();
    assert!(error.contains("benches/loopback.toml"), "lists those there are: {error}");
}

/// Returns the text that is nearly a configuration: keys of the schema with values of many kinds.
fn nearly_toml() -> impl Strategy<Value = String> {
    let sections = prop::sample::select(vec![
        "detector",
        "optics",
        "psf",
        "timing",
        "link",
        "mounting",
        "observer",
        "flight_computer",
        "attitude",
        "sink",
        "flight_computer.slew",
        "exposure",
    ]);
    let keys = prop::sample::select(vec![
        "width_px",
        "focal_length_mm",
        "bits",
        "model",
        "frame_rate_hz",
        "start_utc",
        "kind",
        "wire",
        "line1",
        "axis",
        "sensor_from_body",
        "attitude_hz",
        "stale_after_ms",
        "directory",
        "exposure_s",
        "black_level_dn",
    ]);
    let values = prop_oneof![
        any::<f64>().prop_map(|v| format!("{v:?}").to_lowercase()),
        any::<i64>().prop_map(|v| v.to_string()),
        "[a-zé \\-:0-9]{0,12}".prop_map(|v| format!("\"{v}\"")),
        Just("[1.0, nan, 0.0, inf]".to_owned()),
        Just("{ a = 1 }".to_owned()),
    ];
    proptest::collection::vec((sections, keys, values), 0..6)
        .prop_map(|lines| lines.iter().map(|(s, k, v)| format!("[{s}]\n{k} = {v}\n")).collect())
}

proptest! {
    #[test]
    fn random_text_never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        let text = String::from_utf8_lossy(&bytes);
        let _either = (camera(&text).is_ok(), bench(&text).is_ok());
    }

    #[test]
    fn nearly_right_text_never_panics_and_never_yields_nonsense(text in nearly_toml()) {
        if let Ok(camera) = camera(&format!("{MINIMAL_CAMERA}{text}")) {
            prop_assert!(camera.optics.focal_length_mm > 0.0 && camera.exposure.exposure_s > 0.0);
        }
        match bench(&text) {
            Ok(bench) => prop_assert!(bench.timing.frame_rate_hz > 0.0),
            Err(error) => prop_assert!(error.to_string().contains("lab/bench.toml"), "{}", error),
        }
    }

    #[test]
    fn any_number_for_the_focal_length_is_checked(value in prop_oneof![any::<f64>(), -1.0..2e6]) {
        let text = MINIMAL_CAMERA.replace("= 25", &format!("= {value:?}").to_lowercase());
        let is_allowed = (0.1..=1e6).contains(&value) && value / 2.0 <= 1e5;
        // The corner of this detector is then more than 85 deg off the axis: another rule.
        let is_too_wide = (0.1..0.25).contains(&value);
        prop_assert_eq!(camera(&text).is_ok_and(|c| c.optics.focal_length_mm == value) || is_too_wide, is_allowed);
    }
}

#[test]
fn a_date_error_of_the_trackers_is_read_and_held_to_its_range() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/scenarios");
    let text = std::fs::read_to_string(folder.join("study.toml")).expect("shipped");
    let with = |line: &str| {
        let text = text.replace("delay_ms = 50.0", &format!("delay_ms = 50.0\n{line}"));
        Scenario::from_document(&Document::from_text(&text, &folder.join("lab.toml")))
    };
    let tag_error = |line: &str| with(line).expect("sound").vehicle().expect("flown").tag_error;
    assert_eq!(tag_error(""), base::time::Span::ZERO);
    assert_eq!(tag_error("tag_error_ms = -20.0"), base::time::Span::from_ms(-20));
    let refused = with("tag_error_ms = 1001.0").expect_err("refused").to_string();
    assert!(refused.contains("tracker.tag_error_ms"), "{refused}");
}

/// Reads a shipped scenario after some of its text was replaced, with settings.
fn scenario(name: &str, replaced: [&str; 2], settings: &[&str]) -> Result<Scenario, ConfigError> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/scenarios");
    let text = std::fs::read_to_string(folder.join(name)).expect("shipped");
    let document = Document::from_text(&text.replace(replaced[0], replaced[1]), &folder.join("../scenarios/lab.toml"));
    let settings = settings.iter().map(|text| Setting::parse(text).expect("sound")).collect();
    Scenario::from_document(&document.with_settings(settings))
}

#[test]
fn a_random_attitude_refuses_the_angles_of_a_given_one() {
    for name in ["ra_deg", "dec_deg", "roll_deg"] {
        let with = format!("attitude = \"random\"\n{name} = 1.0 #");
        let error = scenario("acquisition.toml", ["attitude = \"random\"", &with], &[]).expect_err(name).to_string();
        assert!(error.contains(&format!("initial.{name} is given")) && error.contains("lab.toml:12"), "{error}");
        assert!(error.contains("it belongs to attitude = \"given\""), "{error}");
    }
}

#[test]
fn the_judged_window_is_held_to_the_duration_of_this_run() {
    let sound = ["", ""];
    let error = scenario("stray_light.toml", sound, &["duration_s=50.0"]).expect_err("60 s of 50 s").to_string();
    for part in ["lab.toml:37", "expect.window_s is 60", "up to 50", "the run lasts 50 s"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let free = scenario("stray_light.toml", ["window_s = 60.0", ""], &["duration_s=50.0"]).expect("a default");
    assert_eq!(free.expect.window_s, 12.5, "follows the run");
}

#[test]
fn an_event_after_the_end_is_refused_unless_a_setting_cut_the_run_short() {
    let whole = scenario("stray_light.toml", ["", ""], &[]).expect("shipped");
    assert_eq!((whole.events.len(), whole.events_left_out), (3, 0));
    let error = scenario("stray_light.toml", ["at_s = 200.0", "at_s = 420.0"], &[]).expect_err("never").to_string();
    for part in ["lab.toml:31", "event[2].at_s is 420", "before the run ends, at 420 s", "never come"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let short = ["duration_s=170.0", "expect.window_s=60.0"];
    let cut = scenario("stray_light.toml", ["", ""], &short).expect("cut short");
    assert_eq!((cut.events.len(), cut.events_left_out), (1, 2));
    let moved = [&short[..], &["event[2].at_s=500.0"]].concat();
    let error = scenario("stray_light.toml", ["", ""], &moved).expect_err("not of the file's run").to_string();
    assert!(error.contains("--set event[2].at_s=500.0") && error.contains("at 170 s"), "{error}");
    // The bench's duration, 600 s, counts where the scenario has none.
    let of_bench = ["duration_s = 420.0", ""];
    assert_eq!(scenario("stray_light.toml", of_bench, &[]).expect("600 s").events_left_out, 0);
    let short = ["bench.timing.duration_s=180.0"];
    assert_eq!(scenario("stray_light.toml", of_bench, &short).expect("cut short").events_left_out, 1);
}

#[test]
fn files_without_an_end_are_refused() {
    let orbit = "[[target]]\norbit = \"tle\"\nmag = 1.0\nfile = \"/dev/zero\"\n";
    for text in [
        "camera = \"/dev/zero\"\n",
        "link = \"/dev/zero\"\n",
        "spacecraft = \"/dev/zero\"\n[observer]\nkind = \"circular_orbit\"\n",
        "[jitter]\nseries = \"/dev/zero\"\n",
        "[jitter]\ndensity = \"/dev/zero\"\n",
        "[observer]\nkind = \"file\"\nfile = \"/dev/zero\"\n",
        "[plant]\nkind = \"file\"\nattitude = \"/dev/zero\"\n",
        orbit,
    ] {
        let error = bench(text).expect_err(text).to_string();
        assert!(error.contains("it is a device; wanted a file"), "{text}: {error}");
    }
    for (section, line) in
        [("band", "qe_file = \"/dev/zero\""), ("psf", "model = \"measured\"\nfile = \"/dev/zero\"\nsamples_per_px = 4")]
    {
        let error = camera_with(section, line).expect_err(section).to_string();
        assert!(error.contains("it is a device; wanted a file"), "{section}: {error}");
    }
    let error = Document::open(Path::new("/dev/zero")).expect_err("a device").to_string();
    assert!(error.contains("/dev/zero: cannot be read (it is a device; wanted a file)"), "{error}");
}
