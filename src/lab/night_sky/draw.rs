//! A camera file and an attitude -> the frame that starloop draws, with the truth about its stars.

use crate::sky_stars::When;
use base::axes::{Icrf, Rotation, Sensor};
use base::{accuracy::AccuracyBudget, time::Span};
use config::Camera;
use frames::sink::TruthStar;
use image::detector::{DetectorConditions, Seeds};
use plan::attitude::LosPath;
use plan::exposure::{MethodChoice, Motion, Planner};
use run::{runtime::Imager, wiring::camera_parts::camera_params};
use scene::{SceneParams, field_light::illumination_map, truth::fill_truth};
use sky::almanac::Almanac;
use stars::Sky;

use crate::picture::Picture;

/// A drawn frame.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// Its digital numbers.
    pub picture: Picture,
    /// Its stars.
    pub truth: Vec<TruthStar>,
}

/// Any error of the parts, with its causes.
type Failed = Box<dyn core::error::Error + Send + Sync>;

/// Draws one frame, as `starloop render` does, on the CPU.
///
/// # Errors
/// When a part of the program refuses the camera.
pub fn draw(
    camera: &Camera,
    attitude: Rotation<Sensor, Icrf>,
    sky: &Sky,
    when: &When,
    seed: u64,
) -> Result<Drawn, Failed> {
    let params = camera_params(camera)?;
    let at = when.time();
    let size = params.output().size_px;
    let seeds = Seeds { sensor: seed, noise: seed };
    let mut imager = Imager::of_detector(config::Backend::Cpu, params.make_detector(seeds)?)?;
    if let Some(map) = illumination_map(&params) {
        imager.set_illumination_map(map)?;
    }
    let scene_params = SceneParams {
        camera: &params,
        observer: &when.observer(),
        almanac: &Almanac::over(at, at),
        light_deflection: true,
        bodies: false,
        targets: &[],
    };
    let mut scene = scene::Scene::new(&scene_params, sky);
    let los = LosPath::commanded(attitude, at - Span::from_s(0.5 * params.exposure_s), params.exposure_s);
    let mut planner =
        Planner::new(params.instrument(), AccuracyBudget::default(), imager.cost, MethodChoice::default(), los.clone());
    *planner.motion_mut() = Motion { los: los.clone(), image_path: None };
    let report = scene.find(&los, true)?;
    planner.plan(scene.sources());
    let conditions = DetectorConditions::lit(params.exposure_s, report.background);
    let mut image = base::image::DnImage::new(size[0], size[1]);
    imager.image(planner.latest(), 0, &conditions, &mut image)?;
    let mut truth = Vec::new();
    fill_truth(planner.latest(), &params.output(), None, &mut truth);
    scene.stars.name_stars(&mut truth);
    let dn = image.pixels().iter().map(|dn| f32::from(*dn)).collect();
    Ok(Drawn { picture: Picture { size_px: size, dn }, truth })
}
