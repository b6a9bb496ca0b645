//! Files of one crate that refer to each other in a circle: none but those of a list, each with its reason.
//!
//! Cargo refuses a circle of crates, and no tool refuses one of files: their readers have no file to begin with. An import
//! that goes through a re-export counts as one of the file that defines the name. Tests are left out.

use std::collections::{BTreeMap, BTreeSet};

use crate::crates::{Graph, reached_from};
use crate::source::{SourceFile, Token, files, is_word_character, tokens};

/// Circles whose cut would be worse: a folder, its files, and why.
const ALLOWED: &[(&str, &[&str], &str)] = &[
    ("src/config", &["bench", "tracker_out"], "outputs of a bench are checked with all of the bench"),
    ("src/config", &["detector", "detector_effects", "radiometry"], NESTED),
    ("src/config", &["document", "packed"], "a document reads packs, and a pack has documents"),
    ("src/config", &["event", "event_reader", "event_word"], "one row is read and written"),
    ("src/config", &["link", "plain_link"], NESTED),
    ("src/config", &["mtf", "psf"], NESTED),
    ("src/config", &["target", "target_orbit"], NESTED),
    ("src/plan/optics", &["psf", "psf_field"], "a PSF may be a field of PSFs"),
];

/// A section of a configuration has parts, and its parts are checked with the keys of the section.
const NESTED: &str = "keys of a section and of its parts";

/// Words that begin the definition of an item.
const ITEMS: [&str; 9] = ["struct", "enum", "trait", "type", "fn", "const", "static", "union", "macro_rules"];

type Path = Vec<String>;

/// A name that a `use` gives to a path from the root of the crate; `*` for all names of it.
struct Import {
    name: String,
    path: Path,
}

/// A file as a module of its crate.
#[derive(Default)]
struct Module {
    file: String,
    /// Names defined in the file.
    items: BTreeSet<String>,
    imports: Vec<Import>,
    /// Paths from the root of the crate, as the code outside of a `use` has them.
    paths: Vec<Path>,
    /// Words of the code outside of a `use`.
    words: BTreeSet<String>,
}

/// The modules of one crate, by their paths from its root.
type Modules = BTreeMap<Path, Module>;

/// Returns the path of a file's module below the folder of its crate: `a/mod.rs` and `a.rs` are both `a`.
fn module_path(below_crate: &str) -> Path {
    let mut path: Path = below_crate.trim_end_matches(".rs").split('/').map(str::to_owned).collect();
    if path.last().is_some_and(|last| matches!(last.as_str(), "mod" | "lib" | "main")) {
        path.pop();
    }
    path
}

/// Returns tokens without the items that only a test build has.
fn without_tests(all: Vec<Token>) -> Vec<String> {
    let words: Vec<String> = all.into_iter().map(|token| token.text).collect();
    let mut kept = Vec::new();
    let mut at = 0;
    while at < words.len() {
        if words[at..].iter().take(7).eq(["#", "[", "cfg", "(", "test", ")", "]"]) {
            at = end_of_item(&words, at + 7);
        } else {
            kept.push(words[at].clone());
            at += 1;
        }
    }
    kept
}

/// Returns the index behind an item: behind its `;`, or behind the brace that closes it.
fn end_of_item(words: &[String], begin: usize) -> usize {
    let mut depth = 0_usize;
    for (at, word) in words.iter().enumerate().skip(begin) {
        match word.as_str() {
            "{" | "(" | "[" => depth += 1,
            "}" | ")" | "]" => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 && matches!(word.as_str(), ";" | "}") {
            return at + 1;
        }
    }
    words.len()
}

/// Returns a path from the root of the crate; `None` when it leads out of the crate.
fn absolute(path: &[String], module: &[String], modules: &BTreeSet<Path>) -> Option<Path> {
    let supers = path.iter().take_while(|word| *word == "super").count();
    match path.first()?.as_str() {
        "crate" => Some(path[1..].to_vec()),
        "self" => Some([module, &path[1..]].concat()),
        "super" => Some([module.get(..module.len().checked_sub(supers)?)?, &path[supers..]].concat()),
        child => {
            let below = [module, &[child.to_owned()]].concat();
            modules.contains(&below).then(|| [module, path].concat())
        }
    }
}

/// Appends the imports of a `use` tree from `at` on, and returns the index of the token behind it.
fn read_tree(words: &[String], mut at: usize, prefix: &[String], found: &mut Vec<(String, Path)>) -> usize {
    let mut path = prefix.to_vec();
    loop {
        match words[at].as_str() {
            "{" => {
                at += 1;
                while words[at] != "}" {
                    at = read_tree(words, at, &path, found);
                    at += usize::from(words[at] == ",");
                }
                return at + 1;
            }
            "::" => at += 1,
            "," | "}" | ";" => {
                found.push((path.last().cloned().unwrap_or_default(), path));
                return at;
            }
            "as" => {
                found.push((words[at + 1].clone(), path));
                return at + 2;
            }
            // `a::{self}` is a name for `a`.
            "self" if !path.is_empty() => at += 1,
            word => {
                path.push(word.to_owned());
                at += 1;
            }
        }
    }
}

/// Returns the path whose first word is at `at`; `None` inside a path, and for a word alone.
fn path_at(words: &[String], at: usize) -> Option<Path> {
    let is_separator = |at: usize| words.get(at).is_some_and(|word| word == "::");
    let begins = (at == 0 || !is_separator(at - 1)) && is_separator(at + 1);
    let mut path = vec![words.get(at).filter(|_| begins)?.clone()];
    let mut next = at + 1;
    while is_separator(next) && words.get(next + 1).is_some_and(|word| word.starts_with(is_word_character)) {
        path.push(words[next + 1].clone());
        next += 2;
    }
    Some(path)
}

/// Returns the module of a file.
fn read_module(file: &SourceFile, module: &[String], modules: &BTreeSet<Path>) -> Module {
    let words = without_tests(tokens(&file.text));
    let mut read = Module { file: file.path.clone(), ..Module::default() };
    let mut at = 0;
    while at < words.len() {
        let word = words[at].as_str();
        // `use<'a>` says what an opaque type captures.
        if word == "use" && words[at + 1] != "<" {
            let mut found = Vec::new();
            at = read_tree(&words, at + 1, &[], &mut found);
            let import = |(name, path): (String, Path)| Some(Import { name, path: absolute(&path, module, modules)? });
            read.imports.extend(found.into_iter().filter_map(import));
            continue;
        }
        if ITEMS.contains(&word) {
            read.items.extend(words[at + 1..].iter().find(|word| !matches!(word.as_str(), "!" | "mut")).cloned());
        }
        read.words.insert(word.to_owned());
        read.paths.extend(path_at(&words, at).and_then(|path| absolute(&path, module, modules)));
        at += 1;
    }
    read
}

/// Returns the longest beginning of a path that is a module.
fn deepest<'a>(modules: &Modules, path: &'a [String]) -> &'a [String] {
    let length = (0..=path.len()).rev().find(|length| modules.contains_key(&path[..*length])).unwrap_or(0);
    &path[..length]
}

/// Returns the module that defines what a path names. Re-exports are followed, each name of each module once.
fn definer(modules: &Modules, path: &[String], seen: &mut BTreeSet<Path>) -> Option<Path> {
    let at = deepest(modules, path);
    let Some(word) = path.get(at.len()) else { return Some(at.to_vec()) };
    let module = modules.get(at)?;
    if module.items.contains(word) {
        return Some(at.to_vec());
    }
    if !seen.insert(path[..=at.len()].to_vec()) {
        return None;
    }
    let rest = &path[at.len()..];
    let named = module.imports.iter().filter(|import| import.name == *word);
    let named = named.map(|import| [&import.path, &rest[1..]].concat());
    let all = module.imports.iter().filter(|import| import.name == "*");
    let all = all.map(|import| [&import.path[..import.path.len() - 1], rest].concat());
    named.chain(all).find_map(|onward| definer(modules, &onward, seen))
}

/// Returns, for each file, the files that its code refers to. Those of its own folder are parts of it, and are left out.
fn references(modules: &Modules) -> Graph {
    // An item that a macro makes is in no list: its path leads to the file that has the macro.
    let found =
        |path: &Path| definer(modules, path, &mut BTreeSet::new()).unwrap_or_else(|| deepest(modules, path).to_vec());
    let of = |(at, module): (&Path, &Module)| {
        let is_used = |import: &&Import| import.name == "*" || module.words.contains(&import.name);
        let imports = module.imports.iter().filter(is_used).map(|import| &import.path);
        let others = imports.chain(&module.paths).map(found).filter(|found| !found.starts_with(at));
        others.filter_map(|found| modules.get(&found)).map(|other| other.file.clone()).collect()
    };
    modules.iter().map(|module| (module.1.file.clone(), of(module))).collect()
}

/// Returns the circles of one crate, files sorted.
fn circles(files: &[SourceFile], folder: &str) -> Vec<Vec<String>> {
    let path = |file: &SourceFile| module_path(file.path[folder.len()..].trim_start_matches('/'));
    let is_test = |path: &Path| path.iter().any(|part| part == "tests" || part.ends_with("_tests"));
    let paths: BTreeSet<Path> = files.iter().map(path).filter(|path| !is_test(path)).collect();
    let in_code = files.iter().filter(|file| paths.contains(&path(file)));
    let modules: Modules = in_code.map(|file| (path(file), read_module(file, &path(file), &paths))).collect();
    let graph = references(&modules);
    let reach: Graph = graph.keys().map(|file| (file.clone(), reached_from(file, &graph))).collect();
    let mut found = BTreeSet::new();
    for (file, others) in &reach {
        if others.contains(file) {
            found.insert(others.iter().filter(|other| reach[*other].contains(file)).cloned().collect());
        }
    }
    found.into_iter().collect()
}

/// Returns the folders of the crates below `src`.
fn crate_folders() -> Vec<String> {
    let manifests = files(&["src"], &["toml"]);
    let mut folders: Vec<String> =
        manifests.iter().filter_map(|file| file.path.strip_suffix("/Cargo.toml")).map(str::to_owned).collect();
    folders.retain(|folder| folder != "src");
    folders
}

#[test]
fn files_refer_to_each_other_in_no_circle() {
    let folders = crate_folders();
    let all = files(&["src"], &["rs"]);
    let below = |file: &SourceFile, folder: &str| file.path.starts_with(&format!("{folder}/"));
    let (mut rest, mut found) = (Vec::new(), Vec::new());
    let mut of_crate: BTreeMap<&str, Vec<SourceFile>> = BTreeMap::new();
    for file in all {
        match folders.iter().find(|folder| below(&file, folder)) {
            Some(folder) => of_crate.entry(folder).or_default().push(file),
            None => rest.push(file),
        }
    }
    of_crate.insert("src", rest);
    for (folder, files) in &of_crate {
        found.extend(circles(files, folder));
    }
    let allowed =
        ALLOWED.iter().map(|(folder, files, _)| files.iter().map(|file| format!("{folder}/{file}.rs")).collect());
    let allowed: Vec<Vec<String>> = allowed.collect();
    let new: Vec<&Vec<String>> = found.iter().filter(|circle| !allowed.contains(circle)).collect();
    assert!(new.is_empty(), "{} circles of files:\n{:#?}", new.len(), new);
    let gone: Vec<&Vec<String>> = allowed.iter().filter(|circle| !found.contains(circle)).collect();
    assert!(gone.is_empty(), "no longer a circle, remove from the list:\n{gone:#?}");
}

/// Returns the circles of a crate of two files and its root.
fn circles_of(root: &str, first: &str, second: &str) -> usize {
    let file = |path: &str, text: &str| SourceFile { path: path.to_owned(), text: text.to_owned() };
    circles(&[file("x/lib.rs", root), file("x/a.rs", first), file("x/b/mod.rs", second)], "x").len()
}

#[test]
fn a_circle_is_seen_through_every_kind_of_reference() {
    let root = "mod a; mod b; pub use a::A; pub use b::*;";
    let first = "use crate::b::B; pub struct A(B);";
    assert_eq!(circles_of(root, first, "pub struct B;"), 0, "one way");
    for second in [
        "use crate::a::A; pub struct B(A);",
        "use super::{a::{self as other}, c}; pub struct B(other::A);",
        "use super::A; pub struct B(A);",
        "pub struct B(crate::a::A);",
        "pub struct B(super::A);",
    ] {
        assert_eq!(circles_of(root, first, second), 1, "{second}");
    }
    assert_eq!(circles_of(root, "pub struct A(crate::B);", "use crate::A; pub struct B(A);"), 1, "all names of a file");
    let test = "pub struct B; #[cfg(test)] mod t { use crate::a::A; fn f(a: A) {} }";
    assert_eq!(circles_of(root, first, test), 0, "a test");
    let root = "mod a; pub fn f() { a::A; }";
    assert_eq!(circles_of(root, "use super::f; pub fn A() { f() }", ""), 0, "a part of its root");
}
