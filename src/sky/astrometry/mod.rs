//! Catalog sources -> apparent directions (space motion, parallax, deflection, aberration) -> pixels (projection,
//! distortion).
//!
//! [`apparent_places`] composes the first four, in ICRF axes and for one observer's
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
pub use apparent::{PROVEN_YEARS, apparent_places, cone_margin_rad, years_since};
pub use camera::{CameraGeometry, CameraParameters, PixelPosition};
pub use deflection::{Deflection, deflected};
pub use distortion::{BrownConrady, Distortion};
pub use distortion_polynomial::{DEGREE as DISTORTION_DEGREE, PolynomialDistortion};
pub use error::AstrometryError;
pub use parallax::parallax_shifted;
pub use space_motion::at_epoch;
pub use vantage::{Sight, Vantage};

use glam::DVec3;

/// A source as the moving observer sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ApparentSource {
    /// Row of the source in its catalog (stable: the built-in catalog is part of the program).
    pub id: u32,
    /// Apparent direction, unit vector in ICRF axes.
    pub apparent_icrf: DVec3,
    /// Gaia G magnitude.
    pub mag_g: f32,
    /// Gaia colour BP - RP, mag.
    pub bp_rp: f32,
}
