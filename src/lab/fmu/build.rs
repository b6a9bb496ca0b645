//! Compiles the library of every unit from the sources of `fmu_library`, for the crate to carry.
//!
//! Cargo has no stable way to put one crate's shared library into another. This one has no dependencies, so that one call of
//! the compiler makes it, in a second. Where it cannot, such as without a linker for the target, the build goes on with a
//! warning, and `starloop fmu` refuses.

use std::env::{var, var_os};
use std::{fs, path::PathBuf, process::Command};

const SOURCES: &str = "../fmu_library";

fn main() {
    println!("cargo::rerun-if-changed={SOURCES}");
    let out = PathBuf::from(var_os("OUT_DIR").unwrap_or_default()).join("library.so");
    let mut rustc = Command::new(var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
    rustc.args(["--crate-name", "starloop", "--crate-type", "cdylib", "--edition", "2024", "--cap-lints", "allow"]);
    rustc.args(["-C", "opt-level=s", "-C", "strip=symbols", "--target", &var("TARGET").unwrap_or_default()]);
    if let Ok(linker) = var("RUSTC_LINKER") {
        rustc.args(["-C", &format!("linker={linker}")]);
    }
    rustc.arg("-o").arg(&out).arg(format!("{SOURCES}/lib.rs"));
    let why = match rustc.output() {
        Ok(done) if done.status.success() => return,
        Ok(done) => String::from_utf8_lossy(&done.stderr).lines().next().unwrap_or_default().to_owned(),
        Err(error) => error.to_string(),
    };
    println!("cargo::warning=`starloop fmu` will not work: the library for FMI units was not compiled: {why}");
    let _ = fs::write(&out, ""); // without it the crate fails to compile, and names the file
}
