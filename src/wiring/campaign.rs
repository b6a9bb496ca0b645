//! A fault campaign: episodes of one scenario, each with random faults from its own seed, each checked throughout.
//!
//! In: a scenario, seeds. Out: per episode what held and what did not. An episode is one [`ClosedLoop`] whose events are
//! the scenario's own and those of [`fault_schedule`]; its seed alone repeats it.

use crate::config::Scenario;
use crate::sink::NullSink;
use crate::testbed::acs::Mode;
use crate::wiring::closed_loop::{ClosedLoop, LoopError};
use crate::wiring::fault_schedule::{ScheduleLimits, fault_schedule};
use serde::Serialize;

/// Time for acquisition before the first fault, s.
const QUIET_START_S: f64 = 600.0;
/// Time without faults at the end, s: the loop must recover from the last one.
const QUIET_END_S: f64 = 600.0;

/// What became of one episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Episode {
    /// Its seed.
    pub seed: u64,
    /// Simulated time, s.
    pub simulated_s: f64,
    /// Events that were injected.
    pub events: usize,
    /// Times a fault hit something.
    pub hits: u64,
    /// Frames sent.
    pub frames: u64,
    /// CRC-32 over all frames.
    pub frames_crc32: u32,
    /// CRC-32 over all telemetry.
    pub telemetry_crc32: u32,
    /// Broken invariants.
    pub violations: u64,
    /// The first of them in words.
    pub violation_lines: Vec<String>,
}

/// The scenario of one episode: `base` with the faults of `seed`.
#[must_use]
pub fn episode_scenario(base: &Scenario, seed: u64) -> Scenario {
    let mut scenario = base.clone();
    scenario.bench.seed = seed;
    let limits = ScheduleLimits {
        from_s: QUIET_START_S,
        until_s: scenario.bench.timing.duration_s - QUIET_END_S,
        wheels: scenario.spacecraft.params.wheels.len(),
    };
    scenario.expect.allows_refusals = true;
    scenario.events.extend(fault_schedule(seed, &limits));
    scenario.events.sort_by_key(|event| event.at);
    scenario
}

/// Runs one episode.
///
/// # Errors
/// When a part of the loop failed: that, too, breaks an invariant, and is told with the seed.
pub fn run_episode(base: &Scenario, seed: u64) -> Result<Episode, LoopError> {
    let scenario = episode_scenario(base, seed);
    let mut going = ClosedLoop::new(&scenario, |_| Box::new(NullSink::new()))?;
    going.run_to_end(&mut |_, _, _| true)?;
    let mode = going.with_vehicle(|vehicle| vehicle.mode());
    let mut outcome = going.finish()?;
    let assessment = &mut outcome.assessment;
    if !assessment.is_on_target() {
        assessment.violate(|| "not on target at the end".into());
    }
    if mode != Some(Mode::FinePointing) {
        assessment.violate(|| format!("mode at the end is {mode:?}, wanted FinePointing"));
    }
    let (violations, lines) = assessment.violations();
    Ok(Episode {
        seed,
        simulated_s: scenario.bench.timing.duration_s,
        events: scenario.events.len(),
        hits: outcome.faults.iter().map(|fault| fault.hits).sum(),
        frames: outcome.record.frames.delivered,
        frames_crc32: outcome.sinks.first().map_or(0, |sink| sink.run_crc32),
        telemetry_crc32: assessment.telemetry_crc32(),
        violations,
        violation_lines: lines.to_vec(),
    })
}
