//! Layers + where the camera looks -> the tiles of its field, decoded, in bounded memory.
//!
//! * [`TileSky`] keeps decoded tiles and finds those of a field; a field may be announced, so that its tiles are there
//!   when it comes;
//! * `store`: the tiles in memory, the least lately used given up first;
//! * `reader`: a thread that reads tiles ahead, so that frames in real time touch no file.
//!
//! Two ways to read. *In line* (from the start): tiles that are missing are read when they are asked for, and a field
//! is a function of where it is: for the virtual clock and single images. *Ahead* ([`TileSky::read_ahead`]): a tile
//! that has not been read in time is missing from the field and counted. Either way a field of more stars than fit into
//! memory goes without its faintest layers, counted: never with holes. Tiles of a catalog in memory are decoded at the
//! start. Tests: `tests`.

mod field;
mod reader;
mod store;

pub use field::{Shortfall, TileSky};
pub use store::{Light, TileStar};

#[cfg(test)]
mod tests;
