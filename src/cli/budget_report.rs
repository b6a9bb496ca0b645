//! The report on the time of a run: limits, advice, files.
//!
//! The times of a finished run against its limits: those of `[budget]`, and those derived where it names none.

use crate::cli::{frame_plan::FramePlans, named, run::args::ClockKind, run::finished::Finished};
use anyhow::Result;
use config::Bench;
use frames::report::{
    BudgetLimits, BudgetLine, BudgetReport, FrameRing, LineVerdict, Stage, answer_lines, budget_lines, frames_csv,
    timeline_svg, to_junit,
};
use frames::sink::replace_own_file;
use plan::exposure::{Degradation, ExposurePlan};
use run::runtime::{FrameEngine, RunParams};
use run::{runtime::load::ratio_of, wiring::bench_parts};
use std::path::Path;
use testbed::flight_computer::FlightComputer;

/// Returns the report of a run's time; `load_threads` were busy beside it.
///
/// # Errors
/// When a frame cannot be planned again for advice.
pub(super) fn budget_report(finished: &Finished, load_threads: usize) -> Result<BudgetReport> {
    let record = &finished.end.record;
    let limits = limits(finished.bench(), finished.engine());
    let mut lines = budget_lines(&limits, &record.stages, &record.ring);
    lines.extend(answer_lines(&finished.end.answers));
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
    let params = &engine.params;
    let RunParams { camera, cost, .. } = params;
    let cost = cost.unwrap_or(engine.drawer.imager.cost);
    let readout_ms = if engine.drawer.imager.is_on_device() { camera.predicted_readout_ms(&cost) } else { 0.0 };
    let limit_ms = params.drawing_budget_ms(&cost) + readout_ms;
    (limit_ms > 0.0).then_some(limit_ms)
}

// Advice after a run over its time: for the frame that took longest to draw, the first degradation level and the
// method that would fit the time, with cost and error as predicted.
//
// The planner's costs are scaled by what the frame really took: on a loaded machine they are too low. The planner
// changes drawing only; other stages are reported as beyond it.

/// Returns lines of advice; none when nothing is broken.
///
/// # Errors
/// When the frame cannot be planned again.
pub(super) fn advice(finished: &Finished, lines: &[BudgetLine], render_limit_ms: f64) -> Result<Vec<String>> {
    let broken: Vec<&BudgetLine> = lines.iter().filter(|line| line.verdict == LineVerdict::Broken).collect();
    if broken.is_empty() {
        return Ok(Vec::new());
    }
    let works_by_itself = |line: &&BudgetLine| {
        Stage::OF_A_FRAME.iter().any(|stage| stage.name() == line.name) && line.name != Stage::Render.name()
    };
    let beyond = broken.iter().copied().filter(works_by_itself);
    let mut advice: Vec<String> = beyond
        .map(|line| format!("{}: the planner shortens drawing only; this is not its to change", line.name))
        .collect();
    let drawn = finished.end.record.ring.last().filter_map(|record| Some((record, record.times.get(Stage::Render)?)));
    let Some((slowest, took)) = drawn.max_by_key(|(_, time)| *time) else { return Ok(advice) };
    let params = &finished.engine().params;
    let cost = params.cost.unwrap_or(finished.engine().drawer.imager.cost);
    let computer = FlightComputer::new(bench_parts::flight_computer(finished.bench(), finished.end.times.start));
    let mut frames = FramePlans::new(computer, params, &params.open_sky()?);
    let mut planner = frames.planner(cost, None);
    let whole = frames.plan(slowest.number, &mut planner)?;
    // The drawn plan may have been degraded already; its own cost is not kept, so the load may be higher than this.
    let times_as_long = ratio_of(whole.chosen.cost_ms, took.ms()).unwrap_or(1.0);
    advice.push(format!(
        "frame {} took {:.2} ms to draw (level {}, {}); whole: {}, about {:.1} times as long as predicted",
        slowest.number,
        took.ms(),
        slowest.degradation,
        slowest.method,
        summary(whole),
        times_as_long
    ));
    let mut planner = frames.planner(cost, Some(render_limit_ms / times_as_long));
    let plan = frames.plan(slowest.number, &mut planner)?;
    advice.push(verdict(plan, render_limit_ms, times_as_long));
    Ok(advice)
}

fn verdict(plan: &ExposurePlan, limit_ms: f64, times_as_long: f64) -> String {
    let expected_ms = plan.chosen.cost_ms * times_as_long;
    let summary = summary(plan);
    if expected_ms > limit_ms {
        format!(
            "no level fits drawing into {limit_ms:.2} ms at this load; the last: {summary}, {expected_ms:.2} ms here"
        )
    } else if plan.degradation == Degradation::Full {
        format!("drawing fits {limit_ms:.2} ms whole ({summary}, {expected_ms:.2} ms here): the time went elsewhere")
    } else {
        let degradation = plan.degradation;
        format!("inside {limit_ms:.2} ms: {summary}, {expected_ms:.2} ms here; it gives up {}", degradation.gives_up())
    }
}

fn summary(plan: &ExposurePlan) -> String {
    let chosen = &plan.chosen;
    format!(
        "level {}, {}, {} stars, predicted {:.2} ms, at most {:.1e} px and {:.1e} sigma wrong",
        plan.degradation,
        chosen.method,
        plan.stars.len(),
        chosen.cost_ms,
        chosen.centroid_px,
        chosen.pixel_sigma
    )
}

// Files of `--report DIR`: budget.json, frames_timing.csv, junit.xml, worst.svg. Each is complete or absent.

/// Frames in worst.svg.
const WORST: usize = 16;

/// Writes the four files.
///
/// # Errors
/// When the directory or a file cannot be written.
pub(super) fn write(directory: &Path, report: &BudgetReport, ring: &FrameRing) -> Result<()> {
    named::make_folder("--report", directory)?;
    let worst = ring.worst(WORST);
    let title = format!("{}: the {} worst of {} frames", report.bench, worst.len(), ring.total());
    let files = [
        ("budget.json", report.to_json_pretty()?.into_bytes()),
        ("frames_timing.csv", frames_csv(ring.last())?),
        ("junit.xml", to_junit(report).into_bytes()),
        ("worst.svg", timeline_svg(&title, &worst).into_bytes()),
    ];
    for (name, bytes) in files {
        replace_own_file(&directory.join(name), |out| out.write_all(&bytes))?;
    }
    Ok(())
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
