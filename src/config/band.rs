//! `[band]`: quantum efficiency and transmission over wavelength, in place of mean values.
//!
//! `qe` (or `qe_file`) and, optionally, `transmission` (or `transmission_file`): lists of `[nm, share]`, wavelengths
//! ascending, shares from 0 to 1, straight lines between them. A file is TOML with the list under `points`. Without a
//! transmission table `optics.transmission` holds at every wavelength. The mean values that the tables replace
//! (`detector.quantum_efficiency`, the photons and colour law of `[radiometry]`) are refused beside them: two statements
//! of one thing.

use crate::config::check::Checker;
use crate::config::document::Document;
use crate::config::error::ConfigError;
use crate::config::{Psf, RadiometryModel};
use crate::optics::{Band, Spectrum, SpectrumError};
use serde::Deserialize;

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BandKeys {
    qe: Option<Vec<[f64; 2]>>,
    qe_file: Option<String>,
    transmission: Option<Vec<[f64; 2]>>,
    transmission_file: Option<String>,
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

/// The band, when the camera file has `[band]`; to be called after the sections whose mean values it replaces.
pub(super) fn check_band(
    keys: Option<&BandKeys>,
    transmission: f64,
    model: RadiometryModel,
    psf: &Psf,
    check: &mut Checker<'_>,
) -> Result<Option<Band>, ConfigError> {
    let Some(keys) = keys else { return Ok(None) };
    if model != RadiometryModel::PhotonsG {
        let advice = "[band] counts photons by wavelength: leave out the one or the other";
        return Err(check.invalid("radiometry.model", "given", "no other model beside [band]", advice));
    }
    let qe = table("band.qe", keys.qe.as_ref(), keys.qe_file.as_deref(), check)?;
    let qe = qe.ok_or_else(|| {
        let advice = "give the quantum efficiency over wavelength, or leave [band] out";
        check.invalid("band.qe", "missing", "a list such as [[400, 0.6], [900, 0.5]]", advice)
    })?;
    for key in REPLACED {
        replaced(key, "band.qe", check)?;
    }
    let band = match table("band.transmission", keys.transmission.as_ref(), keys.transmission_file.as_deref(), check)? {
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

/// A table given as a list, or in a file, or not at all.
fn table(
    key: &str,
    given: Option<&Vec<[f64; 2]>>,
    file: Option<&str>,
    check: &Checker<'_>,
) -> Result<Option<Spectrum>, ConfigError> {
    let file_key = format!("{key}_file");
    let points = match (given, file) {
        (None, None) => return Ok(None),
        (Some(_), Some(_)) => {
            let advice = format!("{key} gives the table already: keep one of the two");
            return Err(check.invalid(&file_key, "given", format!("no {file_key} here"), &advice));
        }
        (Some(points), None) => points.clone(),
        (None, Some(path)) => {
            let document: Document = check.document.named(&file_key, path)?;
            document.read_as::<TableKeys>()?.points
        }
    };
    let named = if file.is_some() { &file_key } else { key };
    Spectrum::share(points).map(Some).map_err(|error| refused(named, error, check))
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
fn replaced(key: &str, table: &str, check: &mut Checker<'_>) -> Result<(), ConfigError> {
    let Some(place) = check.defaulted.iter().position(|default| default.key == key) else {
        let advice = format!("{table} replaces it: leave out the one or the other");
        return Err(check.invalid(key, "given", format!("no {key} beside {table}"), &advice));
    };
    check.defaulted.remove(place);
    Ok(())
}

/// The wavelength of a diffraction pattern must be one that the detector sees.
fn wavelength_inside(psf: &Psf, band: &Band, check: &Checker<'_>) -> Result<(), ConfigError> {
    let Psf::Airy { wavelength_nm, .. } = *psf else { return Ok(()) };
    let (least, most) = band.range_nm();
    if (least..=most).contains(&wavelength_nm) {
        return Ok(());
    }
    let wanted = format!("a wavelength of the band, {least} to {most} nm");
    let advice = "the detector counts no light there: give a wavelength inside the tables of [band], or extend them";
    Err(check.invalid("psf.wavelength_nm", wavelength_nm, wanted, advice))
}
