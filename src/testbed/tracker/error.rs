//! Why a tracker cannot be made, and why a frame gave no attitude.

/// Why a tracker's parameters or guide stars are refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrackerError {
    /// A parameter is out of its range.
    #[error("tracker parameter {name}: wanted {wanted}, got {got}")]
    Parameter {
        /// Its name, with unit.
        name: &'static str,
        /// Accepted values.
        wanted: &'static str,
        /// The value found.
        got: f64,
    },
    /// The lens distortion cannot be undone inside the field.
    #[error(
        "tracker distortion k1, k2, p1, p2, k3 = {distortion:?}: wanted one that can be inverted at the image corner \
         ({x_px}, {y_px}) px, got a fold there; refit it over the whole field"
    )]
    Distortion {
        /// The coefficients.
        distortion: [f64; 5],
        /// Column of the corner, px.
        x_px: f64,
        /// Row of the corner, px.
        y_px: f64,
    },
    /// The catalog has too few stars brighter than the limit to know a field by.
    #[error("guide stars brighter than G {limiting_mag}: wanted at least {wanted}, got {got}; raise limiting_mag")]
    TooFewGuideStars {
        /// The limit asked for, Gaia G.
        limiting_mag: f64,
        /// Fewest that make sense.
        wanted: usize,
        /// How many there are.
        got: usize,
    },
}

/// Why a frame gave no attitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Reason {
    /// The image has other dimensions than the detector.
    #[error("the image is not of the detector's size")]
    ImageSize,
    /// Fewer spots than an identification needs.
    #[error("too few stars")]
    TooFewStars,
    /// No pattern of the catalog fits the spots.
    #[error("no pattern of the catalog fits")]
    NoMatch,
    /// A pattern fits, yet too few stars confirm it to exclude chance.
    #[error("a pattern fits but chance is not excluded")]
    Ambiguous,
    /// Stars match, but not within their errors.
    #[error("the residuals are larger than the stars' errors")]
    ResidualTooLarge,
    /// Most of the image is at the end of the converter's range.
    #[error("the image is saturated")]
    Saturated,
    /// The background leaves too little range for stars, or is too structured to find stars in it.
    #[error("the background is too bright or too uneven")]
    StrayLight,
}
