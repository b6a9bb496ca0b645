//! Errors of a published catalog.

use stars::layer::LayerError;
use std::path::PathBuf;

/// Why an import ended.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The file could not be read: gone, cut short, or its compression is damaged.
    #[error("{path}: {source}; what was read before is not used", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// A line that no table has.
    #[error("{path}, line {line}: longer than {longest} bytes: wanted a table of text, one row a line", path = path.display())]
    LongLine {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        line: u64,
        /// Bytes that are read.
        longest: usize,
    },
    /// Bytes that are not UTF-8.
    #[error("{path}, line {line}: not UTF-8: wanted a table of text, unpacked or as .gz", path = path.display())]
    NoText {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        line: u64,
    },
    /// A row has not the cells that the header names.
    #[error(
        "{path}, line {line}: wanted {wanted} cells as the header has, got {got}; the file may be cut short, or a cell has a \
         comma in it",
        path = path.display()
    )]
    Cells {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        line: u64,
        /// Cells of the header.
        wanted: usize,
        /// Cells of the row.
        got: usize,
    },
    /// Columns are missing.
    #[error(
        "{path}: no column {missing}; got {got}; say what the file calls them, such as --column phot_g_mean_mag=NAME, or that it \
         has none, such as --column pmra= (of pmra, pmdec, parallax and bp_rp)",
        path = path.display()
    )]
    Columns {
        /// The file.
        path: PathBuf,
        /// The names looked for.
        missing: String,
        /// The header line.
        got: String,
    },
    /// A cell holds something else than it should.
    #[error("{path}, line {line}, column {column}: wanted {wanted}, got \"{got}\"", path = path.display())]
    Cell {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// Accepted values.
        wanted: &'static str,
        /// The text found.
        got: String,
    },
    /// The star cannot be stored, or the disk failed.
    #[error("{path}, line {line}: {source}", path = path.display())]
    Star {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        line: u64,
        /// Why.
        source: LayerError,
    },
}
