//! Centroid error against time: all methods on one scene by one backend, the Pareto front, the planner's choice.

use crate::chart::{rows::MethodRow, scenes::Scene};
use base::accuracy::AccuracyBudget;
use frames::report::pareto_front;
use frames::report::plot::{Axis, Chart, Series, Style};
use plan::exposure::method::MethodName;

/// Returns charts of the charted scenes with their file names; those of the first backend have the scene's name alone.
pub fn charts(rows: &[MethodRow], scenes: &[Scene], backends: &[&str]) -> Vec<(String, Chart)> {
    let charted = || scenes.iter().filter(|scene| scene.is_charted);
    let named = |(i, backend): (usize, &&str), scene: &Scene| {
        let suffix = if i == 0 { String::new() } else { format!("_{backend}") };
        (format!("speed_accuracy_{}{suffix}", scene.name), chart(rows, scene, backend))
    };
    backends.iter().enumerate().flat_map(|at| charted().map(move |scene| named(at, scene))).collect()
}

/// Returns the rows of one scene by one backend that were drawn.
fn rows_of<'a>(rows: &'a [MethodRow], scene: &Scene, backend: &str) -> Vec<&'a MethodRow> {
    rows.iter().filter(|row| row.scene == scene.name && row.backend == backend && row.is_drawn()).collect()
}

/// Returns the time and error of a row.
fn point(row: &MethodRow) -> [f64; 2] {
    [row.draw_ms, row.centroid_px]
}

/// Returns the method that was drawn, without its parameters.
fn family(row: &MethodRow) -> &str {
    row.drawn.split(' ').next().unwrap_or_default()
}

/// Returns the chart of one scene.
pub fn chart(rows: &[MethodRow], scene: &Scene, backend: &str) -> Chart {
    let rows = rows_of(rows, scene, backend);
    let points: Vec<[f64; 2]> = rows.iter().map(|row| point(row)).collect();
    let front: Vec<[f64; 2]> = pareto_front(&points).into_iter().map(|i| points[i]).collect();
    let mut series = vec![Series::new("nothing is faster and better", Style::Front, 0, front)];
    for (group, name) in MethodName::ALL.into_iter().enumerate() {
        let members: Vec<&&MethodRow> = rows.iter().filter(|row| family(row) == name.name()).collect();
        if members.is_empty() {
            continue;
        }
        let marked = (0..members.len()).filter(|i| members[*i].is_choice()).collect();
        let points = members.iter().map(|row| point(row)).collect();
        series.push(Series { marked, ..Series::new(name.name(), Style::Points, group, points) });
    }
    let budget_px = AccuracyBudget::default().centroid_px;
    let ends = |pick: fn(f64, f64) -> f64, from: f64| points.iter().map(|p| p[0]).fold(from, pick);
    let line = [ends(f64::min, f64::INFINITY), ends(f64::max, 0.0)].map(|ms| [ms, budget_px]).to_vec();
    series.push(Series::new("budget", Style::DashedLine, 6, line));
    Chart {
        title: format!("{}, {backend} backend", scene.title),
        x: Axis::log("time to draw a frame, ms"),
        y: Axis::log("5 x 5 centroid error, px"),
        series,
        ring: "the planner's choice".into(),
        notes: notes(scene, &rows),
    }
}

fn notes(scene: &Scene, rows: &[&MethodRow]) -> Vec<String> {
    let stars = rows.first().map_or(0, |row| row.stars);
    let measured = if scene.is_for_speed() { "worst of up to 24 bright stars that stand alone" } else { "worst star" };
    let mut notes = vec![format!(
        "{stars} stars; error: {measured}, against the f64 reference. Points of a method differ in its number of nodes."
    )];
    if !scene.note.is_empty() {
        notes.push(format!("Quick run: {}.", scene.note));
    }
    notes
}
