//! `Camera`: single images.

use crate::errors::{NotDrawn, refused};
use crate::frame::{Drawn, Frame, Pixels};
use crate::request::{Request, SceneKeys, Stage};
use base::time::Tai;
use batch::still::{Still, StillParams, still_fault_of};
use config::{Backend, Bench, Document};
use core::time::Duration;
use frames::report::Stage as TimeStage;
use image::gpu::Electrons;
use pyo3::prelude::*;
use run::{runtime::engine::Light, wiring::memory::RunMemory};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Prepared scenes that a camera keeps: the latest.
const KEPT: usize = 4;

/// A camera that draws single images.
#[pyclass(frozen)]
pub(crate) struct Camera {
    camera: config::Camera,
    prepared: Mutex<Vec<(SceneKeys, Still)>>,
}

#[pymethods]
impl Camera {
    /// Reads a camera or run file, or one that is built in.
    #[staticmethod]
    fn open(py: Python<'_>, path: &str) -> PyResult<Self> {
        py.detach(|| {
            let document = Document::open(Path::new(path)).map_err(refused)?;
            Self::of(&document)
        })
    }

    /// Reads the text of a camera file; files that it names are relative to `folder`.
    #[staticmethod]
    fn parse(text: &str, folder: &str) -> PyResult<Self> {
        Self::of(&Document::from_text(text, &Path::new(folder).join("camera.toml")))
    }

    /// Returns the facts of the camera as JSON.
    fn facts(&self) -> String {
        let camera = &self.camera;
        json!({
            "name": camera.name,
            "width_px": camera.detector.width_px,
            "height_px": camera.detector.height_px,
            "fov_deg": camera.fov_deg(),
            "exposure_s": camera.exposure.exposure_s,
        })
        .to_string()
    }

    /// Draws an image from keywords given as JSON; the interpreter lock is released meanwhile.
    fn render(&self, py: Python<'_>, keywords: &str) -> PyResult<Frame> {
        let request = Request::parse(keywords).map_err(refused)?;
        let drawn = py.detach(|| self.draw(&request))?;
        Frame::new(py, drawn)
    }

    /// Returns the plan of an image as JSON: method, stars, errors that are bounded, predicted cost; draws it first.
    fn plan(&self, py: Python<'_>, keywords: &str) -> PyResult<String> {
        let request = Request::parse(keywords).map_err(refused)?;
        Ok(py.detach(|| self.with(&request, |still| planned(still, &request)))?)
    }
}

impl Camera {
    fn of(document: &Document) -> PyResult<Self> {
        let camera = if config::is_camera(document) {
            config::Camera::from_document(document).map_err(refused)?
        } else {
            config::Scenario::from_document(document).map_err(refused)?.bench.camera
        };
        Ok(Self { camera, prepared: Mutex::default() })
    }

    fn draw(&self, request: &Request) -> Result<Drawn, NotDrawn> {
        self.with(request, |still| {
            draw(still, request)?;
            drawn(still, request.stage)
        })
    }

    /// Calls `act` with what was prepared for the scene of a request, now or for an earlier image.
    fn with<T>(&self, request: &Request, act: impl FnOnce(&mut Still) -> Result<T, String>) -> Result<T, NotDrawn> {
        let mut prepared = self.prepared.lock().unwrap_or_else(PoisonError::into_inner);
        match prepared.iter().position(|(keys, _)| *keys == request.scene) {
            // The latest comes first.
            Some(place) => prepared[..=place].rotate_right(1),
            None => {
                prepared.truncate(KEPT - 1);
                prepared.insert(0, (request.scene.clone(), self.prepare(&request.scene, request.at()?)?));
            }
        }
        Ok(act(&mut prepared[0].1)?)
    }

    fn prepare(&self, scene: &SceneKeys, at: Tai) -> Result<Still, NotDrawn> {
        let text = toml::to_string(&scene.bench).map_err(|error| error.to_string())?;
        let document = Document::from_text(&text, Path::new("keywords.toml"));
        let mut bench = Bench::from_document(&document).map_err(|error| error.to_string())?;
        bench.camera = self.camera.clone();
        bench.seed = scene.seed.unwrap_or(1);
        bench.noise_seed_given = Some(scene.noise_seed.unwrap_or(bench.seed));
        let faults = scene.faults.iter().map(|keys| still_fault_of(keys.clone())).collect::<Result<Vec<_>, _>>();
        let faults = faults.map_err(|error| error.to_string())?;
        // More memory than there is must not be asked for: the interpreter would end with all that it holds.
        let is_reference = bench.render.backend == Backend::Reference;
        let memory = RunMemory::of_image(&bench.camera, is_reference, None);
        memory.check().map_err(|error| NotDrawn::TooLarge(error.to_string()))?;
        let still = Still::new(&StillParams { bench: &bench, span: [at, at], faults: &faults });
        Ok(still.map_err(|error| error.to_string())?)
    }
}

fn draw(still: &mut Still, request: &Request) -> Result<Duration, String> {
    let motion = request.motion(still.params().camera.exposure_s)?;
    let (sources, is_on_sky) = (request.sources()?, request.has_attitude());
    let light = match &sources {
        Some(sources) => Light::Sources { sources, is_on_sky },
        None => Light::Sky,
    };
    let drawn = match request.stage {
        Stage::Dn => still.draw(&motion, light, request.frame),
        Stage::Electrons => still.draw_mean(&motion, light, request.frame),
    };
    let times = drawn.map_err(|error| error.to_string())?;
    let ns = times.get(TimeStage::Plan).map_or(0, |span| u64::try_from(span.ns()).unwrap_or_default());
    Ok(Duration::from_nanos(ns))
}

fn drawn(still: &Still, stage: Stage) -> Result<Drawn, String> {
    let frame = still.frame();
    match (stage, still.mean()) {
        (Stage::Dn, _) => Ok(Drawn::of(frame)),
        (Stage::Electrons, Electrons::Host(image)) => {
            let pixels = Pixels::Electrons(image.pixels().to_vec());
            Ok(Drawn::new(pixels, [image.height(), image.width()], frame))
        }
        (Stage::Electrons, Electrons::Precise(image)) => {
            let pixels = Pixels::Precise(image.pixels().to_vec());
            Ok(Drawn::new(pixels, [image.height(), image.width()], frame))
        }
        (Stage::Electrons, Electrons::Device(_)) => Err("the image is still on its device".into()),
    }
}

fn planned(still: &mut Still, request: &Request) -> Result<String, String> {
    let planning = draw(still, request)?;
    let plan = still.plan();
    let (chosen, budget) = (&plan.chosen, &still.params().budget);
    let facts: Value = json!({
        "method": chosen.method.to_string(),
        "stars": plan.stars.len(),
        "predicted_ms": chosen.cost_ms,
        "planning_ms": planning.as_secs_f64() * 1e3,
        "is_within_budget": chosen.verdict.is_met(),
        "centroid_budget_px": budget.centroid_px,
        "backend": still.imager().name(),
    });
    Ok(facts.to_string())
}
