//! `starloop check`, a calibrated display: the stars of a frame that it cannot show as they are.
//!
//! Input: the run as it is drawn for the display, and its calibration. Output: text. Stars brighter than the display
//! are counted as if at rest in the middle of a pixel; stars beyond the outermost dots are where the map is
//! extrapolated.

use anyhow::Result;
use core::fmt::Write;
use outputs::display::calibration::report::peak_share;
use outputs::display::calibration::{Calibrated, Calibration};
use plan::exposure::ExposurePlan;
use run::runtime::RunParams;

/// Limits of a display: its calibration, and the brightest star that it can show.
pub(super) struct DisplayLimits {
    calibrated: Calibrated,
    /// Electrons, as the run counts them, of a pixel of full grey.
    full_px_e: f64,
    /// Largest share of a star in one pixel.
    peak_share: f64,
    /// The brightest star that is nowhere clipped.
    brightest_mag: f64,
}

/// Returns the limits of the display that `params` are drawn for, if its calibration has fluxes.
///
/// # Errors
/// When a number of the calibration is out of range.
pub(super) fn display_limits(calibration: &Calibration, params: &RunParams) -> Result<Option<DisplayLimits>> {
    let Some(light) = &calibration.light else { return Ok(None) };
    Ok(Some(DisplayLimits {
        calibrated: calibration.calibrated()?,
        full_px_e: params.camera.detector.full_well_e,
        peak_share: peak_share(light.spot_sigma_px),
        brightest_mag: light.brightest_mag,
    }))
}

/// Returns stars of one planned frame that are too bright, or where the map is a guess.
///
/// # Errors
/// When the text cannot grow.
pub(super) fn write_frame(text: &mut String, limits: &DisplayLimits, plan: &ExposurePlan) -> Result<()> {
    let DisplayLimits { calibrated, full_px_e, peak_share, brightest_mag } = limits;
    let size_px = [plan.camera.width_px(), plan.camera.height_px()].map(|side| side as f64 - 0.5);
    let is_shown = |[x, y]: [f64; 2]| x > -0.5 && y > -0.5 && x < size_px[0] && y < size_px[1];
    let (mut shown, mut bright, mut beyond) = (0_u32, 0_u32, 0_u32);
    for star in plan.stars.iter().filter(|star| is_shown(star.mean_px)) {
        let px = calibrated.geometry.shown(star.mean_px);
        shown += 1;
        bright += u32::from(star.electrons * peak_share > full_px_e * calibrated.flat.at(px));
        beyond += u32::from(!calibrated.geometry.covered().contains(px));
    }
    let word = if bright + beyond > 0 { "WARNING" } else { "display" };
    writeln!(
        text,
        "  {word:<12} {shown} stars on the display: {bright} too bright for it (clipped; up to {brightest_mag:.2} mag fit \
         anywhere), {beyond} beyond the calibrated dots, where the map is a guess"
    )?;
    Ok(())
}
