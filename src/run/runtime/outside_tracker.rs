//! The built-in star tracker at the other end of the cable where no internal spacecraft is flown: frames -> attitudes.
//!
//! In: a frame of one head as it goes out, and the observer's velocity that it was drawn with. Out: an attitude, or the
//! reason why there is none, after the tracker's processing time. It sees pixels only, and has no gyro: it derives its
//! rate from its last two attitudes. Frames come in order; the same frames give the same bits. Tests:
//! `tests/closed_loop/lockstep.rs`.
//!
//! Converts camera requests of the built-in tracker to commands like those of any other client.

use base::time::{Span, Tai};
use frames::camera_control::{CameraCommand, CommandSource, Commanded};
use frames::sink::SentFrame;
use glam::DVec3;
use std::{collections::VecDeque, sync::Arc};
use testbed::tracker::{CameraOrders, CameraWish, Exposed, GuideStars, Outcome, Tracker, TrackerParams};

/// Capacity for outputs that are not ready yet: more than a tracker processes at a time.
const WAITING_MAX: usize = 64;

/// Output of a tracker for one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerOutput {
    /// Number of the frame.
    pub frame: u32,
    /// Middle of its exposure according to the tracker's time tag.
    pub mid_exposure: Tai,
    /// Attitude, or the reason why there is none.
    pub outcome: Outcome,
}

/// A tracker with its waiting outputs.
#[derive(Debug)]
pub struct OutsideTracker {
    tracker: Tracker,
    delay: Span,
    tag_error: Span,
    /// Commands to its camera; `None` when it sends none.
    orders: Option<CameraOrders>,
    /// Outputs that wait, each with the time at which it is ready.
    waiting: VecDeque<(Tai, TrackerOutput)>,
    ready: Option<TrackerOutput>,
}

impl OutsideTracker {
    /// Returns a tracker that is lost in space. It takes `delay` to process a frame, and its time tags are late by
    /// `tag_error`.
    pub fn new(params: TrackerParams, guide: Arc<GuideStars>, delay: Span, tag_error: Span) -> Self {
        let waiting = VecDeque::with_capacity(WAITING_MAX);
        Self { tracker: Tracker::new(params, guide), delay, tag_error, orders: None, waiting, ready: None }
    }

    /// Sets the commands that it may send to its camera.
    pub fn set_orders(&mut self, orders: Option<CameraOrders>) {
        self.orders = orders;
    }

    /// Measures a frame that goes out at `at`. `beta` is the observer's barycentric velocity divided by the speed of
    /// light, ICRF axes. Returns what it requests of its camera.
    pub fn take_frame(&mut self, frame: &SentFrame, at: Tai, beta: DVec3) -> Option<CameraWish> {
        self.tracker.expose(&Exposed { exposure_s: frame.meta.exposure_s, regions: frame.meta.regions });
        let mid_exposure = frame.meta.mid_exposure + self.tag_error;
        let outcome = self.tracker.measure(&frame.image, mid_exposure, beta, None);
        self.take_ready(at);
        if self.waiting.len() >= WAITING_MAX {
            self.ready = self.waiting.pop_front().map(|(_, output)| output);
        }
        let output = TrackerOutput { frame: frame.meta.number, mid_exposure, outcome };
        self.waiting.push_back((at + self.delay, output));
        let (seen, done) = ((&frame.image, mid_exposure), (&outcome, at + self.delay));
        self.orders.as_ref().map(|orders| self.tracker.wish(orders, seen, done, (beta, None)))
    }

    fn take_ready(&mut self, now: Tai) {
        while let Some((_, output)) = self.waiting.front().filter(|(ready_at, _)| *ready_at <= now).copied() {
            self.waiting.pop_front();
            self.ready = Some(output);
        }
    }

    /// Returns the newest output that is ready at `now`; `None` before the first.
    pub fn output(&self, now: Tai) -> Option<TrackerOutput> {
        let waiting = self.waiting.iter().rev().find(|(ready_at, _)| *ready_at <= now);
        waiting.map(|(_, output)| *output).or(self.ready)
    }
}

/// Returns the commands for a request that came at `now`.
pub fn commands_of(wish: &CameraWish, now: Tai) -> impl Iterator<Item = Commanded> + use<> {
    let at = wish.from.max(now);
    let commands = [wish.regions.map(CameraCommand::Regions), wish.exposure.map(CameraCommand::Exposure)];
    commands.into_iter().flatten().map(move |command| Commanded { command, at, from: CommandSource::Tracker })
}
