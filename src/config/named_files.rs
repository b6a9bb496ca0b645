//! Files that keys name: SPICE kernels and images.
//!
//! SPICE kernels that a bench names: binary ones (CK, SPK), and the text kernels (SCLK, LSK) that go with them.
//!
//! A build without the feature `spice` refuses them. Tests: `hil_scripts/tests/test_spice.py`.
//!
//! Images that a configuration names: FITS files, relative to the file that names them.

use crate::error::{ConfigError, Result};
use crate::key_type::{Raw, Whole};
use crate::{check::Checker, key::Given};
use base::input_file::{DATA_BYTES, InputFile};
use frames::sink::fits::FitsImage;
use histories::{AttitudeHistory, HistoryError, OrbitHistory, read};
use std::io::BufReader;

/// A file that may be a kernel, and the keys that go with one.
pub(super) struct Kernels<'k> {
    pub(super) file: Given<'k, String>,
    pub(super) texts: Given<'k, Raw<Vec<String>>>,
    pub(super) naif_id: Given<'k, Whole<i32>>,
}

impl Kernels<'_> {
    /// Returns true for a kernel; refuses the keys of one beside another file.
    fn is_kernel(&self, check: &Checker<'_>) -> Result<bool> {
        let Some(path) = self.file.raw().map(|path| check.document.data_beside(path)) else { return Ok(false) };
        let is_kernel = read::is_kernel(&path);
        if !is_kernel && (self.texts.is_given() || self.naif_id.is_given()) {
            // A file that cannot be read, or is packed, is the mistake; the keys beside it are not.
            read::text_of(&path).map_err(|error| refused(&self.file, &error, check))?;
            check.unused(&self.texts.key(), self.texts.is_given(), "a binary SPICE kernel")?;
            check.unused(&self.naif_id.key(), self.naif_id.is_given(), "a binary SPICE kernel")?;
        }
        Ok(is_kernel)
    }

    /// Reads attitudes of a CK file; returns `None` where the file is not a kernel.
    pub(super) fn attitudes(self, check: &Checker<'_>) -> Result<Option<AttitudeHistory>> {
        if self.is_kernel(check)? { self.read_attitudes(check).map(Some) } else { Ok(None) }
    }

    /// Reads the orbit of an SPK file; returns `None` where the file is not a kernel.
    pub(super) fn orbit(self, check: &Checker<'_>) -> Result<Option<OrbitHistory>> {
        if self.is_kernel(check)? { self.read_orbit(check).map(Some) } else { Ok(None) }
    }
}

/// Returns the error of a file that a key names.
pub(super) fn refused(given: &Given<'_, String>, error: &HistoryError, check: &Checker<'_>) -> ConfigError {
    let advice = "src/guide/files_in_and_out.md has every format; paths are relative to the file that names them";
    check.invalid(&given.key(), format!("{error}"), "a file that can be read", advice)
}

#[cfg(feature = "spice")]
impl Kernels<'_> {
    fn read_attitudes(self, check: &Checker<'_>) -> Result<AttitudeHistory> {
        self.read(check, histories::spice::attitudes)
    }

    fn read_orbit(self, check: &Checker<'_>) -> Result<OrbitHistory> {
        self.read(check, histories::spice::orbit)
    }

    fn read<H>(self, check: &Checker<'_>, reader: Reader<H>) -> Result<H> {
        use histories::spice::KernelFile;
        let path = self.file.raw().cloned().unwrap_or_default();
        let bytes = check.document.bytes_of(&self.file.key(), &path)?;
        let texts = self.texts.raw().cloned().unwrap_or_default();
        let read = |text: &String| check.document.bytes_of(&self.texts.key(), text);
        let contents = texts.iter().map(read).collect::<Result<Vec<_>, _>>()?;
        let files = texts.iter().zip(&contents).map(|(file, bytes)| KernelFile { file, bytes }).collect::<Vec<_>>();
        let naif_id = self.naif_id.optional(check)?;
        reader(KernelFile { file: &path, bytes: &bytes }, &files, naif_id).map_err(|error| {
            let advice = "src/guide/spice_kernels.md says which kernels are read, and what goes with them";
            let key = if error.file == path { self.file.key() } else { self.texts.key() };
            check.invalid(&key, error, "a kernel that can be read", advice)
        })
    }
}

/// A reader of a kernel, its text kernels and a number.
#[cfg(feature = "spice")]
type Reader<H> =
    fn(histories::spice::KernelFile<'_>, &[histories::spice::KernelFile<'_>], Option<i32>) -> Result<H, HistoryError>;

#[cfg(not(feature = "spice"))]
impl Kernels<'_> {
    fn read_attitudes(self, check: &Checker<'_>) -> Result<AttitudeHistory> {
        Err(self.refused(check))
    }

    fn read_orbit(self, check: &Checker<'_>) -> Result<OrbitHistory> {
        Err(self.refused(check))
    }

    fn refused(&self, check: &Checker<'_>) -> ConfigError {
        let wanted = "another format: this build lacks SPICE";
        let advice = "install one with `cargo install --locked --path . --features spice`, or convert it to AEM or OEM";
        check.invalid(&self.file.key(), "a SPICE kernel", wanted, advice)
    }
}

/// Reads the FITS image that `key` names and holds it to the wanted size; row by row from the top, as floats.
#[allow(clippy::cast_possible_truncation, reason = "maps are used in single precision")]
pub(super) fn read_image(check: &Checker<'_>, key: &str, path: &str, size_px: [u32; 2]) -> Result<Vec<f32>> {
    let file = check.document.data_beside(path);
    let refuse = |why: String| ConfigError::Read {
        file: file.display().to_string(),
        why,
        named_by: format!(
            "; named by {key} in {}: paths are relative to the file that names them",
            check.document.name()
        ),
    };
    let input = InputFile::open(&file, DATA_BYTES).map_err(|error| refuse(error.to_string()))?;
    let image = FitsImage::read(BufReader::new(input)).map_err(|error| refuse(error.to_string()))?;
    let [width, height] = size_px.map(|side| side as usize);
    if [image.width, image.height] != [width, height] {
        let got = format!("{path}, an image of {} x {} pixels", image.width, image.height);
        let wanted = format!("{width} x {height} pixels, as the detector has");
        return Err(check.invalid(
            key,
            got,
            wanted,
            "crop or bin the image, or change detector.width_px and height_px",
        ));
    }
    Ok(image.top_row_first().into_iter().map(|value| value as f32).collect())
}
