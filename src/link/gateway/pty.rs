//! A pseudo-terminal with slcan on it: what a USB adapter looks like to a program.

use super::client::{ClientParts, OnStall, serve};
use super::counters::Tally;
use super::{slcan, system};
use crate::base::clock::Clock;
use crate::base::time::Span;
use crate::link::LinkError;
use crate::link::serial::PseudoTerminal;
use crate::link::simulated::SimulatedBus;
use core::sync::atomic::{AtomicBool, Ordering};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

const NAME: &str = "slcan on a PTY";

/// A PTY that is served, with a symbolic link to it.
pub(super) struct Pty {
    /// The link that was asked for.
    pub(super) path: PathBuf,
    /// What it leads to.
    device: PathBuf,
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
    let (fd, device_end, device) = PseudoTerminal::open()?.into_ends();
    let advice = "; name a path in a folder that is there, with nothing at it";
    std::os::unix::fs::symlink(&device, path)
        .map_err(|source| system(&format!("{NAME} {}", path.display()), "link to the PTY", source, advice))?;
    // From here on: dropped, it takes the link away.
    let mut pty = Pty { path: path.into(), device, thread: None };
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
    pty.thread = Some(thread.map_err(|source| system(NAME, "start a thread", source, ""))?.thread);
    Ok(pty)
}

/// The writing half of slcan.
pub(super) fn slcan_scribe() -> super::client::Scribe {
    Box::new(|packet, listening, out| slcan::line(packet, listening.stamps.load(Ordering::Relaxed), out))
}

impl Pty {
    /// Waits for its threads, which end when the gateways do.
    pub(super) fn join(&mut self) {
        if let Some(thread) = self.thread.take() {
            let _a_lost_thread_is_gone_too = thread.join();
        }
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        // Only our own link: somebody may have put another thing there.
        if std::fs::read_link(&self.path).is_ok_and(|target| target == self.device) {
            let _a_link_that_stays_is_no_error = std::fs::remove_file(&self.path);
        }
    }
}
