//! A fault campaign: episodes of one scenario, each with random faults from its own seed, each checked throughout.
//!
//! In: a scenario, seeds. Out: the results of each episode's checks. An episode is one [`SteppedRun`] whose events are
//! the scenario's own and those of [`fault_schedule`]; its seed alone repeats it.

use base::refused::Refused;
use config::{Event, Scenario};
use frames::sink::NullSink;
use run::wiring::fault_schedule::{ScheduleLimits, fault_schedule};
use run::wiring::invariants::{Invariant, InvariantLine};
use run::wiring::{error::LoopError, stepped::SteppedRun};
use serde::Serialize;
use testbed::acs::Mode;

/// Time for acquisition before the first fault, s.
const QUIET_START_S: f64 = 600.0;
/// Time without faults at the end, s: the loop must recover from the last one.
const QUIET_END_S: f64 = 600.0;

/// Result of one episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Episode {
    /// Its seed.
    pub seed: u64,
    /// Simulated time, s.
    pub simulated_s: f64,
    /// Events that were injected.
    pub events: usize,
    /// Number of times that a fault hit something.
    pub hits: u64,
    /// Frames sent.
    pub frames: u64,
    /// CRC-32 over all frames.
    pub frames_crc32: u32,
    /// CRC-32 over all telemetry.
    pub telemetry_crc32: u32,
    /// Number of violated invariants.
    pub violations: u64,
    /// The first of them in words.
    pub violation_lines: Vec<String>,
    /// Each invariant with its checks.
    pub invariants: Vec<InvariantLine>,
}

/// Refuses a scenario too short for any random fault: flown as an episode, it would pass without testing anything.
///
/// # Errors
/// The smallest duration.
pub fn check_time_for_faults(base: &Scenario) -> Result<(), Refused> {
    let limits = schedule_limits(base);
    if limits.until_s > limits.from_s {
        return Ok(());
    }
    Err(Refused(format!(
        "duration_s is {}; wanted more than {}: random faults come between {QUIET_START_S} s after the first exposure and \
         {QUIET_END_S} s before the end",
        base.bench.timing.duration_s,
        QUIET_START_S + QUIET_END_S
    )))
}

fn schedule_limits(base: &Scenario) -> ScheduleLimits {
    ScheduleLimits {
        from_s: QUIET_START_S,
        until_s: base.bench.timing.duration_s - QUIET_END_S,
        wheels: base.vehicle().map_or(0, |vehicle| vehicle.spacecraft.params.wheels.len()),
    }
}

/// Returns the random faults of `seed` in the scenario `base`.
pub fn random_faults(base: &Scenario, seed: u64) -> Vec<Event> {
    fault_schedule(seed, &schedule_limits(base))
}

/// Returns the scenario of one episode: `base` with the faults of `seed`.
pub fn episode_scenario(base: &Scenario, seed: u64) -> Scenario {
    let mut scenario = base.clone();
    scenario.bench.seed = seed;
    scenario.expect.allows_refusals = true;
    scenario.events.extend(random_faults(base, seed));
    scenario.events.sort_by_key(|event| event.at);
    scenario
}

/// Runs one episode.
///
/// # Errors
/// When a part of the loop failed: that also violates an invariant, and is reported with the seed.
pub fn run_episode(base: &Scenario, seed: u64) -> Result<Episode, LoopError> {
    let scenario = episode_scenario(base, seed);
    let mut going = SteppedRun::new(&scenario, |_| Box::new(NullSink::new()))?;
    going.run_to_end(&mut |_, _, _| true)?;
    let mode = going.with_vehicle(|vehicle| vehicle.mode());
    let mut outcome = going.end(None);
    if let Some(error) = outcome.error {
        return Err(error);
    }
    let assessment = &mut outcome.assessment;
    let (is_on_target, is_fine) = (assessment.is_on_target(), mode == Some(Mode::FinePointing));
    let invariants = &mut assessment.invariants;
    invariants.check(Invariant::EndsOnTarget, is_on_target, || "not on target at the end".into());
    invariants
        .check(Invariant::EndsInFinePointing, is_fine, || format!("mode at the end is {mode:?}, wanted FinePointing"));
    let (violations, lines) = assessment.violations();
    Ok(Episode {
        seed,
        simulated_s: scenario.bench.timing.duration_s,
        events: scenario.events.len(),
        hits: outcome.faults.iter().map(|fault| fault.hits).sum(),
        frames: outcome.record.frames.delivered,
        frames_crc32: outcome.summaries.first().and_then(Option::as_ref).map_or(0, |sink| sink.run_crc32),
        telemetry_crc32: assessment.telemetry_crc32(),
        violations,
        violation_lines: lines.to_vec(),
        invariants: assessment.invariants.results(&[&Invariant::OF_RUN[..], &Invariant::OF_EPISODE].concat()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::Document;

    #[test]
    fn a_run_without_time_for_faults_is_refused_with_the_least_duration() {
        let mut base = Scenario::from_document(&Document::built_in("scenarios/campaign.toml").unwrap()).unwrap();
        assert_eq!(check_time_for_faults(&base), Ok(()));
        assert!(!random_faults(&base, 1).is_empty());
        base.bench.timing.duration_s = 1200.0;
        let error = check_time_for_faults(&base).expect_err("600 s and 600 s").to_string();
        assert!(error.contains("duration_s is 1200; wanted more than 1200"), "{error}");
        assert!(random_faults(&base, 1).is_empty(), "what is refused is empty");
    }
}
