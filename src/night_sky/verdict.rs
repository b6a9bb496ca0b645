//! The verdict over all frames.

use crate::{compare::Compared, result::Comparison};

/// Returns the verdict: one line.
pub fn verdict(compared: &[Compared]) -> String {
    let good = compared.iter().filter(|one| one.result.agrees).count();
    if good == compared.len() {
        let worst = |of: fn(&Comparison) -> f64| compared.iter().map(|one| of(&one.result)).fold(0.0, f64::max);
        let outliers = match compared.iter().map(|one| one.result.outliers).sum::<usize>() {
            0 => String::new(),
            1 => " (without 1 outlier)".into(),
            count => format!(" (without {count} outliers)"),
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
    // Noise explains no failure of an image whose places are within their limit.
    let is_cause = |words: &&String| !words.starts_with("noise") || one.centroid_robust_px > one.centroid_limit_px;
    let limits = one.limited_by.iter().filter(is_cause).map(|words| format!("limited by {words}"));
    one.failures.iter().cloned().chain(limits).collect::<Vec<_>>().join("; ")
}
