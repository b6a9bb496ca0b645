//! Folders that a command writes into.

use anyhow::{Context, Result, bail};
use std::path::Path;

/// Makes a folder and those around it, where they are missing; `option` names it in messages.
///
/// # Errors
/// When a file has its name, or it cannot be made.
pub(super) fn make(option: &str, folder: &Path) -> Result<()> {
    let is_file = |path: &&Path| path.exists() && !path.is_dir();
    if let Some(file) = folder.ancestors().find(is_file) {
        let (folder, file) = (folder.display(), file.display());
        bail!("{folder}: Not a directory: {file} is a file; wanted a folder, or a free name for {option}");
    }
    std::fs::create_dir_all(folder).with_context(|| format!("{option}: cannot make the folder {}", folder.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_in_the_way_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mine");
        std::fs::write(&file, "mine").unwrap();
        make("--out", &folder.path().join("a/b")).unwrap();
        for path in [file.clone(), file.join("below")] {
            let error = make("--out", &path).unwrap_err().to_string();
            assert!(error.ends_with("--out") && error.contains("mine is a file; wanted a folder"), "{error}");
        }
        assert!(file.is_file(), "left as it is");
    }
}
