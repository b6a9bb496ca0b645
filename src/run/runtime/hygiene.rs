//! Requests the operating system's help for threads that must be in time, and reports the result.
//!
//! In: [`HygieneParams`]. Out: one [`HygieneLine`] for each request: granted, or why not. Nothing here is needed for
//! correct frames, and an unavailable setting never ends a run. Three things are requested:
//!
//! * **Scheduling**: first-in-first-out (POSIX `SCHED_FIFO`) for the link, frame and sink threads and for the threads
//!   that draw. All of them sleep when they have nothing to do (drawing threads spin for some microseconds first), and the
//!   priorities are low: the kernel's own threads come first. Linux gives real-time threads 95 % of a processor at most
//!   (`sched_rt_runtime_us`). Links come first because a late stamp is wrong for good; drawing comes last.
//! * **Memory**: all pages locked, now and later (`mlockall`), so that none is fetched while a frame waits. Only where
//!   the limit allows it whole: half a lock makes later allocations fail.
//! * **Processors**: the threads stay on given ones (`sched_setaffinity`).
//!
//! *Limits.* No `unsafe` of ours: `thread-priority` and `rustix` wrap the calls.
//! Whether it helps is for `starloop budget --load` to show; the tests check that every result is reported.

use frames::report::HygieneLine;
use std::sync::{Arc, Mutex, PoisonError};

/// Stack touched before a thread's work starts, bytes: more than the deepest measured use of the frame path.
const STACK_BYTES: usize = 256 * 1024;

/// The requested settings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HygieneParams {
    /// Real-time scheduling and locked memory.
    pub realtime: bool,
    /// Priority of the drawing threads, 1 to 90; sink, frame and link come 1, 2 and 3 above.
    pub priority: u8,
    /// Processors that the threads stay on; empty: any.
    pub affinity: Vec<usize>,
}

impl Default for HygieneParams {
    /// Returns real-time scheduling at a low priority, on any processor.
    fn default() -> Self {
        Self { realtime: true, priority: 10, affinity: Vec::new() }
    }
}

/// A kind of thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Stamps arriving packets.
    Link,
    /// Makes frames.
    Frame,
    /// Sends frames.
    Sink,
    /// Draws and reads out, with others of its kind.
    Drawing,
    /// Simulates a machine at the other end of the cable, which load on this machine must not delay.
    FarEnd,
}

impl Role {
    /// Returns the name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Link => "link thread",
            Self::Frame => "frame thread",
            Self::Sink => "sink thread",
            Self::Drawing => "drawing threads",
            Self::FarEnd => "simulated flight computer",
        }
    }

    fn above(self) -> u8 {
        match self {
            Self::Drawing => 0,
            Self::Sink => 1,
            Self::Frame => 2,
            Self::Link | Self::FarEnd => 3,
        }
    }
}

/// The parameters, and the results of the requests. Threads enter at their start; the lock is never taken after that.
pub struct Hygiene {
    params: HygieneParams,
    reported: Mutex<Vec<HygieneLine>>,
    announce: fn(&HygieneLine),
}

impl Hygiene {
    /// Returns the parameters with no request made yet.
    pub fn new(params: HygieneParams) -> Self {
        Self { params, reported: Mutex::default(), announce: |_| {} }
    }

    /// Sets a function that is called with every new line.
    #[must_use]
    pub fn announcing(mut self, announce: fn(&HygieneLine)) -> Self {
        self.announce = announce;
        self
    }

    /// Locks memory and starts the drawing threads, so that `threads` draw: 0 for as many as there are processors. The
    /// calling thread becomes the first of them: the frame thread draws at once what the others would be woken for. Call
    /// before anything is drawn: rayon starts them once.
    ///
    /// # Errors
    /// When the threads cannot start, or run already.
    pub fn prepare(self: &Arc<Self>, threads: usize) -> Result<(), rayon::ThreadPoolBuildError> {
        if self.params.realtime {
            self.report_each("locked memory", system::lock_memory());
        }
        let hygiene = Arc::clone(self);
        let threads = if self.params.affinity.is_empty() { threads } else { self.params.affinity.len() };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("draw {i}"));
        pool.use_current_thread().start_handler(move |_| hygiene.enter(Role::Drawing)).build_global()
    }

    /// Applies the settings to the calling thread, and touches its stack.
    pub fn enter(&self, role: Role) {
        if self.params.realtime {
            let priority = self.params.priority.saturating_add(role.above());
            self.report_each(&format!("{}: first-in-first-out", role.name()), system::schedule(priority));
        }
        if !self.params.affinity.is_empty() {
            let what = format!("{}: processors", role.name());
            self.report_each(&what, system::stay_on(&self.params.affinity));
        }
        touch_stack();
    }

    fn report_each(&self, what: &str, outcome: Result<String, String>) {
        let (got, detail) = outcome.map_or_else(|why| (false, why), |how| (true, how));
        let line = HygieneLine { what: what.to_owned(), got, detail };
        let mut reported = self.reported.lock().unwrap_or_else(PoisonError::into_inner);
        // All drawing threads report the same line.
        if !reported.contains(&line) {
            (self.announce)(&line);
            reported.push(line);
        }
    }

    /// Returns the results so far, in order of names, because threads start in any order.
    pub fn lines(&self) -> Vec<HygieneLine> {
        let mut lines = self.reported.lock().unwrap_or_else(PoisonError::into_inner).clone();
        lines.sort_by(|a, b| (&a.what, &a.detail).cmp(&(&b.what, &b.detail)));
        lines
    }
}

/// Writes to the pages of the stack that later calls will use.
#[inline(never)]
fn touch_stack() {
    let mut pages = [0_u8; STACK_BYTES];
    for byte in pages.iter_mut().step_by(4096) {
        *byte = 1;
    }
    core::hint::black_box(&mut pages);
}

mod system {
    use rustix::mm::{MlockAllFlags, mlockall};
    use rustix::process::{Resource, getrlimit};
    use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_setaffinity};
    use thread_priority::{
        RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
        set_thread_priority_and_policy, thread_native_id,
    };

    pub(super) fn lock_memory() -> Result<String, String> {
        let limit = getrlimit(Resource::Memlock).current;
        let is_free = capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
        if let (Some(bytes), false) = (limit, is_free) {
            return Err(format!("the limit is {} KiB (ulimit -l); wanted unlimited, or CAP_IPC_LOCK", bytes / 1024));
        }
        match mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE) {
            Ok(()) => Ok("all pages, now and later".into()),
            Err(error) => Err(error.to_string()),
        }
    }

    pub(super) fn schedule(priority: u8) -> Result<String, String> {
        let value = ThreadPriorityValue::try_from(priority)?;
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        match set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy) {
            Ok(()) => Ok(format!("priority {priority}")),
            Err(thread_priority::Error::OS(code)) => {
                let error = std::io::Error::from_raw_os_error(code);
                Err(format!("priority {priority}: {error}; wanted CAP_SYS_NICE, or a higher limit (ulimit -r)"))
            }
            Err(error) => Err(format!("priority {priority}: {error}")),
        }
    }

    pub(super) fn stay_on(processors: &[usize]) -> Result<String, String> {
        let mut set = CpuSet::new();
        if let Some(beyond) = processors.iter().find(|processor| **processor >= CpuSet::MAX_CPU) {
            return Err(format!("processor {beyond} does not exist"));
        }
        processors.iter().for_each(|processor| set.set(*processor));
        match sched_setaffinity(None, &set) {
            Ok(()) => Ok(format!("{processors:?}")),
            Err(error) => Err(format!("{processors:?}: {error}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the lines reported for a new thread, so that this test's own thread stays as it is.
    fn reported(params: HygieneParams, role: Role) -> Vec<HygieneLine> {
        let hygiene = Arc::new(Hygiene::new(params));
        let inside = Arc::clone(&hygiene);
        let thread = std::thread::Builder::new().name("reported".into());
        thread.spawn(move || inside.enter(role)).unwrap().join().unwrap();
        hygiene.lines()
    }

    #[test]
    fn every_request_is_reported_as_granted_or_refused() {
        let lines = reported(HygieneParams { affinity: vec![0], ..HygieneParams::default() }, Role::Link);
        let names: Vec<&str> = lines.iter().map(|line| line.what.as_str()).collect();
        assert_eq!(names, ["link thread: first-in-first-out", "link thread: processors"]);
        assert!(lines.iter().all(|line| !line.detail.is_empty()), "{lines:?}");
        let nothing = HygieneParams { realtime: false, ..HygieneParams::default() };
        assert!(reported(nothing, Role::Sink).is_empty(), "nothing requested, nothing reported");
    }

    #[test]
    fn unavailable_setting_is_reported_with_its_reason() {
        for affinity in [vec![usize::MAX], vec![1023]] {
            let lines = reported(HygieneParams { realtime: false, affinity, ..HygieneParams::default() }, Role::Frame);
            assert!(!lines[0].got && !lines[0].detail.is_empty(), "{lines:?}");
        }
        let lines = reported(HygieneParams { priority: 200, ..HygieneParams::default() }, Role::Drawing);
        assert!(!lines[0].got, "{lines:?}");
    }

    #[test]
    fn links_come_before_frames_before_sinks_before_drawing() {
        let above = [Role::Link, Role::Frame, Role::Sink, Role::Drawing].map(Role::above);
        assert!(above.windows(2).all(|pair| pair[0] > pair[1]), "{above:?}");
    }
}
