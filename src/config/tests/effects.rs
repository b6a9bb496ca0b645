//! Tables of the detector's effects: what they turn on, and what is refused.

use super::{MINIMAL_CAMERA, assert_refused, camera, camera_with};

#[test]
fn each_effect_rule_has_a_failing_example() {
    for (section, line, parts) in [
        (
            "detector.colour_filter",
            "red = 0.4\ngreen = 0.5\nblue = 0.3\npattern = \"rgb\"",
            ["\"RGGB\"", "first two rows"],
        ),
        ("detector.colour_filter", "pattern = \"GRBG\"\nred = 0.4\nblue = 0.3\ngreen = 1.2", ["0.01 to 1", "a share"]),
        ("detector.colour_filter", "pattern = \"GRBG\"\ngreen = 0.4\nblue = 0.3\nred = 0", ["0.01 to 1", "a share"]),
        ("detector.blooming", "drained_share = 1.5", ["0 to 1", "anti-blooming"]),
        ("detector.image_lag", "share = 1", ["to 0.9", "next frame"]),
        ("detector.charge_transfer", "parallel_share = 0.5", ["0 to 0.0125", "1 - CTE"]),
        ("detector.charge_transfer", "output_corner = \"top\"", ["\"top-left\"", "amplifier"]),
        ("detector.binning", "factor = 9", ["2 to 8", "become one"]),
        ("detector.binning", "factor = 7", ["divides detector.width_px = 640", "another factor"]),
        ("detector.binning", "factor = 2\nsumming_well_e = 10", ["30000 to", "full well"]),
        ("detector.binning", "factor = 2\nkind = \"digital-sum\"\nsumming_well_e = 1e5", ["belongs to", "charge"]),
        ("detector.binning", "factor = 5\nkind = \"digital-sum\"", ["65535", "digital-mean"]),
        ("detector.window", "left_px = 640", ["0 to 639", "top left"]),
        ("detector.window", "left_px = 600\nwidth_px = 41", ["1 to 40", "on the sensor"]),
        ("detector.window", "top_px = 0\nheight_px = 481", ["1 to 480", "on the sensor"]),
        ("detector.tdi", "stages = 0", ["1 to 4096", "rows"]),
        ("detector.defects", "hot_share = 0.5", ["0 to 0.05", "share of all pixels"]),
        ("detector.defects", "dead_response = 2", ["0 to 1", "light"]),
        ("detector.protons", "energy_mev = 0.1", ["1 to 10000", "MeV"]),
        ("detector.protons", "incidence_deg = 10", ["belongs to", "beam"]),
        ("detector.protons", "direction = \"beam\"\nincidence_deg = 90", ["0 to 89.9", "normal"]),
        ("detector.protons", "thickness_um = 0", ["0.1 to 1000", "micrometres"]),
    ] {
        let key = line.lines().last().and_then(|line| line.split(' ').next()).expect("a key");
        assert_refused(camera_with(section, line), &format!("{section}.{key}"), &parts);
    }
}

#[test]
fn effects_are_off_until_their_table_is_given() {
    use image::detector::SpatialParams;
    let plain = camera(MINIMAL_CAMERA).expect("a camera");
    let spatial = plain.detector.params.spatial;
    let layer = spatial.layer;
    assert_eq!(spatial, SpatialParams { layer, ..SpatialParams::OFF });
    assert_eq!(layer.pixel_pitch_um, plain.detector.pixel_pitch_um);
}

#[test]
fn effects_of_neighbours_are_as_the_camera_file_says() {
    use base::bayer::BayerPattern;
    use image::detector::binning::{Binning, BinningKind};
    use image::detector::charge_transfer::{ChargeTransfer, OutputCorner};
    use image::detector::protons::{ProtonDirection, ProtonFlux};
    use image::detector::{blooming::Blooming, image_lag::ImageLag, pattern::ColourFilter, tdi::Tdi, window::Window};
    let of = |section: &str, lines: &str| camera_with(section, lines).expect("a camera").detector.params.spatial;
    assert_eq!(of("detector.blooming", "drained_share = 0.25").blooming, Some(Blooming { drained_share: 0.25 }));
    assert_eq!(of("detector.blooming", "").blooming, Some(Blooming { drained_share: 0.0 }), "an empty table is on");
    assert_eq!(of("detector.image_lag", "share = 0.01").image_lag, Some(ImageLag { share: 0.01 }));
    let transfer = of("detector.charge_transfer", "parallel_share = 1e-5\noutput_corner = \"bottom-right\"");
    let corner = OutputCorner::BottomRight;
    let wanted = ChargeTransfer { parallel_share: 1e-5, serial_share: 0.0, corner };
    assert_eq!(transfer.charge_transfer, Some(wanted));
    let binned = of("detector.binning", "factor = 4\nkind = \"digital-mean\"");
    assert_eq!(binned.binning, Some(Binning { factor: 4, kind: BinningKind::DigitalMean }));
    assert_eq!(binned.output([640, 480]).size_px, [160, 120]);
    let on_chip = of("detector.binning", "factor = 2").binning.expect("on");
    assert_eq!(on_chip.kind, BinningKind::Charge { full_well_e: 30_000.0 }, "one pixel's full well");
    let filter =
        of("detector.colour_filter", "pattern = \"GBRG\"\nred = 0.35\ngreen = 0.45\nblue = 0.25").colour_filter;
    assert_eq!(filter, Some(ColourFilter { pattern: BayerPattern::Gbrg, red: 0.35, green: 0.45, blue: 0.25 }));
    let cut = of("detector.window", "left_px = 100\ntop_px = 20\nwidth_px = 64").window;
    assert_eq!(cut, Some(Window { left_px: 100, top_px: 20, width_px: 64, height_px: 460 }), "the rest of the rows");
    assert_eq!(of("detector.tdi", "stages = 16").tdi, Some(Tdi { stages: 16 }));
    let beam = of("detector.protons", "per_cm2_s = 10\nenergy_mev = 63\ndirection = \"beam\"\nincidence_deg = 30");
    let direction = ProtonDirection::Beam { incidence_deg: 30.0, azimuth_deg: 0.0 };
    assert_eq!(beam.protons, Some(ProtonFlux { per_cm2_s: 10.0, energy_mev: 63.0, direction }));
    assert_eq!(of("detector.protons", "thickness_um = 40").protons, None, "no flux");
    let hot = of("detector.defects", "hot_share = 0.001\nhot_e_per_s = 500").defects;
    assert_eq!((hot.hot_share, hot.hot_e_per_s, hot.dead_share), (0.001, 500.0, 0.0));
}

#[test]
fn stages_of_tdi_add_up_to_the_exposure() {
    let of = |lines: &str| camera(&format!("{MINIMAL_CAMERA}\n[detector.tdi]\nstages = 16\n[exposure]\n{lines}"));
    assert_eq!(of("exposure_s = 0.01").expect("a camera").exposure.exposure_s, 0.16);
    assert_refused(of("exposure_s = 300"), "exposure.exposure_s", &["4800", "stages"]);
    assert_refused(of("rolling_line_us = 10"), "exposure.rolling_line_us", &["[detector.tdi]", "rows together"]);
}

#[test]
fn windows_begin_on_whole_binned_pixels() {
    let of = |window: &str| {
        camera(&format!("{MINIMAL_CAMERA}\n[detector.binning]\nfactor = 4\n[detector.window]\n{window}"))
    };
    let camera = of("left_px = 8\nwidth_px = 64").expect("a camera");
    assert_eq!(camera.detector.params.spatial.output([640, 480]).size_px, [16, 120]);
    assert_refused(of("left_px = 10"), "detector.window.left_px", &["multiple of detector.binning.factor = 4"]);
    assert_refused(of("height_px = 30"), "detector.window.height_px", &["multiple of", "whole output pixels"]);
}
