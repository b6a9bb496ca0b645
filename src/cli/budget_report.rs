//! The times of a finished run against its limits: those of `[budget]`, and those derived where it names none.

use crate::cli::{budget_advice::advice, run_args::ClockKind, run_finished::Finished};
use anyhow::Result;
use config::Bench;
use frames::report::{BudgetLimits, BudgetReport, Stage, budget_lines};
use run::runtime::{FrameEngine, RunParams};

/// Returns the report of a run's time; `load_threads` were busy beside it.
///
/// # Errors
/// When a frame cannot be planned again for advice.
pub(super) fn budget_report(finished: &Finished, load_threads: usize) -> Result<BudgetReport> {
    let record = &finished.end.record;
    let limits = limits(finished.bench(), finished.engine());
    let lines = budget_lines(&limits, &record.stages, &record.ring);
    let summary = finished.summary(ClockKind::Real);
    let render_limit_ms = limits.stage_p99_ms[Stage::Render as usize].unwrap_or(0.0);
    let advice = advice(finished, &lines, render_limit_ms)?;
    Ok(BudgetReport {
        verdict: summary.verdict,
        starloop_version: summary.starloop_version,
        bench: summary.bench,
        camera: summary.camera,
        backend: summary.backend,
        adapter: summary.adapter,
        machine: summary.machine,
        duration_s: summary.duration_s,
        load_threads,
        frames: summary.frames,
        lines,
        latency: summary.latency,
        misses: summary.misses,
        degraded: summary.degraded,
        hygiene: finished.end.hygiene.clone(),
        advice,
    })
}

/// Returns the limits of the bench, with those derived from them.
pub(super) fn limits(bench: &Bench, engine: &FrameEngine) -> BudgetLimits {
    let mut limits = BudgetLimits {
        latency_p99_ms: bench.budget.latency_p99_ms,
        missed_frames: u64::from(bench.budget.missed_frames),
        ..BudgetLimits::default()
    };
    limits.stage_p99_ms[Stage::Render as usize] = derived_render_ms(engine);
    for (name, ms) in &bench.budget.stage_p99_ms {
        if let Some(stage) = Stage::named(name) {
            limits.stage_p99_ms[stage as usize] = Some(*ms);
        }
    }
    limits
}

/// Returns the planner's time for drawing; with the detector's where a device does both in one go.
fn derived_render_ms(engine: &FrameEngine) -> Option<f64> {
    let params = engine.params();
    let RunParams { camera, cost, .. } = params;
    let cost = cost.unwrap_or(engine.imager().cost());
    let readout_ms = if engine.imager().is_on_device() { camera.predicted_readout_ms(&cost) } else { 0.0 };
    let limit_ms = params.drawing_budget_ms(&cost) + readout_ms;
    (limit_ms > 0.0).then_some(limit_ms)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Tai;
    use run::wiring::bench_parts;

    fn limits_of(bench: &Bench) -> BudgetLimits {
        let params = bench_parts::run_params(bench, Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap()).unwrap();
        limits(bench, &FrameEngine::new(params).unwrap())
    }

    #[test]
    fn every_stage_of_the_config_is_a_stage_of_the_report() {
        let mut bench = Bench::built_in().unwrap();
        bench.render.backend = config::Backend::Cpu;
        let limits = limits_of(&bench);
        let of = |stage: Stage| limits.stage_p99_ms[stage as usize];
        let readout_ms = bench.camera.exposure.readout_s * 1e3;
        assert_eq!(of(Stage::ReleaseToDelivered), Some(readout_ms), "the whole is due when it is read out");
        assert!(of(Stage::Render).is_some_and(|ms| ms > 0.0 && ms < readout_ms), "{limits:?}");
        assert_eq!((of(Stage::Sky), limits.missed_frames), (None, 0));
        bench.budget.stage_p99_ms.extend([("sky", 3.0), ("render", 4.0)]);
        let limits = limits_of(&bench);
        assert_eq!(limits.stage_p99_ms[Stage::Sky as usize], Some(3.0));
        assert_eq!(limits.stage_p99_ms[Stage::Render as usize], Some(4.0), "what is given comes first");
        for (name, _) in &bench.budget.stage_p99_ms {
            assert!(Stage::named(name).is_some(), "{name}");
        }
    }
}
