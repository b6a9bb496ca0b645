//! Files that a control client requests: below the run's output folder, and never over an existing one.
//!
//! Each part of the path is opened from the one before without following links, and the file is created, not opened: so
//! neither `..`, nor a link, nor a file that appears meanwhile leads elsewhere. Tests: below.

use rustix::fs::{AtFlags, Mode, OFlags, open, openat, unlinkat};
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path};
use std::{ffi::OsStr, fs::File, os::fd::OwnedFd};

/// Writes a new file below `folder` with `write`; returns its size in bytes. The file is removed if it cannot be
/// written.
pub(super) fn write_below(
    folder: Option<&Path>,
    relative: &str,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, String> {
    let folder = folder.ok_or_else(|| {
        format!("path is \"{relative}\", but this run has no output folder: start it with --out DIR, or leave path out")
    })?;
    let refuse = |why: &str| format!("path is \"{relative}\"; {why} (the output folder is {})", folder.display());
    let names = names(relative).ok_or_else(|| refuse("wanted a path relative to the output folder, without \"..\""))?;
    let (name, parents) = names.split_last().ok_or_else(|| refuse("wanted the name of a file"))?;
    let mut parent = open(folder, OFlags::DIRECTORY | OFlags::CLOEXEC, Mode::empty())
        .map_err(|error| refuse(&format!("the output folder cannot be opened: {error}")))?;
    for part in parents {
        let flags = OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let next = openat(&parent, *part, flags, Mode::empty());
        let why = |error| format!("wanted \"{}\" to be a folder, and no link: {error}", part.display());
        parent = next.map_err(|error| refuse(&why(error)))?;
    }
    let flags = OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let made = openat(&parent, *name, flags, Mode::from_raw_mode(0o644));
    let made =
        made.map_err(|error| refuse(&format!("wanted a file that can be made and does not exist yet: {error}")))?;
    written(made, write).map_err(|error| {
        let _it_may_be_gone_already = unlinkat(&parent, *name, AtFlags::empty());
        refuse(&format!("it cannot be written: {error}"))
    })
}

/// Returns the parts of a relative path; `None` if it leads upwards or starts at the root.
fn names(relative: &str) -> Option<Vec<&OsStr>> {
    let parts = Path::new(relative).components().filter(|part| *part != Component::CurDir);
    parts.map(|part| if let Component::Normal(name) = part { Some(name) } else { None }).collect()
}

fn written(made: OwnedFd, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<u64> {
    let mut out = BufWriter::new(File::from(made));
    write(&mut out)?;
    out.flush()?;
    Ok(out.get_ref().metadata()?.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn write(folder: &Path, relative: &str) -> Result<u64, String> {
        write_below(Some(folder), relative, |out| out.write_all(b"frame"))
    }

    #[test]
    fn a_new_file_below_the_folder_is_written() {
        let base = tempfile::tempdir().unwrap();
        fs::create_dir(base.path().join("sub")).unwrap();
        for path in ["a.fits", "sub/b.fits", "./sub/c.fits"] {
            assert_eq!(write(base.path(), path), Ok(5), "{path}");
            assert_eq!(fs::read(base.path().join(path)).unwrap(), b"frame");
        }
    }

    #[test]
    fn path_outside_the_folder_is_refused() {
        let base = tempfile::tempdir().unwrap();
        let (out, elsewhere) = (base.path().join("out"), base.path().join("elsewhere"));
        fs::create_dir(&out).unwrap();
        fs::create_dir(&elsewhere).unwrap();
        std::os::unix::fs::symlink(&elsewhere, out.join("link")).unwrap();
        std::os::unix::fs::symlink(elsewhere.join("planted"), out.join("dangling")).unwrap();
        let absolute = elsewhere.join("a").display().to_string();
        for (path, part) in [
            ("../elsewhere/a", "without \"..\""),
            ("sub/../../elsewhere/a", "without \"..\""),
            (absolute.as_str(), "relative to the output folder"),
            ("link/a", "no link"),
            ("dangling", "does not exist yet"),
            (".", "the name of a file"),
            ("no/folder", "to be a folder"),
        ] {
            let error = write(&out, path).unwrap_err();
            assert!(error.contains(part) && error.contains(path), "{path}: {error}");
        }
        assert_eq!(fs::read_dir(&elsewhere).unwrap().count(), 0, "nothing was written elsewhere");
    }

    #[test]
    fn an_existing_file_is_kept_and_one_that_cannot_be_written_is_removed() {
        let base = tempfile::tempdir().unwrap();
        fs::write(base.path().join("mine"), "precious").unwrap();
        assert!(write(base.path(), "mine").unwrap_err().contains("does not exist yet"));
        assert_eq!(fs::read(base.path().join("mine")).unwrap(), b"precious");
        let full = write_below(Some(base.path()), "half", |_| Err(io::ErrorKind::StorageFull.into()));
        assert!(full.unwrap_err().contains("cannot be written"));
        assert!(!base.path().join("half").exists());
    }

    #[test]
    fn a_run_without_an_output_folder_writes_nothing() {
        let error = write_below(None, "a.fits", |_| Ok(())).unwrap_err();
        assert!(error.contains("--out DIR"), "{error}");
    }
}
