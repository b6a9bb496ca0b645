//! SPICE kernels that a bench names: binary ones (CK, SPK), and the text kernels (SCLK, LSK) that go with them.
//!
//! A build without the feature `spice` refuses them. Tests: `hil_scripts/test_spice.py`.

use crate::key_type::{Raw, Whole};
use crate::{check::Checker, error::ConfigError, key::Given};
use histories::{AttitudeHistory, HistoryError, OrbitHistory, read};

/// A file that may be a kernel, and the keys that go with one.
pub(super) struct Kernels<'k> {
    pub(super) file: Given<'k, String>,
    pub(super) texts: Given<'k, Raw<Vec<String>>>,
    pub(super) naif_id: Given<'k, Whole<i32>>,
}

impl Kernels<'_> {
    /// Returns true for a kernel; refuses the keys of one beside another file.
    fn is_kernel(&self, check: &Checker<'_>) -> Result<bool, ConfigError> {
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
    pub(super) fn attitudes(self, check: &Checker<'_>) -> Result<Option<AttitudeHistory>, ConfigError> {
        if self.is_kernel(check)? { self.read_attitudes(check).map(Some) } else { Ok(None) }
    }

    /// Reads the orbit of an SPK file; returns `None` where the file is not a kernel.
    pub(super) fn orbit(self, check: &Checker<'_>) -> Result<Option<OrbitHistory>, ConfigError> {
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
    fn read_attitudes(self, check: &Checker<'_>) -> Result<AttitudeHistory, ConfigError> {
        self.read(check, histories::spice::attitudes)
    }

    fn read_orbit(self, check: &Checker<'_>) -> Result<OrbitHistory, ConfigError> {
        self.read(check, histories::spice::orbit)
    }

    fn read<H>(self, check: &Checker<'_>, reader: Reader<H>) -> Result<H, ConfigError> {
        use histories::spice::KernelFile;
        let path = self.file.raw().cloned().unwrap_or_default();
        let bytes = check.document.bytes_of(&self.file.key(), &path)?;
        let texts = self.texts.raw().cloned().unwrap_or_default();
        let read = |text: &String| check.document.bytes_of(&self.texts.key(), text);
        let contents = texts.iter().map(read).collect::<Result<Vec<_>, _>>()?;
        let files = texts.iter().zip(&contents).map(|(file, bytes)| KernelFile { file, bytes }).collect::<Vec<_>>();
        let naif_id = self.naif_id.optional(check)?;
        reader(KernelFile { file: &path, bytes: &bytes }, &files, naif_id).map_err(|error| {
            let advice = "src/guide/files_in_and_out.md says which kernels are read, and what goes with them";
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
    fn read_attitudes(self, check: &Checker<'_>) -> Result<AttitudeHistory, ConfigError> {
        Err(self.refused(check))
    }

    fn read_orbit(self, check: &Checker<'_>) -> Result<OrbitHistory, ConfigError> {
        Err(self.refused(check))
    }

    fn refused(&self, check: &Checker<'_>) -> ConfigError {
        let wanted = "another format: this build lacks SPICE";
        let advice = "install one with `cargo install --locked --path . --features spice`, or convert it to AEM or OEM";
        check.invalid(&self.file.key(), "a SPICE kernel", wanted, advice)
    }
}
