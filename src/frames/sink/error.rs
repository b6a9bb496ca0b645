//! Errors of the sinks.

use base::{refused::Refused, time::Span};
use std::{io, path::PathBuf};

/// A frame or file that did not get out, or a recording that cannot be read back.
#[derive(Debug, thiserror::Error)]
pub enum SinkError {
    /// The directory of a recording cannot be made.
    #[error("recording directory {} cannot be made: {source}; try {}", path.display(), advice(source))]
    Directory {
        /// The directory.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The directory holds an earlier recording.
    #[error(
        "recording directory {} already holds a recording (frames.csv); wanted a new or empty one, so that two runs do \
         not mix; try another directory or remove this one",
        path.display()
    )]
    Occupied {
        /// The directory.
        path: PathBuf,
    },
    /// A file could not be written.
    #[error(
        "{} could not be written: {source}; nothing half-written was left and earlier files are intact; try {}",
        path.display(),
        advice(source)
    )]
    Write {
        /// The file under its final name.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A name that a file of the program needs belongs to something else.
    #[error(
        "{} is there already (a file, link, pipe, device or folder that this run did not make) and is left as it is; \
         wanted a free name: try a new or empty directory",
        path.display()
    )]
    NameTaken {
        /// The path.
        path: PathBuf,
    },
    /// The ring of frames lost its name while the run went on.
    #[error(
        "{} was removed or replaced by another program while the run wrote to it: readers that have it open still get \
         frames, new readers find none; start the run again, and keep other programs from removing the file",
        path.display()
    )]
    Vanished {
        /// The file.
        path: PathBuf,
    },
    /// A frame number that does not follow the ones already recorded.
    #[error("frame {got} after frame {last} in {}: wanted a larger number; give a repeated frame a number of its own", path.display())]
    FrameOrder {
        /// The recording.
        path: PathBuf,
        /// Last number recorded.
        last: u32,
        /// Number refused.
        got: u32,
    },
    /// A frame of another size than those before it in a file that holds one size.
    #[error(
        "{} holds frames of {} x {} px, and this one has {} x {}; wanted one size in a file",
        path.display(), wanted[0], wanted[1], got[0], got[1]
    )]
    FrameSize {
        /// The file.
        path: PathBuf,
        /// Columns and rows of the frames in it.
        wanted: [usize; 2],
        /// Columns and rows of the frame.
        got: [usize; 2],
    },
    /// A frame sent after the end of the run.
    #[error("frame {frame} was sent to the {sink} sink after its end; send every frame before finish")]
    Finished {
        /// The sink's name.
        sink: &'static str,
        /// The frame.
        frame: u32,
    },
    /// The name of the shared memory belongs to something else.
    #[error("{} is not a ring of frames of starloop, and is not replaced; wanted a name that is free", path.display())]
    NotShared {
        /// The file.
        path: PathBuf,
    },
    /// The name of the shared memory belongs to a run that goes on.
    #[error("{} is written by another run; wanted a name that is free: give each run a path of its own", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// A sink that has broken down.
    #[error("the {sink} sink has broken down and takes no more frames; the other sinks go on")]
    Lost {
        /// The sink's name.
        sink: &'static str,
    },
    /// A sink that blocks.
    #[error(
        "the {sink} sink has finished nothing for {:.1} s and was given up: is its disk, network or reader \
         still there?",
        patience.s()
    )]
    Stuck {
        /// The sink's name.
        sink: &'static str,
        /// Time that was waited.
        patience: Span,
    },
    /// A device that did not take a frame.
    #[error("frame {frame} did not get out by the {sink} sink: {source}")]
    Device {
        /// The sink's name.
        sink: &'static str,
        /// The frame.
        frame: u32,
        /// Error reported by the device's own module.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Bytes that are not a FITS image this reader knows.
    #[error("not a FITS image starloop can read: {what}: wanted {wanted}, got {got}")]
    BadFits {
        /// Place in the file.
        what: &'static str,
        /// Contents that are readable.
        wanted: &'static str,
        /// Contents that were found.
        got: String,
    },
    /// A FITS file that is cut short, or whose bytes contradict each other.
    #[error("the FITS file is damaged: {what}: wanted {wanted}, got {got}")]
    DamagedFits {
        /// Place in the file.
        what: &'static str,
        /// Contents that are readable.
        wanted: &'static str,
        /// Contents that were found.
        got: String,
    },
    /// A refusal that is only a sentence.
    #[error(transparent)]
    Refused(#[from] Refused),
}

/// Returns how a person can fix an I/O error.
#[allow(clippy::wildcard_enum_match_arm, reason = "the kinds of I/O errors are the standard library's, and open")]
fn advice(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "freeing space or another disk",
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => "a directory you may write to",
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => "a path whose parent is an existing directory",
        io::ErrorKind::IsADirectory => "a file name that is not a directory",
        _ => "another path or disk",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_says_where_why_and_what_to_try() {
        let source = io::Error::from(io::ErrorKind::StorageFull);
        let text = SinkError::Write { path: "run/frame_000001.fits".into(), source }.to_string();
        assert!(text.contains("run/frame_000001.fits"), "where: {text}");
        assert!(text.contains("freeing space"), "what to try: {text}");
    }
}
