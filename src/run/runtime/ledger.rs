//! The ledger: counts every late, held, dropped, predicted or refused item, and keeps the first and the last events.
//!
//! Counts survive when entries are overwritten. No allocation after construction, no text.
//!
//! Adds missing parts of an exposure's scene to the ledger.

use crate::runtime::slot::Slot;
use base::time::{Span, Tai};
use plan::exposure::Degradation;
use scene::SceneReport;

macro_rules! events {
    ($($(#[doc = $doc:literal])+ $kind:ident = $name:literal,)*) => {
        /// Kind of an event.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum EventKind {
            $($(#[doc = $doc])+ $kind,)*
        }

        impl EventKind {
            /// Every kind.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$kind),*];

            /// Returns the name in tables and files.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$kind => $name,)*
                }
            }

            /// Returns what it means, as one line: `src/guide/events.md` lists every word with it.
            pub const fn meaning(self) -> &'static str {
                match self {
                    $(Self::$kind => concat!($($doc),+).trim_ascii(),)*
                }
            }
        }
    };
}

events! {
    /// A frame was finished after its deadline; the span is its lateness.
    Late = "late",
    /// The previous image went out in place of a late one; the span is the lateness.
    Held = "held",
    /// A frame did not go out; the span is its lateness, or zero when it was never started.
    Dropped = "dropped",
    /// The attitude at mid-exposure lay beyond the newest sample; the span is the horizon.
    Predicted = "predicted",
    /// The stream has stopped and the last attitude was held; the span is the newest sample's age.
    AttitudeHeld = "attitude_held",
    /// A frame without stars: the stream has stopped and the policy is `blank`; the span is the age.
    Blank = "blank",
    /// No frame: the stream has stopped and the policy is `drop`; the span is the newest sample's age.
    AttitudeMissing = "attitude_missing",
    /// Two or more attitudes were missing at an end of the exposure, whose middle was interpolated; the span is the
    /// uncovered time.
    PartlyExtrapolated = "partly_extrapolated",
    /// Jitter samples were missing when the frame was drawn; the span is the uncovered time.
    JitterMissing = "jitter_missing",
    /// A frame without stars: no attitude has been received yet.
    NoAttitude = "no_attitude",
    /// The planner found no method inside the budget and took the best available one.
    OverBudget = "over_budget",
    /// The frame would not have been drawn in time and was degraded; the span is its predicted drawing time.
    Degraded = "degraded",
    /// Drawing takes much longer than predicted: the planner has less time; the span is what the frame took to draw.
    Overloaded = "overloaded",
    /// Drawing takes about as long as predicted again; the span is what the frame took to draw.
    LoadGone = "load_gone",
    /// Tiles of stars were read too late: their stars are missing from the frame.
    StarsLate = "stars_late",
    /// The thread that reads tiles of stars has failed: tiles that are not in memory stay missing from here on.
    StarReaderLost = "star_reader_lost",
    /// The field has more stars than fit into their memory: its faintest layers are missing from the frame.
    StarsCrowdedOut = "stars_crowded_out",
    /// All buffers of the sink were still in use.
    SinkBusy = "sink_busy",
    /// A sink was too slow for a frame, or is lost: it did not receive the frame.
    SinkDropped = "sink_dropped",
    /// A sink failed on a frame, such as on a full disk.
    SinkRefused = "sink_refused",
    /// A network camera gave a frame up: its client stopped the acquisition or is gone, or the run ended.
    SinkCut = "sink_cut",
    /// A sink failed: it takes no more frames, and the others go on.
    SinkLost = "sink_lost",
    /// The telemetry of a star tracker lost a frame or a packet.
    TelemetryLost = "telemetry_lost",
    /// A star tracker outside answered a frame later than its bench allows; the span is mid-exposure to answer.
    AnswerLate = "answer_late",
    /// A star tracker outside did not answer a frame; the span is how long the answer was waited for.
    AnswerMissing = "answer_missing",
    /// A client of a gateway read too slowly for a frame of the bus: it did not receive the frame.
    GatewayDropped = "gateway_dropped",
    /// A thread beside the run ended before it did; the event names it.
    ThreadLost = "thread_lost",
    /// An attitude arrived before the clocks were correlated.
    NoTimeYet = "no_time_yet",
    /// The flight computer's clock stepped, or a presumed step was withdrawn; the span is the step.
    ClockStepped = "clock_stepped",
    /// The sender's clock gains or loses more than a clock does, for six seconds: it does not keep real time. The span is what
    /// two seconds of it gained or lost.
    ClockRunsOff = "clock_runs_off",
    /// The flight computer's clock restarted: its attitudes and dated triggers are forgotten; the span is the step.
    ClockRestarted = "clock_restarted",
    /// The observer's states come from outside, and none is near the exposure: its state is predicted.
    ObserverPredicted = "observer_predicted",
    /// An attitude or jitter sample, or an observer's state, was refused by its history.
    SampleRefused = "sample_refused",
    /// The queue from the receiving thread was full.
    QueueOverflow = "queue_overflow",
    /// Rates contradict the attitudes of the same stream for a second: other units, sign or axes. The span is that time.
    RatesContradict = "rates_contradict",
    /// The interface or port of the bus was lost.
    LinkLost = "link_lost",
    /// The interface or port of the bus is available again.
    LinkRegained = "link_regained",
    /// A link over TCP could not connect: its address refused, or cannot be reached. It is tried again; the summary has
    /// address and tries.
    LinkUnreached = "link_unreached",
    /// The CAN controller went bus-off.
    BusOff = "bus_off",
    /// The controller or the line reported errors.
    LinkErrors = "link_errors",
    /// Packets were lost in a full queue of the link, or could not be sent.
    LinkOverflow = "link_overflow",
    /// A plain link refused messages: of another layout, of another sender, or too long. The summary counts them by
    /// reason.
    InputRefused = "input_refused",
    /// Frames show stars from here on: a RUN was accepted.
    SessionRun = "session_run",
    /// Frames show no stars from here on: a STOP, or a peer of another major version.
    SessionHalt = "session_halt",
    /// A frame without stars: the session is not running.
    NotRunning = "not_running",
    /// A peer of another major version was refused, or reports that version in its heartbeat.
    VersionRefused = "version_refused",
    /// A command was refused.
    CommandRefused = "command_refused",
    /// A command came too soon after another like it and must be repeated.
    CommandDeferred = "command_deferred",
    /// The stream has stopped and the policy is `stop`: the run ends; the span is the newest sample's age.
    AttitudeStopped = "attitude_stopped",
    /// A table of jitter parameters was put into effect.
    TableApplied = "table_applied",
    /// A trigger was taken in; the span is the time to its instant.
    TriggerTaken = "trigger_taken",
    /// A trigger came after its instant; the span is how long after.
    TriggerLate = "trigger_late",
    /// A trigger was refused: nothing waits for its number, or its instant is out of range.
    TriggerRefused = "trigger_refused",
    /// A trigger acts from this frame on; the span is the time from its instant to the end of the exposure.
    TriggerFired = "trigger_fired",
    /// A trigger was forgotten before its instant: a STOP, a peer of another major version, or a restarted clock.
    TriggerForgotten = "trigger_forgotten",
    /// A command to the camera was taken in.
    CameraCommand = "camera_command",
    /// A command to the camera was refused: outside its range, or too many wait.
    CameraRefused = "camera_refused",
    /// A trigger of the camera came before it was ready: it starts no exposure.
    CameraTriggerMissed = "camera_trigger_missed",
    /// A trigger of the camera came while its exposures do not wait for triggers of that source.
    CameraTriggerIgnored = "camera_trigger_ignored",
    /// Edges of trigger lines were lost: more came than the kernel, or the queue to the frame thread, could hold.
    TriggerEdgeLost = "trigger_edge_lost",
    /// The numbers of a trigger line went back: its source started again. Edges that were lost at that are not counted.
    TriggerLineRestarted = "trigger_line_restarted",
    /// The flight computer's heartbeat has stopped; the span is the silence.
    HeartbeatLost = "heartbeat_lost",
    /// The flight computer's heartbeat is back; the span is the silence.
    HeartbeatBack = "heartbeat_back",
    /// The boresight was nearer to Sun, Moon or Earth than the baffle's exclusion angle.
    InsideExclusion = "inside_exclusion",
    /// A target's orbit could no longer be followed: the target is missing from here on.
    TargetLost = "target_lost",
    /// The Sun's disc was on the detector: it is not drawn.
    SunInField = "sun_in_field",
    /// A disc was drawn with cells larger than pixels, because pixel-sized cells would have been too many.
    CoarseDisc = "coarse_disc",
    /// Series of a day that was not prepared were evaluated on the frame thread.
    SeriesOnFrameThread = "series_on_frame_thread",
    /// More protons hit the detector in a frame than the list holds: the rest left no track.
    ProtonsLeftOut = "protons_left_out",
    /// A defect was commanded while the detector's list of defects was full: it is not shown.
    DefectLeftOut = "defect_left_out",
    /// A commanded fault began; the span is how long it lasts.
    Fault = "fault",
    /// A commanded fault of frames or of imaging is over; the span is its commanded length.
    FaultOver = "fault_over",
}

/// One event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// Kind of the event.
    pub kind: EventKind,
    /// Instant of the event.
    pub at: Tai,
    /// Frame in which it happened.
    pub frame: Option<u32>,
    /// Duration (see the kind).
    pub span: Span,
    /// Degradation of the frame; [`Degradation::Full`] in events of other kinds.
    pub degradation: Degradation,
    /// Name of the fault or thread; empty in events of other kinds.
    pub what: &'static str,
}

impl Event {
    /// Returns an event without a degradation.
    pub fn new(kind: EventKind, at: Tai, frame: Option<u32>, span: Span) -> Self {
        Self { kind, at, frame, span, degradation: Degradation::Full, what: "" }
    }
}

/// Events kept in full.
pub const KEPT: usize = 64;

/// First events of a run that are kept beside the last ones.
pub const EARLY: usize = 4096;

/// Event counts, the first [`EARLY`] events and the last [`KEPT`].
#[derive(Debug, Clone)]
pub struct Ledger {
    counts: [u64; EventKind::ALL.len()],
    /// Events that were added to those that are kept.
    noted: u64,
    early: Vec<Event>,
    last: Vec<Event>,
    next: usize,
}

impl Default for Ledger {
    fn default() -> Self {
        Self {
            counts: [0; EventKind::ALL.len()],
            noted: 0,
            early: Vec::with_capacity(EARLY),
            last: Vec::with_capacity(KEPT),
            next: 0,
        }
    }
}

impl Ledger {
    /// Adds an event.
    pub fn note(&mut self, event: Event) {
        self.note_many(event, 1);
    }

    /// Adds an event that happened so many times: it is counted as often, and kept once.
    pub fn note_many(&mut self, event: Event, times: u64) {
        if times == 0 {
            return;
        }
        let count = &mut self.counts[event.kind as usize];
        *count = count.saturating_add(times);
        self.noted += 1;
        if self.early.len() < EARLY {
            self.early.push(event);
        }
        if self.last.len() < KEPT {
            self.last.push(event);
        } else {
            self.last[self.next] = event;
        }
        self.next = (self.next + 1) % KEPT;
    }

    /// Returns how often a kind of event happened.
    pub fn count(&self, kind: EventKind) -> u64 {
        self.counts[kind as usize]
    }

    /// Returns the last events, oldest first.
    pub fn last(&self) -> impl Iterator<Item = &Event> {
        let split = if self.last.len() < KEPT { 0 } else { self.next };
        let (newer, older) = self.last.split_at(split);
        older.iter().chain(newer)
    }

    /// Returns the number of all events, kept or not.
    pub fn total(&self) -> u64 {
        self.counts.iter().fold(0, |sum, count| sum.saturating_add(*count))
    }

    /// Returns every event that is kept, in order: the first [`EARLY`], then the last ones that are not among them.
    pub fn kept(&self) -> impl Iterator<Item = &Event> {
        let after = self.noted.saturating_sub(EARLY as u64);
        let among_first = self.last.len() - usize::try_from(after).unwrap_or(usize::MAX).min(self.last.len());
        self.early.iter().chain(self.last().skip(among_first))
    }
}

/// Adds an event for each part that a scene lacks, and for each fact that the user must know.
pub(super) fn note_scene(report: &SceneReport, slot: Slot, ledger: &mut Ledger) {
    let SceneReport { is_excluded, shortfall, lost_reader, bodies, lost_targets, evaluated_series, background: _ } =
        *report;
    for (kind, happened) in [
        (EventKind::StarsLate, shortfall.late_tiles > 0),
        (EventKind::StarReaderLost, lost_reader),
        (EventKind::StarsCrowdedOut, shortfall.crowded_out_stars > 0),
        (EventKind::InsideExclusion, is_excluded),
        (EventKind::SunInField, bodies.has_sun),
        (EventKind::CoarseDisc, bodies.coarsest_px > 1.0),
        (EventKind::SeriesOnFrameThread, evaluated_series),
    ] {
        if happened {
            ledger.note(Event::new(kind, slot.release, Some(slot.number), Span::ZERO));
        }
    }
    for _ in 0..lost_targets {
        ledger.note(Event::new(EventKind::TargetLost, slot.release, Some(slot.number), Span::ZERO));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_survive_and_the_last_stay_in_order() {
        let mut ledger = Ledger::default();
        for i in 0..150_u32 {
            let kind = if i % 3 == 0 { EventKind::Late } else { EventKind::Predicted };
            let at = Tai::from_ns(i64::from(i));
            ledger.note(Event::new(kind, at, Some(i), Span::ZERO));
        }
        assert_eq!((ledger.count(EventKind::Late), ledger.count(EventKind::Predicted)), (50, 100));
        let frames: Vec<u32> = ledger.last().filter_map(|event| event.frame).collect();
        assert_eq!(frames, (150 - KEPT as u32..150).collect::<Vec<_>>());
    }

    #[test]
    fn an_event_of_many_times_is_counted_and_kept_once() {
        let mut ledger = Ledger::default();
        let event = |i| Event::new(EventKind::TriggerEdgeLost, Tai::from_ns(i), None, Span::ZERO);
        ledger.note_many(event(0), 0);
        ledger.note_many(event(1), u64::MAX);
        ledger.note_many(event(2), 4_294_967_293);
        ledger.note(Event::new(EventKind::Late, Tai::from_ns(3), None, Span::ZERO));
        assert_eq!((ledger.count(EventKind::TriggerEdgeLost), ledger.count(EventKind::Late)), (u64::MAX, 1));
        let kept: Vec<i64> = ledger.kept().map(|event| event.at.ns()).collect();
        assert_eq!(kept, [1, 2, 3]);
    }

    #[test]
    fn first_and_last_events_are_kept_once_each_and_all_are_counted() {
        let of = |events: u32| {
            let mut ledger = Ledger::default();
            let note = |i| Event::new(EventKind::Late, Tai::from_ns(i64::from(i)), Some(i), Span::ZERO);
            (0..events).for_each(|i| ledger.note(note(i)));
            assert_eq!(ledger.total(), u64::from(events));
            ledger.kept().filter_map(|event| event.frame).collect::<Vec<u32>>()
        };
        let (early, kept) = (EARLY as u32, KEPT as u32);
        for events in [0, 1, kept, kept + 1, early, early + 1, early + kept] {
            assert_eq!(of(events), (0..events).collect::<Vec<_>>(), "{events}: nothing is left out");
        }
        let wanted: Vec<u32> = (0..early).chain(early + 500 - kept..early + 500).collect();
        assert_eq!(of(early + 500), wanted, "control: those between are left out");
    }
}

#[cfg(test)]
mod scene_events_tests {
    use super::*;
    use crate::runtime::slot::Started;
    use base::time::Tai;
    use image::detector::Background;
    use scene::sky_bodies::BodyCounts;
    use stars::tiles::Shortfall;

    #[test]
    fn lost_reader_and_late_series_are_events_with_names_of_their_own() {
        let at = Tai::from_ns(0);
        let slot =
            Slot { number: 3, exposure_start: at, exposure_end: at, release: at, due: at, started: Started::Rate };
        let report = SceneReport {
            background: Background::default(),
            is_excluded: false,
            shortfall: Shortfall { late_tiles: 1, late_stars: 1, crowded_out_stars: 0 },
            lost_reader: true,
            bodies: BodyCounts::default(),
            lost_targets: 0,
            evaluated_series: false,
        };
        let mut ledger = Ledger::default();
        note_scene(&SceneReport { evaluated_series: true, ..report }, slot, &mut ledger);
        assert_eq!(ledger.count(EventKind::SeriesOnFrameThread), 1);
        let mut ledger = Ledger::default();
        note_scene(&report, slot, &mut ledger);
        note_scene(&SceneReport { lost_reader: false, ..report }, slot, &mut ledger);
        let count = |kind| ledger.count(kind);
        assert_eq!((count(EventKind::StarReaderLost), count(EventKind::StarsLate)), (1, 2));
        assert_eq!(count(EventKind::SeriesOnFrameThread), 0);
    }
}
