//! Files that the program reads as a whole: a path and the most bytes -> bytes or text, or an error.
//!
//! A device has no end (`/dev/zero`) and is refused. A pipe is read as far as the bound (`/dev/stdin`, `<(program)`),
//! unless nothing comes through it for [`PATIENCE`]. A file of more bytes than the bound is refused, not cut. A test of
//! the repository (`tests/conformance/whole_files.rs`) lists what may read files without this module. Tests: below.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::{path::Path, time::Duration};

/// Most bytes of a text that people write: a configuration, a plan, requirements.
pub const SETTINGS_BYTES: u64 = 16 << 20;
/// Most bytes of a file of data.
pub const DATA_BYTES: u64 = 1 << 30;
/// Longest time without a byte from a pipe.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// A file that is open for reading, up to a number of bytes.
#[derive(Debug)]
pub struct InputFile {
    file: File,
    most_bytes: u64,
    left_bytes: u64,
    /// Longest time without a byte, of a pipe.
    patience: Option<Timespec>,
}

impl InputFile {
    /// Opens a file to read at most `most_bytes`.
    ///
    /// # Errors
    /// When it cannot be opened, is a device, or is larger.
    pub fn open(path: &Path, most_bytes: u64) -> io::Result<Self> {
        Self::open_within(path, most_bytes, PATIENCE)
    }

    fn open_within(path: &Path, most_bytes: u64, patience: Duration) -> io::Result<Self> {
        let about = std::fs::metadata(path)?;
        let kind = about.file_type();
        if kind.is_char_device() || kind.is_block_device() {
            return Err(io::Error::new(ErrorKind::InvalidInput, "it is a device; wanted a file"));
        }
        if kind.is_file() && about.len() > most_bytes {
            return Err(too_large(most_bytes));
        }
        // A pipe without a writer opens at once; files do not look at the flag.
        let nonblocking = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
        let file = OpenOptions::new().read(true).custom_flags(nonblocking).open(path)?;
        let patience = kind.is_fifo().then(|| Timespec::try_from(patience).ok()).flatten();
        Ok(Self { file, most_bytes, left_bytes: most_bytes, patience })
    }
}

impl Read for InputFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if let Some(patience) = &self.patience {
            let mut pipe = [PollFd::new(&self.file, PollFlags::IN)];
            if poll(&mut pipe, Some(patience))? == 0 {
                let why = format!("nothing came through this pipe for {} s; wanted a file", patience.tv_sec);
                return Err(io::Error::new(ErrorKind::TimedOut, why));
            }
        }
        let count = self.file.read(buffer)?;
        self.left_bytes = self.left_bytes.checked_sub(count as u64).ok_or_else(|| too_large(self.most_bytes))?;
        Ok(count)
    }
}

fn too_large(most_bytes: u64) -> io::Error {
    io::Error::new(ErrorKind::FileTooLarge, format!("it has more than {most_bytes} bytes, the most that is read"))
}

/// Returns the bytes of a file of at most `most_bytes`.
///
/// # Errors
/// As for [`InputFile::open`], and when it cannot be read to its end.
pub fn read_bytes(path: &Path, most_bytes: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    InputFile::open(path, most_bytes)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Returns the text of a file of at most `most_bytes`.
///
/// # Errors
/// As for [`read_bytes`], and, of kind `InvalidData`, when it is not UTF-8.
pub fn read_text(path: &Path, most_bytes: u64) -> io::Result<String> {
    let bytes = read_bytes(path, most_bytes)?;
    String::from_utf8(bytes).map_err(|_| io::Error::new(ErrorKind::InvalidData, "it is not UTF-8 text"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    use std::io::Write;

    fn kind_of(result: io::Result<Vec<u8>>) -> (ErrorKind, String) {
        result.map_err(|error| (error.kind(), error.to_string())).expect_err("refused")
    }

    #[test]
    fn a_file_is_read_up_to_its_bound() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("text");
        std::fs::write(&path, "seven b").expect("written");
        assert_eq!(read_text(&path, 7).expect("as large as the bound"), "seven b");
        let (kind, why) = kind_of(read_bytes(&path, 6));
        assert!(kind == ErrorKind::FileTooLarge && why.contains("more than 6 bytes"), "{why}");
        std::fs::write(&path, [0xff, 0xfe]).expect("written");
        assert_eq!(read_text(&path, 7).expect_err("not text").kind(), ErrorKind::InvalidData);
        assert_eq!(kind_of(read_bytes(&folder.path().join("none"), 7)).0, ErrorKind::NotFound);
        assert_eq!(kind_of(read_bytes(folder.path(), 1 << 20)).0, ErrorKind::IsADirectory);
    }

    #[test]
    fn devices_are_refused() {
        for device in ["/dev/zero", "/dev/null", "/dev/full"] {
            let (_, why) = kind_of(read_bytes(Path::new(device), 7));
            assert!(why.contains("a device; wanted a file"), "{device}: {why}");
        }
    }

    #[test]
    fn a_pipe_is_read_while_bytes_come() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("pipe");
        mknodat(CWD, &path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a pipe");
        let mut silent = InputFile::open_within(&path, 9, Duration::from_millis(20)).expect("opens at once");
        assert_eq!(silent.read_to_end(&mut Vec::new()).expect_err("no writer").kind(), ErrorKind::TimedOut);
        let mut pipe = InputFile::open(&path, 9).expect("opens");
        let mut writer = OpenOptions::new().write(true).open(&path).expect("has a reader");
        writer.write_all(b"nine byte").expect("space");
        drop(writer);
        let mut bytes = Vec::new();
        assert_eq!(pipe.read_to_end(&mut bytes).expect("as many as the bound"), 9);
        let mut pipe = InputFile::open(&path, 8).expect("opens");
        let mut writer = OpenOptions::new().write(true).open(&path).expect("has a reader");
        writer.write_all(b"nine byte").expect("space");
        assert_eq!(pipe.read_to_end(&mut bytes).expect_err("one too many").kind(), ErrorKind::FileTooLarge);
    }
}
