//! Light over the field: stars dimmed by place, stray light and sky of a whole camera, against formulae written
//! afresh here.

use crate::scene::{camera, draw_cpu, draw_reference, instrument, los, planner_of, star};
use base::axes::{Icrf, Rotation, Sensor};
use base::time::{Span, Tai};
use config::{Camera, Document};
use glam::{DVec2, DVec3};
use plan::exposure::{Instrument, Source};
use plan::optics::{Illumination, PsfModel};
use plan::{attitude::LosPath, optics::illumination::Vignetting};
use run::wiring::camera_parts::camera_params;
use scene::{camera::CameraParams, field_light::FieldLight};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters, PolynomialDistortion};
use sky::observer::{Observer, ObserverTrack};
use sky::orbit::CircularOrbit;
use std::path::Path;

const SIZE: usize = 256;
const STOPS: Vignetting = Vignetting { window_radius_mm: 12.0, pupil_radius_mm: 10.0, distance_mm: 300.0 };
const LIT: Illumination = Illumination { vignetting: Some(STOPS), cos4: true, unblocked: 0.93 };

/// Returns the relative illumination by its definition: the shared area by integrating chords, the cosine by its angle.
fn wanted_illumination(tangent: f64) -> f64 {
    let (a, b, d) = (STOPS.window_radius_mm, STOPS.pupil_radius_mm, STOPS.distance_mm * tangent);
    let shared = |d: f64| {
        const STRIPS: u32 = 200_000;
        let height = 2.0 * a.min(b) / f64::from(STRIPS);
        let strip = |k: u32| {
            let y = (f64::from(k) + 0.5) * height - a.min(b);
            let (half_a, half_b) = ((a * a - y * y).max(0.0).sqrt(), (b * b - y * y).max(0.0).sqrt());
            ((d + half_b).min(half_a) - (d - half_b).max(-half_a)).max(0.0) * height
        };
        (0..STRIPS).map(strip).sum::<f64>()
    };
    0.93 * shared(d) / shared(0.0) * tangent.atan().cos().powi(4)
}

fn lit_instrument() -> Instrument {
    Instrument { illumination: LIT, ..instrument(camera(SIZE), &PsfModel::gaussian(0.8)) }
}

fn sources() -> Vec<Source> {
    [[127.5, 127.5], [140.2, 100.7], [60.3, 200.1], [20.0, 30.0], [240.4, 239.6]]
        .iter()
        .zip(0..)
        .map(|(px, id)| star(id, 1e5, *px))
        .collect()
}

#[test]
fn stars_are_dimmed_where_they_lie() {
    let mut planner = planner_of(lit_instrument(), "static", los(), None);
    let plan = planner.plan(&sources());
    assert_eq!(plan.stars.len(), 5);
    let mut dimmest = 1.0_f64;
    for star in &plan.stars {
        let tangent = plan.camera.tangent_of_pixel(star.place.mid_px).unwrap().length();
        let wanted = wanted_illumination(tangent);
        let got = star.electrons / 1e5;
        // Strips of 1e-5 of the height at a curved border: their error falls as their width to 3/2.
        assert!((got - wanted).abs() < 1e-6, "{:?}: {got} {wanted}", star.place.mid_px);
        assert!(star.electrons_on_detector <= star.electrons && star.electrons_on_detector > 0.999 * star.electrons);
        dimmest = dimmest.min(got);
    }
    assert!(dimmest < 0.75, "control: the corner is darker: {dimmest}");
    let truth: f64 = plan.stars.iter().map(|star| star.electrons_on_detector).sum();
    for picture in [draw_reference(plan), draw_cpu(plan)] {
        let sum: f64 = picture.pixels.iter().sum();
        assert!((sum / truth - 1.0).abs() < 1e-4, "every backend draws the dimmed star: {sum} {truth}");
    }
    let mut even = planner_of(instrument(camera(SIZE), &PsfModel::gaussian(0.8)), "static", los(), None);
    assert!(even.plan(&sources()).stars.iter().all(|star| star.electrons == 1e5), "off: not a bit changes");
}

#[test]
fn a_moving_star_keeps_the_value_of_its_middle() {
    // A path of 40 px, from the bright field over the edge of vignetting: the true mean of the illumination along it.
    let camera = camera(SIZE);
    let [focal_px, _] = camera.parameters().focal_px;
    let slope_per_px = LIT.steepest_per_tangent() / focal_px;
    let mut worst = 0.0_f64;
    for start in 0..100 {
        let at = |px: f64| LIT.at(DVec2::new(px / focal_px, 0.0));
        let from = f64::from(start);
        let mean = (0..1000).map(|k| at(from + 40.0 * (f64::from(k) + 0.5) / 1000.0)).sum::<f64>() / 1000.0;
        worst = worst.max((mean - at(from + 20.0)).abs());
    }
    let bound = 20.0 * slope_per_px;
    assert!(worst < bound, "{worst} of {bound}");
    assert!(worst > 0.01 * bound && worst < 0.25 * bound, "an even motion errs by far less: {worst} of {bound}");
}

#[test]
fn a_polynomial_lens_draws_what_brown_and_conrady_draw() {
    let (k1, p1) = (-0.3, 2e-3);
    let parameters =
        CameraParameters { distortion: BrownConrady { k1, p1, ..Default::default() }, ..*camera(SIZE).parameters() };
    let plain = CameraParameters { distortion: BrownConrady::default(), ..parameters };
    let terms = [(3, 0, k1, 0.0), (1, 2, k1, 0.0), (2, 1, 0.0, k1), (0, 3, 0.0, k1)];
    let tangential = [(1, 1, 2.0 * p1, 0.0), (2, 0, 0.0, p1), (0, 2, 0.0, 3.0 * p1)];
    let model = terms
        .iter()
        .chain(&tangential)
        .fold(PolynomialDistortion::default(), |model, &(i, j, a, b)| model.with_term(i, j, a, b).unwrap());
    let cameras = [CameraGeometry::new(parameters), CameraGeometry::with_polynomial(plain, model)].map(Result::unwrap);
    let draw = |camera: CameraGeometry| {
        let instrument = Instrument { camera, ..instrument(camera, &PsfModel::gaussian(0.8)) };
        let slew = LosPath { rate_rad_s: DVec3::new(0.01, -0.02, 0.2), ..los() };
        let mut planner = planner_of(instrument, "gauss-legendre:8", slew, None);
        let directions = sources().into_iter().map(|source| {
            let plan::exposure::SourcePlace::Pixel(px) = source.place else { panic!("given in pixels") };
            let v = camera_plain().unproject(px).unwrap();
            Source { place: plan::exposure::SourcePlace::Icrf(v), ..source }
        });
        let sources: Vec<Source> = directions.collect();
        draw_reference(planner.plan(&sources)).pixels
    };
    let [brown, polynomial] = cameras.map(draw);
    let largest = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(largest(&brown, &polynomial) < 1e-4, "{}", largest(&brown, &polynomial));
    let undistorted = draw(camera_plain());
    assert!(largest(&brown, &undistorted) > 100.0, "control: the distortion shows");
}

fn camera_plain() -> CameraGeometry {
    camera(SIZE)
}

const FILE: &str = "[detector]\nwidth_px = 512\nheight_px = 384\npixel_pitch_um = 6.0\nquantum_efficiency = 0.5\n\
    [optics]\nfocal_length_mm = 25\naperture_mm = 12\nobscuration = 0.2\ntransmission = 0.8\n\
    [radiometry]\nzero_magnitude_photons_per_s_m2 = 3e10\n[exposure]\nexposure_s = 0.2\n";

fn params(sections: &str) -> CameraParams {
    let document = Document::from_text(&format!("{FILE}{sections}"), Path::new("cam.toml"));
    camera_params(&Camera::from_document(&document).unwrap()).unwrap()
}

fn noon() -> Tai {
    Tai::from_rfc3339("2026-05-05T12:00:00Z").unwrap()
}

/// Returns the direction of the Sun from the Earth's centre and its distance in au, equatorial axes of date: the
/// Astronomical Almanac's low-precision formulae (page C5), 0.01 deg.
fn almanac_sun(days_since_j2000: f64) -> (DVec3, f64) {
    let g = (357.528 + 0.985_600_3 * days_since_j2000).to_radians();
    let longitude = (280.460 + 0.985_647_4 * days_since_j2000 + 1.915 * g.sin() + 0.020 * (2.0 * g).sin()).to_radians();
    let tilt = (23.439 - 0.000_000_4 * days_since_j2000).to_radians();
    let au = 1.000_14 - 0.016_71 * g.cos() - 0.000_14 * (2.0 * g).cos();
    let (s, c) = longitude.sin_cos();
    (DVec3::new(c, tilt.cos() * s, tilt.sin() * s), au)
}

/// Returns an attitude with `sun` at this angle off the boresight, towards the image's direction (x right, y down).
fn attitude_with(sun: DVec3, off_axis_deg: f64, towards: DVec2) -> Rotation<Sensor, Icrf> {
    let angle = off_axis_deg.to_radians();
    let in_sensor = (towards.normalize() * angle.sin()).extend(angle.cos());
    Rotation::from_quat(glam::DQuat::from_rotation_arc(sun.normalize(), in_sensor))
}

fn pointed(attitude: Rotation<Sensor, Icrf>, at: Tai) -> LosPath {
    LosPath::commanded(attitude, at - Span::from_s(0.1), 0.2)
}

#[test]
fn sunlight_through_the_baffle_is_what_the_table_says() {
    let camera = params(
        "[baffle]\ntransmittance = [[10, 1e-5], [40, 1e-9], [85, 1e-12]]\nshines = [\"sun\"]\ngradient = 0.25\n\
         quadratic = -0.5\nexclusion_sun_deg = 35\n",
    );
    let at = noon();
    let light = FieldLight::new(&camera, ObserverTrack::new(Observer::Geocentre, at));
    let days = at.days_tdb_since_j2000();
    let (of_date, au) = almanac_sun(days);
    // From the equinox of date to J2000: 50.29 arcsec a year about the ecliptic's pole.
    let turn = -(50.29 / 3600.0 * days / 365.25_f64).to_radians();
    let pole = DVec3::new(0.0, -(23.439_f64).to_radians().sin(), (23.439_f64).to_radians().cos());
    let sun = glam::DQuat::from_axis_angle(pole, turn) * of_date;
    for (deg, transmittance) in [(25.0, 1e-7), (40.0, 1e-9), (62.5, 10_f64.powf(-10.5))] {
        let towards = DVec2::new(0.8, -0.6);
        let (background, glare) = light.at(&pointed(attitude_with(sun, deg, towards), at)).unwrap();
        // Photons of magnitude -26.90 per m^2 and s; colour terms are zero; half become electrons; 6 um pixels; 0.2 s.
        let photons = 3e10 * 10_f64.powf(0.4 * 26.90) / (au * au);
        let wanted = photons * 0.5 * 36e-12 * 0.2 * transmittance;
        let got = f64::from(background.uniform_e);
        // 0.01 deg of the almanac where the table falls by a decade in 7.5 deg: 0.3 %.
        assert!((got / wanted - 1.0).abs() < 6e-3, "{deg}: {got} {wanted}");
        let [gx, gy] = background.gradient_e.map(f64::from);
        assert!((gx / got - 0.25 * 0.8).abs() < 2e-4 && (gy / got + 0.25 * 0.6).abs() < 2e-4, "{gx} {gy}");
        assert!((f64::from(background.quadratic_e) / got + 0.5).abs() < 1e-6);
        assert_eq!(glare.excluded, [deg < 35.0, false, false], "{deg}");
    }
    let behind = light.at(&pointed(attitude_with(sun, 91.0, DVec2::X), at)).unwrap().0;
    assert_eq!(behind.uniform_e, 0.0, "from behind");
}

#[test]
fn night_is_dark_and_the_sky_is_lit_by_latitude() {
    let at = noon();
    let days = at.days_tdb_since_j2000();
    let (sun, _) = almanac_sun(days);
    let camera = params("[baffle]\ntransmittance = [[0, 1e-6], [90, 1e-6]]\nshines = [\"sun\"]\n");
    // A polar orbit through the direction of the Sun and the one opposite: day and night, half a revolution apart.
    let ra_deg = sun.y.atan2(sun.x).to_degrees();
    let declination_deg = sun.z.asin().to_degrees();
    let orbit = |latitude_argument_deg: f64| {
        Observer::Circular(CircularOrbit::new(500.0, 90.0, ra_deg, latitude_argument_deg, at).unwrap())
    };
    let lit = |observer: Observer| {
        let los = pointed(attitude_with(sun, 50.0, DVec2::X), at);
        FieldLight::new(&camera, ObserverTrack::new(observer, at)).at(&los).unwrap().0.uniform_e
    };
    assert!(lit(orbit(declination_deg)) > 0.0, "noon");
    assert_eq!(lit(orbit(declination_deg - 180.0)), 0.0, "midnight");

    let sky = params("[background]\nsky = [\"zodiacal\"]\n[illumination]\ncos4 = true\n");
    let light = FieldLight::new(&sky, ObserverTrack::new(Observer::Geocentre, at));
    // Ecliptic pole: 60 S10 of V = 10, G = V - 0.14 stars per square degree, through aperture, transmission and QE.
    let tilt = 23.439_28_f64.to_radians();
    let pole = DVec3::new(0.0, -tilt.sin(), tilt.cos());
    let los = pointed(attitude_with(pole, 0.0, DVec2::X), at);
    let (background, _) = light.at(&los).unwrap();
    let aperture_m2 = std::f64::consts::FRAC_PI_4 * 0.012_f64.powi(2) * (1.0 - 0.04);
    let star_e = 3e10 * 10_f64.powf(-0.4 * (10.0 - 0.14)) * aperture_m2 * 0.8 * 0.5 * 0.2;
    let pixel_deg2 = (6e-6_f64 / 25e-3).to_degrees().powi(2);
    let wanted = 60.0 * star_e * pixel_deg2;
    assert!((f64::from(background.sky_e) / wanted - 1.0).abs() < 2e-3, "{} {wanted}", background.sky_e);
    assert_eq!((background.uniform_e, background.gradient_e), (0.0, [0.0; 2]));
    let bodies = ObserverTrack::new(Observer::Geocentre, at).bodies(at).unwrap();
    let near_sun = pointed(attitude_with(bodies.sun_km, 40.0, DVec2::X), at);
    assert!(light.at(&near_sun).unwrap().0.sky_e > 3.0 * background.sky_e, "control: brighter near the Sun");
}
