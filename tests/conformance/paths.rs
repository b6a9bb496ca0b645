//! Tokens -> every path the code names, `use` trees unfolded and `self`/`super` resolved.

use crate::source::{Token, tokens};

/// One path named in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NamedPath {
    /// From the crate root, `crate` left out; a path of another crate begins with that crate's name.
    pub(crate) segments: Vec<String>,
    /// True when the path began with `crate`, `self`, `super` or the crate's own name.
    pub(crate) is_of_the_house: bool,
    /// Line, from 1.
    pub(crate) line: usize,
}

impl NamedPath {
    /// The room or the other crate; empty for the bare crate root.
    pub(crate) fn head(&self) -> &str {
        self.segments.first().map_or("", String::as_str)
    }
}

/// Module path of a file under `src/`: `src/sky/catalog/mod.rs` -> `sky::catalog`; `src/lib.rs` -> the root.
pub(crate) fn module_of(path: &str) -> Vec<String> {
    let inner = path.trim_start_matches("src/").trim_end_matches(".rs");
    let mut module: Vec<String> = inner.split('/').map(str::to_owned).collect();
    if module.last().is_some_and(|last| last == "mod" || last == "lib") {
        module.pop();
    }
    module
}

/// Every path of the code in `text`, a file whose module is `module`.
pub(crate) fn named_paths(module: &[String], text: &str) -> Vec<NamedPath> {
    let tokens = tokens(text);
    let mut walker =
        Walker { tokens: &tokens, module: module.to_vec(), inline: Vec::new(), depth: 0, found: Vec::new() };
    let mut at = 0;
    while at < tokens.len() {
        at = walker.step(at);
    }
    walker.found
}

struct Walker<'a> {
    tokens: &'a [Token],
    /// The module at the cursor.
    module: Vec<String>,
    /// Brace depth inside each open `mod name { .. }`.
    inline: Vec<usize>,
    depth: usize,
    found: Vec<NamedPath>,
}

impl Walker<'_> {
    fn text(&self, at: usize) -> &str {
        self.tokens.get(at).map_or("", |token| &token.text)
    }

    /// Consumes what stands at `at`; gives the next position.
    fn step(&mut self, at: usize) -> usize {
        match self.text(at) {
            "mod" if self.text(at + 2) == "{" => self.enter_module(at),
            "pub" if self.text(at + 1) == "(" => self.after_visibility(at),
            "{" => {
                self.depth += 1;
                at + 1
            }
            "}" => self.close_brace(at),
            _ if self.tokens[at].is_word() => self.tree(at, Vec::new()),
            _ => at + 1,
        }
    }

    fn enter_module(&mut self, at: usize) -> usize {
        self.module.push(self.text(at + 1).to_owned());
        self.depth += 1;
        self.inline.push(self.depth);
        at + 3
    }

    fn close_brace(&mut self, at: usize) -> usize {
        if self.inline.last() == Some(&self.depth) {
            self.inline.pop();
            self.module.pop();
        }
        self.depth = self.depth.saturating_sub(1);
        at + 1
    }

    /// `pub(crate)`, `pub(in path)` name no import; `pub(crate::a::B)` in a tuple struct does.
    fn after_visibility(&self, at: usize) -> usize {
        if self.text(at + 2) == "in" {
            return (at..self.tokens.len()).find(|&i| self.text(i) == ")").unwrap_or(self.tokens.len());
        }
        if self.text(at + 3) == ")" { at + 4 } else { at + 1 }
    }

    /// A path, or a `use` tree after `prefix`; records each leaf.
    fn tree(&mut self, mut at: usize, mut prefix: Vec<String>) -> usize {
        let line = self.tokens[at].line;
        loop {
            match self.text(at) {
                "{" => return self.branches(at + 1, &prefix),
                "*" => {
                    prefix.push("*".to_owned());
                    self.record(&prefix, line);
                    return at + 1;
                }
                _ if self.tokens.get(at).is_some_and(Token::is_word) => prefix.push(self.text(at).to_owned()),
                _ => {
                    self.record(&prefix, line);
                    return at;
                }
            }
            at += 1;
            if self.text(at) != "::" {
                self.record(&prefix, line);
                return at;
            }
            at += 1;
        }
    }

    /// The inside of `prefix::{ .. }`, up to and with its closing brace.
    fn branches(&mut self, mut at: usize, prefix: &[String]) -> usize {
        while at < self.tokens.len() {
            match self.text(at) {
                "}" => return at + 1,
                "as" => at += 2,
                "," => at += 1,
                _ => {
                    let next = self.tree(at, prefix.to_vec());
                    at = next.max(at + 1);
                }
            }
        }
        at
    }

    fn record(&mut self, written: &[String], line: usize) {
        if let Some((segments, is_of_the_house)) = resolved(&self.module, written) {
            self.found.push(NamedPath { segments, is_of_the_house, line });
        }
    }
}

/// `written` from the crate root; `None` for a plain `self`, the receiver of a method.
fn resolved(module: &[String], written: &[String]) -> Option<(Vec<String>, bool)> {
    let mut at = module.to_vec();
    let mut rest = written;
    match written.first()?.as_str() {
        "crate" | "starloop" => {
            at.clear();
            rest = &rest[1..];
        }
        "self" if written.len() > 1 => rest = &rest[1..],
        "super" => {}
        "self" => return None,
        _ => return Some((written.to_vec(), false)),
    }
    while let Some("super") = rest.first().map(String::as_str) {
        at.pop();
        rest = &rest[1..];
    }
    at.extend(rest.iter().filter(|segment| *segment != "self").cloned());
    Some((at, true))
}

fn house(path: &str, text: &str) -> Vec<String> {
    let paths = named_paths(&module_of(path), text);
    paths.iter().filter(|path| path.is_of_the_house).map(|path| path.segments.join("::")).collect()
}

#[test]
fn use_trees_unfold() {
    let text = "use crate::{base::time::{self, Tai as T}, sky::catalog::*};\nuse crate::link;";
    assert_eq!(house("src/link/port.rs", text), ["base::time", "base::time::Tai", "sky::catalog::*", "link"]);
}

#[test]
fn inline_paths_are_found() {
    let text =
        "fn a(self, b: crate::sky::B<crate::gpu::C>) -> Option<crate::link::D> { crate::e!(::wgpu::F::<u8>::g()) }";
    assert_eq!(house("src/base/image.rs", text), ["sky::B", "gpu::C", "link::D", "e"]);
    let external = named_paths(&[], text);
    assert!(
        external.iter().any(|path| path.segments == ["wgpu", "F"]),
        "paths of other crates keep their crate's name"
    );
}

#[test]
fn super_climbs_from_files_and_inline_modules() {
    assert_eq!(house("src/sky/catalog/open.rs", "use super::super::super::gpu::A;"), ["gpu::A"]);
    let text = "mod tests { use super::*; fn a() { super::super::b(); } }\nuse super::c;";
    assert_eq!(house("src/sky/earth.rs", text), ["sky::earth::*", "sky::b", "sky::c"]);
    assert_eq!(house("src/sky/mod.rs", "use super::link::A; use self::b::C;"), ["link::A", "sky::b::C"]);
}

#[test]
fn visibility_and_comments_name_nothing() {
    let text = "// use crate::gpu::A;\n/// [`crate::gpu::B`]\npub(crate) struct C; pub(in crate::gpu) fn d() { \"crate::gpu\"; }";
    assert!(house("src/base/image.rs", text).is_empty(), "{:?}", house("src/base/image.rs", text));
    assert_eq!(house("src/base/image.rs", "struct A(pub(crate) u8, pub (crate::gpu::B, u8));"), ["gpu::B"]);
}
