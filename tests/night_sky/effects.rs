//! Effects that a camera has or lacks: each is found within its error where it is, and not found where it is not.

use super::{attitude, compared, file, frame, frame_of, taking};
use base::{axes::sensor_from_ra_dec_roll, units::DEG};
use config::{Camera, Document};
use frames::sink::fits::{Header, Pixels, write_image};
use starloop_night_sky::outliers::hipparcos;
use starloop_night_sky::{Comparer, Comparison, Options, Picture};
use std::path::Path;
use tempfile::TempDir;

/// Hipparcos number of T Vulpeculae, a Cepheid of G = 5.5, and a frame about it: right ascension, declination, roll, deg.
const CEPHEID: u32 = 102_949;
const ABOUT_CEPHEID: [f64; 3] = [312.9, 28.3, 331.3];

fn result_of(picture: &Picture) -> Comparison {
    compared(picture, Options::default()).unwrap().result
}

#[test]
fn a_second_radial_term_is_found_where_the_camera_has_one() {
    let bent = taking().replace("k1 = 0.11", "k1 = 0.11\nk2 = 25.0");
    let found = result_of(&frame_of(&bent, attitude([0.0; 3]), 11));
    let error = found.k2_error.unwrap();
    assert!((found.k2 - 25.0).abs() < 4.0 * error && error < 6.0, "{} +- {error}", found.k2);
    assert!(found.agrees && found.centroid_robust_px < 0.1, "{:?}", found.failures);
}

#[test]
fn an_optical_axis_off_the_middle_is_found_where_the_camera_has_one() {
    let off = taking().replace("[optics]", "[optics]\nprincipal_point_px = [591.5, 333.5]");
    let found = result_of(&frame_of(&off, attitude([0.0; 3]), 12));
    let errors = found.principal_point_errors_px.unwrap();
    for (i, wanted) in [591.5, 333.5].into_iter().enumerate() {
        let away = found.principal_point_px[i] - wanted;
        assert!(away.abs() < 4.0 * errors[i] && errors[i] < 30.0, "{away} +- {}", errors[i]);
    }
    assert!(found.agrees, "{:?}", found.failures);
}

#[test]
fn a_camera_without_these_effects_has_none_of_them() {
    for seed in 20..23 {
        let found = result_of(&frame(seed));
        assert_eq!((found.k2_error, found.principal_point_errors_px), (None, None), "{seed}");
        assert!(found.response_gamma.is_none() && !found.edge_is_by_stars, "{seed}: {:?}", found.response_slope);
        assert!(found.agrees && found.outliers <= 1, "{seed}: {:?} {:?}", found.failures, found.worst_stars);
        assert!(found.limited_by.iter().all(|words| words.starts_with("noise")), "{:?}", found.limited_by);
    }
}

#[test]
fn vignetting_is_that_of_the_stars_where_the_background_is_an_offset() {
    let text = taking().replace("window_radius_mm = 14.0", "window_radius_mm = 10.0");
    let offset = text
        .replace("mag_per_arcsec2 = 16.2\n", "")
        .replace("gradient = [0.1, 0.5]\n", "")
        .replace("quadratic = -0.3\n", "")
        .replace("uniform_e_per_s = 450.0", "uniform_e_per_s = 1800.0");
    let camera = Camera::from_document(&Document::from_text(&offset, Path::new("offset.toml"))).unwrap();
    let params = run::wiring::camera_parts::camera_params(&camera).unwrap();
    let wanted = params.illumination.at(glam::DVec2::X * params.geometry.half_diagonal_rad().tan());
    let found = result_of(&frame_of(&offset, attitude([0.0; 3]), 13));
    assert!(found.edge_is_by_stars && wanted < 0.6, "{wanted}");
    let away_mag = -2.5 * (found.edge_illumination / wanted).log10();
    assert!(away_mag.abs() < 4.0 * found.edge_by_stars_mag[1].max(0.03), "{away_mag} mag of {wanted}");
    assert!(found.edge_by_stars_mag[0].abs() < 4.0 * found.edge_by_stars_mag[1], "{:?}", found.edge_by_stars_mag);
    assert!(found.agrees, "{:?}", found.failures);
}

#[test]
fn a_response_curve_is_found_with_its_exponent() {
    let picture = frame(14);
    let curved = picture.map(|_, dn| (4095.0 * (dn / 4095.0).powf(1.0 / 1.5)).round());
    let found = result_of(&curved);
    let [gamma, error] = found.response_gamma.unwrap();
    assert!((gamma - 1.5).abs() < 4.0 * error && error < 0.2, "{gamma} +- {error}");
    assert!(found.response_slope[0] < 0.0, "bright stars are too faint: {:?}", found.response_slope);
    assert!(found.limited_by.iter().any(|words| words.contains("the image's response")), "{:?}", found.limited_by);
}

/// Returns a picture in which the light of stars at these places is multiplied.
fn changed(picture: &Picture, places: &[[f64; 2]], factor: f32) -> Picture {
    const HALF_PX: f64 = 5.0;
    let width = picture.size_px[0];
    picture.map(|i, dn| {
        let at = [(i % width) as f64, (i / width) as f64];
        let is_near = |px: &&[f64; 2]| (0..2).all(|k| (px[k] - at[k]).abs() <= HALF_PX);
        let Some(px) = places.iter().find(is_near) else { return dn };
        let beside = picture.at((px[0] - 8.0) as usize, px[1] as usize) as f32;
        (beside + factor * (dn - beside)).round().clamp(0.0, 4095.0)
    })
}

#[test]
fn a_variable_star_is_named_and_does_not_decide() {
    let [ra, dec, roll] = ABOUT_CEPHEID.map(|deg| deg * DEG);
    let picture = frame_of(&taking(), sensor_from_ra_dec_roll(ra, dec, roll), 15);
    let before = result_of(&picture);
    assert!(before.agrees, "{:?}", before.failures);
    let number = |name: &Option<String>| name.as_ref().and_then(|name| hipparcos(name.parse().unwrap()));
    let cepheid = before.star_rows.iter().find(|row| number(&row.name) == Some(CEPHEID)).unwrap();
    let after = result_of(&changed(&picture, &[[cepheid.x_px, cepheid.y_px]], 4.0));
    assert!(after.agrees && after.unexplained_outliers <= 1, "{:?} {:?}", after.failures, after.worst_stars);
    let star = after.worst_stars.iter().find(|star| star.hipparcos == Some(CEPHEID)).unwrap();
    assert!(star.is_outlier && star.is_explained && (star.dmag + 1.5).abs() < 0.3, "{star:?}");
    assert!(star.words().contains("variable T Vul, type DCEP"), "{}", star.words());
    assert!(after.mag_rms > 0.15 && after.mag_robust < before.mag_rms + 0.03, "control: the plain figure is beyond");
    // Stars that nothing explains are counted: some are too many.
    let others: Vec<[f64; 2]> = before
        .star_rows
        .iter()
        .filter(|row| number(&row.name) != Some(CEPHEID) && (5.8..7.5).contains(&row.mag_g))
        .take(8)
        .map(|row| [row.x_px, row.y_px])
        .collect();
    let wrong = result_of(&changed(&picture, &others, 2.5));
    assert!(!wrong.agrees && wrong.failures.iter().any(|why| why.contains("outliers")), "{:?}", wrong.failures);
}

#[test]
fn the_limits_grow_with_the_noise_of_the_frame() {
    let noisy = taking().replace("read_noise_e_rms = 6.0", "read_noise_e_rms = 40.0").replace(
        "model = \"halo\"\nsigma_px = 0.5\nhalo_sigma_px = 1.0\nhalo_share = 0.4",
        "model = \"gaussian\"\nsigma_px = 1.2",
    );
    let [quiet, noisy] = [frame(16), frame_of(&noisy, attitude([0.0; 3]), 16)].map(|picture| result_of(&picture));
    for one in [&quiet, &noisy] {
        assert!(one.centroid_limit_px <= 0.15_f64.hypot(one.drawn_centroid_rms_px) + 1e-9, "{}", one.centroid_limit_px);
        assert!(one.mag_limit <= 0.15_f64.hypot(one.drawn_mag_rms) + 1e-9 && one.mag_limit > 0.15);
    }
    assert!(noisy.centroid_limit_px > quiet.centroid_limit_px + 0.005, "{}", noisy.centroid_limit_px);
    assert!(noisy.agrees, "{:?}", noisy.failures);
}

#[test]
fn shapes_that_change_over_the_field_are_named_as_the_limit() {
    const CELL_PX: usize = 48;
    let picture = frame(17);
    let [width, height] = picture.size_px;
    let torn = picture.map(|i, dn| {
        let (x, y) = (i % width, i / width);
        let cell = base::random::philox([(x / CELL_PX) as u32, (y / CELL_PX) as u32, 0, 0], [3, 5]);
        let off = [cell[0] % 5, cell[1] % 5].map(|word| word as usize);
        let (from_x, from_y) = ((x + off[0]).saturating_sub(2), (y + off[1]).saturating_sub(2));
        (0.5 * (dn + picture.at(from_x.min(width - 1), from_y.min(height - 1)) as f32)).round()
    });
    let found = result_of(&torn);
    assert!(!found.agrees, "{}", found.centroid_robust_px);
    assert!(found.limited_by.iter().any(|words| words.contains("the stars' shapes")), "{:?}", found.limited_by);
}

#[test]
fn a_bottom_up_fits_file_without_an_order_of_rows_is_turned_over() {
    let picture = frame(18);
    let folder = TempDir::new().unwrap();
    let rows = picture.dn.chunks_exact(picture.size_px[0]);
    let comparer = Comparer::new(&super::document(), Path::new(super::START), Options::default()).unwrap();
    let mut rolls = Vec::new();
    for (name, values, flipped) in [
        ("top.fits", rows.clone().flatten().copied().collect::<Vec<f32>>(), None),
        ("bottom.fits", rows.rev().flatten().copied().collect(), Some("rows")),
    ] {
        let mut bytes = Vec::new();
        let [width, height] = picture.size_px;
        write_image(&mut bytes, width, height, Pixels::F32(&values), &Header::default()).unwrap();
        let found = comparer.compare(&file(&folder, name, &bytes)).unwrap().result;
        assert!(found.agrees && found.flipped.as_deref() == flipped, "{name}: {:?}", found.flipped);
        rolls.push(found.roll_deg);
    }
    assert!((rolls[0] - rolls[1]).abs() < 1e-6, "{rolls:?}");
    // A file that states its order is taken at its word.
    let mut header = Header::default();
    header.push("ROWORDER", "TOP-DOWN", "");
    let upside_down: Vec<f32> = picture.dn.chunks_exact(picture.size_px[0]).rev().flatten().copied().collect();
    let mut bytes = Vec::new();
    write_image(&mut bytes, picture.size_px[0], picture.size_px[1], Pixels::F32(&upside_down), &header).unwrap();
    let error = comparer.compare(&file(&folder, "stated.fits", &bytes)).err().unwrap().to_string();
    assert!(error.contains("mirrored") && error.contains("--flip rows"), "{error}");
}

#[test]
fn offsets_of_pixels_and_dark_current_are_drawn_once() {
    let uneven =
        taking().replace("dsnu_e_rms = 0.5", "dsnu_e_rms = 9.0").replace("dark_e_per_s = 0.0", "dark_e_per_s = 400.0");
    assert!(uneven.contains("dsnu_e_rms = 9.0") && uneven.contains("dark_e_per_s = 400.0"), "control");
    let folder = TempDir::new().unwrap();
    let picture = frame_of(&uneven, attitude([0.0; 3]), 19);
    let path = file(&folder, "frame.tiff", &super::tiff(&picture, 16.0));
    let camera = Path::new("taking.toml");
    let comparer = Comparer::new(&Document::from_text(&uneven, camera), camera, Options::default()).unwrap();
    let found = comparer.compare(&path).unwrap().result;
    assert!((found.background_noise_ratio - 1.0).abs() < 0.03, "{}", found.background_noise_ratio);
    let more_dn = found.background.drawn_mean_dn - found.background.real_mean_dn;
    assert!(more_dn.abs() < 5.0, "{more_dn} DN; the dark current alone is 44 DN");
}
