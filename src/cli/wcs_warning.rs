//! The warning of a lens that FITS headers cannot follow.

use scene::wcs::PROMISED_PX;

/// Warns of a map to the sky that is worse than promised.
pub(super) fn warn_of_wcs(error_px: f64) {
    if error_px > PROMISED_PX {
        eprintln!(
            "WARNING: the WCS in FITS headers is off by up to {error_px:.3} px (promised: {PROMISED_PX}): polynomials of the \
             ninth order do not follow this lens over the whole image; WCSERR states it in each frame"
        );
    }
}
