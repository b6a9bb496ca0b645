//! The Rust crate as a static library behind the C header: built without the standard library, linked into the C driver
//! with the driver's own panic function, held to the same exams as the C sources.

use crate::c_codec::failures;
use crate::c_program::{Program, compile, driver_source, folder};
use std::{path::PathBuf, process::Command};

/// Random inputs of each kind.
const FUZZ_INPUTS: usize = 40_000;

/// Builds the library with the cargo that runs this test. It is a workspace of its own: it has a panic handler.
fn library() -> PathBuf {
    let target = folder("static_library");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args(["build", "--release", "--locked", "--offline", "--manifest-path"])
        .arg(crate::kit().join("staticlib/Cargo.toml"))
        .arg("--target-dir")
        .arg(&target)
        .env_remove("CARGO_BUILD_TARGET")
        // The test command sets it, so that libtest prints times.
        .env_remove("RUSTC_BOOTSTRAP")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    target.join("release/libstarloop_protocol.a")
}

#[test]
fn the_static_library_agrees_with_the_vectors_and_with_rust() {
    let (library, driver) = (library(), folder("static_driver").join("driver"));
    compile(&[&driver_source(), &library], &driver, &["-DSTATIC_LIBRARY"]);
    let failures = failures(&Program::at(driver), 3, FUZZ_INPUTS);
    assert!(failures.is_empty(), "{} differ:\n{}", failures.len(), failures[..failures.len().min(10)].join("\n"));
}

/// Negative control: the library has no panic function of its own, so a program without one does not link.
#[test]
#[should_panic(expected = "sl_panic")]
fn a_program_without_a_panic_function_does_not_link() {
    let library = library();
    let whole = ["-Wl,--whole-archive", library.to_str().unwrap(), "-Wl,--no-whole-archive"];
    compile(&[&driver_source()], &folder("static_driver").join("without"), &whole);
}
