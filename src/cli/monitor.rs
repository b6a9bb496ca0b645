//! Ctrl-C and the progress line of a run, in a thread of their own.

use crate::report::{Progress, progress_line};
use anyhow::{Context, Result};
use core::sync::atomic::{AtomicBool, Ordering};
use crossbeam_channel::{Receiver as Queue, Sender, bounded};
use std::io::{IsTerminal, Write};
use std::sync::Arc;
use std::time::Duration;

/// Ctrl-C and the progress line: nothing real-time, so it lives on tokio.
pub(super) struct Monitor {
    pub(super) updates: Sender<Progress>,
    over: Arc<AtomicBool>,
    thread: std::thread::JoinHandle<()>,
}

impl Monitor {
    pub(super) fn start(stop: Arc<AtomicBool>, say: bool) -> Result<Self> {
        let (updates, queue) = bounded(1);
        let over = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&over);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let thread = std::thread::Builder::new()
            .name("monitor".into())
            .spawn(move || runtime.block_on(watch(&queue, &stop, &ended, say)))
            .context("cannot start the monitor thread")?;
        Ok(Self { updates, over, thread })
    }

    pub(super) fn finish(self) {
        self.over.store(true, Ordering::SeqCst);
        drop(self.updates);
        let _nothing_to_report = self.thread.join();
    }
}

/// How often the progress line is drawn.
const REDRAW: Duration = Duration::from_millis(100);

async fn watch(queue: &Queue<Progress>, stop: &AtomicBool, over: &AtomicBool, say: bool) {
    let terminal = std::io::stderr().is_terminal();
    let mut redraw = tokio::time::interval(REDRAW);
    let mut drawn = false;
    while !over.load(Ordering::SeqCst) {
        tokio::select! {
            pressed = tokio::signal::ctrl_c() => if pressed.is_ok() { stop.store(true, Ordering::SeqCst) },
            _ = redraw.tick() => {
                if let (true, true, Some(update)) = (say, terminal, queue.try_iter().last()) {
                    draw(&update);
                    drawn = true;
                }
            }
        }
    }
    if drawn {
        eprintln!();
    }
}

fn draw(update: &Progress) {
    const WIDTH: usize = 120;
    let mut out = std::io::stderr().lock();
    let _a_closed_terminal_is_no_error = write!(out, "\r{:<WIDTH$}", progress_line(update, WIDTH));
    let _ = out.flush();
}
