//! The program that runs the unit, started from the unit's own resources.
//!
//! It goes on until its socket closes, so it ends with the instance, and with the simulator however that ends. It has a
//! process group of its own: Ctrl-C in the simulator's terminal is the simulator's to act on.

use crate::protocol::{Reply, Request, Status};
use core::ffi::{c_int, c_void};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::{fs::PermissionsExt, net::UnixStream, process::CommandExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::{fs, io, net::Shutdown, path::Path};

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
    /// Starts the program, and returns it when it has taken the unit in.
    ///
    /// # Errors
    /// With why it cannot be started, or what it refuses.
    pub fn start(resources: &str, token: &str) -> Result<Self, String> {
        let program = Path::new(resources).join(PROGRAM);
        let refuse = |error: io::Error| {
            format!(
                "{}: cannot start the program of this unit: {error}; the folder must allow programs",
                program.display()
            )
        };
        let (stream, theirs) = UnixStream::pair().map_err(refuse)?;
        let child = launch(&program, [resources, token], theirs).map_err(refuse)?;
        let mut worker = Self { child, stream };
        let reply = Reply::read(&mut worker.stream).unwrap_or_else(|error| worker.lost(&error));
        if reply.code == Status::Ok { Ok(worker) } else { Err(String::from_utf8_lossy(&reply.head).into()) }
    }

    /// Asks for one thing; a program that has ended is a fatal reply.
    pub fn ask(&mut self, request: &Request) -> Reply {
        let sent = send_all(&self.stream, &request.bytes());
        sent.and_then(|()| Reply::read(&mut self.stream)).unwrap_or_else(|error| self.lost(&error))
    }

    fn lost(&mut self, error: &io::Error) -> Reply {
        let how = self.end().map_or_else(|error| error.to_string(), |status| status.to_string());
        Reply::of(Status::Fatal, &format!("the program of this unit has ended ({how}; {error}); free the instance"))
    }

    /// Closes the socket, by which the program ends.
    fn end(&mut self) -> io::Result<ExitStatus> {
        let _ = self.stream.shutdown(Shutdown::Both); // it may be closed already
        self.child.wait()
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        let _ = self.end(); // a simulator that collects its children has done so
    }
}

/// Starts the program with one end of the socket as its standard input. Unzipping may lose the permission to run it.
fn launch(program: &Path, words: [&str; 2], socket: UnixStream) -> io::Result<Child> {
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
