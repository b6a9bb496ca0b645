//! The C driver: built once per implementation, then asked in batches over its pipes.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{fmt::Write as _, io::Write as _};

/// Compiler flags of our C sources.
const FLAGS: [&str; 7] =
    ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1", "-fsanitize=address,undefined"];

/// A driver that runs.
pub(crate) struct Program {
    path: PathBuf,
}

/// Compiles with the C compiler of the machine; says why when it does not.
pub(crate) fn compile(arguments: &[&Path], to: &Path, extra: &[&str]) {
    let include = format!("-I{}", crate::kit().join("c").display());
    let output =
        Command::new("cc").args(FLAGS).arg(include).args(arguments).arg("-o").arg(to).args(extra).output().unwrap();
    assert!(output.status.success(), "cc {arguments:?}:\n{}", String::from_utf8_lossy(&output.stderr));
}

/// Returns a folder of this test's own.
pub(crate) fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("firmware_kit").join(name);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

pub(crate) fn driver_source() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/firmware_kit/driver.c")
}

impl Program {
    /// Returns the driver with the C implementation.
    pub(crate) fn of_c_sources(name: &str) -> Self {
        let path = folder(name).join("driver");
        let library = crate::kit().join("c/starloop_protocol.c");
        compile(&[&driver_source(), &library], &path, &["-fno-sanitize-recover=undefined"]);
        Self { path }
    }

    /// Returns a driver that was linked already.
    pub(crate) fn at(path: PathBuf) -> Self {
        Self { path }
    }

    /// Returns one answer per question.
    pub(crate) fn ask(&self, questions: &[String]) -> Vec<String> {
        let mut command = Command::new(&self.path);
        // Nothing is allocated, and the search for leaks wants rights that a container may lack.
        command.env("ASAN_OPTIONS", "detect_leaks=0").stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let text = questions.join("\n") + "\n";
        let mut stdin = child.stdin.take().unwrap();
        let writer = std::thread::Builder::new()
            .name("questions".into())
            .spawn(move || stdin.write_all(text.as_bytes()).unwrap())
            .unwrap();
        let output = child.wait_with_output().unwrap();
        writer.join().unwrap();
        assert!(output.status.success(), "the driver ended with {}", output.status);
        let answers: Vec<_> = String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect();
        assert_eq!(answers.len(), questions.len(), "one answer per question");
        answers
    }
}

/// Returns bytes as the driver takes them; `-` for none.
pub(crate) fn hex(bytes: &[u8]) -> String {
    if bytes.is_empty() {
        return "-".to_owned();
    }
    bytes.iter().fold(String::new(), |mut hex, byte| {
        write!(hex, "{byte:02x}").unwrap();
        hex
    })
}
