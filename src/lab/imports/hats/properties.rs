//! `hats.properties`: what a catalog says of itself, lines of `key=value` as Java writes them.
//!
//! Source: IVOA Note "HATS" (keys); Java's `Properties` (comments, escapes, lines that go on).

use crate::{COLLECTION, FILES};
use base::input_file::{SETTINGS_BYTES, read_text};
use base::refused::Refused;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The properties of a catalog.
#[derive(Debug)]
pub(super) struct Properties {
    pub(super) path: PathBuf,
    values: BTreeMap<String, String>,
}

impl Properties {
    /// Reads the properties of a catalog; of the main one in a collection. The folder of the file is kept with them.
    pub(super) fn read(folder: &Path) -> Result<Self, Refused> {
        let collection = folder.join(COLLECTION);
        if collection.is_file() {
            let collection = Self::read_file(collection)?;
            let main = collection.wanted("hats_primary_table_url", "the folder of the main catalog")?;
            return Self::read_file(file_of(&folder.join(main)));
        }
        Self::read_file(file_of(folder))
    }

    fn read_file(path: PathBuf) -> Result<Self, Refused> {
        let text = read_text(&path, SETTINGS_BYTES).map_err(Refused::file("cannot read", &path))?;
        Ok(Self { values: parse(&text), path })
    }

    /// Returns the folder of the catalog.
    pub(super) fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new("."))
    }

    pub(super) fn get(&self, key: &str) -> Option<&str> {
        self.values.get(key).map(String::as_str).filter(|value| !value.is_empty())
    }

    /// Returns a property that must be there.
    pub(super) fn wanted(&self, key: &'static str, wanted: &str) -> Result<&str, Refused> {
        self.get(key).ok_or_else(|| self.refuse(key, wanted, "nothing"))
    }

    /// Returns a whole number, where there is one.
    pub(super) fn number(&self, key: &'static str) -> Result<Option<u64>, Refused> {
        let number = |text: &str| text.parse().map_err(|_| self.refuse(key, "a whole number", text));
        self.get(key).map(number).transpose()
    }

    pub(super) fn refuse(&self, key: &'static str, wanted: &str, got: &str) -> Refused {
        Refused::at(&self.path, format_args!("{key}: wanted {wanted}, got {got}"))
    }
}

fn file_of(folder: &Path) -> PathBuf {
    let there = FILES.iter().map(|name| folder.join(name)).find(|path| path.is_file());
    there.unwrap_or_else(|| folder.join(FILES[0]))
}

/// Returns keys and values; of a key that comes twice the last.
fn parse(text: &str) -> BTreeMap<String, String> {
    let mut values = BTreeMap::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let mut line = line.trim_start().to_owned();
        if line.starts_with(['#', '!']) {
            continue;
        }
        // An odd number of strokes at its end: the line goes on.
        while line.chars().rev().take_while(|c| *c == '\\').count() % 2 == 1 {
            line.pop();
            let Some(next) = lines.next() else { break };
            line.push_str(next.trim_start());
        }
        let (key, rest) = part(&line, |c| matches!(c, '=' | ':') || c.is_whitespace());
        if key.is_empty() {
            continue;
        }
        let rest = rest.trim_start();
        let value = rest.strip_prefix(['=', ':']).unwrap_or(rest).trim();
        values.insert(key, part(value, |_| false).0);
    }
    values
}

/// Returns the text up to the first character that `ends` it and is not escaped, without its escapes; and the rest.
fn part(text: &str, ends: impl Fn(char) -> bool) -> (String, &str) {
    let (mut out, mut letters) = (String::new(), text.char_indices());
    while let Some((at, letter)) = letters.next() {
        match letter {
            '\\' => match letters.next() {
                Some((at, 'u')) => {
                    let code = text.get(at + 1..at + 5).and_then(|code| u32::from_str_radix(code, 16).ok());
                    out.push(code.and_then(char::from_u32).unwrap_or(char::REPLACEMENT_CHARACTER));
                    letters.by_ref().take(4).for_each(drop);
                }
                Some((_, 'n')) => out.push('\n'),
                Some((_, 'r')) => out.push('\r'),
                Some((_, 't')) => out.push('\t'),
                Some((_, letter)) => out.push(letter),
                None => {}
            },
            letter if ends(letter) => return (out, &text[at..]),
            letter => out.push(letter),
        }
    }
    (out, "")
}

/// Returns keys and values as a file of properties.
pub(super) fn write(path: &Path, values: &[(&str, String)]) -> Result<(), Refused> {
    let mut text = String::from("#HATS catalog\n");
    for (key, value) in values.iter().filter(|(_, value)| !value.is_empty()) {
        text.push_str(key);
        text.push('=');
        for letter in value.chars() {
            match letter {
                '\n' => text.push_str("\\n"),
                '\r' => text.push_str("\\r"),
                '\t' => text.push_str("\\t"),
                '\\' | '=' | ':' | '#' | '!' => text.extend(['\\', letter]),
                // Java reads these files as Latin-1.
                letter if !letter.is_ascii() => {
                    letter.encode_utf16(&mut [0; 2]).iter().for_each(|code| text.push_str(&format!("\\u{code:04X}")));
                }
                letter => text.push(letter),
            }
        }
        text.push('\n');
    }
    std::fs::write(path, text).map_err(Refused::file("cannot write", path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::is_hats;

    #[test]
    fn properties_as_java_writes_them() {
        let text = "#HATS catalog\n! more\nobs_collection=gaia\nhats_nrows = 12\n  hats_col_ra:ra\n\nobs_title=a\\=b\\: \\u00e9\n\
            hats_cols_default=one \\\n   two\nempty=\nspaced key\nlast=c\\\\";
        let values = parse(text);
        let get = |key: &str| values.get(key).map(String::as_str);
        assert_eq!(get("obs_collection"), Some("gaia"));
        assert_eq!((get("hats_nrows"), get("hats_col_ra")), (Some("12"), Some("ra")));
        assert_eq!(get("obs_title"), Some("a=b: é"));
        assert_eq!(get("hats_cols_default"), Some("one two"));
        assert_eq!((get("empty"), get("spaced"), get("last")), (Some(""), Some("key"), Some("c\\")));
        assert_eq!(parse("cut=\\u00").get("cut").map(String::as_str), Some("\u{FFFD}"), "an escape that is cut short");
        assert_eq!(parse("cut=a\\").get("cut").map(String::as_str), Some("a"));
    }

    #[test]
    fn written_properties_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let credits = "Gaia: ESA/DPAC = #1!\nline\ttwo \\ é";
        write(&folder.path().join("properties"), &[("obs_ack", credits.into()), ("empty", String::new())]).unwrap();
        assert!(is_hats(folder.path()));
        let read = Properties::read(folder.path()).unwrap();
        assert_eq!((read.get("obs_ack"), read.get("empty")), (Some(credits), None));
        assert_eq!(read.folder(), folder.path());
        let reported = read.wanted("hats_col_ra", "a name").unwrap_err().to_string();
        assert!(reported.contains("properties: hats_col_ra: wanted a name, got nothing"), "{reported}");
        let reported = Properties::read(&folder.path().join("no")).unwrap_err().to_string();
        assert!(reported.contains("hats.properties"), "{reported}");
    }
}
