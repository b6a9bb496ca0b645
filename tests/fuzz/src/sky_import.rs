//! `starloop::sky::import`.

#[path = "../../../src/sky/import/add_bright.rs"]
mod add_bright;
#[path = "../../../src/sky/import/bands.rs"]
mod bands;
#[path = "../../../src/sky/import/bright.rs"]
pub mod bright;
#[path = "../../../src/sky/import/crossmatch.rs"]
mod crossmatch;
#[path = "../../../src/sky/import/error.rs"]
mod error;
#[path = "../../../src/sky/import/gaia.rs"]
pub mod gaia;
#[path = "../../../src/sky/import/hipparcos.rs"]
mod hipparcos;
#[path = "../../../src/sky/import/lines.rs"]
mod lines;
#[path = "../../../src/sky/import/tycho.rs"]
mod tycho;

pub use add_bright::add_bright;
pub use error::ImportError;
