//! Tests measured costs: used on the real clock, reported by `check`, never used by the virtual clock.

use std::path::Path;
use std::process::{Command, Output};

fn starloop(arguments: &[&str], folder: &Path, cache: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_starloop"));
    command.args(arguments).current_dir(folder).env("XDG_CACHE_HOME", cache).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Returns the only file of a cache.
fn cache_file(cache: &Path) -> std::path::PathBuf {
    let mut files = std::fs::read_dir(cache.join("starloop")).unwrap();
    files.next().unwrap().unwrap().path()
}

fn run_crc(folder: &Path, cache: &Path, name: &str) -> String {
    let arguments = ["run", "bench.toml", "--clock", "virtual", "--out", name, "--quiet"];
    let output = starloop(&arguments, folder, cache);
    assert!(output.status.success() && output.stderr.is_empty(), "{}", text(&output.stderr));
    let summary = std::fs::read_to_string(folder.join(name).join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert!(summary["degraded"].as_object().unwrap().values().any(|frames| frames.as_u64() > Some(0)), "costs matter");
    summary["run_crc32"].as_str().unwrap().to_owned()
}

#[test]
fn the_virtual_clock_ignores_what_was_measured_and_check_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let [measured, none] = ["measured", "none"].map(|name| folder.path().join(name));
    // The readout time is too short for all stars: costs decide the number drawn.
    std::fs::write(
        folder.path().join("camera.toml"),
        "[detector]\nwidth_px = 256\nheight_px = 256\n[optics]\nfocal_length_mm = 10\naperture_mm = 20\n\
         [radiometry]\nlimiting_mag = 12\n[exposure]\nreadout_s = 2.2e-4\n",
    )
    .unwrap();
    let bench =
        "camera = \"camera.toml\"\n[timing]\nduration_s = 0.5\ndegrade = \"always\"\n[render]\nbackend = \"cpu\"\n";
    std::fs::write(folder.path().join("bench.toml"), bench).unwrap();
    let output = starloop(&["calibrate", "--backend", "cpu", "--quick"], folder.path(), &measured);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("splat_ns"), "{}", text(&output.stdout));
    // Impossible costs: if they were used, no star would be left in the frames.
    let file = cache_file(&measured);
    let slow: Vec<String> = std::fs::read_to_string(&file)
        .unwrap()
        .lines()
        .map(|line| if line.starts_with("splat_ns") { "splat_ns = 9e9".into() } else { line.to_owned() })
        .collect();
    std::fs::write(&file, slow.join("\n")).unwrap();
    let [a, b] = [(&measured, "a"), (&none, "b")].map(|(cache, name)| run_crc(folder.path(), cache, name));
    assert_eq!(a, b, "with and without a cache");
    let check = |cache: &Path, extra: &[&str]| {
        let output = starloop(&[&["check", "bench.toml"], extra].concat(), folder.path(), cache);
        assert!(output.status.success());
        (text(&output.stdout), text(&output.stderr))
    };
    let with_cache = check(&measured, &[]).0;
    assert!(with_cache.contains("measured here on"), "{with_cache}");
    let (built_in, ignored) = (check(&none, &[]).0, check(&measured, &["--built-in-costs"]).0);
    assert!(built_in.contains("built in") && !built_in.contains("measured here"), "{built_in}");
    let plans = |text: &str| text[text.find("plan of frame").unwrap()..].to_owned();
    assert_eq!(plans(&built_in), plans(&ignored), "ignored as asked");
    assert_ne!(plans(&built_in), plans(&with_cache), "the control: check believes the cache");
}

#[test]
fn a_damaged_cache_is_one_line_and_no_more() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    std::fs::write(folder.path().join("bench.toml"), "[render]\nbackend = \"cpu\"\n").unwrap();
    let output = starloop(&["calibrate", "costs", "--backend", "cpu", "--quick"], folder.path(), &cache);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let file = cache_file(&cache);
    std::fs::write(&file, "measured_utc = 7\n").unwrap();
    let output = starloop(&["check", "bench.toml"], folder.path(), &cache);
    let reported = text(&output.stderr);
    assert!(output.status.success() && reported.lines().count() == 1 && reported.contains("damaged"), "{reported}");
    assert!(text(&output.stdout).contains("built in"), "and the built-in costs are used");
}
