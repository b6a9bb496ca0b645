//! A request -> its answer.
//!
//! | address | answer |
//! |---|---|
//! | `/` | the page |
//! | `/frame.png?head=H&stretch=..` | a head's newest frame, 8-bit grey; its number in the header `starloop-frame` |
//! | `/frame.png?head=H&frame=N&stretch=..` | a frame that was asked for not long ago (`kept_frames` of the state) |
//! | `/truth.json?head=H&frame=N` | stars and facts of such a frame |
//! | `/pixel.json?head=H&frame=N&x=X&y=Y` | value and direction of one pixel of such a frame |
//! | `/state.json?head=H` | everything else the page shows: of head H at the top, of each head in the list `heads` |
//! | `/metrics` | the same for Prometheus, of all heads |
//!
//! `head` is 0 where it is left out; a number beyond the last head is 404. GET and HEAD only. Refusals are one line of
//! text that says what was wanted. Nothing is cached by browsers, nothing may be shown by pages from elsewhere, and
//! only requests by its address or a known name are answered. Tests: `http_tests`.

use crate::live::head::{Board, Encoded, NoPicture};
use crate::live::picture::pixel_of;
use crate::live::query::{self, BadQuery, PictureQuery};
use crate::live::{Params, metrics, state};
use http_body_util::Full;
use hyper::header::{ALLOW, CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderValue, RETRY_AFTER};
use hyper::{Method, Response, StatusCode, body::Bytes, http::request::Parts};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::{net::IpAddr, time::Duration};

/// The board, for the tasks of one thread; never locked across a wait.
pub(super) type SharedBoard = Arc<Mutex<Board>>;
/// Answer to a request.
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
    include_str!("page/theme.js"),
    include_str!("page/star_names.js"),
    include_str!("page/zoom.js"),
    include_str!("page/frame.js"),
    include_str!("page/pixel.js"),
    include_str!("page/history.js"),
    include_str!("page/sky.js"),
    include_str!("page/timing.js"),
    include_str!("page/counts.js"),
    include_str!("page/events.js"),
    include_str!("page/heads.js"),
    include_str!("page/tabs.js"),
    include_str!("page/keys.js"),
    include_str!("page/page.js"),
    "</script>\n",
);
/// Permissions of the page: to run its own scripts, and to ask its own server.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src 'self' blob: data:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// A request for a picture waits this long for the encoder at most.
const PATIENCE: Duration = Duration::from_secs(5);

pub(super) fn lock(board: &SharedBoard) -> MutexGuard<'_, Board> {
    board.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the answer to a request, counted.
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
        "/state.json" => answer_or_refusal(query::head(question), |head| state(board, head)),
        "/metrics" => text(StatusCode::OK, metrics::CONTENT_TYPE, metrics::metrics_of(&mut lock(board)).into()),
        "/frame.png" => match query::picture(question) {
            Ok(asked) => picture(board, asked).await,
            Err(error) => refused(StatusCode::BAD_REQUEST, &error.to_string()),
        },
        "/truth.json" => {
            answer_or_refusal(query::head_and_frame(question), |(head, number)| truth(board, head, number))
        }
        "/pixel.json" => {
            answer_or_refusal(query::pixel(question), |(head, number, place)| pixel(board, head, number, place))
        }
        _ => refused(StatusCode::NOT_FOUND, "wanted /, /frame.png, /truth.json, /pixel.json, /state.json or /metrics"),
    }
}

/// Answers a request, or says why it cannot be read.
fn answer_or_refusal<T>(asked: Result<T, BadQuery>, answer: impl FnOnce(T) -> Answer) -> Answer {
    match asked {
        Ok(asked) => answer(asked),
        Err(error) => refused(StatusCode::BAD_REQUEST, &error.to_string()),
    }
}

fn state(board: &SharedBoard, head: usize) -> Answer {
    let mut board = lock(board);
    match state::state_of(&mut board, head) {
        Some(state) => json(state.to_string().into()),
        None => no_such_head(&board, head),
    }
}

fn truth(board: &SharedBoard, head: usize, number: u32) -> Answer {
    let board = lock(board);
    let Some(known) = board.heads.get(head) else { return no_such_head(&board, head) };
    let unknown = "the stars of this frame are not kept: ask for /frame.png of this head first";
    known.truth(number).map_or_else(|| refused(StatusCode::NOT_FOUND, unknown), json)
}

fn pixel(board: &SharedBoard, head: usize, number: u32, place: [usize; 2]) -> Answer {
    let board = lock(board);
    let Some(known) = board.heads.get(head) else { return no_such_head(&board, head) };
    let Some(frame) = known.kept.get(number) else { return not_kept(number) };
    let [width, height] = [frame.image.width(), frame.image.height()];
    pixel_of(frame, place).map_or_else(
        || {
            let [x, y] = place;
            refused(StatusCode::NOT_FOUND, &format!("x={x} y={y}: wanted x below {width} and y below {height}"))
        },
        |pixel| json(pixel.to_string().into()),
    )
}

fn not_kept(number: u32) -> Answer {
    let why = format!("frame: got {number}, wanted one of kept_frames of /state.json: frames asked for not long ago");
    refused(StatusCode::NOT_FOUND, &why)
}

fn no_such_head(board: &Board, head: usize) -> Answer {
    let heads = board.heads.len();
    let wanted = if heads == 1 { "0, the only head of this run".into() } else { format!("0 to {}", heads - 1) };
    refused(StatusCode::NOT_FOUND, &format!("head: got {head}, wanted {wanted}; /state.json lists the heads"))
}

/// Refuses requests for other hosts. Any web site can give a name of its own our address, and would then read the view
/// in its visitors' browsers: so a host is answered by its address, as `localhost`, or by a name that whoever started
/// the run has given. No site can choose an address as its name; on loopback it must still be one of loopback.
fn may_ask(params: &Params, request: &Parts) -> Result<(), &'static str> {
    let mut hosts = request.headers.get_all(HOST).iter();
    let host = hosts.next().filter(|_| hosts.next().is_none()).and_then(|host| host.to_str().ok());
    let name = host.and_then(name_of).unwrap_or("");
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

/// Returns the name or address of a host with or without a port; `None` for anything else, such as `localhost:80@site`.
fn name_of(host: &str) -> Option<&str> {
    let (name, port) = match host.strip_prefix('[') {
        Some(rest) => rest.split_once(']')?,
        None => host.split_at(host.find(':').unwrap_or(host.len())),
    };
    let is_port = |port: &str| port.bytes().all(|byte| byte.is_ascii_digit());
    (port.is_empty() || port.strip_prefix(':').is_some_and(is_port)).then_some(name)
}

/// Answers with a picture of a head; waits while the encoder rests.
async fn picture(board: &SharedBoard, asked: PictureQuery) -> Answer {
    let PictureQuery { head, frame, scale } = asked;
    let patience = tokio::time::sleep(PATIENCE);
    tokio::pin!(patience);
    loop {
        let found = lock(board).encode(head, frame, scale);
        let rest = match found {
            Ok(encoded) => return png(head, encoded),
            Err(NoPicture::NoHead) => return no_such_head(&lock(board), head),
            Err(NoPicture::NoFrame) => return refused(StatusCode::NOT_FOUND, "no frame of this head has come yet"),
            Err(NoPicture::NotKept(number)) => return not_kept(number),
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

fn png(head: usize, encoded: Encoded) -> Answer {
    let mut answer = text(StatusCode::OK, "image/png", encoded.png);
    answer.headers_mut().insert("starloop-head", head.into());
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
