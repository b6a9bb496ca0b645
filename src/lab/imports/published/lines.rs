//! Text -> its lines, numbered, each of bounded length.
//!
//! A line ends with a line feed, or with a carriage return and a line feed; the last one may end with the text. Empty
//! lines are left out. Memory: one line, whatever the text is. Tests: below, and `starloop_fuzz`'s `star_lines`.

use base::refused::Refused;
use std::io::{BufRead, Read};
use std::path::Path;

/// The lines of a text; `path` is for messages.
pub(super) struct Lines<'a, R> {
    text: R,
    path: &'a Path,
    longest: usize,
    line: Vec<u8>,
    number: u64,
}

/// One line that is not empty.
pub(super) struct TextLine<'a> {
    /// From 1.
    pub(super) number: u64,
    /// Without its end.
    pub(super) text: &'a str,
    /// False where the text ends before the line does.
    pub(super) is_ended: bool,
}

impl<'a, R: BufRead> Lines<'a, R> {
    /// Returns lines of at most `longest` bytes, their ends not counted.
    pub(super) fn new(text: R, path: &'a Path, longest: usize) -> Self {
        Self { text, path, longest, line: Vec::new(), number: 0 }
    }

    /// Returns the next line; `None` after the last.
    pub(super) fn next(&mut self) -> Result<Option<TextLine<'_>>, Refused> {
        let length = loop {
            let Some(length) = self.read()? else { return Ok(None) };
            if length > 0 {
                break length;
            }
        };
        let text = core::str::from_utf8(&self.line[..length]).map_err(|_| {
            Refused(format!(
                "{path}, line {line}: not UTF-8: wanted a table of text, unpacked or as .gz",
                path = self.path.display(),
                line = self.number
            ))
        })?;
        Ok(Some(TextLine { number: self.number, text, is_ended: self.line.ends_with(b"\n") }))
    }

    /// Reads a line, and gives its length without its end.
    fn read(&mut self) -> Result<Option<usize>, Refused> {
        let most = self.longest as u64 + 2;
        self.line.clear();
        let read = (&mut self.text).take(most).read_until(b'\n', &mut self.line);
        if read.map_err(|source| Refused::at(self.path, format_args!("{source}; what was read before is not used")))?
            == 0
        {
            return Ok(None);
        }
        self.number += 1;
        let line = self.line.strip_suffix(b"\n").unwrap_or(&self.line);
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        if line.len() > self.longest {
            let (path, line) = (self.path, self.number);
            return Err(Refused(format!(
                "{path}, line {line}: longer than {longest} bytes: wanted a table of text, one row a line",
                path = path.display(),
                longest = self.longest
            )));
        }
        Ok(Some(line.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &[u8], longest: usize) -> Result<Vec<(u64, String, bool)>, String> {
        let (mut lines, mut all) = (Lines::new(text, Path::new("a.csv"), longest), Vec::new());
        while let Some(line) = lines.next().map_err(|error| error.to_string())? {
            all.push((line.number, line.text.to_owned(), line.is_ended));
        }
        Ok(all)
    }

    #[test]
    fn lines_are_numbered_whatever_ends_them() {
        let wanted =
            [(1, "a", true), (3, "b\r", true), (5, "c", false)].map(|(n, text, end)| (n, text.to_owned(), end));
        assert_eq!(all(b"a\n\nb\r\r\n\r\nc", 3).unwrap(), wanted);
        assert!(all(b"", 3).unwrap().is_empty() && all(b"\n\r\n", 3).unwrap().is_empty());
    }

    #[test]
    fn the_longest_line_is_read_and_a_longer_one_is_not() {
        for end in ["", "\n", "\r\n"] {
            assert_eq!(all(format!("xyz{end}").as_bytes(), 3).unwrap().len(), 1);
            let reported = all(format!("a\nwxyz{end}").as_bytes(), 3).unwrap_err();
            assert!(reported.contains("a.csv, line 2: longer than 3 bytes"), "{reported}");
        }
    }

    #[test]
    fn non_utf8_lines_are_reported() {
        let reported = all(b"a\n\xff\n", 3).unwrap_err();
        assert!(reported.contains("a.csv, line 2: not UTF-8"), "{reported}");
    }
}
