//! `starloop check`, attitude and jitter.
//!
//! `starloop check`, attitude: how wrong the attitude at mid-exposure may be, by each method that could make it.
//!
//! Input: a bench and the run that was made of it, which may be drawn ahead of its light. Output: text. The motion is
//! that of the simulated flight computer: its slew (versine ramps), or that of its file (by differences of rows), is
//! what the records carry; its jitter is never part of them, and is judged by how it travels. Left out: waiting for
//! other messages on the bus (a record takes its own time on an idle wire).

use crate::cli::facts::Facts;
use base::time::Span;
use base::units::{ARCSEC, DEG};
use config::{Bench, JitterAxes, JitterFile, JitterInput, JitterSource};
use core::f64::consts::TAU;
use firmware_protocol::{MessageId, can::CanFrame};
use glam::DVec3;
use link::{CHUNK_MAX, Datagram, Packet, SerialChunk, WireFormat};
use plan::attitude::{
    AttitudeAssessment, AttitudeMethod, AttitudeVerdict, JitterRecord, MotionScale, PredictionErrors, Reach, RecordEnd,
    Sinusoid, assess_methods, band_power_rad2, cheapest, psd_variance, smear_power_rad2,
};
use run::{runtime::RunParams, wiring::bench_parts};

/// Four f32 of up to 1 are each wrong by up to 2^-25; an attitude turns by twice the error of its quaternion.
const WIRE_QUATERNION_RAD: f64 = 4.0 / 33_554_432.0;
/// Half of 1 urad/s per axis: the rate in a classic attitude group.
const CLASSIC_RATE_ERROR_RAD_S: f64 = 0.87e-6;
/// Time tags are whole microseconds, rounded down.
const TAG_S: f64 = 1e-6;
/// Time correlation at ten marks a second, 99 % (`tests/physics/time_correlation.rs`).
const CORRELATION_S: f64 = 2e-6;
/// Frames of a classic attitude group.
const CLASSIC_GROUP: i64 = 5;

/// Everything the table is made from.
struct Situation {
    motion: MotionScale,
    reach: Reach,
    record_period_s: f64,
    arrival_s: f64,
    /// From mid-exposure to the moment a frame's drawing begins; less than 0: it is drawn ahead.
    wait_s: f64,
}

/// Writes the section about attitude.
pub(super) fn write_attitude(facts: &mut Facts, bench: &Bench, params: &RunParams, motion: MotionScale) {
    let situation = Situation::of(bench, params, motion);
    let Situation { motion, reach, .. } = &situation;
    let (total_rad, records_rad) = (bench.accuracy.los_arcsec * ARCSEC, record_error_rad(bench, &situation));
    let left_rad = total_rad - records_rad;
    write_situation(facts, &situation);
    let [records, left] = [records_rad, left_rad].map(|rad| rad / ARCSEC);
    let (total, is_left) = (bench.accuracy.los_arcsec, left_rad > 0.0);
    let left = if is_left { format!("{left:.4}") } else { "none".to_owned() };
    facts.named("records").line(format_args!(
        "wrong by up to {records:.4} arcsec (wire format, time tags): {left} of {total} arcsec are left for the method"
    ));
    if !is_left {
        facts.warning(format_args!(
            "the attitude records alone are wrong by up to {records:.4} arcsec, more than accuracy.los_arcsec = {total}"
        ));
    }
    facts.line("  method                 bound arcsec  verdict");
    let assessed = assess_methods(left_rad, motion, *reach);
    for assessment in &assessed {
        let mark = if assessment.method == situation.used(bench) { '>' } else { ' ' };
        facts.line(format_args!("{mark} {}", assessment_line(assessment)));
    }
    let enough = cheapest(&assessed).map_or("none fits", AttitudeMethod::name);
    facts.line(format_args!("  (> is what a run does; the least demanding that fits: {enough})"));
    write_scripted_jitter(facts, bench, &situation);
    write_limits(facts, bench, &situation);
    facts.line("");
}

impl Situation {
    fn of(bench: &Bench, params: &RunParams, motion: MotionScale) -> Self {
        let record_period_s = 1.0 / bench.flight_computer.attitude_hz;
        let arrival_s = bench.link.latency_us * 1e-6 + record_on_wire(bench).s();
        let wait_s = 0.5 * params.camera.exposure_s - params.ahead.s();
        let is_next_there = record_period_s + arrival_s <= wait_s;
        let reach = if is_next_there {
            Reach { horizon_s: record_period_s, spacing_s: Some(record_period_s) }
        } else {
            Reach { horizon_s: record_period_s + arrival_s - wait_s, spacing_s: None }
        };
        Self { motion, reach, record_period_s, arrival_s, wait_s }
    }

    /// Returns the time from the newest sample of jitter to mid-exposure.
    fn jitter_held_s(&self, bench: &Bench) -> f64 {
        let samples = if bench.link.wire == WireFormat::CanClassic { 2.0 } else { f64::from(BURST_SAMPLES) };
        (samples * jitter_sample_s(bench) + self.arrival_s - self.wait_s).max(0.0)
    }

    /// Returns the method of the frame engine in this situation.
    fn used(&self, bench: &Bench) -> AttitudeMethod {
        match self.reach.spacing_s {
            Some(_) => AttitudeMethod::Interpolation,
            None if self.reach.horizon_s <= bench.attitude.estimate.max_horizon.s() => {
                AttitudeMethod::ConstantAcceleration
            }
            None => AttitudeMethod::ConstantRate,
        }
    }
}

/// Returns the time of one attitude record on an idle wire, no longer than this.
fn record_on_wire(bench: &Bench) -> Span {
    let (timing, frames) =
        (bench_parts::bus(bench).0.timing, if bench.link.wire == WireFormat::CanClassic { CLASSIC_GROUP } else { 1 });
    let id = bench.link.ids.id(MessageId::Attitude);
    let packet = match bench.link.wire {
        WireFormat::CanClassic => CanFrame::classic(id, &[0; 8]).map(Packet::Can),
        WireFormat::CanFd => CanFrame::fd(id, &[0; 64]).map(Packet::Can),
        WireFormat::Serial => SerialChunk::new(&[0; CHUNK_MAX]).map(Packet::Serial),
        WireFormat::Plain => Datagram::new(&[0; 64]).map(Packet::Datagram),
    };
    let one = packet.and_then(|packet| timing.duration(&packet)).unwrap_or(Span::ZERO);
    Span::from_ns(one.ns().saturating_mul(frames))
}

/// Returns the error of the records themselves.
fn record_error_rad(bench: &Bench, situation: &Situation) -> f64 {
    let errors = PredictionErrors {
        rate_error_rad_s: if bench.link.wire == WireFormat::CanClassic { CLASSIC_RATE_ERROR_RAD_S } else { 0.0 },
        clock_error_s: TAG_S + CORRELATION_S,
        ..Default::default()
    };
    let rate = DVec3::X * situation.motion.rate_rad_s;
    WIRE_QUATERNION_RAD + errors.bound_rad(rate, DVec3::ZERO, situation.reach.horizon_s)
}

fn write_situation(facts: &mut Facts, situation: &Situation) {
    let Situation { motion, reach, record_period_s, arrival_s, wait_s } = situation;
    facts.line("attitude at mid-exposure");
    facts.named("samples").line(format_args!(
        "every {:.1} ms, {:.2} ms to arrive; drawing begins {:.1} ms {} mid-exposure",
        record_period_s * 1e3,
        arrival_s * 1e3,
        wait_s.abs() * 1e3,
        if *wait_s < 0.0 { "before" } else { "after" }
    ));
    match reach.spacing_s {
        Some(_) => facts.more("so the samples on both sides are there"),
        None => facts.more(format_args!("so it is predicted by up to {:.1} ms", reach.horizon_s * 1e3)),
    }
    let [w, a, j] = [motion.rate_rad_s, motion.acceleration_rad_s2, motion.jerk_rad_s3].map(|v| v / DEG);
    facts.fact("motion", format_args!("at most {w:.3} deg/s, {a:.3} deg/s^2, {j:.3} deg/s^3"));
}

/// Horizons beyond what the bench allows, which a run notes frame by frame.
fn write_limits(facts: &mut Facts, bench: &Bench, situation: &Situation) {
    let (horizon_ms, limits) = (situation.reach.horizon_s * 1e3, &bench.attitude.estimate);
    if situation.reach.spacing_s.is_none() && horizon_ms > limits.stale_after.ms() {
        facts.warning(format_args!(
            "{horizon_ms:.1} ms are beyond attitude.stale_after_ms = {}: frames will be missing, held or blank, by \
             attitude.stale_policy",
            limits.stale_after.ms()
        ));
    } else if situation.reach.spacing_s.is_none() && horizon_ms > limits.max_horizon.ms() {
        facts.warning(format_args!(
            "{horizon_ms:.1} ms are beyond attitude.max_horizon_ms = {}: the acceleration is left out, and no bound \
             is known",
            limits.max_horizon.ms()
        ));
    }
    let is_sampled = bench.flight_computer.jitter_source == JitterSource::Samples;
    let (gap_ms, most_ms) = (situation.jitter_held_s(bench) * 1e3, bench.attitude.jitter_max_gap.ms());
    if is_sampled && gap_ms > most_ms {
        facts.warning(format_args!(
            "jitter would be held over {gap_ms:.1} ms, and is left out beyond {most_ms} ms: frames are begun too far \
             ahead for sampled jitter"
        ));
    }
}

fn assessment_line(assessment: &AttitudeAssessment) -> String {
    let (method, bound_arcsec) = (assessment.method, assessment.bound_rad / ARCSEC);
    let verdict = match assessment.verdict {
        AttitudeVerdict::Fits => "fits".to_owned(),
        AttitudeVerdict::OverBudget { times } if times <= 0.0 => "refused: nothing is left of the budget".to_owned(),
        AttitudeVerdict::OverBudget { times } => format!("refused: {times:.1} times what is left of the budget"),
        AttitudeVerdict::NeedsLaterSample => "refused: the next sample comes too late".to_owned(),
        AttitudeVerdict::FasterThanSamples { frequency_hz } => {
            format!("refused: {frequency_hz} Hz is above half the sample rate")
        }
        AttitudeVerdict::TurnsTooFar => "refused: more than a radian between samples".to_owned(),
    };
    let is_in_domain = matches!(assessment.verdict, AttitudeVerdict::Fits | AttitudeVerdict::OverBudget { .. });
    let bound = if is_in_domain { format!("{bound_arcsec:.2e}") } else { "-".to_owned() };
    format!("{method:<22} {bound:>12}  {verdict}")
}

/// Returns the jitter by the way it travels, and what the methods would make of it if it were part of the records.
fn write_scripted_jitter(facts: &mut Facts, bench: &Bench, situation: &Situation) {
    let lines: Vec<Sinusoid> = bench.flight_computer.known_lines().map(|line| sinusoid(&line)).collect();
    if lines.is_empty() {
        return;
    }
    match bench.flight_computer.jitter_source {
        JitterSource::Lines => facts.fact("jitter", "known as lines at both ends: not predicted, no error here"),
        JitterSource::Samples => write_sampled_jitter(facts, bench, situation, &lines),
    }
    let within = MotionScale { sinusoids: lines, ..situation.motion.clone() };
    facts.line("  were it part of the attitude records instead:");
    for assessment in assess_methods(bench.accuracy.los_arcsec * ARCSEC, &within, situation.reach) {
        facts.line(format_args!("  {}", assessment_line(&assessment)));
    }
}

fn sinusoid(line: &plan::attitude::JitterLine) -> Sinusoid {
    Sinusoid { frequency_hz: line.frequency_hz, amplitude_rad: line.amplitude_rad.length() }
}

/// Returns the straight lines between samples miss a sinusoid by `A (w dt)^2 / 8`, and by twice its amplitude at most;
/// what has not arrived is held.
fn write_sampled_jitter(facts: &mut Facts, bench: &Bench, situation: &Situation, lines: &[Sinusoid]) {
    let sample_s = jitter_sample_s(bench);
    let chord = |line: &Sinusoid| line.amplitude_rad * ((TAU * line.frequency_hz * sample_s).powi(2) / 8.0).min(2.0);
    let chords_rad: f64 = lines.iter().map(chord).sum();
    let held_s = situation.jitter_held_s(bench);
    let jitter = MotionScale { sinusoids: lines.to_vec(), ..MotionScale::default() };
    let held_rad = AttitudeMethod::Hold.bound_rad(&jitter, held_s);
    facts.named("jitter").line(format_args!(
        "samples every {:.2} ms: {:.4} arcsec between them, {:.4} arcsec held over {:.1} ms",
        sample_s * 1e3,
        chords_rad / ARCSEC,
        held_rad / ARCSEC,
        held_s * 1e3
    ));
}

fn jitter_sample_s(bench: &Bench) -> f64 {
    if bench.link.wire == WireFormat::CanClassic { 1e-3 } else { 1.0 / bench.flight_computer.jitter_sample_hz }
}

/// Samples in one burst on CAN FD and serial.
const BURST_SAMPLES: u32 = 14;

// `starloop check`, jitter from a file: its power in bands, and what it does to images.

/// Writes the section about jitter from a file; nothing without any.
pub(super) fn write_jitter(facts: &mut Facts, bench: &Bench, params: &RunParams) {
    let (Some(input), Some(recorded)) = (&bench.jitter, &params.attitude.jitter_record) else { return };
    write_source(facts, bench, input, &recorded.record);
    let (frame_hz, exposure_s) = (1.0 / params.frame_period.s(), params.camera.exposure_s);
    let exposure_hz = 1.0 / exposure_s;
    let spectrum = recorded.record.spectrum();
    let total = band_power_rad2(&spectrum, [0.0, f64::INFINITY]);
    let smear = smear_power_rad2(&spectrum, exposure_s);
    facts.line("  rms about            x arcsec    y arcsec    z arcsec");
    let edges = [0.0, frame_hz, exposure_hz.max(frame_hz), f64::INFINITY];
    let names = [
        format!("below {frame_hz} Hz"),
        format!("{frame_hz} to {:.4} Hz", edges[2]),
        format!("above {:.4} Hz", edges[2]),
    ];
    for (name, band) in names.iter().zip(edges.windows(2)) {
        write_row(facts, name, band_power_rad2(&spectrum, [band[0], band[1]]));
    }
    write_row(facts, "all", total);
    write_row(facts, "moves images", (total - smear).max(DVec3::ZERO));
    write_row(facts, "smears images", smear);
    facts.line(format_args!(
        "  (bands: frame rate and 1/exposure; smear: within one exposure of {exposure_s} s, in the mean)"
    ));
    facts.line("");
}

fn write_source(facts: &mut Facts, bench: &Bench, input: &JitterInput, record: &JitterRecord) {
    let JitterInput { path, source, axes, start_s } = input;
    let (axes, rate_hz) = (if *axes == JitterAxes::Sensor { "sensor" } else { "body" }, 1.0 / record.period_s());
    facts.line(format_args!(
        "jitter from {path}, {axes} axes; it is added where frames are made, and travels over no bus"
    ));
    match source {
        JitterFile::Density { points, .. } => {
            let rms = root(psd_variance(points)).map(|value| format!("{value:.4}")).join(", ");
            facts.fact("density", format_args!("{} rows, {rms} arcsec rms about x, y, z", points.len()));
            facts.fact(
                "series",
                format_args!(
                    "made by seed {}: {rate_hz:.1} Hz, repeats every {:.1} s",
                    bench.seed,
                    record.duration_s()
                ),
            )
        }
        JitterFile::Series(_) => {
            let end = if record.end() == RecordEnd::Repeat { "then it repeats" } else { "then nothing" };
            facts.fact(
                "series",
                format_args!(
                    "{} samples at {rate_hz:.1} Hz from {start_s} s after the first exposure, {:.3} s long, {end}",
                    record.samples().len(),
                    record.duration_s()
                ),
            )
        }
    }
}

fn write_row(facts: &mut Facts, name: &str, power_rad2: DVec3) {
    let [x, y, z] = root(power_rad2);
    facts.line(format_args!("  {name:<18} {x:>10.4}  {y:>10.4}  {z:>10.4}"));
}

fn root(power_rad2: DVec3) -> [f64; 3] {
    power_rad2.to_array().map(|power| power.max(0.0).sqrt() / ARCSEC)
}

#[cfg(test)]
mod attitude_tests {
    use super::*;
    use base::time::Tai;
    use run::wiring::bench_parts::script_scale;

    fn report(bench: &Bench) -> String {
        report_drawn_ahead(bench, 0)
    }

    fn report_drawn_ahead(bench: &Bench, ahead_ms: i64) -> String {
        let mut params = bench_parts::run_params(bench, Tai::from_ns(0)).unwrap();
        params.ahead = Span::from_ms(ahead_ms);
        let mut facts = Facts::indented();
        write_attitude(&mut facts, bench, &params, script_scale(bench));
        facts.text()
    }

    fn line<'a>(text: &'a str, start: &str) -> &'a str {
        text.lines().find(|line| line.starts_with(start)).unwrap_or_else(|| panic!("no \"{start}\" in\n{text}"))
    }

    #[test]
    fn the_built_in_bench_interpolates_within_its_budget() {
        let text = report(&Bench::built_in().unwrap());
        assert!(line(&text, "> interpolation").ends_with("fits"), "{text}");
        assert!(line(&text, "  hold").contains("refused"), "{text}");
        assert!(text.contains("known as lines at both ends"), "{text}");
        assert!(text.contains("53 Hz is above half the sample rate"), "{text}");
    }

    #[test]
    fn a_short_exposure_is_predicted_and_a_long_horizon_refused() {
        let mut bench = Bench::built_in().unwrap();
        bench.camera.exposure.exposure_s = 0.01;
        let text = report(&bench);
        assert!(line(&text, "> constant-acceleration").ends_with("fits"), "{text}");
        assert!(line(&text, "  interpolation").contains("comes too late"), "{text}");
        bench.flight_computer.attitude_hz = 1.0;
        let text = report(&bench);
        assert!(line(&text, "> constant-rate").contains("refused"), "{text}");
        assert!(text.contains("none fits"), "{text}");
    }

    #[test]
    fn frames_that_are_drawn_ahead_are_predicted_so_much_further() {
        let mut bench = Bench::built_in().unwrap();
        let (half_ms, period_ms) = (500.0 * bench.camera.exposure.exposure_s, 1e3 / bench.flight_computer.attitude_hz);
        let text = report_drawn_ahead(&bench, 120);
        assert!(line(&text, "> constant-acceleration").contains("fits") && !text.contains("WARNING"), "{text}");
        let horizon_ms = 120.0 - half_ms + period_ms;
        // Samples take a fraction of a millisecond to arrive.
        let reported =
            (0..10).any(|tenth| text.contains(&format!("by up to {:.1} ms", horizon_ms + 0.1 * f64::from(tenth))));
        assert!(reported && text.contains("before mid-exposure"), "{horizon_ms}: {text}");
        bench.flight_computer.jitter_source = JitterSource::Samples;
        for (ahead_ms, parts) in [
            (210.0 + half_ms, ["max_horizon_ms = 200", "jitter would be held"]),
            (510.0 + half_ms, ["stale_after_ms = 500", "beyond 100 ms"]),
        ] {
            let text = report_drawn_ahead(&bench, ahead_ms as i64);
            assert!(parts.iter().all(|part| text.contains(part)), "{ahead_ms}: {text}");
        }
    }

    #[test]
    fn jitter_as_samples_has_errors_of_its_own() {
        let mut bench = Bench::built_in().unwrap();
        bench.flight_computer.jitter_source = JitterSource::Samples;
        assert!(report(&bench).contains("samples every 1.00 ms"), "{}", report(&bench));
        bench.flight_computer.jitter_lines.clear();
        assert!(!report(&bench).contains("jitter"), "nothing to say without any");
    }
}

#[cfg(test)]
mod jitter_tests {
    use super::*;
    use base::time::Tai;
    use config::Document;
    use run::wiring::bench_parts;

    fn report(rows: &str, keys: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("j.csv"), rows).unwrap();
        let document = Document::from_text(&format!("[jitter]\n{keys}"), &folder.path().join("lab.toml"));
        let bench = Bench::from_document(&document).unwrap();
        let params = bench_parts::run_params(&bench, Tai::from_ns(0)).unwrap();
        let mut facts = Facts::indented();
        write_jitter(&mut facts, &bench, &params);
        facts.text()
    }

    fn numbers(text: &str, row: &str) -> Vec<f64> {
        let line =
            text.lines().find(|line| line.trim_start().starts_with(row)).unwrap_or_else(|| panic!("{row}: {text}"));
        line[20..].split_whitespace().map(|word| word.parse().unwrap()).collect()
    }

    #[test]
    fn a_tone_is_in_its_band() {
        let row = |i: i32| {
            let t_s = f64::from(i) * 1e-3;
            format!("{t_s:.3},{:.6},0\n", 2.0 * (TAU * 123.4 * t_s).sin())
        };
        let rows = (0..20_000).map(row).fold("t_s,x_arcsec,y_arcsec\n".to_owned(), |text, row| text + &row);
        let text = report(&rows, "series = \"j.csv\"\nat_end = \"repeat\"\n");
        let [below, above, smears] = ["below", "above", "smears images"].map(|row| numbers(&text, row)[0]);
        assert!(
            below < 0.01 && (above - 2.0_f64.sqrt()).abs() < 0.01 && (smears - 2.0_f64.sqrt()).abs() < 0.05,
            "{text}"
        );
        assert!(text.contains("then it repeats") && text.contains("20000 samples"), "{text}");
    }

    #[test]
    fn a_density_has_its_integral() {
        let text = report("f_hz,y_arcsec2_hz\n1,0.5\n201,0.5\n", "density = \"j.csv\"\n");
        assert!((numbers(&text, "all")[1] - 10.0).abs() < 0.01 && text.contains("10.0000"), "{text}");
    }
}
