//! Files that are being written under a temporary name, so that a program that a signal ends leaves none behind.
//!
//! A writer registers the name before it makes the file and drops the [`Unfinished`] when the file is renamed or
//! removed. Limits: what a kill that cannot be caught (SIGKILL) leaves is not removed.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn registered() -> MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Registers a file or directory as unfinished for as long as it lives.
#[derive(Debug)]
pub struct Unfinished {
    path: PathBuf,
}

impl Unfinished {
    /// Registers `path`, which need not exist yet.
    pub fn register(path: &Path) -> Self {
        registered().push(path.to_path_buf());
        Self { path: path.to_path_buf() }
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        let mut registered = registered();
        if let Some(place) = registered.iter().position(|path| *path == self.path) {
            registered.swap_remove(place);
        }
    }
}

/// Removes all unfinished files, for a program that is about to end: a thread that registers a file from then on waits
/// for that end.
pub fn remove_all_at_the_end() {
    let registered = registered();
    registered.iter().for_each(|path| remove(path));
    core::mem::forget(registered);
}

fn remove(path: &Path) {
    // The path is missing when it was already renamed; other errors have no one to go to.
    let _ = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registered_paths_are_known_until_they_are_dropped() {
        let [a, b] = ["unfinished-test-a", "unfinished-test-b"].map(PathBuf::from);
        let is_known = |path: &PathBuf| registered().contains(path);
        let (first, second) = (Unfinished::register(&a), Unfinished::register(&b));
        assert!(is_known(&a) && is_known(&b));
        drop(first);
        assert!(!is_known(&a) && is_known(&b));
        drop(second);
        assert!(!is_known(&b));
    }

    #[test]
    fn files_and_directories_are_removed_and_missing_ones_are_no_error() {
        let folder = tempfile::tempdir().unwrap();
        let [file, directory, missing] = ["a.part", "b.part", "c.part"].map(|name| folder.path().join(name));
        std::fs::write(&file, "half").unwrap();
        std::fs::create_dir(&directory).unwrap();
        std::fs::write(directory.join("inside"), "half").unwrap();
        [&file, &directory, &missing].into_iter().for_each(|path| remove(path));
        assert!(!file.exists() && !directory.exists());
    }
}
