//! Why a file of attitudes or of an orbit is refused: file, line, what was got, what was wanted, how to repair it.

/// Why a file is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}{}: {why}", line.map_or_else(String::new, |line| format!(":{line}")))]
pub struct HistoryError {
    /// The file, as it was named.
    pub file: String,
    /// Line, from 1; `None` where the whole file is meant.
    pub line: Option<usize>,
    /// The given value, the wanted one, and advice.
    pub why: String,
}

/// A text with the name of its file, for error messages.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Source<'a> {
    pub(crate) file: &'a str,
    pub(crate) text: &'a str,
}

/// Longest part of a file that a message quotes, characters.
const QUOTED: usize = 60;

impl Source<'_> {
    /// Returns the error of what is at this byte of the text.
    pub(crate) fn refuse(&self, offset: usize, got: &str, wanted: &str) -> HistoryError {
        self.at_line(self.line(offset), got, wanted)
    }

    /// Returns the line of a byte, from 1.
    pub(crate) fn line(&self, offset: usize) -> usize {
        let before = self.text.as_bytes().get(..offset).unwrap_or_default();
        1 + before.iter().filter(|byte| **byte == b'\n').count()
    }

    /// Returns the error of what is at this byte, in words of its own.
    pub(crate) fn because(&self, offset: usize, why: &str) -> HistoryError {
        HistoryError { why: why.to_owned(), ..self.refuse(offset, "", "") }
    }

    /// Returns the error of a line.
    pub(crate) fn at_line(&self, line: usize, got: &str, wanted: &str) -> HistoryError {
        let why = format!("got {}, wanted {wanted}", quoted(got));
        HistoryError { file: self.file.to_owned(), line: Some(line), why }
    }

    /// Returns the error of the whole file.
    pub(crate) fn whole(&self, why: impl Into<String>) -> HistoryError {
        HistoryError { file: self.file.to_owned(), line: None, why: why.into() }
    }
}

/// Returns a piece of a file as messages show it: short, without control characters.
fn quoted(text: &str) -> String {
    let text = text.trim();
    let is_long = text.chars().count() > QUOTED;
    let shown: String = text.chars().take(QUOTED).map(|c| if c.is_control() { ' ' } else { c }).collect();
    format!("\"{shown}{}\"", if is_long { "..." } else { "" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_file_and_line_and_quote_little() {
        let source = Source { file: "a.aem", text: "one\ntwo\nthree\n" };
        assert_eq!(source.refuse(4, "two", "2").to_string(), "a.aem:2: got \"two\", wanted 2");
        assert_eq!(source.whole("no rows").to_string(), "a.aem: no rows");
        let long = source.refuse(0, &"x".repeat(1000), "less").to_string();
        assert!(long.len() < 100 && long.contains("..."), "{long}");
    }
}
