//! The camera of one shard and its images.
//!
//! In: a description and the number of a shard. Out: a camera and a bench with the keys that were drawn for this shard,
//! ready to draw ([`Studio`]); then, for the number of an item, its image, truth and labels ([`Item`]). A camera with image
//! lag is refused: its images depend on the images before them. Tests: below.

use crate::distribution::{Draws, Purpose};
use crate::outline::{Mean, Outline};
use crate::{distribution::drawn_table, recipe::Recipe, spec::Spec};
use anyhow::{Context, Result, bail};
use base::time::Span;
use batch::still::{Still, StillParams, stays};
use config::{Bench, Camera, Document, Scenario, Setting, TargetSettings, is_camera};
use frames::sink::{FrameFault, SentFrame, TruthKind};
use image::gpu::Electrons;
use plan::exposure::target::Target;
use run::wiring::sensitivity::{Conditions, Sensitivity};
use run::{runtime::engine::Light, wiring::bench_parts::scripted};
use std::path::Path;
use toml::Table;

/// One image with its labels.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// Everything that was drawn for it.
    pub recipe: Recipe,
    /// Shard whose camera drew it.
    pub shard: u32,
    /// Image, truth and metadata.
    pub frame: SentFrame,
    /// Signal-to-noise ratio of each row of the truth.
    pub snr: Vec<f64>,
    /// Boxes and masks of the targets.
    pub outlines: Vec<Outline>,
}

/// The camera of a shard, ready to draw.
pub struct Studio {
    spec: Spec,
    /// The number of its shard.
    pub shard: u32,
    bench: Bench,
    still: Still,
    /// Targets of the bench itself.
    own_targets: Vec<TargetSettings>,
    sensitivity: Sensitivity,
    ifov_arcsec: f64,
    /// Keys that were drawn for the camera and the bench, as JSON.
    pub drawn_keys: String,
}

impl Studio {
    /// Makes the camera of a shard.
    ///
    /// # Errors
    /// When the camera or the bench cannot be used, or has image lag.
    pub fn new(spec: &Spec, shard: u32) -> Result<Self> {
        let camera_keys = drawn_keys(&spec.draw.camera, spec.seed, shard, Purpose::Camera).context("draw.camera")?;
        let bench_keys = drawn_keys(&spec.draw.bench, spec.seed, shard, Purpose::Bench).context("draw.bench")?;
        let mut bench = bench_of(spec, &bench_keys).context("bench")?;
        bench.camera = Self::camera_of(spec, shard)?;
        let sensor_seed = spec.seed.wrapping_add(u64::from(shard));
        (bench.seed, bench.noise_seed_given) = (sensor_seed, Some(spec.seed));
        let still = still_of(spec, &bench)?;
        if still.params().camera.detector.spatial.image_lag.is_some() {
            bail!(
                "camera \"{}\" has image lag: each image depends on the images before it; give the data set a camera without it",
                bench.camera.name
            );
        }
        let sensitivity = Sensitivity::new(&still.params().camera, &Conditions::default());
        let ifov_arcsec = bench.camera.ifov_arcsec();
        let own_targets = bench.targets.clone();
        let drawn_keys = serde_json::json!({ "camera": camera_keys, "bench": bench_keys }).to_string();
        Ok(Self { spec: spec.clone(), shard, bench, still, own_targets, sensitivity, ifov_arcsec, drawn_keys })
    }

    /// Returns the camera of a shard, with the keys that are drawn for it.
    ///
    /// # Errors
    /// When the camera file is refused.
    pub fn camera_of(spec: &Spec, shard: u32) -> Result<Camera> {
        let keys = drawn_keys(&spec.draw.camera, spec.seed, shard, Purpose::Camera).context("draw.camera")?;
        camera_of(spec, &keys).context("camera")
    }

    /// Returns the camera file as it is drawn with.
    pub fn camera(&self) -> &Camera {
        &self.bench.camera
    }

    /// Returns whether items may have targets.
    pub fn has_targets(&self) -> bool {
        !self.own_targets.is_empty() || !self.spec.targets.is_empty()
    }

    /// Returns the columns and rows of its images.
    pub fn size_px(&self) -> [usize; 2] {
        self.still.params().camera.output().size_px
    }

    /// Draws an item.
    ///
    /// # Errors
    /// When a drawn value cannot be used, or the image cannot be drawn.
    pub fn item(&mut self, number: u32) -> Result<Item> {
        let recipe = Recipe::new(&self.spec, number, self.ifov_arcsec).with_context(|| format!("item {number}"))?;
        let targets = self.targets_of(&recipe)?;
        let (snr_of, threshold_e) = (self.sensitivity.window.noise(&self.sensitivity.pixel), self.threshold_e());
        let frame = if recipe.faults.iter().any(|(_, fault)| stays(fault)) {
            // A change that stays in a detector must not reach the next item.
            let mut own = still_of(&self.spec, &self.bench)?;
            drawn(&mut own, &recipe, &targets, threshold_e)?
        } else {
            drawn(&mut self.still, &recipe, &targets, threshold_e)?
        };
        let (frame, outlines) = frame;
        let snr = frame.truth.iter().map(|row| if is_point(row.kind) { snr_of.snr(row.electrons) } else { f64::NAN });
        Ok(Item { snr: snr.collect(), recipe, shard: self.shard, frame, outlines })
    }

    /// Returns the scripted targets of an item: those of the bench, and those that were drawn, from its exposure on.
    fn targets_of(&mut self, recipe: &Recipe) -> Result<Vec<Target>> {
        let params = self.still.params();
        let start = recipe.at - Span::from_s(0.5 * params.camera.exposure_s);
        self.bench.targets = self.own_targets.iter().chain(&recipe.targets).cloned().collect();
        scripted(&self.bench, &params.camera, start)
    }

    /// Returns the light from which on an output pixel belongs to a target, e-.
    fn threshold_e(&self) -> f64 {
        let by = f64::from(self.still.params().camera.output().binning);
        self.spec.output.mask_snr * by * self.sensitivity.pixel.variance_e2().sqrt()
    }
}

/// Draws the image of a recipe, then each of its targets alone for its outline.
fn drawn(
    still: &mut Still,
    recipe: &Recipe,
    targets: &[Target],
    threshold_e: f64,
) -> Result<(SentFrame, Vec<Outline>)> {
    let faults: Vec<FrameFault> = recipe.faults.iter().map(|(_, fault)| *fault).collect();
    still.set_faults(&faults, first_fault_number(recipe.item))?;
    still.set_targets(targets);
    let motion = recipe.motion(still.params().camera.exposure_s);
    still.draw(&motion, Light::Sky, recipe.item)?;
    let frame = still.frame().clone();
    let planned: Vec<Target> = still.plan().targets.iter().map(|planned| planned.target).collect();
    let camera = &still.params().camera;
    let (output, width_px) = (camera.output(), camera.geometry.width_px());
    let mut outlines = Vec::new();
    for target in &planned {
        still.draw_target_alone(target)?;
        let Electrons::Host(mean) = still.mean() else { bail!("outlines of targets: wanted the backend cpu or gpu") };
        let mean = Mean { electrons: mean.pixels(), width_px };
        outlines.extend(Outline::of(target.id, &mean, &output, threshold_e));
    }
    Ok((frame, outlines))
}

/// Returns the number of the first fault of an item: it gives random places, so that they differ from item to item.
fn first_fault_number(item: u32) -> u16 {
    const MOST_FAULTS: u32 = 64;
    #[allow(clippy::cast_possible_truncation, reason = "below 2^16")]
    let number = (1 + item.wrapping_mul(MOST_FAULTS) % (u32::from(u16::MAX) - MOST_FAULTS)) as u16;
    number
}

fn is_point(kind: TruthKind) -> bool {
    match kind {
        TruthKind::Star | TruthKind::Target | TruthKind::FalseStar => true,
        TruthKind::Planet | TruthKind::Moon | TruthKind::Earth | TruthKind::ProtonTrack => false,
    }
}

/// Returns the keys of a shard with numbers in the place of distributions.
fn drawn_keys(keys: &Table, seed: u64, shard: u32, purpose: Purpose) -> Result<Table> {
    drawn_table(keys, &mut Draws::new(seed, shard, purpose))
}

/// Returns a document with drawn values.
fn with_keys(document: Document, keys: &Table) -> Result<Document> {
    let settings = keys.iter().map(|(key, value)| Setting::parse(&format!("{key}={value}")));
    Ok(document.with_settings(settings.collect::<Result<_, _>>()?))
}

fn bench_of(spec: &Spec, keys: &Table) -> Result<Bench> {
    match &spec.bench {
        Some(path) => Ok(Scenario::from_document(&with_keys(Document::open(path)?, keys)?)?.bench),
        // Nothing but the stars, from the centre of the Earth: the defaults of an empty file.
        None => {
            let empty = Document::from_text("", Path::new("a bench without keys"));
            Ok(Bench::from_document(&with_keys(empty, keys)?)?)
        }
    }
}

fn camera_of(spec: &Spec, keys: &Table) -> Result<Camera> {
    let document = Document::open(&spec.camera)?;
    if is_camera(&document) {
        return Ok(Camera::from_document(&with_keys(document, keys)?)?);
    }
    if !keys.is_empty() {
        bail!("{}: a run file; wanted a camera file, whose keys can be drawn", spec.camera.display());
    }
    Ok(Scenario::from_document(&document)?.bench.camera)
}

fn still_of(spec: &Spec, bench: &Bench) -> Result<Still> {
    Ok(Still::new(&StillParams { bench, span: spec.span, faults: &[] })?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(rest: &str) -> Spec {
        let begin = "name = \"x\"\ncamera = \"cameras/small_tracker.toml\"\n";
        Spec::parse(&format!("{begin}{rest}"), Path::new(".")).unwrap()
    }

    const EVERYTHING: &str = "[motion]\nrate_deg_s = { uniform = [0, 1] }\njitter_arcsec = { uniform = [0, 60] }\n\
        [[fault]]\nprobability = 0.4\ndo = \"stray_light\"\ne_per_s = { log_uniform = [10, 1000] }\n\
        [[fault]]\nprobability = 0.4\ndo = \"hot_pixels\"\ncount = 5\ne_per_s = 1e5\n\
        [[fault]]\nprobability = 0.4\ndo = \"false_stars\"\ncount = 3\nmag = 4.0\n\
        [[target]]\ncount = { integer = [0, 2] }\nmag = 3\nvelocity_px_s = [{ normal = [0, 200] }, 0]\n\
        position_px = [{ uniform = [20, 230] }, { uniform = [20, 230] }]\n";

    #[test]
    fn item_is_the_same_alone_and_after_others() {
        let spec = spec(EVERYTHING);
        let mut first = Studio::new(&spec, 0).unwrap();
        let items: Vec<Item> = (0..8).map(|item| first.item(item).unwrap()).collect();
        assert!(
            items.iter().any(|item| !item.outlines.is_empty()) && items.iter().any(|item| item.recipe.faults.len() > 1)
        );
        let mut other = Studio::new(&spec, 0).unwrap();
        for number in [6, 1, 3] {
            assert_eq!(other.item(number).unwrap(), items[number as usize], "item {number}");
        }
        assert_ne!(items[0].frame.image, items[1].frame.image);
    }

    #[test]
    fn every_shard_has_its_own_camera() {
        let keys = "[draw.camera]\n\"detector.black_level_dn\" = { uniform = [50, 200] }\n\
                    [draw.bench]\n\"observer.kind\" = \"circular_orbit\"\n\
                    \"observer.altitude_km\" = { uniform = [400, 800] }\n";
        let spec = spec(keys);
        let [first, second] = [0, 1].map(|shard| Studio::new(&spec, shard).unwrap());
        assert_ne!(first.drawn_keys, second.drawn_keys);
        assert_ne!(first.camera().detector.params.black_level_dn, second.camera().detector.params.black_level_dn);
        assert_eq!(first.drawn_keys, Studio::new(&spec, 0).unwrap().drawn_keys);
    }

    #[test]
    fn outlines_are_where_the_truth_has_the_targets() {
        let spec = spec(EVERYTHING);
        let mut studio = Studio::new(&spec, 0).unwrap();
        let items: Vec<Item> = (0..10).map(|item| studio.item(item).unwrap()).collect();
        let mut seen = 0;
        for item in &items {
            for outline in &item.outlines {
                let row = item.frame.truth.iter().find(|row| row.id == outline.id).unwrap();
                let [x, y, width, height] = outline.box_px.map(|side| side as f64);
                assert!((x - 1.0..=x + width).contains(&row.x_px) && (y - 1.0..=y + height).contains(&row.y_px));
                assert!(
                    outline.area_px > 0
                        && width >= 0.9 * row.smear_px.min(200.0) * row.smear_deg.to_radians().cos().abs() - 2.0
                );
                seen += 1;
            }
        }
        assert!(seen > 3);
    }

    #[test]
    fn cameras_whose_images_depend_on_each_other_are_refused() {
        let lag = "[draw.camera]\n\"detector.image_lag.share\" = 0.1\n";
        let error = format!("{:#}", Studio::new(&spec(lag), 0).map(|_| ()).unwrap_err());
        assert!(error.contains("image lag"), "{error}");
        let key = "[draw.camera]\n\"detector.colour\" = 0.1\n";
        assert!(format!("{:#}", Studio::new(&spec(key), 0).map(|_| ()).unwrap_err()).contains("colour"));
    }
}
