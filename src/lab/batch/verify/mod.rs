//! Compares a camera with its file, from its own frames: flats, darks and stars.
//!
//! In: a function that exposes (a detector, or a whole imager); out: the measurements of a laboratory. Nothing here
//! reads a detector's parameters: gain, noise and the rest are computed from digital numbers alone, so that the file
//! and the frames are compared independently.
//!
//! * `photon_transfer`: moments of flats in time and in space, the procedure of EMVA 1288 -> [`DataSheet`].
//! * `fidelity`: stars of known light in noisy frames -> [`Fidelity`], errors by brightness.
//! * `export`: flats and darks as files for other programs.
//! * `table`: both as text.

pub mod data_sheet;
pub mod export;
pub mod fidelity;
pub mod photon_transfer;
pub mod table;

pub use data_sheet::DataSheet;
pub use fidelity::Fidelity;
pub use fidelity::StarField;
pub use photon_transfer::{Flat, Procedure, characterise};
