//! SIGINT, SIGTERM and SIGHUP: the first one ends a command in order, the second one at once. What follows within
//! [`TWICE`] is the same signal: `timeout` sends it to the program and to its group.
//!
//! [`catch`] is the first thing that the program does. A command that ends in order (it writes a summary, removes its
//! ring and its links) calls [`stop`] and looks at the flag; any other command ends with the first signal, after the
//! files that it has not finished are removed. The handlers set flags that nothing resets, so no signal is lost however
//! early or often it comes. SIGHUP stays ignored where the caller ignores it (`nohup`).

use anyhow::{Context, Result};
use base::{streams::say, unfinished};
use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::{flag, iterator::Signals, low_level};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// Added to a signal's number in an exit status.
const EXIT_BY_SIGNAL: i32 = 128;
/// A command that waits for something else looks for a signal this often.
const LOOK: Duration = Duration::from_millis(50);
/// A signal that comes again so soon is not a second one.
const TWICE: Duration = Duration::from_millis(200);

/// Flags that the handlers set.
struct Caught {
    /// A signal has come.
    stop: Arc<AtomicBool>,
    /// Number of the newest signal; 0 before the first.
    newest: Arc<AtomicUsize>,
    /// The command looks at `stop` and ends by itself.
    ends_in_order: AtomicBool,
}

static CAUGHT: OnceLock<Caught> = OnceLock::new();

/// Catches the signals from here on. Once.
///
/// # Errors
/// When the system refuses a handler or a thread.
pub(super) fn catch() -> Result<()> {
    let caught = CAUGHT.get_or_init(|| Caught {
        stop: Arc::default(),
        newest: Arc::default(),
        ends_in_order: AtomicBool::new(false),
    });
    let is_second = Arc::new(AtomicBool::new(false));
    let signals: Vec<i32> = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| is_to_be_caught(*signal)).collect();
    for signal in signals.iter().copied() {
        flag::register_conditional_shutdown(signal, EXIT_BY_SIGNAL + signal, Arc::clone(&is_second))
            .and_then(|_| flag::register_usize(signal, Arc::clone(&caught.newest), signal.unsigned_abs() as usize))
            .and_then(|_| flag::register(signal, Arc::clone(&caught.stop)))
            .with_context(|| format!("cannot catch {}", name(signal)))?;
    }
    let mut arriving = Signals::new(&signals).context("cannot wait for signals")?;
    let end = move || {
        for signal in arriving.forever() {
            if !caught.ends_in_order.load(Ordering::SeqCst) {
                end_now(signal);
            }
            std::thread::sleep(TWICE);
            is_second.store(true, Ordering::SeqCst);
        }
    };
    std::thread::Builder::new().name("signals".into()).spawn(end).context("cannot start the signal thread")?;
    Ok(())
}

/// Returns the flag that the first signal sets; from here on the command ends by itself.
pub(super) fn stop() -> Arc<AtomicBool> {
    let Some(caught) = CAUGHT.get() else { return Arc::default() };
    caught.ends_in_order.store(true, Ordering::SeqCst);
    Arc::clone(&caught.stop)
}

/// Waits until `stop` is set.
pub(super) async fn stopped(stop: &AtomicBool) {
    let mut look = tokio::time::interval(LOOK);
    while !stop.load(Ordering::SeqCst) {
        look.tick().await;
    }
}

/// Returns the exit status of a command that a signal ended in order: 130 for SIGINT, 143 for SIGTERM, 129 for SIGHUP.
pub(super) fn exit_status() -> u8 {
    u8::try_from(EXIT_BY_SIGNAL + newest()).unwrap_or(super::EXIT_INTERRUPTED)
}

/// Returns the signal that ended the command, for people.
pub(super) fn cause() -> &'static str {
    name(newest())
}

/// Returns the number of the newest signal; SIGINT where none was caught.
fn newest() -> i32 {
    let newest = CAUGHT.get().map_or(0, |caught| caught.newest.load(Ordering::SeqCst));
    i32::try_from(newest).ok().filter(|signal| *signal != 0).unwrap_or(SIGINT)
}

fn name(signal: i32) -> &'static str {
    match signal {
        SIGTERM => "SIGTERM",
        SIGHUP => "SIGHUP",
        _ => "Ctrl-C",
    }
}

/// Ends a command that does not end by itself.
fn end_now(signal: i32) -> ! {
    unfinished::remove_all_at_the_end();
    say(format_args!("starloop: stopped by {}\n", name(signal)));
    // Without the library's handlers at exit: other threads are still at work.
    low_level::exit(EXIT_BY_SIGNAL + signal)
}

/// Returns false for SIGHUP where it is ignored, as below `nohup`.
fn is_to_be_caught(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    signal != SIGHUP || !is_ignored(&status, signal)
}

/// Returns whether the text of `/proc/self/status` lists a signal as ignored.
fn is_ignored(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_are_read_from_the_status_of_the_process() {
        let status =
            "Name:\tstarloop\nSigBlk:\t0000000000000001\nSigIgn:\t0000000000001001\nSigCgt:\t0000000000004002\n";
        assert!(is_ignored(status, SIGHUP), "bit 0");
        assert!(!is_ignored(status, SIGINT) && !is_ignored(status, SIGTERM));
        assert!(!is_ignored("", SIGHUP), "unknown is not ignored");
    }

    #[test]
    fn without_handlers_a_command_gets_a_flag_of_its_own() {
        assert!(!stop().load(Ordering::SeqCst));
        assert_eq!((exit_status(), cause()), (130, "Ctrl-C"));
    }
}
