//! A file appears under its final name only when all of its bytes are written.
//!
//! The bytes go to a hidden temporary file with a random name in the same directory, made by `O_CREAT | O_EXCL`, so
//! that a planted link is not followed and no file of another program is opened. It then gets its final name in one
//! step; when anything fails it is removed. There are three ways to take the name:
//!
//! * [`write_new_file`]: names that the program chose and that are free, such as the frames of a recording. Whatever
//!   has the name already (file, link, pipe, device, folder) stays as it is, and the write is refused without blocking.
//! * [`replace_own_file`]: names that the program chose and writes again, such as `session.json`. A regular file is
//!   replaced, everything else refused.
//! * [`write_file_atomically`]: paths that a person typed. A link stays and its target is replaced; a pipe or device
//!   (`/dev/stdout`) is written directly; a pipe without a reader is an error after [`PATIENCE`].
//!
//! Limits: this survives a full disk and a killed program; it does not wait for the disk (no fsync), so it does not
//! protect from loss of power.

use crate::sink::SinkError;
use base::{input_file::PATIENCE, unfinished::Unfinished};
use rustix::{fs::OFlags, io::Errno};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::{path::Path, time::Duration};
use tempfile::NamedTempFile;

/// Bytes collected before they go to the system.
const BUFFER_BYTES: usize = 64 * 1024;
/// Between two looks whether a pipe has a reader.
const LOOK: Duration = Duration::from_millis(20);

/// Writes a file at a path that a person named, whole or not at all; returns its size in bytes.
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

/// Writes a file that does not exist yet, whole or not at all; returns its size in bytes.
///
/// # Errors
/// [`SinkError::NameTaken`] when anything has the name, also when it came while the bytes were written;
/// [`SinkError::Write`] otherwise.
pub fn write_new_file(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<u64, SinkError> {
    let failed = |source: io::Error| SinkError::Write { path: path.to_path_buf(), source };
    if fs::symlink_metadata(path).is_ok() {
        return Err(SinkError::NameTaken { path: path.to_path_buf() });
    }
    let mut temporary = temporary_beside(path).map_err(failed)?;
    let _registered = Unfinished::register(temporary.path());
    let bytes = write_through(temporary.as_file_mut(), write).map_err(failed)?;
    match temporary.persist_noclobber(path).map_err(|refused| refused.error) {
        Ok(_file) => Ok(bytes),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
            Err(SinkError::NameTaken { path: path.to_path_buf() })
        }
        Err(error) => Err(failed(error)),
    }
}

/// Writes a file that the program may have written before, whole or not at all; returns its size in bytes.
///
/// # Errors
/// [`SinkError::NameTaken`] when the name belongs to a link, a pipe, a device or a folder; [`SinkError::Write`] otherwise.
pub fn replace_own_file(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<u64, SinkError> {
    if fs::symlink_metadata(path).is_ok_and(|found| !found.is_file()) {
        return Err(SinkError::NameTaken { path: path.to_path_buf() });
    }
    // Renaming replaces the file of that name and follows no link, even one made in between.
    write_and_rename(path, write).map_err(|source| SinkError::Write { path: path.to_path_buf(), source })
}

fn write_directly(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<u64> {
    write_through(&mut open_existing(path, PATIENCE)?, write)
}

/// Opens a device, or a pipe that gets a reader within `patience`.
fn open_existing(path: &Path, patience: Duration) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true);
    if !fs::metadata(path)?.file_type().is_fifo() {
        return options.open(path);
    }
    // Without this flag the system would wait for a reader without limit.
    options.custom_flags(OFlags::NONBLOCK.bits().cast_signed());
    let mut waited = Duration::ZERO;
    loop {
        match options.open(path) {
            Ok(pipe) => {
                // From here on it waits for its reader, who may be slow.
                rustix::fs::fcntl_setfl(&pipe, OFlags::WRONLY)?;
                return Ok(pipe);
            }
            Err(error) if error.raw_os_error() != Some(Errno::NXIO.raw_os_error()) => return Err(error),
            Err(_no_reader) if waited < patience => {
                std::thread::sleep(LOOK);
                waited += LOOK;
            }
            Err(_no_reader) => {
                let seconds = patience.as_secs();
                let why = format!("this pipe was without a reader for {seconds} s; wanted a file, or a reader");
                return Err(io::Error::new(io::ErrorKind::TimedOut, why));
            }
        }
    }
}

fn write_and_rename(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<u64> {
    let mut temporary = temporary_beside(path)?;
    let _registered = Unfinished::register(temporary.path());
    let bytes = write_through(temporary.as_file_mut(), write)?;
    temporary.persist(path).map_err(|refused| refused.error)?;
    Ok(bytes)
}

fn write_through(file: &mut File, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<u64> {
    let mut out = Counted { out: BufWriter::with_capacity(BUFFER_BYTES, file), bytes: 0 };
    write(&mut out)?;
    out.flush()?;
    Ok(out.bytes)
}

/// Makes a hidden temporary file beside `path`, readable as other files of the user; removed when dropped.
///
/// # Errors
/// With the system's reason, or when the path does not end in a file name.
pub(super) fn temporary_beside(path: &Path) -> io::Result<NamedTempFile> {
    let no_name = || io::Error::new(io::ErrorKind::InvalidInput, "the path does not end in a file name");
    let mut prefix = std::ffi::OsString::from(".");
    prefix.push(path.file_name().ok_or_else(no_name)?);
    prefix.push(".");
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(".part").rand_bytes(RANDOM_CHARACTERS);
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(directory)
}

/// Random letters and digits in a temporary name: 62^10 names.
const RANDOM_CHARACTERS: usize = 10;

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
#[path = "atomic_tests.rs"]
mod tests;
