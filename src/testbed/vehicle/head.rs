//! One tracker head aboard: frames and their time tags -> attitudes, each when the tracker is done with it.
//!
//! A frame is matched to the EXPOSURE message of its number (modulo 256); one without is not used, and counted.
//! Attitudes come out in the order of their readiness. Tests: `tests` of the vehicle.

use crate::tracker::{CameraOrders, CameraWish, Exposed, GuideStars, Outcome, Solution, Tracker, TrackerParams};
use base::axes::{Body, Icrf, Rotation, Sensor};
use base::time::{Span, Tai};
use base::{image::DnImage, refused::Refused};
use glam::{DMat3, DVec3};
use stars::catalog::Catalog;
use std::{collections::VecDeque, sync::Arc};

/// Time tags kept: a frame that is later than so many others is not used.
const TAGS: usize = 64;

/// An attitude older than this says nothing of how the tracker does now.
const FRESH: Span = Span::from_ms(1500);

/// One head.
#[derive(Debug, Clone, Copy)]
pub struct HeadParams {
    /// Mounting.
    pub sensor_from_body: Rotation<Sensor, Body>,
    /// Parameters of the tracker.
    pub tracker: TrackerParams,
    /// From the last pixel to the attitude.
    pub delay: Span,
    /// Limits of its commands to its camera; `None`: it sends none.
    pub orders: Option<CameraOrders>,
}

/// Last result of a head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadReport {
    /// Attitude, or the reason for its absence; `None` before the first frame.
    pub last: Option<Outcome>,
    /// Number of the frame of that result, and the middle of its exposure.
    pub frame: Option<(u32, Tai)>,
    /// Frames without a time tag.
    pub untagged: u64,
    /// Frames that came while the tracker was off.
    pub ignored: u64,
}

/// The heads of a vehicle.
#[derive(Debug)]
pub struct Heads(pub(super) Vec<Head>);

impl Heads {
    /// Returns heads without frames; equal trackers share one list of guide stars.
    pub(super) fn new(params: &[HeadParams], start: Tai) -> Result<Self, Refused> {
        let catalog = Catalog::built_in().map_err(|why| Refused(format!("catalog: {why}")))?;
        let mut guides: Vec<(TrackerParams, Arc<GuideStars>)> = Vec::new();
        let mut heads = Vec::with_capacity(params.len());
        for head in params {
            let known = guides.iter().find(|(tracker, _)| *tracker == head.tracker).map(|(_, guide)| Arc::clone(guide));
            let guide = match known {
                Some(guide) => guide,
                None => {
                    let guide = Arc::new(GuideStars::new(&catalog, &head.tracker, start)?);
                    guides.push((head.tracker, Arc::clone(&guide)));
                    guide
                }
            };
            heads.push(Head::new(*head, guide));
        }
        Ok(Self(heads))
    }

    /// Notes when a frame was exposed.
    pub(super) fn tag(&mut self, frame: u8, mid_exposure: Tai) {
        self.0.iter_mut().for_each(|head| head.tag(frame, mid_exposure));
    }

    /// Returns whether the EXPOSURE message of a frame has come.
    pub fn has_tag(&self, head: usize, number: u32) -> bool {
        self.0.get(head).is_some_and(|head| head.tag_of(number).is_some())
    }

    /// Takes how the next frame of a head was exposed, where that is not as the camera's file says.
    pub fn expose(&mut self, head: usize, exposed: &Exposed) {
        if let Some(head) = self.0.get_mut(head) {
            head.tracker.expose(exposed);
        }
    }

    /// Returns what a head's tracker asks of its camera after the last frame, once.
    pub fn take_wish(&mut self, head: usize) -> Option<CameraWish> {
        self.0.get_mut(head)?.wish.take()
    }

    /// Returns the last result of each head.
    pub fn reports(&self) -> impl Iterator<Item = &HeadReport> {
        self.0.iter().map(|head| &head.report)
    }

    /// Leaves a head to a tracker outside: the one inside looks at no frame.
    pub fn hand_over(&mut self, head: usize) {
        self.0.get_mut(head).into_iter().for_each(|head| head.is_outside = true);
    }

    /// Takes what a tracker outside says at `at` about a frame of a head; a head that is off does not listen.
    pub fn take_answer(&mut self, head: usize, frame: u32, outcome: Outcome, at: Tai) {
        let Some(head) = self.0.get_mut(head) else { return };
        if head.off > 0 {
            head.report.ignored += 1;
            return;
        }
        head.last_frame = Some(at);
        head.report.last = Some(outcome);
        if let Outcome::Solved(solution) = outcome {
            head.report.frame = Some((frame, solution.at));
            head.ready.push_back((at, solution));
        }
    }

    /// Switches one head, or all of them, off or on again.
    pub(super) fn switch(&mut self, head: Option<usize>, is_off: bool) {
        let chosen = |(i, _): &(usize, &mut Head)| head.is_none_or(|head| head == *i);
        self.0.iter_mut().enumerate().filter(chosen).for_each(|(_, head)| head.switch(is_off));
    }

    /// Returns the frames that came while one head, or all of them, were off.
    pub(super) fn ignored(&self, head: Option<usize>) -> u64 {
        let chosen = |(i, _): &(usize, &HeadReport)| head.is_none_or(|head| head == *i);
        self.reports().enumerate().filter(chosen).map(|(_, report)| report.ignored).sum()
    }
}

/// A head with its queue of attitudes.
#[derive(Debug)]
pub(super) struct Head {
    params: HeadParams,
    tracker: Tracker,
    /// Frame number modulo 256 and middle of its exposure.
    tags: VecDeque<(u8, Tai)>,
    /// When each is ready.
    ready: VecDeque<(Tai, Solution)>,
    /// A tracker outside answers for it.
    is_outside: bool,
    /// How many faults keep it off.
    off: u32,
    last_frame: Option<Tai>,
    /// Camera request after the last frame.
    wish: Option<CameraWish>,
    pub(super) report: HeadReport,
}

impl Head {
    fn new(params: HeadParams, guide: Arc<GuideStars>) -> Self {
        Self {
            tracker: Tracker::new(params.tracker, guide),
            params,
            tags: VecDeque::with_capacity(TAGS + 1),
            ready: VecDeque::with_capacity(TAGS),
            is_outside: false,
            off: 0,
            last_frame: None,
            wish: None,
            report: HeadReport { last: None, frame: None, untagged: 0, ignored: 0 },
        }
    }

    /// Notes when a frame was exposed.
    fn tag(&mut self, frame: u8, mid_exposure: Tai) {
        self.tags.retain(|(number, _)| *number != frame);
        self.tags.push_back((frame, mid_exposure));
        if self.tags.len() > TAGS {
            self.tags.pop_front();
        }
    }

    /// Returns the middle of a frame's exposure, when its message has come. Numbers on the bus are modulo 256.
    fn tag_of(&self, number: u32) -> Option<Tai> {
        self.tags.iter().find(|(tagged, _)| u32::from(*tagged) == number & 0xff).map(|(_, mid_exposure)| *mid_exposure)
    }

    /// Measures a frame that arrived at `at`.
    pub(super) fn take_frame(&mut self, number: u32, image: &DnImage, at: Tai, beta: DVec3, rate_body: DVec3) {
        if self.is_outside {
            return;
        }
        self.last_frame = Some(at);
        if self.off > 0 {
            self.report.ignored += 1;
            return;
        }
        let Some(mid_exposure) = self.tag_of(number) else {
            self.report.untagged += 1;
            self.report.last = None;
            return;
        };
        let rate = self.params.sensor_from_body.apply(rate_body);
        let outcome = self.tracker.measure(image, mid_exposure, beta, Some(rate));
        self.report.last = Some(outcome);
        self.report.frame = Some((number, mid_exposure));
        if let Some(orders) = &self.params.orders {
            let done = (&outcome, at + self.params.delay);
            self.wish = Some(self.tracker.wish(orders, (image, mid_exposure), done, (beta, Some(rate))));
        }
        if let Outcome::Solved(solution) = outcome {
            self.ready.push_back((at + self.params.delay, solution));
        }
    }

    /// Returns the next attitude that is ready at `at`, in body axes, with its covariance.
    pub(super) fn next_ready(&mut self, at: Tai) -> Option<BodyAttitude> {
        let (_, solution) = self.ready.front().filter(|(ready, _)| *ready <= at).copied()?;
        self.ready.pop_front();
        let body_from_sensor = self.params.sensor_from_body.inverse();
        let turn = body_from_sensor.matrix();
        Some(BodyAttitude {
            at: solution.at,
            body_from_icrf: body_from_sensor * solution.sensor_from_icrf,
            covariance_rad2: turn * solution.covariance_rad2 * turn.transpose(),
        })
    }

    /// Returns whether the last frame gave an attitude, and came lately.
    pub(super) fn is_solved(&self, now: Tai) -> bool {
        let is_fresh = self.last_frame.is_some_and(|at| now - at < FRESH);
        is_fresh && matches!(self.report.last, Some(Outcome::Solved(_)))
    }

    /// Counts one more, or one less, of the causes that switch the head off.
    fn switch(&mut self, is_off: bool) {
        self.off = if is_off { self.off + 1 } else { self.off.saturating_sub(1) };
        if is_off {
            self.ready.clear();
            self.tracker.forget();
            self.report.last = None;
        }
    }
}

/// Measurement for the estimator.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyAttitude {
    pub(super) at: Tai,
    pub(super) body_from_icrf: Rotation<Body, Icrf>,
    pub(super) covariance_rad2: DMat3,
}
