//! The times of one frame: its due time, the times of its stages, its outcome and the cause.
//!
//! Plain data that a frame thread fills in and a sink thread completes. Instants are on the run's clock. What is not
//! known is `None`, never a made-up number.

use crate::report::stages::{Stage, StageHistograms, StageTimes};
use base::time::{Span, Tai};

/// Outcome of a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// Its frame went out in time.
    Sent,
    /// Its frame went out late.
    Late,
    /// The frame before went out again in its place.
    Held,
    /// No frame was sent.
    Dropped,
}

impl Fate {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Sent, Self::Late, Self::Held, Self::Dropped];

    /// Returns the name in tables and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sent => "sent",
            Self::Late => "late",
            Self::Held => "held",
            Self::Dropped => "dropped",
        }
    }
}

/// Cause of a missed slot: its frame was late, held or dropped, or was without stars because no attitude was available.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MissCause {
    /// The frame thread slept past the release: the system woke it late.
    ReleasedLate,
    /// The frames before took so long that this slot started too late.
    FramesBefore,
    /// All buffers were still with the sink.
    SinkBusy,
    /// No attitude was available.
    AwaitingAttitude,
    /// This stage took longest beyond its median.
    Stage(Stage),
}

/// Causes other than a stage.
const CAUSES: [MissCause; 4] =
    [MissCause::ReleasedLate, MissCause::FramesBefore, MissCause::SinkBusy, MissCause::AwaitingAttitude];

impl MissCause {
    /// Number of causes.
    pub const COUNT: usize = CAUSES.len() + Stage::COUNT;

    /// Returns every cause, in the order of [`Self::index`].
    pub fn all() -> impl Iterator<Item = Self> {
        CAUSES.into_iter().chain(Stage::ALL.into_iter().map(Self::Stage))
    }

    /// Returns the place among all causes.
    pub fn index(self) -> usize {
        match self {
            Self::ReleasedLate => 0,
            Self::FramesBefore => 1,
            Self::SinkBusy => 2,
            Self::AwaitingAttitude => 3,
            Self::Stage(stage) => CAUSES.len() + stage as usize,
        }
    }

    /// Returns the cause in words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ReleasedLate => "released late by the system",
            Self::FramesBefore => "the frames before took too long",
            Self::SinkBusy => "sink busy",
            Self::AwaitingAttitude => "waiting for attitude",
            Self::Stage(stage) => stage.name(),
        }
    }
}

/// One frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameRecord {
    /// Frame number, from 0.
    pub number: u32,
    /// Camera head, from 0.
    pub head: usize,
    /// First instant of the exposure.
    pub exposure_start: Tai,
    /// Its middle.
    pub mid_exposure: Tai,
    /// Its last instant: work begins.
    pub release: Tai,
    /// Deadline.
    pub due: Tai,
    /// Time at which the frame thread began to wait for the slot.
    pub asked: Tai,
    /// Time at which it ran again.
    pub woken: Tai,
    /// The image was finished.
    pub finished: Option<Tai>,
    /// Epoch of the newest attitude in the image that went out.
    pub commanded: Option<Tai>,
    /// The image was handed to the sink thread.
    pub submitted: Option<Tai>,
    /// Time at which the sink took the frame: several sinks, and any sink on the real clock, have it in their queues
    /// then.
    pub delivered: Option<Tai>,
    /// Times of the stages.
    pub times: StageTimes,
    /// Finished minus due; negative when early.
    pub lateness: Span,
    /// Outcome.
    pub fate: Fate,
    /// Why it was missed; `None` when it was not.
    pub cause: Option<MissCause>,
    /// Degradation level.
    pub degradation: &'static str,
    /// Motion method.
    pub method: &'static str,
    /// Source of the attitude.
    pub origin: &'static str,
    /// Newest attitude to mid-exposure: how far it was predicted; negative when it was interpolated.
    pub horizon: Span,
    /// Newest attitude to the end of the exposure: how far its last part was extrapolated.
    pub end_horizon: Span,
    /// Part of the exposure that lacks jitter samples.
    pub jitter_missing: Span,
    /// Bound of the pointing error of that, rad; `None`: nothing is known about how the body may move.
    pub pointing_bound_rad: Option<f64>,
    /// Measured over predicted drawing time when the frame was planned; 1 without load.
    pub load: f64,
}

impl FrameRecord {
    /// Returns the record of a slot whose frame thread has just woken; nothing else has happened.
    pub fn released(number: u32, [exposure_start, release, due]: [Tai; 3], [asked, woken]: [Tai; 2]) -> Self {
        let mut times = StageTimes::default();
        times.set(Stage::Wait, woken - asked);
        times.set(Stage::Wake, woken - release);
        let half = Span::from_ns((release - exposure_start).ns() / 2);
        Self {
            number,
            head: 0,
            exposure_start,
            mid_exposure: exposure_start + half,
            release,
            due,
            asked,
            woken,
            finished: None,
            commanded: None,
            submitted: None,
            delivered: None,
            times,
            lateness: woken - due,
            fate: Fate::Dropped,
            cause: None,
            degradation: "none",
            method: "none",
            origin: "none",
            horizon: Span::ZERO,
            end_horizon: Span::ZERO,
            jitter_missing: Span::ZERO,
            pointing_bound_rad: None,
            load: 1.0,
        }
    }

    /// Returns whether the slot was missed.
    pub fn is_missed(&self) -> bool {
        self.cause.is_some()
    }

    /// Returns why a slot began too late for its frame to be drawn at all: its thread was at the frames before, or
    /// asleep.
    pub fn cause_of_late_start(&self) -> MissCause {
        if self.asked > self.release { MissCause::FramesBefore } else { MissCause::ReleasedLate }
    }

    /// Returns why a frame that was drawn was late: the stage that took longest beyond its median. Where no excess
    /// explains half of the lateness (every frame is late), the stage that took longest.
    pub fn cause_of_lateness(&self, usual: &StageHistograms) -> MissCause {
        let run = || Stage::OF_A_FRAME.into_iter().filter_map(|stage| self.times.get(stage).map(|time| (stage, time)));
        let beyond = |(stage, time): (Stage, Span)| (stage, time.ms() - usual.median_ms(stage));
        let worst = run().map(beyond).max_by(|a, b| a.1.total_cmp(&b.1));
        let explains = |excess_ms: f64| excess_ms >= 0.5 * self.lateness.ms().max(0.0) && excess_ms > 0.0;
        let stage = match worst {
            Some((stage, excess_ms)) if explains(excess_ms) => stage,
            _ => run().max_by_key(|(_, time)| *time).map_or(Stage::Wake, |(stage, _)| stage),
        };
        if stage == Stage::Wake { self.cause_of_late_start() } else { MissCause::Stage(stage) }
    }
}

/// Returns a frame delivered in time: 100 ms exposure from 100 ms times its number, due 80 ms later.
#[cfg(test)]
pub(crate) fn sample_record(number: u32) -> FrameRecord {
    let start = Tai::from_ns(1_790_000_000_000_000_000) + Span::from_ms(100 * i64::from(number));
    let after = |ms| start + Span::from_ms(ms);
    let mut record = FrameRecord::released(number, [after(0), after(100), after(180)], [after(60), after(101)]);
    for (stage, ms) in
        [(Stage::Plan, 2), (Stage::Render, 20), (Stage::Detector, 8), (Stage::Queue, 1), (Stage::Sink, 3)]
    {
        record.times.set(stage, Span::from_ms(ms));
    }
    record.times.set(Stage::ReleaseToDelivered, Span::from_ms(36));
    (record.finished, record.submitted, record.delivered) = (Some(after(131)), Some(after(132)), Some(after(136)));
    record.commanded = Some(after(60));
    (record.lateness, record.fate) = (Span::from_ms(-49), Fate::Sent);
    (record.degradation, record.method, record.origin) = ("full", "samples", "interpolated");
    record
}

#[cfg(test)]
#[path = "frame_record_tests.rs"]
mod tests;
