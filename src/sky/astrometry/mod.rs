//! Catalog sources -> apparent directions (space motion, parallax, deflection, aberration) -> pixels (projection,
//! distortion).
//!
//! [`ApparentPlaces`] composes the first four, in ICRF axes and for one observer's
//! [`Vantage`]; [`CameraGeometry`] does the last two, in sensor axes.
//! The attitude comes between the two; it belongs to `plan::attitude`.

mod apparent;
mod camera;
mod distortion;
mod vantage;

pub use apparent::{ApparentPlaces, PROVEN_YEARS, at_epoch, cone_margin_rad, parallax_shifted, years_since};
pub use camera::{AstrometryError, CameraGeometry, CameraParameters, PixelPosition};
pub use distortion::{BrownConrady, DEGREE as DISTORTION_DEGREE, Distortion, PolynomialDistortion};
pub use vantage::{Aberration, Deflection, Sight, Vantage, aberrated, deflected};
