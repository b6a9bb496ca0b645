//! The same numbers for Prometheus: text exposition format 0.0.4.
//!
//! Names begin with `starloop_` and end in their unit; counters end in `_total`. Each family has its HELP and TYPE once,
//! before its samples. Histograms are cumulative, with `+Inf`. `hil_scripts/test_live.py` reads it with Prometheus's own
//! parser; the forms of numbers and labels are tested below.

use crate::live::board::Board;
use crate::live::latest::Picture;
use core::fmt::{Display, Write};
use frames::report::{RunNumbers, Stage};
use frames::sink::FaultFlags;

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

    /// A sample without labels.
    fn sample(&mut self, name: &str, value: impl Display) {
        self.line(format_args!("starloop_{name} {value}"));
    }

    /// A sample with labels; their values are escaped.
    fn labelled(&mut self, name: &str, labels: &[(&str, &str)], value: impl Display) {
        let mut inside = String::new();
        for (i, (label, text)) in labels.iter().enumerate() {
            let _a_string_takes_all = write!(inside, "{}{label}=\"{}\"", if i == 0 { "" } else { "," }, escaped(text));
        }
        self.line(format_args!("starloop_{name}{{{inside}}} {value}"));
    }

    /// A family of one sample.
    fn single(&mut self, name: &str, kind: &str, help: &str, value: impl Display) {
        self.family(name, kind, help);
        self.sample(name, value);
    }

    /// The buckets of one histogram, its sum and its count.
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
            let name = format!("{name}_{part}");
            if labels.is_empty() { self.sample(&name, value) } else { self.labelled(&name, labels, value) }
        }
    }

    fn line(&mut self, line: core::fmt::Arguments<'_>) {
        let _a_string_takes_all = writeln!(self.text, "{line}");
    }
}

/// A label's value as the format has it.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

/// All metrics now.
pub(super) fn metrics_of(board: &mut Board) -> String {
    board.listen();
    let mut out = Text { text: String::with_capacity(64 * 1024) };
    out.family("build_info", "gauge", "Version of the program, as a label; always 1.");
    out.labelled("build_info", &[("version", env!("CARGO_PKG_VERSION"))], 1);
    let is_over = u8::from(board.is_over());
    out.single("run_over", "gauge", "1 when the run has ended and no frame comes any more.", is_over);
    out.single(
        "readout_seconds",
        "gauge",
        "From the end of an exposure to its frame's deadline.",
        board.params.readout_s,
    );
    if let Some(picture) = board.newest() {
        newest_frame(&mut out, picture);
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
        ("live_clients_refused", "Connections to the live view for which there was no seat.", served.clients_refused),
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

fn newest_frame(out: &mut Text, picture: &Picture) {
    let meta = &picture.frame.meta;
    let gauges = [
        ("frame_number", "Number of the newest frame.", f64::from(meta.number)),
        (
            "frame_mid_exposure_timestamp_seconds",
            "Unix time of the middle of its exposure.",
            meta.mid_exposure.unix_s(),
        ),
        ("frame_exposure_seconds", "Its exposure time.", meta.exposure_s),
        ("frame_stars", "Stars and other sources in it.", picture.frame.truth.len() as f64),
        ("frame_left_out_stars", "Stars left out of it for want of time or light.", meta.left_out_stars as f64),
        ("frame_attitude_age_seconds", "Age of the newest attitude when it was planned.", meta.attitude_age.s()),
        ("frame_horizon_seconds", "How far its attitude was predicted; negative when interpolated.", meta.horizon.s()),
        ("boresight_right_ascension_degrees", "Right ascension of its boresight, ICRF.", meta.ra_deg),
        ("boresight_declination_degrees", "Declination of its boresight, ICRF.", meta.dec_deg),
        ("boresight_roll_degrees", "Position angle of its up direction, east of north.", meta.roll_deg),
    ];
    for (name, help, value) in gauges {
        out.single(name, "gauge", help, value);
    }
    out.family("frame_fault_active", "gauge", "1 when a commanded fault acts on the newest frame.");
    for (flag, name) in FaultFlags::NAMED {
        out.labelled("frame_fault_active", &[("fault", name)], u8::from(meta.faults.contains(*flag)));
    }
    counters(out, [("frames_shown", "Frames that the live view was given.", picture.count)]);
    let lateness = &picture.lateness;
    out.family(
        "frame_lateness_seconds",
        "histogram",
        "Completion of frames minus their deadline; negative when early.",
    );
    out.histogram("frame_lateness_seconds", &[], lateness.cumulative(), (lateness.sum_s(), lateness.total()));
}

fn run(out: &mut Text, numbers: &RunNumbers) {
    let frames = &numbers.frames;
    let counts = [
        ("frames_scheduled", "Slots that came up.", frames.scheduled),
        ("frames_rendered", "Frames drawn.", frames.rendered),
        (
            "frames_delivered",
            "Frames handed to the sinks' queues; what each sink made of them is told when the run ends.",
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
        "Ports of the bus of which nothing is told here.",
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
    use crate::live::view::tests::board;
    use base::time::Span;
    use frames::report::{NamedCounts, PortCounts};
    use frames::sink::Sink;
    use frames::sink::sample::sample_frame;

    #[test]
    fn every_family_is_told_once_before_its_samples() {
        let (mut board, mut sink, numbers) = board();
        sink.send(&sample_frame(4)).unwrap();
        let mut run = RunNumbers::NONE;
        run.stages[Stage::Render as usize].record(Span::from_ms(7));
        run.events = [("late", 2)].into_iter().collect();
        let counts: NamedCounts = [("packets_received", 120)].into_iter().collect();
        run.push_port(PortCounts { counters: counts, rejects: NamedCounts::NONE });
        numbers.tell(&run);
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
        let told = families.len();
        families.sort();
        families.dedup();
        assert_eq!(families.len(), told, "each once");
        for wanted in [
            "starloop_frame_number 4",
            "starloop_link_total{port=\"0\",counter=\"packets_received\"} 120",
            "starloop_link_ports_left_out 0",
            "starloop_events_total{kind=\"late\"} 2",
            "starloop_stage_duration_seconds_bucket{stage=\"render\",le=\"0.005\"} 0",
            "starloop_stage_duration_seconds_bucket{stage=\"render\",le=\"0.01\"} 1",
            "starloop_stage_duration_seconds_bucket{stage=\"render\",le=\"+Inf\"} 1",
            "starloop_stage_duration_seconds_sum{stage=\"render\"} 0.007",
            "starloop_frame_fault_active{fault=\"hot_pixels\"} 1",
            "starloop_frame_fault_active{fault=\"blank\"} 0",
            "starloop_frame_lateness_seconds_count 1",
        ] {
            assert!(text.lines().any(|line| line == wanted), "{wanted} is not in\n{text}");
        }
    }

    #[test]
    fn labels_are_escaped() {
        let mut out = Text { text: String::new() };
        out.labelled("x", &[("a", "b\"c\\d\ne"), ("f", "")], 1);
        assert_eq!(out.text, "starloop_x{a=\"b\\\"c\\\\d\\ne\",f=\"\"} 1\n");
    }
}
