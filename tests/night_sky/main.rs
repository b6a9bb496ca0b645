//! Fields drawn with a known attitude and camera come back; other pictures are refused, or do not agree.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::float_cmp,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a test may stop at the first surprise and compares exact values where exactness is the claim"
)]

mod effects;

use base::axes::{Icrf, Rotation, Sensor, sensor_from_ra_dec_roll};
use base::refused::Refused;
use base::units::{ARCSEC, DEG};
use config::{Camera, Document};
use frames::sink::png::write_dn_raw;
use starloop_night_sky::read::{self, MOST_PIXELS};
use starloop_night_sky::{Compared, Comparer, Options, Picture};
use starloop_night_sky::{draw::draw, picture::Flip, sky_stars::When};
use stars::Sky;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use tiff::encoder::{TiffEncoder, colortype::Gray16};

/// The camera that frames are compared with.
const START: &str = "cameras/imx265_35mm.toml";

/// Keys of the camera that takes the frames, which the camera at the start lacks.
const CHANGED: &str = "
[distortion]
k1 = 0.11
p1 = 2e-4
[psf]
model = \"halo\"
sigma_px = 0.5
halo_sigma_px = 1.0
halo_share = 0.4
[illumination]
cos4 = true
window_radius_mm = 14.0
window_distance_mm = 90.0
[background]
uniform_e_per_s = 450.0
gradient = [0.1, 0.5]
quadratic = -0.3
mag_per_arcsec2 = 16.2
[exposure]
exposure_s = 0.3
";

/// Right ascension, declination, roll of the frames, degrees.
const POINTING: [f64; 3] = [286.4, 28.9, 331.3];

fn document() -> Document {
    Document::built_in(START).unwrap()
}

/// Text of the camera that takes the frames.
fn taking() -> String {
    let text = document().text().to_owned();
    let kept = text.split("[psf]").next().unwrap();
    let radiometry = "[radiometry]\nlimiting_mag = 8.5\ncolor_c1 = 0.08\n";
    kept.replace("focal_length_mm = 35.0", "focal_length_mm = 35.15")
        .replace("read_noise_e_rms = 4.5", "read_noise_e_rms = 6.0")
        + radiometry
        + CHANGED
}

fn attitude(off_deg: [f64; 3]) -> Rotation<Sensor, Icrf> {
    let [ra, dec, roll] = [0, 1, 2].map(|i| (POINTING[i] + off_deg[i]) * DEG);
    sensor_from_ra_dec_roll(ra, dec, roll)
}

fn frame(seed: u64) -> Picture {
    frame_of(&taking(), attitude([0.0; 3]), seed)
}

/// Draws a frame of a camera file.
fn frame_of(camera: &str, attitude: Rotation<Sensor, Icrf>, seed: u64) -> Picture {
    let camera = Camera::from_document(&Document::from_text(camera, Path::new("taking.toml"))).unwrap();
    let sky = Sky::open(&[], 8.5, 64).unwrap();
    let when = When { at: None, epoch_yr: sky.layers.epoch_yr() };
    draw(&camera, attitude, &sky, &when, seed).unwrap().picture
}

/// Writes a picture as a TIFF file of 16 bits, its values times `scale`.
fn tiff(picture: &Picture, scale: f32) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let values: Vec<u16> = picture.dn.iter().map(|dn| (dn * scale) as u16).collect();
    let [width, height] = picture.size_px.map(|side| side as u32);
    TiffEncoder::new(&mut bytes).unwrap().write_image::<Gray16>(width, height, &values).unwrap();
    bytes.into_inner()
}

fn file(folder: &TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn compared(picture: &Picture, options: Options) -> Result<Compared, Refused> {
    let folder = TempDir::new().unwrap();
    let path = file(&folder, "frame.tiff", &tiff(picture, 16.0));
    Comparer::new(&document(), Path::new(START), options).unwrap().compare(&path)
}

#[test]
fn a_drawn_field_gives_its_attitude_and_its_camera_back() {
    let one = compared(&frame(3), Options::default()).unwrap();
    let result = &one.result;
    assert!(result.agrees, "{:?}", result.failures);
    let off = (result.ra_deg - POINTING[0]) * (POINTING[1] * DEG).cos();
    let arcsec = (off.hypot(result.dec_deg - POINTING[1])) * DEG / ARCSEC;
    assert!(arcsec < 3.0, "{arcsec} arcsec");
    assert!((result.roll_deg - POINTING[2]).abs() < 0.005, "{}", result.roll_deg);
    assert!((result.focal_length_mm[0] - 35.15).abs() < 0.005, "{:?}", result.focal_length_mm);
    assert!((result.k1 - 0.11).abs() < 0.02, "{}", result.k1);
    // Both terms together, at the colour of most stars; the truth has 0.08 per magnitude.
    let at_one = result.colour[0] + result.colour[1];
    assert!((at_one - 0.08).abs() < 0.06, "{:?}", result.colour);
    assert!(result.mag_rms < 0.08 && result.missing == 0, "{} {}", result.mag_rms, result.missing);
    assert!(
        result.edge_by_stars_mag[0].abs() < 4.0 * result.edge_by_stars_mag[1].max(0.02),
        "{:?}",
        result.edge_by_stars_mag
    );
    let words = starloop_night_sky::report::text(core::slice::from_ref(&one));
    assert!(words.starts_with("AGREES: 1 of 1 images"), "{words}");
    let json: serde_json::Value =
        serde_json::from_str(&starloop_night_sky::report::json(core::slice::from_ref(&one)).unwrap()).unwrap();
    assert!(json["images"][0]["centroid_rms_px"].as_f64().unwrap() < 0.15 && json["schema_version"] == 1);
    assert!((result.gain_e_per_dn / 2.7 - 1.0).abs() < 0.1, "{}", result.gain_e_per_dn);
    assert!((result.background_noise_ratio - 1.0).abs() < 0.03, "{}", result.background_noise_ratio);
    assert!(result.ensquared_energy_difference.abs() < 0.015, "{:?}", result.energy);
    // The fitted file is a camera file, and says what was fitted.
    let camera = Camera::from_document(&Document::from_text(&one.camera_text, Path::new("fitted.toml"))).unwrap();
    assert!((camera.optics.focal_length_mm - result.focal_length_mm[0]).abs() < 1e-6);
}

#[test]
fn an_attitude_two_pixels_off_does_not_agree() {
    let given = |off_deg| Options { attitude: Some(attitude(off_deg)), ..Options::default() };
    let pixel_deg = 40.5 / 3600.0;
    let shifted = compared(&frame(4), given([0.0, 2.0 * pixel_deg, 0.0])).unwrap().result;
    assert!(!shifted.agrees && shifted.failures.iter().any(|why| why.contains("centroids")), "{:?}", shifted.failures);
    assert!(shifted.attitude_given);
}

#[test]
fn the_wrong_camera_a_mirrored_frame_and_a_blank_one_are_refused() {
    let picture = frame(5);
    let folder = TempDir::new().unwrap();
    let path = file(&folder, "frame.tiff", &tiff(&picture, 16.0));
    let other = document().text().replace("focal_length_mm = 35.0", "focal_length_mm = 50.0");
    let wrong = Comparer::new(
        &Document::from_text(&other, Path::new("other.toml")),
        Path::new("other.toml"),
        Options::default(),
    )
    .unwrap();
    let error = wrong.compare(&path).err().unwrap().to_string();
    assert!(error.contains("no attitude found") && error.contains("optics.focal_length_mm"), "{error}");
    let [width, _] = picture.size_px;
    let rows = picture.dn.chunks(width).flat_map(|row| row.iter().rev().copied());
    let mirrored = Picture { size_px: picture.size_px, dn: rows.collect() };
    let error = compared(&mirrored, Options::default()).err().unwrap().to_string();
    assert!(error.contains("mirrored left to right") && error.contains("--flip columns"), "{error}");
    assert!(!error.contains("focal_length"), "the scale is right: {error}");
    // The same of a camera file whose scale is 2.5 % off.
    let path = file(&folder, "mirrored.tiff", &tiff(&mirrored, 16.0));
    let near = document().text().replace("focal_length_mm = 35.0", "focal_length_mm = 34.3");
    let near = Document::from_text(&near, Path::new("near.toml"));
    let near = Comparer::new(&near, Path::new("near.toml"), Options::default()).unwrap();
    let error = near.compare(&path).err().unwrap().to_string();
    assert!(error.contains("mirrored left to right"), "{error}");
    let turned = compared(&mirrored, Options { flip: Some(Flip::Columns), ..Options::default() }).unwrap().result;
    assert!(turned.agrees && turned.flipped.as_deref() == Some("columns"), "{:?}", turned.failures);
    let blank = picture.map(|_, _| 100.0);
    let error = compared(&blank, Options::default()).err().unwrap().to_string();
    assert!(error.contains("0 stars above"), "{error}");
    let noise = picture.map(|i, _| 100.0 + base::random::philox([i as u32, 0, 0, 0], [1, 2])[0] as f32 / 5e8);
    assert!(compared(&noise, Options::default()).is_err(), "noise alone");
}

#[test]
fn a_frame_whose_lower_half_is_shifted_does_not_agree() {
    let picture = frame(6);
    let [width, height] = picture.size_px;
    let torn = picture.map(|i, _| {
        let (x, y) = (i % width, i / width);
        picture.dn[y * width + if y > height / 2 { (x + 2) % width } else { x }]
    });
    match compared(&torn, Options::default()) {
        Ok(one) => assert!(!one.result.agrees, "{} px", one.result.centroid_rms_px),
        Err(error) => assert!(error.to_string().contains("attitude"), "{error}"),
    }
}

#[test]
fn tiff_png_and_fits_hold_the_same_numbers_left_justified_or_not() {
    let picture = Picture { size_px: [40, 30], dn: (0..1200).map(|i| (i * 3 % 4096) as f32).collect() };
    let folder = TempDir::new().unwrap();
    let mut image = base::image::DnImage::new(40, 30);
    image.pixels_mut().iter_mut().zip(&picture.dn).for_each(|(pixel, dn)| *pixel = *dn as u16);
    let mut png = Vec::new();
    write_dn_raw(&mut png, &image).unwrap();
    let mut fits = Vec::new();
    let mut sent = frames::sink::SentFrame::with_capacity(40, 30, 0, "camera".into());
    sent.image = image;
    frames::sink::fits::write_frame(&mut fits, &sent).unwrap();
    let mut packed = Vec::new();
    frames::sink::fits::write_compressed_frame(&mut packed, &sent).unwrap();
    for (name, bytes) in [
        ("a.tiff", tiff(&picture, 1.0)),
        ("b.tiff", tiff(&picture, 16.0)),
        ("c.png", png),
        ("d.fits", fits),
        ("e.fits.fz", packed),
    ] {
        let path = file(&folder, name, &bytes);
        assert_eq!(read::read(&path, [40, 30], 12).unwrap().picture, picture, "{name}");
        let error = read::read(&path, [30, 40], 12).unwrap_err().to_string();
        assert!(error.contains("40 x 30 pixels") && error.contains("30 x 40"), "{error}");
        damaged(&folder, name, &bytes);
    }
    let path = file(&folder, "odd.tiff", &tiff(&picture, 5.0));
    assert!(read::read(&path, [40, 30], 12).unwrap_err().to_string().contains("12 bits"));
}

/// A file that is cut short is refused; one with other bytes in its head is refused or read, without a panic.
fn damaged(folder: &TempDir, name: &str, bytes: &[u8]) {
    for cut in (0..bytes.len() - 1).step_by(37) {
        let path = file(folder, name, &bytes[..cut]);
        // The bytes after the last pixel may be lost.
        if let Ok(picture) = read::read_raw(&path) {
            assert!(
                cut + 2880 > bytes.len() || name.ends_with("png"),
                "{name}: {cut} of {} bytes: {:?}",
                bytes.len(),
                picture.picture.size_px
            );
        }
    }
    for place in 0..bytes.len().min(400) {
        for value in [0, 1, 127, 255] {
            let mut changed = bytes.to_vec();
            changed[place] = value;
            let _ = read::read_raw(&file(folder, name, &changed));
        }
    }
}

#[test]
fn what_is_no_image_is_refused_with_what_is_wanted() {
    let folder = TempDir::new().unwrap();
    let refusal = |name: &str, bytes: &[u8]| read::read_raw(&file(&folder, name, bytes)).unwrap_err().to_string();
    assert!(refusal("a.txt", b"hello").contains("wanted TIFF, PNG or FITS, got a file that starts with 68 65"));
    assert!(refusal("b", b"").contains("an empty file"));
    assert!(read::read_raw(folder.path()).unwrap_err().to_string().contains("this is not a file"));
    assert!(read::read_raw(&folder.path().join("none")).unwrap_err().to_string().contains("cannot be read"));
    // A size of 65,535 x 65,535 px in a file of a few bytes: refused before memory is taken.
    let mut huge = tiff(&Picture { size_px: [8, 8], dn: vec![0.0; 64] }, 1.0);
    let small = 8_u32.to_le_bytes();
    let places: Vec<usize> =
        huge.windows(4).enumerate().filter(|(_, four)| *four == small).map(|(place, _)| place).collect();
    places.into_iter().for_each(|place| huge[place..place + 4].copy_from_slice(&65_535_u32.to_le_bytes()));
    let message = refusal("huge.tiff", &huge);
    assert!(message.contains(&MOST_PIXELS.to_string()) || message.contains("damaged"), "{message}");
}
