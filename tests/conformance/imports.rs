//! The sources of `src/` against the import table.

use crate::paths::{NamedPath, module_of, named_paths};
use crate::source::{SourceFile, files, root, tokens};
use crate::table::{ROOMS, may_import};

/// `src/main.rs` calls the commands and nothing else.
const MAIN_MAY_IMPORT: &[&str] = &["cli"];
/// The only modules that speak to the graphics interface.
const MAY_NAME_WGPU: &[&[&str]] = &[&["gpu"], &["render", "gpu"], &["detector", "gpu"], &["display"]];
/// The only reader of the machine's clocks.
const MAY_READ_CLOCKS: &[&[&str]] = &[&["base", "clock"]];
/// Ceiling for one file: beyond it, a file has two subjects.
const LINES_MAX: usize = 600;

/// One file, its module and its paths.
struct Checked {
    path: String,
    module: Vec<String>,
    named: Vec<NamedPath>,
}

impl Checked {
    fn read(file: &SourceFile) -> Self {
        let module = module_of(&file.path);
        let named = named_paths(&module, &file.text);
        Self { path: file.path.clone(), module, named }
    }

    fn room(&self) -> &str {
        self.module.first().map_or("lib", String::as_str)
    }

    fn is_inside(&self, modules: &[&[&str]]) -> bool {
        modules.iter().any(|module| begins_with(&self.module, module))
    }

    /// `PATH:LINE: names a::b, why` for each path that `is_wrong`.
    fn wrong(&self, why: &str, is_wrong: impl Fn(&NamedPath) -> bool) -> Vec<String> {
        let say =
            |path: &NamedPath| format!("{}:{}: names `{}`: {why}", self.path, path.line, path.segments.join("::"));
        self.named.iter().filter(|path| is_wrong(path)).map(say).collect()
    }
}

fn begins_with(segments: &[String], start: &[&str]) -> bool {
    segments.len() >= start.len() && segments.iter().zip(start).all(|(had, wanted)| had == wanted)
}

/// Imports that the table does not give to the file's room.
fn forbidden_imports(file: &Checked) -> Vec<String> {
    let room = file.room();
    let allowed = if room == "main" { Some(MAIN_MAY_IMPORT) } else { may_import(room) };
    let is_allowed = |path: &NamedPath| {
        let is_free = path.is_of_the_house && (path.head() == room || path.head() == "base");
        is_free || allowed.unwrap_or(&[]).iter().any(|entry| begins_with(&path.segments, &split(entry)))
    };
    let is_checked = |path: &NamedPath| path.is_of_the_house || path.head() == "firmware_protocol";
    file.wrong(&format!("`{room}` may import {:?}", allowed.unwrap_or(&[])), |path| {
        is_checked(path) && !is_allowed(path)
    })
}

fn split(entry: &str) -> Vec<&str> {
    entry.split("::").collect()
}

/// wgpu outside the modules that may name it.
fn stray_wgpu(file: &Checked) -> Vec<String> {
    if file.is_inside(MAY_NAME_WGPU) {
        return Vec::new();
    }
    file.wrong("only `gpu`, `render::gpu`, `detector::gpu` and `display` do", |path| path.head() == "wgpu")
}

/// The machine's clocks outside `base::clock`.
fn stray_clocks(file: &Checked) -> Vec<String> {
    if file.is_inside(MAY_READ_CLOCKS) {
        return Vec::new();
    }
    file.wrong("time is an argument; only `base::clock` reads clocks", |path| reads_clocks(&path.segments))
}

/// True for `std::time::Instant`, `time::SystemTime` and for `std::time` taken whole.
fn reads_clocks(segments: &[String]) -> bool {
    let segments: Vec<_> = segments.iter().map(String::as_str).filter(|segment| *segment != "self").collect();
    let names_clock = segments.windows(2).any(|pair| matches!(pair, ["time", "Instant" | "SystemTime" | "UNIX_EPOCH"]));
    names_clock || matches!(segments[..], ["std" | "tokio", "time"] | ["std" | "tokio", "time", "*"])
}

/// Functions of a stage called by `config`, which takes their parameter types and calls nothing.
fn functions_in_config(file: &Checked) -> Vec<String> {
    let is_own = |path: &NamedPath| ["config", "base"].iter().any(|room| begins_with(&path.segments, &[room]));
    let names_type = |path: &NamedPath| path.segments.iter().any(|segment| segment.starts_with(char::is_uppercase));
    if file.room() != "config" {
        return Vec::new();
    }
    file.wrong("`config` takes types from the stages, and no functions", |path| {
        path.is_of_the_house && !is_own(path) && !names_type(path)
    })
}

/// All that is wrong with one file.
fn violations(file: &SourceFile) -> Vec<String> {
    let checked = Checked::read(file);
    [forbidden_imports, stray_wgpu, stray_clocks, functions_in_config].iter().flat_map(|rule| rule(&checked)).collect()
}

#[test]
fn each_room_imports_what_the_table_gives_it() {
    let found: Vec<_> = files(&["src"], &["rs"]).iter().flat_map(violations).collect();
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

#[test]
fn the_table_names_the_rooms_of_the_library() {
    let text = std::fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let tokens = tokens(&text);
    let mut declared: Vec<_> =
        tokens.windows(2).filter(|pair| pair[0].text == "mod").map(|pair| pair[1].text.as_str()).collect();
    let mut listed: Vec<_> = ROOMS.iter().map(|room| room.name).collect();
    declared.sort_unstable();
    listed.sort_unstable();
    assert_eq!(declared, listed, "`mod`s of src/lib.rs (left) and rows of the table (right)");
}

#[test]
fn each_file_has_one_subject() {
    let all = files(&["src", "tests", "firmware_protocol"], &["rs", "wgsl"]);
    let long = all.iter().filter(|file| file.text.lines().count() > LINES_MAX);
    let long: Vec<_> = long.map(|file| format!("{}: {} lines", file.path, file.text.lines().count())).collect();
    assert!(long.is_empty(), "more than {LINES_MAX} lines:\n{}", long.join("\n"));
}

fn found_in(path: &str, text: &str) -> usize {
    violations(&SourceFile { path: path.to_owned(), text: text.to_owned() }).len()
}

#[test]
fn a_forbidden_import_is_caught() {
    assert_eq!(found_in("src/render/cpu.rs", "use crate::base::image::Image;\nuse crate::exposure::A;"), 0, "control");
    assert_eq!(found_in("src/render/cpu.rs", "use crate::detector::Detector;"), 1, "plain");
    assert_eq!(found_in("src/render/cpu.rs", "use crate::{base::image::Image, sink::A, sky::{B, C}};"), 3, "tree");
    assert_eq!(found_in("src/render/cpu.rs", "fn a() { super::super::sink::b() }"), 1, "super");
    assert_eq!(found_in("src/render/cpu.rs", "mod tests { use super::super::super::sink::B; }"), 1, "in a test module");
    assert_eq!(found_in("src/render/cpu.rs", "use crate::*; use crate as house;"), 2, "the whole crate");
    assert_eq!(found_in("src/render/cpu.rs", "use firmware_protocol::Message;"), 1, "the other crate");
    assert_eq!(found_in("src/base/time.rs", "use crate::gpu::A;"), 1, "base imports nothing");
    assert_eq!(
        found_in("src/lib.rs", "pub use crate::sink::A; pub use self::sink::B;"),
        2,
        "the root re-exports nothing"
    );
    assert_eq!(found_in("src/main.rs", "fn main() { starloop::cli::run(); starloop::sink::a(); }"), 1, "main");
    assert_eq!(found_in("src/cellar/mod.rs", "use crate::sink::A;"), 1, "a room that the table lacks");
}

#[test]
fn comments_are_no_imports() {
    let text = "//! crate::sink::A\n/// [`crate::sink::B`]\n// use crate::sink::C;\n/* use wgpu; */ fn a() { \"crate::sink\" }";
    assert_eq!(found_in("src/render/cpu.rs", text), 0);
}

#[test]
fn testbed_sees_the_catalog_alone() {
    assert_eq!(found_in("src/testbed/tracker.rs", "use crate::sky::catalog::{Catalog, cone::A};"), 0, "control");
    assert_eq!(
        found_in("src/testbed/tracker.rs", "use crate::sky::earth::A; use crate::sky;"),
        2,
        "the rest of the sky"
    );
    assert_eq!(found_in("src/testbed/tracker.rs", "use crate::astrometry::CameraGeometry;"), 1, "the code it checks");
}

#[test]
fn stray_wgpu_and_clocks_are_caught() {
    assert_eq!(found_in("src/render/gpu/passes.rs", "use wgpu::Buffer;"), 0, "control");
    assert_eq!(found_in("src/render/cpu.rs", "use wgpu::Buffer; fn a(b: &wgpu::Device) {}"), 2, "wgpu");
    assert_eq!(found_in("src/base/clock.rs", "use std::time::Instant;"), 0, "control");
    assert_eq!(found_in("src/sink/null.rs", "use std::time::Duration; struct Instant;"), 0, "control");
    assert_eq!(
        found_in("src/sink/null.rs", "use std::time::{Duration, Instant}; std::time::SystemTime::now()"),
        2,
        "clocks"
    );
    assert_eq!(
        found_in("src/sink/null.rs", "use std::time; use std::time::{self}; use std::time::*;"),
        3,
        "the module"
    );
}

#[test]
fn config_takes_types_and_no_functions() {
    assert_eq!(
        found_in("src/config/bench.rs", "use crate::optics::PsfModel; crate::optics::Airy::new()"),
        0,
        "control"
    );
    assert_eq!(found_in("src/config/bench.rs", "use crate::optics::gaussian::blur;"), 1, "a function");
}
