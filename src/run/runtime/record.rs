//! The record of a run: counts, histograms and events during the run; a summary at its end.
//!
//! The first word of a run's verdict while it goes on: no allocation, no text, for whoever watches.
//!
//! In: the record so far, with the limits of `[expect]`. Out: a word that is never better than the final one, except that
//! what the bench promised and has not come up yet is not missing. Tests: `tests/closed_loop/verdicts.rs`.
//!
//! How a run ended.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::{engine::FrameEngine, error::RunError, port_reading::PortReading, receiver::Receiver};
use base::drawn::{Degradation, FrameMethod, MethodName, PathOrigin};
use base::time::{Span, Tai};
use firmware_protocol::Reject;
use frames::report::{
    CountHistogram, EVENTS_MAX, EventLine, FrameAccount, FrameCounts, FrameRecord, FrameRing, LinkCounts, Losses,
    Machine, NewestEvent, RunLimits, RunNumbers, RunSummary, RunWord, Stage, StageHistogram, StageHistograms,
    StageTimes,
};
use frames::sink::{FaultFlags, FrameMeta, Loss, LossKind, SentFrame, SinkLine, SinkSummary};
use std::collections::BTreeMap;

/// The results of a run.
pub struct RunRecord {
    /// Frame counts.
    pub frames: FrameCounts,
    /// Frames of the slots so far by their ends.
    pub account: FrameAccount,
    /// Limits of `[expect]`.
    pub limits: RunLimits,
    /// Events.
    pub ledger: Ledger,
    /// Wall time per stage.
    pub stages: StageHistograms,
    /// Times of the last frames, and causes of missed slots (real clock).
    pub ring: FrameRing,
    lateness: StageHistogram,
    attitude_age: StageHistogram,
    horizon: StageHistogram,
    /// Time from arrival on the bus to the history (real clock).
    intake: StageHistogram,
    stars: CountHistogram,
    methods: [u64; MethodName::ALL.len()],
    degradations: [u64; Degradation::ALL.len()],
    faults: Vec<u64>,
    /// Readings of the ports at the newest frame.
    ports: Vec<PortReading>,
}

/// Initial capacity for readings of ports.
const PORTS: usize = 8;

impl Default for RunRecord {
    fn default() -> Self {
        Self {
            frames: FrameCounts::default(),
            account: FrameAccount::NONE,
            limits: RunLimits::default(),
            ledger: Ledger::default(),
            stages: StageHistograms::default(),
            ring: FrameRing::default(),
            lateness: StageHistogram::default(),
            attitude_age: StageHistogram::default(),
            horizon: StageHistogram::default(),
            intake: StageHistogram::default(),
            stars: CountHistogram::default(),
            methods: [0; MethodName::ALL.len()],
            degradations: [0; Degradation::ALL.len()],
            faults: vec![0; FaultFlags::NAMED.len()],
            ports: Vec::with_capacity(PORTS),
        }
    }
}

// A watcher of the run has fields for every kind of event.
const _: () = assert!(EventKind::ALL.len() <= EVENTS_MAX);

impl RunRecord {
    /// Returns a record that keeps the times of the last `frames` frames of each of `heads`.
    pub fn with_ring(frames: usize, heads: usize) -> Self {
        Self { ring: FrameRing::with_capacity(frames, heads), ..Self::default() }
    }

    /// Records a delivered frame, as measured by the sink thread.
    pub fn complete(&mut self, delivered: &FrameRecord) {
        for stage in [Stage::Handover, Stage::Queue, Stage::Sink, Stage::ReleaseToDelivered] {
            if let Some(time) = delivered.times.get(stage) {
                self.stages.record_stage(stage, time);
            }
        }
        self.ring.complete(*delivered);
    }

    /// Records the losses of sinks: an event for each frame and sink, with the frame's own number and the time of the
    /// report.
    pub fn note_losses(&mut self, losses: &[Loss], at: Tai) {
        for loss in losses {
            let kind = match loss.kind {
                LossKind::Dropped => EventKind::SinkDropped,
                LossKind::Refused => EventKind::SinkRefused,
                LossKind::Cut => EventKind::SinkCut,
                LossKind::TelemetryLost => EventKind::TelemetryLost,
                LossKind::SinkLost => EventKind::SinkLost,
            };
            self.note(kind, at, loss.frame, Span::ZERO);
        }
    }

    /// Counts a frame that was drawn.
    pub fn count_rendered(&mut self, frame: &SentFrame, times: &StageTimes) {
        let meta = &frame.meta;
        self.frames.rendered += 1;
        let blank = meta.faults.contains(FaultFlags::BLANK);
        self.frames.blank += u64::from(blank);
        let is_extrapolated = matches!(meta.origin, PathOrigin::Predicted | PathOrigin::Held);
        self.frames.extrapolated += u64::from(!blank && is_extrapolated);
        self.frames.partly_extrapolated += u64::from(meta.is_partly_extrapolated);
        self.frames.jitter_missing += u64::from(meta.jitter_missing > Span::ZERO);
        self.stages.record(times);
        self.stars.record(frame.truth.len() as u64);
        self.attitude_age.record(meta.attitude_age);
        self.horizon.record(meta.horizon);
        if let FrameMethod::Planned(method) = meta.method {
            self.methods[method as usize] += 1;
        }
        self.degradations[meta.degradation as usize] += 1;
    }

    /// Records the time from a message's arrival to its acceptance.
    pub fn count_intake(&mut self, after: Span) {
        self.intake.record(after);
    }

    /// Counts a frame that goes out.
    pub fn count_outgoing(&mut self, meta: &FrameMeta) {
        self.lateness.record(meta.lateness);
        for (count, (flag, _)) in self.faults.iter_mut().zip(FaultFlags::NAMED) {
            *count += u64::from(meta.faults.contains(*flag));
        }
    }

    /// Adds an event to the ledger.
    pub fn note(&mut self, kind: EventKind, at: Tai, frame: u32, span: Span) {
        self.ledger.note(Event::new(kind, at, Some(frame), span));
    }

    /// Stores the present readings of the ports.
    pub fn keep_ports(&mut self, readings: &[PortReading]) {
        self.ports.clear();
        self.ports.extend_from_slice(readings);
    }

    /// Returns a copy of counts and times so far for a watcher of the run, without allocation.
    pub fn numbers(&self, frames_in_run: Option<u64>) -> RunNumbers {
        let events = EventKind::ALL.iter().map(|kind| (kind.name(), self.ledger.count(*kind))).collect();
        let newest = self.ledger.last().map(newest_event).collect();
        let stages = self.stages.tallies();
        // On the real clock delivered frames are counted at the end; until then the count of sink times is used.
        let sent = stages[Stage::Sink as usize].count();
        let frames = FrameCounts { delivered: self.frames.delivered.max(sent), ..self.frames };
        let mut numbers = RunNumbers {
            frames_in_run,
            frames,
            account: self.account,
            word: word_so_far(&self.limits, &self.ledger, &self.account),
            stages,
            events,
            newest,
            ..RunNumbers::NONE
        };
        self.ports.iter().for_each(|port| numbers.push_port(port.named()));
        numbers
    }

    /// Returns the 99 % quantile of the time from release to delivery, ms.
    pub fn p99_ms(&self) -> f64 {
        self.stages.of(Stage::ReleaseToDelivered).p99_ms
    }

    /// Returns every event that is kept, in words, in order.
    pub fn kept_events(&self) -> Vec<EventLine> {
        self.ledger.kept().map(event_line).collect()
    }

    /// Returns the summary of the run (names of bench, clock and times are filled in by the caller).
    pub fn summary(
        &self,
        engine: &FrameEngine,
        receiver: &Receiver,
        ports: &[PortReading],
        sink: Option<&SinkSummary>,
    ) -> RunSummary {
        let mut summary = RunSummary::empty(Machine::read());
        let params = &engine.params;
        summary.camera = params.camera.name.to_string();
        summary.backend = engine.drawer.imager.name().into();
        summary.adapter = engine.drawer.imager.description();
        summary.start_utc = params.first_exposure.to_rfc3339();
        summary.frame_period_s = params.frame_period.s();
        summary.duration_s = params.frame_period.s() * f64::from(params.frames);
        (summary.seed, summary.noise_seed) = (params.seed, params.noise_seed);
        summary.frames = self.frames;
        summary.stages = self.stages.quantiles();
        summary.lateness = self.lateness.quantiles();
        summary.attitude_age = self.attitude_age.quantiles();
        summary.horizon = self.horizon.quantiles();
        summary.latency = self.ring.latency();
        summary.misses = self.ring.misses();
        summary.stars = self.stars.spread();
        summary.intake = self.intake.quantiles();
        summary.link = link_counts(receiver, ports);
        summary.methods = named(MethodName::ALL.iter().map(|m| m.name()).zip(self.methods));
        let degraded =
            Degradation::ALL.iter().zip(self.degradations).filter(|(degradation, _)| **degradation > Degradation::Full);
        summary.degraded = named(degraded.map(|(degradation, count)| (degradation.name(), count)));
        summary.faults = named(FaultFlags::NAMED.iter().map(|(_, name)| *name).zip(self.faults.iter().copied()));
        summary.event_counts = named(EventKind::ALL.iter().map(|kind| (kind.name(), self.ledger.count(*kind))));
        summary.last_events = self.ledger.last().map(event_line).collect();
        if let Some(sink) = sink {
            summary.sink = sink.sink.into();
            summary.output = sink.output.as_ref().map(|path| path.display().to_string());
            summary.run_crc32 = format!("{:08x}", sink.run_crc32);
        }
        summary
    }
}

/// Returns names with counts above zero.
fn named<'a>(counts: impl Iterator<Item = (&'a str, u64)>) -> BTreeMap<String, u64> {
    counts.filter(|(_, count)| *count > 0).map(|(name, count)| (name.to_string(), count)).collect()
}

fn link_counts(receiver: &Receiver, ports: &[PortReading]) -> LinkCounts {
    let history = receiver.attitudes.history.counts();
    let mut counts = LinkCounts::default();
    let mut add = |name: &str, count: u64| counts.counters.insert(name.to_string(), count);
    add("attitudes_accepted", history.accepted);
    add("jitter_points_accepted", receiver.mountings.of(0).jitter.counts().accepted);
    add("clock_pairs", receiver.clock.remote.pairs);
    for (number, port) in ports.iter().enumerate() {
        count_port(&mut counts, number, port);
    }
    counts.first_refused = ports.iter().find_map(|port| port.first_refused).map(|first| first.to_string());
    let pulses = receiver.clock.pulses;
    let triggers = receiver.session.triggers.of(0).counts();
    let sometimes = [
        ("jitter_points_late", receiver.mountings.of(0).late_jitter),
        ("pulses_used", pulses.used),
        ("pulses_refused", pulses.refused),
        ("triggers_accepted", triggers.accepted),
        ("triggers_late", triggers.late),
        ("triggers_repeated", triggers.repeated),
        ("triggers_refused", triggers.refused),
        ("triggers_forgotten", triggers.forgotten),
        ("triggers_fired", triggers.fired),
    ];
    for (name, count) in sometimes {
        if count > 0 {
            counts.counters.insert(name.into(), count);
        }
    }
    let jitter = receiver.mountings.of(0).jitter.counts();
    let history = [
        ("jitter_duplicate_epoch", jitter.duplicate_epoch),
        ("jitter_stale_time", jitter.stale),
        ("jitter_future_time", jitter.future),
        ("jitter_not_finite", jitter.not_finite),
        ("jitter_too_large", jitter.too_fast),
        ("jitter_older_than_history", jitter.older_than_history),
        ("duplicate_epoch", history.duplicate_epoch),
        ("stale_time", history.stale),
        ("future_time", history.future),
        ("not_finite", history.not_finite),
        ("too_fast", history.too_fast),
        ("older_than_history", history.older_than_history),
    ];
    let clock = &receiver.clock.remote;
    let marks = [("late_time_mark", clock.late), ("outlier_time_mark", clock.outliers)];
    for (name, count) in history.into_iter().chain(marks).filter(|(_, count)| *count > 0) {
        *counts.rejects.entry(name.into()).or_default() += count;
    }
    counts
}

/// Adds the counters of one port: the first has plain names, further ones have their number as a prefix.
fn count_port(counts: &mut LinkCounts, number: usize, port: &PortReading) {
    let name = |what: &str| if number == 0 { what.to_string() } else { format!("port_{number}_{what}") };
    counts.counters.extend(port.reported().map(|(what, count)| (name(what), count)));
    for (reason, count) in port.rejects().filter(|(_, count)| *count > 0) {
        *counts.rejects.entry(reject_name(reason)).or_default() += u64::from(count);
    }
    for (reason, count) in port.plain_rejects().filter(|(_, count)| *count > 0) {
        *counts.rejects.entry(reason.name().into()).or_default() += u64::from(count);
    }
}

fn reject_name(reason: Reject) -> String {
    format!("{reason:?}")
}

fn newest_event(event: &Event) -> NewestEvent {
    NewestEvent { kind: event.kind.name(), what: event.what, at: event.at, frame: event.frame, span: event.span }
}

fn event_line(event: &Event) -> EventLine {
    EventLine {
        at_utc: event.at.to_rfc3339(),
        frame: event.frame,
        kind: event.kind.name().into(),
        detail: if event.kind == EventKind::Degraded {
            format!("{}, drawn in {:.3} ms as predicted", event.degradation, event.span.ms())
        } else if event.what.is_empty() {
            format!("{:.3} ms", event.span.ms())
        } else {
            format!("{}, {:.3} ms", event.what, event.span.ms())
        },
    }
}

/// An event that means that something is missing.
#[derive(Debug, Clone, Copy)]
pub struct Missing {
    /// Its kind.
    pub kind: EventKind,
    /// Word of the verdict that it leads to.
    pub word: RunWord,
    /// Words that follow its count.
    pub words: &'static str,
    /// Key of its limit; empty where nothing is allowed.
    pub key: &'static str,
    /// Most such events.
    pub limit: Option<u32>,
}

/// Returns every kind of event that means that something is missing, with its limit.
pub fn missing(limits: &RunLimits) -> [Missing; 13] {
    let word = RunWord::Incomplete;
    let limited = |kind, words, key, limit| Missing { kind, word, words, key, limit };
    let never = |kind, words| Missing { kind, word, words, key: "", limit: None };
    [
        limited(
            EventKind::JitterMissing,
            "frames without a part of their jitter samples",
            "jitter_missing_frames_at_most",
            limits.jitter_missing,
        ),
        limited(
            EventKind::LinkOverflow,
            "times packets were lost on a link or could not be sent",
            "packets_lost_at_most",
            limits.packets_lost,
        ),
        limited(
            EventKind::AnswerMissing,
            "frames without an answer of their tracker outside",
            "missing_answers_at_most",
            limits.answers_missing,
        ),
        Missing {
            word: RunWord::Late,
            ..limited(
                EventKind::AnswerLate,
                "late answers of trackers outside",
                "late_answers_at_most",
                limits.answers_late,
            )
        },
        never(EventKind::QueueOverflow, "times messages were lost in a full queue"),
        never(EventKind::TriggerEdgeLost, "times edges of trigger lines were lost"),
        never(EventKind::RatesContradict, "rates that contradict the attitudes"),
        never(EventKind::ClockRunsOff, "times the sender's clock ran off: it does not keep real time"),
        never(EventKind::StarsLate, "frames without stars that were read too late"),
        never(EventKind::StarsCrowdedOut, "frames without their faintest stars: more stars than memory"),
        never(EventKind::TargetLost, "targets lost: their orbits could not be followed"),
        never(EventKind::ProtonsLeftOut, "frames with more proton hits than are drawn"),
        never(EventKind::DefectLeftOut, "commanded defects that were not shown: the list was full"),
    ]
}

/// Events that make a run LOST.
const LOST: [EventKind; 5] = [
    EventKind::SinkDropped,
    EventKind::SinkRefused,
    EventKind::SinkLost,
    EventKind::ThreadLost,
    EventKind::GatewayDropped,
];

/// Returns the word so far.
pub(super) fn word_so_far(limits: &RunLimits, ledger: &Ledger, account: &FrameAccount) -> RunWord {
    let is_above = |kind, limit: Option<u32>| ledger.count(kind) > u64::from(limit.unwrap_or(0));
    if LOST.iter().any(|kind| ledger.count(*kind) > 0) {
        return RunWord::Lost;
    }
    let of_links = is_above(EventKind::LinkLost, limits.links_lost).then_some(RunWord::Incomplete);
    let missing = missing(limits).into_iter().filter(|missing| is_above(missing.kind, missing.limit));
    let words = missing.map(|missing| missing.word).chain(of_links);
    words.fold(limits.word(account), RunWord::max)
}

/// Result of a run, whether it ended well or not.
pub struct RunOutcome {
    /// Counts, times and events.
    pub record: RunRecord,
    /// Counters of each port.
    pub ports: Vec<PortReading>,
    /// Summary written by the sink of each head; `None` when it could not finish.
    pub summaries: Vec<Option<SinkSummary>>,
    /// Result of each sink of each head, failures included: on the real clock they do not end a run.
    pub sinks: Vec<SinkLine>,
    /// Threads beside the run that ended before it did: pulses, gateways, the live view.
    pub lost_threads: Vec<&'static str>,
    /// Why the run ended early, if it did.
    pub error: Option<RunError>,
}

impl RunOutcome {
    /// Lists all losses: frames that a sink dropped or refused, sinks that could not be finished or failed, threads.
    pub fn losses(&self) -> Losses {
        let mut losses = Losses::of_sinks(&self.sinks);
        self.lost_threads.iter().for_each(|name| losses.note_thread(name));
        note_lost_reader(&mut losses, &self.record.ledger);
        losses
    }

    /// Records a thread that ended before the run did; `at` is when this was noticed.
    pub fn note_lost_thread(&mut self, name: &'static str, at: Tai) {
        self.lost_threads.push(name);
        self.record.ledger.note(Event { what: name, ..Event::new(EventKind::ThreadLost, at, None, Span::ZERO) });
    }
}

/// Adds the thread that reads tiles of stars, if the ledger records its loss.
pub fn note_lost_reader(losses: &mut Losses, ledger: &Ledger) {
    if ledger.count(EventKind::StarReaderLost) > 0 {
        losses.note_thread("tiles");
    }
}

/// Returns the lines of one head's sinks; with several heads their places contain the head's number.
pub fn lines_of_head(head: usize, heads: usize, lines: Vec<SinkLine>) -> impl Iterator<Item = SinkLine> {
    let named = move |line: SinkLine| match heads {
        0 | 1 => line,
        _ => SinkLine { place: format!("head{head} {}", line.place), ..line },
    };
    lines.into_iter().map(named)
}

#[cfg(test)]
mod outcome_tests {
    use super::*;

    #[test]
    fn frames_that_a_gateways_client_loses_make_the_word_so_far_lost() {
        let mut record = RunRecord::default();
        assert_eq!(record.numbers(None).word, RunWord::Ok, "control");
        record.ledger.note(Event::new(EventKind::GatewayDropped, Tai::from_ns(0), None, Span::ZERO));
        let numbers = record.numbers(None);
        assert_eq!(numbers.word, RunWord::Lost);
        assert!(numbers.events.iter().any(|event| event == ("gateway_dropped", 1)));
    }

    #[test]
    fn lost_reader_of_stars_is_a_loss_of_the_run() {
        let mut record = RunRecord::default();
        let outcome = |record| RunOutcome {
            record,
            ports: Vec::new(),
            summaries: Vec::new(),
            sinks: Vec::new(),
            lost_threads: Vec::new(),
            error: None,
        };
        assert!(outcome(RunRecord::default()).losses().is_empty(), "control: nothing was lost");
        record.ledger.note(Event::new(EventKind::StarReaderLost, Tai::from_ns(0), Some(1), Span::ZERO));
        assert_eq!(outcome(record).losses().to_string(), "lost: tiles: the thread ended before the run did");
    }
}
