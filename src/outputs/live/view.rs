//! The view from its start to its end.

use crate::live::head::{Board, Head};
use crate::live::kept::{Picture, latest};
use crate::live::route::{SharedBoard, lock};
use crate::live::{HeadParams, Params, lateness::LatenessBins, numbers::Numbers, server::serve, sink::LiveSink};
use base::{clock::Clock, time::Span};
use frames::sink::SentFrame;
use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, Mutex};
use std::{io, thread::JoinHandle, time::Duration};
use tokio::sync::Notify;

/// After the end of a run its totals are served for so long, so that pages and Prometheus see that it is over.
pub const LINGER: Duration = Duration::from_secs(2);
/// They are served only when a client asked so shortly before: a page asks four times a second.
const ASKED_WITHIN: Span = Span::from_ms(5000);
/// Number of stars of a frame that fit without allocation.
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
    /// inherit. `clock` is a clock that runs: it measures the age of a frame and the rest of the encoder. Returns one
    /// sink per head, in the order of `params.heads`; each may run in a thread of its own.
    ///
    /// # Errors
    /// When the list of heads is empty, when the address cannot be used, or when the thread cannot be started.
    pub fn start(params: Params, clock: Arc<dyn Clock>) -> io::Result<(Self, Vec<LiveSink>, Numbers)> {
        if params.heads.is_empty() {
            return Err(io::Error::other(
                "Params.heads of the live view: got an empty list, wanted at least one camera head; list every head of the run",
            ));
        }
        let asked = params.address;
        let refused = |source: io::Error| {
            let advice = "wanted an address of this machine and a free port: port 0 takes one";
            io::Error::new(source.kind(), format!("the live view cannot listen at {asked}: {source}; {advice}"))
        };
        let no_thread = |source: io::Error| {
            let text = format!("the live view's thread cannot be started: {source}; the run goes on without --monitor");
            io::Error::new(source.kind(), text)
        };
        let listener = TcpListener::bind(asked).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(no_thread)?;
        let (board, sinks, numbers) = parts(params, &clock);
        let board: SharedBoard = Arc::new(Mutex::new(board));
        let stop = Arc::new(Notify::new());
        let (stopped, served) = (Arc::clone(&stop), Arc::clone(&board));
        let serving = async move {
            if let Ok(listener) = tokio::net::TcpListener::from_std(listener) {
                serve(listener, served, stopped).await;
            }
        };
        let thread = std::thread::Builder::new().name("live".into()).spawn(move || runtime.block_on(serving));
        let thread = Some(thread.map_err(no_thread)?);
        Ok((Self { address, board, stop, thread }, sinks, numbers))
    }

    /// Serves the end of a run for [`LINGER`], when a client is connected, and ends; false when its thread ended
    /// before, by a panic or because it could not listen.
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

    /// Returns where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    fn end(&mut self) -> bool {
        let Some(thread) = self.thread.take() else { return true };
        let was_at_work = !thread.is_finished();
        self.stop.notify_one();
        thread.join().is_ok() && was_at_work
    }

    /// Returns whether other machines can reach it: it does not ask for a password.
    pub fn is_exposed(&self) -> bool {
        !self.address.ip().is_loopback()
    }
}

impl Drop for LiveView {
    fn drop(&mut self) {
        self.end();
    }
}

/// Makes the parts of the view except its clients.
fn parts(params: Params, clock: &Arc<dyn Clock>) -> (Board, Vec<LiveSink>, Numbers) {
    let (heads, sinks) = params.heads.iter().map(|head| head_and_sink(head, params.heads.len(), clock)).unzip();
    let (numbers, reported) = Numbers::new();
    (Board::new(params, Arc::clone(clock), heads, reported), sinks, numbers)
}

/// Makes the two ends of one head.
fn head_and_sink(params: &HeadParams, heads: usize, clock: &Arc<dyn Clock>) -> (Head, LiveSink) {
    let [width, height] = params.size_px;
    let frame = SentFrame::with_capacity(width, height, STARS, Arc::clone(&params.camera));
    let lateness = LatenessBins::reaching(params.readout_s);
    let (writer, reader) = latest(Picture { frame, count: 0, taken: clock.now(), lateness });
    (Head::new(params.clone(), reader, heads), LiveSink::new(writer, Arc::clone(clock)))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use base::{clock::Virtual, time::Tai};

    /// A view of small frames on a port of its own.
    pub(in crate::live) fn params() -> Params {
        Params {
            address: ([127, 0, 0, 1], 0).into(),
            names: Vec::new(),
            bench: "test bench".into(),
            stage_limit_ms: [None; frames::report::Stage::COUNT],
            heads: vec![head(0)],
        }
    }

    /// A head of small frames; each number has a camera and a field of its own.
    pub(in crate::live) fn head(number: u8) -> HeadParams {
        HeadParams {
            name: format!("head {number}"),
            camera: if number == 0 { "test camera".into() } else { format!("test camera {number}").into() },
            size_px: [31, 17],
            field_deg: [20.0 + f64::from(number), 11.0],
            frame_period_s: 0.1,
            readout_s: 0.08,
        }
    }

    /// Returns [`params`] with three heads.
    pub(in crate::live) fn params_of_three() -> Params {
        Params { heads: (0..3).map(head).collect(), ..params() }
    }

    /// Its parts, on a clock that never advances.
    pub(in crate::live) fn board() -> (Board, LiveSink, Numbers) {
        let (board, mut sinks, numbers) = board_of(params());
        (board, sinks.remove(0), numbers)
    }

    /// The parts of a view of these heads, on a clock that never advances.
    pub(in crate::live) fn board_of(params: Params) -> (Board, Vec<LiveSink>, Numbers) {
        let clock: Arc<dyn Clock> = Arc::new(Virtual::new(Tai::from_ns(1_790_000_000_000_000_000)));
        parts(params, &clock)
    }

    #[test]
    fn view_without_heads_is_refused() {
        let clock: Arc<dyn Clock> = Arc::new(Virtual::new(Tai::from_ns(0)));
        let error = LiveView::start(Params { heads: Vec::new(), ..params() }, Arc::clone(&clock)).err().unwrap();
        assert!(error.to_string().contains("wanted at least one camera head"), "{error}");
        let (_view, sinks, _numbers) = LiveView::start(params_of_three(), clock).expect("control: three heads");
        assert_eq!(sinks.len(), 3);
    }

    #[test]
    fn view_whose_thread_panics_is_reported() {
        let clock: Arc<dyn Clock> = Arc::new(Virtual::new(Tai::from_ns(0)));
        let (whole, _sinks, _numbers) = LiveView::start(params(), Arc::clone(&clock)).unwrap();
        assert!(whole.finish(), "control: one that ends in order");
        let (mut broken, _sinks, _numbers) = LiveView::start(params(), clock).unwrap();
        assert!(broken.end());
        broken.thread =
            Some(std::thread::Builder::new().name("live".into()).spawn(|| panic!("as the test wants it")).unwrap());
        assert!(!broken.finish());
    }

    #[test]
    fn a_taken_port_is_reported_with_what_to_try() {
        let clock: Arc<dyn Clock> = Arc::new(Virtual::new(Tai::from_ns(0)));
        let (first, _sinks, _numbers) = LiveView::start(params(), Arc::clone(&clock)).unwrap();
        assert!(!first.is_exposed());
        let again = Params { address: first.address(), ..params() };
        let error = LiveView::start(again, clock).err().unwrap().to_string();
        assert!(error.contains(&first.address().to_string()) && error.contains("port 0"), "{error}");
    }
}
