//! `starloop check SCENARIO`: what is flown, what happens when, what is expected.
//!
//! Input: a checked scenario. Output: text. All parts of the loop are made once, so that what only a run would refuse (a
//! wheel that is not there) is refused here.

use anyhow::Result;
use base::units::DEG;
use config::{Action, Event, Expect, GyroFaultKind, Pointing, Scenario};
use core::fmt::{Error, Write};
use frames::sink::{FrameFault, NullSink};
use glam::DVec3;
use link::tap::LinkFault;
use run::wiring::closed_loop::ClosedLoop;

/// The section about the scenario.
///
/// # Errors
/// When it cannot be flown.
pub(super) fn report(scenario: &Scenario) -> Result<String> {
    ClosedLoop::new(scenario, |_| Box::new(NullSink::new()))?;
    let mut text = String::new();
    write_flight(&mut text, scenario)?;
    write_events(&mut text, &scenario.events)?;
    write_expectations(&mut text, &scenario.expect)?;
    for (what, list) in [("scenario", &scenario.defaulted), ("spacecraft", &scenario.spacecraft.defaulted)] {
        for default in list {
            writeln!(text, "  default      {what}: {} = {}", default.key, default.value)?;
        }
    }
    writeln!(text, "  note         the bench's [flight_computer], used below, is not flown: the spacecraft is")?;
    Ok(text)
}

fn write_flight(text: &mut String, scenario: &Scenario) -> Result<(), Error> {
    let Scenario { bench, spacecraft, heads, .. } = scenario;
    writeln!(text, "scenario \"{}\" is sound", scenario.name)?;
    writeln!(text, "  bench        \"{}\"", bench.name)?;
    let wheels = spacecraft.params.wheels.len();
    let period_ms = spacecraft.control.period.s() * 1e3;
    writeln!(text, "  spacecraft   \"{}\": {wheels} wheels, a control step every {period_ms} ms", spacecraft.name)?;
    writeln!(text, "  run          {} s, seed {}", bench.timing.duration_s, bench.seed)?;
    let mountings: Vec<String> = heads.iter().map(|head| format!("{:.4?}", head.wxyz())).collect();
    writeln!(text, "  heads        {}, sensor_from_body {}", heads.len(), mountings.join(" "))?;
    let start = scenario.initial.as_ref().map_or_else(|| "a random attitude from the seed".to_owned(), pointing);
    let rate_deg_s = (scenario.initial_rate_rad_s / DEG).to_array();
    writeln!(text, "  start        {start}, rate {rate_deg_s:.4?} deg/s")?;
    writeln!(text, "  target       {}", pointing(&scenario.target))?;
    writeln!(
        text,
        "  tracker      {} ms after readout, {} brightest stars, time tags off by {} ms; torque {} ms late",
        scenario.tracker_delay.s() * 1e3,
        scenario.tracker_stars,
        scenario.tag_error.s() * 1e3,
        scenario.actuation_delay.s() * 1e3
    )
}

fn write_events(text: &mut String, events: &[Event]) -> Result<(), Error> {
    if events.is_empty() {
        return writeln!(text, "  events       none");
    }
    writeln!(text, "  events        at s    for s  do")?;
    for event in events {
        let line = format!("{:<20} {}", event.action.word(), told(&event.action));
        let after = event.on_trigger.map_or_else(String::new, |number| format!(", after trigger {number}"));
        writeln!(text, "            {:9.1} {:9.1}  {}{after}", event.at.s(), event.lasts.s(), line.trim_end())?;
    }
    Ok(())
}

/// The values of an event.
fn told(action: &Action) -> String {
    let of_head = |head: Option<usize>| head.map_or_else(|| "all heads".to_owned(), |head| format!("head {head}"));
    let rate = |rate_rad_s: DVec3| format!("{:.3?} deg/h", (rate_rad_s * (3600.0 / DEG)).to_array());
    match action {
        Action::Slew(target) => pointing(target),
        Action::Bus(fault) | Action::BusBack(fault) => match fault {
            LinkFault::Loss { share }
            | LinkFault::Duplicate { share }
            | LinkFault::WrongBits { share }
            | LinkFault::Truncate { share } => {
                format!("{} % of the packets", share * 100.0)
            }
            LinkFault::Delay { by, jitter } => format!("{} ms, jitter {} ms", by.s() * 1e3, jitter.s() * 1e3),
            LinkFault::Reorder { share, by } => {
                format!("{} % of the packets, held back {} ms", share * 100.0, by.s() * 1e3)
            }
            LinkFault::Babble { id, period, bytes } => {
                format!("identifier 0x{id:03X}, {bytes} bytes, each {} ms", period.s() * 1e3)
            }
            LinkFault::ClockStep { by } => format!("{} ms", by.s() * 1e3),
            LinkFault::ClockDrift { ppm } => format!("{ppm} ppm"),
            LinkFault::Silence | LinkFault::Off => String::new(),
        },
        Action::Frame {
            head,
            fault: FrameFault::Drop | FrameFault::Duplicate | FrameFault::Torn | FrameFault::Blank,
        }
        | Action::TrackerOff { head } => of_head(*head),
        Action::Frame { head, fault } => {
            let (begin, end) = (fault.amount(0.0), fault.amount(1.0));
            let to = if begin == end { String::new() } else { format!(" to {}", end.value) };
            format!("{}{to} {}, {}", begin.value, begin.unit, of_head(*head))
        }
        Action::Gyro(GyroFaultKind::BiasJump(by) | GyroFaultKind::Spike(by)) => rate(*by),
        Action::Trigger { number } => format!("trigger {number}"),
        Action::WheelFailure { wheel } => format!("wheel {wheel}"),
        Action::Safe | Action::Resume | Action::Gyro(GyroFaultKind::Dropout | GyroFaultKind::Stuck) => String::new(),
    }
}

fn write_expectations(text: &mut String, expect: &Expect) -> Result<(), Error> {
    writeln!(text, "  expected     judged: the last {} s", expect.window_s)?;
    let numbers = [
        ("fine pointing reached: within", expect.fine_pointing_within_s, " s"),
        ("pointing error in the window: at most", expect.pointing_arcsec.filter(|_| !expect.diverges), " arcsec rms"),
        ("error of the estimate in the window: at most", expect.knowledge_arcsec, " arcsec rms"),
        ("pointing error over linear theory's: at most", expect.pointing_over_predicted, ""),
        ("angle to the Sun: at least", expect.least_sun_angle_deg, " deg"),
    ];
    for (what, limit, unit) in numbers {
        if let Some(limit) = limit {
            writeln!(text, "               {what} {limit}{unit}")?;
        }
    }
    let Expect { recovery_s, recovered_arcsec, .. } = expect;
    writeln!(text, "               after a fault: within {recovered_arcsec} arcsec in {recovery_s} s")?;
    if let Some(mode) = expect.final_mode {
        writeln!(text, "               mode at the end: {mode}")?;
    }
    if expect.diverges {
        let limit = expect.pointing_arcsec.unwrap_or(expect.recovered_arcsec);
        writeln!(text, "               the control fails: pointing error in the window above {limit} arcsec rms")?;
    }
    Ok(())
}

fn pointing(to: &Pointing) -> String {
    format!("RA {} Dec {} roll {} deg", to.ra_deg, to.dec_deg, to.roll_deg)
}
