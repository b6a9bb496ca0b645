//! Things that a command line names: a camera, an angle, a file of attitudes, a folder to write into.

use anyhow::{Context, Result, bail};
#[cfg(feature = "spice")]
use base::input_file::{DATA_BYTES, read_bytes};
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use config::{Bench, Camera, Document, RIGHT_ASCENSION_DEG, RadiometryModel, is_camera};
use histories::{AttitudeHistory, read};
use plan::optics::{StarLight, StarSpectra};
use scene::wcs::PROMISED_PX;
use std::path::{Path, PathBuf};

// The camera that a command line names: a camera file, a bench file, or a built-in one by its path below `configs/`.

/// Returns the camera that was named, by itself or by its bench; of nothing, the built-in bench's.
///
/// # Errors
/// With what is wrong with the file.
pub(super) fn named_camera(path: Option<&Path>) -> Result<Camera> {
    let Some(path) = path else { return Ok(Bench::built_in()?.camera) };

    let document = Document::open(path)?;
    // A file without any key is a bench with the camera of the binary: that is not meant here.
    if is_camera(&document) || document.is_blank() {
        return Ok(Camera::from_document(&document)?);
    }
    Ok(Bench::from_document(&document)?.camera)
}

// A camera's radiometry in words: which model, and the numbers that follow from it.

/// Colours for which a band's colour term is printed.
const BLUE_AND_RED: [f64; 2] = [0.0, 2.0];

/// Returns one line.
pub(super) fn radiometry_text(camera: &Camera) -> String {
    let light = camera.star_light();
    match (&camera.band, &light, camera.radiometry.model) {
        (Some(band), StarLight::Band(_), _) => {
            let (from, to) = band.range_nm();
            let [blue, red] = BLUE_AND_RED.map(|color| band.mean_wavelength_nm(&StarSpectra::new().of_color(color)));
            format!(
                "band of {from} to {to} nm, mean {blue:.0} nm for BP-RP = 0 and {red:.0} nm for 2, where magnitudes \
                 are G{:+.3}",
                light.mag_instrument(0.0, BLUE_AND_RED[1])
            )
        }
        (_, _, RadiometryModel::LinearGrey(map)) => format!(
            "linear grey mapping, G = {} to {}: {} to {} DN whatever the exposure",
            map.brightest_mag, map.faintest_mag, map.brightest_grey_dn, map.faintest_grey_dn
        ),
        (_, _, model) => format!(
            "{:.3e} photons / (s m^2) at {} = 0, mean transmission {} and QE {}",
            camera.radiometry.zero_magnitude_photons_per_s_m2,
            if model == RadiometryModel::PhotonsV { "V" } else { "G" },
            camera.optics.transmission,
            camera.detector.quantum_efficiency
        ),
    }
}

/// Returns down to which magnitude a camera is drawn, and who chose it.
pub(super) fn drawn_text(camera: &Camera, limiting_mag: f32) -> String {
    let chosen = if camera.radiometry.limiting_mag.is_none() { " (limiting_mag = \"auto\")" } else { "" };
    format!("drawn down to G = {limiting_mag}{chosen}")
}

/// Returns that magnitude as a number with the digits of the file, or with hundredths.
pub(super) fn drawn_mag(camera: &Camera, limiting_mag: f32) -> f64 {
    camera.radiometry.limiting_mag.unwrap_or_else(|| (f64::from(limiting_mag) * 100.0).round() / 100.0)
}

// The warning of a lens that FITS headers cannot follow.

/// Warns of a map to the sky that is worse than promised.
pub(super) fn warn_of_wcs(error_px: f64) {
    if error_px > PROMISED_PX {
        eprintln!(
            "WARNING: the WCS in FITS headers is off by up to {error_px:.3} px (promised: {PROMISED_PX}): polynomials of the \
             ninth order do not follow this lens over the whole image; WCSERR states it in each frame"
        );
    }
}

// Angles on the command line: decimal degrees, with advice for those who type hours.
//
// The ranges are those of configuration files, so that a number means the same everywhere.

/// Reads a right ascension, degrees.
///
/// # Errors
/// When it is not a number of degrees from -360 to 360; hours are converted in the message.
pub fn right_ascension_deg(text: &str) -> Result<f64, String> {
    let [least, most] = RIGHT_ASCENSION_DEG;
    within(text, least, most).map_err(|wanted| {
        let hours = degrees_of_sexagesimal(text, true);
        let advice = hours.map(|degrees| format!(": degrees, not hours: {} is {degrees}", text.trim()));
        format!("{wanted}{}", advice.unwrap_or_default())
    })
}

/// Reads a declination, degrees.
///
/// # Errors
/// When it is not a number of degrees from -90 to 90.
pub fn declination_deg(text: &str) -> Result<f64, String> {
    within(text, -90.0, 90.0)
}

fn within(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let value = text.trim().parse::<f64>().ok().filter(|value| (least..=most).contains(value));
    value.ok_or_else(|| format!("wanted decimal degrees from {least} to {most}"))
}

/// Returns the degrees of hours such as `5h30m` and `5h 30m 12.5s`, and of numbers such as `-5:30:12.5`, which are hours of a right
/// ascension and degrees of any other angle.
pub fn degrees_of_sexagesimal(text: &str, is_right_ascension: bool) -> Option<f64> {
    let text = text.trim().to_ascii_lowercase();
    let is_hours = text.contains('h') || is_right_ascension;
    if !text.contains(['h', ':']) {
        return None;
    }
    // The sign is of the whole, also before a zero.
    let (sign, text) = text.strip_prefix('-').map_or((1.0, text.as_str()), |rest| (-1.0, rest));
    let parts: Vec<&str> = text.split(['h', 'm', 's', ':', ' ']).filter(|part| !part.is_empty()).collect();
    let numbers: Vec<f64> = parts.iter().map(|part| part.parse().ok()).collect::<Option<_>>()?;
    if numbers.iter().any(|number| number.is_sign_negative()) {
        return None;
    }
    let whole = match numbers[..] {
        [whole] => whole,
        [whole, m] => whole + m / 60.0,
        [whole, m, s] => whole + m / 60.0 + s / 3600.0,
        _ => return None,
    };
    let degrees = sign * whole * if is_hours { 15.0 } else { 1.0 };
    Some((degrees * 1e6).round() / 1e6)
}

// A file of attitudes that the command line names: any that a bench takes, also a SPICE CK with its text kernels.

/// Arguments of a SPICE CK file.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct KernelArgs {
    /// Text kernel of a SPICE CK given as --attitudes: its clock (SCLK), or leap seconds (LSK); may be repeated
    #[arg(long = "kernel", value_name = "FILE", requires = "attitudes")]
    kernels: Vec<PathBuf>,
    /// Number of the instrument in a SPICE CK that has several
    #[arg(long, value_name = "N", allow_hyphen_values = true, requires = "attitudes")]
    naif_id: Option<i32>,
}

/// Reads a file of attitudes.
///
/// # Errors
/// With the file, what was got and what was wanted.
pub(super) fn attitudes(path: &Path, kernels: &KernelArgs) -> Result<AttitudeHistory> {
    if read::is_kernel(path) {
        return of_kernel(path, kernels);
    }
    if !kernels.kernels.is_empty() || kernels.naif_id.is_some() {
        bail!(
            "--kernel and --naif-id: {} is not a binary SPICE kernel; wanted them beside a CK file only",
            path.display()
        );
    }
    Ok(read::attitudes(&path.display().to_string(), &read::text_of(path)?, None)?)
}

#[cfg(feature = "spice")]
fn of_kernel(path: &Path, kernels: &KernelArgs) -> Result<AttitudeHistory> {
    use anyhow::Context;
    use histories::spice::{self, KernelFile};
    let bytes_of =
        |path: &Path| read_bytes(path, DATA_BYTES).with_context(|| format!("{}: cannot be read", path.display()));
    let bytes = bytes_of(path)?;
    let texts = kernels.kernels.iter().map(|path| anyhow::Ok((path.display().to_string(), bytes_of(path)?)));
    let texts = texts.collect::<Result<Vec<_>>>()?;
    let texts: Vec<KernelFile<'_>> = texts.iter().map(|(file, bytes)| KernelFile { file, bytes }).collect();
    let file = path.display().to_string();
    Ok(spice::attitudes(KernelFile { file: &file, bytes: &bytes }, &texts, kernels.naif_id)?)
}

#[cfg(not(feature = "spice"))]
fn of_kernel(path: &Path, _kernels: &KernelArgs) -> Result<AttitudeHistory> {
    bail!(
        "{}: a SPICE kernel; this build reads none: install one that does with \
         `cargo install --locked --path . --features spice`, or convert it to AEM",
        path.display()
    )
}

// Words of a command line for a value.

/// Returns a reader of words: each has a meaning, which the help states, and a value.
pub(super) fn one_of<T: Clone + Send + Sync + 'static>(
    words: &'static [(&'static str, &'static str, T)],
) -> impl TypedValueParser<Value = T> {
    let known = words.iter().map(|(word, meaning, _)| match *meaning {
        "" => PossibleValue::new(*word),
        meaning => PossibleValue::new(*word).help(meaning),
    });
    PossibleValuesParser::new(known).try_map(move |word| {
        let found = words.iter().find(|(known, ..)| *known == word);
        found.map(|(.., value)| value.clone()).ok_or("no such word")
    })
}

// Folders that a command writes into.

/// Makes a folder and those around it, where they are missing; `option` names it in messages.
///
/// # Errors
/// When a file has its name, or it cannot be made.
pub(super) fn make_folder(option: &str, folder: &Path) -> Result<()> {
    if folder.to_string_lossy().chars().any(char::is_control) {
        bail!("{option}: got {folder:?}, wanted a name without control characters: it is printed to terminals");
    }
    let is_file = |path: &&Path| path.exists() && !path.is_dir();
    if let Some(file) = folder.ancestors().find(is_file) {
        let (folder, file) = (folder.display(), file.display());
        bail!("{folder}: Not a directory: {file} is a file; wanted a folder, or a free name for {option}");
    }
    std::fs::create_dir_all(folder).with_context(|| format!("{option}: cannot make the folder {}", folder.display()))
}

#[cfg(test)]
mod degrees_tests {
    use super::*;

    #[test]
    fn degrees_are_read_and_hours_are_converted_in_the_message() {
        assert_eq!(right_ascension_deg("83.8"), Ok(83.8));
        assert_eq!(right_ascension_deg("-360"), Ok(-360.0));
        for (text, degrees) in [("5h30m", "82.5"), ("5h 30m 12s", "82.55"), ("5:30:12", "82.55"), ("23h", "345")] {
            let refused = right_ascension_deg(text).unwrap_err();
            assert!(refused.ends_with(&format!("not hours: {text} is {degrees}")), "{refused}");
        }
        for text in ["400", "nan", "abc", "5h30x", ""] {
            let refused = right_ascension_deg(text).unwrap_err();
            assert_eq!(refused, "wanted decimal degrees from -360 to 360", "{text}");
        }
        for (text, is_right_ascension, degrees) in [
            ("-1:12:00", false, Some(-1.2)),
            ("-0:30:00", false, Some(-0.5)),
            ("-45:30", false, Some(-45.5)),
            ("41:48:36", false, Some(41.81)),
            ("-1h30m", false, Some(-22.5)),
            ("5:35:00", true, Some(83.75)),
            ("-0:30", true, Some(-7.5)),
            ("1:-30", true, None),
            ("45.5", false, None),
        ] {
            assert_eq!(degrees_of_sexagesimal(text, is_right_ascension), degrees, "{text}");
        }
        assert_eq!(declination_deg("-90"), Ok(-90.0));
        assert_eq!(declination_deg("90.1").unwrap_err(), "wanted decimal degrees from -90 to 90");
    }
}

#[cfg(test)]
mod attitude_file_tests {
    use super::*;

    #[test]
    fn keys_of_a_kernel_beside_another_file_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv");
        std::fs::write(&path, "0 1 0 0 0\n").unwrap();
        assert_eq!(attitudes(&path, &KernelArgs::default()).unwrap().rows(), 1);
        let with = KernelArgs { naif_id: Some(-82000), ..KernelArgs::default() };
        assert!(attitudes(&path, &with).unwrap_err().to_string().contains("not a binary SPICE kernel"));
        let kernel = folder.path().join("x.bc");
        std::fs::write(&kernel, b"DAF/CK  ").unwrap();
        let error = attitudes(&kernel, &KernelArgs::default()).unwrap_err().to_string();
        assert!(error.contains("x.bc"), "{error}");
    }
}

#[cfg(test)]
mod folder_tests {
    use super::*;

    #[test]
    fn file_in_the_way_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mine");
        std::fs::write(&file, "mine").unwrap();
        make_folder("--out", &folder.path().join("a/b")).unwrap();
        for path in [file.clone(), file.join("below")] {
            let error = make_folder("--out", &path).unwrap_err().to_string();
            assert!(error.ends_with("--out") && error.contains("mine is a file; wanted a folder"), "{error}");
        }
        assert!(file.is_file(), "left as it is");
    }

    #[test]
    fn name_that_would_change_a_terminal_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a\u{1b}[31mred");
        let error = make_folder("--out", &path).unwrap_err().to_string();
        assert!(error.contains("control characters") && !error.contains('\u{1b}'), "{error}");
        assert!(!path.exists());
        make_folder("--out", &folder.path().join("gr\u{fc}n")).unwrap();
    }
}
