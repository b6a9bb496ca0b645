//! Clients come and go, in one thread.
//!
//! In: a listener and the board. Limits: [`CLIENTS_MAX`] at once; one more takes the seat of the one that has been
//! silent for longest, or is hung up on when all have sent a request; one every `PACE`; one request a connection, its
//! head within `HEAD_MAX` and `HEAD_BYTES`, the whole within `CONNECTION_MAX`. A client that sends garbage, nothing, or
//! never reads loses its connection and takes nothing from the others but a seat for that long. A picture is shared by
//! all its clients, so their memory is bounded by seats times one picture. Tests: `http_tests`.

use crate::live::route::{SharedBoard, answer, lock};
use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use nix::sys::socket::{setsockopt, sockopt};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
use tokio::task::AbortHandle;
use tokio::time::MissedTickBehavior;

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
/// Interval at which the numbers are read when no client asks.
const LISTEN: Duration = Duration::from_millis(100);

/// Serves until the stop is notified.
pub(super) async fn serve(listener: TcpListener, board: SharedBoard, stop: Arc<Notify>) {
    let mut seats = Seats { free: Arc::new(Semaphore::new(CLIENTS_MAX)), silent: Silent::default(), arrived: 0 };
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

/// Connections that have not sent the head of a request yet, oldest first, each with its number.
#[derive(Clone, Default)]
struct Silent {
    connections: Arc<Mutex<VecDeque<(u64, AbortHandle)>>>,
}

impl Silent {
    fn add(&self, number: u64, connection: AbortHandle) {
        let mut connections = self.connections.lock().unwrap_or_else(PoisonError::into_inner);
        connections.retain(|(_, connection)| !connection.is_finished());
        connections.push_back((number, connection));
    }

    fn remove(&self, number: u64) {
        self.connections.lock().unwrap_or_else(PoisonError::into_inner).retain(|(other, _)| *other != number);
    }

    /// Ends the oldest; false when there is none.
    fn end_one(&self) -> bool {
        let mut connections = self.connections.lock().unwrap_or_else(PoisonError::into_inner);
        connections.retain(|(_, connection)| !connection.is_finished());
        let oldest = connections.pop_front();
        oldest.iter().for_each(|(_, connection)| connection.abort());
        oldest.is_some()
    }
}

/// The places for clients.
struct Seats {
    free: Arc<Semaphore>,
    silent: Silent,
    arrived: u64,
}

impl Seats {
    /// Serves a client, if there is a seat. Half requests cannot keep others out: one of them makes way.
    async fn welcome(&mut self, stream: TcpStream, board: &SharedBoard) {
        let mut seat = Arc::clone(&self.free).try_acquire_owned().ok();
        if seat.is_none() && self.silent.end_one() {
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
        let (number, silent) = (self.arrived, self.silent.clone());
        let connection = tokio::spawn(attend(stream, Arc::clone(board), seat, (number, silent)));
        self.silent.add(number, connection.abort_handle());
    }
}

async fn attend(stream: TcpStream, board: SharedBoard, seat: OwnedSemaphorePermit, (number, silent): (u64, Silent)) {
    let _ = stream.set_nodelay(true); // without it answers may be slower
    let _ = setsockopt(&stream, sockopt::SndBuf, &KERNEL_BYTES); // without it the system may buffer more
    let answering = service_fn(|request: Request<Incoming>| {
        silent.remove(number);
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
