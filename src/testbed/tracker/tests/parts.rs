//! Geometry, aberration, guide stars, pairs and Wahba's problem, against formulae written afresh.

use super::super::adjust::{MatchedStar, adjust};
use super::super::{Geometry, GuideStars, TrackerParams, apparent};
use super::draw::{aberrated, gaussian, project, random_attitude};
use super::{super::centroid::Spot, *};
use crate::tracker::geometry::{Observation, davenport};
use crate::tracker::guide::PairIndex;
use base::axes::{Icrf, Rotation, Sensor};
use base::source::{direction_from_ra_dec, ra_dec_rad};
use base::units::{ARCSEC, DEG, MAS};
use glam::{DMat3, DVec2};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Newton stops at 1e-13 of the focal length.
const ROUND_TRIP_PX: f64 = 1e-8;

fn bent() -> Geometry {
    Geometry {
        focal_px: [2900.0, 2910.0],
        principal_point_px: [500.3, 521.8],
        distortion: [-0.2, 0.15, 5e-4, -2e-4, 0.01],
        ..Geometry::centred(1024, 1024, 2903.0)
    }
}

#[test]
fn distortion_round_trips() {
    let geometry = bent();
    let mut largest: f64 = 0.0;
    for step in 0..=40_u8 {
        let place = DVec2::new(f64::from(step) * 25.6 - 0.5, 1023.5 - f64::from(step.wrapping_mul(step) % 41) * 25.6);
        let direction = geometry.direction(place);
        let back = geometry.pixel(direction).expect("before the camera");
        assert!(back.distance(place) < ROUND_TRIP_PX, "{place} came back as {back}");
        assert!(project(&geometry, direction).expect("in front").distance(place) < ROUND_TRIP_PX, "own formula");
        let straight = Geometry { distortion: [0.0; 5], ..geometry };
        largest = largest.max(straight.pixel(direction).expect("in front").distance(place));
    }
    assert!(largest > 5.0, "control: the distortion must show, got {largest} px");
}

#[test]
fn turning_the_sensor_moves_places_as_the_derivative_says() {
    let geometry = bent();
    let direction = geometry.direction(DVec2::new(80.0, 900.0));
    let (place, slope) = geometry.pixel_and_turn(direction).expect("in front");
    let sky = Rotation::<Sensor, Icrf>::IDENTITY;
    for (axis, slope) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().zip(slope) {
        // Central differences of 1e-5 rad: truncation 1e-10 of the place, rounding 1e-7 px/rad.
        let at = |angle: f64| geometry.pixel(sky.rotated_by(axis * angle).apply(direction)).expect("in front");
        let measured = (at(1e-5) - at(-1e-5)) / 2e-5;
        assert!(measured.distance(slope) < 1e-3, "about {axis} at {place}: {measured}, derivative {slope}");
    }
}

#[test]
fn a_fold_is_refused() {
    let geometry = Geometry { distortion: [-20.0, 0.0, 0.0, 0.0, 0.0], ..bent() };
    let error = geometry.check().expect_err("folded");
    assert!(error.to_string().contains("k3 = [-20"), "{error}");
}

#[test]
fn bad_parameters_are_refused() {
    let good = Camera::wide().params;
    assert_eq!(good.check(), Ok(()));
    let refuse = |params: TrackerParams, name: &str| {
        let error = GuideStars::new(catalog(), &params, noon()).expect_err(name).to_string();
        assert!(error.contains(name) && error.contains("wanted"), "{error}");
    };
    refuse(TrackerParams { psf_sigma_px: 0.0, ..good }, "psf_sigma_px");
    refuse(TrackerParams { limiting_mag: f64::NAN, ..good }, "limiting_mag");
    refuse(TrackerParams { fewest_stars: 100, ..good }, "fewest_stars");
    refuse(TrackerParams { limiting_mag: 1.0, ..good }, "at least 100");
}

#[test]
fn aberration_agrees_with_stumpff() {
    let beta = beta();
    let mut random = StdRng::seed_from_u64(5);
    for _ in 0..100 {
        let u = random_attitude(&mut random).apply(DVec3::Z);
        let apart = apparent(u, beta).angle_between(aberrated(u, beta));
        // Third order: (1e-4)^3 rad = 2e-4 mas; the angle itself rounds at 1e-8 rad.
        assert!(apart < 0.01 * ARCSEC && apparent(u, beta).distance(aberrated(u, beta)) < 1e-3 * MAS, "{apart}");
        let first_order = (u + beta).normalize();
        assert!(apparent(u, beta).distance(first_order) < 2.0 * MAS, "first order errs by beta^2 / 2");
    }
}

/// Meeus, *Astronomical Algorithms*, 2nd ed. 1998, example 23.a: theta Persei on 2028 November 13.19 TD, annual
/// aberration +30.045 arcsec in right ascension and +6.697 arcsec in declination (its low-accuracy method, 0.1 arcsec).
#[test]
fn earth_velocity_gives_the_published_aberration() {
    let at = Tai::from_rfc3339("2028-11-13T04:32:27Z").expect("a time");
    // J2000.0 place; the published shift is along the axes of date, 0.39 deg of precession away: 0.15 arcsec.
    let theta_persei = direction_from_ra_dec(41.050 * DEG, 49.228 * DEG);
    let [ra, dec] = ra_dec_rad(theta_persei);
    let [moved_ra, moved_dec] = ra_dec_rad(apparent(theta_persei, earth_beta(at)));
    let (east, north) = ((moved_ra - ra) * dec.cos() / ARCSEC, (moved_dec - dec) / ARCSEC);
    let (published_east, published_north) = (30.045 * (49.348_5 * DEG).cos(), 6.697);
    assert!((east.hypot(north) - published_east.hypot(published_north)).abs() < 0.1, "{east} {north}");
    assert!((east - published_east).abs() < 0.25 && (north - published_north).abs() < 0.25, "{east} {north}");
}

#[test]
fn pair_ranges_agree_with_brute_force() {
    let mut random = StdRng::seed_from_u64(6);
    let stars: Vec<_> = (0..300).map(|_| random_attitude(&mut random).apply(DVec3::Z)).collect();
    let index = PairIndex::new(&stars, 0.5 * DEG, 30.0 * DEG);
    let mut total = 0;
    for step in 0..60_u8 {
        let (angle, tolerance) = (f64::from(step) * 0.52 * DEG, 0.1 * DEG);
        let mut found = index.within(angle, tolerance).to_vec();
        found.sort_unstable();
        let mut wanted = Vec::new();
        for a in 0..300_u32 {
            for b in a + 1..300 {
                let between = stars[a as usize].dot(stars[b as usize]).acos();
                let indexed = (0.5 * DEG..=30.0 * DEG).contains(&between);
                if indexed && (between - angle).abs() <= tolerance {
                    wanted.push([a, b]);
                }
            }
        }
        assert_eq!(found, wanted, "about {angle} rad");
        total += found.len();
    }
    assert!(total > 500, "control: the ranges must not be empty, got {total}");
}

#[test]
fn davenport_recovers_the_attitude() {
    let mut random = StdRng::seed_from_u64(7);
    for count in [2, 3, 20] {
        for _ in 0..50 {
            let truth = random_attitude(&mut random);
            let stars: Vec<_> = (0..count).map(|_| random_attitude(&mut random).apply(DVec3::Z)).collect();
            let seen = stars.iter().map(|s| Observation { measured: truth.apply(*s), reference: *s, weight: 2.0 });
            let error = davenport(seen).rotation_vector_to(&truth).length();
            // Rounding, amplified where two of the random directions nearly coincide.
            assert!(error < 1e-7, "{count} stars: {error} rad");
        }
    }
}

/// TRIAD (Black 1964) with two exact directions must agree, axes and signs.
#[test]
fn triad_agrees() {
    let truth = random_attitude(&mut StdRng::seed_from_u64(8));
    let (a, b) = (DVec3::new(0.1, 0.05, 1.0).normalize(), DVec3::new(-0.2, 0.1, 1.0).normalize());
    let frame = |a: DVec3, b: DVec3| {
        let across = a.cross(b).normalize();
        DMat3::from_cols(a, across, a.cross(across))
    };
    let [sky_a, sky_b] = [a, b].map(|v| truth.inverse().apply(v));
    let matrix = frame(a, b) * frame(sky_a, sky_b).transpose();
    let pairs = [(a, sky_a), (b, sky_b)];
    let found =
        davenport(pairs.into_iter().map(|(measured, reference)| Observation { measured, reference, weight: 1.0 }));
    assert!(
        (found.matrix() - matrix).to_cols_array().iter().all(|element| element.abs() < 1e-9),
        "{:?}",
        found.matrix()
    );
}

/// Returns the twenty stars with Gaussian errors of known size.
fn noisy_matches(random: &mut StdRng, truth: &Rotation<Sensor, Icrf>, geometry: &Geometry) -> Vec<MatchedStar> {
    (0..20)
        .map(|star| {
            let place = DVec2::new(random.random::<f64>(), random.random::<f64>()) * 1000.0 + 10.0;
            let apparent_icrf = truth.inverse().apply(geometry.direction(place));
            let sigma = if star % 2 == 0 { 0.02 } else { 0.1 };
            let noise = DVec2::new(gaussian(random), gaussian(random)) * sigma;
            let covariance_px2 = [sigma * sigma, 0.0, sigma * sigma];
            let spot =
                Spot { place_px: place + noise, covariance_px2, flux_e: 1.0, flux_sigma_e: 0.1, saturated: false };
            MatchedStar { star, apparent_icrf, spot, residual_px: DVec2::ZERO, used: true }
        })
        .collect()
}

/// Sum over 400 attitudes of the squared error in units of its covariance: chi-square with 1200 degrees of freedom,
/// so the mean is 3 within 4 sqrt(6 / 400) = 0.49 (false alarm 6e-5, once for the seed).
#[test]
fn attitude_errors_follow_the_covariance() {
    let (mut random, geometry) = (StdRng::seed_from_u64(9), bent());
    let (mut squared, mut halved, mut chi) = (0.0, 0.0, 0.0);
    for _ in 0..400 {
        let truth = random_attitude(&mut random);
        let mut matches = noisy_matches(&mut random, &truth, &geometry);
        let start = truth.rotated_by(DVec3::new(1e-3, -2e-3, 3e-3));
        let found = adjust(&geometry, &start, &mut matches, 0.0).expect("twenty stars");
        let error = found.attitude.rotation_vector_to(&truth);
        squared += error.dot(found.covariance_rad2.inverse() * error) / 400.0;
        halved += error.dot((found.covariance_rad2 * 0.7).inverse() * error) / 400.0;
        chi += found.chi_square_per_dof / 400.0;
    }
    assert!((squared - 3.0).abs() < 0.49, "mean squared error {squared}, wanted 3");
    assert!((halved - 3.0).abs() > 0.49, "control: a covariance 0.7 times as large must be found out, got {halved}");
    // 37 degrees of freedom each: 4 sqrt(2 / 37 / 400).
    assert!((chi - 1.0).abs() < 0.047, "residuals: chi-square per degree of freedom {chi}");
}

#[test]
fn an_outlier_is_left_out() {
    let (mut random, geometry) = (StdRng::seed_from_u64(10), bent());
    let truth = random_attitude(&mut random);
    let mut matches = noisy_matches(&mut random, &truth, &geometry);
    matches[4].spot.place_px.x += 3.0;
    let found = adjust(&geometry, &truth, &mut matches, 0.0).expect("nineteen stars");
    assert!(!matches[4].used && found.used == 19, "used {}", found.used);
    assert!((matches[4].residual_px.x - 3.0).abs() < 0.1, "its residual is still reported: {}", matches[4].residual_px);
    assert!(found.attitude.rotation_vector_to(&truth).length() < 3.0 * ARCSEC * 2.0);
}

#[test]
fn two_stars_give_no_attitude() {
    let mut matches = noisy_matches(&mut StdRng::seed_from_u64(11), &Rotation::IDENTITY, &bent());
    assert!(adjust(&bent(), &Rotation::IDENTITY, &mut matches[..2], 0.0).is_none());
}

#[test]
fn proper_motion_is_carried() {
    // Epsilon Indi, G 4.3: 3.961 and -2.539 arcsec/yr (van Leeuwen 2007), so 10 years move it by 47.05 arcsec.
    let guide_at = |text: &str| {
        GuideStars::new(catalog(), &Camera::narrow().params, Tai::from_rfc3339(text).expect("a time")).expect("guide")
    };
    let (then, later) = (guide_at("2016-01-01T12:00:00Z"), guide_at("2026-01-01T12:00:00Z"));
    let axis = direction_from_ra_dec(330.84 * DEG, -56.786 * DEG);
    let near = |guide: &GuideStars| {
        let stars = guide.stars.iter().filter(|s| s.mag_g < 5.0);
        *stars.min_by(|a, b| a.direction_icrf.distance(axis).total_cmp(&b.direction_icrf.distance(axis))).expect("one")
    };
    let (a, b) = (near(&then), near(&later));
    assert_eq!(a.id, b.id);
    let moved = a.direction_icrf.distance(b.direction_icrf) / ARCSEC;
    assert!((moved - 47.05).abs() < 0.1, "{moved} arcsec");
}

/// The pattern stars a field holds, over 2000 random fields.
#[test]
fn fields_have_pattern_stars() {
    for (camera, guide) in [(Camera::wide(), wide_guide()), (Camera::coarse(), coarse_guide())] {
        let mut random = StdRng::seed_from_u64(12);
        let mut out = Vec::new();
        let mut counts: Vec<usize> = (0..2000)
            .map(|_| {
                let attitude = random_attitude(&mut random);
                guide.in_field(guide.pattern_stars(), 1000, &attitude, beta(), &camera.params.geometry, &mut out);
                out.len()
            })
            .collect();
        counts.sort_unstable();
        println!(
            "pattern stars in a field: least {}, 1 % {}, median {}, most {}",
            counts[0], counts[20], counts[1000], counts[1999]
        );
        assert!(counts[2] >= 8, "at least 8 in all but one of a thousand fields: {:?}", &counts[..5]);
        assert!((1500..=3000).contains(&guide.pattern_stars()), "{}", guide.pattern_stars());
    }
}

#[test]
fn doubles_are_merged_or_left_out() {
    let params = Camera::wide().params;
    let guide = wide_guide();
    // A star within 2.5 spot widths of a brighter one is pulled by 0.2 px and more: it must be out.
    let reach = 2.5 * params.pixel_psf_sigma_px() * params.geometry.ifov_rad();
    let mut sorted: Vec<_> = guide.stars.to_vec();
    sorted.sort_unstable_by(|a, b| a.direction_icrf.z.total_cmp(&b.direction_icrf.z));
    for (at, star) in sorted.iter().enumerate() {
        let close = sorted[at + 1..].iter().take_while(|other| other.direction_icrf.z - star.direction_icrf.z < reach);
        for other in close {
            let apart = other.direction_icrf.distance(star.direction_icrf);
            assert!(apart > reach, "{star:?} {other:?}: {} px", apart / params.geometry.ifov_rad());
        }
    }
    // Control: the catalog itself has such pairs, so stars must have gone.
    let bright = catalog().sources().iter().filter(|s| f64::from(s.mag_g) <= params.limiting_mag).count();
    assert!(guide.stars.len() < bright, "{} of {bright}", guide.stars.len());
}
