//! `[illumination]`, `[background]`, `[baffle]`, and the polynomial of `[distortion]`: what they mean, what is refused.

use super::*;
use plan::optics::{Illumination, illumination::Vignetting};
use std::path::Path;

const MINIMAL: &str = "[detector]\nwidth_px = 640\nheight_px = 480\n[optics]\nfocal_length_mm = 25\naperture_mm = 20\n";

fn camera(sections: &str) -> Result<Camera, ConfigError> {
    Camera::from_document(&Document::from_text(&format!("{MINIMAL}{sections}"), Path::new("lab/cam.toml")))
}

#[test]
fn nothing_is_lit_unless_the_file_says_so() {
    let plain = camera("").expect("enough");
    assert_eq!(plain.illumination, Illumination::EVEN);
    assert_eq!((plain.background, plain.baffle), (Background::default(), None));
    assert_eq!(plain.distortion.polynomial, None);
}

#[test]
fn sections_become_what_they_say() {
    let lit = camera("[illumination]\ncos4 = true\nblocked = 0.04\nwindow_radius_mm = 14\nwindow_distance_mm = 40\n");
    let stops = Vignetting { window_radius_mm: 14.0, pupil_radius_mm: 10.0, distance_mm: 40.0 };
    let wanted = Illumination { vignetting: Some(stops), cos4: true, unblocked: 0.96 };
    assert_eq!(lit.expect("a camera").illumination, wanted);

    let sky = |line: &str| camera(&format!("[background]\n{line}\n")).expect("a camera").background.sky;
    assert_eq!(sky("mag_per_arcsec2 = 22.5"), Sky::Even { mag_per_arcsec2: 22.5 });
    assert_eq!(sky("sky = [\"galactic\"]"), Sky::Model { zodiacal: false, galactic: true });
    assert_eq!(sky("sky = []"), Sky::Dark);

    let baffle = "[baffle]\ntransmittance = [[10, 1e-4], [80, 1e-10]]\nshines = [\"moon\", \"sun\"]\n\
                  exclusion_sun_deg = 90\ngradient = 0.3\n";
    let baffle = camera(baffle).expect("a camera").baffle.expect("given");
    assert_eq!(baffle.shade.shines, [true, true, false]);
    assert!((baffle.shade.exclusion_rad[0] - core::f64::consts::FRAC_PI_2).abs() < 1e-15);
    assert!((baffle.shade.transmittance.at(45_f64.to_radians()) / 1e-7 - 1.0).abs() < 1e-9);

    let bent = "[distortion]\nmodel = \"polynomial\"\nx = [[3, 0, -0.05]]\ny = [[2, 1, -5e-2], [2, 1, 1e-2]]\n";
    let model = camera(bent).expect("a camera").distortion.polynomial.expect("given");
    let at = model.distort(glam::DVec2::new(0.5, 0.2));
    assert!(at.distance(glam::DVec2::new(0.5 - 0.05 * 0.125, 0.2 - 0.04 * 0.25 * 0.2)) < 1e-15, "{at}");
}

#[test]
fn each_rule_has_a_failing_example() {
    let table = "transmittance = [[10, 1e-4], [80, 1e-10]]\n";
    let with_table = |line: &str| format!("{table}{line}");
    for (section, lines, key, parts) in [
        ("illumination", "blocked = 1".into(), "illumination.blocked", ["0 to 0.95", "3 % is 0.03"]),
        ("illumination", "window_radius_mm = 5".into(), "window_radius_mm", ["belongs to", "window_distance_mm"]),
        ("illumination", "window_distance_mm = 5".into(), "window_distance_mm", ["belongs to", "together"]),
        ("illumination", "pupil_radius_mm = 5".into(), "pupil_radius_mm", ["belongs to", "together"]),
        (
            "illumination",
            "window_radius_mm = 0\nwindow_distance_mm = 5".into(),
            "window_radius_mm",
            ["above 0", "millimetres"],
        ),
        ("illumination", "cos_4 = true".into(), "cos_4", ["did you mean", "cos4"]),
        ("background", "uniform_e_per_s = -1".into(), "background.uniform_e_per_s", ["0 to", "turns it off"]),
        ("background", "gradient = [0.1, 0.0]".into(), "background.gradient", ["belongs to", "above 0"]),
        (
            "background",
            "uniform_e_per_s = 5\ngradient = [0.8, 0.7]".into(),
            "background.gradient",
            ["nowhere below 0", "shallower"],
        ),
        (
            "background",
            "uniform_e_per_s = 5\ngradient = [0.5, 0.0]\nquadratic = -0.6".into(),
            "background.gradient",
            ["nowhere below 0", "1.1"],
        ),
        ("background", "mag_per_arcsec2 = nan".into(), "background.mag_per_arcsec2", ["-10 to 40", "22 to 23.5"]),
        (
            "background",
            "mag_per_arcsec2 = 22\nsky = [\"zodiacal\"]".into(),
            "background.mag_per_arcsec2",
            ["belongs to", "count twice"],
        ),
        ("background", "sky = [\"aurora\"]".into(), "background.sky", ["\"aurora\"", "zodiacal"]),
        ("baffle", "gradient = 0.1".into(), "baffle.transmittance", ["2 to 1000 rows", "[30, 1e-7]"]),
        ("baffle", "transmittance = [[10, 0], [20, 1e-5]]".into(), "baffle.transmittance", ["row 1", "1e-30"]),
        ("baffle", "transmittance = [[30, 1e-6], [20, 1e-5]]".into(), "baffle.transmittance", ["row 2", "sort"]),
        ("baffle", with_table("exclusion_moon_deg = 200"), "baffle.exclusion_moon_deg", ["0 to 180", "limb"]),
        ("baffle", with_table("earth_albedo = 2"), "baffle.earth_albedo", ["0 to 1", "0.306"]),
        ("baffle", with_table("gradient = 1.5"), "baffle.gradient", ["-1 to 1", "half a diagonal"]),
        ("baffle", with_table("shines = [\"jupiter\"]"), "baffle.shines", ["\"jupiter\"", "all three"]),
        ("distortion", "model = \"fisheye\"".into(), "distortion.model", ["polynomial", "brown-conrady"]),
        ("distortion", "x = [[3, 0, 0.1]]".into(), "distortion.x", ["belongs to", "polynomial"]),
        ("distortion", "model = \"polynomial\"".into(), "distortion.x", ["none", "rows of"]),
        (
            "distortion",
            "model = \"polynomial\"\nx = [[1.5, 0.0, 1.0]]\ny = [[0, 1, 1.0]]".into(),
            "distortion.x",
            ["1.5", "whole"],
        ),
        (
            "distortion",
            "model = \"polynomial\"\nk1 = 0.1\nx = [[3, 0, 0.1]]".into(),
            "distortion.k1",
            ["belongs to", "brown-conrady"],
        ),
        ("distortion", "model = \"polynomial\"\ny = [[4, 2, 0.1]]".into(), "distortion.y", ["x^4 y^2", "from 1 to 5"]),
        (
            "distortion",
            "model = \"polynomial\"\ny = [[4, 0, nan]]".into(),
            "distortion.y",
            ["-1000000", "focal lengths"],
        ),
    ] as [(&str, String, &str, [&str; 2]); 27]
    {
        let error = camera(&format!("[{section}]\n{lines}\n")).expect_err(key).to_string();
        assert!(error.contains("lab/cam.toml") && error.contains(key), "{lines}: {error}");
        for part in parts {
            assert!(error.contains(part), "{lines}: says \"{part}\": {error}");
        }
    }
}
