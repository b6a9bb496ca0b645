//! The same numbers for Prometheus: text exposition format 0.0.4.
//!
//! Names begin with `starloop_` and end in their unit; counters end in `_total`. Each family has its HELP and TYPE
//! once, before its samples. Histograms are cumulative, with `+Inf`. `hil_scripts/tests/test_live.py` reads it with
//! Prometheus's own parser; the forms of numbers and labels are tested below.

use crate::live::{HeadParams, head::Board, kept::Picture};
use core::fmt::{Display, Write};
use frames::report::{RunNumbers, Stage};
use frames::sink::{FaultFlags, SentFrame};

/// The content type of the format.
pub(super) const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// The text under way.
struct Text {
    text: String,
}

impl Text {
    /// Begins a family.
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        self.line(format_args!("# HELP starloop_{name} {help}"));
        self.line(format_args!("# TYPE starloop_{name} {kind}"));
    }

    /// Adds a sample without labels.
    fn sample(&mut self, name: &str, value: impl Display) {
        self.line(format_args!("starloop_{name} {value}"));
    }

    /// Adds a sample with labels; their values are escaped.
    fn labelled(&mut self, name: &str, labels: &[(&str, &str)], value: impl Display) {
        let mut inside = String::new();
        for (i, (label, text)) in labels.iter().enumerate() {
            // Writing to a string cannot fail.
            let _ = write!(inside, "{}{label}=\"{}\"", if i == 0 { "" } else { "," }, escaped(text));
        }
        self.line(format_args!("starloop_{name}{{{inside}}} {value}"));
    }

    /// Adds a family of one sample.
    fn single(&mut self, name: &str, kind: &str, help: &str, value: impl Display) {
        self.family(name, kind, help);
        self.sample(name, value);
    }

    /// Adds the buckets of one histogram, its sum and its count.
    fn histogram(
        &mut self,
        name: &str,
        labels: &[(&str, &str)],
        buckets: impl Iterator<Item = (f64, u64)>,
        (sum, count): (f64, u64),
    ) {
        let bucket = format!("{name}_bucket");
        let end = (f64::INFINITY, count);
        for (upper, below) in buckets.chain([end]) {
            let upper = if upper.is_finite() { upper.to_string() } else { "+Inf".into() };
            let with_bound: Vec<_> = labels.iter().copied().chain([("le", upper.as_str())]).collect();
            self.labelled(&bucket, &with_bound, below);
        }
        let parts: [(&str, &dyn Display); 2] = [("sum", &sum), ("count", &count)];
        for (part, value) in parts {
            self.labelled(&format!("{name}_{part}"), labels, value);
        }
    }

    fn line(&mut self, line: core::fmt::Arguments<'_>) {
        let _ = writeln!(self.text, "{line}"); // writing to a string cannot fail
    }
}

/// Returns a label's value as the format has it.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

/// Returns all metrics now.
pub(super) fn metrics_of(board: &mut Board) -> String {
    board.listen();
    let mut out = Text { text: String::with_capacity(64 * 1024) };
    out.family("build_info", "gauge", "Version of the program, as a label; always 1.");
    out.labelled("build_info", &[("version", env!("CARGO_PKG_VERSION"))], 1);
    let is_over = u8::from(board.is_over());
    out.single("run_over", "gauge", "1 when the run has ended and no frame comes any more.", is_over);
    heads(&mut out, &board.params.heads);
    let newest = board.heads.iter_mut().enumerate();
    let newest: Vec<Shown<'_>> =
        newest.filter_map(|(number, head)| Some((number.to_string(), head.newest()?))).collect();
    if !newest.is_empty() {
        newest_frames(&mut out, &newest);
        fault_flags(&mut out, &newest);
        lateness(&mut out, &newest);
    }
    if board.has_numbers {
        run(&mut out, &board.numbers);
    }
    let served = board.served;
    let view = [
        ("live_requests", "Requests to the live view that were answered.", served.requests),
        (
            "live_requests_refused",
            "Requests to the live view that were refused (status 400 and above).",
            served.refused,
        ),
        ("live_clients_refused", "Connections to the live view that found all places taken.", served.clients_refused),
        (
            "live_clients_failed",
            "Connections to the live view that ended in an error or took too long.",
            served.clients_failed,
        ),
    ];
    counters(&mut out, view);
    out.text
}

fn counters(out: &mut Text, named: impl IntoIterator<Item = (&'static str, &'static str, u64)>) {
    for (name, help, count) in named {
        out.single(&format!("{name}_total"), "counter", help, count);
    }
}

/// A head's number, and its newest picture.
type Shown<'a> = (String, &'a Picture);
/// Name after `starloop_`, help, and value of a gauge of the newest frame.
type FrameGauge = (&'static str, &'static str, fn(&SentFrame) -> f64);

/// One sample per head for each.
const FRAME_GAUGES: [FrameGauge; 10] = [
    ("frame_number", "Number of the newest frame.", |frame| f64::from(frame.meta.number)),
    ("frame_mid_exposure_timestamp_seconds", "Unix time of the middle of its exposure.", |frame| {
        frame.meta.mid_exposure.unix_s()
    }),
    ("frame_exposure_seconds", "Its exposure time.", |frame| frame.meta.exposure_s),
    ("frame_stars", "Stars and other sources in it.", |frame| frame.truth.len() as f64),
    ("frame_left_out_stars", "Stars left out of it for want of time or light.", |frame| {
        frame.meta.left_out_stars as f64
    }),
    ("frame_attitude_age_seconds", "Age of the newest attitude when it was planned.", |frame| {
        frame.meta.attitude_age.s()
    }),
    ("frame_horizon_seconds", "How far its attitude was predicted; negative when interpolated.", |frame| {
        frame.meta.horizon.s()
    }),
    ("boresight_right_ascension_degrees", "Right ascension of its boresight, ICRF.", |frame| frame.meta.ra_deg),
    ("boresight_declination_degrees", "Declination of its boresight, ICRF.", |frame| frame.meta.dec_deg),
    ("boresight_roll_degrees", "Position angle of its up direction, east of north.", |frame| frame.meta.roll_deg),
];

/// Adds the description of each head.
fn heads(out: &mut Text, heads: &[HeadParams]) {
    out.family("head_info", "gauge", "Name and camera of each head, as labels; always 1.");
    for (number, head) in heads.iter().enumerate() {
        let labels = [("head", &*number.to_string()), ("name", &*head.name), ("camera", &*head.camera)];
        out.labelled("head_info", &labels, 1);
    }
    out.family("readout_seconds", "gauge", "From the end of an exposure to its frame's deadline.");
    for (number, head) in heads.iter().enumerate() {
        out.labelled("readout_seconds", &[("head", &number.to_string())], head.readout_s);
    }
}

fn newest_frames(out: &mut Text, newest: &[Shown<'_>]) {
    for (name, help, value) in FRAME_GAUGES {
        out.family(name, "gauge", help);
        for (head, picture) in newest {
            out.labelled(name, &[("head", head)], value(&picture.frame));
        }
    }
    out.family("frames_shown_total", "counter", "Frames that the live view was given.");
    for (head, picture) in newest {
        out.labelled("frames_shown_total", &[("head", head)], picture.count);
    }
}

fn fault_flags(out: &mut Text, newest: &[Shown<'_>]) {
    out.family("frame_fault_active", "gauge", "1 when a commanded fault acts on the newest frame.");
    for (head, picture) in newest {
        for (flag, name) in FaultFlags::NAMED {
            let is_active = u8::from(picture.frame.meta.faults.contains(*flag));
            out.labelled("frame_fault_active", &[("head", head), ("fault", name)], is_active);
        }
    }
}

fn lateness(out: &mut Text, newest: &[Shown<'_>]) {
    let help = "Completion of frames minus their deadline; negative when early.";
    out.family("frame_lateness_seconds", "histogram", help);
    for (head, picture) in newest {
        let bins = &picture.lateness;
        let labels = [("head", head.as_str())];
        out.histogram("frame_lateness_seconds", &labels, bins.cumulative(), (bins.sum_s(), bins.total()));
    }
}

fn run(out: &mut Text, numbers: &RunNumbers) {
    let frames = &numbers.frames;
    let counts = [
        ("frames_scheduled", "Slots that came up.", frames.scheduled),
        ("frames_rendered", "Frames drawn.", frames.rendered),
        (
            "frames_delivered",
            "Frames handed to the sinks' queues; the run summary counts the frames that each sink took.",
            frames.delivered,
        ),
        ("frames_late", "Frames finished after their deadline.", frames.late),
        ("frames_held", "Frames repeated because the new one was not ready.", frames.held),
        ("frames_dropped", "Slots without a frame.", frames.dropped),
        ("frames_extrapolated", "Frames whose attitude was predicted beyond the newest sample.", frames.extrapolated),
        (
            "frames_partly_extrapolated",
            "Frames whose attitude was extrapolated at an end of the exposure only.",
            frames.partly_extrapolated,
        ),
        ("frames_jitter_missing", "Frames that lack jitter samples.", frames.jitter_missing),
        ("frames_blank", "Frames sent without a scene.", frames.blank),
    ];
    counters(out, counts);
    out.family("stage_duration_seconds", "histogram", "Wall time that frames spent in each stage.");
    for (stage, tally) in Stage::ALL.iter().zip(&numbers.stages).filter(|(_, tally)| tally.count() > 0) {
        let labels = [("stage", stage.name())];
        out.histogram("stage_duration_seconds", &labels, tally.cumulative(), (tally.sum_s(), tally.count()));
    }
    out.family("events_total", "counter", "Events of the ledger, by kind.");
    for (kind, count) in numbers.events.iter() {
        out.labelled("events_total", &[("kind", kind)], count);
    }
    ports(out, numbers);
}

fn ports(out: &mut Text, numbers: &RunNumbers) {
    let numbered = || numbers.ports().iter().enumerate().map(|(i, port)| (i.to_string(), port));
    out.single(
        "link_ports_left_out",
        "gauge",
        "Ports of the bus that are not reported here.",
        numbers.ports_left_out(),
    );
    out.family("link_total", "counter", "What each port of the bus counted, by counter.");
    for (port, counts) in numbered() {
        for (counter, count) in counts.counters.iter() {
            out.labelled("link_total", &[("port", &port), ("counter", counter)], count);
        }
    }
    out.family("link_rejects_total", "counter", "Messages that each port refused, by reason.");
    for (port, counts) in numbered() {
        for (reason, count) in counts.rejects.iter() {
            out.labelled("link_rejects_total", &[("port", &port), ("reason", reason)], count);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::view::tests::{board, board_of, params_of_three};
    use base::time::Span;
    use frames::report::{NamedCounts, PortCounts};
    use frames::sink::{Sink, sample::sample_frame};

    #[test]
    fn every_family_is_described_once_before_its_samples() {
        let (mut board, mut sink, numbers) = board();
        sink.send(&sample_frame(4)).unwrap();
        let mut run = RunNumbers::NONE;
        run.stages[Stage::Render as usize].record(Span::from_ms(7));
        run.events = [("late", 2)].into_iter().collect();
        let counts: NamedCounts = [("packets_received", 120)].into_iter().collect();
        run.push_port(PortCounts { counters: counts, rejects: NamedCounts::NONE });
        numbers.announce(&run);
        let text = metrics_of(&mut board);
        let mut families = Vec::new();
        for line in text.lines() {
            if let Some(rest) = line.strip_prefix("# TYPE ") {
                families.push(rest.split(' ').next().unwrap().to_owned());
            } else if !line.starts_with('#') {
                let name = line.split(['{', ' ']).next().unwrap();
                let of = families.last().unwrap();
                assert!(name.starts_with(of.as_str()), "{line} after {of}");
            }
        }
        let reported = families.len();
        families.sort();
        families.dedup();
        assert_eq!(families.len(), reported, "each once");
        for wanted in [
            "starloop_head_info{head=\"0\",name=\"head 0\",camera=\"test camera\"} 1",
            "starloop_readout_seconds{head=\"0\"} 0.08",
            "starloop_frame_number{head=\"0\"} 4",
            "starloop_link_total{port=\"0\",counter=\"packets_received\"} 120",
            "starloop_link_ports_left_out 0",
            "starloop_events_total{kind=\"late\"} 2",
            "starloop_stage_duration_seconds_bucket{stage=\"render\",le=\"0.005\"} 0",
            "starloop_stage_duration_seconds_bucket{stage=\"render\",le=\"0.01\"} 1",
            "starloop_stage_duration_seconds_bucket{stage=\"render\",le=\"+Inf\"} 1",
            "starloop_stage_duration_seconds_sum{stage=\"render\"} 0.007",
            "starloop_frame_fault_active{head=\"0\",fault=\"hot_pixels\"} 1",
            "starloop_frame_fault_active{head=\"0\",fault=\"blank\"} 0",
            "starloop_frame_lateness_seconds_count{head=\"0\"} 1",
        ] {
            assert!(text.lines().any(|line| line == wanted), "{wanted} is not in\n{text}");
        }
    }

    #[test]
    fn samples_of_every_head_that_has_a_frame_carry_its_number() {
        let (mut board, mut sinks, _numbers) = board_of(params_of_three());
        sinks[1].send(&sample_frame(4)).unwrap();
        (8..=9).for_each(|number| sinks[2].send(&sample_frame(number)).unwrap());
        let text = metrics_of(&mut board);
        for wanted in [
            "starloop_head_info{head=\"0\",name=\"head 0\",camera=\"test camera\"} 1",
            "starloop_head_info{head=\"2\",name=\"head 2\",camera=\"test camera 2\"} 1",
            "starloop_frame_number{head=\"1\"} 4",
            "starloop_frame_number{head=\"2\"} 9",
            "starloop_frames_shown_total{head=\"2\"} 2",
            "starloop_frame_lateness_seconds_bucket{head=\"1\",le=\"+Inf\"} 1",
        ] {
            assert!(text.lines().any(|line| line == wanted), "{wanted} is not in\n{text}");
        }
        assert!(!text.contains("starloop_frame_number{head=\"0\"}"), "control: head 0 has no frame");
        let headings = text.lines().filter(|line| line.starts_with("# TYPE starloop_frame_number ")).count();
        assert_eq!(headings, 1, "one family for all heads");
    }

    #[test]
    fn labels_are_escaped() {
        let mut out = Text { text: String::new() };
        out.labelled("x", &[("a", "b\"c\\d\ne"), ("f", "")], 1);
        assert_eq!(out.text, "starloop_x{a=\"b\\\"c\\\\d\\ne\",f=\"\"} 1\n");
    }
}
