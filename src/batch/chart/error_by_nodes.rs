//! Centroid error against the number of nodes, with the bound beside it, for the methods that count nodes.

use crate::chart::{rows::MethodRow, scenes::Scene};
use frames::report::plot::{Axis, Chart, Series, Style};
use plan::exposure::method::MethodName;

/// Methods with a variable number of nodes.
const SHOWN: [MethodName; 3] = [MethodName::Samples, MethodName::Segments, MethodName::GaussLegendre];

/// Returns charts of the charted scenes, with their file names, by the first backend.
pub fn charts(rows: &[MethodRow], scenes: &[Scene], backends: &[&str]) -> Vec<(String, Chart)> {
    let Some(backend) = backends.first() else { return Vec::new() };
    let charted = scenes.iter().filter(|scene| scene.is_charted);
    charted.map(|scene| (format!("error_by_nodes_{}", scene.name), chart(rows, scene, backend))).collect()
}

/// Returns the chart of one scene.
pub fn chart(rows: &[MethodRow], scene: &Scene, backend: &str) -> Chart {
    let mut series = Vec::new();
    for (group, name) in SHOWN.into_iter().enumerate() {
        let is_shown = |row: &&MethodRow| {
            row.scene == scene.name && row.backend == backend && row.method == name.name() && row.is_drawn()
        };
        let members: Vec<&MethodRow> = rows.iter().filter(is_shown).collect();
        let points = |value: fn(&MethodRow) -> f64| {
            members.iter().map(|row| [row.nodes as f64, value(row)]).collect::<Vec<[f64; 2]>>()
        };
        if members.is_empty() {
            continue;
        }
        series.push(Series::new(name.name(), Style::Points, group, points(|row| row.centroid_px)));
        series.push(Series::new("", Style::Line, group, points(|row| row.centroid_px)));
        series.push(Series::new(
            format!("{}, bound", name.name()),
            Style::DashedLine,
            group,
            points(|row| row.bound_centroid_px),
        ));
    }
    Chart {
        title: format!("{}: error by number of nodes, {backend} backend", scene.title),
        x: Axis::log("nodes per star"),
        y: Axis::log("5 x 5 centroid error, px"),
        series,
        ring: String::new(),
        notes: vec![
            "Worst star against the f64 reference; dashed: the bound known before drawing. Segments carry two nodes each."
                .into(),
        ],
    }
}
