//! Errors of a catalog.

use std::path::PathBuf;

/// Why a catalog was not packed or not opened.
#[derive(Debug, thiserror::Error)]
pub enum CatalogError {
    /// The file could not be read or written.
    #[error("catalog {path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Fewer bytes than the header promises.
    #[error("packed catalog is cut short: wanted {wanted} bytes for its {part}, got {got}; copy or pack it again")]
    Truncated {
        /// The part that does not fit.
        part: &'static str,
        /// Bytes needed from the start of the file.
        wanted: usize,
        /// Bytes there are.
        got: usize,
    },
    /// More bytes than the header promises.
    #[error("packed catalog has {got} bytes, wanted {wanted}: something follows its end")]
    TrailingBytes {
        /// Bytes the header promises.
        wanted: usize,
        /// Bytes there are.
        got: usize,
    },
    /// Not a packed catalog at all.
    #[error(
        "not a packed star catalog: wanted it to begin with \"STARCAT1\", got {got:?}; a CSV is packed by `starloop catalog pack`"
    )]
    Magic {
        /// The first bytes, as text.
        got: String,
    },
    /// A layout this program does not know.
    #[error("packed catalog: {field} wanted {wanted}, got {got}")]
    Layout {
        /// Name of the header field.
        field: &'static str,
        /// The value that this program reads.
        wanted: String,
        /// The value in the file.
        got: String,
    },
    /// The bytes are not those that were written.
    #[error("packed catalog is damaged: CRC-32 wanted {wanted:08x}, got {got:08x}; copy or pack it again")]
    Checksum {
        /// Value stored in the header.
        wanted: u32,
        /// Value of the bytes read.
        got: u32,
    },
    /// Tile offsets that do not grow from 0 to the number of stars, or stars out of order: a writer's mistake.
    #[error("packed catalog, tile {tile}: {why}")]
    Tile {
        /// Nested HEALPix index of the tile.
        tile: usize,
        /// The reason.
        why: String,
    },
    /// The CSV lacks columns.
    #[error(
        "catalog CSV: no column {missing}; got {got}; cells may be blank, or take the CSV in by `starloop catalog import`, \
         which reads Gaia's column names and, by --column, others"
    )]
    Columns {
        /// The names looked for.
        missing: String,
        /// The header line.
        got: String,
    },
    /// The text is not CSV, or could not be read.
    #[error("catalog CSV: {0}")]
    Csv(#[from] csv::Error),
    /// A cell holds something else than a number in range.
    #[error("catalog CSV, line {line}, column {column}: wanted {wanted}, got \"{got}\"")]
    Cell {
        /// Line of the file, from 1.
        line: u64,
        /// Name of the column.
        column: &'static str,
        /// Accepted values.
        wanted: String,
        /// The text found.
        got: String,
    },
    /// More stars or text than a catalog in memory is meant to hold.
    #[error(
        "packed catalog: {count} {what}, wanted at most {most}: `starloop catalog import` takes any number of stars"
    )]
    TooMany {
        /// The counted items.
        what: &'static str,
        /// How many.
        count: usize,
        /// The format's limit.
        most: usize,
    },
}
