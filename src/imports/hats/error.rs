//! Errors of a HATS catalog.

use stars::layer::LayerError;
use std::path::{Path, PathBuf};

/// Why a catalog was not read or written.
#[derive(Debug, thiserror::Error)]
pub enum HatsError {
    /// The file or folder could not be read or written.
    #[error("{what} {path}: {source}", path = path.display())]
    File {
        /// The action that failed.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A property that this program cannot go on with.
    #[error("{path}: {key}: wanted {wanted}, got {got}", path = path.display())]
    Property {
        /// The file of properties.
        path: PathBuf,
        /// Name of the property.
        key: &'static str,
        /// Accepted values.
        wanted: String,
        /// Its value.
        got: String,
    },
    /// The list of partitions cannot be read.
    #[error("{path}, line {line}: wanted a HEALPix order and pixel in columns Norder and Npix, got \"{got}\"", path = path.display())]
    List {
        /// The list.
        path: PathBuf,
        /// Line of the file, from 1.
        line: usize,
        /// The line.
        got: String,
    },
    /// The files are not those that the list of partitions has.
    #[error("{path}: {what}; fetch or make the catalog again", path = path.display())]
    Partition {
        /// The file or folder.
        path: PathBuf,
        /// Missing, not listed, or shared.
        what: String,
    },
    /// The catalog has not the rows it should have.
    #[error("{path}: {what}: wanted {wanted} rows, got {got}", path = path.display())]
    Rows {
        /// The file or folder.
        path: PathBuf,
        /// The source of the wanted number.
        what: &'static str,
        /// Rows it should have.
        wanted: u64,
        /// Rows there are.
        got: u64,
    },
    /// The file is not Parquet, cut short or damaged.
    #[error("{path}: damaged, or no Parquet file: {why}", path = path.display())]
    Parquet {
        /// The file.
        path: PathBuf,
        /// The reason.
        why: String,
    },
    /// A column is missing, or of a type that holds no such thing.
    #[error("{path}, column {column}: wanted {wanted}, got {got}", path = path.display())]
    Column {
        /// The file.
        path: PathBuf,
        /// Its name.
        column: String,
        /// The wanted type.
        wanted: &'static str,
        /// The type in the file.
        got: String,
    },
    /// The bytes of a column cannot be read.
    #[error("{path}, column {column}: damaged: {why}", path = path.display())]
    Damage {
        /// The file.
        path: PathBuf,
        /// Name of the column.
        column: String,
        /// The reason.
        why: String,
    },
    /// A cell holds something else than it should.
    #[error("{path}, row {row}, column {column}: wanted {wanted}, got {got}", path = path.display())]
    Cell {
        /// The file.
        path: PathBuf,
        /// Row of the file, from 1.
        row: u64,
        /// Name of the column.
        column: String,
        /// Accepted values.
        wanted: &'static str,
        /// The value found.
        got: String,
    },
    /// A row lies outside the pixel of its partition.
    #[error("{path}, row {row}: RA {ra_deg} Dec {dec_deg} deg: wanted pixel {wanted} of order {order}, got {got}", path = path.display())]
    Place {
        /// The file.
        path: PathBuf,
        /// Row of the file, from 1.
        row: u64,
        /// Its right ascension.
        ra_deg: f64,
        /// Its declination.
        dec_deg: f64,
        /// HEALPix order of the partition.
        order: u8,
        /// Pixel of the partition.
        wanted: u64,
        /// Pixel of the place.
        got: u64,
    },
    /// The star cannot be stored, or the disk failed.
    #[error("{path}, row {row}: {source}", path = path.display())]
    Star {
        /// The file.
        path: PathBuf,
        /// Row of the file, from 1.
        row: u64,
        /// Why.
        source: LayerError,
    },
    /// A catalog is written to a folder of its own.
    #[error("{path}: there already: name another folder, or remove it", path = path.display())]
    There {
        /// The folder.
        path: PathBuf,
    },
    /// A catalog is given its name when it is whole.
    #[error("{path:?}: wanted the name of a new folder for the catalog, such as out/sky, got none at its end")]
    Name {
        /// The path.
        path: PathBuf,
    },
    /// The writer of Parquet cannot go on.
    #[error("cannot write {path}: {source}", path = path.display())]
    Writing {
        /// The file.
        path: PathBuf,
        /// Why.
        source: parquet::errors::ParquetError,
    },
    /// A layer cannot be read.
    #[error(transparent)]
    Layer(#[from] LayerError),
    /// The layers cannot make one catalog.
    #[error("{path}: {what}: wanted {wanted}, got {got}", path = path.display())]
    Layers {
        /// The layer.
        path: PathBuf,
        /// The property that is wrong.
        what: &'static str,
        /// Accepted values.
        wanted: String,
        /// Its value.
        got: String,
    },
    /// More stars at one place than a partition may have.
    #[error("pixel {pixel} of order {order}: {stars} stars; wanted at most {most}: raise --max-rows")]
    Crowded {
        /// HEALPix order.
        order: u8,
        /// Pixel.
        pixel: u64,
        /// Stars in it.
        stars: usize,
        /// Most in a partition.
        most: usize,
    },
}

impl HatsError {
    /// Returns a failure of the system with `path`.
    pub(super) fn file(what: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::File { what, path, source }
    }
}
