//! Fields from layers of 37 million stars to G = 15: finding the tiles of a field, and a whole frame of 300,000 stars.
//!
//! The sky is a synthetic population, made once in the folder of the build (600 MB, some minutes);
//! `STARLOOP_BENCH_STARS` asks for another number of stars.
//!
//! * `cone`: the tiles of a field, all in memory; what it takes the first time is printed.
//! * `dense`: 2048 x 2048 pixels, jitter of 0.4 px, CPU: stars to sources, planning, drawing, and all together; all together
//!   also with 0.5 px, where one shape for the whole field is not enough, and the splat alone: without motion.
#![allow(missing_docs, reason = "criterion's macros make undocumented functions")]

use base::{
    accuracy::AccuracyBudget, axes::sensor_from_ra_dec_roll, clock::Stopwatch, source::direction_from_ra_dec,
    time::Tai, units::DEG,
};
use config::{Camera, Document};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use glam::DVec3;
use image::render::{Backend, cpu::Cpu};
use imports::synthetic::Population;
use plan::attitude::{JitterLine, LosPath};
use plan::exposure::cost::CostModel;
use plan::exposure::{MethodChoice, Planner};
use run::wiring::camera_parts::camera_params;
use scene::{camera::CameraParams, sky_view::SkyView};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};
use sky::observer::{Observer, ObserverTrack};
use stars::tiles::{Light, TileSky};
use stars::{Sky, layer::LayerSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Gaia has so many stars brighter than 15.
const STARS: f64 = 37e6;
const LIMITS_MAG: [f32; 2] = [10.0, 15.0];
const MEMORY_MB: u32 = 1024;
/// Name, right ascension, declination.
const PLACES: [(&str, f64, f64); 3] =
    [("Galactic centre", 266.4, -29.0), ("Galactic pole", 192.9, 27.1), ("celestial pole", 0.0, 90.0)];

fn layers() -> Vec<PathBuf> {
    let stars = std::env::var("STARLOOP_BENCH_STARS").ok().and_then(|text| text.parse().ok()).unwrap_or(STARS);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("synthetic_sky_{stars}"));
    let paths: Vec<PathBuf> = LIMITS_MAG.iter().map(|limit| folder.join(format!("g{limit}.starlayer"))).collect();
    if !paths.iter().all(|path| path.exists()) {
        println!("making {stars} stars in {} ...", folder.display());
        let mut watch = Stopwatch::start();
        let population = Population::new(&LIMITS_MAG, Some(stars), 1).expect("a population");
        population.write(&folder, &mut |_| {}).expect("space on the disk");
        println!("made in {:.0} s", watch.lap().s());
    }
    paths
}

fn cone(c: &mut Criterion) {
    let paths = layers();
    let mut group = c.benchmark_group("cone");
    group.sample_size(30);
    let set = Arc::new(LayerSet::open(&paths, 15.0).expect("layers"));
    println!("{} stars", set.layers().map(|layer| layer.stars()).sum::<u64>());
    for (name, ra_deg, dec_deg) in PLACES {
        let axis = direction_from_ra_dec(ra_deg * DEG, dec_deg * DEG);
        for radius_deg in [0.5, 5.0, 10.0] {
            let light = Light::new(|mag_g, _| (f64::from(mag_g), mag_g));
            let mut sky = TileSky::new(Arc::clone(&set), light, 20_000_000);
            let mut watch = Stopwatch::start();
            sky.take_field(axis, radius_deg * DEG).expect("a field");
            let first_ms = watch.lap().ms();
            let stars: usize = sky.blocks().map(<[_]>::len).sum();
            println!(
                "{name}, {radius_deg} deg: {stars} stars in {} tiles, first time {first_ms:.1} ms",
                sky.blocks().count()
            );
            group.bench_function(BenchmarkId::new(name, radius_deg), |b| {
                b.iter(|| sky.take_field(axis, radius_deg * DEG).expect("a field"));
            });
        }
    }
    group.finish();
}

/// Returns a deep sky about the Galactic centre, 2 degrees around.
fn deep_layers() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("synthetic_centre_18");
    let paths: Vec<PathBuf> = DEEP_MAG.iter().map(|limit| folder.join(format!("g{limit}.starlayer"))).collect();
    if !paths.iter().all(|path| path.exists()) {
        let population = Population::new(&DEEP_MAG, None, 1).expect("a population");
        let (_, ra_deg, dec_deg) = PLACES[0];
        let axis = direction_from_ra_dec(ra_deg * DEG, dec_deg * DEG);
        population.around(axis, 2.0 * DEG).write(&folder, &mut |_| {}).expect("space on the disk");
    }
    paths
}

const DEEP_MAG: [f32; 2] = [14.0, 18.0];

/// Returns a camera whose field about the Galactic centre, 2.5 degrees square, has some 300,000 stars.
fn dense_camera() -> CameraParams {
    let file = Document::built_in("cameras/detection_limit_22mag.toml").expect("a built-in file");
    let mut camera = camera_params(&Camera::from_document(&file).expect("a camera")).expect("a camera");
    camera.geometry = CameraGeometry::new(CameraParameters {
        width_px: 2048,
        height_px: 2048,
        focal_px: [FOCAL_PX; 2],
        principal_point_px: [1023.5; 2],
        distortion: BrownConrady::default(),
    })
    .expect("a camera");
    camera.limiting_mag = 18.0;
    camera
}

const FOCAL_PX: f64 = 46_900.0;
/// Jitter, px: up to the first one shape serves all stars of the field.
const JITTER_PX: [f64; 2] = [0.4, 0.5];

fn dense(c: &mut Criterion) {
    let camera = dense_camera();
    let sky = Sky::open(&deep_layers(), camera.limiting_mag, MEMORY_MB).expect("a sky");
    let at = Tai::from_rfc3339("2026-03-01T00:00:00Z").expect("an instant");
    let (_, ra_deg, dec_deg) = PLACES[0];
    let attitude = sensor_from_ra_dec_roll(ra_deg * DEG, dec_deg * DEG, 0.0);
    let los = |jitter_px: f64| {
        let mut los = LosPath::commanded(attitude, at, camera.exposure_s);
        los.jitter.lines = vec![JitterLine {
            frequency_hz: 2.25 / camera.exposure_s,
            amplitude_rad: DVec3::new(0.28, -0.96, 0.0) * (jitter_px / FOCAL_PX),
            phase_rad: 0.4,
        }];
        los
    };
    let still = LosPath::commanded(attitude, at, camera.exposure_s);
    let planner = |los: &LosPath| {
        let budget = AccuracyBudget::default();
        Planner::new(camera.instrument(), budget, CostModel::CPU, MethodChoice::Auto, los.clone())
    };
    let mut view = SkyView::new(&camera, ObserverTrack::new(Observer::Geocentre, at), &sky);
    let mut backend = Cpu::new(2048, 2048);
    let mut group = c.benchmark_group("dense");
    group.sample_size(20);
    let path = los(JITTER_PX[0]);
    group.bench_function("sky", |b| b.iter(|| view.find_in_view(&path).expect("stars")));
    let mut stages = planner(&path);
    group.bench_function("plan", |b| b.iter(|| stages.plan(view.found()).stars.len()));
    let plan = stages.latest().clone();
    group.bench_function("draw", |b| b.iter(|| backend.render(&plan).expect("draws")));
    let whole = JITTER_PX.map(|px| (format!("sky, plan and draw, jitter {px} px"), los(px)));
    for (name, path) in whole.into_iter().chain([("sky, plan and draw, no motion".into(), still)]) {
        let mut planner = planner(&path);
        let plan = planner.plan(view.found());
        for class in &plan.classes {
            println!("{name}: {} stars, {}", class.stars, class.chosen.method);
        }
        println!("predicted {:.1} ms to plan and draw", plan.chosen.cost_ms);
        group.bench_function(name, |b| {
            b.iter(|| {
                view.find_in_view(&path).expect("stars");
                backend.render(planner.plan(view.found())).expect("draws");
            });
        });
    }
    group.finish();
}

criterion_group!(benches, cone, dense);
criterion_main!(benches);
