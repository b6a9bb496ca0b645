//! A calibrated display against a simulated one, behind a collimator and before a camera, that shares no code with the
//! calibration: the whole procedure from images to a file, and stars drawn with it.
//!
//! What is known only to the bench: distortion, tilt, roll, mirror, response, black level, vignetting, noise. What is
//! known to both: the tracker's own camera, as from its data sheet.

use base::time::{Span, Tai};
use base::{image::Image, refused::Refused};
use glam::{DVec2, DVec3};
use image::detector::Nonlinearity;
use outputs::display::calibration::spots::{FrameScale, sights_of_frame};
use outputs::display::calibration::{
    Calibration, DisplayIdentity, Fitted, Grid, Plan, Sight, Tracker, TrackerIdentity, fit,
};
use outputs::display::calibration::{fit::FitOptions, pattern::Pattern, report::MagnitudeRange};
use outputs::display::drive::{DisplayDrive, Dither};
use outputs::display::luminance_code::{KNOTS, code, luminance};
use outputs::display::{latency::Latency, response::Response};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};
use std::sync::OnceLock;
use testbed::display_bench::{BenchTruth, DisplayBench};

/// Largest error of the map, display px: the promise of a calibration.
const PROMISED_PX: f64 = 0.02;
const EXPOSURE_S: f64 = 0.1;

fn tracker(truth: &BenchTruth) -> CameraGeometry {
    CameraGeometry::new(CameraParameters {
        width_px: truth.tracker_px[0],
        height_px: truth.tracker_px[1],
        focal_px: [truth.tracker_focal_px; 2],
        principal_point_px: truth.tracker_centre_px,
        distortion: BrownConrady { k1: truth.tracker_radial, ..BrownConrady::default() },
    })
    .unwrap()
}

fn plan(truth: &BenchTruth) -> Plan {
    let [width_px, height_px] = truth.display_px;
    let display = DisplayIdentity { name: "bench".into(), width_px, height_px, bits: truth.bits };
    let tracker = TrackerIdentity::of("tracker", &tracker(truth));
    Plan::new(display, tracker, Grid { columns: 16, rows: 12, dot_px: 5, margin_px: 14 }, 24).unwrap()
}

fn options() -> FitOptions {
    FitOptions {
        made: Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap(),
        measured: Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap(),
        valid_days: 30,
        zero_point_e_per_s: Some(4e7),
        latency: None,
        spot_sigma_px: 0.7,
    }
}

/// Returns the fit of a tracker whose file says that it vignettes nothing.
fn fit_with(plan: &Plan, sights: &[Sight], camera: &CameraGeometry) -> Result<Fitted, Refused> {
    fit(plan, sights, &Tracker { name: "tracker", geometry: camera, illumination: &|_| 1.0 }, &options())
}

fn scale(truth: &BenchTruth) -> FrameScale {
    let BenchTruth { gain_e_per_dn, black_level_dn, .. } = *truth;
    FrameScale { gain_e_per_dn, black_level_dn, exposure_s: EXPOSURE_S, largest_dn: u16::MAX, full_well_e: 1e9 }
}

/// Shows every image of the plan and measures its frame.
fn measured(bench: &mut DisplayBench, plan: &Plan) -> Vec<Sight> {
    let scale = scale(&bench.truth);
    let mut sights = Vec::new();
    for pattern in plan.patterns() {
        let frame = match pattern {
            Pattern::Dark => bench.frame(None),
            Pattern::Level(_) | Pattern::Dots | Pattern::DotsBit(_) | Pattern::Marker(_) => {
                bench.frame(Some(&plan.draw(pattern)))
            }
        };
        sights.extend(sights_of_frame(pattern, &scale.applied(&frame), scale.saturated_from()));
    }
    sights
}

/// Returns the crooked bench's plan, measurements and fit: made once, as no test changes them.
fn crooked() -> &'static (Plan, Vec<Sight>, Fitted) {
    static CROOKED: OnceLock<(Plan, Vec<Sight>, Fitted)> = OnceLock::new();
    CROOKED.get_or_init(|| calibrated(&BenchTruth::crooked()))
}

fn calibrated(truth: &BenchTruth) -> (Plan, Vec<Sight>, Fitted) {
    let plan = plan(truth);
    let sights = measured(&mut DisplayBench::new(truth.clone()), &plan);
    let fitted = fit_with(&plan, &sights, &tracker(truth)).unwrap();
    (plan, sights, fitted)
}

/// Returns the largest error of the map over what its dots cover, display px.
fn map_error_px(truth: &BenchTruth, fitted: &Fitted) -> f64 {
    let [left, right, top, bottom] = fitted.map.geometry.covered().range_px();
    let places = (0..=40).flat_map(|i| (0..=30).map(move |j| [f64::from(i) / 40.0, f64::from(j) / 30.0]));
    let error = |[u, v]: [f64; 2]| {
        let px = DVec2::new(left + u * (right - left), top + v * (bottom - top));
        let found = fitted.map.geometry.project(truth.direction(px)).unwrap();
        DVec2::from(found).distance(px)
    };
    places.map(error).fold(0.0, f64::max)
}

#[test]
fn the_map_is_recovered_to_a_fiftieth_of_a_pixel() {
    let straight = BenchTruth::crooked();
    let mirrored = BenchTruth { mirrored: true, roll_rad: 2.6, seed: 2, ..straight.clone() };
    let turned = calibrated(&mirrored).2;
    for (truth, fitted) in [(straight, &crooked().2), (mirrored, &turned)] {
        let error_px = map_error_px(&truth, fitted);
        let r = &fitted.calibration.residual;
        println!("mirrored {}: map within {error_px:.4} px, {r:?}", truth.mirrored);
        assert!(error_px <= PROMISED_PX, "{error_px} px");
        assert!(r.map_error_px < PROMISED_PX && r.rms_px < 2.0 * PROMISED_PX, "{r:?}");
        assert!(r.dots_used > 140, "{r:?}");
        assert!(r.coverage > 0.85 && r.dots_saturated == 0, "{r:?}");
        assert_eq!(fitted.calibration.geometry.mirrored, truth.mirrored);
        assert!(fitted.has_dark);
    }
}

#[test]
fn without_its_polynomial_the_map_is_off() {
    let truth = BenchTruth::crooked();
    let (plan, _, fitted) = crooked();
    let mut fitted = fitted.clone();
    assert!(fitted.calibration.geometry.degree >= 3, "degree {}", fitted.calibration.geometry.degree);
    fitted.calibration.geometry.terms.retain(|(i, j, ..)| i + j == 1);
    fitted.map.geometry = fitted.calibration.calibrated().unwrap().geometry;
    assert!(map_error_px(&truth, &fitted) > 10.0 * PROMISED_PX, "the comparison can fail");
    assert_eq!(plan.display, fitted.calibration.display);
}

/// Returns the relative luminance of a grey as the bench has it, above black.
fn true_luminance(truth: &BenchTruth, grey: u16) -> f64 {
    (truth.light(grey) - truth.black_share) / (1.0 - truth.black_share)
}

#[test]
fn response_black_level_and_flat_field_are_recovered() {
    let truth = BenchTruth::crooked();
    let (_, _, fitted) = crooked();
    let parts = fitted.calibration.calibrated().unwrap();
    let worst = (0..=255_u16)
        .map(|grey| (parts.response.luminance()[usize::from(grey)] - true_luminance(&truth, grey)).abs())
        .fold(0.0, f64::max);
    println!("response within {worst:.5} of full");
    assert!(worst < 2e-3, "{worst} of full: a quarter of the step between bright greys");
    let black = fitted.calibration.response.black_share;
    assert!((black - truth.black_share).abs() < 3e-4, "black {black}");
    let normal = parts.flat.at([350.0, 220.0]) / truth.vignette(DVec2::new(350.0, 220.0));
    for px in [[20.0, 20.0], [620.0, 20.0], [320.0, 240.0], [20.0, 460.0], [620.0, 460.0]] {
        let off = parts.flat.at(px) / truth.vignette(DVec2::from(px)) / normal - 1.0;
        assert!(off.abs() < 0.005, "{off} at {px:?}");
    }
    // 6000 electrons in 0.1 s, less the black level, against 4e7 per second of magnitude 0.
    let range = MagnitudeRange::of(fitted.calibration.light.as_ref().unwrap(), &parts, Dither::over(16).unwrap());
    let wanted = -2.5 * (6000.0_f64 * (1.0 - truth.black_share) / EXPOSURE_S / 4e7).log10();
    println!("{range:?}");
    assert!((range.full_px - wanted).abs() < 0.01, "{} for {wanted} mag", range.full_px);
    assert!((range.black_px - range.full_px + 2.5 * truth.black_share.log10()).abs() < 0.2, "{range:?}");
}

/// Draws a star of a Gaussian's light, integrated over pixels, at a place of the display; luminance of full.
fn star(size_px: [usize; 2], at: [f64; 2], peak: f64) -> Vec<f32> {
    const SIGMA_PX: f64 = 0.5;
    let share = |i: usize, at: f64| {
        let below = |edge: f64| 0.5 * libm::erfc((at - edge) / (2.0_f64.sqrt() * SIGMA_PX));
        below(i as f64 + 0.5) - below(i as f64 - 0.5)
    };
    let columns: Vec<f64> = (0..size_px[0]).map(|x| share(x, at[0])).collect();
    let rows = (0..size_px[1]).map(|y| peak * share(y, at[1]) / 0.47);
    #[allow(clippy::cast_possible_truncation, reason = "frames are single precision")]
    rows.flat_map(|row| columns.iter().map(move |column| (row * column) as f32)).collect()
}

/// Returns where the tracker sees the star that is drawn for a direction, less where it should, display px: mean light
/// of so many refreshes, without noise.
fn star_error_px(bench: &DisplayBench, fitted: &Fitted, drive: &DisplayDrive, v_sensor: DVec3, refreshes: u64) -> f64 {
    let truth = &bench.truth;
    let size_px = truth.display_px;
    let geometry = &fitted.map.geometry;
    let drawn_px = geometry.camera().project(geometry.drawn_from_sensor().apply(v_sensor)).unwrap();
    let luminance = star(size_px, drawn_px, 0.5);
    let mut greys = Image::new(size_px[0], size_px[1]);
    let black = bench.mean_e(&greys);
    let mut light = vec![0.0; black.len()];
    for refresh in 0..refreshes {
        assert_eq!(drive.frame(&luminance, refresh, greys.pixels_mut()), 0, "nothing is clipped");
        light.iter_mut().zip(bench.mean_e(&greys)).for_each(|(sum, e)| *sum += e);
    }
    light.iter_mut().zip(black).for_each(|(sum, black)| *sum -= refreshes as f64 * black);
    let width = truth.tracker_px[0];
    let places = light.iter().enumerate().map(|(i, e)| DVec2::new((i % width) as f64, (i / width) as f64) * *e);
    let seen = places.sum::<DVec2>() / light.iter().sum::<f64>();
    let wanted = truth.tracker_place(v_sensor);
    let (_, density) = truth.display_place(wanted).unwrap();
    seen.distance(wanted) * density.sqrt()
}

#[test]
fn stars_are_seen_where_they_should_be() {
    let truth = BenchTruth::crooked();
    let (_, _, fitted) = crooked();
    let bench = DisplayBench::new(truth.clone());
    let parts = fitted.calibration.calibrated().unwrap();
    let drive = parts.drive(Dither::over(16).unwrap());
    let linear = Response::of_gamma(8, 1.0).unwrap();
    let wrong = DisplayDrive::new(&linear, &parts.flat, truth.display_px, Dither::over(16).unwrap(), false);
    let (mut worst, mut worst_wrong) = (0.0_f64, 0.0_f64);
    for place in [[100.25, 90.75], [320.5, 240.25], [545.75, 70.75], [140.25, 400.25], [500.75, 420.25]] {
        let v_sensor = truth.direction(DVec2::from(place));
        worst = worst.max(star_error_px(&bench, fitted, &drive, v_sensor, 16));
        worst_wrong = worst_wrong.max(star_error_px(&bench, fitted, &wrong, v_sensor, 16));
    }
    println!("stars within {worst:.4} px; grey taken for luminance {worst_wrong:.4} px");
    assert!(worst <= PROMISED_PX, "{worst} px");
    assert!(worst_wrong > 2.0 * PROMISED_PX, "response left linear: {worst_wrong} px");
}

#[test]
fn wrong_measurements_are_refused() {
    let truth = BenchTruth::crooked();
    let (plan, sights, fitted) = crooked();
    let tracker = tracker(&truth);
    let refused = |plan: &Plan, sights: &[Sight]| fit_with(plan, sights, &tracker).unwrap_err().to_string();
    // Dots that changed places: numbers given, each dot another's.
    let number_of = |px: [f64; 2]| {
        let v = tracker.unproject(px)?;
        let near = |dot: &&outputs::display::calibration::fit_map::SeenDot| dot.v_sensor.distance(v) < 1e-9;
        fitted.dots.iter().find(near).map(|dot| dot.number)
    };
    let named = |shuffle: bool| -> Vec<Sight> {
        let name = |sight: &Sight| {
            let dot = sight.tracker_px.filter(|_| sight.pattern == Pattern::Dots).and_then(number_of);
            Sight { dot: dot.map(|dot| if shuffle { 1 + dot * 71 % 192 } else { dot }), ..sight.clone() }
        };
        sights.iter().map(name).collect()
    };
    let by_name = fit_with(plan, &named(false), &tracker).unwrap();
    assert_eq!(by_name.calibration.geometry, fitted.calibration.geometry, "numbers given or read are the same");
    let reported = refused(plan, &named(true));
    assert!(reported.contains("belong to this plan"), "{reported}");
    // Measurements of another plan.
    let other =
        Plan::new(plan.display.clone(), plan.tracker.clone(), Grid { columns: 15, rows: 11, ..plan.grid.clone() }, 24);
    let reported = refused(&other.unwrap(), sights);
    assert!(reported.contains("wanted"), "{reported}");
    // Another tracker than the plan's.
    let moved = BenchTruth { tracker_focal_px: 1801.0, ..truth.clone() };
    let error = fit_with(plan, sights, &self::tracker(&moved)).unwrap_err().to_string();
    assert!(error.contains("tracker geometry"), "{error}");
    // No ramp.
    let dots: Vec<Sight> = sights.iter().filter(|s| !matches!(s.pattern, Pattern::Level(_))).cloned().collect();
    assert!(refused(plan, &dots).contains("greys with 0 and 255"), "{}", refused(plan, &dots));
    // Nothing is seen, with the lens cap on.
    assert!(refused(plan, &[]).contains("at least 12, got 0"), "{}", refused(plan, &[]));
}

#[test]
fn a_tenth_of_the_dots_may_be_reflections() {
    let truth = BenchTruth::crooked();
    let (plan, sights, fitted) = crooked();
    let mut sights = sights.clone();
    for (i, sight) in sights.iter_mut().filter(|sight| sight.pattern == Pattern::Dots).enumerate() {
        if let Some(px) = sight.tracker_px.as_mut().filter(|_| i % 10 == 3) {
            px[0] += 1.5;
        }
    }
    let spoiled = fit_with(plan, &sights, &tracker(&truth)).unwrap();
    let error_px = map_error_px(&truth, &spoiled);
    assert!(error_px <= PROMISED_PX, "{error_px} px");
    let left_out = spoiled.map.is_used.iter().filter(|used| !**used).count();
    assert!(left_out >= fitted.dots.len() / 10 - 2, "{left_out} left out");
}

#[test]
fn the_file_keeps_all_of_it_and_a_wrong_file_is_refused() {
    let (plan, _, fitted) = crooked();
    let flips = DisplayBench::new(BenchTruth::crooked()).flips_csv(200, 0.0285, 0.0004);
    let latency = Latency::measured(flips.as_bytes(), 0.0, Span::ZERO).unwrap();
    assert!((latency.median_ns - 28_500_000).abs() < 150_000, "{latency:?}");
    let kept = Calibration { latency: Some(latency), ..fitted.calibration.clone() };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bench.toml");
    kept.write(&path).unwrap();
    let read = Calibration::read(&path).unwrap();
    assert_eq!(read, kept);
    assert_eq!(read.calibrated().unwrap().geometry, fitted.map.geometry, "the same map, bit by bit");
    let now = Tai::from_rfc3339("2026-03-08T00:00:00Z").unwrap();
    assert!(read.admit(&plan.display, Some(&plan.tracker), now).is_ok());
    let wrong = DisplayIdentity { width_px: 1920, ..plan.display.clone() };
    assert!(read.admit(&wrong, None, now).unwrap_err().to_string().contains("resolution"));
    assert!(read.admit(&plan.display, None, now + Span::from_s(30.0 * 86_400.0)).is_err(), "stale");
    let text = std::fs::read_to_string(&path).unwrap().replace("mirrored = false", "mirrored = true");
    std::fs::write(&path, text).unwrap();
    assert!(Calibration::read(&path).unwrap_err().to_string().contains("damaged or edited"));
}

#[test]
fn vignetting_of_the_tracker_is_not_corrected() {
    let truth = BenchTruth::crooked();
    let (plan, sights, even) = crooked();
    let camera = tracker(&truth);
    // cos^4 of the field angle, from the pinhole alone: the tracker's own fall of light.
    let own = |px: [f64; 2]| {
        let [x, y] = [0, 1].map(|i| (px[i] - truth.tracker_centre_px[i]) / truth.tracker_focal_px);
        (1.0 + x * x + y * y).powi(-2)
    };
    let through = |sight: &Sight| {
        let flux = sight.flux.zip(sight.tracker_px).map(|(flux, px)| flux * own(px));
        Sight { flux, ..sight.clone() }
    };
    let vignetted: Vec<Sight> = sights.iter().map(through).collect();
    let reported = Tracker {
        name: "tracker",
        geometry: &camera,
        illumination: &|tangent: DVec2| (1.0 + tangent.length_squared()).powi(-2),
    };
    let reported = fit(plan, &vignetted, &reported, &options()).unwrap();
    let not_reported = fit_with(plan, &vignetted, &camera).unwrap();
    // A star in a corner, drawn evenly: the tracker must see its light less what it vignettes itself, as in the sky.
    let corner = [600.0, 450.0];
    let seen_of = |fitted: &Fitted| {
        let light = fitted.calibration.light.as_ref().unwrap();
        let shown = 1.0 / (light.full_px_e_per_s * fitted.calibration.calibrated().unwrap().flat.at(corner));
        let lens = even.calibration.light.as_ref().unwrap().full_px_e_per_s
            * even.calibration.calibrated().unwrap().flat.at(corner);
        shown * lens * own(truth.seen_at(DVec2::from(corner)).to_array())
    };
    let in_the_sky = own(truth.seen_at(DVec2::from(corner)).to_array());
    println!(
        "in the sky {in_the_sky:.4}, reported {:.4}, not reported {:.4}",
        seen_of(&reported),
        seen_of(&not_reported)
    );
    assert!(in_the_sky < 0.96, "it matters: {in_the_sky}");
    assert!((seen_of(&reported) / in_the_sky - 1.0).abs() < 0.005, "{} for {in_the_sky}", seen_of(&reported));
    assert!((seen_of(&not_reported) / in_the_sky - 1.0).abs() > 0.03, "taken out: the comparison can fail");
}

#[test]
fn saturated_frames_are_left_out_or_refused() {
    let truth = BenchTruth::crooked();
    let (plan, _, _) = crooked();
    let camera = tracker(&truth);
    let frames = |largest_dn: u16| -> Vec<Sight> {
        let mut bench = DisplayBench::new(truth.clone());
        let scale = FrameScale { largest_dn, ..scale(&truth) };
        let shown = |pattern: Pattern| {
            let greys = plan.draw(pattern);
            let mut frame = bench.frame((pattern != Pattern::Dark).then_some(&greys));
            frame.pixels_mut().iter_mut().for_each(|dn| *dn = (*dn).min(largest_dn));
            sights_of_frame(pattern, &scale.applied(&frame), scale.saturated_from())
        };
        plan.patterns().into_iter().flat_map(shown).collect()
    };
    let most = |sights: &[Sight], scale: f64| sights.iter().filter_map(|s| s.luminance).fold(0.0, f64::max) * scale;
    let open = frames(u16::MAX);
    let per_dn = EXPOSURE_S / truth.gain_e_per_dn;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "digital numbers")]
    let end = |share: f64| (truth.black_level_dn + share * most(&open, per_dn)) as u16;
    let some = fit_with(plan, &frames(end(0.9)), &camera).unwrap();
    println!("{} levels and {} dots left out", some.saturated_levels, some.calibration.residual.dots_saturated);
    assert!(some.saturated_levels > 3, "{} levels", some.saturated_levels);
    let luminance = some.calibration.calibrated().unwrap().response.luminance()[200];
    assert!((luminance - true_luminance(&truth, 200)).abs() < 2e-3, "what is left is right: {luminance}");
    let reported = fit_with(plan, &frames(end(0.3)), &camera).unwrap_err().to_string();
    assert!(reported.contains("saturated"), "{reported}");
}

#[test]
fn dots_in_one_corner_are_refused() {
    let truth = BenchTruth::crooked();
    let (plan, sights, _) = crooked();
    let in_part = |right: f64| -> Vec<Sight> {
        let is_kept =
            |sight: &&Sight| sight.pattern != Pattern::Dots || sight.tracker_px.is_some_and(|px| px[0] < right);
        sights.iter().filter(is_kept).cloned().collect()
    };
    let reported = fit_with(plan, &in_part(260.0), &tracker(&truth)).unwrap_err().to_string();
    assert!(reported.contains("of what the tracker sees of the display"), "{reported}");
    let most = fit_with(plan, &in_part(560.0), &tracker(&truth)).unwrap();
    let r = &most.calibration.residual;
    println!("{r:?}");
    assert!((0.5..0.85).contains(&r.coverage), "{r:?}");
}

#[test]
fn measurements_that_are_too_old_are_not_fitted() {
    let truth = BenchTruth::crooked();
    let (plan, sights, fitted) = crooked();
    let camera = tracker(&truth);
    let tracker = Tracker { name: "tracker", geometry: &camera, illumination: &|_| 1.0 };
    let at = |text: &str| FitOptions { measured: Tai::from_rfc3339(text).unwrap(), ..options() };
    for text in ["2026-01-29T00:00:00Z", "2026-03-03T00:00:00Z"] {
        let reported = fit(plan, sights, &tracker, &at(text)).unwrap_err().to_string();
        assert!(reported.contains("age of 0 to 30 days"), "{reported}");
    }
    let old = fit(plan, sights, &tracker, &at("2026-02-10T00:00:00Z")).unwrap().calibration;
    assert_eq!((&old.measured_utc[..10], &old.made_utc[..10]), ("2026-02-10", "2026-03-01"));
    assert_eq!(old.geometry, fitted.calibration.geometry);
}

#[test]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "single precision and digital numbers")]
fn a_detectors_response_makes_the_codes_of_luminances() {
    // As a run on a display has it: so many electrons for 1/65535 of full.
    const E_PER_STEP: f64 = 3e4;
    let response = Nonlinearity::through(&KNOTS.map(|[l, code]| [l * 65_535.0 * E_PER_STEP, code * E_PER_STEP]));
    let pieces = response.unwrap().pieces();
    let read = |wanted: f64| {
        let x = (wanted * 65_535.0 * E_PER_STEP) as f32;
        let bends = pieces.thresholds_e.iter().zip(pieces.steps);
        let seen = bends.fold(pieces.slope * x, |seen, (at, step)| seen + step * (x - at).max(0.0));
        (seen / E_PER_STEP as f32 + 0.5).floor().clamp(0.0, 65_535.0) as u16
    };
    let off = |at: u16| i32::from(read(luminance(at))) - i32::from(at);
    let worst = |codes: std::ops::RangeInclusive<u16>| codes.map(|at| off(at).abs()).max().unwrap();
    let faint = worst(0..=18_079);
    let bright = worst(18_080..=65_535);
    println!("faint codes off by {faint} at most, bright ones by {bright}");
    // Single precision at 141 x 65535, where the slopes of the pieces cancel: half a unit in each of four sums.
    assert!(faint == 0 && bright <= 3, "{faint}, {bright}");
    assert_eq!((read(0.0), read(1e-5)), (0, code(1e-5)));
}
