//! Deep star layers on disk: stars in any order -> one file per range of magnitude -> cone queries.
//!
//! * [`Sorting`] takes stars in, as importers read them, sorts them on disk in bounded memory, and writes layers;
//! * [`Layer`] opens one: its head (some MB) in memory, its stars read by tile and checked as they are read;
//! * [`LayerSet`] makes one sky of several.
//!
//! Positions are ICRS at the catalog's epoch. Stored values differ from those given by at most 0.36 mas (at order 6,
//! and half of it with each order more), 0.025 mas/yr (1.25 beyond 1.4 arcsec/yr), 0.01 mas of parallax, 0.5 mmag of
//! magnitude and colour. Numbers of stars in their source catalogs are kept, unless they were not asked for. Unknown
//! colours have a code of their own in the file and are read as [`UNKNOWN_BP_RP_MAG`]. Tests: `tests` (round trip,
//! brute force, resuming, damage), and on real rows `hil_scripts/tests/test_catalog.py`.

mod build;
mod error;
mod layout;
mod open;
mod restored;
mod runs;
mod set;
mod star;
mod writer;

pub use build::{LEAST_MEMORY_BYTES, MEMORY_BYTES, Sorting, layer_name};
pub use layout::{FASTEST_MAS_YR, StarRecord, order_for, tiles_of};
pub use open::{Layer, UNKNOWN_BP_RP_MAG, is_layer};
pub use set::{LayerSet, TileId};
pub use star::{NewStar, StarCounts, TakenStar, tile_records};
pub use writer::{Head, LayerReport, LayerWriter, UnnamedLayer};

#[cfg(test)]
mod tests;
