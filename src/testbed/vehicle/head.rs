//! One tracker head aboard: frames and their time tags -> attitudes, each when the tracker is done with it.
//!
//! A frame is matched to the EXPOSURE message of its number (modulo 256); one without is not used, and counted. Attitudes
//! come out in the order of their readiness. Tests: `tests` of the vehicle.

use super::params::HeadParams;
use crate::base::axes::Rotation;
use crate::base::image::DnImage;
use crate::base::time::Tai;
use crate::testbed::tracker::{GuideStars, Outcome, Reason, Solution, Tracker};
use glam::DVec3;
use std::collections::VecDeque;
use std::sync::Arc;

/// Time tags kept: a frame that is later than so many others is not used.
const TAGS: usize = 64;

/// What a head said last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadReport {
    /// Attitude, or why there is none; `None` before the first frame.
    pub last: Option<Outcome>,
    /// Frames without a time tag.
    pub untagged: u64,
    /// Frames that came while the tracker was off.
    pub ignored: u64,
}

/// A head with its queue of attitudes.
#[derive(Debug)]
pub(super) struct Head {
    pub(super) params: HeadParams,
    tracker: Tracker,
    /// Frame number modulo 256 and middle of its exposure.
    tags: VecDeque<(u8, Tai)>,
    /// When each is ready.
    ready: VecDeque<(Tai, Solution)>,
    pub(super) is_off: bool,
    pub(super) report: HeadReport,
}

impl Head {
    pub(super) fn new(params: HeadParams, guide: Arc<GuideStars>) -> Self {
        Self {
            tracker: Tracker::new(params.tracker, guide),
            params,
            tags: VecDeque::with_capacity(TAGS + 1),
            ready: VecDeque::with_capacity(TAGS),
            is_off: false,
            report: HeadReport { last: None, untagged: 0, ignored: 0 },
        }
    }

    /// Notes when a frame was exposed.
    pub(super) fn tag(&mut self, frame: u8, mid_exposure: Tai) {
        self.tags.retain(|(number, _)| *number != frame);
        self.tags.push_back((frame, mid_exposure));
        if self.tags.len() > TAGS {
            self.tags.pop_front();
        }
    }

    /// Measures a frame that arrived at `at`.
    pub(super) fn take_frame(&mut self, number: u32, image: &DnImage, at: Tai, beta: DVec3, rate_body: DVec3) {
        if self.is_off {
            self.report.ignored += 1;
            return;
        }
        let low = u8::try_from(number & 0xff).unwrap_or(0);
        let Some((_, mid_exposure)) = self.tags.iter().find(|(tagged, _)| *tagged == low).copied() else {
            self.report.untagged += 1;
            self.report.last = None;
            return;
        };
        let rate = self.params.sensor_from_body.apply(rate_body);
        let outcome = self.tracker.measure(image, mid_exposure, beta, Some(rate));
        self.report.last = Some(outcome);
        if let Outcome::Solved(solution) = outcome {
            self.ready.push_back((at + self.params.delay, solution));
        }
    }

    /// The next attitude that is ready at `at`, in body axes, with its covariance.
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

    /// Whether the last frame gave an attitude.
    pub(super) fn is_solved(&self) -> bool {
        matches!(self.report.last, Some(Outcome::Solved(_)))
    }

    pub(super) fn switch(&mut self, is_off: bool) {
        self.is_off = is_off;
        if is_off {
            self.ready.clear();
            self.tracker.forget();
            self.report.last = Some(Outcome::NoSolution(Reason::NoMatch));
        }
    }
}

/// What the estimator takes.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyAttitude {
    pub(super) at: Tai,
    pub(super) body_from_icrf: Rotation<crate::base::axes::Body, crate::base::axes::Icrf>,
    pub(super) covariance_rad2: glam::DMat3,
}
