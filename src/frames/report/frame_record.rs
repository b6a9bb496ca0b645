//! The times of one frame: its due time, the times of its stages, its outcome and the cause.
//!
//! Plain data that a frame thread fills in and a sink thread completes. Instants are on the run's clock. What is not
//! known is `None`, never a made-up number.

use crate::report::stages::{Stage, StageHistograms, StageTimes};
use base::refused::Refused;
use base::time::{Span, Tai};
use base::units::ARCSEC;

base::words! {
    /// Outcome of a slot.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Fate {
        /// Its frame went out in time.
        Sent = "sent",
        /// Its frame went out late.
        Late = "late",
        /// The frame before went out again in its place.
        Held = "held",
        /// No frame was sent.
        Dropped = "dropped",
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

// The frame ring as CSV: one row per frame, times in ms after its release, empty where there was nothing.

/// Word for a bound that is not known.
const UNKNOWN: &str = "unknown";

/// A column: its name, and the cell of a frame.
type Column = (&'static str, fn(&FrameRecord) -> String);

/// Columns before those of the stages.
const COLUMNS: [Column; 21] = [
    ("frame", |record| record.number.to_string()),
    ("head", |record| record.head.to_string()),
    ("exposure_start_tai_ns", |record| record.exposure_start.ns().to_string()),
    ("release_tai_ns", |record| record.release.ns().to_string()),
    ("due_ms", |record| after_release(record, Some(record.due))),
    ("commanded_ms", |record| after_release(record, record.commanded)),
    ("woken_ms", |record| after_release(record, Some(record.woken))),
    ("finished_ms", |record| after_release(record, record.finished)),
    ("submitted_ms", |record| after_release(record, record.submitted)),
    ("delivered_ms", |record| after_release(record, record.delivered)),
    ("lateness_ms", |record| ms(record.lateness)),
    ("fate", |record| record.fate.name().to_owned()),
    ("cause", |record| record.cause.map(MissCause::name).unwrap_or_default().to_owned()),
    ("rung", |record| record.degradation.to_owned()),
    ("method", |record| record.method.to_owned()),
    ("origin", |record| record.origin.to_owned()),
    ("horizon_ms", |record| ms(record.horizon)),
    ("end_horizon_ms", |record| ms(record.end_horizon)),
    ("jitter_missing_ms", |record| ms(record.jitter_missing)),
    ("pointing_bound_arcsec", bound),
    ("load", |record| format!("{:.4}", record.load)),
];

fn ms(span: Span) -> String {
    format!("{:.6}", span.ms())
}

fn after_release(record: &FrameRecord, at: Option<Tai>) -> String {
    at.map(|at| ms(at - record.release)).unwrap_or_default()
}

fn bound(record: &FrameRecord) -> String {
    record.pointing_bound_rad.map_or_else(|| UNKNOWN.to_owned(), |rad| format!("{:.6}", rad / ARCSEC))
}

/// Returns the rows, with a heading.
///
/// # Errors
/// When they cannot be expressed.
pub fn frames_csv<'a>(records: impl IntoIterator<Item = &'a FrameRecord>) -> Result<Vec<u8>, Refused> {
    table(records).map_err(|why| {
        Refused(format!("the frames' times cannot be written as CSV: {why}; the frames are not affected"))
    })
}

fn table<'a>(records: impl IntoIterator<Item = &'a FrameRecord>) -> csv::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let stages = Stage::ALL.iter().map(|stage| format!("{}_ms", stage.name()));
    writer.write_record(COLUMNS.iter().map(|(name, _)| (*name).to_owned()).chain(stages))?;
    for record in records {
        let stages = Stage::ALL.iter().map(|stage| record.times.get(*stage).map(ms).unwrap_or_default());
        writer.write_record(COLUMNS.iter().map(|(_, cell)| cell(record)).chain(stages))?;
    }
    writer.into_inner().map_err(|error| error.into_error().into())
}

#[cfg(test)]
#[path = "frame_record_tests.rs"]
mod tests;

#[cfg(test)]
mod frames_csv_tests {
    use super::*;
    use crate::report::frame_record::sample_record;

    #[test]
    fn rows_hold_what_the_records_hold() {
        let missed = FrameRecord { cause: Some(MissCause::SinkBusy), delivered: None, ..sample_record(7) };
        let known = FrameRecord {
            pointing_bound_rad: Some(0.5 * ARCSEC),
            end_horizon: Span::from_ms(12),
            jitter_missing: Span::from_ms(14),
            ..sample_record(8)
        };
        let text = frames_csv([&missed, &known]).unwrap();
        let mut reader = csv::Reader::from_reader(&text[..]);
        let names = reader.headers().unwrap().clone();
        let rows: Vec<_> = reader.records().map(Result::unwrap).collect();
        let cell = |i: usize, name: &str| rows[i][names.iter().position(|n| n == name).unwrap()].to_owned();
        assert_eq!((cell(0, "frame"), cell(1, "frame")), ("7".into(), "8".into()));
        assert_eq!((cell(0, "cause"), cell(1, "cause")), ("sink busy".into(), String::new()));
        assert_eq!((cell(0, "delivered_ms"), cell(1, "delivered_ms")), (String::new(), "36.000000".into()));
        assert_eq!((cell(0, "commanded_ms"), cell(0, "due_ms")), ("-40.000000".into(), "80.000000".into()));
        assert_eq!((cell(1, "end_horizon_ms"), cell(1, "jitter_missing_ms")), ("12.000000".into(), "14.000000".into()));
        let bounds = [0, 1].map(|i| cell(i, "pointing_bound_arcsec"));
        assert_eq!(bounds, [UNKNOWN, "0.500000"], "never a made-up number");
        assert_eq!((cell(0, "render_ms"), cell(0, "readback_ms")), ("20.000000".into(), String::new()));
    }
}
