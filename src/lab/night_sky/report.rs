//! Comparisons -> the verdict over all frames, text, JSON, tables of stars.

use crate::compare::Compared;
use crate::result::{Comparison, SCHEMA_VERSION, most_outliers};
use core::fmt::Write;

/// Returns the comparisons as JSON.
///
/// # Errors
/// Never with the figures of this program.
pub fn json(compared: &[Compared]) -> serde_json::Result<String> {
    let images: Vec<&Comparison> = compared.iter().map(|one| &one.result).collect();
    let agrees = images.iter().all(|one| one.agrees);
    serde_json::to_string_pretty(
        &serde_json::json!({ "schema_version": SCHEMA_VERSION, "agrees": agrees, "images": images }),
    )
}

/// Returns the figures as text; the first line is the verdict.
pub fn text(compared: &[Compared]) -> String {
    let mut text = verdict(compared);
    text.push('\n');
    for one in compared {
        let _ = lines(&mut text, &one.result);
    }
    text
}

fn lines(text: &mut String, one: &Comparison) -> core::fmt::Result {
    writeln!(text, "\n{}", one.image)?;
    if let Some(flipped) = &one.flipped {
        writeln!(text, "  image        turned over: its {flipped} are in reverse order")?;
    }
    writeln!(text, "  attitude     RA {:.4}, Dec {:.4}, roll {:.4} deg", one.ra_deg, one.dec_deg, one.roll_deg)?;
    writeln!(
        text,
        "  stars        {} above SNR 20 ({} saturated, {} with a neighbour left out), {} missing; {} found in the image",
        one.stars, one.left_out[0], one.left_out[1], one.missing, one.detections
    )?;
    writeln!(
        text,
        "  centroids    {:.3} px rms without outliers (judged, limit {:.3}); all stars {:.3} ({:.3} along columns, {:.3} along rows); \
         of the drawn frame {:.3}",
        one.centroid_robust_px,
        one.centroid_limit_px,
        one.centroid_rms_px,
        one.centroid_rms_axes_px[0],
        one.centroid_rms_axes_px[1],
        one.drawn_centroid_rms_px
    )?;
    writeln!(
        text,
        "  magnitudes   {:.3} rms without outliers (judged, limit {:.3}); all stars {:.3}; of the drawn frame {:.3}",
        one.mag_robust, one.mag_limit, one.mag_rms, one.drawn_mag_rms
    )?;
    worst_lines(text, one)?;
    let background = &one.background;
    writeln!(
        text,
        "  background   mean {:.1} and {:.1} DN, {:.2} % rms over {} places; noise {:.3} and {:.3} DN, ratio {:.3}",
        background.real_mean_dn,
        background.drawn_mean_dn,
        100.0 * background.mean_difference_rms,
        background.places,
        background.real_noise_dn,
        background.drawn_noise_dn,
        background.noise_ratio
    )?;
    writeln!(
        text,
        "  energy       3 x 3 px: {:.3} and {:.3} ({:+.3}); 5 x 5 px: {:.3} and {:.3}; {} stars",
        one.energy.real[0],
        one.energy.drawn[0],
        one.ensquared_energy_difference,
        one.energy.real[1],
        one.energy.drawn[1],
        one.energy.stars
    )?;
    writeln!(text, "  SNR          drawn less real {:+.1} %", 100.0 * one.snr_difference)?;
    camera_lines(text, one)?;
    if let Some(air) = &one.refraction {
        writeln!(
            text,
            "  air          stretch {:.2e} +- {:.2e}, vertical at {:.0} deg from right towards down; without it {:.3} px rms along an axis",
            air.stretch, air.stretch_error, air.vertical_deg, air.rms_without_px
        )?;
    }
    for words in &one.limited_by {
        writeln!(text, "  limited by   {words}")?;
    }
    Ok(())
}

/// Prints the fitted camera and its light.
fn camera_lines(text: &mut String, one: &Comparison) -> core::fmt::Result {
    writeln!(
        text,
        "  camera       f = {:.4} +- {:.4} mm, k1 {:+.4}; {}; edge {:.3} of the middle (by stars {:+.3} +- {:.3} mag more)",
        one.focal_length_mm[0],
        one.focal_length_mm[1],
        one.k1,
        one.psf,
        one.edge_illumination,
        one.edge_by_stars_mag[0],
        one.edge_by_stars_mag[1]
    )?;
    if let Some(error) = one.k2_error {
        writeln!(text, "               k2 {:+.3} +- {error:.3}", one.k2)?;
    }
    if let Some([across, down]) = one.principal_point_errors_px {
        let [x, y] = one.principal_point_px;
        writeln!(text, "               optical axis at column {x:.1} +- {across:.1}, row {y:.1} +- {down:.1}")?;
    }
    if one.edge_is_by_stars {
        writeln!(text, "               illumination by the stars: the background contradicts them")?;
    }
    writeln!(
        text,
        "  light        {:.3e} e- of G = 0; colour {:+.3}, {:+.3}; gain {:.3} e-/DN, read noise {:.2} e-",
        one.zero_point_e, one.colour[0], one.colour[1], one.gain_e_per_dn, one.read_noise_e
    )
}

/// Stars of the list that are printed.
const MOST_WORST: usize = 8;

/// Prints the stars that are furthest off.
fn worst_lines(text: &mut String, one: &Comparison) -> core::fmt::Result {
    writeln!(
        text,
        "  outliers     {} of {} stars (limit {}, known variables aside); the worst stars:",
        one.outliers,
        one.stars,
        most_outliers(one.stars)
    )?;
    for star in one.worst_stars.iter().take(MOST_WORST) {
        writeln!(text, "    {} {}", if star.is_outlier { "outlier" } else { "       " }, star.words())?;
    }
    Ok(())
}

/// Returns the table of the stars as CSV.
pub(crate) fn table(one: &Comparison) -> String {
    let mut text =
        "mag_g,bp_rp,x_px,y_px,dx_px,dy_px,dmag,snr,drawn_dx_px,drawn_dy_px,drawn_dmag,name,outlier\n".to_owned();
    for star in &one.star_rows {
        let _ = writeln!(
            text,
            "{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{:.2},{:.4},{:.4},{:.4},{},{}",
            star.mag_g,
            star.bp_rp,
            star.x_px,
            star.y_px,
            star.dx_px,
            star.dy_px,
            star.dmag,
            star.snr,
            star.drawn_dx_px,
            star.drawn_dy_px,
            star.drawn_dmag,
            star.name.as_deref().unwrap_or_default(),
            u8::from(star.is_outlier)
        );
    }
    text
}

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
