//! A file of attitudes that the command line names: any that a bench takes, also a SPICE CK with its text kernels.

use anyhow::{Result, bail};
#[cfg(feature = "spice")]
use base::input_file::{DATA_BYTES, read_bytes};
use clap::Args;
use histories::{AttitudeHistory, read};
use std::path::{Path, PathBuf};

/// Arguments of a SPICE CK file.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct KernelArgs {
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

#[cfg(test)]
mod tests {
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
