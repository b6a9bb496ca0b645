//! The statistical tracker against its own figures: each term comes out of a series by the same estimator that judges
//! the tracker on pixels (`error_terms`), within four standard errors of that estimate.

use super::*;
use crate::tracker::{
    AttitudePair, DetectorFigures, ErrorTerms, ExposedLight, Geometry, GuideStars, TrackerParams, error_terms,
};
use base::{axes::sensor_from_ra_dec_roll, units::ARCSEC};
use stars::catalog::Catalog;
use std::sync::Arc;

const STATIONS: u32 = 600;
const REPEATS: u32 = 20;
/// Standard errors that a figure may be off; chance of a false alarm over all checks below 1e-3, once for the fixed
/// seed.
const SIGMAS: f64 = 4.0;

fn figures() -> ModelParams {
    ModelParams {
        bias_rad: DVec3::new(5.0, -3.0, 20.0) * ARCSEC,
        drift_rad_h: DVec3::ZERO,
        fov_spatial_rad: DVec3::new(2.0, 2.0, 8.0) * ARCSEC,
        field_rad: 20.0 * DEG,
        aberration_residual_rad: 0.0,
        pixel_spatial_rad: DVec3::new(1.0, 1.0, 5.0) * ARCSEC,
        pixel_rad: 70.0 * ARCSEC,
        noise_rad: DVec3::new(1.5, 1.5, 12.0) * ARCSEC,
        noise_method: NoiseMethod::Even,
        noise_rate_s: DVec3::ZERO,
        date_error: Span::ZERO,
        acquisition: Span::ZERO,
        acquisition_probability: 1.0,
        tracking_probability: 1.0,
        false_probability: 0.0,
        acquires_below_rad_s: 1.0 * DEG,
        lost_above_rad_s: 3.0 * DEG,
        sun_exclusion_rad: 0.0,
        moon_exclusion_rad: 0.0,
        earth_exclusion_rad: 0.0,
        stars: 20,
    }
}

fn at(ms: i64) -> Tai {
    Tai::from_unix_ns(1_772_366_400_000_000_000) + Span::from_ms(ms)
}

fn geometry() -> Geometry {
    let (side, focal) = (1024, 1024.0 / (2.0 * (10.0 * DEG).tan()));
    Geometry {
        width_px: side,
        height_px: side,
        focal_px: [focal; 2],
        principal_point_px: [511.5; 2],
        distortion: [0.0; 5],
    }
}

/// Returns a station of a walk over the sky in stations 0.37 deg apart, on a line that meets all of the field's waves.
fn station(number: u32) -> Rotation<Sensor, Icrf> {
    let s = f64::from(number);
    sensor_from_ra_dec_roll(0.37 * DEG * s, 0.9 * (0.011 * s).sin(), 0.004 * s)
}

/// Returns figures without any error.
fn silent() -> ModelParams {
    ModelParams {
        bias_rad: DVec3::ZERO,
        fov_spatial_rad: DVec3::ZERO,
        pixel_spatial_rad: DVec3::ZERO,
        noise_rad: DVec3::splat(1e-12),
        ..figures()
    }
}

fn terms(params: ModelParams, seed: u64) -> ErrorTerms {
    let mut model = TrackerModel::new(params, None, seed, at(0));
    let mut series = Vec::new();
    for number in 0..STATIONS * REPEATS {
        let truth = station(number / REPEATS);
        let Outcome::Solved(solution) = model.measure(number, at(100 * i64::from(number)), &truth, DVec3::ZERO) else {
            unreachable!("it always tracks")
        };
        series.push(AttitudePair { measured: solution.sensor_from_icrf, truth });
    }
    error_terms(&series, &geometry()).unwrap()
}

fn is_near(got: DVec3, wanted: DVec3, standard_error: DVec3) -> bool {
    ((got - wanted).abs() / standard_error).max_element() < SIGMAS
}

#[test]
fn error_terms_are_the_figures() {
    let (params, got) = (figures(), terms(figures(), 11));
    let spatial = (params.fov_spatial_rad * params.fov_spatial_rad
        + params.pixel_spatial_rad * params.pixel_spatial_rad)
        .map(f64::sqrt);
    // The FOV spatial error of neighbouring stations is alike: some 54 of the 600 are independent.
    let independent = f64::from(STATIONS) * 0.37 / 20.0 * 5.0;
    assert!(is_near(got.bias_rad, params.bias_rad, spatial / independent.sqrt()), "bias {:?}", got.bias_rad / ARCSEC);
    let freedom = f64::from(STATIONS * (REPEATS - 1));
    assert!(
        is_near(got.nea_rad, params.noise_rad, params.noise_rad / (2.0 * freedom).sqrt()),
        "{:?}",
        got.nea_rad / ARCSEC
    );
    let fov_error = params.fov_spatial_rad / (2.0 * independent).sqrt() * 1.5;
    assert!(is_near(got.fov_spatial_rad, params.fov_spatial_rad, fov_error), "fov {:?}", got.fov_spatial_rad / ARCSEC);
    let pixel = got.pixel_spatial_rad.unwrap();
    let pixel_error = params.pixel_spatial_rad * 0.1;
    assert!(is_near(pixel, params.pixel_spatial_rad, pixel_error), "pixel {:?}", pixel / ARCSEC);
}

#[test]
fn a_figure_that_is_off_is_seen() {
    let params = figures();
    let noisier = terms(ModelParams { noise_rad: params.noise_rad * 1.1, ..params }, 11);
    let freedom = f64::from(STATIONS * (REPEATS - 1));
    assert!(!is_near(noisier.nea_rad, params.noise_rad, params.noise_rad / (2.0 * freedom).sqrt()), "control: 10 %");
    let off = terms(ModelParams { bias_rad: params.bias_rad + DVec3::splat(6.0 * ARCSEC), ..params }, 11);
    let shift = (off.bias_rad - terms(params, 11).bias_rad) / ARCSEC;
    assert!((shift - DVec3::splat(6.0)).abs().max_element() < 0.01, "{shift:?}");
}

#[test]
fn drift_grows() {
    let quiet = ModelParams { drift_rad_h: DVec3::new(3.0, 0.0, -6.0) * ARCSEC, ..silent() };
    let mut model = TrackerModel::new(quiet, None, 3, at(0));
    let truth = station(5);
    let Outcome::Solved(late) = model.measure(9, at(1_800_000), &truth, DVec3::ZERO) else { unreachable!() };
    let error = truth.rotation_vector_to(&late.sensor_from_icrf) / ARCSEC;
    assert!((error - DVec3::new(1.5, 0.0, -3.0)).length() < 1e-4, "half an hour: {error:?}");
}

/// Standard deviation of the errors about the sensor's axes at a rate, arcsec.
fn scatter_arcsec(params: ModelParams, rate_rad_s: DVec3) -> (DVec3, DMat3) {
    let frames = 4000_u32;
    let (truth, mut sum, mut stated) = (station(5), DVec3::ZERO, DMat3::ZERO);
    let mut model = TrackerModel::new(params, None, 3, at(0));
    for frame in 0..frames {
        let Outcome::Solved(solution) = model.measure(frame, at(0), &truth, rate_rad_s) else { unreachable!() };
        let error = truth.rotation_vector_to(&solution.sensor_from_icrf) / ARCSEC;
        (sum, stated) = (sum + error * error, solution.covariance_rad2);
    }
    ((sum / f64::from(frames)).map(f64::sqrt), stated)
}

#[test]
fn noise_of_motion_is_larger_along_it() {
    let [along, across, about] = [6.0, 2.0, 30.0];
    let noise_rate_s = DVec3::new(along, across, about) * ARCSEC / DEG;
    let (noise_rad, limit) = (figures().noise_rad, 20.0 * DEG);
    let params =
        ModelParams { noise_rad, noise_rate_s, acquires_below_rad_s: limit, lost_above_rad_s: limit, ..silent() };
    let rest = figures().noise_rad / ARCSEC;
    let expect = |x: f64, y: f64, z: f64| DVec3::new(rest.x.hypot(x), rest.y.hypot(y), rest.z.hypot(z));
    let diagonal = (along.hypot(across) / 2.0_f64.sqrt(), 0.5_f64.sqrt() * DEG);
    let half_field = 0.5 * params.field_rad;
    for (rate, wanted) in [
        (DVec3::ZERO, rest),
        (DVec3::X * DEG, expect(along, across, about)),
        (DVec3::Y * DEG, expect(across, along, about)),
        (DVec3::new(diagonal.1, diagonal.1, 0.0), expect(diagonal.0, diagonal.0, about)),
        (DVec3::Z * (DEG / half_field), expect(diagonal.0, diagonal.0, about)),
    ] {
        let (got, stated) = scatter_arcsec(params, rate);
        let error = wanted / (2.0 * 4000.0_f64).sqrt();
        assert!(is_near(got, wanted, error), "{rate:?}: {got:?}, wanted {wanted:?}");
        let said = DVec3::new(stated.x_axis.x, stated.y_axis.y, stated.z_axis.z).map(f64::sqrt) / ARCSEC;
        assert!((said - wanted).abs().max_element() < 1e-9, "{rate:?}: its covariance says {said:?}");
    }
    let (control, _) = scatter_arcsec(params, DVec3::X * DEG);
    let wanted = expect(across, along, about);
    assert!(!is_near(control, wanted, wanted / (2.0 * 4000.0_f64).sqrt()), "control: the axes of another motion");
}

#[test]
fn false_attitudes_come_by_chance_and_from_all_over_the_sky() {
    let frames = 20_000_u32;
    let run = |false_probability: f64| {
        let params = ModelParams { false_probability, ..silent() };
        let mut model = TrackerModel::new(params, None, 5, at(0));
        let (truth, mut found, mut mean) = (station(0), 0_u32, DVec3::ZERO);
        for frame in 0..frames {
            let Outcome::Solved(solution) = model.measure(frame, at(0), &truth, DVec3::ZERO) else { unreachable!() };
            if truth.rotation_vector_to(&solution.sensor_from_icrf).length() > 1e-3 {
                (found, mean) = (found + 1, mean + solution.sensor_from_icrf.inverse().apply(DVec3::Z));
            }
        }
        (f64::from(found), mean / f64::from(found.max(1)))
    };
    let (found, mean) = run(0.05);
    let wanted = 0.05 * f64::from(frames);
    assert!((found - wanted).abs() < SIGMAS * wanted.sqrt(), "{found}");
    // The mean of unit vectors from all directions: 1 / sqrt(3 n) about each axis.
    assert!(mean.abs().max_element() < SIGMAS / (3.0 * found).sqrt(), "{mean:?}");
    assert_eq!(run(0.0).0, 0.0, "control: none");
}

#[test]
fn aberration_that_is_left_is_along_the_velocity_and_largest_across_it() {
    let params = ModelParams { aberration_residual_rad: 2.0 * ARCSEC, ..silent() };
    let velocity = earth_beta(at(0)).normalize();
    let mut largest = 0.0_f64;
    for number in 0..200 {
        let truth = station(number);
        let error = |params: ModelParams| {
            let mut model = TrackerModel::new(params, None, 3, at(0));
            let Outcome::Solved(solution) = model.measure(1, at(0), &truth, DVec3::ZERO) else { unreachable!() };
            truth.rotation_vector_to(&solution.sensor_from_icrf) / ARCSEC
        };
        assert!(error(silent()).length() < 1e-4, "control: none");
        let (error, boresight) = (error(params), truth.inverse().apply(DVec3::Z));
        // The attitude that sees the stars where aberration puts them: its boresight lags behind by so much.
        let wanted = 2.0 * boresight.angle_between(velocity).sin();
        assert!((error.length() - wanted).abs() < 1e-3, "{} {wanted}", error.length());
        largest = largest.max(wanted);
    }
    assert!(largest > 1.8, "some look across the velocity: {largest}");
}

#[test]
fn a_late_date_is_an_error_against_the_motion() {
    let params = ModelParams { date_error: Span::from_ms(20), ..silent() };
    let truth = station(5);
    let rate = DVec3::new(0.3, -0.2, 0.1) * DEG;
    let mut model = TrackerModel::new(params, None, 3, at(0));
    let Outcome::Solved(solution) = model.measure(1, at(0), &truth, rate) else { unreachable!() };
    let error = truth.rotation_vector_to(&solution.sensor_from_icrf);
    assert!((error + rate * 0.02).length() < 1e-9, "where it was 20 ms ago: {error:?}");
}

/// Noise by stars: of the size of the figures over the sky, and of a field's own in it, with its correlations.
#[test]
fn noise_by_stars_is_that_of_the_field() {
    let detector =
        DetectorFigures { gain_e_per_dn: 25.1, black_level_dn: 100.0, read_noise_e_rms: 61.5, saturation_dn: 4095 };
    let tracker = TrackerParams { most_stars: 40, ..TrackerParams::new(geometry(), detector, 0.65) };
    let guide = Arc::new(GuideStars::new(&Catalog::built_in().unwrap(), &tracker, at(0)).unwrap());
    let light = ExposedLight { zero_magnitude_e: 1.12e6, background_sigma_e: 62.5, background_e: 0.0 };
    let mut stars = StarNoise::new(&tracker, guide, &light);
    let params = ModelParams {
        bias_rad: DVec3::ZERO,
        fov_spatial_rad: DVec3::ZERO,
        pixel_spatial_rad: DVec3::ZERO,
        noise_method: NoiseMethod::Stars,
        stars: 40,
        ..figures()
    };
    let mut model = TrackerModel::new(params, Some(stars.clone()), 11, at(0));
    let frames = 4000_u32;
    let mut ratios = Vec::new();
    for number in [3, 150, 300, 450] {
        let (truth, mut sum) = (station(number), DMat3::ZERO);
        for frame in 0..frames {
            let Outcome::Solved(solution) = model.measure(frame, at(i64::from(frame)), &truth, DVec3::ZERO) else {
                unreachable!("it always tracks")
            };
            let e = truth.rotation_vector_to(&solution.sensor_from_icrf);
            sum += DMat3::from_cols(e * e.x, e * e.y, e * e.z) * (1.0 / f64::from(frames));
        }
        let root = DMat3::from_diagonal(params.noise_rad) * stars.at(&truth).unwrap().factor;
        let wanted = root * root.transpose();
        let error = (2.0 / f64::from(frames)).sqrt();
        for axis in 0..3 {
            let ratio = sum.col(axis)[axis] / wanted.col(axis)[axis];
            assert!((ratio - 1.0).abs() < SIGMAS * error, "station {number}, axis {axis}: {ratio}");
        }
        ratios.push(wanted.z_axis.z.sqrt() / params.noise_rad.z);
    }
    let [least, most] = [f64::min, f64::max].map(|of| ratios.iter().copied().reduce(of).unwrap());
    assert!(most > 1.5 * least, "control: it is not even, {ratios:.3?}");
}

#[test]
fn attitude_is_found_after_its_time_and_lost_above_the_rate() {
    let params = ModelParams { acquisition: Span::from_ms(1000), acquisition_probability: 0.5, ..figures() };
    let truth = station(0);
    let (mut waited, trials) = (0.0, 400_u32);
    for trial in 0..trials {
        let mut model = TrackerModel::new(params, None, u64::from(trial), at(0));
        let found = (0..200_u32).find(|frame| {
            matches!(model.measure(*frame, at(100 * i64::from(*frame)), &truth, DVec3::ZERO), Outcome::Solved(_))
        });
        let found = found.expect("within 200 frames");
        assert!(found >= 10, "not before a second has passed");
        waited += f64::from(found - 10);
    }
    // Geometric law: mean (1 - p) / p = 1, standard deviation sqrt(1 - p) / p.
    let (mean, error) = (waited / f64::from(trials), (0.5_f64).sqrt() / 0.5 / f64::from(trials).sqrt());
    assert!((mean - 1.0).abs() < SIGMAS * error, "{mean}");
    let mut model = TrackerModel::new(
        ModelParams { acquisition: Span::ZERO, acquisition_probability: 1.0, ..params },
        None,
        1,
        at(0),
    );
    let mut solved_at = |frame: u32, rate_deg_s: f64| {
        let rate = DVec3::X * (rate_deg_s * DEG);
        matches!(model.measure(frame, at(100 * i64::from(frame)), &truth, rate), Outcome::Solved(_))
    };
    assert!(!solved_at(0, 2.0), "too fast to find it");
    assert!(solved_at(1, 0.5) && solved_at(2, 2.0), "but not to keep it");
    assert!(!solved_at(3, 3.5) && !solved_at(4, 2.0), "lost");
}

#[test]
fn tracking_probability_is_that_of_frames() {
    let params = ModelParams { tracking_probability: 0.9, ..figures() };
    let mut model = TrackerModel::new(params, None, 5, at(0));
    let truth = station(0);
    let frames = 20_000_u32;
    let lost = (0..frames).filter(|frame| {
        matches!(model.measure(*frame, at(100 * i64::from(*frame)), &truth, DVec3::ZERO), Outcome::NoSolution(_))
    });
    let lost = lost.count() as f64;
    // After a lost frame the next one is found for certain: a share of 0.1 / 1.1.
    let (share, wanted) = (lost / f64::from(frames), 0.1 / 1.1);
    assert!((share - wanted).abs() < SIGMAS * (wanted / f64::from(frames)).sqrt(), "{share}");
}

#[test]
fn sun_and_moon_blind_it_inside_their_cones_only() {
    let params = ModelParams { sun_exclusion_rad: 30.0 * DEG, moon_exclusion_rad: 15.0 * DEG, ..figures() };
    for (direction, half_angle_deg) in [(sun_direction_icrf(at(0)), 30.0), (moon_direction_icrf(at(0)), 15.0)] {
        let (ra, dec) = (direction.y.atan2(direction.x), direction.z.asin());
        let outcome = |off_deg: f64| {
            let away = if dec > 0.0 { dec - off_deg * DEG } else { dec + off_deg * DEG };
            let truth = sensor_from_ra_dec_roll(ra, away, 0.0);
            TrackerModel::new(params, None, 1, at(0)).measure(0, at(0), &truth, DVec3::ZERO)
        };
        assert_eq!(outcome(half_angle_deg - 0.1), Outcome::NoSolution(Reason::StrayLight));
        assert!(matches!(outcome(half_angle_deg + 0.1), Outcome::Solved(_)));
    }
}

#[test]
fn the_earth_blinds_it_near_its_limb_once_it_is_known() {
    let params = ModelParams { earth_exclusion_rad: 20.0 * DEG, ..figures() };
    let earth = EarthDisc { direction_icrf: DVec3::X, radius_rad: 67.0 * DEG };
    let outcome = |off_deg: f64, earth: Option<EarthDisc>, params: ModelParams| {
        let mut model = TrackerModel::new(params, None, 1, at(0));
        model.see_earth(earth);
        model.measure(0, at(0), &sensor_from_ra_dec_roll(off_deg * DEG, 0.0, 0.0), DVec3::ZERO)
    };
    assert_eq!(outcome(86.9, Some(earth), params), Outcome::NoSolution(Reason::StrayLight));
    for (off_deg, earth, params) in [(87.1, Some(earth), params), (10.0, None, params), (10.0, Some(earth), figures())]
    {
        assert!(matches!(outcome(off_deg, earth, params), Outcome::Solved(_)), "{off_deg} {earth:?}");
    }
}

#[test]
fn the_same_frames_give_the_same_bits_in_any_order() {
    let params = figures();
    let mut forward = TrackerModel::new(params, None, 7, at(0));
    let mut backward = TrackerModel::new(params, None, 7, at(0));
    let measure = |model: &mut TrackerModel, frame: u32| match model.measure(frame, at(0), &station(frame), DVec3::ZERO)
    {
        Outcome::Solved(solution) => solution.sensor_from_icrf,
        Outcome::NoSolution(reason) => unreachable!("{reason}"),
    };
    let there: Vec<_> = (0..50).map(|frame| measure(&mut forward, frame)).collect();
    let mut back: Vec<_> = (0..50).rev().map(|frame| measure(&mut backward, frame)).collect();
    back.reverse();
    assert_eq!(there, back);
    let mut other = TrackerModel::new(params, None, 8, at(0));
    assert_ne!(there[0], measure(&mut other, 0), "control: another seed");
}

/// Geocentric places by the built-in ephemeris of astropy 8.0.2 (`get_body("moon")`), deg.
#[test]
fn the_moon_is_where_another_program_has_it() {
    for (utc, ra_deg, dec_deg) in
        [("2026-03-01T12:00:00Z", 138.759_103, 18.112_429), ("2026-06-15T00:00:00Z", 80.772_515, 27.912_127)]
    {
        let at = Tai::from_rfc3339(utc).unwrap();
        let (sin_ra, cos_ra) = (ra_deg * DEG).sin_cos();
        let (sin_dec, cos_dec) = (dec_deg * DEG).sin_cos();
        let wanted = DVec3::new(cos_dec * cos_ra, cos_dec * sin_ra, sin_dec);
        let off_deg = moon_direction_icrf(at).angle_between(wanted) / DEG;
        assert!(off_deg < 0.6, "{utc}: {off_deg} deg");
        let later = moon_direction_icrf(at + Span::from_s(7200.0)).angle_between(wanted) / DEG;
        assert!(later > 0.6, "control: two hours later {later} deg");
    }
}
