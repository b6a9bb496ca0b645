//! `starloop check`, jitter from a file: its power in bands, and what it does to images.

use base::units::ARCSEC;
use config::{Bench, JitterAxes, JitterFile, JitterInput};
use core::fmt::{Error, Write};
use glam::DVec3;
use plan::attitude::{JitterRecord, RecordEnd, band_power_rad2, psd_variance, smear_power_rad2};
use run::runtime::RunParams;

/// Writes the section about jitter from a file; nothing without any.
///
/// # Errors
/// When the text cannot grow.
pub(super) fn write_jitter(text: &mut String, bench: &Bench, params: &RunParams) -> Result<(), Error> {
    let (Some(input), Some(recorded)) = (&bench.jitter, &params.attitude.jitter_record) else { return Ok(()) };
    write_source(text, bench, input, &recorded.record)?;
    let (frame_hz, exposure_s) = (1.0 / params.frame_period.s(), params.camera.exposure_s);
    let exposure_hz = 1.0 / exposure_s;
    let spectrum = recorded.record.spectrum();
    let total = band_power_rad2(&spectrum, [0.0, f64::INFINITY]);
    let smear = smear_power_rad2(&spectrum, exposure_s);
    writeln!(text, "  rms about            x arcsec    y arcsec    z arcsec")?;
    let edges = [0.0, frame_hz, exposure_hz.max(frame_hz), f64::INFINITY];
    let names = [
        format!("below {frame_hz} Hz"),
        format!("{frame_hz} to {:.4} Hz", edges[2]),
        format!("above {:.4} Hz", edges[2]),
    ];
    for (name, band) in names.iter().zip(edges.windows(2)) {
        write_row(text, name, band_power_rad2(&spectrum, [band[0], band[1]]))?;
    }
    write_row(text, "all", total)?;
    write_row(text, "moves images", (total - smear).max(DVec3::ZERO))?;
    write_row(text, "smears images", smear)?;
    writeln!(text, "  (bands: frame rate and 1/exposure; smear: within one exposure of {exposure_s} s, in the mean)")?;
    text.write_char('\n')
}

fn write_source(text: &mut String, bench: &Bench, input: &JitterInput, record: &JitterRecord) -> Result<(), Error> {
    let JitterInput { path, source, axes, start_s } = input;
    let (axes, rate_hz) = (if *axes == JitterAxes::Sensor { "sensor" } else { "body" }, 1.0 / record.period_s());
    writeln!(text, "jitter from {path}, {axes} axes; it is added where frames are made, and travels over no bus")?;
    match source {
        JitterFile::Density { points, .. } => {
            let rms = root(psd_variance(points)).map(|value| format!("{value:.4}")).join(", ");
            writeln!(text, "  density      {} rows, {rms} arcsec rms about x, y, z", points.len())?;
            writeln!(
                text,
                "  series       made by seed {}: {rate_hz:.1} Hz, repeats every {:.1} s",
                bench.seed,
                record.duration_s()
            )
        }
        JitterFile::Series(_) => {
            let end = if record.end() == RecordEnd::Repeat { "then it repeats" } else { "then nothing" };
            writeln!(
                text,
                "  series       {} samples at {rate_hz:.1} Hz from {start_s} s after the first exposure, {:.3} s long, {end}",
                record.samples().len(),
                record.duration_s()
            )
        }
    }
}

fn write_row(text: &mut String, name: &str, power_rad2: DVec3) -> Result<(), Error> {
    let [x, y, z] = root(power_rad2);
    writeln!(text, "  {name:<18} {x:>10.4}  {y:>10.4}  {z:>10.4}")
}

fn root(power_rad2: DVec3) -> [f64; 3] {
    power_rad2.to_array().map(|power| power.max(0.0).sqrt() / ARCSEC)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Tai;
    use config::Document;
    use run::wiring::bench_parts;

    fn report(rows: &str, keys: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("j.csv"), rows).unwrap();
        let document = Document::from_text(&format!("[jitter]\n{keys}"), &folder.path().join("lab.toml"));
        let bench = Bench::from_document(&document).unwrap();
        let params = bench_parts::run_params(&bench, Tai::from_ns(0)).unwrap();
        let mut text = String::new();
        write_jitter(&mut text, &bench, &params).unwrap();
        text
    }

    fn numbers(text: &str, row: &str) -> Vec<f64> {
        let line =
            text.lines().find(|line| line.trim_start().starts_with(row)).unwrap_or_else(|| panic!("{row}: {text}"));
        line[20..].split_whitespace().map(|word| word.parse().unwrap()).collect()
    }

    #[test]
    fn a_tone_is_in_its_band() {
        let row = |i: i32| {
            let t_s = f64::from(i) * 1e-3;
            format!("{t_s:.3},{:.6},0\n", 2.0 * (core::f64::consts::TAU * 123.4 * t_s).sin())
        };
        let rows = (0..20_000).map(row).fold("t_s,x_arcsec,y_arcsec\n".to_owned(), |text, row| text + &row);
        let text = report(&rows, "series = \"j.csv\"\nat_end = \"repeat\"\n");
        let [below, above, smears] = ["below", "above", "smears images"].map(|row| numbers(&text, row)[0]);
        assert!(
            below < 0.01 && (above - 2.0_f64.sqrt()).abs() < 0.01 && (smears - 2.0_f64.sqrt()).abs() < 0.05,
            "{text}"
        );
        assert!(text.contains("then it repeats") && text.contains("20000 samples"), "{text}");
    }

    #[test]
    fn a_density_has_its_integral() {
        let text = report("f_hz,y_arcsec2_hz\n1,0.5\n201,0.5\n", "density = \"j.csv\"\n");
        assert!((numbers(&text, "all")[1] - 10.0).abs() < 0.01 && text.contains("10.0000"), "{text}");
    }
}
