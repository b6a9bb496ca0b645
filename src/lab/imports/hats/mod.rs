//! HATS catalogs: Parquet files partitioned by HEALPix, as clusters make and archives host them -> layers, and back.
//!
//! * [`HatsCatalog`] opens one: its partitions are there, listed, disjoint, and have as many rows as it says;
//! * [`import()`] reads a Parquet file, of a partition or on its own, into a [`stars::layer::Sorting`];
//! * [`export()`] writes layers as a catalog that readers of HATS open.
//!
//! Limits: catalogs of kind "object"; pages plain or of dictionaries, unpacked, Snappy or Zstandard. Parquet has a
//! checksum of a page at most, and most writers leave it out (the one used here has none): what is said of damage is
//! that a file is refused when its bytes make no sense, or not the rows, places and ranges that they should make.
//! Layers have checksums of everything. Source: IVOA Note "HATS"; tests: `tests`, and with other people's programs
//! `hil_scripts/tests/test_hats.py`.

mod catalog;
mod export;
mod file;
mod pixel;
mod properties;
mod rows;
mod writer;

pub use catalog::{HatsCatalog, Partition};
pub use export::{ExportReport, Exporting, export};
pub use pixel::Pixel;
pub use rows::{COARSE_PLACES, STARLOOP_ID, import};

#[cfg(test)]
mod tests;
