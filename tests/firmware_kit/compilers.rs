//! The C kit under every compiler that CI has: no warnings, and nothing but single precision on a Cortex-M4F.

use crate::c_program::{compile, folder};
use std::path::{Path, PathBuf};
use std::process::Command;

const WARNINGS: [&str; 6] = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion", "-Werror"];
/// Standards, each with the language that selects it.
const STANDARDS: [(&str, &str); 6] =
    [("c", "c99"), ("c", "c11"), ("c", "c17"), ("c++", "c++11"), ("c++", "c++17"), ("c++", "c++20")];
const KIT_SOURCES: [&str; 2] = ["starloop_protocol.c", "example.c"];
/// A Cortex-M4 whose floating-point unit has single precision only.
const CORTEX_M4F: [&str; 4] = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"];
const CROSS: &str = "arm-none-eabi-gcc";

/// Returns false, with a line that counts as a skipped test, when the machine lacks the compiler.
fn is_there(compiler: &str) -> bool {
    let is_there = Command::new(compiler).arg("--version").output().is_ok_and(|output| output.status.success());
    if !is_there {
        println!("SKIPPED: no {compiler}, so the C kit was not compiled with it");
    }
    is_there
}

/// Compiles one file to an object; what the compiler complained about.
fn object(compiler: &str, arguments: &[&str], source: &Path, to: &Path) -> Result<(), String> {
    let include = format!("-I{}", crate::kit().join("c").display());
    let output =
        Command::new(compiler).args(arguments).args([&include, "-c"]).arg(source).arg("-o").arg(to).output().unwrap();
    if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

fn check_warnings(compiler: &str) {
    if !is_there(compiler) {
        return;
    }
    let folder = folder(compiler);
    let careless = folder.join("careless.c");
    std::fs::write(&careless, "unsigned careless(int a);\nunsigned careless(int a) { return a; }\n").unwrap();
    for (language, standard) in STANDARDS {
        let standard = format!("-std={standard}");
        let arguments = [&["-x", language, &standard, "-O2"][..], &WARNINGS].concat();
        for source in KIT_SOURCES {
            let outcome = object(compiler, &arguments, &crate::kit().join("c").join(source), &folder.join("kit.o"));
            assert_eq!(outcome, Ok(()), "{compiler} {standard} {source}");
        }
        // Negative control: a silent change of sign is refused.
        let outcome = object(compiler, &arguments, &careless, &folder.join("careless.o"));
        assert!(outcome.is_err_and(|said| said.contains("conversion")), "{compiler} {standard}");
    }
}

#[test]
fn gcc_has_no_warning_about_the_c_kit() {
    check_warnings("gcc");
}

#[test]
fn clang_has_no_warning_about_the_c_kit() {
    check_warnings("clang");
}

#[test]
fn arm_gcc_has_no_warning_about_the_c_kit() {
    check_warnings(CROSS);
}

/// Returns the double-precision routines of the compiler's library that an object calls.
fn double_routines(source: &Path, name: &str) -> Vec<String> {
    let to = folder("cortex_m4f").join(name);
    let arguments = [&["-std=c99", "-O2"][..], &CORTEX_M4F].concat();
    object(CROSS, &arguments, source, &to).unwrap();
    let output = Command::new("arm-none-eabi-nm").arg("--undefined-only").arg(&to).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let symbols = String::from_utf8(output.stdout).unwrap();
    let is_double = |symbol: &&str| {
        symbol.strip_prefix("__aeabi_").is_some_and(|rest| rest.starts_with('d') || rest.ends_with("2d"))
    };
    symbols.split_whitespace().filter(is_double).map(str::to_owned).collect()
}

#[test]
fn cortex_m4f_needs_no_double_precision_routine() {
    if !is_there(CROSS) {
        return;
    }
    let source = crate::kit().join("c/starloop_protocol.c");
    assert_eq!(double_routines(&source, "kit.o"), Vec::<String>::new());
    // Negative control: one product in double precision, as in earlier versions of the kit, is found.
    let doubled = folder("cortex_m4f").join("doubled.c");
    std::fs::write(&doubled, "float doubled(float a);\nfloat doubled(float a) { return (float)(a * 1e-6); }\n")
        .unwrap();
    let found = double_routines(&doubled, "doubled.o");
    assert!(["__aeabi_f2d", "__aeabi_dmul"].iter().all(|name| found.iter().any(|symbol| symbol == name)), "{found:?}");
}

/// Returns `N compared, M differ` of `scaled.c`, and whether it ended well.
fn compared(program: &Path, arguments: &[&str]) -> (u64, u64, bool) {
    let output = Command::new(program).args(arguments).output().unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    let mut numbers = said.split_whitespace().filter_map(|word| word.parse().ok());
    let (compared, differ) = (numbers.next().unwrap(), numbers.next().unwrap());
    (compared, differ, output.status.success())
}

#[test]
fn integer_arithmetic_has_the_bits_of_double_precision() {
    let program = folder("scaled").join("scaled");
    let source = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/firmware_kit/scaled.c");
    compile(&[&source], &program, &["-lm"]);
    let (count, differ, is_well) = compared(&program, &[]);
    assert!(count > 10_000_000 && is_well, "{count} compared, {differ} differ");
    let (_, differ, is_well) = compared(&program, &["float"]);
    assert!(differ > 100_000 && !is_well, "negative control: {differ} differ in single precision");
}
