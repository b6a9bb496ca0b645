//! Which reader a file needs, by its beginning and its name; and how large it may be.

use crate::csv::{self, Sense};
use crate::error::{HistoryError, Source};
use crate::{aem, attitude::AttitudeHistory, oem, orbit::OrbitHistory, stk};
use base::input_file::read_bytes;
use std::{fs::File, io::Read, path::Path};

/// Largest file: three million rows of an AEM with rates.
pub const MOST_BYTES: u64 = 512 << 20;

/// A format, by how a file begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Ccsds,
    Stk,
    Table,
}

fn format_of(text: &str) -> Format {
    let begin = text.trim_start_matches('\u{feff}').trim_start();
    if begin.starts_with('<') || begin.starts_with("CCSDS_") || begin.starts_with("COMMENT") {
        Format::Ccsds
    } else if begin.get(..4).is_some_and(|word| word.eq_ignore_ascii_case("stk.")) {
        Format::Stk
    } else {
        Format::Table
    }
}

/// Reads the whole of a file of at most [`MOST_BYTES`] as text; a table in a Parquet file as the text of a table.
///
/// # Errors
/// When it cannot be read, is larger, or is not UTF-8.
pub fn text_of(path: &Path) -> Result<String, HistoryError> {
    if beginning::<4>(path).is_some_and(|begin| begin == *b"PAR1") {
        return parquet_text(path);
    }
    let file = path.display().to_string();
    let refuse = |why: String| HistoryError { file: file.clone(), line: None, why };
    let bytes = read_bytes(path, MOST_BYTES).map_err(|error| refuse(format!("cannot be opened: {error}")))?;
    if let Some(why) = packed(&bytes) {
        return Err(refuse(why));
    }
    String::from_utf8(bytes).map_err(|error| {
        let line = 1 + error.as_bytes()[..error.utf8_error().valid_up_to()].iter().filter(|b| **b == b'\n').count();
        HistoryError { file: file.clone(), line: Some(line), why: "got bytes that are not UTF-8, wanted text".into() }
    })
}

/// Returns why a packed file is not read; `None` for a file that is not packed.
pub fn packed(bytes: &[u8]) -> Option<String> {
    const BEGINNINGS: [(&[u8], &str, &str); 6] = [
        (b"\x1f\x8b", "gzip", "gunzip"),
        (b"BZh", "bzip2", "bunzip2"),
        (b"\xfd7zXZ", "xz", "unxz"),
        (b"\x5d\0\0", "lzma", "unlzma"),
        (b"\x28\xb5\x2f\xfd", "zstd", "unzstd"),
        (b"PK\x03\x04", "zip", "unzip"),
    ];
    let found = BEGINNINGS.into_iter().find(|(begin, _, _)| bytes.starts_with(begin));
    found.map(|(_, by, unpack)| format!("it is packed by {by}; wanted the file itself: unpack it by {unpack}"))
}

/// Returns the first bytes of a file; `None` where it has fewer or cannot be read.
fn beginning<const N: usize>(path: &Path) -> Option<[u8; N]> {
    let mut begin = [0; N];
    // A pipe gives its bytes once.
    let file = path.is_file().then(|| File::open(path))?;
    file.and_then(|mut file| file.read_exact(&mut begin)).ok().map(|()| begin)
}

#[cfg(feature = "parquet")]
fn parquet_text(path: &Path) -> Result<String, HistoryError> {
    crate::parquet_table::text_of(path, MOST_BYTES)
}

#[cfg(not(feature = "parquet"))]
fn parquet_text(path: &Path) -> Result<String, HistoryError> {
    let why = "a Parquet file, which this build does not read: install one that does with \
               `cargo install --locked --path . --features parquet`, or give the table as CSV";
    Err(HistoryError { file: path.display().to_string(), line: None, why: why.into() })
}

/// Returns true for a file that begins as a binary SPICE kernel, or its transfer form.
pub fn is_kernel(path: &Path) -> bool {
    let is_one = |begin: [u8; 8]| [&b"DAF/"[..], b"NAIF/DAF", b"DAFETF"].iter().any(|known| begin.starts_with(known));
    beginning(path).is_some_and(is_one)
}

/// Reads a text of attitudes: CSV, AEM (KVN or XML), STK `.a`. `file` is what errors call it; `sense` is that of a
/// table that does not say it.
///
/// # Errors
/// With the file, the line, what was got and what was wanted.
pub fn attitudes(file: &str, text: &str, sense: Option<Sense>) -> Result<AttitudeHistory, HistoryError> {
    let source = Source { file, text };
    if text.trim_start_matches('\u{feff}').trim_start().starts_with(['{', '[']) {
        return Err(source.whole("JSON; wanted a CCSDS AEM, an STK .a or a table: JSON is read only of elements (OMM)"));
    }
    let format = format_of(text);
    if sense.is_some() && format != Format::Table {
        return Err(source.whole("a file that states its own frames; wanted no sense given for it: leave it out"));
    }
    let mut history = match format {
        Format::Ccsds => aem::read(&source)?,
        Format::Stk => stk::attitudes(&source)?,
        Format::Table => csv::attitudes(&source, sense)?,
    };
    history.find_gaps();
    match history.contradiction() {
        Some(why) => Err(source.whole(why)),
        None => Ok(history),
    }
}

/// Reads the attitudes of a recorded run, also where its rates contradict them: a fault may have been commanded.
///
/// # Errors
/// With the file, the line, what was got and what was wanted.
pub fn recorded_attitudes(file: &str, text: &str) -> Result<AttitudeHistory, HistoryError> {
    csv::attitudes(&Source { file, text }, None)
}

/// Reads a text of an orbit: CSV, OEM (KVN or XML), STK `.e`.
///
/// # Errors
/// With the file, the line, what was got and what was wanted.
pub fn orbit(file: &str, text: &str) -> Result<OrbitHistory, HistoryError> {
    let source = Source { file, text };
    let mut history = match format_of(text) {
        Format::Ccsds => oem::read(&source)?,
        Format::Stk => stk::orbit(&source)?,
        Format::Table => csv::orbit(&source)?,
    };
    history.find_gaps();
    match history.contradiction() {
        Some(why) => Err(source.whole(why)),
        None => Ok(history),
    }
}
