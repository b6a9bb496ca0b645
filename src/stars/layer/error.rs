//! Errors of a layer.

use crate::catalog::CatalogError;
use std::path::{Path, PathBuf};

/// Why a layer was not written, opened or read.
#[derive(Debug, thiserror::Error)]
pub enum LayerError {
    /// The file could not be read or written.
    #[error("{what} {path}: {source}", path = path.display())]
    File {
        /// The action that failed.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Not a layer at all.
    #[error(
        "{path}: not a star layer: wanted it to begin with \"STARLAY1\", got {got:?}; `starloop catalog import` makes layers of a CSV \
         (what `catalog pack` makes is for `catalog info`, `query` and `map`)",
        path = path.display()
    )]
    Magic {
        /// The file.
        path: PathBuf,
        /// The first bytes, as text.
        got: String,
    },
    /// A field that this program does not know how to read.
    #[error("{path}: {field}: wanted {wanted}, got {got}", path = path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Name of the field.
        field: &'static str,
        /// The value that this program reads.
        wanted: String,
        /// The value in the file.
        got: String,
    },
    /// The file has another length than its head promises.
    #[error(
        "{path}: {got} bytes, wanted {wanted} by its head: half written, cut short or something follows its end; \
         import it again",
        path = path.display()
    )]
    Length {
        /// The file.
        path: PathBuf,
        /// Bytes by its head.
        wanted: u64,
        /// Bytes there are.
        got: u64,
    },
    /// The head's bytes are not those that were written.
    #[error("{path}: damaged: CRC-32 of its head wanted {wanted:08x}, got {got:08x}; import it again", path = path.display())]
    Head {
        /// The file.
        path: PathBuf,
        /// Value stored.
        wanted: u32,
        /// Value of the bytes read.
        got: u32,
    },
    /// A file that takes far less of the disk than it is long.
    #[error(
        "{path}: {bytes} bytes long, but {stored} are on the disk: it has holes where stars should be, as in a copy that \
         was cut short; import it again",
        path = path.display()
    )]
    Holes {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
        /// Bytes of it that are stored.
        stored: u64,
    },
    /// Memory is not there.
    #[error(
        "{path}: its stars want {bytes} bytes of memory more than there are: a smaller field or brighter stars take less, and an \
         import with less --memory-mb",
        path = path.display()
    )]
    Memory {
        /// The file.
        path: PathBuf,
        /// Bytes that were wanted.
        bytes: usize,
    },
    /// The numbers of a tile's stars are not those that were written.
    #[error("{path}: damaged: numbers of the stars of tile {tile}, CRC-32 wanted {wanted:08x}, got {got:08x}; import it again", path = path.display())]
    Numbers {
        /// The file.
        path: PathBuf,
        /// Nested HEALPix index.
        tile: u64,
        /// Value stored.
        wanted: u32,
        /// Value of the bytes read.
        got: u32,
    },
    /// The bytes of a tile are not those that were written.
    #[error(
        "{path}: damaged: tile {tile} of order {order} (about RA {ra_deg:.3} Dec {dec_deg:+.3} deg), CRC-32 wanted \
         {wanted:08x}, got {got:08x}; import it again",
        path = path.display()
    )]
    Tile {
        /// The file.
        path: PathBuf,
        /// Nested HEALPix index.
        tile: u64,
        /// Order of the tiles.
        order: u8,
        /// Its centre.
        ra_deg: f64,
        /// Its centre.
        dec_deg: f64,
        /// Value stored.
        wanted: u32,
        /// Value of the bytes read.
        got: u32,
    },
    /// A star that no layer can hold.
    #[error("source {source_id}: {what}: wanted {wanted}, got {got}")]
    Star {
        /// Which.
        source_id: i64,
        /// The property that is wrong.
        what: &'static str,
        /// Accepted values.
        wanted: String,
        /// Its value.
        got: f64,
    },
    /// The folder of an earlier import does not fit.
    #[error("{path}: {why}; remove the folder to start over", path = path.display())]
    Work {
        /// Where.
        path: PathBuf,
        /// The reason.
        why: String,
    },
    /// Layers of one sky whose positions are of different times.
    #[error("{path}: epoch wanted J{wanted} as of the layers before, got J{got}; import them with one --epoch", path = path.display())]
    Epochs {
        /// The layer.
        path: PathBuf,
        /// Of the first layer.
        wanted: f64,
        /// Of this one.
        got: f64,
    },
    /// Two layers that do not join: stars would come twice, or be missing.
    #[error(
        "{path}: begins at G = {from}, and the layer before it ends at {below}: wanted layers of one import, each where the one \
         before ends",
        path = path.display()
    )]
    Joint {
        /// The fainter layer.
        path: PathBuf,
        /// End of the one before.
        below: f32,
        /// Its start.
        from: f32,
    },
    /// No layer has stars as bright as the camera sees.
    #[error(
        "{path}: the brightest layer begins at G = {from}, and the camera sees stars to {limiting_mag}: wanted the brighter \
         layers too",
        path = path.display()
    )]
    NoneSoBright {
        /// The brightest layer.
        path: PathBuf,
        /// Its start.
        from: f32,
        /// The camera's limit.
        limiting_mag: f32,
    },
    /// The catalog in memory.
    #[error(transparent)]
    Catalog(CatalogError),
    /// A sky of no layers.
    #[error("no layer was named: wanted at least one file as `starloop catalog import` writes them")]
    NoLayer,
}

impl LayerError {
    /// Returns a failure of the system with `path`.
    pub fn file(what: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::File { what, path: path.into(), source }
    }
}
