//! Whole frames, with noise: the catalog's stars are where an independent computation of apparent places puts them,
//! and the electron image holds the light that the truth table says.

use crate::apparent_places::{NORTH, ORION, Pointing, Star, apparent_icrf, project};
use base::time::{Span, Tai};
use base::{accuracy::AccuracyBudget, axes::sensor_from_ra_dec_roll, image::DnImage};
use image::detector::{DetectorConditions, DetectorParams, Patterns};
use image::gpu::Electrons;
use plan::attitude::LosPath;
use plan::exposure::{Instrument, MethodChoice, Planner, PsfSampling, Shutter};
use plan::optics::{BackgroundLight, Illumination, PsfModel, Radiometry};
use run::runtime::Imager;
use scene::{camera::CameraParams, sky_view::SkyView};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};
use sky::observer::{Observer, ObserverTrack};
use stars::Sky;

/// Promise of the project for a 20 degree tracker, px (71 arcsec each).
const PLACE_PX: f64 = 0.02;
/// Share of the frame's electrons that may be missing from, or too many in, the truth table.
const ELECTRONS_REL: f64 = 1e-4;
/// Half-width of the centroid window, px.
const WINDOW: i64 = 4;
/// Another drawn star within this many px pulls the centroid: such stars are left out.
const ALONE_PX: f64 = 12.0;
/// Brighter stars saturate this camera, fainter ones are lost in their own noise (0.005 px at magnitude 5).
const MAGNITUDES: core::ops::Range<f64> = 1.4..5.0;
const SIZE: usize = 1024;
const FOCAL_PX: f64 = 2903.6;
const PRINCIPAL_PX: [f64; 2] = [510.2, 512.9];
const RADIAL: [f64; 3] = [-0.04, 0.01, 0.0];
const TANGENTIAL: [f64; 2] = [3e-4, -2e-4];
const AT: &str = "2026-03-01T00:00:00Z";

fn camera() -> CameraParams {
    let [k1, k2, k3] = RADIAL;
    let [p1, p2] = TANGENTIAL;
    let geometry = CameraGeometry::new(CameraParameters {
        width_px: SIZE,
        height_px: SIZE,
        focal_px: [FOCAL_PX; 2],
        principal_point_px: PRINCIPAL_PX,
        distortion: BrownConrady { k1, k2, k3, p1, p2 },
    });
    CameraParams {
        name: "test".into(),
        geometry: geometry.unwrap(),
        shutter: Shutter::Global,
        psf: PsfModel::gaussian(0.8),
        sampling: PsfSampling::Auto,
        illumination: Illumination::EVEN,
        background: BackgroundLight::default(),
        radiometry: Radiometry {
            zero_magnitude_photons_per_s_m2: 3.2e10,
            aperture_mm: 60.0,
            obscuration: 0.0,
            transmission: 0.8,
            quantum_efficiency: 0.6,
            color_c1: 0.0,
            color_c2: 0.0,
        }
        .into(),
        patterns: Patterns::default(),
        detector: DetectorParams {
            full_well_e: 5e5,
            gain_e_per_dn: 8.0,
            bits: 16,
            black_level_dn: 100.0,
            read_noise_e_rms: 8.0,
            dark_e_per_s: 50.0,
            prnu: 0.0,
            dsnu_e_rms: 0.0,
            ..DetectorParams::QUIET
        },
        pixel_pitch_um: 10.0,
        focal_length_mm: FOCAL_PX * 0.01,
        limiting_mag: 6.0, // few neighbours, so that many stars stand alone
        exposure_s: 0.1,
        readout_s: 0.1,
    }
}

/// A frame with noise, its mean, and its truth as (x, y, electrons, mag).
struct Frame {
    dn: DnImage,
    mean_sum_e: f64,
    truth: Vec<[f64; 4]>,
}

fn draw(ra_dec_roll_deg: [f64; 3], backend: config::Backend) -> Frame {
    let camera = camera();
    let at = Tai::from_rfc3339(AT).unwrap();
    let [ra, dec, roll] = ra_dec_roll_deg.map(f64::to_radians);
    let attitude = sensor_from_ra_dec_roll(ra, dec, roll);
    let los = LosPath::commanded(attitude, at - Span::from_s(0.05), camera.exposure_s);
    let instrument: Instrument = camera.instrument();
    let mut imager = Imager::new(backend, camera.detector, [SIZE, SIZE], 3).unwrap();
    let mut planner = Planner::new(instrument, AccuracyBudget::default(), imager.cost, MethodChoice::Auto, los);
    let mut sky = SkyView::new(
        &camera,
        ObserverTrack::new(Observer::Geocentre, at),
        &Sky::open(&[], camera.limiting_mag, 1).unwrap(),
    );
    let boresight = attitude.inverse().apply(glam::DVec3::Z);
    let plan = planner.plan(sky.sources(boresight, 0.0, at).unwrap());
    let mut dn = DnImage::new(SIZE, SIZE);
    imager.image(plan, 0, &DetectorConditions::dark(camera.exposure_s), &mut dn).unwrap();
    let mean_sum_e = match imager.render(plan).unwrap() {
        Electrons::Host(mean) => mean.pixels().iter().map(|e| f64::from(*e)).sum(),
        Electrons::Precise(mean) => mean.pixels().iter().sum(),
        Electrons::Device(_) => panic!("the imager hands out images on the host"),
    };
    let truth =
        plan.stars.iter().map(|s| [s.mean_px[0], s.mean_px[1], s.electrons_on_detector, f64::from(s.mag)]).collect();
    Frame { dn, mean_sum_e, truth }
}

/// Returns the background-free first moment of the DN around a place, px.
fn centroid(image: &DnImage, near: [f64; 2]) -> [f64; 2] {
    let black = camera().detector.black_level_dn + 5.0 / 8.0; // 50 e-/s in 0.1 s at 8 e-/DN
    let (cx, cy) = (near[0].round() as i64, near[1].round() as i64);
    let mut sum = [0.0; 3];
    for y in cy - WINDOW..=cy + WINDOW {
        for x in cx - WINDOW..=cx + WINDOW {
            let dn = image.get(usize::try_from(x).unwrap(), usize::try_from(y).unwrap()).unwrap();
            let value = f64::from(dn) - black;
            sum[0] += value;
            sum[1] += value * x as f64;
            sum[2] += value * y as f64;
        }
    }
    [sum[1] / sum[0], sum[2] / sum[0]]
}

/// Returns the distance of every usable star's centroid from its independent place, px.
fn misses(frame: &Frame, stars: &[Star], ra_dec_roll_deg: [f64; 3]) -> Vec<(u32, f64)> {
    let at = Tai::from_rfc3339(AT).unwrap();
    let pointing = Pointing {
        ra_dec_roll_rad: ra_dec_roll_deg.map(f64::to_radians),
        focal_px: FOCAL_PX,
        principal_point_px: PRINCIPAL_PX,
        radial: RADIAL,
        tangential: TANGENTIAL,
    };
    let inside = |v: f64| v > 10.0 && v < SIZE as f64 - 11.0;
    let mut out = Vec::new();
    for star in stars {
        let Some(place) = project(apparent_icrf(star, at), &pointing) else { continue };
        if !(inside(place[0]) && inside(place[1])) {
            continue;
        }
        let distance = |t: &[f64; 4]| (t[0] - place[0]).hypot(t[1] - place[1]);
        let own = frame.truth.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
        let crowded = frame.truth.iter().any(|other| other != own && distance(other) < ALONE_PX);
        if MAGNITUDES.contains(&own[3]) && !crowded {
            let [x, y] = centroid(&frame.dn, place);
            out.push((star.hip, (x - place[0]).hypot(y - place[1])));
        }
    }
    out
}

fn check(name: &str, stars: &[Star], pointing: [f64; 3], at_least: usize) {
    let frame = draw(pointing, config::Backend::Cpu);
    let misses = misses(&frame, stars, pointing);
    let worst = misses.iter().map(|(_, miss)| *miss).fold(0.0, f64::max);
    println!("{name}: {} stars, worst {worst:.4} px", misses.len());
    assert!(misses.len() >= at_least, "{name}: only {} stars could be used", misses.len());
    for (hip, miss) in misses {
        assert!(miss < PLACE_PX, "{name}: HIP {hip} is {miss:.4} px from where it should be");
    }
    let truth_e: f64 = frame.truth.iter().map(|star| star[2]).sum();
    let rel = (frame.mean_sum_e / truth_e - 1.0).abs();
    assert!(rel < ELECTRONS_REL, "{name}: the image holds {} e-, the truth table {truth_e} e-", frame.mean_sum_e);
}

#[test]
fn orion() {
    check("Orion", &ORION, [83.8, -1.2, 25.0], 8);
}

#[test]
fn across_the_pole() {
    check("pole", &NORTH, [40.0, 89.0, -70.0], 4);
}

/// The same comparison sees a boresight that is off by 3 arcsec, and a mirrored roll.
#[test]
fn a_wrong_attitude_is_seen() {
    let frame = draw([83.8, -1.2, 25.0], config::Backend::Cpu);
    for wrong in [[83.8 + 3.0 / 3600.0, -1.2, 25.0], [83.8, -1.2, 25.01]] {
        let worst = misses(&frame, &ORION, wrong).iter().map(|(_, miss)| *miss).fold(0.0, f64::max);
        assert!(worst > PLACE_PX, "{wrong:?}: only {worst:.4} px");
    }
}
