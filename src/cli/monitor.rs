//! The progress line of a run, drawn by a thread of its own.

use anyhow::{Context, Result};
use base::streams::say;
use crossbeam_channel::{Receiver as Queue, Sender, bounded};
use frames::report::{Progress, progress_line};
use std::{io::IsTerminal, time::Duration};

/// The thread that draws the progress line: nothing real-time.
pub(super) struct Monitor {
    pub(super) updates: Sender<Progress>,
    thread: std::thread::JoinHandle<()>,
}

impl Monitor {
    pub(super) fn start(say: bool) -> Result<Self> {
        let (updates, queue) = bounded(1);
        let watch = move || watch(&queue, say && std::io::stderr().is_terminal());
        let thread = std::thread::Builder::new()
            .name("monitor".into())
            .spawn(watch)
            .context("cannot start the monitor thread")?;
        Ok(Self { updates, thread })
    }

    /// Ends the thread; false when it has already ended by itself.
    ///
    /// All other holders of `updates` must have dropped it.
    pub(super) fn finish(self) -> bool {
        drop(self.updates);
        self.thread.join().is_ok()
    }
}

/// How often the progress line is drawn at most.
const REDRAW: Duration = Duration::from_millis(100);

/// Draws updates until all senders are gone.
fn watch(queue: &Queue<Progress>, draws: bool) {
    let mut drawn = false;
    for update in queue {
        if draws {
            draw(&update);
            drawn = true;
            std::thread::sleep(REDRAW);
        }
    }
    if drawn {
        say(format_args!("\n"));
    }
}

fn draw(update: &Progress) {
    const WIDTH: usize = 120;
    say(format_args!("\r{:<WIDTH$}", progress_line(update, WIDTH)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monitor_thread_that_panics_is_reported() {
        assert!(Monitor::start(false).unwrap().finish(), "control: one that ends in order");
        let (updates, queue) = bounded::<Progress>(1);
        let broken = move || {
            let _queue = queue;
            panic!("as the test wants it");
        };
        let thread = std::thread::Builder::new().name("monitor".into()).spawn(broken).unwrap();
        assert!(!Monitor { updates, thread }.finish());
    }
}
