//! Errors of a calibration: it could not be made, or it is refused.

use base::refused::Refused;
use std::{fmt::Display, path::Path};

/// A file that cannot be read.
pub(crate) fn file(path: &Path, reason: impl Display) -> Refused {
    Refused::at(path, reason)
}

/// Too few dots.
pub(crate) fn few_dots(wanted: usize, got: usize, unread: usize, unseen: usize, saturated: usize) -> Refused {
    Refused(format!(
        "measured dots: wanted at least {wanted}, got {got} ({unread} whose code could not be read, {unseen} outside the tracker's field, {saturated} saturated); {}",
        if saturated > unread { "expose shorter" } else { "expose longer, or darken the laboratory" }
    ))
}

/// Dots that no map fits.
pub(crate) fn not_a_map(wanted: &'static str, got: impl Display) -> Refused {
    Refused(format!(
        "measured dots: wanted {wanted}, got {got}; do the measurements belong to this plan, and is the tracker's camera file right?"
    ))
}

/// The calibration is of another display or tracker.
pub(crate) fn mismatch(
    measured_utc: impl Display,
    what: &'static str,
    wanted: impl Display,
    got: impl Display,
) -> Refused {
    Refused(format!(
        "calibration measured {measured_utc}: it is of another {what}: wanted {wanted}, got {got}; name the file that belongs to it, or calibrate this one"
    ))
}

/// The fitted map is not a camera.
pub(crate) fn not_a_camera(why: impl Display) -> Refused {
    Refused(format!("the fitted map is not a camera: {why}"))
}
