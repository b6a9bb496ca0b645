//! Path of a port -> an open port with its settings, for this program alone, or the reason and advice.

use super::{SerialParams, settings::apply};
use crate::LinkError;
use rustix::fs::{FlockOperation, Mode, OFlags, flock, open};
use rustix::io::Errno;
use rustix::termios::{QueueSelector, ioctl_tiocexcl, tcflush};
use std::io;
use std::os::fd::{AsFd, OwnedFd};

const ABSENT: &str = "; check the cable and the name (names under /dev/serial/by-id survive replugging)";
const FORBIDDEN: &str = "; add the user to the group of the port: `usermod -aG dialout USER`, then log in again";
const BUSY: &str = "; another program has it open: `fuser -v` on the port shows which";
const NOT_A_PORT: &str = "; this is not a serial port: wanted a device such as /dev/ttyUSB0";
const NOT_TAKEN: &str = "; choose settings that the adapter has";

/// Opens without waiting for a carrier, non-blocking; input that arrived before is thrown away.
pub(super) fn open_port(params: &SerialParams) -> Result<OwnedFd, LinkError> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let port = open(&params.path, flags, Mode::empty()).map_err(|error| refused(params, error))?;
    let failed = |doing, source, advice| LinkError::System { link: name(params), doing, source, advice };
    flock(&port, FlockOperation::NonBlockingLockExclusive)
        .and_then(|()| ioctl_tiocexcl(&port))
        .map_err(|error| failed("lock the port", error.into(), lock_advice(error)))?;
    apply(port.as_fd(), params).map_err(|error| failed("set the port", error, NOT_TAKEN))?;
    tcflush(&port, QueueSelector::IOFlush).map_err(|error| failed("empty the port", error.into(), ""))?;
    Ok(port)
}

/// Returns the name of a link, for messages.
pub(super) fn name(params: &SerialParams) -> String {
    params.path.display().to_string()
}

/// Returns what to do when a port cannot be locked.
fn lock_advice(error: Errno) -> &'static str {
    match error {
        _ if is_busy(error) => BUSY,
        Errno::NOTTY => NOT_A_PORT,
        _ => "",
    }
}

fn is_busy(error: Errno) -> bool {
    matches!(error, Errno::BUSY | Errno::WOULDBLOCK)
}

fn refused(params: &SerialParams, error: Errno) -> LinkError {
    let advice = match error {
        Errno::NOENT | Errno::NODEV | Errno::NXIO | Errno::IO => ABSENT,
        Errno::ACCESS | Errno::PERM => FORBIDDEN,
        Errno::BUSY => BUSY,
        _ => "",
    };
    let system = io::Error::from(error);
    let source = io::Error::new(system.kind(), format!("{system} (ports here: {})", ports()));
    LinkError::System { link: name(params), doing: "open the port", source, advice }
}

/// Returns the ports of this machine, as text.
fn ports() -> String {
    let ports = serialport::available_ports().unwrap_or_default();
    let names: Vec<_> = ports.into_iter().map(|port| port.port_name).collect();
    if names.is_empty() { "none".into() } else { names.join(", ") }
}
