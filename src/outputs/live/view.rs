//! The view from its start to its end.

use crate::live::board::Board;
use crate::live::lateness::LatenessBins;
use crate::live::latest::{Picture, latest};
use crate::live::numbers::Numbers;
use crate::live::route::{SharedBoard, lock};
use crate::live::server::serve;
use crate::live::sink::LiveSink;
use crate::live::{LiveError, Params};
use base::clock::Clock;
use base::time::Span;
use frames::sink::SentFrame;
use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::Notify;

/// After the end of a run its totals are served for so long, so that pages and Prometheus see that it is over.
pub const LINGER: Duration = Duration::from_secs(2);
/// They are served only when somebody has asked so shortly before: a page asks four times a second.
const ASKED_WITHIN: Span = Span::from_ms(5000);
/// Stars of a frame for which there is room from the start.
const STARS: usize = 1024;

/// A page that is served; dropping it ends it.
pub struct LiveView {
    address: SocketAddr,
    board: SharedBoard,
    stop: Arc<Notify>,
    thread: Option<JoinHandle<()>>,
}

impl LiveView {
    /// Listens, and serves in a thread of its own: call it before the frame thread takes its priority, which threads
    /// inherit. `clock` is a clock that runs: the age of a frame, and how long the encoder rests, are told by it.
    ///
    /// # Errors
    /// When nobody can listen at the address, or the thread cannot be started.
    pub fn start(params: Params, clock: Arc<dyn Clock>) -> Result<(Self, LiveSink, Numbers), LiveError> {
        let refused = |address| move |source| LiveError::Listen { address, source };
        let asked = params.address;
        let listener = TcpListener::bind(asked).map_err(refused(asked))?;
        listener.set_nonblocking(true).map_err(refused(asked))?;
        let address = listener.local_addr().map_err(refused(asked))?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(LiveError::Thread)?;
        let (board, sink, numbers) = parts(params, &clock);
        let board: SharedBoard = Arc::new(Mutex::new(board));
        let stop = Arc::new(Notify::new());
        let (stopped, served) = (Arc::clone(&stop), Arc::clone(&board));
        let serving = async move {
            if let Ok(listener) = tokio::net::TcpListener::from_std(listener) {
                serve(listener, served, stopped).await;
            }
        };
        let thread = std::thread::Builder::new().name("live".into()).spawn(move || runtime.block_on(serving));
        let thread = Some(thread.map_err(LiveError::Thread)?);
        Ok((Self { address, board, stop, thread }, sink, numbers))
    }

    /// Serves the end of a run for [`LINGER`], when somebody looks, and ends; false when its thread had ended before, by a
    /// panic or because it could not listen.
    #[must_use]
    pub fn finish(mut self) -> bool {
        let is_watched = {
            let mut board = lock(&self.board);
            board.listen();
            board.is_over() && board.asked.is_some_and(|asked| board.clock.now() - asked < ASKED_WITHIN)
        };
        if is_watched {
            std::thread::sleep(LINGER);
        }
        self.end()
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    fn end(&mut self) -> bool {
        let Some(thread) = self.thread.take() else { return true };
        let was_at_work = !thread.is_finished();
        self.stop.notify_one();
        thread.join().is_ok() && was_at_work
    }

    /// True when other machines can reach it: it asks for no password.
    #[must_use]
    pub fn is_exposed(&self) -> bool {
        !self.address.ip().is_loopback()
    }
}

impl Drop for LiveView {
    fn drop(&mut self) {
        self.end();
    }
}

/// What the view is made of but for its clients.
fn parts(params: Params, clock: &Arc<dyn Clock>) -> (Board, LiveSink, Numbers) {
    let [width, height] = params.size_px;
    let frame = SentFrame::with_capacity(width, height, STARS, Arc::clone(&params.camera));
    let lateness = LatenessBins::reaching(params.readout_s);
    let (writer, reader) = latest(Picture { frame, count: 0, taken: clock.now(), lateness });
    let (numbers, told) = Numbers::new();
    let board = Board::new(params, Arc::clone(clock), reader, told);
    (board, LiveSink::new(writer, Arc::clone(clock)), numbers)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use base::clock::Virtual;
    use base::time::Tai;

    /// A view of small frames on a port of its own.
    pub(in crate::live) fn params() -> Params {
        Params {
            address: ([127, 0, 0, 1], 0).into(),
            names: Vec::new(),
            bench: "test bench".into(),
            camera: "test camera".into(),
            size_px: [31, 17],
            field_deg: [20.0, 11.0],
            frame_period_s: 0.1,
            readout_s: 0.08,
        }
    }

    /// Its parts, on a clock that stands.
    pub(in crate::live) fn board() -> (Board, LiveSink, Numbers) {
        let clock: Arc<dyn Clock> = Arc::new(Virtual::new(Tai::from_ns(1_790_000_000_000_000_000)));
        parts(params(), &clock)
    }

    #[test]
    fn view_whose_thread_panics_is_reported() {
        let clock: Arc<dyn Clock> = Arc::new(Virtual::new(Tai::from_ns(0)));
        let (whole, _sink, _numbers) = LiveView::start(params(), Arc::clone(&clock)).unwrap();
        assert!(whole.finish(), "control: one that ends in order");
        let (mut broken, _sink, _numbers) = LiveView::start(params(), clock).unwrap();
        assert!(broken.end());
        broken.thread =
            Some(std::thread::Builder::new().name("live".into()).spawn(|| panic!("as the test wants it")).unwrap());
        assert!(!broken.finish());
    }

    #[test]
    fn a_taken_port_is_told_with_what_to_try() {
        let clock: Arc<dyn Clock> = Arc::new(Virtual::new(Tai::from_ns(0)));
        let (first, _sink, _numbers) = LiveView::start(params(), Arc::clone(&clock)).unwrap();
        assert!(!first.is_exposed());
        let again = Params { address: first.address(), ..params() };
        let error = LiveView::start(again, clock).err().unwrap().to_string();
        assert!(error.contains(&first.address().to_string()) && error.contains("port 0"), "{error}");
    }
}
