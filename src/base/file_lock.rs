//! A lock of an open file, which the system releases however its holder ends.
//!
//! It belongs to the open file, not to the process: two holders within one program keep each other out too. Programs
//! that use `flock` do not see it.

use nix::fcntl::{FcntlArg, fcntl};
use nix::{errno::Errno, libc};
use std::{io, os::fd::AsFd};

/// Takes the lock of `bytes` bytes from `first` on (0: to the end, however far that is); false when another open file
/// has it. It goes with the last descriptor of this open file.
///
/// # Errors
/// When the file cannot be locked at all.
pub fn take(file: &impl AsFd, first: i64, bytes: i64) -> io::Result<bool> {
    #[allow(clippy::cast_possible_truncation, reason = "small constants, which the system takes as short ones")]
    let (kind, whence) = (libc::F_WRLCK as libc::c_short, libc::SEEK_SET as libc::c_short);
    let lock = libc::flock { l_type: kind, l_whence: whence, l_start: first, l_len: bytes, l_pid: 0 };
    match fcntl(file, FcntlArg::F_OFD_SETLK(&lock)) {
        Ok(_) => Ok(true),
        Err(Errno::EAGAIN | Errno::EACCES) => Ok(false),
        Err(error) => Err(error.into()),
    }
}
