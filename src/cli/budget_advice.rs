//! Advice after a run over its time: for the frame that took longest to draw, the first degradation level and the
//! method that would fit the time, with cost and error as predicted.
//!
//! The planner's costs are scaled by what the frame really took: on a loaded machine they are too low. The planner
//! changes drawing only; other stages are reported as beyond it.

use crate::cli::{frame_plan::FramePlans, run_finished::Finished};
use anyhow::Result;
use frames::report::{BudgetLine, LineVerdict, Stage};
use plan::exposure::{Degradation, ExposurePlan};
use run::{runtime::load::ratio_of, wiring::bench_parts};
use testbed::flight_computer::FlightComputer;

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
    let params = finished.engine().params();
    let cost = params.cost.unwrap_or(finished.engine().imager().cost());
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
