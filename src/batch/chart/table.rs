//! The table for a terminal: the planner's choice on every scene, with its predictions and the measured values.

use crate::chart::rows::{MethodRow, broken};
use crate::chart::scenes::Scene;

/// Largest factor between predicted and measured times.
const COST_FACTOR: f64 = 1.5;

/// Returns lines of text; `notes` name the backends.
pub(super) fn summary(methods: &[MethodRow], samplings: &[MethodRow], scenes: &[Scene], notes: &[String]) -> String {
    let mut lines = notes.to_vec();
    lines.push(String::new());
    lines.push(format!(
        "{:<16} {:<4} {:<34} {:>8} {:>8}   {:>8} {:>8} {:>10} {:>12} {:>7} {:>9}",
        "scene",
        "",
        "the planner's choice",
        "bound px",
        "error px",
        "plan ms",
        "draw ms",
        "fastest ms",
        "predicted ms",
        "ratio",
        "fastest"
    ));
    for scene in scenes {
        lines.extend(
            methods.iter().filter(|row| row.scene == scene.name && row.is_choice()).map(|row| line(row, scene)),
        );
    }
    lines.push(String::new());
    lines.push(cost_verdict(methods, scenes));
    lines.extend(bound_verdict(methods, "methods"));
    lines.extend(bound_verdict(samplings, "PSF samplings"));
    lines.join("\n") + "\n"
}

fn line(row: &MethodRow, scene: &Scene) -> String {
    let ratio =
        if scene.is_for_speed() { format!("{:>7.2} {:>9.2}", to_median(row), to_fastest(row)) } else { String::new() };
    let line = format!(
        "{:<16} {:<4} {:<34} {:>8.1e} {:>8.1e} {} {:>8.3} {:>8.3} {:>10.3} {:>12.3} {ratio}",
        row.scene,
        row.backend,
        row.drawn,
        row.bound_centroid_px,
        row.centroid_px,
        if row.fits() { ' ' } else { '*' },
        row.plan_ms,
        row.draw_ms,
        row.fastest_ms,
        row.predicted_ms
    );
    let note = if row.fits() { String::new() } else { format!("  * {}", row.verdict) };
    line.trim_end().to_owned() + &note
}

/// Returns the ratio of the predicted time to the medians of planning and drawing.
fn to_median(row: &MethodRow) -> f64 {
    row.predicted_ms / (row.plan_ms + row.draw_ms)
}

/// Returns the ratio of the predicted time to planning and the fastest drawing.
fn to_fastest(row: &MethodRow) -> f64 {
    row.predicted_ms / (row.plan_ms + row.fastest_ms)
}

fn cost_verdict(methods: &[MethodRow], scenes: &[Scene]) -> String {
    let is_speed = |row: &&MethodRow| scenes.iter().any(|scene| scene.is_for_speed() && scene.name == row.scene);
    let choices: Vec<&MethodRow> = methods.iter().filter(|row| row.is_choice()).filter(is_speed).collect();
    let near = |ratio: fn(&MethodRow) -> f64| {
        choices.iter().filter(|row| (1.0 / COST_FACTOR..=COST_FACTOR).contains(&ratio(row))).count()
    };
    let (drawn, fastest, all) = (near(to_median), near(to_fastest), choices.len());
    format!(
        "predicted times of S1 to S4 within a factor of {COST_FACTOR}: {drawn} of {all} against the \
         median of planning and drawing, {fastest} of {all} with the fastest drawing"
    )
}

fn bound_verdict(rows: &[MethodRow], what: &str) -> Vec<String> {
    let fit = rows.iter().filter(|row| row.fits()).count();
    let broken = broken(rows);
    let mut lines = vec![format!("{what}: {} of {fit} rows that fit the budget are beyond their bounds", broken.len())];
    lines.extend(broken.iter().map(|row| {
        format!(
            "  {} {} {} ({}): bounds {:.1e} px {:.1e} flux {:.1e} sigma, found {:.1e} px {:.1e} flux {:.1e} sigma",
            row.scene,
            row.backend,
            row.method,
            row.drawn,
            row.bound_centroid_px,
            row.bound_flux_rel,
            row.bound_pixel_sigma,
            row.centroid_px,
            row.flux_rel,
            row.pixel_sigma
        )
    }));
    lines
}
