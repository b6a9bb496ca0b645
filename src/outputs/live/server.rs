//! Clients come and go, in one thread.
//!
//! In: a listener and the board. Limits: [`CLIENTS_MAX`] at once; one more takes the seat of the one that has been
//! silent for longest, then of the one that has taken longest to read its answer, if that is more than `READS_WITHIN`;
//! otherwise it is hung up on; one every `PACE`; one request a connection, its
//! head within `HEAD_MAX` and `HEAD_BYTES`, the whole within `CONNECTION_MAX`. A client that sends garbage, nothing, or
//! never reads loses its connection and takes nothing from the others but a seat for that long. A picture is shared by
//! all its clients, so their memory is bounded by seats times one picture. Tests: `http_tests`.

use crate::live::route::{SharedBoard, answer, lock};
use hyper::{Request, body::Incoming, server::conn::http1, service::service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use rustix::net::sockopt::set_socket_send_buffer_size;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::{collections::VecDeque, convert::Infallible, time::Duration};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
use tokio::task::AbortHandle;
use tokio::time::{Instant, MissedTickBehavior};

/// Clients at once.
pub const CLIENTS_MAX: usize = 24;
/// Time to send the head of a request.
const HEAD_MAX: Duration = Duration::from_secs(3);
/// Time for a request and its answer; shorter in tests, which wait for it.
const CONNECTION_MAX: Duration = Duration::from_secs(if cfg!(test) { 2 } else { 10 });
/// Bytes of an answer that the system may hold for a client that does not read.
const KERNEL_BYTES: usize = 128 * 1024;
/// From one client to the next: a client that asks over and over takes part of a core, and not all of it.
const PACE: Duration = Duration::from_millis(4);
/// Bytes of a request's head.
const HEAD_BYTES: usize = 16 * 1024;
/// Header lines of a request.
const HEADERS_MAX: usize = 64;
/// Time that a connection which loses its seat may take.
const MAKES_WAY: Duration = Duration::from_millis(100);
/// Time to read an answer while another client waits for the seat.
const READS_WITHIN: Duration = Duration::from_secs(1);
/// Interval at which the numbers are read when no client asks.
const LISTEN: Duration = Duration::from_millis(100);

/// Serves until the stop is notified.
pub(super) async fn serve(listener: TcpListener, board: SharedBoard, stop: Arc<Notify>) {
    let mut seats = Seats { free: Arc::new(Semaphore::new(CLIENTS_MAX)), seating: Seating::default(), arrived: 0 };
    let mut listen = tokio::time::interval(LISTEN);
    listen.set_missed_tick_behavior(MissedTickBehavior::Skip);
    loop {
        tokio::select! {
            () = stop.notified() => return,
            _ = listen.tick() => lock(&board).listen(),
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) => {
                    seats.welcome(stream, &board).await;
                    tokio::time::sleep(PACE).await;
                }
                // The client is gone already, or no descriptors are left: pause before the next attempt.
                Err(_) => tokio::time::sleep(Duration::from_millis(5)).await,
            },
        }
    }
}

/// One connection.
struct Seated {
    number: u64,
    since: Instant,
    has_asked: bool,
    connection: AbortHandle,
}

/// The connections, oldest first.
#[derive(Clone, Default)]
struct Seating {
    seated: Arc<Mutex<VecDeque<Seated>>>,
}

impl Seating {
    fn lock(&self) -> MutexGuard<'_, VecDeque<Seated>> {
        let mut seated = self.seated.lock().unwrap_or_else(PoisonError::into_inner);
        seated.retain(|seated| !seated.connection.is_finished());
        seated
    }

    fn add(&self, number: u64, connection: AbortHandle) {
        self.lock().push_back(Seated { number, since: Instant::now(), has_asked: false, connection });
    }

    /// Records that a client has sent the head of its request.
    fn note_request(&self, number: u64) {
        self.lock().iter_mut().filter(|seated| seated.number == number).for_each(|seated| seated.has_asked = true);
    }

    /// Ends the oldest that has sent no request, or else the oldest that does not read its answer; false when there is
    /// neither.
    fn end_one(&self) -> bool {
        let mut seated = self.lock();
        let is_slow = |seated: &Seated| seated.since.elapsed() >= READS_WITHIN;
        let silent = seated.iter().position(|seated| !seated.has_asked);
        let ends = silent.or_else(|| seated.iter().position(is_slow)).and_then(|place| seated.remove(place));
        ends.iter().for_each(|seated| seated.connection.abort());
        ends.is_some()
    }
}

/// The places for clients.
struct Seats {
    free: Arc<Semaphore>,
    seating: Seating,
    arrived: u64,
}

impl Seats {
    /// Serves a client, if there is a seat. Neither half requests nor answers without a reader keep others
    /// out: one of them makes way.
    async fn welcome(&mut self, stream: TcpStream, board: &SharedBoard) {
        let mut seat = Arc::clone(&self.free).try_acquire_owned().ok();
        if seat.is_none() && self.seating.end_one() {
            lock(board).served.clients_failed += 1;
            // It goes as soon as this task waits.
            let free = Arc::clone(&self.free).acquire_owned();
            seat = tokio::time::timeout(MAKES_WAY, free).await.ok().and_then(Result::ok);
        }
        let Some(seat) = seat else {
            lock(board).served.clients_refused += 1;
            return;
        };
        self.arrived += 1;
        let (number, seating) = (self.arrived, self.seating.clone());
        let connection = tokio::spawn(attend(stream, Arc::clone(board), seat, (number, seating)));
        self.seating.add(number, connection.abort_handle());
    }
}

async fn attend(stream: TcpStream, board: SharedBoard, seat: OwnedSemaphorePermit, (number, seating): (u64, Seating)) {
    let _ = stream.set_nodelay(true); // without it answers may be slower
    let _ = set_socket_send_buffer_size(&stream, KERNEL_BYTES); // without it the system may buffer more
    let answering = service_fn(|request: Request<Incoming>| {
        seating.note_request(number);
        let board = Arc::clone(&board);
        async move { Ok::<_, Infallible>(answer(&board, &request.into_parts().0).await) }
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_MAX)
        .max_buf_size(HEAD_BYTES)
        .max_headers(HEADERS_MAX)
        .keep_alive(false)
        .serve_connection(TokioIo::new(stream), answering);
    let ended = tokio::time::timeout(CONNECTION_MAX, connection).await;
    if !matches!(ended, Ok(Ok(()))) {
        lock(&board).served.clients_failed += 1;
    }
    drop(seat);
}
