//! `[band]`: quantum efficiency and transmission over wavelength, in place of mean values.
//!
//! `qe` (or `qe_file`) and, optionally, `transmission` (or `transmission_file`): lists of `[nm, share]`, wavelengths
//! ascending, shares from 0 to 1, straight lines between them. A file is TOML with the list under `points`. Without a
//! transmission table `optics.transmission` holds at every wavelength. The mean values that the tables replace
//! (`detector.quantum_efficiency`, the photons and colour law of `[radiometry]`) are refused beside them: two
//! statements of one thing.

use crate::error::{ConfigError, Result};
use crate::key::{Given, section};
use crate::key_type::{Raw, Shape};
use crate::{Psf, RadiometryModel};
use crate::{check::Checker, document::Document};
use plan::optics::{Band, Spectrum, SpectrumError};
use serde::Deserialize;

section! {
    /// Quantum efficiency and transmission over wavelength, in place of mean values.
    BandKeys at "band" {
        /// Quantum efficiency as [nm, share], wavelengths ascending.
        qe: Raw<Vec<[f64; 2]>> = Optional, Shape::pairs(),
            "give the quantum efficiency over wavelength, or leave [band] out";
        /// The same in a TOML file with the list under `points`, in place of qe.
        qe_file: String = Optional, "path", "band.qe gives the table already: keep one of the two";
        /// Transmission of the optics as [nm, share], in place of optics.transmission.
        transmission: Raw<Vec<[f64; 2]>> = Optional, Shape::pairs();
        /// The same in a TOML file with the list under `points`, in place of transmission.
        transmission_file: String = Optional, "path", "band.transmission gives the table already: keep one of the two";
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TableKeys {
    points: Vec<[f64; 2]>,
}

/// Mean values that the QE table replaces.
const REPLACED: [&str; 4] = [
    "detector.quantum_efficiency",
    "radiometry.zero_magnitude_photons_per_s_m2",
    "radiometry.color_c1",
    "radiometry.color_c2",
];
/// The mean value that the transmission table replaces.
const TRANSMISSION: &str = "optics.transmission";

/// Returns the band, when the camera file has `[band]`; to be called after the sections whose mean values it replaces.
pub(super) fn check_band(
    keys: Option<&BandKeys>,
    transmission: f64,
    model: RadiometryModel,
    psf: &Psf,
    check: &mut Checker<'_>,
) -> Result<Option<Band>> {
    let Some(keys) = keys else { return Ok(None) };
    if model != RadiometryModel::PhotonsG {
        let advice = "[band] counts photons by wavelength: leave out the one or the other";
        return Err(check.invalid("radiometry.model", "given", "no other model beside [band]", advice));
    }
    let qe = table(&keys.qe(), &keys.qe_file(), check)?;
    let qe = qe.ok_or_else(|| keys.qe().missing("a list such as [[400, 0.6], [900, 0.5]]", check))?;
    for key in REPLACED {
        replaced(key, "band.qe", check)?;
    }
    let band = match table(&keys.transmission(), &keys.transmission_file(), check)? {
        None => Band::with_flat_transmission(transmission, qe),
        Some(table) => {
            replaced(TRANSMISSION, "band.transmission", check)?;
            Band::new(table, qe)
        }
    };
    let band = band.map_err(|error| refused("band.transmission", error, check))?;
    wavelength_inside(psf, &band, check)?;
    Ok(Some(band))
}

/// Reads a table that is given as a list, in a file, or not at all.
fn table(
    list: &Given<'_, Raw<Vec<[f64; 2]>>>,
    file: &Given<'_, String>,
    check: &Checker<'_>,
) -> Result<Option<Spectrum>> {
    let (named, points) = match (list.raw(), file.raw()) {
        (None, None) => return Ok(None),
        (Some(_), Some(_)) => return Err(file.invalid("given", format!("no {} here", file.key()), check)),
        (Some(points), None) => (list.key(), points.clone()),
        (None, Some(path)) => {
            let document: Document = check.document.named(&file.key(), path)?;
            (file.key(), document.read_as::<TableKeys>()?.points)
        }
    };
    Spectrum::share(points).map(Some).map_err(|error| refused(&named, error, check))
}

fn refused(key: &str, error: SpectrumError, check: &Checker<'_>) -> ConfigError {
    let (wanted, advice) = match error {
        SpectrumError::TooFew { .. } => ("at least two points", "pairs of wavelength in nm and share"),
        SpectrumError::Wavelength { .. } => ("wavelengths in nanometres", "0.55 um is 550"),
        SpectrumError::NotAscending { .. } => ("wavelengths that ascend", "sort the points, each wavelength once"),
        SpectrumError::Value { .. } => ("shares from 0 to 1", "a fraction: 45 % is 0.45"),
        SpectrumError::OutsideQe { .. } => {
            ("a band inside the QE table", "extend band.qe (0 where there is none), or cut the transmission")
        }
        SpectrumError::Dark => {
            ("a band that passes light", "is a table in percent of percent, or a filter beside the QE?")
        }
    };
    check.invalid(key, format!("refused ({error})"), wanted, advice)
}

/// Refuses a mean value that was given beside the table that replaces it, and takes its default off the list.
fn replaced(key: &str, table: &str, check: &mut Checker<'_>) -> Result<()> {
    let Some(place) = check.defaulted.iter().position(|default| default.key == key) else {
        let advice = format!("{table} replaces it: leave out the one or the other");
        return Err(check.invalid(key, "given", format!("no {key} beside {table}"), &advice));
    };
    check.defaulted.remove(place);
    Ok(())
}

/// Checks that the detector sees the wavelength of a diffraction pattern.
fn wavelength_inside(psf: &Psf, band: &Band, check: &Checker<'_>) -> Result<()> {
    let Psf::Airy { wavelength_nm, .. } = *psf else { return Ok(()) };
    let (least, most) = band.range_nm();
    if (least..=most).contains(&wavelength_nm) {
        return Ok(());
    }
    let wanted = format!("a wavelength of the band, {least} to {most} nm");
    let advice = "the detector counts no light there: give a wavelength inside the tables of [band], or extend them";
    Err(check.invalid("psf.wavelength_nm", wavelength_nm, wanted, advice))
}

#[cfg(test)]
mod tests {
    use crate::{Camera, Document};
    use std::path::Path;

    const OPTICS: &str = "[optics]\nfocal_length_mm = 25\n";
    const QE: &str = "qe = [[400, 0.5], [700, 0.6], [1000, 0.1]]\n";

    fn reported(text: &str) -> Result<Camera, String> {
        let text = format!("[detector]\nwidth_px = 640\nheight_px = 480\n{text}");
        Camera::from_document(&Document::from_text(&text, Path::new("lab/cam.toml"))).map_err(|e| e.to_string())
    }

    fn band(lines: &str) -> Result<Camera, String> {
        reported(&format!("{OPTICS}[band]\n{lines}"))
    }

    #[test]
    fn a_band_replaces_the_mean_values_and_their_defaults() {
        let camera = band(QE).unwrap();
        assert_eq!(camera.band.as_ref().unwrap().range_nm(), (400.0, 1000.0));
        assert!((camera.band.as_ref().unwrap().response(700.0) - 0.8 * 0.6).abs() < 1e-12, "optics.transmission holds");
        let defaults: Vec<&str> = camera.defaulted.iter().map(|d| d.key.as_str()).collect();
        assert!(!defaults.contains(&"detector.quantum_efficiency") && !defaults.contains(&"radiometry.color_c1"));
        assert!(defaults.contains(&"optics.transmission") && defaults.contains(&"radiometry.limiting_mag"));
        let filtered = band(&format!("{QE}transmission = [[500, 0.9], [600, 0.9]]")).unwrap();
        assert!(filtered.defaulted.iter().all(|d| d.key != "optics.transmission"), "the table replaces it");
        let ratio = filtered.zero_point_e_per_s() / camera.zero_point_e_per_s();
        assert!(ratio > 0.1 && ratio < 0.5, "a hundred nanometres of six hundred: {ratio}");
    }

    #[test]
    fn each_rule_has_a_failing_example() {
        let with = |section: &str, line: &str| reported(&format!("{OPTICS}{section}\n{line}\n[band]\n{QE}"));
        for (outcome, parts) in [
            (band(""), ["band.qe is missing", "leave [band] out"]),
            (band("qe = []"), ["band.qe", "at least two"]),
            (band("qe = [[400, 0.5], [400, 0.6]]"), ["band.qe", "ascend"]),
            (band("qe = [[400, 0.5], [700, 45]]"), ["45 at 700 nm", "a fraction"]),
            (band("qe = [[400, -0.5], [700, 0.4]]"), ["-0.5 at 400 nm", "0 to 1"]),
            (band("qe = [[0.4, 0.5], [0.7, 0.4]]"), ["0.4 nm", "0.55 um is 550"]),
            (band("qe = [[400, 0], [700, 0]]"), ["no light passes", "passes light"]),
            (band(&format!("{QE}transmission = [[350, 0.9], [600, 0.9]]")), ["350 to 600 nm", "extend band.qe"]),
            (band(&format!("{QE}transmission = [[500, 0.9], [1001, 0.9]]")), ["stated from 400 to 1000 nm", "cut"]),
            (band(&format!("{QE}qe_file = \"x.toml\"")), ["band.qe_file", "keep one"]),
            (band("qe_file = \"none.toml\""), ["none.toml", "band.qe_file"]),
            (
                reported(&format!("quantum_efficiency = 0.5\n{OPTICS}[band]\n{QE}")),
                ["detector.quantum_efficiency", "band.qe replaces"],
            ),
            (with("[radiometry]", "color_c1 = 0"), ["radiometry.color_c1", "band.qe replaces"]),
            (with("[radiometry]", "zero_magnitude_photons_per_s_m2 = 3e10"), ["radiometry.zero", "band.qe replaces"]),
            (with("[radiometry]", "model = \"linear_grey\""), ["radiometry.model", "beside [band]"]),
            (
                reported(&format!("{OPTICS}transmission = 0.5\n[band]\n{QE}transmission = [[500, 1], [600, 1]]")),
                ["optics.transmission", "band.transmission replaces"],
            ),
            (with("[psf]", "model = \"airy\"\nwavelength_nm = 1050"), ["psf.wavelength_nm is 1050", "400 to 1000 nm"]),
        ] {
            let error = outcome.map(|camera| camera.name).expect_err(parts[0]);
            assert!(error.contains("lab/") && parts.iter().all(|part| error.contains(part)), "{parts:?}: {error}");
        }
        assert!(with("[psf]", "model = \"airy\"\nwavelength_nm = 1000").is_ok(), "the edge itself");
        assert!(
            reported(&format!("{OPTICS}transmission = 0.5\n[band]\n{QE}")).is_ok(),
            "one transmission, one QE table"
        );
    }

    #[test]
    fn tables_may_be_in_files_and_are_packed_with_the_run() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        write("qe.toml", "points = [[400, 0.5], [1000, 0.1]]\n");
        let camera = "[detector]\nwidth_px = 64\nheight_px = 64\n[optics]\nfocal_length_mm = 25\n[band]\nqe_file = \"qe.toml\"\n";
        write("cam.toml", camera);
        let document = Document::open(&folder.path().join("cam.toml")).unwrap();
        let packed = document.pack().unwrap();
        let from_files = Camera::from_document(&document).unwrap();
        assert_eq!(from_files.band.as_ref().unwrap().range_nm(), (400.0, 1000.0));
        write("qe.toml", "points = [[400, 0.5], [1000, 4]]\n");
        let error = Camera::from_document(&document).unwrap_err().to_string();
        assert!(error.contains("band.qe_file") && error.contains("4 at 1000 nm"), "{error}");
        let from_pack = Camera::from_document(&Document::packed(packed).unwrap()).unwrap();
        assert_eq!(from_pack.band, from_files.band, "the pack keeps what the file said");
        write("qe.toml", "point = [[400, 0.5], [1000, 0.4]]\n");
        let error = Camera::from_document(&document).unwrap_err().to_string();
        assert!(error.contains("did you mean `points`"), "{error}");
    }
}
