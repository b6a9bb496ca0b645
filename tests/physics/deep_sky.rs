//! Fields from layers on disk: the same sky as the catalog they were made of, tiles that are there when a slew comes to
//! them, and the two cases of dense-field simulation, magnitude 15 and 22 at a signal-to-noise ratio of 3, drawn and
//! counted.

use crate::noise::STANDARD_ERRORS;
use base::axes::{Icrf, Rotation, Sensor, sensor_from_ra_dec_roll};
use base::time::{Span, Tai};
use base::units::{DEG, MAS};
use base::{accuracy::AccuracyBudget, image::DnImage, source::ra_dec_rad};
use config::{Camera, Document};
use image::detector::DetectorConditions;
use plan::attitude::LosPath;
use plan::exposure::{MethodChoice, Planner, Source, SourcePlace};
use run::runtime::Imager;
use run::wiring::camera_parts::camera_params;
use scene::{camera::CameraParams, sky_view::SkyView};
use sky::astrometry::CameraGeometry;
use sky::observer::{Observer, ObserverTrack};
use stars::layer::{NewStar, Sorting};
use stars::{Sky, catalog::Catalog, numbering::stored_number, tiles::Shortfall};
use std::path::{Path, PathBuf};

const AT: &str = "2026-03-01T00:00:00Z";
const MEMORY_MB: u32 = 64;

fn camera(name: &str) -> (CameraParams, Camera) {
    let camera = Camera::from_document(&Document::built_in(&format!("cameras/{name}.toml")).unwrap()).unwrap();
    (camera_params(&camera).unwrap(), camera)
}

fn layers(folder: &Path, limits_mag: &[f32], stars: impl Iterator<Item = NewStar>) -> Vec<PathBuf> {
    let mut sorting = Sorting::start(&folder.join("work"), limits_mag).unwrap();
    for star in stars {
        sorting.add(&star).unwrap();
    }
    let reports = sorting.finish(folder, 2016.0, "", &mut |_| {}).unwrap();
    reports.into_iter().map(|report| report.path).collect()
}

fn built_in_layers(folder: &Path) -> Vec<PathBuf> {
    let catalog = Catalog::built_in().unwrap();
    let star = |star: &base::source::CatalogSource| {
        let [ra_rad, dec_rad] = ra_dec_rad(star.direction_icrf);
        NewStar {
            source_id: stored_number(star.source_id),
            ra_rad,
            dec_rad,
            motion_mas_yr: star.proper_motion.map(|m| [m.pm_ra_cosdec_mas_yr, m.pm_dec_mas_yr].map(f64::from)),
            parallax_mas: star.parallax_mas.map(f64::from),
            mag_g: f64::from(star.mag_g),
            bp_rp: Some(f64::from(star.bp_rp)),
        }
    };
    layers(folder, &[5.0, 7.0, 9.0], catalog.sources().iter().map(star))
}

fn place(source: &Source) -> glam::DVec3 {
    match source.place {
        SourcePlace::Icrf(direction) => direction,
        SourcePlace::Pixel(_) => panic!("stars of a sky have directions"),
    }
}

#[test]
fn layers_show_the_sky_of_the_catalog_they_were_made_of() {
    let folder = tempfile::tempdir().unwrap();
    let (camera, _) = camera("star_tracker_20deg");
    let at = Tai::from_rfc3339(AT).unwrap();
    let view = |sky: &Sky| SkyView::new(&camera, ObserverTrack::new(Observer::Geocentre, at), sky);
    let mut by_catalog = view(&Sky::open(&[], camera.limiting_mag, MEMORY_MB).unwrap());
    let mut by_layers = view(&Sky::open(&built_in_layers(folder.path()), camera.limiting_mag, MEMORY_MB).unwrap());
    let (mut total, mut worst_mas, mut worst_light) = (0, 0.0_f64, 0.0_f64);
    for (ra_deg, dec_deg) in [(84.0, -1.2), (269.5, 4.7), (10.0, 89.0), (266.4, -29.0)] {
        let axis = base::source::direction_from_ra_dec(ra_deg * DEG, dec_deg * DEG);
        let wanted = by_catalog.sources(axis, 0.0, at).unwrap().to_vec();
        by_layers.sources(axis, 0.0, at).unwrap();
        assert_eq!(by_layers.shortfall, Shortfall::default());
        let got = by_layers.found();
        for star in &wanted {
            // The cones differ by what the fastest star moves: look for stars, not for numbers of them.
            let near = got.iter().filter(|other| (other.mag - star.mag).abs() < 2e-3);
            let found = near.min_by(|a, b| {
                let off = |other: &Source| place(other).distance(place(star));
                off(a).total_cmp(&off(b))
            });
            let Some(found) = found else { panic!("{star:?} is missing") };
            let off_mas = place(found).distance(place(star)) / MAS;
            let is_at_the_rim = axis.angle_between(place(star)) > 14.0 * DEG;
            if !is_at_the_rim {
                worst_mas = worst_mas.max(off_mas);
                worst_light = worst_light.max((found.electrons / star.electrons - 1.0).abs());
                total += 1;
                let name = by_catalog.source_id(star.id);
                assert!(name.is_some(), "{star:?} has a name");
                assert_eq!(by_layers.source_id(found.id), name, "{found:?}");
            }
        }
    }
    println!("{total} stars, at most {worst_mas:.2} mas and {worst_light:.1e} of the light apart");
    assert!(total > 1000, "control: {total}");
    // A layer's places have 0.36 mas, motions 1.25 mas/yr beyond 1.4 arcsec/yr (for ten years), else 0.025 mas/yr.
    assert!(worst_mas < 13.0, "{worst_mas} mas");
    assert!(worst_light < 2e-3, "{worst_light}: steps of a millimagnitude, in G and colour");
}

/// Seconds from field to field: fewer than tiles are read ahead for.
const STEP_S: f64 = 1.5;

/// Returns the attitude of a slew at 3 deg/s about the sensor's vertical axis, at field `i`, and the reported rate:
/// `turn` times the real one.
fn slew(i: u32, turn: f64) -> (Rotation<Sensor, Icrf>, glam::DVec3) {
    let attitude = sensor_from_ra_dec_roll(84.0 * DEG, 0.0, 0.0);
    let rate_rad_s = glam::DVec3::new(0.0, 3.0 * DEG, 0.0);
    let turned = glam::DQuat::from_scaled_axis(-rate_rad_s * STEP_S * f64::from(i));
    (Rotation::from_quat(turned) * attitude, rate_rad_s * turn)
}

#[test]
fn a_slew_finds_its_tiles_there() {
    let folder = tempfile::tempdir().unwrap();
    let (mut camera, _) = camera("star_tracker_20deg");
    camera.limiting_mag = 9.0;
    let at = Tai::from_rfc3339(AT).unwrap();
    let sky = Sky::open(&built_in_layers(folder.path()), camera.limiting_mag, MEMORY_MB).unwrap();
    let late_frames = |turn: f64| {
        let mut view = SkyView::new(&camera, ObserverTrack::new(Observer::Geocentre, at), &sky);
        view.read_ahead().unwrap();
        let mut late = Vec::new();
        for i in 0..60 {
            let (attitude, rate_rad_s) = slew(i, turn);
            let mut los = LosPath::commanded(attitude, at + Span::from_s(STEP_S * f64::from(i)), camera.exposure_s);
            los.rate_rad_s = rate_rad_s;
            view.find_in_view(&los).unwrap();
            if view.shortfall.late_tiles > 0 {
                late.push(i);
            }
            // All that was asked for comes before the next frame, however slow the machine is.
            while view.settle().unwrap() > 0 {
                std::thread::yield_now();
            }
        }
        late
    };
    assert_eq!(late_frames(1.0), [0], "only the first frame comes unannounced");
    let backwards = late_frames(-1.0);
    assert!(backwards.len() > 20, "control: looking the wrong way does not help: {backwards:?}");
}

/// Counts of stars of one magnitude on a grid of pixel centres, in frames with noise.
struct Counts {
    stars: usize,
    mean_e: f64,
    sd_e: f64,
    background_e: f64,
    background_sd_e: f64,
}

/// Distance of the stars, px.
const PITCH: usize = 48;
const FRAMES: u32 = 4;

fn grid(geometry: &CameraGeometry) -> Vec<[usize; 2]> {
    let along = |size: usize| (1..size / PITCH).map(|i| i * PITCH);
    along(geometry.height_px()).flat_map(|y| along(geometry.width_px()).map(move |x| [x, y])).collect()
}

/// Draws layers that hold stars of `mag_g` and counts.
fn count(name: &str, mag_g: f64) -> Counts {
    let folder = tempfile::tempdir().unwrap();
    let (mut camera, _) = camera(name);
    camera.limiting_mag = mag_g as f32 + 0.001;
    let attitude = sensor_from_ra_dec_roll(266.4 * DEG, -29.0 * DEG, 0.3);
    let geometry = camera.geometry;
    let pixels = grid(&geometry);
    let star = |(id, pixel): (usize, &[usize; 2])| {
        let tangent = geometry.tangent_of_pixel(pixel.map(|v| v as f64)).unwrap();
        let direction = attitude.inverse().apply(tangent.extend(1.0).normalize());
        let [ra_rad, dec_rad] = ra_dec_rad(direction);
        let source_id = i64::try_from(id).unwrap();
        NewStar { source_id, ra_rad, dec_rad, motion_mas_yr: None, parallax_mas: None, mag_g, bp_rp: Some(0.82) }
    };
    let paths = layers(folder.path(), &[14.0, 22.5], pixels.iter().enumerate().map(star));
    let at = Tai::from_rfc3339(AT).unwrap();
    let sky = Sky::open(&paths, camera.limiting_mag, MEMORY_MB).unwrap();
    // At rest at the barycentre: stars are where they were put.
    let mut view = SkyView::new(&camera, ObserverTrack::new(Observer::Barycentre, at), &sky);
    let [width, height] = camera.sensor_px();
    let los = LosPath::commanded(attitude, at, camera.exposure_s);
    let (mut sums, mut dark) = (Vec::new(), Vec::new());
    for seed in 0..u64::from(FRAMES) {
        let mut imager = Imager::new(config::Backend::Cpu, camera.detector, [width, height], seed).unwrap();
        let budget = AccuracyBudget::default();
        let mut planner = Planner::new(camera.instrument(), budget, imager.cost, MethodChoice::Auto, los.clone());
        let plan = planner.plan(view.in_view(&los).unwrap());
        assert_eq!(plan.stars.len(), pixels.len(), "every star is drawn");
        let mut dn = DnImage::new(width, height);
        imager.image(plan, 0, &DetectorConditions::dark(camera.exposure_s), &mut dn).unwrap();
        let (gain, black) = (camera.detector.gain_e_per_dn, camera.detector.black_level_dn);
        let e = |x: usize, y: usize| (f64::from(dn.get(x, y).unwrap()) - black) * gain;
        for [x, y] in &pixels {
            sums.push((0..9).map(|i| e(x + i % 3 - 1, y + i / 3 - 1)).sum::<f64>());
            dark.extend((0..9).map(|i| e(x + PITCH / 2 + i % 3, y + PITCH / 2 + i / 3)));
        }
    }
    let moments = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64;
        (mean, variance.sqrt())
    };
    let ((sum_e, sd_e), (background_e, background_sd_e)) = (moments(&sums), moments(&dark));
    Counts { stars: sums.len(), mean_e: sum_e - 9.0 * background_e, sd_e, background_e, background_sd_e }
}

/// Compares the counts at a limiting magnitude with the file's numbers, by formulae of this file.
fn hold_case(name: &str, mag_g: f64, sigma_px: f64, zero_point_e_per_s: f64) {
    let (_, file) = camera(name);
    let (d, t) = (&file.detector.params, file.exposure.exposure_s);
    let share = libm::erf(1.5 / (sigma_px * core::f64::consts::SQRT_2)).powi(2);
    let signal = zero_point_e_per_s * t * share * 10_f64.powf(-0.4 * mag_g);
    let dark_e = d.dark_e_per_s * t;
    let pixel_variance = dark_e + d.read_noise_e_rms.powi(2) + d.gain_e_per_dn.powi(2) / 12.0 + d.dsnu_e_rms.powi(2);
    let noise = (signal + 9.0 * pixel_variance).sqrt();
    let got = count(name, mag_g);
    let root = (got.stars as f64).sqrt();
    println!(
        "{name}: {} stars of {mag_g} mag, {:.2} e- of {signal:.2}, noise {:.3} of {noise:.3}, SNR {:.3}; background {:.3} \
         of {dark_e:.3} e-, {:.3} rms of {:.3}",
        got.stars,
        got.mean_e,
        got.sd_e,
        got.mean_e / got.sd_e,
        got.background_e,
        got.background_sd_e,
        pixel_variance.sqrt()
    );
    assert!((got.mean_e - signal).abs() < STANDARD_ERRORS * noise / root * 1.5, "{} {signal}", got.mean_e);
    assert!((got.sd_e / noise - 1.0).abs() < STANDARD_ERRORS / (2.0_f64.sqrt() * root) + 0.01, "{} {noise}", got.sd_e);
    assert!((got.mean_e / got.sd_e - 3.0).abs() < 0.2, "SNR {}", got.mean_e / got.sd_e);
    let background_root = 3.0 * root;
    assert!((got.background_e - dark_e).abs() < STANDARD_ERRORS * pixel_variance.sqrt() / background_root + 0.02);
    assert!((got.background_sd_e / pixel_variance.sqrt() - 1.0).abs() < 0.02, "{}", got.background_sd_e);
    // Control: half a magnitude more is another signal.
    assert!((got.mean_e - signal * 10_f64.powf(-0.2)).abs() > STANDARD_ERRORS * noise / root * 1.5);
}

#[test]
fn a_field_of_magnitude_15_at_snr_3_has_its_counts_and_background() {
    let zero_point = 3.2e10 * core::f64::consts::FRAC_PI_4 * 0.09 * 0.09 * 0.85 * 0.70;
    hold_case("detection_limit_15mag", 15.0, 0.7, zero_point);
}

#[test]
fn a_field_of_magnitude_22_at_snr_3_has_its_counts_and_background() {
    hold_case("detection_limit_22mag", 22.0, 0.75, 3.8402e9);
}
