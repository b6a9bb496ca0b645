//! Repository files, and Rust text -> tokens without comments, strings and lifetimes.
//!
//! A scanner, not a parser: it knows where code stops and prose begins, which is all that the rules need.

use std::path::{Path, PathBuf};

/// Returns the repository root.
pub(crate) fn root() -> PathBuf {
    std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into()).into()
}

/// A text file of the repository.
pub(crate) struct SourceFile {
    /// Path from the root, with `/`.
    pub(crate) path: String,
    pub(crate) text: String,
}

/// Returns every file under `folders` with one of the `extensions`, sorted by path. Panics when there is none.
pub(crate) fn files(folders: &[&str], extensions: &[&str]) -> Vec<SourceFile> {
    let root = root();
    let mut found = Vec::new();
    for folder in folders {
        collect(&root.join(folder), extensions, &mut found);
    }
    found.sort();
    assert!(!found.is_empty(), "no {extensions:?} files under {folders:?} in {}", root.display());
    found.iter().map(|path| read(&root, path)).collect()
}

fn collect(folder: &Path, extensions: &[&str], found: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    for path in entries.map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            collect(&path, extensions, found);
        } else if path.extension().is_some_and(|obtained| extensions.iter().any(|wanted| obtained == *wanted)) {
            found.push(path);
        }
    }
}

fn read(root: &Path, path: &Path) -> SourceFile {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let path = path.strip_prefix(root).unwrap().to_str().unwrap().replace('\\', "/");
    SourceFile { path, text }
}

/// A word, `::`, or one character of punctuation; a literal is the token `"`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Token {
    pub(crate) text: String,
    /// Line, from 1.
    pub(crate) line: usize,
}

impl Token {
    /// Returns true for identifiers, keywords and numbers.
    pub(crate) fn is_word(&self) -> bool {
        self.text.starts_with(is_word_character)
    }
}

/// Returns true for a character of an identifier, a keyword or a number.
pub(crate) fn is_word_character(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Returns the code of `text`, comments and documentation left out.
pub(crate) fn tokens(text: &str) -> Vec<Token> {
    let mut scanner = Scanner { rest: text, line: 1, tokens: Vec::new() };
    while scanner.step() {}
    scanner.tokens
}

struct Scanner<'a> {
    rest: &'a str,
    line: usize,
    tokens: Vec<Token>,
}

impl Scanner<'_> {
    /// Consumes one item; false at the end.
    fn step(&mut self) -> bool {
        let Some(first) = self.rest.chars().next() else { return false };
        if first.is_whitespace() {
            self.advance(first.len_utf8());
        } else if self.rest.starts_with("//") {
            self.advance(self.rest.find('\n').unwrap_or(self.rest.len()));
        } else if self.rest.starts_with("/*") {
            self.advance(block_comment_len(self.rest));
        } else if let Some(len) = raw_string_len(self.rest) {
            self.literal(len);
        } else if first == '"' {
            self.literal(quoted_len(self.rest, '"'));
        } else if first == '\'' {
            self.quote();
        } else if is_word_character(first) {
            self.emit(word_len(self.rest));
        } else {
            self.emit(if self.rest.starts_with("::") { 2 } else { first.len_utf8() });
        }
        true
    }

    /// Reads a character literal or a lifetime.
    fn quote(&mut self) {
        let mut after = self.rest.chars().skip(1);
        let is_literal = after.next() == Some('\\') || after.next() == Some('\'');
        if is_literal {
            self.literal(quoted_len(self.rest, '\''));
        } else {
            self.advance(1 + word_len(&self.rest[1..]));
        }
    }

    fn emit(&mut self, len: usize) {
        self.tokens.push(Token { text: self.rest[..len].to_owned(), line: self.line });
        self.advance(len);
    }

    fn literal(&mut self, len: usize) {
        self.tokens.push(Token { text: "\"".to_owned(), line: self.line });
        self.advance(len);
    }

    fn advance(&mut self, len: usize) {
        self.line += self.rest[..len].matches('\n').count();
        self.rest = &self.rest[len..];
    }
}

fn word_len(text: &str) -> usize {
    text.find(|c| !is_word_character(c)).unwrap_or(text.len())
}

/// Returns the length of a literal that begins with `quote`, its closing quote included.
fn quoted_len(text: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        if escaped {
            escaped = false;
        } else if c == '\\' {
            escaped = true;
        } else if c == quote {
            return at + 1;
        }
    }
    text.len()
}

/// Returns the length of `r"..."`, `br#"..."#` and the like; `None` when `text` begins with anything else.
fn raw_string_len(text: &str) -> Option<usize> {
    let prefix = ["r", "br", "cr"].into_iter().find(|prefix| *prefix == &text[..word_len(text)])?;
    let after = &text[prefix.len()..];
    let hashes = after.len() - after.trim_start_matches('#').len();
    let body = after[hashes..].strip_prefix('"')?;
    let end = format!("\"{}", "#".repeat(hashes));
    let len = body.find(&end).map_or(body.len(), |at| at + end.len());
    Some(prefix.len() + hashes + 1 + len)
}

/// Returns the length of a block comment, nested ones included.
fn block_comment_len(text: &str) -> usize {
    let mut depth = 0_usize;
    let mut at = 0;
    while at < text.len() {
        if text[at..].starts_with("/*") {
            depth += 1;
            at += 2;
        } else if text[at..].starts_with("*/") {
            depth -= 1;
            at += 2;
        } else {
            at += text[at..].chars().next().map_or(1, char::len_utf8);
        }
        if depth == 0 {
            break;
        }
    }
    at
}

fn texts(text: &str) -> Vec<String> {
    tokens(text).into_iter().map(|token| token.text).collect()
}

#[test]
fn comments_strings_and_lifetimes_are_not_code() {
    assert!(texts("// a\n/// b\n//! c\n/* d /* e */ f */").is_empty(), "comments, nested ones too");
    assert_eq!(
        texts(r##"("a\"b", r#"c"d"#, br"e", '\'', 'f')"##),
        ["(", "\"", ",", "\"", ",", "\"", ",", "\"", ",", "\"", ")"]
    );
    assert_eq!(texts("fn a<'b>(c: &'b r#type)"), ["fn", "a", "<", ">", "(", "c", ":", "&", "r", "#", "type", ")"]);
}

#[test]
fn code_keeps_its_words_and_lines() {
    let found = tokens("a::b\n/* x\n */ c!(\"d\ne\");\nf");
    let words: Vec<_> = found.iter().filter(|t| t.is_word()).map(|t| (t.text.as_str(), t.line)).collect();
    assert_eq!(words, [("a", 1), ("b", 1), ("c", 3), ("f", 5)]);
    assert_eq!(found[1].text, "::");
}
