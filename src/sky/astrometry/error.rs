//! Errors of a camera's geometry.

/// Why a camera geometry was refused.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum AstrometryError {
    /// A number is out of range or not finite.
    #[error("camera geometry: {parameter} wanted {wanted}, got {got}")]
    Parameter {
        /// Name of the parameter, with its unit.
        parameter: &'static str,
        /// Accepted range.
        wanted: &'static str,
        /// Value given.
        got: f64,
    },
    /// The distortion model folds over inside the image.
    #[error(
        "camera geometry: distortion is one-to-one only to {limit_deg:.2} deg off axis and no direction reaches the image corner at ({x_px}, {y_px}) px; check signs and units of the coefficients (k1, k2, k3, p1, p2, or the polynomial's: all for lengths in focal lengths)"
    )]
    DistortionFolds {
        /// Off-axis angle to which the model may be used, deg.
        limit_deg: f64,
        /// Column of the corner, px.
        x_px: f64,
        /// Row of the corner, px.
        y_px: f64,
    },
    /// Two models of distortion at once.
    #[error(
        "camera geometry: wanted one model of distortion, got Brown and Conrady's coefficients and a polynomial; put their terms into the polynomial"
    )]
    TwoDistortions,
}
