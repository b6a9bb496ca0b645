//! Every method on every scene: rows, and the charts of error against time and against nodes.
//!
//! One scene, every method, every backend -> rows.

use crate::chart::rows::{Errors, MethodRow, NOT_DRAWN, brightest_e};
use crate::chart::scenes::{Movement, Scene};
use crate::chart::stage::{Drawer, Effort, Picture, READ_NOISE_E, Stage, truth};
use crate::chart::{Settings, stage};
use base::{accuracy::AccuracyBudget, refused::Refused};
use frames::report::pareto_front;
use frames::report::plot::{Axis, Chart, Series, Style};
use plan::exposure::method::MethodName;
use plan::exposure::{ExposurePlan, MethodChoice, Planner};

/// Factor of the effort for times whose prediction is checked.
const SPEED_EFFORT: usize = 4;

/// A method with its parameters.
type Trial = (MethodName, &'static [Option<usize>]);

const WHOLE: [Trial; 8] = [
    (MethodName::Static, &[None]),
    (MethodName::Gaussian, &[None]),
    (MethodName::GaussLegendre, &[Some(2), Some(4), Some(8), Some(16), Some(32), Some(64)]),
    (MethodName::Segments, &[Some(1), Some(4), Some(16), Some(64), Some(256)]),
    (MethodName::Corners, &[None, Some(2), Some(4), Some(8)]),
    (
        MethodName::Samples,
        &[Some(4), Some(8), Some(16), Some(32), Some(64), Some(128), Some(256), Some(512), Some(1024)],
    ),
    (MethodName::EffectivePsf, &[None, Some(16), Some(64), Some(256), Some(1024)]),
    (MethodName::ZonalPsf, &[None, Some(16), Some(64), Some(256)]),
];
const QUICK: [Trial; 8] = [
    (MethodName::Static, &[None]),
    (MethodName::Gaussian, &[None]),
    (MethodName::GaussLegendre, &[Some(4), Some(8), Some(16)]),
    (MethodName::Segments, &[Some(4), Some(16), Some(64)]),
    (MethodName::Corners, &[None, Some(4)]),
    (MethodName::Samples, &[Some(4), Some(16), Some(64), Some(256)]),
    (MethodName::EffectivePsf, &[None, Some(64)]),
    (MethodName::ZonalPsf, &[None]),
];
/// Methods for scenes without motion, whose nodes are all in one place.
const STILL: [Trial; 3] =
    [(MethodName::Static, &[None]), (MethodName::Samples, &[Some(4)]), (MethodName::EffectivePsf, &[Some(4)])];

/// Returns the planner's choice and every method that is tried on `scene`.
fn trials(scene: &Scene, quick: bool) -> Vec<MethodChoice> {
    let list: &[Trial] = match (scene.motion, quick) {
        (Movement::Still, _) => &STILL,
        (_, true) => &QUICK,
        (_, false) => &WHOLE,
    };
    let fixed = list.iter().flat_map(|(name, numbers)| numbers.iter().map(|n| MethodChoice::Fixed(*name, *n)));
    core::iter::once(MethodChoice::Auto).chain(fixed).collect()
}

/// Measures all methods on `scene` by all `drawers`.
///
/// # Errors
/// When a backend fails at the planner's own choice.
pub fn measure_scene(
    scene: &Scene,
    settings: &Settings,
    drawers: &mut [Drawer],
    effort: Effort,
    mut begin: impl FnMut(String),
    rows: &mut Vec<MethodRow>,
) -> Result<(), Refused> {
    let stage = Stage::new(scene, settings.seed).map_err(stage::camera_refused)?;
    let effort = if scene.is_for_speed() { effort.times(SPEED_EFFORT) } else { effort };
    let mut known = None;
    for drawer in drawers {
        begin(format!("{}, {}", scene.title, drawer.name()));
        for choice in trials(scene, settings.quick) {
            let planner = stage.planner(drawer.cost(), choice);
            let mut row = blank_row(scene.name, drawer.name(), choice);
            row.note = scene.note.into();
            match measure(&stage, planner, drawer, effort, &mut known, &mut row) {
                Ok(()) => {}
                Err(source) if choice == MethodChoice::Auto => {
                    return Err(Refused(format!(
                        "scene {scene}, {backend} backend: {source}",
                        scene = scene.name,
                        backend = drawer.name()
                    )));
                }
                Err(error) => refuse(&mut row, &error),
            }
            rows.push(row);
        }
    }
    Ok(())
}

/// Marks a row that a backend refused to draw.
pub fn refuse(row: &mut MethodRow, error: &Refused) {
    row.verdict = NOT_DRAWN.into();
    row.note = error.to_string();
}

/// Plans, draws, times and compares; `known` keeps the truth for the next method.
///
/// # Errors
/// When the backend refuses the plan or fails.
pub fn measure(
    stage: &Stage,
    mut planner: Planner,
    drawer: &mut Drawer,
    effort: Effort,
    known: &mut Option<Truth>,
    row: &mut MethodRow,
) -> Result<(), Refused> {
    let plan = planner.plan(&stage.sources);
    row.promise(&plan.chosen);
    row.stars = plan.stars.len();
    let part = stage.measured_part(plan);
    row.brightest_e = brightest_e(&part);
    let image = drawer.picture(&part)?;
    let truth = Truth::of(known, &part)?;
    let errors = Errors::of(&image, truth, &part);
    (row.centroid_px, row.flux_rel, row.pixel_sigma) = (errors.centroid_px, errors.flux_rel, errors.pixel_sigma);
    row.l1_rel = errors.l1_rel;
    let drawing = effort.time(|| drawer.draw(plan))?;
    let planning = effort.time(|| {
        planner.plan(&stage.sources);
        Ok::<_, Refused>(())
    })?;
    (row.draw_ms, row.plan_ms) = (drawing.median_ms, planning.median_ms);
    row.fastest_ms = drawing.least_ms;
    Ok(())
}

/// The reference's image, and its stars.
#[derive(Debug)]
pub struct Truth {
    ids: Vec<u32>,
    picture: Picture,
}

impl Truth {
    /// Returns the known image, or a new one if the stars differ.
    fn of<'a>(known: &'a mut Option<Self>, plan: &ExposurePlan) -> Result<&'a Picture, Refused> {
        let ids: Vec<u32> = plan.stars.iter().map(|star| star.id).collect();
        let truth = match known.take() {
            Some(truth) if truth.ids == ids => truth,
            _ => Self { ids, picture: truth(plan)? },
        };
        Ok(&known.insert(truth).picture)
    }
}

/// Returns a row without values.
pub fn blank_row(scene: &str, backend: &str, choice: MethodChoice) -> MethodRow {
    let (method, parameter) = match choice {
        MethodChoice::Auto => ("auto", None),
        MethodChoice::Fixed(name, number) => (name.name(), number),
    };
    MethodRow {
        backend: backend.into(),
        scene: scene.into(),
        method: method.into(),
        parameter,
        drawn: String::new(),
        nodes: 0,
        verdict: String::new(),
        bound_centroid_px: f64::NAN,
        bound_flux_rel: f64::NAN,
        bound_pixel_sigma: f64::NAN,
        predicted_ms: f64::NAN,
        centroid_px: f64::NAN,
        flux_rel: f64::NAN,
        pixel_sigma: f64::NAN,
        l1_rel: f64::NAN,
        plan_ms: f64::NAN,
        draw_ms: f64::NAN,
        fastest_ms: f64::NAN,
        stars: 0,
        brightest_e: 0.0,
        read_noise_e: READ_NOISE_E,
        note: String::new(),
    }
}

// Centroid error against the number of nodes, with the bound beside it, for the methods that count nodes.

/// Methods with a variable number of nodes.
const SHOWN: [MethodName; 3] = [MethodName::Samples, MethodName::Segments, MethodName::GaussLegendre];

/// Returns charts of the charted scenes, with their file names, by the first backend.
pub fn error_by_nodes_charts(rows: &[MethodRow], scenes: &[Scene], backends: &[&str]) -> Vec<(String, Chart)> {
    let Some(backend) = backends.first() else { return Vec::new() };
    let charted = scenes.iter().filter(|scene| scene.is_charted);
    charted
        .map(|scene| (format!("error_by_nodes_{}", scene.name), error_by_nodes_chart(rows, scene, backend)))
        .collect()
}

/// Returns the chart of one scene.
pub fn error_by_nodes_chart(rows: &[MethodRow], scene: &Scene, backend: &str) -> Chart {
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
    let title = format!("{}: error by number of nodes, {backend} backend", scene.title);
    Chart::new(title, Axis::log("nodes per star"), Axis::log("5 x 5 centroid error, px"), series).noted(
        "Worst star against the f64 reference; dashed: the bound known before drawing. Segments carry two nodes each.",
    )
}

// Centroid error against time: all methods on one scene by one backend, the Pareto front, the planner's choice.

/// Returns charts of the charted scenes with their file names; those of the first backend have the scene's name alone.
pub fn speed_accuracy_charts(rows: &[MethodRow], scenes: &[Scene], backends: &[&str]) -> Vec<(String, Chart)> {
    let charted = || scenes.iter().filter(|scene| scene.is_charted);
    let named = |(i, backend): (usize, &&str), scene: &Scene| {
        let suffix = if i == 0 { String::new() } else { format!("_{backend}") };
        (format!("speed_accuracy_{}{suffix}", scene.name), speed_accuracy_chart(rows, scene, backend))
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
pub fn speed_accuracy_chart(rows: &[MethodRow], scene: &Scene, backend: &str) -> Chart {
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
