//! The thread of a tracker on the real clock.

use crate::runtime::{error::RunError, tracker_out::shared::OutThread, tracker_out::telemeter::Telemeter};
use base::{clock::Clock, time::Span};
use crossbeam_channel::RecvTimeoutError;
use std::{sync::Arc, time::Duration};

/// A line with clients is looked at this often.
const LISTEN_EVERY: Span = Span::from_ms(2);
/// The thread looks after itself at least this often.
const LONGEST_WAIT: Span = Span::from_ms(100);

impl OutThread {
    /// Starts the thread of a tracker; it ends when the sending end of its frames is gone.
    ///
    /// # Errors
    /// When the system has no thread for it.
    pub fn start(mut telemeter: Telemeter, clock: Arc<dyn Clock>) -> Result<Self, RunError> {
        let run = move || {
            let most = if telemeter.has_clients() { LISTEN_EVERY } else { LONGEST_WAIT };
            loop {
                telemeter.step(clock.now());
                let now = clock.now();
                let wait = telemeter.next_due().map_or(most, |due| (due - now).min(most));
                let wait = Duration::from_nanos(u64::try_from(wait.ns()).unwrap_or(0));
                match telemeter.frames().recv_timeout(wait) {
                    Ok(seen) => telemeter.take(seen),
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return telemeter.finish(),
                }
            }
        };
        let thread = std::thread::Builder::new().name("tracker out".into()).spawn(run);
        thread.map(Self).map_err(|source| RunError::Thread { name: "tracker out", source })
    }
}
