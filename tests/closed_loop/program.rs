//! Tests the program as a user or a script runs it.

use std::path::Path;
use std::process::{Command, Output, Stdio};

fn starloop(arguments: &[&str], folder: &Path) -> Output {
    command(arguments, folder).output().unwrap()
}

fn command(arguments: &[&str], folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_starloop"));
    command.args(arguments).current_dir(folder);
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Returns the value of a top-level key of `summary.json`.
fn summary(folder: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join("summary.json")).unwrap()).unwrap()
}

#[test]
fn virtual_runs_have_the_same_hash_and_files() {
    let folder = tempfile::tempdir().unwrap();
    for (name, threads) in [("a", "1"), ("b", "2")] {
        let arguments = ["run", "--clock", "virtual", "--duration", "1", "--out", name, "--quiet"];
        let output = command(&arguments, folder.path()).env("RAYON_NUM_THREADS", threads).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
    let [a, b] = ["a", "b"].map(|name| summary(&folder.path().join(name)));
    assert_eq!(a["run_crc32"], b["run_crc32"], "whatever the number of threads");
    assert_eq!(a["frames"]["delivered"], 10);
    let bytes = |name: &str| std::fs::read(folder.path().join(name).join("frame_000003.fits")).unwrap();
    assert_eq!(bytes("a"), bytes("b"), "files too");
}

#[test]
fn the_bench_clock_accounts_for_every_slot() {
    let folder = tempfile::tempdir().unwrap();
    let output = starloop(&["run", "--duration", "1", "--out", "run", "--details"], folder.path());
    let verdict = text(&output.stdout).lines().next().unwrap_or_default().to_owned();
    let word = match output.status.code() {
        Some(0) => "ok: 10 of 10 ",
        Some(6) => "INCOMPLETE: ",
        status => panic!("{status:?}: {}", text(&output.stderr)),
    };
    assert!(verdict.starts_with(word), "{verdict}");
    assert!(verdict.contains(" of 10 frames on time, 0 lost; ") && verdict.ends_with("; run"), "{verdict}");
    assert!(text(&output.stdout).contains("release_to_delivered"), "{}", text(&output.stdout));
    let frames = &summary(&folder.path().join("run"))["frames"];
    let count = |key: &str| frames[key].as_u64().unwrap();
    assert_eq!(count("scheduled"), 10);
    // A loaded machine may miss slots; it must not miscount them.
    assert_eq!(count("delivered") + count("dropped"), 10, "{frames}");
}

#[test]
fn summary_that_cannot_be_written_is_a_loss_with_its_own_exit_status() {
    let folder = tempfile::tempdir().unwrap();
    let run = |out: &str| {
        starloop(&["run", "--clock", "virtual", "--duration", "0.3", "--out", out, "--quiet"], folder.path())
    };
    // A directory occupies the name of the file.
    std::fs::create_dir_all(folder.path().join("lost/summary.json")).unwrap();
    let lost = run("lost");
    let stderr = text(&lost.stderr);
    assert_eq!(lost.status.code(), Some(5), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(stderr.contains("lost: summary.json: not written"), "{stderr}");
    let kept = run("kept");
    assert_eq!((kept.status.code(), text(&kept.stderr).as_str()), (Some(0), ""), "control: nothing in the way");
    assert_eq!(summary(&folder.path().join("kept"))["losses"], serde_json::json!([]));
}

#[test]
fn ctrl_c_ends_cleanly_with_everything_written() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = command(&["run", "--duration", "60", "--out", "run"], folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let first_frame = folder.path().join("run/frame_000002.fits");
    for _ in 0..600 {
        if first_frame.exists() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let status = child.wait().unwrap();
    assert_eq!(status.code(), Some(130));
    let summary = summary(&folder.path().join("run"));
    let delivered = summary["frames"]["delivered"].as_u64().unwrap();
    assert!(delivered >= 2, "{delivered}");
    for number in 0..delivered {
        assert!(folder.path().join(format!("run/frame_{number:06}.fits")).exists(), "frame {number} is whole");
    }
}

#[test]
fn without_a_vulkan_driver_the_cpu_draws_and_one_line_says_so() {
    for (clock, notes) in [("virtual", 0), ("real", 1)] {
        let folder = tempfile::tempdir().unwrap();
        let output = command(&["run", "--clock", clock, "--duration", "0.2", "--out", "run"], folder.path())
            .env("VK_DRIVER_FILES", "/nonexistent")
            .env("VK_ICD_FILENAMES", "/nonexistent")
            .output()
            .unwrap();
        let stderr = text(&output.stderr);
        assert!(output.status.success(), "{stderr}");
        let lines = |part: &str| stderr.lines().filter(|line| line.contains(part)).count();
        assert_eq!(lines("cpu backend"), 1, "the bench's line has its backend: {stderr}");
        assert_eq!(lines("using the CPU backend"), notes, "the reason, where time counts: {stderr}");
    }
}

#[test]
fn machine_without_a_display_session_is_not_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let output = command(&["check"], folder.path()).env_remove("XDG_RUNTIME_DIR").output().unwrap();
    let stderr = text(&output.stderr);
    assert!(output.status.success() && stderr.is_empty(), "{stderr}");
}

#[test]
fn errors_state_what_where_wanted_got() {
    let folder = tempfile::tempdir().unwrap();
    let camera = folder.path().join("camera.toml");
    let write = |focal: &str| {
        let text = format!("[detector]\nwidth_px = 64\nheight_px = 64\n[optics]\nfocal_length_mm = {focal}\n");
        std::fs::write(&camera, text).unwrap();
    };
    let camera_name = camera.to_str().unwrap();
    let render = |extra: &[&str]| {
        let mut arguments = vec!["render", "--camera", camera_name, "--out", "frame.fits"];
        arguments.extend_from_slice(extra);
        let output = starloop(&arguments, folder.path());
        (output.status.code(), text(&output.stderr))
    };
    write("0");
    let (code, error) = render(&["--ra", "10", "--dec", "-20"]);
    assert_eq!(code, Some(1));
    for part in ["camera.toml", "focal_length_mm", "0"] {
        assert!(error.contains(part), "no \"{part}\" in: {error}");
    }
    write("50");
    std::fs::write(folder.path().join("far.csv"), "t_s,dx_px,dy_px,roll_arcsec\n0,0,0,0\n0.05,20000,0,0\n").unwrap();
    std::fs::write(folder.path().join("farther.csv"), "t_s,dx_px,dy_px,roll_arcsec\n0,0,0,0\n0.05,1e12,0,0\n").unwrap();
    std::fs::write(folder.path().join("bright.csv"), "x_px,y_px,electrons\n1,2,1e39\n").unwrap();
    let cases: [(&[&str], Option<i32>, &str); 11] = [
        (&["--attitude", "1,0,0,NaN"], Some(2), "4 finite numbers"),
        (&["--attitude", "2,0,0,0"], Some(2), "norm 2"),
        (&["--ra", "10", "--dec", "91"], Some(2), "-90 to 90"),
        (&["--ra", "10", "--dec", "0", "--sources", "none.csv"], Some(1), "none.csv"),
        (&["--ra", "10", "--dec", "0", "--time", "noon"], Some(2), "RFC 3339"),
        (&["--ra", "10", "--dec", "0", "--method", "magic"], Some(2), "magic"),
        (&["--ra", "1", "--dec", "0", "--los", "far.csv", "--method", "effective-psf"], Some(1), "use samples or auto"),
        (&["--ra", "1", "--dec", "0", "--los", "farther.csv"], Some(1), "row 2"),
        (&["--sources", "bright.csv"], Some(1), "wanted 0 to 1e12"),
        (&["--ra", "1", "--dec", "0", "--rate", "1e9,0,0"], Some(2), "wanted at most 1000"),
        (&[], Some(2), "wanted --ra"),
    ];
    for (arguments, wanted, part) in cases {
        let (code, error) = render(arguments);
        assert_eq!(code, wanted, "{arguments:?}: {error}");
        assert!(error.contains(part), "no \"{part}\" in: {error}");
    }
    assert!(!folder.path().join("frame.fits").exists(), "nothing half-written");
    let (code, error) = render(&["--ra", "10", "--dec", "-20", "--roll", "5"]);
    assert_eq!(code, Some(0), "and a right one works: {error}");
}

#[test]
fn a_full_disk_is_a_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let camera = folder.path().join("camera.toml");
    std::fs::write(&camera, "[detector]\nwidth_px = 64\nheight_px = 64\n[optics]\nfocal_length_mm = 50\n").unwrap();
    std::os::unix::fs::symlink("/dev/full", folder.path().join("full.fits")).unwrap();
    let camera = camera.to_str().unwrap();
    let output =
        starloop(&["render", "--camera", camera, "--ra", "1", "--dec", "2", "--out", "full.fits"], folder.path());
    assert_eq!(output.status.code(), Some(1));
    let error = text(&output.stderr);
    assert!(error.contains("full.fits") && error.to_lowercase().contains("space"), "{error}");
}
