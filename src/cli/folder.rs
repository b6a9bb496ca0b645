//! Folders that a command writes into.

use anyhow::{Context, Result, bail};
use std::path::Path;

/// Makes a folder and those around it, where they are missing; `option` names it in messages.
///
/// # Errors
/// When a file has its name, or it cannot be made.
pub(super) fn make(option: &str, folder: &Path) -> Result<()> {
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

    #[test]
    fn name_that_would_change_a_terminal_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a\u{1b}[31mred");
        let error = make("--out", &path).unwrap_err().to_string();
        assert!(error.contains("control characters") && !error.contains('\u{1b}'), "{error}");
        assert!(!path.exists());
        make("--out", &folder.path().join("gr\u{fc}n")).unwrap();
    }
}
