//! Why a tracker cannot be made, and why a frame gave no attitude.

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
