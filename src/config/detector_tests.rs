//! `[detector]` beyond its geometry: what is taken, and what is refused with which words.

use super::*;
use image::detector::{DarkLaw, LinePattern, Rounding, RowNoise};
use std::path::Path;

fn camera_at(path: &Path, lines: &str) -> Result<Detector, String> {
    let text = format!("[detector]\nwidth_px = 64\nheight_px = 48\n{lines}\n[optics]\nfocal_length_mm = 25\n");
    let camera = Camera::from_document(&Document::from_text(&text, path));
    camera.map(|camera| camera.detector).map_err(|error| error.to_string())
}

fn detector(lines: &str) -> Result<Detector, String> {
    camera_at(Path::new("lab/cam.toml"), lines)
}

#[test]
fn effects_without_keys_are_off() {
    let plain = detector("").expect("a camera");
    assert_eq!(plain.params.dark_law, DarkLaw { reference_c: 20.0, operating_c: 20.0, ..DarkLaw::AT_REFERENCE });
    assert_eq!((plain.params.line_pattern, plain.params.row_noise), (LinePattern::OFF, RowNoise::OFF));
    assert_eq!((plain.params.rounding, plain.params.nonlinearity.is_on()), (Rounding::Nearest, false));
    assert_eq!((plain.params.amplifier_noise_e_rms, plain.params.dark_nonuniformity), (0.0, 0.0));
    assert_eq!(plain.maps, image::detector::Patterns::default());
}

#[test]
fn the_dark_current_is_a_rate_or_a_density_at_a_temperature() {
    let found = detector("dark_e_per_s = 40\ndark_temperature_c = 25").expect("today's keys");
    assert_eq!((found.params.dark_e_per_s, found.params.dark_law.factor()), (40.0, 1.0), "nothing is scaled");
    let found =
        detector("dark_current_na_per_cm2 = 0.1\npixel_pitch_um = 18.0\ntemperature_c = 6.0").expect("a density");
    // 0.1e-9 * (18e-4)^2 / 1.602176634e-19, and two doublings of 7 K colder.
    assert!((found.params.dark_e_per_s / 2022.2488 - 1.0).abs() < 1e-6, "{}", found.params.dark_e_per_s);
    assert!((found.params.dark_law.factor() - 0.25).abs() < 1e-12, "{:?}", found.params.dark_law);
    let found = detector("temperature_c = 30.0\ndark_doubling_k = 5.0").expect("a law");
    assert!((found.params.dark_law.factor() - 4.0).abs() < 1e-12);
}

#[test]
fn spreads_are_rms_or_peak_to_peak() {
    let found = detector("prnu_pp = 0.06\ndsnu_e_pp = 30.0").expect("six sigmas");
    assert!((found.params.prnu - 0.01).abs() < 1e-15 && (found.params.dsnu_e_rms - 5.0).abs() < 1e-12);
    let found = detector("prnu_pp = 0.05\npp_sigmas = 5.0").expect("five");
    assert!((found.params.prnu - 0.01).abs() < 1e-15 && found.params.dsnu_e_rms == 1.0);
}

#[test]
fn the_gain_follows_a_rule_or_is_given() {
    let of = |lines: &str| detector(&format!("full_well_e = 40960.0\nblack_level_dn = 95.0\n{lines}"));
    assert!((of("").expect("fills the range").params.gain_e_per_dn - 10.24).abs() < 1e-12);
    assert!((of("gain_rule = \"lsb\"").expect("the paper's").params.gain_e_per_dn - 10.0).abs() < 1e-12);
    let found = of("gain_e_per_dn = 3.0\nrounding = \"truncate\"").expect("given");
    assert_eq!((found.params.gain_e_per_dn, found.params.rounding), (3.0, Rounding::Truncate));
}

#[test]
fn tables_switch_effects_on() {
    let found = detector(
        "lines = { column_e_rms = 2.0, row_e_rms = 1.0 }\nrow_noise = { e_rms = 1.5, corner_cycles_per_row = 0.02 }\n\
         nonlinearity = { knots_e = [[10000, 9990], [20000, 19500]] }\namplifier_noise_e_rms = 3.0",
    )
    .expect("a camera");
    assert_eq!(found.params.line_pattern, LinePattern { column_e_rms: 2.0, column_gain_rms: 0.0, row_e_rms: 1.0 });
    assert_eq!(found.params.row_noise, RowNoise { e_rms: 1.5, corner_cycles_per_row: 0.02 });
    assert_eq!(found.params.nonlinearity.knots_e(), [[10_000.0, 9990.0], [20_000.0, 19_500.0]]);
    assert_eq!(found.params.amplifier_noise_e_rms, 3.0);
}

#[test]
fn contradictions_are_refused_with_what_to_try() {
    for (lines, parts) in [
        (
            "full_well_e = 500.0\ngain_e_per_dn = 10.0",
            ["detector.full_well_e is 500", "50.0 DN", "lower black_level_dn"],
        ),
        ("black_level_dn = 4095.0", ["detector.black_level_dn", "0 to 4094", "range for signal"]),
        ("gain_rule = \"lsb\"\ngain_e_per_dn = 2.0", ["gain_e_per_dn is 2", "gain_rule", "give the gain, or the rule"]),
        ("gain_rule = \"lsp\"", ["detector.gain_rule", "\"lsb\"", "full well / 2^bits"]),
        ("rounding = \"up\"", ["detector.rounding", "\"truncate\"", "whole number"]),
        ("dark_doubling_k = 0.0", ["detector.dark_doubling_k is 0", "above 0", "double the dark current"]),
        ("temperature_c = -300.0", ["-300; wanted a number from -273.15 to 200", "Celsius", "detector.temperature_c"]),
        ("temperature_c = 190.0\ndark_e_per_s = 1e4", ["detector.temperature_c", "e-/s", "nearer to the detector's"]),
        ("dark_current_na_per_cm2 = 1.0\ndark_e_per_s = 1.0", ["dark_current_na_per_cm2", "dark_e_per_s (1)", "once"]),
        ("dark_current_na_per_cm2 = -1.0", ["dark_current_na_per_cm2", "0 to 1000000", "square centimetre"]),
        ("dark_nonuniformity = 20.0", ["detector.dark_nonuniformity", "0 to 1", "20 % is 0.2"]),
        ("prnu = 0.01\nprnu_pp = 0.06", ["detector.prnu", "more than once", "keep one"]),
        ("dsnu_e_rms = 1.0\ndsnu_e_pp = 6.0", ["detector.dsnu_e_rms", "more than once", "keep one"]),
        ("prnu_pp = 6.0", ["detector.prnu", "0 to 0.5", "pp_sigmas"]),
        ("pp_sigmas = 0.0", ["detector.pp_sigmas", "1 to 20", "5 to 6"]),
        ("lines = { column_gain_rms = 1.0 }", ["detector.lines.column_gain_rms", "0 to 0.2", "0.001"]),
        ("lines = { row_e_rms = -1.0 }", ["detector.lines.row_e_rms", "0 or more", "turns it off"]),
        ("amplifier_noise_e_rms = -1.0", ["amplifier_noise_e_rms", "0 to", "quadrature"]),
        ("row_noise = { e_rms = -1.0 }", ["detector.row_noise.e_rms", "0 to", "turns it off"]),
        (
            "row_noise = { corner_cycles_per_row = 0.1 }",
            ["row_noise.corner_cycles_per_row", "is 0.1", "give row_noise.e_rms"],
        ),
        (
            "row_noise = { e_rms = 1.0, corner_cycles_per_row = 0.6 }",
            ["corner_cycles_per_row", "0 to 0.5", "time of a row"],
        ),
        ("nonlinearity = { knots_e = [[10, 9], [5, 12]] }", ["nonlinearity.knots_e", "knot 2", "both rising"]),
        ("nonlinearity = { knots_e = [[10, 9], [20, 8]] }", ["nonlinearity.knots_e", "knot 2", "both rising"]),
        ("nonlinearity = { knots_e = [[1, 1], [2, 2], [3, 3], [4, 4], [5, 5]] }", ["5 knots", "up to four", "such as"]),
        ("lines = { colum_e_rms = 1.0 }", ["colum_e_rms", "column_e_rms", "lab/cam.toml:4"]),
    ] {
        let error = detector(lines).expect_err(lines);
        assert!(error.contains("lab/cam.toml"), "names the file: {error}");
        for part in parts {
            assert!(error.contains(part), "{lines}: says \"{part}\": {error}");
        }
    }
}

/// Writes a FITS file by the letter of the standard: one header block, big-endian floats, padded to whole blocks.
fn write_map(path: &Path, [width, height]: [usize; 2], value: impl Fn(usize) -> f32) {
    let cards = ["SIMPLE  =                    T", "BITPIX  =                  -32", "NAXIS   =                    2"];
    let sides = [("NAXIS1", width), ("NAXIS2", height)].map(|(name, side)| format!("{name:<8}= {side:>20}"));
    let end = ["END".to_owned()];
    let header = cards.map(str::to_owned).into_iter().chain(sides).chain(end);
    let header: String = header.map(|card| format!("{card:<80}")).collect();
    let mut bytes = format!("{header:<2880}").into_bytes();
    bytes.extend((0..width * height).flat_map(|i| value(i).to_be_bytes()));
    bytes.resize(bytes.len().next_multiple_of(2880), 0);
    std::fs::write(path, bytes).expect("a file");
}

#[test]
fn maps_are_read_from_beside_the_camera_and_held_to_its_size() {
    let folder = tempfile::tempdir().expect("a folder");
    let (camera, map) = (folder.path().join("cam.toml"), folder.path().join("map.fits"));
    let read = |lines: &str| camera_at(&camera, lines);
    write_map(&map, [64, 48], |i| i as f32 * 1e-5);
    let found = read("maps = { prnu = \"map.fits\", dark_factor = \"map.fits\" }").expect("maps");
    let prnu = found.maps.prnu.as_deref().expect("read");
    assert_eq!(
        (prnu.len(), prnu[64], found.params.prnu),
        (64 * 48, 64.0 * 1e-5, 0.0),
        "row by row, and nothing is drawn"
    );
    assert!(found.maps.dark_factor.is_some() && found.maps.dsnu_e.is_none());

    let refused = |lines: &str, parts: &[&str]| {
        let error = read(lines).expect_err(lines);
        parts.iter().for_each(|part| assert!(error.contains(part), "says \"{part}\": {error}"));
    };
    let prnu = "maps = { prnu = \"map.fits\" }";
    refused("prnu = 0.01\nmaps = { prnu = \"map.fits\" }", &["detector.prnu", "more than once"]);
    refused("maps = { prnu = \"no.fits\" }", &["no.fits", "detector.maps.prnu", "relative to the file"]);
    refused("dark_nonuniformity = 0.1\nmaps = { dark_factor = \"map.fits\" }", &["dark_nonuniformity", "leave out"]);
    write_map(&map, [48, 64], |_| 0.0);
    refused(prnu, &["detector.maps.prnu", "48 x 64 pixels", "64 x 48 pixels", "crop or bin"]);
    write_map(&map, [64, 48], |i| if i == 130 { f32::NAN } else { 0.0 });
    refused(prnu, &["pixel (2, 2) is NaN", "no pixel may be missing"]);
    write_map(&map, [64, 48], |_| 1.01);
    refused(prnu, &["mean is 1.010", "subtract 1"]);
    write_map(&map, [64, 48], |_| -0.1);
    refused("maps = { dark_factor = \"map.fits\" }", &["factors of 0 to 1e6"]);
    for value in [3e38, -3e38, 1.1e7] {
        write_map(&map, [64, 48], |_| value);
        refused("maps = { dsnu_e = \"map.fits\" }", &["electrons, 1e7 at most"]);
        refused(prnu, &["detector.maps.prnu"]);
    }
    write_map(&map, [64, 48], |_| 9e6);
    read("maps = { dsnu_e = \"map.fits\" }").expect("control: within the limit");
    std::fs::write(&map, "not an image").expect("a file");
    refused(prnu, &["map.fits", "detector.maps.prnu", "not a FITS image"]);
}
