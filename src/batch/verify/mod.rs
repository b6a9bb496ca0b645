//! Compares a camera with its file, from its own frames: flats, darks and stars.
//!
//! In: a function that exposes (a detector, or a whole imager); out: the measurements of a laboratory. Nothing here
//! reads a detector's parameters: gain, noise and the rest are computed from digital numbers alone, so that the file
//! and the frames are compared independently.
//!
//! * `flats`: moments of one image and of pairs, in time and in space.
//! * `photon_transfer`: the procedure of EMVA 1288 -> [`DataSheet`].
//! * `linear_fit`: the straight lines in it.
//! * `table`: both as text.
//! * `star_field`, `fidelity`: stars of known light in noisy frames -> [`Fidelity`], errors by brightness.

pub mod data_sheet;
pub mod fidelity;
pub mod flats;
pub mod linear_fit;
pub mod photon_transfer;
pub mod star_field;
pub mod table;

pub use data_sheet::DataSheet;
pub use fidelity::Fidelity;
pub use photon_transfer::{Flat, Procedure, characterise};
pub use star_field::StarField;
