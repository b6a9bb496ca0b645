//! Neighbours that keep processors busy while a run is timed: ordinary threads that never sleep.

use anyhow::{Context, Result};
use core::sync::atomic::{AtomicBool, Ordering};
use std::{sync::Arc, thread::JoinHandle};

/// Busy threads, until they are dropped. Start them before the run's threads: they keep the ordinary scheduling of the
/// thread that starts them.
pub(super) struct LoadThreads {
    over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl LoadThreads {
    /// Starts `count` of them.
    ///
    /// # Errors
    /// When the system gives no more threads.
    pub(super) fn start(count: usize) -> Result<Self> {
        let mut load = Self { over: Arc::new(AtomicBool::new(false)), threads: Vec::new() };
        for i in 0..count {
            let over = Arc::clone(&load.over);
            let thread = std::thread::Builder::new()
                .name(format!("load {i}"))
                .spawn(move || keep_busy(&over))
                .with_context(|| format!("--load: thread {i} of {count}"))?;
            load.threads.push(thread);
        }
        Ok(load)
    }
}

impl Drop for LoadThreads {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _it_only_counts = thread.join();
        }
    }
}

fn keep_busy(over: &AtomicBool) {
    let mut count = 0_u64;
    while !over.load(Ordering::Relaxed) {
        for _ in 0..10_000 {
            count = core::hint::black_box(count.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
        }
    }
}
