//! Accuracy against speed, measured: every method, scene and backend -> CSV tables and SVG charts.
//!
//! In: [`Settings`]. Out: [`Charted`], texts of files and a table for a terminal; nothing here accesses a disk. Each
//! image is compared with the f64 reference of the same stars, image with image: an undersampled star's centroid has
//! its own S-curve. Bounds and predicted times are those the planner knew before drawing.
//!
//! ```text
//! scenes -> stage (planner, stars) -> sweep (methods x backends: measure, timing) -> rows -> charts, verdicts
//! sampling, poisson, prediction, footprint, effects, crowding: tables and charts of their own
//! ```
//!
//! *Limits.* Times are medians on the present machine, including its other load, with the fastest beside them;
//! predicted times are those of planning and drawing. Errors on fields of many stars are those of a few isolated stars.
//! *Validation.* `tests/physics/chart.rs` runs the quick form.

use base::refused::Refused;

pub mod crowding;
pub mod effects;
pub mod poisson;
pub mod prediction;
pub mod rows;
pub mod sampling;
pub mod scenes;
pub mod stage;
pub mod sweep;

pub use rows::MethodRow;

use frames::report::{Chart, to_svg};
use rows::csv_text;
use stage::{Drawer, Effort};

/// Scope of the measurements.
#[derive(Debug, Clone)]
pub struct Settings {
    /// True for fewer parameters, frames and stars.
    pub quick: bool,
    /// Which backends.
    pub backends: Backends,
    /// Seed of random paths, star places and brightnesses.
    pub seed: u32,
}

/// Backends to measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backends {
    /// The CPU.
    Cpu,
    /// The GPU, or an error without one.
    Gpu,
    /// The CPU, and the GPU if there is one.
    All,
}

/// Progress of a chart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Number of parts done.
    pub done: usize,
    /// Number of all parts.
    pub total: usize,
    /// Name of the next part.
    pub next: String,
}

/// A file to write.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct File {
    /// Name, without a folder.
    pub name: String,
    /// Content.
    pub text: String,
}

/// All results.
#[derive(Debug, Clone)]
pub struct Charted {
    /// CSV tables and SVG charts.
    pub files: Vec<File>,
    /// Rows of `methods.csv`.
    pub methods: Vec<MethodRow>,
    /// Rows of `sampling.csv`.
    pub sampling: Vec<MethodRow>,
    /// The table for a terminal.
    pub summary: String,
}

/// Counts parts and announces each.
struct Steps<'a> {
    done: usize,
    total: usize,
    announce: &'a mut dyn FnMut(&Step),
}

impl Steps<'_> {
    fn begin(&mut self, next: impl Into<String>) {
        (self.announce)(&Step { done: self.done, total: self.total, next: next.into() });
        self.done += 1;
    }
}

/// Measures and draws everything; calls `announce` before every part.
///
/// # Errors
/// When the requested backend is not available, or fails.
pub fn run(settings: &Settings, announce: &mut dyn FnMut(&Step)) -> Result<Charted, Refused> {
    let (mut drawers, missing) = Drawer::open(settings.backends)?;
    let scenes = scenes::scenes(settings.quick);
    let effort = Effort::new(settings.quick);
    let sigmas_px = sampling::sigmas_px(settings.quick);
    // Poisson, prediction, footprint, effects and crowding follow the scenes and the samplings.
    let total = scenes.len() * drawers.len() + sigmas_px.len() + 5;
    let mut steps = Steps { done: 0, total, announce };
    let mut methods = Vec::new();
    for scene in &scenes {
        sweep::measure_scene(scene, settings, &mut drawers, effort, |name| steps.begin(name), &mut methods)?;
    }
    let mut samplings = Vec::new();
    for sigma_px in sigmas_px {
        steps.begin(format!("PSF sampling, sigma {sigma_px} px"));
        sampling::measure_all(*sigma_px, settings, &mut drawers, effort, &mut samplings)?;
    }
    let names: Vec<&str> = drawers.iter().map(Drawer::name).collect();
    let mut files = vec![csv("methods", &methods)?, csv("sampling", &samplings)?];
    files.extend(sweep::speed_accuracy_charts(&methods, &scenes, &names).iter().map(svg));
    files.extend(sweep::error_by_nodes_charts(&methods, &scenes, &names).iter().map(svg));
    files.push(svg(&("sampling".into(), sampling::chart(&samplings))));
    steps.begin("Poisson methods");
    let poisson = poisson::measure(settings.quick, effort)?;
    files.extend([csv("poisson", &poisson)?, svg(&("poisson".into(), poisson::chart(&poisson)))]);
    steps.begin("attitude prediction");
    let prediction = prediction::measure(settings.quick);
    files.push(csv("prediction", &prediction)?);
    files.extend(prediction::charts(&prediction).iter().map(svg));
    steps.begin("footprints");
    let footprint = sampling::measure_footprints();
    files.extend([csv("footprint", &footprint)?, svg(&("footprint".into(), sampling::footprint_chart(&footprint)))]);
    steps.begin("effects");
    let effects = effects::measure(settings.quick, &mut drawers)?;
    files.push(csv("effects", &effects)?);
    steps.begin("stars by number");
    let crowding = crowding::measure(settings, &mut drawers, effort)?;
    files.extend([csv("crowding", &crowding)?, svg(&("crowding".into(), crowding::chart(&crowding)))]);
    let notes: Vec<String> = drawers.iter().map(Drawer::description).chain(missing).collect();
    let summary = rows::summary(&methods, &samplings, &scenes, &notes)
        + &effects::summary(&effects)
        + &crowding::summary(&crowding);
    Ok(Charted { files, methods, sampling: samplings, summary })
}

fn csv<R: serde::Serialize>(name: &str, rows: &[R]) -> Result<File, Refused> {
    Ok(File {
        name: format!("{name}.csv"),
        text: csv_text(rows).map_err(|why| Refused(format!("rows do not go into CSV: {why}")))?,
    })
}

fn svg((name, chart): &(String, Chart)) -> File {
    File { name: format!("{name}.svg"), text: to_svg(chart) }
}
