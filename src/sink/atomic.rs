//! A file appears under its final name only when all of its bytes are written.
//!
//! The bytes go to a hidden temporary file in the same directory, which is then renamed; when anything fails the
//! temporary is removed and an older file of the final name stays as it was. Limits: this survives a full disk and a
//! killed program; it does not wait for the disk (no fsync), so it says nothing about loss of power. A path that
//! exists and is no regular file (a pipe, `/dev/stdout`) is written directly, since it must not be replaced.

use crate::base::unfinished::Unfinished;
use crate::sink::SinkError;
use core::sync::atomic::{AtomicU64, Ordering};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Bytes collected before they go to the system.
const BUFFER_BYTES: usize = 64 * 1024;

static TEMPORARIES: AtomicU64 = AtomicU64::new(0);

/// Writes a file whole or not at all; gives its size in bytes.
///
/// # Errors
/// [`SinkError::Write`] with the path and the reason when the file cannot be made, written or renamed, or when
/// `write` itself fails.
pub fn write_file_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, SinkError> {
    // Through a symbolic link: the link stays and its target is replaced.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let bytes = match fs::metadata(&target) {
        Ok(existing) if !existing.is_file() && !existing.is_dir() => write_directly(&target, write),
        _ => write_and_rename(&target, write),
    };
    bytes.map_err(|source| SinkError::Write { path: path.to_path_buf(), source })
}

fn write_directly(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<u64> {
    write_through(OpenOptions::new().write(true).open(path)?, write)
}

fn write_and_rename(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<u64> {
    let temporary = Temporary::beside(path)?;
    let bytes = write_through(File::create(&temporary.path)?, write)?;
    fs::rename(&temporary.path, path)?;
    Ok(bytes)
}

fn write_through(file: File, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<u64> {
    let mut out = Counted { out: BufWriter::with_capacity(BUFFER_BYTES, file), bytes: 0 };
    write(&mut out)?;
    out.flush()?;
    Ok(out.bytes)
}

/// A hidden name beside `path`, not used by another thread or program.
fn temporary_name(path: &Path) -> io::Result<PathBuf> {
    let no_name = || io::Error::new(io::ErrorKind::InvalidInput, "the path does not end in a file name");
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().ok_or_else(no_name)?);
    let number = TEMPORARIES.fetch_add(1, Ordering::Relaxed);
    name.push(format!(".{}-{number}.part", std::process::id()));
    Ok(path.with_file_name(name))
}

/// Removes the temporary file, unless it has been renamed.
pub(super) struct Temporary {
    /// Its name.
    pub(super) path: PathBuf,
    /// Registered until it is renamed or removed.
    _unfinished: Unfinished,
}

impl Temporary {
    /// A name for it in the directory of the file that it is to become.
    pub(super) fn beside(path: &Path) -> io::Result<Self> {
        let path = temporary_name(path)?;
        Ok(Self { _unfinished: Unfinished::register(&path), path })
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _gone_after_rename = fs::remove_file(&self.path);
    }
}

struct Counted<W> {
    out: W,
    bytes: u64,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names_in(directory: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(directory).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_failure_leaves_the_old_file_and_no_other() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.txt");
        let bytes = write_file_atomically(&path, |out| out.write_all(b"first")).unwrap();
        assert_eq!(bytes, 5);
        let error = write_file_atomically(&path, |out| {
            out.write_all(b"second")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert!(matches!(error, Err(SinkError::Write { .. })), "{error:?}");
        assert_eq!(fs::read(&path).unwrap(), b"first");
        assert_eq!(names_in(directory.path()), ["a.txt"]);
    }

    #[test]
    fn a_file_is_replaced_whole() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.txt");
        write_file_atomically(&path, |out| out.write_all(b"a longer first text")).unwrap();
        write_file_atomically(&path, |out| out.write_all(b"second")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(names_in(directory.path()), ["a.txt"]);
    }

    #[test]
    fn a_missing_directory_or_a_directory_in_the_way_is_a_clear_error() {
        let directory = tempfile::tempdir().unwrap();
        let missing = directory.path().join("none/a.txt");
        let error = write_file_atomically(&missing, |_| Ok(())).unwrap_err().to_string();
        assert!(error.contains("none/a.txt") && error.contains("existing directory"), "{error}");
        write_file_atomically(directory.path(), |_| Ok(())).unwrap_err();
        write_file_atomically(Path::new("/"), |_| Ok(())).unwrap_err();
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_is_an_error_and_is_not_replaced() {
        use std::os::unix::fs::{FileTypeExt, symlink};
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("full");
        symlink("/dev/full", &path).unwrap();
        let error = write_file_atomically(&path, |out| out.write_all(&[7; 100_000])).unwrap_err();
        assert!(
            matches!(&error, SinkError::Write { source, .. } if source.kind() == io::ErrorKind::StorageFull),
            "{error}"
        );
        assert!(fs::metadata("/dev/full").unwrap().file_type().is_char_device(), "the device is still a device");
        assert!(fs::symlink_metadata(&path).unwrap().is_symlink(), "the link is still a link");
    }
}
