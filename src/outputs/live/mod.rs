//! Frames and numbers of a run under way -> one page for people and metrics for machines, over HTTP.
//!
//! ```text
//! sink threads: SentFrame -> LiveSink per head -> newest picture of it (three buffers that change places)
//! frame thread: RunNumbers -> Numbers -> queue of one, dropped when full          -> "live" thread (tokio): requests
//! ```
//!
//! Input: frames of every camera head (a copy of each; the newest, and the last that a page asked for, are kept) and
//! [`RunNumbers`](frames::report::RunNumbers), all counts since the start. Output: `/` (the page, which loads nothing
//! from elsewhere), `/frame.png`, `/truth.json`, `/pixel.json`, `/state.json` and `/metrics` (Prometheus text 0.0.4).
//! Units are in the names. Heads are counted from 0; a request that names none is about head 0.
//!
//! Read-only: GET and HEAD, everything else is 405. No password: the view listens on loopback unless configured
//! otherwise, and answers only requests for an address of this machine, `localhost` or a configured name. Nothing here
//! runs on the frame thread but a copy of 16 KiB; a sink thread waits for no client, as the buffers change places under
//! a lock that is held for two moves. Bounded: clients ([`CLIENTS_MAX`]), time of a connection, size of a request, one
//! encoding at a time for a quarter of a core at most.
//!
//! Tour: `kept` and `sink` (frames in), `numbers` (counts in) -> `head` (state of one head and of the run) ->
//! `picture`, `truth`, `state`, `metrics` (its forms) -> `route` (request to answer) -> `server` (clients) and `page/`.
//!
//! Tests: beside the code; `http_tests` with raw requests; `hil_scripts/tests/test_live.py` with a browser and Prometheus's
//! parser.

mod head;
#[cfg(test)]
mod http_tests;
mod kept;
mod lateness;
mod metrics;
mod numbers;
mod picture;
mod query;
mod route;
mod server;
mod sink;
mod state;
mod truth;
mod view;

pub use numbers::Numbers;
pub use server::CLIENTS_MAX;
pub use sink::LiveSink;
pub use view::{LINGER, LiveView};

use frames::report::Stage;
use std::{net::SocketAddr, sync::Arc};

/// The parameters of the page.
#[derive(Debug, Clone, PartialEq)]
pub struct Params {
    /// Where to listen; port 0 takes a free one.
    pub address: SocketAddr,
    /// Names of this machine by which it may be asked, beside `localhost` and addresses; without a port.
    pub names: Vec<String>,
    /// Name of the bench.
    pub bench: String,
    /// Limits of the 99 % quantile of each stage, ms; `None`: any.
    pub stage_limit_ms: [Option<f64>; Stage::COUNT],
    /// The camera heads, at least one; they are numbered in this order from 0.
    pub heads: Vec<HeadParams>,
}

/// One camera head of the page.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadParams {
    /// Name for people, such as `head 1`.
    pub name: String,
    /// Name of the camera.
    pub camera: Arc<str>,
    /// Columns and rows of a frame, px: buffers are made for it.
    pub size_px: [usize; 2],
    /// Full field of view along columns and rows, deg.
    pub field_deg: [f64; 2],
    /// Frame period, s.
    pub frame_period_s: f64,
    /// From the end of the exposure to the deadline, s.
    pub readout_s: f64,
}
