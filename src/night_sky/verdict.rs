//! The verdict over all frames.

use crate::compare::Compared;
use crate::result::Comparison;

/// Returns the verdict: one line.
#[must_use]
pub fn verdict(compared: &[Compared]) -> String {
    let good = compared.iter().filter(|one| one.result.agrees).count();
    if good == compared.len() {
        let worst = |of: fn(&Comparison) -> f64| compared.iter().map(|one| of(&one.result)).fold(0.0, f64::max);
        let outliers = match compared.iter().map(|one| one.result.outliers).sum::<usize>() {
            0 => String::new(),
            count => format!(" (both without {count} outliers)"),
        };
        format!(
            "AGREES: {good} of {good} images: centroids within {:.3} px rms, magnitudes {:.3}{outliers}, noise {:.1} %, energy {:.1} %",
            worst(|one| one.centroid_robust_px),
            worst(|one| one.mag_robust),
            100.0 * worst(|one| (one.background_noise_ratio - 1.0).abs()),
            100.0 * worst(|one| one.ensquared_energy_difference.abs())
        )
    } else {
        let first = compared.iter().find(|one| !one.result.agrees);
        let why = first.map_or_else(String::new, |one| format!("{}: {}", one.result.image, reasons(&one.result)));
        format!("DOES NOT AGREE: {} of {} images; {why}", compared.len() - good, compared.len())
    }
}

/// Returns what one image fails, and what limits it.
fn reasons(one: &Comparison) -> String {
    let limits: Vec<String> = one.limited_by.iter().map(|words| format!("limited by {words}")).collect();
    one.failures.iter().chain(&limits).map(String::as_str).collect::<Vec<_>>().join("; ")
}
