//! The run summary: everything a run is judged by, as one JSON object.
//!
//! Keys carry their unit; maps are sorted, stages are in flow order, so equal runs give equal text except their times.
//! The caller writes the text, whole or not at all.

use crate::report::histogram::{CountSpread, Quantiles};
use crate::report::{
    account::FrameAccount, frame_ring::Latency, json_pretty, losses::Losses, machine::Machine, sink_line::SinkLine,
    stages::Stage, verdict::RunVerdict,
};
use base::refused::Refused;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;

/// One run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RunSummary {
    /// The verdict and its reasons.
    #[serde(flatten)]
    pub verdict: RunVerdict,
    /// Version of starloop.
    pub starloop_version: String,
    /// Name of the bench.
    pub bench: String,
    /// Name of the camera.
    pub camera: String,
    /// Render backend.
    pub backend: String,
    /// Adapter and driver, or the processor, of the backend.
    pub adapter: String,
    /// `monotonic` or `virtual`.
    pub clock: String,
    /// The machine.
    pub machine: Machine,
    /// UTC of the first frame's slot on the run's clock, RFC 3339.
    pub start_utc: String,
    /// Length of the run on its own clock, s.
    pub duration_s: f64,
    /// Wall time the run took, s.
    pub wall_s: f64,
    /// Frame period, s.
    pub frame_period_s: f64,
    /// Seed of the run: of the sensor and of all that has no seed of its own.
    pub seed: u64,
    /// Seed of the noise of exposures.
    pub noise_seed: u64,
    /// Frames by outcome.
    pub frames: FrameCounts,
    /// Frames by their ends: each of those that the bench promised is counted once.
    pub account: FrameAccount,
    /// Wall time per stage, in the order of [`Stage::ALL`].
    #[serde(serialize_with = "by_stage_name")]
    pub stages: [Quantiles; Stage::COUNT],
    /// Completion minus deadline (early counts as 0).
    pub lateness: Quantiles,
    /// Age of the newest attitude when the frame was planned.
    pub attitude_age: Quantiles,
    /// Newest attitude to mid-exposure (interpolated counts as 0).
    pub horizon: Quantiles,
    /// From the arrival of a message at the edge to its place in the history (real clock).
    pub intake: Quantiles,
    /// From the attitude on the bus to the frame that shows it (real clock).
    pub latency: Latency,
    /// Slots missed, by cause (real clock).
    pub misses: BTreeMap<String, u64>,
    /// The link.
    pub link: LinkCounts,
    /// Commanded faults: frames in which each was active.
    pub faults: BTreeMap<String, u64>,
    /// Smear methods: frames drawn with each.
    pub methods: BTreeMap<String, u64>,
    /// Frames degraded to keep their time, by degradation level.
    pub degraded: BTreeMap<String, u64>,
    /// Stars per frame.
    pub stars: CountSpread,
    /// Events of each kind; kept when the events themselves are overwritten.
    pub event_counts: BTreeMap<String, u64>,
    /// The last events, oldest first.
    pub last_events: Vec<EventLine>,
    /// Sink the frames went to.
    pub sink: String,
    /// Folder, file or address to which the sink wrote them.
    pub output: Option<String>,
    /// CRC-32 over all frames, eight hexadecimal digits: equal for equal runs.
    pub run_crc32: String,
    /// Result of each sink.
    pub sinks: Vec<SinkLine>,
    /// Losses of a run that reached its end; empty when the exit status is 0.
    pub losses: Losses,
    /// Frames that each gateway forwarded, lost and refused.
    pub gateways: Vec<GatewayRow>,
    /// Answers of each star tracker outside; left out when there is none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub answers: Vec<AnswerRow>,
}

/// Answers of a star tracker outside.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct AnswerRow {
    /// Its place in the bench.
    pub place: String,
    /// Head whose frames it saw.
    pub head: usize,
    /// Protocol.
    pub protocol: String,
    /// Line on which it answered.
    pub line: String,
    /// Frames that went out.
    pub frames: u64,
    /// Frames that it answered.
    pub answers: u64,
    /// Answers with an attitude.
    pub attitudes: u64,
    /// Answers after [`Self::late_after_ms`].
    pub late: u64,
    /// Frames that it did not answer.
    pub missing: u64,
    /// Frames at the end of the run whose answer was not due yet.
    pub not_judged: u64,
    /// Answers to no frame, or to one that was answered or given up.
    pub of_no_frame: u64,
    /// Datagrams of others than the sender that has the line.
    pub of_other_senders: u64,
    /// Packets that were damaged or no report.
    pub damaged: u64,
    /// From the middle of an exposure to an answer that is late, ms.
    pub late_after_ms: f64,
    /// From the middle of the exposure to the answer.
    pub latency: Quantiles,
    /// From the frame, finished, to the answer: the part of the tracker, with its camera's sink and its line.
    pub since_sent: Quantiles,
    /// Root mean square of the attitudes' distance from those that were drawn: direction of the boresight, arcsec.
    pub error_across_arcsec: Option<f64>,
    /// The same about the boresight, arcsec.
    pub error_about_arcsec: Option<f64>,
}

impl AnswerRow {
    /// Returns it in words.
    pub fn words(&self) -> String {
        let Self { answers, frames, late, missing, latency, since_sent, .. } = self;
        let error = |value: Option<f64>| value.map_or_else(|| "-".into(), |arcsec| format!("{arcsec:.3}"));
        format!(
            "{answers} answers to {frames} frames, {late} late, {missing} missing; after mid-exposure p50 {:.3} ms, \
             p99 {:.3} ms, longest {:.3} ms (after the frame p50 {:.3} ms); off by {} arcsec rms across, {} about",
            latency.p50_ms,
            latency.p99_ms,
            latency.max_ms,
            since_sent.p50_ms,
            error(self.error_across_arcsec),
            error(self.error_about_arcsec)
        )
    }
}

/// Frames of a run by outcome.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct FrameCounts {
    /// Frames that the bench promised, or exposures where a camera made more.
    pub scheduled: u64,
    /// Frames drawn.
    pub rendered: u64,
    /// Frames handed to the sinks; each sink's line says how many it took.
    pub delivered: u64,
    /// Frames finished after their deadline.
    pub late: u64,
    /// Frames repeated because the new one was not ready.
    pub held: u64,
    /// Slots without a frame.
    pub dropped: u64,
    /// Frames whose attitude was extrapolated beyond the newest sample.
    pub extrapolated: u64,
    /// Frames whose attitude was interpolated in the middle, but extrapolated at an end of the exposure.
    pub partly_extrapolated: u64,
    /// Frames that lack jitter samples.
    pub jitter_missing: u64,
    /// Frames sent without a scene.
    pub blank: u64,
}

/// Messages received over the link.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct LinkCounts {
    /// Named counters (frames and bytes received and sent, groups complete, ...).
    pub counters: BTreeMap<String, u64>,
    /// Messages rejected, by reason.
    pub rejects: BTreeMap<String, u64>,
    /// The first plain message that was refused, quoted, with its reason.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_refused: Option<String>,
}

/// One event of the ledger.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EventLine {
    /// When, RFC 3339 on the run's clock.
    pub at_utc: String,
    /// The frame it belongs to.
    pub frame: Option<u32>,
    /// Kind of event.
    pub kind: String,
    /// The event in words and numbers.
    pub detail: String,
}

impl RunSummary {
    /// Returns the summary of a run that has not begun: names empty, counts zero.
    pub fn empty(machine: Machine) -> Self {
        Self { starloop_version: env!("CARGO_PKG_VERSION").into(), machine, ..Self::default() }
    }

    /// Returns JSON for people and programs that ends in a line break. Numbers that are not finite become `null`.
    ///
    /// # Errors
    /// When it cannot be expressed.
    pub fn to_json_pretty(&self) -> Result<String, Refused> {
        json_pretty(self)
    }
}

fn by_stage_name<S: Serializer>(stages: &[Quantiles; Stage::COUNT], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(Stage::ALL.iter().map(|stage| stage.name()).zip(stages))
}

/// Returns a run with something in every field.
#[cfg(test)]
pub(crate) fn sample_summary() -> RunSummary {
    let machine = Machine { cpu: "Example CPU".into(), cores: 8, system: "linux x86_64".into() };
    let times =
        |n: f64| Quantiles { count: 600, p50_ms: n, p99_ms: 2.0 * n, p999_ms: 3.0 * n, max_ms: 4.0 * n, mean_ms: n };
    let count = |pairs: &[(&str, u64)]| pairs.iter().map(|&(name, n)| (name.to_owned(), n)).collect();
    let mut summary = RunSummary::empty(machine);
    (summary.bench, summary.camera) = ("loopback".into(), "wide field".into());
    (summary.backend, summary.adapter, summary.clock) = ("cpu".into(), "AVX2, 8 threads".into(), "monotonic".into());
    (summary.start_utc, summary.duration_s, summary.wall_s) = ("2026-03-01T12:00:00.000000Z".into(), 60.0, 60.2);
    (summary.frame_period_s, summary.seed, summary.noise_seed) = (0.1, u64::MAX, u64::MAX - 1);
    summary.frames = FrameCounts {
        scheduled: 600,
        rendered: 599,
        delivered: 598,
        late: 3,
        held: 2,
        dropped: 1,
        extrapolated: 590,
        partly_extrapolated: 6,
        jitter_missing: 5,
        blank: 4,
    };
    summary.stages = core::array::from_fn(|i| times(0.1 * (i as f64 + 1.0)));
    summary.stages[Stage::Render as usize] = times(0.5);
    summary.stages[Stage::Readback as usize] = Quantiles::default();
    summary.latency = Latency { epoch_to_delivered: times(60.0), ..Latency::default() };
    summary.misses = count(&[("sink busy", 1)]);
    (summary.lateness, summary.attitude_age, summary.horizon) = (times(0.5), times(12.0), times(38.0));
    summary.intake = times(0.02);
    summary.link.counters = count(&[("rx_frames", 24_000), ("tx_frames", 1_200)]);
    summary.link.rejects = count(&[("bad_crc", 2), ("stale", 5)]);
    summary.faults = count(&[("hot_pixels", 600)]);
    summary.methods = count(&[("kernel", 590), ("samples", 9)]);
    summary.degraded = count(&[("faint-stars-out", 12)]);
    summary.stars = CountSpread { min: 31, median: 44, max: 71 };
    summary.event_counts = count(&[("late", 3), ("dropped", 1)]);
    summary.last_events = vec![EventLine {
        at_utc: "2026-03-01T12:00:59.900000Z".into(),
        frame: Some(599),
        kind: "late".into(),
        detail: "1.25 ms after its deadline".into(),
    }];
    (summary.sink, summary.output) = ("recorder".into(), Some("runs/7".into()));
    summary.run_crc32 = "0badcafe".into();
    summary.sinks = vec![sample_row()];
    summary.losses = Losses::of_sinks(&summary.sinks);
    summary.gateways = vec![sample_gateway_row()];
    summary
}

#[cfg(test)]
fn sample_row() -> SinkLine {
    SinkLine {
        place: "extra_sink[0]".into(),
        kind: "recorder",
        frames: 590,
        dropped: 7,
        refused: 1,
        bytes: 1_234_567_890,
        run_crc32: None,
        output: Some("runs/7".into()),
        first_error: Some("no space".into()),
        is_lost: false,
        mean_delay: base::time::Span::from_s(0.0125),
        longest_delay: base::time::Span::from_ms(310),
        counts: vec![("resent", 4)],
    }
}

// Frames that the gateways of a run forwarded, lost and refused: rows of the run summary, and their lines in its
// table.

/// Counts of one gateway.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct GatewayRow {
    /// Its kind.
    pub gateway: String,
    /// Address at which it listened.
    pub address: String,
    /// Clients served.
    pub clients: u64,
    /// Clients turned away because all seats were taken.
    pub refused: u64,
    /// Clients dropped because they did not read.
    pub stalled: u64,
    /// Frames from clients.
    pub from_clients: u64,
    /// Frames to clients.
    pub to_clients: u64,
    /// Frames of the bus that a client read too slowly for.
    pub dropped: u64,
    /// FD frames that the protocol cannot carry.
    pub withheld: u64,
    /// Lines and connections refused, by reason.
    pub rejects: BTreeMap<String, u64>,
}

/// The columns of the table beside the name.
pub(super) const HEADINGS: [&str; 6] = ["clients", "refused", "stalled", "from them", "to them", "dropped"];

impl GatewayRow {
    /// Returns the cells under [`HEADINGS`].
    pub(super) fn cells(&self) -> [String; 6] {
        [self.clients, self.refused, self.stalled, self.from_clients, self.to_clients, self.dropped]
            .map(|count| count.to_string())
    }

    /// Returns the lines below its row: where it listened, and a line for each reason.
    pub(super) fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!("  at {}", self.address)];
        if self.withheld > 0 {
            lines.push(format!("  {} FD frames withheld", self.withheld));
        }
        let rejects = plain_names(&self.rejects);
        lines.extend(rejects.iter().map(|(reason, count)| format!("  refused {count} times: {reason}")));
        lines
    }
}

/// Returns a gateway with something in every field.
#[cfg(test)]
pub(super) fn sample_gateway_row() -> GatewayRow {
    GatewayRow {
        gateway: "socketcand".into(),
        address: "127.0.0.1:29536".into(),
        clients: 2,
        refused: 51,
        stalled: 1,
        from_clients: 1234,
        to_clients: 5678,
        dropped: 9,
        withheld: 12,
        rejects: BTreeMap::from([("http_request".into(), 3)]),
    }
}

// Names of counts in plain words, for tables that people read; files have the names as programs know them.

/// Returns counts with their names in words: "BadFraming" and "bad_framing" are "bad framing".
pub(super) fn plain_names(counts: &BTreeMap<String, u64>) -> BTreeMap<String, u64> {
    counts.iter().map(|(name, count)| (words_of(name), *count)).collect()
}

fn words_of(name: &str) -> String {
    let mut words = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !words.is_empty() {
            words.push(' ');
        }
        words.extend(if c == '_' { ' ' } else { c }.to_lowercase());
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_holds_every_number_under_its_name() {
        let text = sample_summary().to_json_pretty().unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["seed"].as_u64(), Some(u64::MAX), "exact");
        assert_eq!(json["noise_seed"].as_u64(), Some(u64::MAX - 1), "the seed of the noise");
        assert_eq!(json["frames"]["extrapolated"], 590);
        assert_eq!(json["stages"]["render"]["p99_ms"], 1.0);
        assert_eq!(json["stages"].as_object().unwrap().len(), Stage::COUNT);
        assert_eq!(json["degraded"]["faint-stars-out"], 12);
        assert_eq!(json["link"]["rejects"]["stale"], 5);
        assert_eq!(json["last_events"][0]["frame"], 599);
        assert_eq!(json["latency"]["epoch_to_delivered"]["p999_ms"], 180.0);
        assert_eq!(json["misses"]["sink busy"], 1);
        assert_eq!(json["output"], "runs/7");
        let sink = &json["sinks"][0];
        assert_eq!((&sink["dropped"], &sink["refused"], &sink["counts"]["resent"]), (&7.into(), &1.into(), &4.into()));
        assert_eq!((&json["losses"][0]["part"], &json["losses"][0]["count"]), (&"sink".into(), &8.into()));
        let gateway = &json["gateways"][0];
        assert_eq!((&gateway["refused"], &gateway["rejects"]["http_request"]), (&51.into(), &3.into()));
        assert!(text.ends_with("}\n"), "ends in a line break");
    }

    #[test]
    fn stages_are_in_flow_order() {
        let text = sample_summary().to_json_pretty().unwrap();
        let places: Vec<usize> = Stage::ALL.iter().map(|s| text.find(&format!("\"{}\":", s.name())).unwrap()).collect();
        assert!(places.is_sorted(), "{places:?}");
    }

    #[test]
    fn numbers_that_are_not_finite_are_null() {
        let mut summary = sample_summary();
        summary.duration_s = f64::NAN;
        assert!(summary.to_json_pretty().unwrap().contains("\"duration_s\": null"));
    }
}
