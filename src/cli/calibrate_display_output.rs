//! Output of every calibration of a display: its date, its plan with the images, its result.

use anyhow::{Context, Result};
use base::clock::{Clock, Monotonic};
use base::time::Tai;
use frames::sink::{png, write_file_atomically};
use outputs::display::calibration::{Fitted, Pattern, Plan};
use outputs::display::{calibration::report::reported, drive::Dither};
use std::path::Path;

/// Name of the plan in its folder.
pub(super) const PLAN: &str = "plan.toml";
/// Refreshes of a dither cycle for which magnitudes are printed.
pub(super) const REPORTED_CYCLE: u32 = 16;

/// Returns the present time.
pub(super) fn now() -> Tai {
    Monotonic::start().now()
}

/// Writes the plan and all images, except for a display that is off.
pub(super) fn write_plan(plan: &Plan, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("the folder {}", folder.display()))?;
    let text = plan.to_toml()?;
    write_file_atomically(&folder.join(PLAN), |out| out.write_all(text.as_bytes()))?;
    for pattern in plan.patterns().into_iter().filter(|pattern| *pattern != Pattern::Dark) {
        write_pattern(plan, pattern, &folder.join(format!("{}.png", pattern.name())))?;
    }
    Ok(())
}

/// Writes greys of 8 bits unchanged; deeper ones as luminances of 16 bits, from which `display show` makes these greys.
pub(super) fn write_pattern(plan: &Plan, pattern: Pattern, path: &Path) -> Result<()> {
    write_file_atomically(path, |out| match plan.display.bits {
        8 => png::write_greys(out, &plan.draw(pattern)),
        _ => png::write_dn_raw(out, &plan.luminances(pattern)),
    })?;
    Ok(())
}

/// Prints the result of a calibration.
pub(super) fn announce(fitted: &Fitted) -> Result<()> {
    print!("{}", reported(&fitted.calibration, &fitted.calibration.calibrated()?, Dither::over(REPORTED_CYCLE)?));
    if fitted.saturated_levels > 0 {
        println!("  note             {} measured levels were left out as saturated", fitted.saturated_levels);
    }
    if !fitted.has_dark {
        println!("  note             no level of `dark` was measured: darkness was taken for nothing");
    }
    Ok(())
}
