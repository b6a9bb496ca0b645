//! Why there is no calibration, or why one is refused.

use crate::astrometry::AstrometryError;
use crate::display::response::ResponseError;
use crate::sink::SinkError;
use std::path::PathBuf;

/// Why a display could not be calibrated, or a calibration not be used.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// A plan that cannot be shown.
    #[error("display plan: {name} wanted {wanted}, got {got}")]
    Plan {
        /// Name of the number.
        name: &'static str,
        /// What would do.
        wanted: String,
        /// What was given.
        got: String,
    },
    /// A file that cannot be read.
    #[error("{path}: {reason}")]
    File {
        /// Which.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A row of measurements that is none.
    #[error(
        "{path}, line {line}: {reason}; wanted the columns pattern,x_px,y_px,flux,luminance,dot (pattern and what was measured of it; the others may be missing or empty)"
    )]
    Row {
        /// Which file.
        path: PathBuf,
        /// Line, the header being 1.
        line: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// Too few dots.
    #[error(
        "measured dots: wanted at least {wanted}, got {got} ({unread} whose code could not be read, {unseen} outside the tracker's field); expose longer, or darken the room"
    )]
    FewDots {
        /// Fewest that do.
        wanted: usize,
        /// Dots with a number and a direction.
        got: usize,
        /// Centroids without a number.
        unread: usize,
        /// Centroids without a direction.
        unseen: usize,
    },
    /// Dots that no map fits.
    #[error(
        "measured dots: wanted {wanted}, got {got}; do the measurements belong to this plan, and is the tracker's camera file right?"
    )]
    NotAMap {
        /// What a display's map does.
        wanted: &'static str,
        /// What these do.
        got: String,
    },
    /// The fitted map is no camera.
    #[error("the fitted map is no camera: {0}")]
    Geometry(#[from] AstrometryError),
    /// No response.
    #[error("{0}")]
    Response(#[from] ResponseError),
    /// No flat field.
    #[error("flat field: {0}")]
    Flat(String),
    /// Changed since it was written.
    #[error(
        "{path}: damaged or edited: wanted the check sum {wanted} of its content, got {got}; calibrate again, or fetch the original"
    )]
    Damaged {
        /// Which file.
        path: PathBuf,
        /// Of the content.
        wanted: String,
        /// As written in the file.
        got: String,
    },
    /// Of something else.
    #[error(
        "calibration of {made_utc}: it is of another {what}: wanted {wanted}, got {got}; name the file that belongs to it, or calibrate this one"
    )]
    Mismatch {
        /// When it was made.
        made_utc: String,
        /// In what it differs.
        what: &'static str,
        /// What is in use.
        wanted: String,
        /// What the calibration is of.
        got: String,
    },
    /// Too old, or from the future.
    #[error(
        "calibration of {made_utc}: wanted an age of 0 to {valid_days} days, got {age_days:.1}; calibrate again, or set this machine's clock"
    )]
    Stale {
        /// When it was made.
        made_utc: String,
        /// How long it is valid.
        valid_days: u32,
        /// How old it is.
        age_days: f64,
    },
    /// It could not be written.
    #[error(transparent)]
    Write(#[from] SinkError),
}
