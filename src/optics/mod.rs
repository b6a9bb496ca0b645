//! Point-spread function and radiometry.
//!
//! In: magnitude and colour, a PSF model. Out: electrons, and the share of a star's light in each pixel (f64, exact).
//! Fast forms of the pixel integral live with the backends that use them and are measured against this room.

pub mod airy;
pub mod gaussian;
pub mod image_spline;
pub mod measured;
pub mod moffat;
pub mod psf;
pub mod psf_field;
pub mod psf_grid;
pub mod quadrature;
pub mod radiometry;
pub mod spectral_weight;

pub use psf::PsfModel;
pub use psf_field::{PsfField, PsfFieldError};
pub use psf_grid::{PsfGrid, PsfGridError};
pub use radiometry::Radiometry;
pub use spectral_weight::SpectralWeight;
