//! What can be wrong with a published catalog.

use crate::sky::layer::LayerError;
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
    /// The text is no CSV, or cut short within a compressed file.
    #[error("{path}: {source}", path = path.display())]
    Csv {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: csv::Error,
    },
    /// A column is missing.
    #[error("{path}: no column \"{wanted}\"; got {got}", path = path.display())]
    Column {
        /// The file.
        path: PathBuf,
        /// The name looked for.
        wanted: String,
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
