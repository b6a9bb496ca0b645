//! Files for readers that open a path: one folder for each process, in the system's folder for temporary files, which
//! `hil_scripts/fuzz.sh` puts into memory and removes.

use std::fs::{self, File, OpenOptions};
use std::{io::Write, path::PathBuf, sync::LazyLock};

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("starloop_fuzz_{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder for temporary files");
    folder
});

/// Returns a path in the folder.
pub fn path(name: &str) -> PathBuf {
    FOLDER.join(name)
}

/// Returns a file of these bytes.
pub fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = path(name);
    // Not created again: its pages are there from the input before.
    let mut file = open(&path);
    file.write_all(bytes).expect("the disk takes it");
    file.set_len(bytes.len() as u64).expect("the disk takes it");
    path
}

fn open(path: &PathBuf) -> File {
    OpenOptions::new().create(true).truncate(false).write(true).open(path).expect("a file for writing")
}
