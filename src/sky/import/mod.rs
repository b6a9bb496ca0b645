//! Catalogs as they are published -> stars for layers.
//!
//! * [`gaia`]: the bulk files of Gaia's archive, and any CSV with its column names.
//!
//! Rows are taken in as they stream by; what a row lacks is counted and said, what it should not have ends the import
//! with file, line and column.

mod error;
pub mod gaia;

pub use error::ImportError;
