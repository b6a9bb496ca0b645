//! `starloop snr`: how bright a star must be for a camera to see it, and how bright it may be.

use crate::cli::facts::Facts;
use crate::cli::named::{drawn_mag, drawn_text, named_camera, radiometry_text};
use anyhow::{Context, Result, bail};
use clap::Args;
use config::Camera;
use frames::report::plot::{Axis, Chart, Series, Style, to_svg};
use frames::sink::write_file_atomically;
use plan::optics::{radiometry::mag_v, star_light::surface_brightness_e_per_s_px};
use run::wiring::camera_parts::camera_params;
use run::wiring::sensitivity::{Conditions, Sensitivity};
use serde_json::json;
use std::path::PathBuf;

/// Ratios whose magnitudes are printed.
const LIMITS: [f64; 2] = [3.0, 5.0];
/// Rows of a table whose range was not given: about as many.
const ROWS: f64 = 16.0;
/// Steps between rows, mag.
const STEPS_MAG: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
/// Most rows of a table.
const MOST_ROWS: usize = 1000;
/// Points of a curve.
const CURVE_POINTS: usize = 200;
/// How far a table and a curve go beyond saturation and the limit at SNR 3, mag.
const BEYOND_MAG: f64 = 1.0;
/// Range of a table when no star saturates, or none is found.
const RANGE_WHERE_NONE: (f64, f64) = (-1.0, 10.0);

/// Command line of `snr`.
#[derive(Debug, Args)]
#[command(
    after_help = "Columns, electrons of one frame: signal, the star's electrons in the window; peak, those in its \
                  brightest pixel; then the noise of the window's sum by its sources (shot noise of the star, of the dark \
                  signal and of the background; readout; rounding of the converter), rms. SNR: signal over all of \
                  these; optimal: of the sum weighted pixel by pixel by signal over variance, the best a linear \
                  measurement can do. PRNU and DSNU are patterns: the same in every frame, not in the SNR.\n\n\
                  The star is on the centre of a pixel; the camera's even background counts; light that \
                  depends on where it looks, motion, defects and effects between pixels are left out.\n\n\
                  Examples:\n  starloop snr cameras/star_tracker_20deg.toml\n  \
                  starloop snr my_bench.toml --bp-rp 1.5 --exposure 0.2 --plot snr.svg\n  \
                  starloop snr cameras/detection_limit_22mag.toml --mag-range 20:23:0.25"
)]
pub struct SnrArgs {
    /// Camera or bench file (TOML), or the name of a built-in one; without it: the built-in loopback bench's camera
    file: Option<PathBuf>,
    /// Colour of the stars, Gaia BP-RP; the Sun's is 0.82
    #[arg(long, value_name = "MAG", default_value_t = 0.82, allow_negative_numbers = true)]
    bp_rp: f64,
    /// Exposure instead of the camera's, seconds
    #[arg(long, value_name = "S")]
    exposure: Option<f64>,
    /// Background (sky and stray light), electrons per second and pixel
    #[arg(long, value_name = "E_PER_S", default_value_t = 0.0)]
    background: f64,
    /// Sky besides the camera's own, instrument magnitudes per square arcsecond, added to the background; a dark sky
    /// has about 22
    #[arg(long, value_name = "MAG")]
    sky: Option<f64>,
    /// Side of the square window whose sum is taken, pixels, odd; without it: the one that finds the faintest star
    #[arg(long, value_name = "PX")]
    window: Option<usize>,
    /// Magnitudes of the table and the curve, brightest:faintest or brightest:faintest:step
    #[arg(long, value_name = "RANGE", allow_hyphen_values = true)]
    mag_range: Option<String>,
    /// Draw SNR against magnitude into this file
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// When the file is refused, a number makes no sense, or the plot cannot be written.
pub fn run(arguments: &SnrArgs) -> Result<()> {
    let camera = named_camera(arguments.file.as_deref())?;
    let params = camera_params(&camera)?;
    let sensitivity = Sensitivity::new(&params, &conditions(arguments, &camera)?);
    let limiting_mag = params.limiting_mag;
    let mags = magnitudes(arguments.mag_range.as_deref(), &sensitivity)?;
    facts(&camera, limiting_mag, &sensitivity, &mags).print("snr", arguments.json)?;
    if let Some(path) = &arguments.plot {
        let svg = to_svg(&chart(&camera, &sensitivity, &mags));
        write_file_atomically(path, |out| std::io::Write::write_all(out, svg.as_bytes()))
            .with_context(|| format!("--plot {}", path.display()))?;
        if !arguments.json {
            println!("\nplot in {}", path.display());
        }
    }
    Ok(())
}

fn conditions(arguments: &SnrArgs, camera: &Camera) -> Result<Conditions> {
    if arguments.exposure.is_some_and(|exposure_s| !(exposure_s > 0.0 && exposure_s <= 3600.0)) {
        bail!("--exposure is {:?}; wanted seconds above 0, up to 3600", arguments.exposure.unwrap_or_default());
    }
    if !(0.0..=1e12).contains(&arguments.background) {
        bail!("--background is {}; wanted electrons per second and pixel, 0 or more", arguments.background);
    }
    if arguments.window.is_some_and(|side| side % 2 == 0 || side > 99) {
        bail!("--window is {}; wanted an odd number of pixels, up to 99", arguments.window.unwrap_or_default());
    }
    if !arguments.bp_rp.is_finite() {
        bail!("--bp-rp is {}; wanted a colour such as 0.82", arguments.bp_rp);
    }
    let sky_e_per_s = match (arguments.sky, camera.star_light().zero_point_e_per_s()) {
        (None, _) => 0.0,
        (Some(mag), Some(zero_point)) if mag.is_finite() => {
            surface_brightness_e_per_s_px(zero_point, mag, camera.ifov_arcsec())
        }
        (Some(mag), Some(_)) => bail!("--sky is {mag}; wanted magnitudes per square arcsecond, such as 22"),
        (Some(_), None) => bail!("--sky needs a zero point; a grey mapping has none: give --background"),
    };
    Ok(Conditions {
        bp_rp: arguments.bp_rp,
        exposure_s: arguments.exposure,
        background_e_per_s: arguments.background + sky_e_per_s,
        window_px: arguments.window,
    })
}

/// Magnitudes of the rows: as asked for, or from a magnitude above saturation to one below the limit.
fn magnitudes(asked: Option<&str>, sensitivity: &Sensitivity) -> Result<Vec<f64>> {
    let (bright, faint, step) = match asked {
        Some(text) => parsed_range(text)?,
        None => {
            let bright = sensitivity.saturation_mag().map_or(RANGE_WHERE_NONE.0, |mag| mag - BEYOND_MAG);
            let faint = sensitivity.limiting_mag(LIMITS[0]).map_or(RANGE_WHERE_NONE.1, |mag| mag + BEYOND_MAG);
            let (bright, faint) = (bright.floor(), faint.ceil().max(bright.floor() + 1.0));
            (bright, faint, step_of(faint - bright))
        }
    };
    let rows = ((faint - bright) / step + 1e-9).floor() as usize + 1;
    if rows > MOST_ROWS {
        bail!("--mag-range asks for {rows} rows; wanted at most {MOST_ROWS}: take larger steps");
    }
    Ok((0..rows).map(|row| bright + step * row as f64).collect())
}

fn step_of(range_mag: f64) -> f64 {
    STEPS_MAG.into_iter().find(|step| range_mag / step <= ROWS).unwrap_or(STEPS_MAG[STEPS_MAG.len() - 1])
}

fn parsed_range(text: &str) -> Result<(f64, f64, f64)> {
    let numbers: Option<Vec<f64>> =
        text.split(':').map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    let range = match numbers.as_deref() {
        Some([bright, faint]) => (*bright, *faint, step_of(faint - bright)),
        Some([bright, faint, step]) => (*bright, *faint, *step),
        _ => bail!("--mag-range is {text}; wanted brightest:faintest or brightest:faintest:step, such as 0:8:0.5"),
    };
    if !(range.1 > range.0 && range.2 > 0.0) {
        bail!("--mag-range is {text}; wanted the smaller magnitude first and a step above 0");
    }
    Ok(range)
}

fn facts(camera: &Camera, limiting_mag: f32, sensitivity: &Sensitivity, mags: &[f64]) -> Facts {
    let mut facts = Facts::new("", 12);
    head(&mut facts, camera, sensitivity);
    facts.line(format_args!(
        "\n{:>7}{:>8}{:>12}{:>11}{:>9}{:>8}{:>8}{:>8}{:>8}{:>9}{:>9}{:>9}{:>8}",
        "G", "V", "signal e-", "peak e-", "shot", "dark", "sky", "read", "round", "SNR", "optimal", "PRNU", "DSNU"
    ));
    for &mag in mags {
        let t = sensitivity.terms(mag);
        let (mag_v, bare_e) =
            (mag_v(mag, sensitivity.bp_rp), sensitivity.pixel.dark_e + sensitivity.pixel.background_e);
        let is_full = t.peak_e + bare_e > sensitivity.full_e;
        facts.line(format_args!(
            "{mag:>7.2}{mag_v:>8.2}{:>12.1}{:>11.1}{:>9.1}{:>8.1}{:>8.1}{:>8.1}{:>8.1}{:>9.2}{:>9.2}{:>9.1}{:>8.1}{}",
            t.signal_e,
            t.peak_e,
            t.shot_e,
            t.dark_e,
            t.background_e,
            t.read_e,
            t.rounding_e,
            t.snr,
            t.snr_optimal,
            t.prnu_e,
            t.dsnu_e,
            if is_full { "  saturated" } else { "" }
        ));
        facts.element(
            "rows",
            json!({
                "mag_g": mag, "mag_v": mag_v, "signal_e": t.signal_e, "peak_e": t.peak_e, "shot_e": t.shot_e,
                "dark_e": t.dark_e, "background_e": t.background_e, "read_e": t.read_e, "rounding_e": t.rounding_e,
                "snr": t.snr, "snr_optimal": t.snr_optimal, "prnu_e": t.prnu_e, "dsnu_e": t.dsnu_e,
                "saturated": is_full,
            }),
        );
    }
    facts.line("");
    limits(&mut facts, sensitivity);
    facts.line(format_args!("{}, as far as the catalog of a bench reaches", drawn_text(camera, limiting_mag)));
    facts.value("drawn_to_mag_g", drawn_mag(camera, limiting_mag));
    facts
}

fn head(facts: &mut Facts, camera: &Camera, sensitivity: &Sensitivity) {
    let Sensitivity { window, pixel, exposure_s, bp_rp, .. } = sensitivity;
    let zero_point_e_per_s = sensitivity.light.zero_point_e_per_s();
    facts.value("camera", camera.name.as_str());
    facts.value("exposure_s", *exposure_s);
    facts.value("bp_rp", *bp_rp);
    facts.value("zero_point_e_per_s", json!(zero_point_e_per_s));
    facts.value("window_px", window.side_px);
    facts.value("window_share", window.share());
    facts.named("camera").line(format_args!(
        "\"{}\", exposure {exposure_s} s, {:.2} arcsec/px",
        camera.name,
        camera.ifov_arcsec()
    ));
    facts.fact("radiometry", radiometry_text(camera));
    if let Some(zero_point) = zero_point_e_per_s {
        let term = sensitivity.light.mag_instrument(0.0, *bp_rp);
        facts
            .named("zero point")
            .line(format_args!("{zero_point:.4e} e-/s at magnitude 0; stars of BP-RP = {bp_rp}: G{term:+.3}"));
    }
    facts.named("window").line(format_args!(
        "{0} x {0} px with {1:.4} of the light, {2:.4} in the brightest pixel",
        window.side_px,
        window.share(),
        window.peak()
    ));
    facts.named("pixel").line(format_args!(
        "{:.2} e- rms without a star: dark signal {:.3} e-, background {:.3} e-, read noise {} e- rms, one DN \
         = {:.3} e-",
        pixel.variance_e2().sqrt(),
        pixel.dark_e,
        pixel.background_e,
        pixel.read_noise_e_rms,
        pixel.lsb_e
    ));
}

fn limits(facts: &mut Facts, sensitivity: &Sensitivity) {
    let reported = |mag: Option<f64>| {
        mag.map_or_else(|| "none".into(), |mag| format!("G = {mag:.2} (V = {:.2})", mag_v(mag, sensitivity.bp_rp)))
    };
    for snr in LIMITS {
        let [mag, optimal] = [sensitivity.limiting_mag(snr), sensitivity.limiting_mag_optimal(snr)];
        let [words, with_weights] = [reported(mag), reported(optimal)];
        facts.line(format_args!("limiting magnitude at SNR {snr}: {words}; with optimal weights {with_weights}"));
        facts.element("limits", json!({ "snr": snr, "mag_g": mag, "mag_g_optimal": optimal }));
    }
    let (saturation, full_e) = (sensitivity.saturation_mag(), sensitivity.full_e);
    facts.line(format_args!(
        "saturation magnitude: {}, where the brightest pixel holds {full_e:.0} e-",
        reported(saturation)
    ));
    facts.value("saturation_mag_g", json!(saturation));
    facts.value("saturation_e", full_e);
}

fn chart(camera: &Camera, sensitivity: &Sensitivity, mags: &[f64]) -> Chart {
    let (bright, faint) = (mags[0], mags[mags.len() - 1]);
    let at = |i: usize| bright + (faint - bright) * i as f64 / (CURVE_POINTS - 1) as f64;
    let curve = |name: &str, style, group, of: &dyn Fn(f64) -> f64| {
        Series::new(name, style, group, (0..CURVE_POINTS).map(|i| [at(i), of(at(i))]).collect())
    };
    let level = |snr: f64, group| curve(&format!("SNR {snr}"), Style::DashedLine, group, &|_| snr);
    let series = vec![
        curve("sum over the window", Style::Line, 0, &|mag| sensitivity.terms(mag).snr),
        curve("optimal weights", Style::Line, 1, &|mag| sensitivity.terms(mag).snr_optimal),
        curve("the star's photons alone", Style::DashedLine, 2, &|mag| sensitivity.terms(mag).shot_e),
        level(LIMITS[0], 3),
        level(LIMITS[1], 4),
    ];
    let x = Axis::linear(format!("Gaia G, stars of BP-RP = {}", sensitivity.bp_rp));
    let (exposure_s, side_px) = (sensitivity.exposure_s, sensitivity.window.side_px);
    Chart::new(format!("Signal-to-noise ratio, {}", camera.name), x, Axis::log("SNR of one frame"), series)
        .noted(format!("Exposure {exposure_s} s; window {side_px} x {side_px} px; star on the centre of a pixel."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn built_in(name: &str) -> (Camera, Sensitivity) {
        let camera = named_camera(Some(Path::new(name))).unwrap();
        let params = camera_params(&camera).unwrap();
        let sensitivity = Sensitivity::new(&params, &Conditions { bp_rp: 0.82, ..Conditions::default() });
        (camera, sensitivity)
    }

    #[test]
    fn a_camera_is_found_by_itself_or_through_its_bench() {
        let own = named_camera(Some(Path::new("cameras/star_tracker_20deg.toml"))).unwrap();
        assert_eq!(named_camera(None).unwrap().name, own.name);
        assert_eq!(named_camera(Some(Path::new("benches/loopback.toml"))).unwrap().name, own.name);
        let error = named_camera(Some(Path::new("cameras/none.toml"))).unwrap_err().to_string();
        assert!(error.contains("cameras/none.toml"), "{error}");
    }

    #[test]
    fn the_table_runs_from_saturation_to_the_limit_and_says_both() {
        let (camera, sensitivity) = built_in("cameras/star_tracker_20deg.toml");
        let mags = magnitudes(None, &sensitivity).unwrap();
        assert!(mags[0] < sensitivity.saturation_mag().unwrap());
        assert!(mags[mags.len() - 1] > sensitivity.limiting_mag(3.0).unwrap() && mags.len() <= 20, "{mags:?}");
        let text = facts(&camera, 7.0, &sensitivity, &mags).text();
        for word in
            ["zero point", "limiting magnitude at SNR 3: G = ", "SNR 5", "saturation magnitude: G = ", "saturated"]
        {
            assert!(text.contains(word), "no \"{word}\" in\n{text}");
        }
        let widest = text.lines().skip(7).map(str::len).max().unwrap();
        assert!(widest <= 130, "{widest} columns");
    }

    #[test]
    fn the_two_published_cases_are_reproduced() {
        for (name, limit) in [("15", "limiting magnitude at SNR 3: G = 15.00"), ("22", "at SNR 3: G = 22.00")] {
            let (camera, sensitivity) = built_in(&format!("cameras/detection_limit_{name}mag.toml"));
            let text = facts(&camera, 7.0, &sensitivity, &magnitudes(None, &sensitivity).unwrap()).text();
            assert!(text.contains(limit), "{text}");
        }
    }

    #[test]
    fn ranges_are_read_and_senseless_ones_refused() {
        assert_eq!(parsed_range("-1:5:0.5").unwrap(), (-1.0, 5.0, 0.5));
        assert_eq!(parsed_range("0:8").unwrap(), (0.0, 8.0, 0.5));
        for bad in ["5", "8:0", "0:8:0", "a:b", "0:8:-1", "0:nan", "1:2:3:4", "0:inf"] {
            assert!(parsed_range(bad).unwrap_err().to_string().contains("--mag-range"), "{bad}");
        }
        let (_, sensitivity) = built_in("cameras/small_tracker.toml");
        assert_eq!(magnitudes(Some("0:8:2"), &sensitivity).unwrap(), [0.0, 2.0, 4.0, 6.0, 8.0]);
        assert!(magnitudes(Some("0:8:0.001"), &sensitivity).is_err(), "too many rows");
    }

    #[test]
    fn the_plot_has_both_curves_and_the_levels() {
        let (camera, sensitivity) = built_in("cameras/small_tracker.toml");
        let chart = chart(&camera, &sensitivity, &[0.0, 8.0]);
        let names: Vec<&str> = chart.series.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names.len(), 5);
        assert!(names.contains(&"SNR 3") && names.contains(&"optimal weights"), "{names:?}");
        let [sum, photons] = [0, 2].map(|i| chart.series[i].points[50][1]);
        assert!(sum < photons && sum > 0.0, "{sum} {photons}");
        assert!(to_svg(&chart).contains("Gaia G"));
    }
}
