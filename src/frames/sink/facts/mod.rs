//! The facts of a frame: one table with the names and forms under which each output writes them.
//!
//! In: a frame. Out: for each output, in the order of [`TABLE`] (binary layouts: by place), the facts it has. The
//! writers walk the table: `fits::keywords`, `frame_log`, `shared_memory`, and outside this crate the network camera's
//! chunk data, the live view and the control socket. So a new fact is a row of `table`, and a field of
//! [`FrameMeta`](crate::sink::FrameMeta) where it is new there too; the code that knows the value fills that in.
//!
//! Outputs deliberately have fewer facts than the table:
//!
//! * FITS has all facts except those that only JSON needs; [`crate::sink::wcs`] is a map, not a fact, and has writers of its own;
//! * the frame log has the facts that change from frame to frame: the camera's own numbers are in FITS;
//! * shared memory has 256 bytes for all of them (`firmware_protocol/FRAMES.md`, version 1);
//! * chunk data has a fixed layout which only grows at its end;
//! * the live view has the facts that its page shows, the control socket those that a program needs to step a run.
//!
//! Tour: `value` (a fact, and how it is written) -> `row` (a fact's names) -> `table` -> `reference` (the table for
//! people, `src/guide/frame_facts.md`). Tests: `tests`, and `pinned_tests`: every output byte by byte (those of other
//! crates beside their writers).

mod json;
#[cfg(test)]
mod pinned_tests;
#[cfg(test)]
mod reference;
mod row;
mod table;
#[cfg(test)]
mod tests;
mod value;

pub use json::{json, json_keys};
pub use row::{Card, Column, Feature, FeatureKind, Key, Part, Place, Row, Stored};
pub use table::TABLE;
pub use value::{Fact, FactSource, Form, Kind, Scalar};
