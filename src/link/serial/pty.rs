//! A pseudo terminal: the far end of a serial port without a cable.
//!
//! It has no bit times and no parity, and holds 4 KiB each way. Closing it discards bytes on their way.

use crate::LinkError;
use rustix::fs::{Mode, OFlags, fcntl_setfl, open};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::{ffi::OsString, os::unix::ffi::OsStringExt};

/// The master's side of a pseudo terminal. Dropping it unplugs the program that has opened [`Self::path`].
#[derive(Debug)]
pub struct PseudoTerminal {
    master: OwnedFd,
    path: PathBuf,
    /// Kept open: without any opener of the port the master would read errors, not silence.
    port: OwnedFd,
}

impl PseudoTerminal {
    /// Returns a new pseudo terminal in raw mode.
    ///
    /// # Errors
    /// When the system has none left.
    pub fn open() -> Result<Self, LinkError> {
        Self::make().map_err(|error| LinkError::System {
            link: "pseudo terminal".into(),
            doing: "make one",
            source: error.into(),
            advice: "; is /dev/pts mounted?",
        })
    }

    fn make() -> rustix::io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        fcntl_setfl(&master, OFlags::RDWR | OFlags::NONBLOCK)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let path = PathBuf::from(OsString::from_vec(ptsname(&master, Vec::new())?.into_bytes()));
        let port = open(&path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
        let mut modes = rustix::termios::tcgetattr(&port)?;
        modes.make_raw();
        rustix::termios::tcsetattr(&port, rustix::termios::OptionalActions::Now, &modes)?;
        Ok(Self { master, path, port })
    }

    /// Returns its parts for another server: the master, which does not block, the port, which must stay open, and the
    /// port's path.
    pub fn into_ends(self) -> (OwnedFd, OwnedFd, PathBuf) {
        (self.master, self.port, self.path)
    }

    /// Returns the port that others open.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl AsFd for PseudoTerminal {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.master.as_fd()
    }
}
