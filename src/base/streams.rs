//! Standard output and standard error, which may be full or closed: an error, never a panic.
//!
//! Output that cannot be written ends the program: silently when its reader has gone (`| head`), with a message on
//! standard error otherwise. Messages that cannot be written end nothing, since a run must reach its end without them;
//! [`status_of_streams`] turns them into an exit status at the end. Names of files may hold any character: those that
//! move the cursor, ring the bell or change what is on the screen are escaped. Tests: below.

use core::fmt;
use std::io::{self, Write};
use std::sync::OnceLock;

/// Exit status when the reader of standard output is gone: that of a program which SIGPIPE ends.
pub const EXIT_BROKEN_PIPE: u8 = 128 + 13;
/// Exit status when a standard stream cannot be written for another reason, such as a full disk.
const EXIT_UNWRITTEN: u8 = 1;

/// The first failure of standard output and of standard error.
static FAILURES: [OnceLock<io::Error>; 2] = [const { OnceLock::new() }; 2];

/// One of the two streams.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stream {
    Output,
    Error,
}

impl Stream {
    fn failure(self) -> &'static OnceLock<io::Error> {
        &FAILURES[self as usize]
    }

    fn name(self) -> &'static str {
        match self {
            Self::Output => "standard output",
            Self::Error => "standard error",
        }
    }

    fn write(self, text: fmt::Arguments<'_>) -> io::Result<()> {
        let mut said = String::new();
        fmt::write(&mut said, text).map_err(io::Error::other)?;
        let said = escaped(said);
        match self {
            Self::Output => io::stdout().lock().write_all(said.as_bytes()),
            Self::Error => io::stderr().lock().write_all(said.as_bytes()),
        }
    }

    /// Keeps the first failure; returns the same error.
    fn noted(self, error: io::Error) -> io::Error {
        let again = copy_of(&error);
        let _ = self.failure().set(error); // the first one is kept
        again
    }
}

/// Returns a text with control characters escaped; ends of lines, tabs, and returns of lines that are written again stay.
fn escaped(text: String) -> String {
    let is_plain = |c: char| !c.is_control() || matches!(c, '\n' | '\t' | '\r');
    if text.chars().all(is_plain) {
        return text;
    }
    let mut plain = String::with_capacity(2 * text.len());
    for c in text.chars() {
        if is_plain(c) {
            plain.push(c);
        } else {
            plain.extend(c.escape_default());
        }
    }
    plain
}

fn copy_of(error: &io::Error) -> io::Error {
    error.raw_os_error().map_or_else(|| io::Error::new(error.kind(), error.to_string()), io::Error::from_raw_os_error)
}

/// Writes to standard output; ends the program when that is impossible.
pub fn print(text: fmt::Arguments<'_>) {
    if let Err(error) = Stream::Output.write(text) {
        drop(Stream::Output.noted(error));
        crate::unfinished::remove_all_at_the_end();
        std::process::exit(i32::from(status_of_streams(0)));
    }
}

/// Writes to standard error; what cannot be written is left out.
pub fn say(text: fmt::Arguments<'_>) {
    if Stream::Error.failure().get().is_none()
        && let Err(error) = Stream::Error.write(text)
    {
        drop(Stream::Error.noted(error));
    }
}

/// Standard output for code that writes more than lines: its errors are returned, and [`status_of_streams`] knows them.
#[derive(Debug, Default)]
pub struct Output;

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        io::stdout().write(bytes).map_err(|error| Stream::Output.noted(error))
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stdout().flush().map_err(|error| Stream::Output.noted(error))
    }
}

/// Notes that other code could not write to standard error, or to standard output.
pub fn note_failure(is_error_stream: bool, error: io::Error) {
    let stream = if is_error_stream { Stream::Error } else { Stream::Output };
    drop(stream.noted(error));
}

/// Returns true when standard output could not be written.
pub fn output_has_failed() -> bool {
    Stream::Output.failure().get().is_some()
}

/// Returns the exit status of a command that ended with `status`: the same when both streams could be written to their
/// end. Otherwise 0 becomes an error, and the other stream gets a message, unless the reader has gone.
pub fn status_of_streams(status: u8) -> u8 {
    if !output_has_failed()
        && let Err(error) = io::stdout().flush()
    {
        drop(Stream::Output.noted(error));
    }
    let mut worst = status;
    for (stream, other) in [(Stream::Output, Stream::Error), (Stream::Error, Stream::Output)] {
        let Some(failure) = stream.failure().get() else { continue };
        let is_closed = failure.kind() == io::ErrorKind::BrokenPipe;
        if !is_closed {
            // A failure of both streams cannot be reported.
            let failure = failure.to_string();
            let words = failure.split(" (os error ").next().unwrap_or_default();
            let _ = other.write(format_args!("starloop: cannot write to {}: {words}\n", stream.name()));
        }
        if worst == 0 {
            worst = if is_closed { EXIT_BROKEN_PIPE } else { EXIT_UNWRITTEN };
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_would_change_a_terminal_are_escaped() {
        let name = "a\u{1b}[31m\u{7}\u{9b}1m.fits";
        assert_eq!(escaped(format!("\r{name}:\tgr\u{fc}n\n")), "\ra\\u{1b}[31m\\u{7}\\u{9b}1m.fits:\tgr\u{fc}n\n");
        assert_eq!(escaped("12 frames, 3 µm ✓\n".into()), "12 frames, 3 µm ✓\n", "control");
    }
}
