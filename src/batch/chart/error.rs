//! The refusal of a chart.

use base::refused::Refused;
use sky::astrometry::AstrometryError;

/// A scene's camera was refused.
pub(super) fn camera(why: AstrometryError) -> Refused {
    Refused(format!("a scene's camera: {why}"))
}
