//! The camera that a command line names: a camera file, a bench file, or a built-in one by its path below `configs/`.

use anyhow::Result;
use config::{Bench, Camera, Document, is_camera};
use std::path::Path;

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
