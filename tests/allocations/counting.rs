//! An allocator that counts every allocation of every thread while it is armed, and stores the call stacks.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::{backtrace::Backtrace, cell::Cell, sync::Mutex};

/// Bytes allocated now, and the maximum since the last look.
static HELD: AtomicUsize = AtomicUsize::new(0);
static MOST_HELD: AtomicUsize = AtomicUsize::new(0);
static ARMED: AtomicBool = AtomicBool::new(false);
static FOUND: Mutex<Vec<Found>> = Mutex::new(Vec::new());

/// Number of call stacks that are stored; a single allocation is already an error.
const REMEMBERED: usize = 32;

thread_local! {
    /// True while this thread records an allocation, which allocates itself.
    static WRITING: Cell<bool> = const { Cell::new(false) };
}

/// One allocation.
#[derive(Debug, Clone)]
pub(crate) struct Found {
    pub(crate) bytes: usize,
    /// Call stack, as text.
    pub(crate) stack: String,
}

impl Found {
    /// Returns true when a line of this repository is on the stack. The test harness's own thread notes a test that it has
    /// started, waits for its end, and prints a line while it takes long.
    pub(crate) fn is_ours(&self) -> bool {
        let harness = ["get_timed_out_tests", "write_timeout", "RunningTest", "TimeoutEntry", "CompletedTest"];
        let is_the_harness = harness.iter().any(|name| self.stack.contains(name));
        self.stack.contains("at ./") && !is_the_harness
    }

    /// Returns the innermost calls of starloop; the whole stack where they have no name.
    pub(crate) fn place(&self) -> String {
        // Where crates have no lines of their own in the debug information, their functions have names.
        let is_ours = |line: &&str| line.starts_with("at ./src/") || line.contains("starloop_");
        let ours = self.stack.lines().map(str::trim).filter(is_ours);
        let place = ours.take(4).collect::<Vec<_>>().join(" < ");
        if place.is_empty() { self.stack.clone() } else { place }
    }
}

/// The system's allocator, with counting.
pub(crate) struct Counting;

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        write_down(layout.size());
        take(layout.size());
        // SAFETY: the caller's promises are those of the system's allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        write_down(layout.size());
        take(layout.size());
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        write_down(bytes);
        // Both blocks may exist while one is copied.
        take(bytes);
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, bytes) }
    }
}

fn write_down(bytes: usize) {
    if !ARMED.load(Ordering::SeqCst) || WRITING.replace(true) {
        return;
    }
    if let Ok(mut found) = FOUND.lock()
        && found.len() < REMEMBERED
    {
        let stack = Backtrace::force_capture().to_string();
        found.push(Found { bytes, stack });
    }
    WRITING.set(false);
}

fn take(bytes: usize) {
    let held = HELD.fetch_add(bytes, Ordering::Relaxed) + bytes;
    MOST_HELD.fetch_max(held, Ordering::Relaxed);
}

/// Returns the largest number of bytes that all threads hold at one time while `work` runs, beyond those held before.
pub(crate) fn most_held_in(work: impl FnOnce()) -> usize {
    let before = HELD.load(Ordering::Relaxed);
    MOST_HELD.store(before, Ordering::Relaxed);
    work();
    MOST_HELD.load(Ordering::Relaxed).saturating_sub(before)
}

/// Returns the allocations of all threads while `work` runs.
pub(crate) fn allocations_in(work: impl FnOnce()) -> Vec<Found> {
    ARMED.store(true, Ordering::SeqCst);
    work();
    ARMED.store(false, Ordering::SeqCst);
    std::mem::take(&mut *FOUND.lock().unwrap())
}
