//! `starloop check SCENARIO`: what is flown, what happens when, what is expected.
//!
//! Input: a checked scenario. Output: text. All parts of the loop are made once, so that what only a run would refuse
//! (a wheel that is not there) is refused here.

use crate::cli::facts::Facts;
use anyhow::Result;
use base::units::DEG;
use config::{Action, Event, Expect, ExpectFrames, Pointing, Scenario, Vehicle};
use frames::sink::{NullSink, Sink};
use link::tap::LinkFault;
use run::wiring::assemble::{Outputs, Run, RunOptions};
use run::wiring::{ports::needs_real_clock, stepped::SteppedRun};

/// Makes all parts of the run, so that what only a run would refuse is refused here; a real bus is not opened.
fn make_once(scenario: &Scenario) -> Result<()> {
    let mut nothing = |_: usize| Box::new(NullSink::new()) as Box<dyn Sink>;
    if needs_real_clock(&scenario.bench).is_some() {
        Run::assemble(scenario, RunOptions::real(Outputs::Made(&mut nothing)))?;
    } else {
        let is_controlled = scenario.bench.is_lockstep();
        let options = RunOptions { is_controlled, ..RunOptions::stepped(Outputs::Made(&mut nothing)) };
        SteppedRun::of(Run::assemble(scenario, options)?)?;
    }
    Ok(())
}

fn write_frames_expected(facts: &mut Facts, expect: &ExpectFrames) {
    let limits = &expect.limits;
    let limits = [
        ("late frames, at most", limits.late),
        ("dropped frames, at most", limits.dropped),
        ("blank frames, at most", limits.blank),
        ("blank frames at the start, at most", limits.blank_at_start),
        ("frames with a held attitude, at most", limits.attitude_held),
        ("frames not exposed, at most", limits.not_exposed),
        ("losses of a link, at most", limits.links_lost),
        ("times packets are lost, at most", limits.packets_lost),
        ("frames without all jitter, at most", limits.jitter_missing),
        ("triggers, at least", expect.triggers_at_least),
    ];
    for (what, limit) in limits {
        if let Some(limit) = limit {
            facts.fact("expected", format_args!("{what} {limit}"));
        }
    }
}

/// Returns the section about what happens in the run.
///
/// # Errors
/// When it cannot be flown.
pub(super) fn report(scenario: &Scenario) -> Result<Facts> {
    make_once(scenario)?;
    let mut facts = Facts::indented();
    let Some(vehicle) = scenario.vehicle() else {
        if scenario.bench.is_lockstep() {
            facts.line(
                "plant outside, in lockstep: run it with --clock virtual --control ADDRESS; the client sends attitudes",
            );
        }
        facts.line(format_args!("events of \"{}\"", scenario.name));
        write_events(&mut facts, &scenario.events);
        write_frames_expected(&mut facts, &scenario.expect.frames);
        return Ok(facts);
    };
    write_flight(&mut facts, scenario, vehicle);
    write_events(&mut facts, &scenario.events);
    write_expectations(&mut facts, &scenario.expect);
    write_frames_expected(&mut facts, &scenario.expect.frames);
    for (what, list) in [("scenario", &scenario.defaulted), ("spacecraft", &vehicle.spacecraft.defaulted)] {
        for default in list {
            facts.fact("default", format_args!("{what}: {} = {}", default.key, default.value));
        }
    }
    facts.fact("note", "the bench's [flight_computer], used below, is not flown: the spacecraft is");
    Ok(facts)
}

fn write_flight(facts: &mut Facts, scenario: &Scenario, vehicle: &Vehicle) {
    let (bench, spacecraft, heads) = (&scenario.bench, &vehicle.spacecraft, scenario.bench.mountings());
    facts.line(format_args!("scenario \"{}\"", scenario.name));
    facts.fact("bench", format_args!("\"{}\"", bench.name));
    let wheels = spacecraft.params.wheels.len();
    let period_ms = spacecraft.control.period.s() * 1e3;
    facts
        .named("spacecraft")
        .line(format_args!("\"{}\": {wheels} wheels, a control step every {period_ms} ms", spacecraft.name));
    facts.fact("run", format_args!("{} s, seed {}", bench.timing.duration_s, bench.seed));
    let mountings: Vec<String> = heads.iter().map(|head| format!("{:.4?}", head.wxyz())).collect();
    facts.fact("heads", format_args!("{}, sensor_from_body {}", heads.len(), mountings.join(" ")));
    let start = vehicle.initial.as_ref().map_or_else(|| "a random attitude from the seed".to_owned(), pointing);
    let rate_deg_s = (vehicle.initial_rate_rad_s / DEG).to_array();
    facts.fact("start", format_args!("{start}, rate {rate_deg_s:.4?} deg/s"));
    facts.fact("target", pointing(&vehicle.target));
    facts.named("tracker").line(format_args!(
        "{} ms after readout, {} brightest stars, time tags off by {} ms; torque {} ms late",
        vehicle.tracker_delay.s() * 1e3,
        vehicle.tracker_stars,
        vehicle.tag_error.s() * 1e3,
        vehicle.actuation_delay.s() * 1e3
    ));
}

fn write_events(facts: &mut Facts, events: &[Event]) {
    if events.is_empty() {
        return facts.fact("events", "none");
    }
    facts.line("  events        at s    for s  do");
    for event in events {
        let line = format!("{:<20} {}", event.action.word(), values(&event.action));
        let after = event.on_trigger.map_or_else(String::new, |number| format!(", after trigger {number}"));
        facts.line(format_args!(
            "            {:9.1} {:9.1}  {}{after}",
            event.at.s(),
            event.lasts.s(),
            line.trim_end()
        ));
    }
}

/// Returns the values of an event.
fn values(action: &Action) -> String {
    match action {
        Action::Slew(target) => pointing(target),
        Action::Bus(fault) => fault.to_string(),
        Action::BusBackLoss { share } => LinkFault::Loss { share: *share }.to_string(),
        Action::Frame { head, fault } => {
            let heads = head.map_or_else(|| "all heads".to_owned(), |head| format!("head {head}"));
            let parts = [fault.to_string(), heads];
            parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
        }
        Action::Aboard(fault) => fault.to_string(),
        Action::Trigger { number } => format!("trigger {number}"),
        Action::Safe | Action::Resume => String::new(),
    }
}

fn write_expectations(facts: &mut Facts, expect: &Expect) {
    facts.fact("expected", format_args!("judged: the last {} s", expect.window_s));
    let numbers = [
        ("fine pointing reached: within", expect.fine_pointing_within_s, " s"),
        ("pointing error in the window: at most", expect.pointing_arcsec.filter(|_| !expect.diverges), " arcsec rms"),
        ("error of the estimate in the window: at most", expect.knowledge_arcsec, " arcsec rms"),
        ("pointing error over linear theory's: at most", expect.pointing_over_predicted, ""),
        ("angle to the Sun: at least", expect.least_sun_angle_deg, " deg"),
    ];
    for (what, limit, unit) in numbers {
        if let Some(limit) = limit {
            facts.more(format_args!("{what} {limit}{unit}"));
        }
    }
    let Expect { recovery_s, recovered_arcsec, .. } = expect;
    facts.more(format_args!("after a fault: within {recovered_arcsec} arcsec in {recovery_s} s"));
    if let Some(mode) = expect.final_mode {
        facts.more(format_args!("mode at the end: {mode}"));
    }
    if expect.diverges {
        let limit = expect.pointing_arcsec.unwrap_or(expect.recovered_arcsec);
        facts.more(format_args!("the control fails: pointing error in the window above {limit} arcsec rms"));
    }
}

fn pointing(to: &Pointing) -> String {
    format!("RA {} Dec {} roll {} deg", to.ra_deg, to.dec_deg, to.roll_deg)
}
