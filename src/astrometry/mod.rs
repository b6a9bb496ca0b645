//! Catalog sources -> apparent directions (space motion, parallax, aberration) -> pixels (projection, distortion).

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
