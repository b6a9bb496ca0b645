//! A pseudo-terminal with slcan on it, which looks like a USB adapter to a program.
//!
//! The link of a run that was killed is replaced by the next run's; that of a run that goes on is not.

use super::client::{ClientParts, OnStall, serve};
use super::{Tally, slcan, system};
use crate::{LinkError, serial::PseudoTerminal, simulated::SimulatedBus};
use base::{clock::Clock, time::Span};
use core::sync::atomic::{AtomicBool, Ordering};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use std::path::{Path, PathBuf};
use std::{os::fd::OwnedFd, sync::Arc, thread::JoinHandle};

const NAME: &str = "PTY";
/// Folder in which the system puts PTYs.
const DEVICES: &str = "/dev/pts";

/// A symbolic link to a PTY, which goes away with it.
#[derive(Debug)]
pub struct LinkedTerminal {
    /// The link that was asked for.
    path: PathBuf,
    /// Its target.
    device: PathBuf,
}

impl LinkedTerminal {
    /// Opens a PTY and links `path` to it. Returns the link, the master, which does not block, and the other end, to be
    /// kept open.
    ///
    /// # Errors
    /// When the system has none left, another run serves the link, or something else is there.
    pub fn open(path: &Path) -> Result<(Self, OwnedFd, OwnedFd), LinkError> {
        let (fd, device_end, device) = PseudoTerminal::open()?.into_ends();
        let refuse = |doing, advice| {
            let link = format!("{NAME} {}", path.display());
            move |source| system(&link, doing, source, advice)
        };
        lock(&device_end).map_err(refuse("lock the PTY", ""))?;
        let is_live = is_live_link(path, &device);
        if is_live == Some(false) {
            std::fs::remove_file(path).map_err(refuse("remove the link of a run that is over", ""))?;
        }
        let advice = match is_live {
            Some(true) => "; a run that goes on serves this link: give each run a path of its own",
            Some(false) | None => "; name a path in a folder that is there, with nothing at it",
        };
        std::os::unix::fs::symlink(&device, path).map_err(refuse("link to the PTY", advice))?;
        Ok((Self { path: path.into(), device }, fd, device_end))
    }

    /// Returns the link's path.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for LinkedTerminal {
    fn drop(&mut self) {
        // Only our own link: another file may be there now.
        if std::fs::read_link(&self.path).is_ok_and(|target| target == self.device) {
            let _ = std::fs::remove_file(&self.path); // a link that remains is harmless
        }
    }
}

/// A PTY that is served, with a symbolic link to it.
pub(super) struct Pty {
    /// The link that was asked for.
    pub(super) link: LinkedTerminal,
    thread: Option<JoinHandle<()>>,
}

/// Opens a PTY, links `path` to it and serves it.
pub(super) fn open(
    path: &Path,
    bus: &SimulatedBus,
    clock: &Arc<dyn Clock>,
    tally: &Arc<Tally>,
    patience: Span,
    ended: &Arc<AtomicBool>,
) -> Result<Pty, LinkError> {
    let (link, fd, device_end) = LinkedTerminal::open(path)?;
    let parts = ClientParts {
        fd,
        link: bus.attach(),
        clock: Arc::clone(clock),
        tally: Arc::clone(tally),
        on_stall: OnStall::CloseChannel(device_end),
        patience,
        ended: Arc::clone(ended),
        admission: None,
    };
    let channel = slcan::Channel::new(&bus.params().timing);
    let thread = serve(parts, Box::new(channel), slcan_scribe());
    let thread = Some(thread.map_err(|source| system(NAME, "start a thread", source, ""))?.thread);
    Ok(Pty { link, thread })
}

/// Marks a PTY as served for as long as its device end is open; false when another run serves it.
fn lock(device_end: &OwnedFd) -> std::io::Result<bool> {
    base::file_lock::take(device_end, 0, 0)
}

/// Returns whether `path` is a link to a PTY that another run serves; `None` when it is not a link to a PTY. `ours` has
/// just been made: a link to it was made when its number belonged to another PTY.
fn is_live_link(path: &Path, ours: &Path) -> Option<bool> {
    let device = std::fs::read_link(path).ok().filter(|device| device.starts_with(DEVICES))?;
    if device == ours {
        return Some(false);
    }
    match rustix::fs::open(&device, OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC, Mode::empty()) {
        Ok(device_end) => Some(!lock(&device_end).unwrap_or(false)),
        // Nothing there, or the number of a PTY whose other end is closed: its run is over.
        Err(Errno::NOENT | Errno::NXIO | Errno::IO) => Some(false),
        // It belongs to another program.
        Err(_) => Some(true),
    }
}

/// Returns the writing half of slcan.
pub(super) fn slcan_scribe() -> super::client::Scribe {
    Box::new(|packet, listening, out| slcan::line(packet, listening.stamps.load(Ordering::Relaxed), out))
}

impl Pty {
    /// Waits for its threads, which end when the gateways do.
    pub(super) fn join(&mut self) {
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // one that panicked has counted itself
        }
    }
}
