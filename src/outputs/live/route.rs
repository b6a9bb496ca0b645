//! A request -> its answer.
//!
//! | address | answer |
//! |---|---|
//! | `/` | the page |
//! | `/frame.png?stretch=..` | the newest frame, 8-bit grey; its number in the header `starloop-frame` |
//! | `/truth.json?frame=N` | the stars of a frame that was asked for as a picture not long ago |
//! | `/state.json` | everything else the page shows |
//! | `/metrics` | the same for Prometheus |
//!
//! GET and HEAD only. Refusals are one line of text that says what was wanted. Nothing is cached by browsers, nothing may
//! be shown by pages from elsewhere, and only who asks for this place by its address or a known name is answered. Tests:
//! `http_tests`.

use crate::live::board::{Board, Encoded, NoPicture};
use crate::live::picture::Scale;
use crate::live::{Params, metrics, query, state};
use http_body_util::Full;
use hyper::body::Bytes;
use hyper::header::{ALLOW, CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderValue, RETRY_AFTER};
use hyper::http::request::Parts;
use hyper::{Method, Response, StatusCode};
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The board, for the tasks of one thread; never locked across a wait.
pub(super) type SharedBoard = Arc<Mutex<Board>>;
/// What goes back.
pub(super) type Answer = Response<Full<Bytes>>;

/// The page: markup, style and script in one.
const PAGE: &str = concat!(
    include_str!("page/head.html"),
    "<style>\n",
    include_str!("page/page.css"),
    "</style>\n",
    include_str!("page/body.html"),
    "<script>\n\"use strict\";\n",
    include_str!("page/drawing.js"),
    include_str!("page/frame.js"),
    include_str!("page/sky.js"),
    include_str!("page/timing.js"),
    include_str!("page/counts.js"),
    include_str!("page/page.js"),
    "</script>\n",
);
/// What the page may do: run what it came with, and ask where it came from.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src 'self' blob: data:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// A request for a picture waits this long for the encoder at most.
const PATIENCE: Duration = Duration::from_secs(5);

pub(super) fn lock(board: &SharedBoard) -> MutexGuard<'_, Board> {
    board.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The answer to a request, counted.
pub(super) async fn answer(board: &SharedBoard, request: &Parts) -> Answer {
    let answer = answered(board, request).await;
    let mut board = lock(board);
    board.asked = Some(board.clock.now());
    let served = &mut board.served;
    if answer.status().as_u16() < 400 {
        served.requests += 1;
    } else {
        served.refused += 1;
    }
    answer
}

async fn answered(board: &SharedBoard, request: &Parts) -> Answer {
    if request.method != Method::GET && request.method != Method::HEAD {
        let mut refusal = refused(StatusCode::METHOD_NOT_ALLOWED, "this view is read-only: wanted GET or HEAD");
        refusal.headers_mut().insert(ALLOW, HeaderValue::from_static("GET, HEAD"));
        return refusal;
    }
    if let Err(why) = may_ask(&lock(board).params, request) {
        return refused(StatusCode::MISDIRECTED_REQUEST, why);
    }
    let question = request.uri.query().unwrap_or("");
    match request.uri.path() {
        "/" => page(),
        "/state.json" => json(state::state_of(&mut lock(board)).to_string().into()),
        "/metrics" => text(StatusCode::OK, metrics::CONTENT_TYPE, metrics::metrics_of(&mut lock(board)).into()),
        "/frame.png" => match query::scale(question) {
            Ok(scale) => picture(board, scale).await,
            Err(error) => refused(StatusCode::BAD_REQUEST, &error.to_string()),
        },
        "/truth.json" => match query::frame(question) {
            Ok(number) => match lock(board).truth(number) {
                Some(truth) => json(truth),
                None => {
                    refused(StatusCode::NOT_FOUND, "the stars of this frame are not kept: ask for /frame.png first")
                }
            },
            Err(error) => refused(StatusCode::BAD_REQUEST, &error.to_string()),
        },
        _ => refused(StatusCode::NOT_FOUND, "wanted /, /frame.png, /truth.json, /state.json or /metrics"),
    }
}

/// Any web site can give a name of its own our address, and would then read the view in its visitors' browsers: so a host
/// is answered by its address, as `localhost`, or by a name that whoever started the run has given. No site can choose an
/// address as its name; on loopback it must still be one of loopback.
fn may_ask(params: &Params, request: &Parts) -> Result<(), &'static str> {
    // Browsers always say whom they ask.
    let Some(host) = request.headers.get(HOST) else { return Ok(()) };
    let host = host.to_str().unwrap_or("");
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or(""),
        None => host.split(':').next().unwrap_or(""),
    };
    let is_on_loopback = params.address.ip().is_loopback();
    let is_address = name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback() || !is_on_loopback);
    let mut known = ["localhost"].into_iter().chain(params.names.iter().map(String::as_str));
    if is_address || known.any(|known| known.eq_ignore_ascii_case(name)) {
        return Ok(());
    }
    Err(if is_on_loopback {
        "this view listens on loopback: wanted localhost, 127.0.0.1 or [::1] as the host, or a name given with --monitor-name"
    } else {
        "this view does not know the host's name: wanted its address, or a name given with --monitor-name"
    })
}

/// The newest picture; waits while the encoder rests.
async fn picture(board: &SharedBoard, scale: Scale) -> Answer {
    let patience = tokio::time::sleep(PATIENCE);
    tokio::pin!(patience);
    loop {
        let found = lock(board).encode(scale);
        let rest = match found {
            Ok(encoded) => return png(encoded),
            Err(NoPicture::NoFrame) => return refused(StatusCode::NOT_FOUND, "no frame has come yet"),
            Err(NoPicture::Broken(error)) => {
                return refused(StatusCode::INTERNAL_SERVER_ERROR, &format!("the frame cannot be a PNG: {error}"));
            }
            Err(NoPicture::NotYet(rest)) => Duration::from_nanos(rest.ns().unsigned_abs()),
        };
        tokio::select! {
            () = tokio::time::sleep(rest) => (),
            () = &mut patience => {
                let mut refusal = refused(StatusCode::SERVICE_UNAVAILABLE, "others ask for more pictures than are made");
                refusal.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
                return refusal;
            }
        }
    }
}

fn page() -> Answer {
    let mut answer = text(StatusCode::OK, "text/html; charset=utf-8", Bytes::from_static(PAGE.as_bytes()));
    answer.headers_mut().insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    answer
}

fn png(encoded: Encoded) -> Answer {
    let mut answer = text(StatusCode::OK, "image/png", encoded.png);
    answer.headers_mut().insert("starloop-frame", encoded.number.into());
    answer
}

fn json(body: Bytes) -> Answer {
    text(StatusCode::OK, "application/json", body)
}

fn refused(status: StatusCode, why: &str) -> Answer {
    text(status, "text/plain; charset=utf-8", format!("{why}\n").into())
}

fn text(status: StatusCode, kind: &'static str, body: Bytes) -> Answer {
    let mut answer = Response::new(Full::new(body));
    *answer.status_mut() = status;
    let headers = answer.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert("x-content-type-options", HeaderValue::from_static("nosniff"));
    headers.insert("cross-origin-resource-policy", HeaderValue::from_static("same-origin"));
    answer
}
