//! Compares the promise of a bench with its run: the verdict.
//!
//! In: the scenario before the run, record and losses after it. Out: every promised frame counted once
//! ([`FrameAccount`]), and one word with its reasons ([`RunVerdict`]). The same on both clocks and in a run's replay.
//! Tests: `tests/closed_loop/verdicts.rs`, `hil_scripts/tests/test_broken_benches.py`.

use crate::runtime::record::{Missing, missing};
use crate::runtime::{EventKind, Head, PortReading, RunRecord};
use crate::runtime::{exposing::Exposing, receiver::Receiver};
use base::time::Tai;
use config::{Bench, Carrier, Link, Scenario, SessionStart};
use frames::report::{FrameAccount, FrameEnd, Losses, Reason, RunLimits, RunVerdict, RunWord};
use link::{WireFormat, gateway::GatewayParams};

/// How a run ended before its last frame, other than by an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CutShort {
    /// A signal stopped it.
    Interrupted,
    /// Its client asked it to finish: frames that were still to come are missing as commanded.
    Finished,
    /// The plant that drives its clock went away.
    PlantGone,
    /// Its client went away.
    ClientGone,
}

/// Promise of a bench.
#[derive(Debug, Clone)]
pub struct Promise {
    /// Promised frames of each head; `None` where triggers decide.
    frames: Vec<Option<u64>>,
    /// Names of the links, in the order of the ports.
    links: Vec<String>,
    /// Attitudes come from outside over the link.
    is_external: bool,
    /// Frames show stars only after a RUN.
    starts_on_run: bool,
    /// Advice for a link on which nothing arrives.
    advice: &'static str,
}

impl Promise {
    /// Returns the promise of a scenario with these heads.
    pub(super) fn of(scenario: &Scenario, heads: &[Head]) -> Self {
        let bench = &scenario.bench;
        let frames = heads.iter().enumerate().map(|(number, head)| {
            let is_triggered =
                bench.trigger_lines.iter().any(|line| line.is_armed && line.head.is_none_or(|of| of == number));
            (!is_triggered).then(|| head.engine.exposing.own_exposures())
        });
        let links = core::iter::once(&bench.link).chain(&bench.extra_links);
        Self {
            frames: frames.collect(),
            links: links.map(link_name).collect(),
            is_external: bench.flight_computer.is_external,
            starts_on_run: bench.session.start == SessionStart::OnRun,
            advice: advice(bench),
        }
    }

    /// Returns the links over TCP to which tries to connect failed: words with address and tries, and the port.
    pub(super) fn failed_tries<'a>(&self, ports: &'a [PortReading]) -> impl Iterator<Item = (String, &'a PortReading)> {
        let tried = self.links.iter().zip(ports);
        tried.filter_map(|(name, port)| Some((format!("{name} {}", port.failed_tries()?), port)))
    }

    /// Returns the end of every frame: those that the bench promised and that never came up are added.
    pub(super) fn account(&self, record: &RunRecord, cut_short: Option<CutShort>) -> FrameAccount {
        let mut account = record.account;
        let triggers_missed = record.ledger.count(EventKind::CameraTriggerMissed);
        let missing = match self.frames.iter().copied().collect::<Option<Vec<u64>>>() {
            Some(promised) => promised.iter().sum::<u64>().saturating_sub(account.scheduled()),
            None => triggers_missed,
        };
        let end = if cut_short == Some(CutShort::Finished) { FrameEnd::Commanded } else { FrameEnd::NotExposed };
        account.add_many(end, missing);
        account
    }
}

/// Returns the limits within which a run is `ok`.
pub(super) fn limits(scenario: &Scenario) -> RunLimits {
    // Random faults are commanded, and so is what they cost.
    if scenario.expect.allows_refusals {
        return RunLimits::ANYTHING;
    }
    // Frames that the timing budget lets be missed may be late, or dropped because they were.
    let missed = Some(scenario.bench.budget.missed_frames).filter(|missed| *missed > 0);
    let stated = scenario.expect.frames.limits;
    RunLimits { late: stated.late.or(missed), dropped: stated.dropped.or(missed), ..stated }
}

/// Returns the name of a link, for people.
fn link_name(link: &Link) -> String {
    match &link.carrier {
        Carrier::Simulated(_) => "the simulated bus".into(),
        Carrier::SocketCan { interface } => interface.clone(),
        Carrier::SerialPort { port, .. } => port.path.display().to_string(),
        Carrier::Udp { listen } => format!("udp {listen}"),
        Carrier::Tcp { address, .. } => format!("tcp {address}"),
    }
}

/// Advice for an address over TCP that no program answers at.
const LISTENS: &str = "check that a program listens there, and takes one more client";

/// Returns what to check where nothing arrives over a link.
fn advice(bench: &Bench) -> &'static str {
    match (&bench.link.wire, &bench.link.carrier) {
        (WireFormat::Plain, _) if bench.link.is_of_42() => {
            "check that 42 sends to this address, that spacecraft_number is a spacecraft of its SC[n] lines, and encoding"
        }
        (WireFormat::Plain, _) => {
            "check that the other end sends to this address, and encoding, order of values and sender of both ends"
        }
        (WireFormat::Serial, _) => "check that the other end sends, and baud rate, parity and node of both ends",
        (WireFormat::CanFd | WireFormat::CanClassic, Carrier::Simulated(ports))
            if *ports == GatewayParams::default() =>
        {
            "send samples over the control socket, or name a link of the machine"
        }
        (WireFormat::CanFd | WireFormat::CanClassic, _) => {
            "check that the other end sends, and node, id_bits, id_base, wire and bit rate of both ends"
        }
    }
}

/// Inputs of a verdict beside the promise.
pub(super) struct Facts<'a> {
    pub(super) record: &'a RunRecord,
    pub(super) heads: &'a [Head],
    pub(super) receiver: &'a Receiver,
    pub(super) ports: &'a [PortReading],
    pub(super) losses: &'a Losses,
    pub(super) zero: Tai,
    pub(super) cut_short: Option<CutShort>,
    /// Why an error ended the run, or which expectation is not met.
    pub(super) failure: Option<String>,
}

/// Returns the verdict on a run.
pub(super) fn verdict(promise: &Promise, facts: &Facts<'_>) -> RunVerdict {
    let account = promise.account(facts.record, facts.cut_short);
    let cause = |end| cause(end, promise, facts);
    let mut verdict = RunVerdict::of_frames(&account, &facts.record.limits, facts.zero, &cause);
    add_silence(&mut verdict, promise, facts);
    add_links(&mut verdict, promise, facts);
    for Missing { kind, word, words, key, limit } in missing(&facts.record.limits) {
        let (count, limit) = (facts.record.ledger.count(kind), limit.unwrap_or(0));
        let text = format!("{count} {words}");
        if count > u64::from(limit) {
            verdict.add(Reason { word, kind: kind.name(), count, text });
        } else if count > 0 {
            verdict.use_limit(&text, key, limit);
        }
    }
    for line in facts.losses.lines() {
        let text = format!("{}: {}", line.name, line.detail);
        verdict.add(Reason { word: RunWord::Lost, kind: line.part.name(), count: line.count, text });
    }
    match facts.cut_short {
        Some(CutShort::Interrupted) => {
            let text = "stopped before its end".into();
            verdict.add(Reason { word: RunWord::Incomplete, kind: "interrupted", count: 1, text });
        }
        Some(CutShort::PlantGone) => {
            let text = "the plant went away before the end".into();
            verdict.add(Reason { word: RunWord::Incomplete, kind: "plant_gone", count: 1, text });
        }
        Some(CutShort::ClientGone) => {
            let text = "the control client went away".into();
            verdict.add(Reason { word: RunWord::Failed, kind: "client_gone", count: 1, text });
        }
        Some(CutShort::Finished) | None => {}
    }
    if let Some(failure) = &facts.failure {
        verdict.add(Reason { word: RunWord::Failed, kind: "failed", count: 1, text: failure.clone() });
    }
    verdict
}

/// A run without a single attitude from outside is never `ok`, whatever its limits; nor is one whose link never connected.
fn add_silence(verdict: &mut RunVerdict, promise: &Promise, facts: &Facts<'_>) {
    let accepted = facts.receiver.attitudes.history.counts().accepted;
    let was_due = facts.record.account.scheduled() > 0;
    if promise.is_external && accepted == 0 && was_due {
        let refused: u64 = facts.ports.iter().map(PortReading::refused_messages).sum();
        let unreached = promise.failed_tries(facts.ports).find(|(_, port)| port.is_unreached());
        let text = if let Some((failed, _)) = unreached {
            format!("no attitude arrived: {failed}: {LISTENS}")
        } else if refused > 0 {
            let first = facts.ports.iter().find_map(|port| port.first_refused);
            let first = first.map_or_else(String::new, |first| format!(", the first is {first}"));
            format!("no attitude was accepted: {refused} messages were refused{first}: {}", promise.advice)
        } else {
            let others: u64 = facts.ports.iter().map(PortReading::of_other_nodes).sum();
            let others = if others > 0 { format!(", only {others} messages of other nodes") } else { String::new() };
            format!("no attitude arrived{others}: {}", promise.advice)
        };
        verdict.add(Reason { word: RunWord::Incomplete, kind: "no_attitude", count: 1, text });
        return;
    }
    // One connection that never came is as one that was lost.
    let is_allowed = facts.record.limits.links_lost.is_some_and(|most| most > 0);
    for (failed, port) in promise.failed_tries(facts.ports).filter(|(_, port)| port.is_unreached() && !is_allowed) {
        let (word, kind) = (RunWord::Incomplete, EventKind::LinkUnreached.name());
        verdict.add(Reason { word, kind, count: port.counters.unreached, text: format!("{failed}: {LISTENS}") });
    }
}

fn add_links(verdict: &mut RunVerdict, promise: &Promise, facts: &Facts<'_>) {
    let limit = facts.record.limits.links_lost.unwrap_or(0);
    let total: u64 = facts.ports.iter().map(|port| port.counters.lost).sum();
    if total == 0 {
        return;
    }
    if total <= u64::from(limit) {
        verdict.use_limit(&format!("{total} losses of a link"), "links_lost_at_most", limit);
        return;
    }
    let first_at = |kind| facts.record.ledger.kept().find(|event| event.kind == kind).map(|event| event.at);
    for (number, port) in facts.ports.iter().enumerate().filter(|(_, port)| port.counters.lost > 0) {
        let name = promise.links.get(number).map_or("a link", String::as_str);
        let mut text = format!("link {name} lost");
        if port.counters.lost > 1 {
            text += &format!(" {} times", port.counters.lost);
        }
        if let Some(at) = first_at(EventKind::LinkLost) {
            text += &format!(" at {:.1} s", (at - facts.zero).s());
        }
        let (word, kind) = (RunWord::Incomplete, EventKind::LinkLost.name());
        verdict.add(Reason { word, kind, count: port.counters.lost, text });
    }
}

/// Returns why frames ended as they did, in words.
fn cause(end: FrameEnd, promise: &Promise, facts: &Facts<'_>) -> String {
    match end {
        FrameEnd::OnTime | FrameEnd::Commanded => String::new(),
        FrameEnd::BlankAtStart if promise.starts_on_run => "no HELLO and RUN came".into(),
        FrameEnd::BlankAtStart => "no attitude yet".into(),
        FrameEnd::Blank | FrameEnd::AttitudeHeld => "no new attitude".into(),
        FrameEnd::NotExposed => not_exposed(facts),
        FrameEnd::Late | FrameEnd::Dropped => {
            let misses = facts.record.ring.misses();
            let mut causes: Vec<_> = misses.into_iter().filter(|(_, count)| *count > 0).collect();
            causes.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
            causes.first().map_or_else(String::new, |(name, _)| name.replace('_', " "))
        }
    }
}

/// Returns why exposures that the bench promised did not come.
fn not_exposed(facts: &Facts<'_>) -> String {
    if facts.cut_short.is_some() || facts.failure.is_some() {
        return "the run ended early".into();
    }
    let commanded = |exposing: &&Exposing| exposing.is_commanded;
    let Some(exposing) = facts.heads.iter().map(|head| &head.engine.exposing).find(commanded) else {
        return String::new();
    };
    let start = exposing.next_start();
    if start.is_triggered {
        return "the camera waited for triggers".into();
    }
    let rate_hz = start.period.map(|period| 1.0 / period.s());
    rate_hz.map_or_else(String::new, |rate_hz| format!("a client set the frame rate to {rate_hz} Hz"))
}
