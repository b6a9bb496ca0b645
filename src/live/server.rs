//! Clients come and go, in one thread.
//!
//! In: a listener and the board. Limits: [`CLIENTS_MAX`] at once, one more is hung up on; one every `PACE`; one request a
//! connection, its head within `HEAD_MAX` and `HEAD_BYTES`, the whole within `CONNECTION_MAX`. A client that sends
//! garbage, nothing, or never reads loses its connection and takes nothing from the others but a seat for that long. A
//! picture is shared by all who asked for it, so what clients hold is bounded by seats times one picture. Tests:
//! `http_tests`.

use crate::live::route::{SharedBoard, answer, lock};
use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use nix::sys::socket::{setsockopt, sockopt};
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
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
/// How often the numbers are taken in when nobody asks.
const LISTEN: Duration = Duration::from_millis(100);

/// Serves until told to stop.
pub(super) async fn serve(listener: TcpListener, board: SharedBoard, stop: Arc<Notify>) {
    let seats = Arc::new(Semaphore::new(CLIENTS_MAX));
    let mut listen = tokio::time::interval(LISTEN);
    listen.set_missed_tick_behavior(MissedTickBehavior::Skip);
    loop {
        tokio::select! {
            () = stop.notified() => return,
            _ = listen.tick() => lock(&board).listen(),
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) => {
                    welcome(stream, &board, &seats);
                    tokio::time::sleep(PACE).await;
                }
                // Nobody there any more, or no descriptors left: not to be asked again without a pause.
                Err(_) => tokio::time::sleep(Duration::from_millis(5)).await,
            },
        }
    }
}

fn welcome(stream: TcpStream, board: &SharedBoard, seats: &Arc<Semaphore>) {
    match Arc::clone(seats).try_acquire_owned() {
        Ok(seat) => drop(tokio::spawn(attend(stream, Arc::clone(board), seat))),
        Err(_) => lock(board).served.clients_refused += 1,
    }
}

async fn attend(stream: TcpStream, board: SharedBoard, seat: OwnedSemaphorePermit) {
    let _an_answer_may_be_slower_without = stream.set_nodelay(true);
    let _the_system_may_hold_more = setsockopt(&stream, sockopt::SndBuf, &KERNEL_BYTES);
    let answering = service_fn(|request: Request<Incoming>| {
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
