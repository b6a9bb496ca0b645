//! Catalog sources -> apparent directions (space motion, parallax, deflection, aberration) -> pixels (projection,
//! distortion).
//!
//! [`ApparentPlaces`] composes the first four, in ICRF axes and for one observer's
//! [`Vantage`]; [`CameraGeometry`] does the last two, in sensor axes.
//! The attitude comes between the two; it belongs to `plan::attitude`.

mod aberration;
mod apparent;
mod camera;
mod deflection;
mod distortion;
mod distortion_polynomial;
mod error;
mod parallax;
mod space_motion;
mod vantage;

pub use aberration::{Aberration, aberrated};
pub use apparent::{ApparentPlaces, PROVEN_YEARS, cone_margin_rad, years_since};
pub use camera::{CameraGeometry, CameraParameters, PixelPosition};
pub use deflection::{Deflection, deflected};
pub use distortion::{BrownConrady, Distortion};
pub use distortion_polynomial::{DEGREE as DISTORTION_DEGREE, PolynomialDistortion};
pub use error::AstrometryError;
pub use parallax::parallax_shifted;
pub use space_motion::at_epoch;
pub use vantage::{Sight, Vantage};
