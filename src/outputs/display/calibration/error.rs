//! Errors of a calibration: it could not be made, or it is refused.

use crate::display::response::ResponseError;
use frames::sink::SinkError;
use sky::astrometry::AstrometryError;
use std::path::PathBuf;

/// Why a display could not be calibrated, or a calibration not be used.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// A plan that cannot be shown.
    #[error("display plan: {name} wanted {wanted}, got {got}")]
    Plan {
        /// Name of the number.
        name: &'static str,
        /// Values that are accepted.
        wanted: String,
        /// Value that was given.
        got: String,
    },
    /// A file that cannot be read.
    #[error("{path}: {reason}")]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Fault that was found.
        reason: String,
    },
    /// A row of measurements that is none.
    #[error(
        "{path}, line {line}: {reason}; wanted the columns pattern,x_px,y_px,flux,luminance,dot,saturated (pattern and what was measured of it; the others may be missing or empty)"
    )]
    Row {
        /// Path of the file.
        path: PathBuf,
        /// Line, the header being 1.
        line: u64,
        /// Fault that was found.
        reason: String,
    },
    /// Too few dots.
    #[error(
        "measured dots: wanted at least {wanted}, got {got} ({unread} whose code could not be read, {unseen} outside the tracker's field, {saturated} saturated); {}",
        if *saturated > *unread { "expose shorter" } else { "expose longer, or darken the laboratory" }
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
        /// Dots in which the camera was at its end.
        saturated: usize,
    },
    /// Levels in which the camera was at its end.
    #[error(
        "levels of the ramp: {left_out} of {of} measurements are saturated, and full grey is nowhere below; measure the whole ramp again by one shorter exposure, which suits full grey"
    )]
    SaturatedLevels {
        /// Measurements that are saturated.
        left_out: usize,
        /// Measurements in all.
        of: usize,
    },
    /// Dots in one part of the display.
    #[error(
        "the dots fitted to enclose {:.0} % of what the tracker sees of the display: wanted at least {:.0} %, as the map is a guess beyond them; measure the dots of the other parts too, or plan more of them with a smaller margin",
        100.0 * got, 100.0 * wanted
    )]
    Coverage {
        /// Least share.
        wanted: f64,
        /// Share within the outermost dots.
        got: f64,
    },
    /// Dots that no map fits.
    #[error(
        "measured dots: wanted {wanted}, got {got}; do the measurements belong to this plan, and is the tracker's camera file right?"
    )]
    NotAMap {
        /// Condition that a display's map meets.
        wanted: &'static str,
        /// Result of these dots.
        got: String,
    },
    /// The fitted map is not a camera.
    #[error("the fitted map is not a camera: {0}")]
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
        /// Path of the file.
        path: PathBuf,
        /// Check sum of the content.
        wanted: String,
        /// Check sum as written in the file.
        got: String,
    },
    /// The calibration is of another display or tracker.
    #[error(
        "calibration measured {measured_utc}: it is of another {what}: wanted {wanted}, got {got}; name the file that belongs to it, or calibrate this one"
    )]
    Mismatch {
        /// Time of the measurement.
        measured_utc: String,
        /// Name of the difference.
        what: &'static str,
        /// Identity of the display or tracker in use.
        wanted: String,
        /// Identity in the calibration.
        got: String,
    },
    /// The calibration is too old, or from the future.
    #[error(
        "calibration measured {measured_utc}: wanted an age of 0 to {valid_days} days, got {age_days:.1}; calibrate again, or set this machine's clock"
    )]
    Stale {
        /// Time of the measurement.
        measured_utc: String,
        /// Time for which it is valid, days.
        valid_days: u32,
        /// Age, days.
        age_days: f64,
    },
    /// The file could not be written.
    #[error(transparent)]
    Write(#[from] SinkError),
}
