//! One scene, every method, every backend -> rows.

use super::error;
use crate::chart::Settings;
use crate::chart::drawer::{Drawer, Picture, truth};
use crate::chart::measure::{Errors, brightest_e};
use crate::chart::rows::{MethodRow, NOT_DRAWN};
use crate::chart::scenes::{Movement, Scene};
use crate::chart::stage::{READ_NOISE_E, Stage};
use crate::chart::timing::Effort;
use base::refused::Refused;
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
    let stage = Stage::new(scene, settings.seed).map_err(error::camera)?;
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
