//! Results of a scenario: JSON for machines, a table for people.

use crate::cli::facts::Facts;
use config::Scenario;
use frames::report::{AnswerRow, FrameAccount, FrameCounts, Losses, Machine, RunVerdict, RunWord, SinkLine};
use run::runtime::note_lost_reader;
use run::wiring::assessment::{ModeLine, Verdict, WindowErrors};
use run::wiring::invariants::{Invariant, InvariantLine};
use run::wiring::run_end::{LoopView, RunEnd};
use run::wiring::{control::ControlRefusals, faults::FaultLine};
use serde::Serialize;

/// The report of one scenario run.
#[derive(Debug, Clone, Serialize)]
pub struct ScenarioReport {
    /// The verdict and its reasons.
    #[serde(flatten)]
    pub verdict: RunVerdict,
    /// Scenario.
    pub scenario: String,
    /// Seed.
    pub seed: u64,
    /// Machine.
    pub machine: Machine,
    /// Simulated time, s.
    pub simulated_s: f64,
    /// Wall time, s.
    pub wall_s: f64,
    /// Simulated hours per wall hour.
    pub speed: f64,
    /// CRC-32 over all frames of each head.
    pub frames_crc32: Vec<String>,
    /// CRC-32 over all telemetry.
    pub telemetry_crc32: String,
    /// Frame counts, all heads together.
    pub frames: FrameCounts,
    /// Frames by their ends.
    pub account: FrameAccount,
    /// Seconds from the first exposure to fine pointing.
    pub fine_after_s: Option<f64>,
    /// Pointing errors at the end.
    pub pointing: WindowErrors,
    /// Knowledge errors at the end.
    pub knowledge: WindowErrors,
    /// Boresight's rms error by linear theory, arcsec.
    pub predicted_pointing_arcsec: Option<f64>,
    /// Share of the telemetry with an attitude of a tracker.
    pub tracker_availability: f64,
    /// Attitudes that the estimator worked in.
    pub attitudes_used: u64,
    /// Attitudes that it refused: too far from what it expected.
    pub attitudes_gated: u64,
    /// Attitudes that came too late for the estimator, or ahead of it.
    pub attitudes_refused: u64,
    /// Frames that came without a time tag and were not used.
    pub frames_untagged: u64,
    /// Frames that went out too late to be compared with the truth.
    pub frames_unchecked: u64,
    /// How often it started from an attitude, the first time included.
    pub estimator_starts: u64,
    /// Frames compared with the true attitude.
    pub frames_held_to_truth: u64,
    /// Largest distance of such a frame's attitude from the truth, arcsec.
    pub largest_rendered_error_arcsec: f64,
    /// Smallest angle between the kept boresight and the Sun, deg.
    pub least_sun_angle_deg: Option<f64>,
    /// Largest micro-vibration, arcsec.
    pub largest_vibration_arcsec: Option<f64>,
    /// Largest wheel speed when it was largest, revolutions per second.
    pub wheel_speed_then_hz: Option<f64>,
    /// Mode changes (the first 256).
    pub modes: Vec<ModeLine>,
    /// Faults and what they hit.
    pub faults: Vec<FaultLine>,
    /// Commands that the flight computer refused.
    pub refusals: Vec<String>,
    /// Events of the stimulator, counted by name.
    pub events: std::collections::BTreeMap<String, u64>,
    /// Expectations.
    pub verdicts: Vec<Verdict>,
    /// Broken invariants.
    pub violations: u64,
    /// The first of them, in words.
    pub violation_lines: Vec<String>,
    /// Each invariant with its checks.
    pub invariants: Vec<InvariantLine>,
    /// The verdict is `ok`.
    pub passed: bool,
    /// Counters of each sink; empty before the end.
    pub sinks: Vec<SinkLine>,
    /// Losses of a run that reached its end; empty when the exit status is 0.
    pub losses: Losses,
    /// Answers of each star tracker outside; left out when there is none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub answers: Vec<AnswerRow>,
    /// Connections that the control socket refused, by reason; left out when there were none.
    #[serde(skip_serializing_if = "ControlRefusals::is_empty")]
    pub control_refusals: ControlRefusals,
}

impl ScenarioReport {
    /// Makes the report of a run, finished or in progress, with the connections that its control socket refused.
    pub fn of(scenario: &Scenario, outcome: &LoopView<'_>, wall_s: f64, refusals: Option<&ControlRefusals>) -> Self {
        let (record, assessment) = (outcome.record, outcome.assessment);
        let simulated_s = outcome.simulated_s;
        let flown = outcome.flown;
        let predicted = flown.predicted_pointing_arcsec();
        let verdicts = assessment.verdicts(predicted, record);
        let (violations, lines) = assessment.violations();
        let (frames_held_to_truth, largest_rendered_error_arcsec) = assessment.rendered();
        let mut losses = Losses::default();
        note_lost_reader(&mut losses, &record.ledger);
        let events =
            run::runtime::EventKind::ALL.iter().map(|kind| (kind.name().to_owned(), record.ledger.count(*kind)));
        Self {
            verdict: outcome.verdict.clone(),
            scenario: scenario.name.clone(),
            seed: scenario.bench.seed,
            machine: Machine::read(),
            simulated_s,
            wall_s,
            speed: simulated_s / wall_s.max(1e-9),
            frames_crc32: outcome.frames_crc32.iter().map(|crc32| format!("{crc32:08x}")).collect(),
            telemetry_crc32: format!("{:08x}", assessment.telemetry_crc32()),
            frames: FrameCounts { scheduled: outcome.account.scheduled(), ..record.frames },
            account: outcome.account,
            fine_after_s: assessment.fine_after_s(),
            pointing: assessment.pointing(),
            knowledge: assessment.knowledge(),
            predicted_pointing_arcsec: predicted,
            tracker_availability: assessment.tracker_availability(),
            attitudes_used: flown.estimator.used,
            attitudes_gated: flown.estimator.gated,
            attitudes_refused: flown.estimator.refused,
            frames_untagged: flown.untagged,
            frames_unchecked: assessment.frames_unchecked,
            estimator_starts: flown.estimator.starts,
            frames_held_to_truth,
            largest_rendered_error_arcsec,
            least_sun_angle_deg: assessment.least_sun_angle_rad.map(f64::to_degrees),
            largest_vibration_arcsec: assessment.vibration().map(|(arcsec, _)| arcsec),
            wheel_speed_then_hz: assessment.vibration().map(|(_, hz)| hz),
            modes: assessment.mode_lines.to_vec(),
            faults: outcome.faults.clone(),
            refusals: assessment.refusals().to_vec(),
            events: events.filter(|(_, count)| *count > 0).collect(),
            passed: outcome.verdict.word == RunWord::Ok,
            verdicts,
            violations,
            violation_lines: lines.to_vec(),
            invariants: assessment.invariants.results(&Invariant::OF_RUN),
            sinks: Vec::new(),
            losses,
            answers: Vec::new(),
            control_refusals: refusals.cloned().unwrap_or_default(),
        }
    }

    /// Returns the same of a run that has ended: what each sink and tracker did, and all that was lost.
    #[must_use]
    pub fn ended(self, end: &RunEnd) -> Self {
        Self { sinks: end.sink_lines.clone(), losses: end.losses.clone(), answers: end.answers.clone(), ..self }
    }
}

/// Returns the report for people; of a run without a spacecraft its faults and expectations only.
pub fn table(report: &ScenarioReport, details: bool, is_flown: bool) -> String {
    let mut lines = Facts::new("", 9);
    if is_flown {
        write_flight(&mut lines, report, details);
    }
    write_faults(&mut lines, report);
    write_verdicts(&mut lines, report);
    lines.text()
}

fn write_flight(lines: &mut Facts, report: &ScenarioReport, details: bool) {
    let frames = &report.frames;
    lines.fact("scenario", format_args!("{} (seed {})", report.scenario, report.seed));
    lines.named("time").line(format_args!(
        "{:.1} s simulated in {:.1} s: {:.1} simulated hours per hour",
        report.simulated_s, report.wall_s, report.speed
    ));
    lines.named("frames").line(format_args!(
        "{} scheduled, {} delivered, {} dropped, {} blank; CRC-32 {}, telemetry {}",
        frames.scheduled,
        frames.delivered,
        frames.dropped,
        frames.blank,
        report.frames_crc32.join(" "),
        report.telemetry_crc32
    ));
    lines.named("truth").line(format_args!(
        "{} frames held to the true attitude, at most {:.4} arcsec from it",
        report.frames_held_to_truth, report.largest_rendered_error_arcsec
    ));
    lines.named("tracker").line(format_args!(
        "attitude in {:.2} % of the telemetry; {} used, {} gated, {} without time tag, {} starts of the \
         estimator",
        100.0 * report.tracker_availability,
        report.attitudes_used,
        report.attitudes_gated,
        report.frames_untagged,
        report.estimator_starts
    ));
    for row in &report.answers {
        lines.fact("answers", format_args!("{}: {}", row.place, row.words()));
    }
    for (name, errors) in [("pointing", report.pointing), ("knowledge", report.knowledge)] {
        if let (Some(boresight), Some(roll), Some(largest)) =
            (errors.boresight_arcsec, errors.roll_arcsec, errors.largest_boresight_arcsec)
        {
            lines.named(name).line(format_args!(
                "boresight {boresight:.3} arcsec rms (largest {largest:.3}), roll {roll:.3} arcsec rms"
            ));
        }
    }
    if !details {
        return;
    }
    if let Some(predicted) = report.predicted_pointing_arcsec {
        lines.fact("predicted", format_args!("boresight {predicted:.3} arcsec rms by linear theory"));
    }
    if let Some(angle) = report.least_sun_angle_deg {
        lines.fact("Sun", format_args!("never nearer than {angle:.2} deg to the kept boresight"));
    }
    if let (Some(arcsec), Some(hz)) = (report.largest_vibration_arcsec, report.wheel_speed_then_hz) {
        lines
            .named("vibration")
            .line(format_args!("at most {arcsec:.3} arcsec, with a wheel at {hz:.2} revolutions per second"));
    }
    for mode in report.modes.iter().take(20) {
        lines.named("mode").line(format_args!("{:9.1} s  {} -> {} ({})", mode.t_s, mode.from, mode.to, mode.cause));
    }
}

fn write_faults(lines: &mut Facts, report: &ScenarioReport) {
    for fault in report.faults.iter().take(40) {
        if fault.from_s.is_infinite() {
            lines.fact("fault", format_args!("not triggered           {}", fault.name));
            continue;
        }
        lines.named("fault").line(format_args!(
            "{:9.1} s .. {:9.1} s  {}: {} hit",
            fault.from_s, fault.until_s, fault.name, fault.hits
        ));
    }
    for sink in report.sinks.iter().filter(|sink| sink.dropped + sink.refused > 0 || report.sinks.len() > 1) {
        let SinkLine { place, kind, frames, dropped, refused, first_error, .. } = sink;
        let error = first_error.as_ref().map(|error| format!("; first failure: {error}")).unwrap_or_default();
        lines
            .named("sink")
            .line(format_args!("{place} ({kind}): {frames} taken, {dropped} dropped, {refused} refused{error}"));
    }
    for refusal in &report.refusals {
        lines.fact("refused", refusal);
    }
    for (reason, count) in &report.control_refusals {
        lines.fact("control", format_args!("{count} connections refused: {reason}"));
    }
}

/// Writes what was expected, what broke, and the last line.
fn write_verdicts(lines: &mut Facts, report: &ScenarioReport) {
    for verdict in &report.verdicts {
        let mark = if verdict.passed { "ok" } else { "FAILED" };
        lines.named(mark).line(format_args!("{}: wanted {}, got {}", verdict.name, verdict.wanted, verdict.got));
    }
    for line in &report.violation_lines {
        lines.fact("BROKEN", line);
    }
    let held = if report.violations == 0 { "all held".into() } else { format!("{} violations", report.violations) };
    lines.line(format_args!("invariants: {held}"));
}
