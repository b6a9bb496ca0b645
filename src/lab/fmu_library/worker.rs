//! The program that runs the unit, started from the unit's own resources.
//!
//! It goes on until its socket closes, so it ends with the instance, and with the simulator however that ends. It has a
//! process group of its own: Ctrl-C in the simulator's terminal is the simulator's to act on.

use crate::protocol::{Operation, Reply, Status, read_reply, request};
use core::ffi::{c_int, c_void};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::{fs::PermissionsExt, net::UnixStream, process::CommandExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::{fs, io, net::Shutdown};

/// The program, below the resources.
const PROGRAM: &str = "starloop";
/// `MSG_NOSIGNAL`: a program that has ended is an error, not a signal that ends the simulator.
const NO_SIGNAL: c_int = 0x4000;

unsafe extern "C" {
    fn send(socket: c_int, bytes: *const c_void, count: usize, flags: c_int) -> isize;
}

/// A program that runs.
#[derive(Debug)]
pub struct Worker {
    child: Child,
    stream: UnixStream,
}

impl Worker {
    /// Starts the program for a unit of a version of FMI, and returns it when it has taken the unit in.
    ///
    /// # Errors
    /// With why it cannot be started, or what it refuses.
    pub fn start(version: &str, resources: &str, token: &str) -> Result<Self, String> {
        let program = Path::new(resources).join(PROGRAM);
        let refuse = |error: io::Error| {
            format!(
                "{}: cannot start the program of this unit: {error}; the folder must allow programs",
                program.display()
            )
        };
        let (ours, theirs) = UnixStream::pair().map_err(refuse)?;
        let child = launch(&program, [version, resources, token], theirs).map_err(refuse)?;
        let mut worker = Self { child, stream: ours };
        let reply = worker.reply();
        if reply.status == Status::Ok { Ok(worker) } else { Err(reply.message) }
    }

    /// Asks for one thing; a program that has ended is a fatal reply.
    pub fn ask(&mut self, operation: Operation, content: &[u8]) -> Reply {
        match send_all(&self.stream, &request(operation, content)) {
            Ok(()) => self.reply(),
            Err(_gone) => self.ended(),
        }
    }

    fn reply(&mut self) -> Reply {
        match read_reply(&mut self.stream) {
            Ok(Some(reply)) => reply,
            Ok(None) => self.ended(),
            Err(error) if error.kind() == io::ErrorKind::InvalidData => Reply::of(Status::Fatal, error.to_string()),
            Err(_gone) => self.ended(),
        }
    }

    fn ended(&mut self) -> Reply {
        let _ = self.stream.shutdown(Shutdown::Both); // it may be closed already
        let how = self.child.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        Reply::of(Status::Fatal, format!("the program of this unit has ended ({how}); free the instance"))
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        let _ = self.stream.shutdown(Shutdown::Both); // it may be closed already
        let _ = self.child.wait(); // a simulator that collects its children has done so
    }
}

/// Starts the program with one end of the socket as its standard input. Unzipping may lose the permission to run it.
fn launch(program: &PathBuf, words: [&str; 3], socket: UnixStream) -> io::Result<Child> {
    let mode = fs::metadata(program)?.permissions().mode();
    if mode & 0o100 == 0 {
        fs::set_permissions(program, fs::Permissions::from_mode(mode | 0o700))?;
    }
    let mut command = Command::new(program);
    command.args(["fmu", "--worker"]).args(words);
    command.stdin(Stdio::from(OwnedFd::from(socket))).process_group(0).spawn()
}

fn send_all(stream: &UnixStream, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        // SAFETY: an open socket, and as many bytes as are said.
        let sent = unsafe { send(stream.as_raw_fd(), bytes.as_ptr().cast(), bytes.len(), NO_SIGNAL) };
        match usize::try_from(sent) {
            Ok(sent) => bytes = bytes.get(sent..).unwrap_or_default(),
            Err(_) if io::Error::last_os_error().kind() == io::ErrorKind::Interrupted => {}
            Err(_) => return Err(io::Error::last_os_error()),
        }
    }
    Ok(())
}
