//! Numbers, output and thread of a tracker at work, as others see them.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// Numbers of a tracker.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct OutCounts {
    /// Reports that went out.
    pub reports: u64,
    /// Those with an attitude.
    pub attitudes: u64,
    /// Packets that the line took.
    pub packets: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Reports and packets that were lost, and commands that the camera's queue could not take.
    pub lost: u64,
    /// Packets without a client, or for one that did not read.
    pub unread: u64,
    /// Commands and requests that were obeyed.
    pub commands: u64,
    /// Commands that were refused.
    pub refused: u64,
    /// Reports and packets that commanded faults hit.
    pub faults: u64,
    /// CRC-32 over the instants and bytes of all packets.
    pub crc32: u32,
    /// The first loss, in words.
    pub first_error: Option<String>,
    /// Its thread ended before the run did.
    pub is_lost: bool,
}

/// Known state of a tracker outside.
#[derive(Debug)]
pub struct OutShared {
    /// Its place in the bench.
    pub place: String,
    /// Its protocol.
    pub protocol: &'static str,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    counts: OutCounts,
    announced: u64,
    output: String,
    thread: Option<OutThread>,
}

impl OutShared {
    /// Returns those of a tracker that has no line yet.
    pub fn new(place: String, protocol: &'static str) -> Self {
        Self { place, protocol, state: Mutex::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns its numbers so far.
    pub fn counts(&self) -> OutCounts {
        self.state().counts.clone()
    }

    /// Returns where its packets go.
    pub fn output(&self) -> String {
        self.state().output.clone()
    }

    /// Says where its packets go.
    pub fn set_output(&self, output: String) {
        self.state().output = output;
    }

    /// Gives it the thread that is to be waited for at the end.
    pub fn set_thread(&self, thread: OutThread) {
        self.state().thread = Some(thread);
    }

    pub(super) fn publish(&self, counts: &OutCounts) {
        let mut state = self.state();
        let is_lost = state.counts.is_lost;
        state.counts.clone_from(counts);
        state.counts.is_lost = is_lost;
    }

    /// Returns the number of losses not yet reported.
    pub(super) fn take_new_losses(&self) -> u64 {
        let mut state = self.state();
        let new = (state.counts.lost + state.counts.unread).saturating_sub(state.announced);
        state.announced += new;
        new
    }

    /// Waits for the thread, which ends when no more frames come.
    pub(super) fn join(&self) {
        let thread = self.state().thread.take();
        if thread.is_some_and(|thread| thread.0.join().is_err()) {
            self.state().counts.is_lost = true;
        }
    }
}

/// A thread that is at work.
#[derive(Debug)]
pub struct OutThread(pub(super) JoinHandle<()>);
