//! The tables of a verification as text.

use crate::verify::{data_sheet::Comparison, fidelity::Fidelity};

/// Returns the sheet beside the values of its file.
pub fn data_sheet(lines: &[Comparison]) -> String {
    let mut text = format!("  {:<18} {:>12} {:>12}  {:<7} {:>10}\n", "", "file", "measured", "", "difference");
    for line in lines {
        let Comparison { name, unit, file, measured, .. } = line;
        let resolved =
            if line.se > line.most { format!("  +-{:.0} % by statistics", 100.0 * line.se) } else { String::new() };
        let verdict = if line.holds() { resolved.as_str() } else { "  *" };
        let error = 100.0 * line.error();
        text +=
            &format!("  {name:<18} {:>12} {:>12}  {unit:<7} {error:>8.2} %{verdict}\n", short(*file), short(*measured));
    }
    text
}

/// Returns a value with five digits.
fn short(value: f64) -> String {
    if value.abs() >= 1e4 { format!("{value:.0}") } else { format!("{value:.4}") }
}

/// Returns errors by brightness; `mag_of` converts electrons to a magnitude.
pub fn fidelity(table: &Fidelity, mag_of: impl Fn(f64) -> f64) -> String {
    let mut text = format!(
        "  {:>6} {:>10} {:>5} {:>8} {:>15} {:>17} {:>10} {:>9} {:>9} {:>8}\n",
        "mag", "electrons", "stars", "SNR", "SNR error", "centroid bias", "scatter", "error", "energy", "error"
    );
    for row in &table.rows {
        let scatter_error =
            if row.scatter_error.is_nan() { "-".into() } else { format!("{:+.2} %", 100.0 * row.scatter_error) };
        text += &format!(
            "  {:>6.2} {:>10.0} {:>5} {:>8.1} {:>+6.2} +-{:>4.2} % {:>8.5} +-{:>7.5} {:>7.4} px {:>9} {:>7.2} % {:>+6.3} %\n",
            mag_of(row.electrons),
            row.electrons,
            row.stars,
            row.snr,
            100.0 * row.snr_error,
            100.0 * row.snr_se,
            row.centroid_bias_px,
            row.centroid_bias_se_px,
            row.scatter_px,
            scatter_error,
            100.0 * row.energy,
            100.0 * row.energy_error
        );
    }
    let b = &table.background;
    text += &format!(
        "  background, {} places: mean {:.2} e- over black, error {:+.3} % of the image's level; spread {:.3} e- rms, error {:+.3} +-{:.3} %\n",
        b.places,
        b.mean_e,
        100.0 * b.mean_error,
        b.sigma_e,
        100.0 * b.sigma_error,
        100.0 * b.sigma_se
    );
    text + "  published for such simulators: SNR within 10 %, centroid 0.01 px, background mean 5 % and spread 10 %, energy > 90 %\n"
}
