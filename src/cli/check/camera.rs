//! `starloop check`, the camera: the stars that it sees, numbers that no camera has, light beside the stars.
//!
//! `starloop check`, what the camera sees: down to which magnitude, whether the frames have those stars, and whether a
//! frame has any.
//!
//! Input: parameters and stars of a run, plans of some frames. Output: text. `run::wiring::sensitivity` defines the stars that
//! are seen: stars of the Sun's colour at SNR 3, without motion. Frames of a calibrated display are
//! drawn in steps of its luminance, without a tracker's noise: of them only their stars are counted.

use crate::cli::facts::Facts;
use anyhow::Result;
use config::{Bench, Camera, Plant, Radiometry};
use core::{f64::consts::TAU, ops::RangeInclusive};
use glam::DVec3;
use plan::{exposure::ExposurePlan, optics::baffle::BrightBodies};
use run::wiring::sensitivity::{SEEN_SNR, sensitivity_for_suns};
use run::{runtime::RunParams, wiring::sensitivity::Sensitivity};
use scene::{camera::CameraParams, field_light::FieldLight};
use stars::{Sky, StarIndex};

/// The brightest star of the sky, Sirius, G.
const BRIGHTEST_MAG: f64 = -1.5;
/// Differences of magnitudes below this are rounding of the file's numbers.
const SAME_MAG: f64 = 0.05;
/// Steradians of the sky.
const SKY_SR: f64 = 2.0 * TAU;

/// The sight of a bench's camera.
pub(super) struct Sight {
    /// `None` for a calibrated display, whose frames have no tracker's noise.
    sensitivity: Option<Sensitivity>,
    /// True where the planned attitudes are those of the run.
    is_planned: bool,
}

impl Sight {
    /// Returns what a bench's camera sees.
    pub(super) fn of(bench: &Bench, plant: &Plant, params: &RunParams) -> Self {
        let has_noise = params.drawn_from_sensor.is_none() && params.camera.radiometry.zero_point_e_per_s().is_some();
        let is_planned = match plant {
            Plant::FlightComputer | Plant::File(_) => !bench.flight_computer.is_external,
            Plant::Vehicle(_) | Plant::Outside => false,
        };
        Self { sensitivity: has_noise.then(|| sensitivity_for_suns(&params.camera)), is_planned }
    }

    /// Writes down to which magnitude the camera sees, and warns of stars that it would see and the frames lack.
    pub(super) fn write(&self, facts: &mut Facts, bench: &Bench, params: &RunParams, sky: &Sky) {
        let [_, faintest] = sky.layers.magnitudes().map(f64::from);
        let drawn = f64::from(params.camera.limiting_mag);
        if let Some(sensitivity) = &self.sensitivity {
            let seen = sensitivity.limiting_mag(SEEN_SNR);
            match seen.filter(|seen| *seen >= BRIGHTEST_MAG) {
                Some(seen) => {
                    facts.fact("sees", format_args!("stars to G = {seen:.2} at SNR {SEEN_SNR} in one frame"));
                    if let Some(what) = left_out(&bench.camera.radiometry, [drawn, faintest, seen]) {
                        facts.warning(what);
                    }
                }
                None => {
                    let seen = seen.map_or_else(|| "none".into(), |seen| format!("G = {seen:.2}"));
                    facts.warning(format_args!(
                        "the camera sees no star: its limit at SNR {SEEN_SNR} is {seen}, the brightest star has G = \
                         {BRIGHTEST_MAG}: check aperture_mm, exposure_s and quantum_efficiency"
                    ));
                }
            }
        } else if drawn > faintest {
            facts.warning(format_args!(
                "the catalog ends at G = {faintest:.1}: fainter stars are missing from the frames"
            ));
        }
        if !self.is_planned {
            write_mean_stars(facts, bench, sky);
        }
    }

    /// Warns of a planned frame in which no star is, or none that the camera sees.
    pub(super) fn write_frame(&self, facts: &mut Facts, number: u32, plan: &ExposurePlan) {
        if !self.is_planned {
            return;
        }
        let in_field = || plan.stars.iter().filter(|star| star.electrons_on_detector > 0.0);
        let Some(brightest_e) = in_field().map(|star| star.electrons).reduce(f64::max) else {
            facts.warning(format_args!("no star is in the field of frame {number}"));
            return;
        };
        let Some(Sensitivity { window, pixel, .. }) = &self.sensitivity else { return };
        let snr = window.terms(brightest_e, pixel).snr;
        if snr < SEEN_SNR {
            facts.warning(format_args!(
                "the camera sees none of the {} stars of frame {number}: the brightest has SNR {snr:.2}, wanted \
                 {SEEN_SNR}",
                in_field().count()
            ));
        }
    }
}

/// Returns the magnitude to which a camera sees; `None` for one without noise, and for one that sees no star.
pub(crate) fn seen_mag(params: &RunParams) -> Option<f64> {
    let has_noise = params.drawn_from_sensor.is_none() && params.camera.radiometry.zero_point_e_per_s().is_some();
    has_noise.then(|| sensitivity_for_suns(&params.camera))?.limiting_mag(SEEN_SNR)
}

/// Returns which stars the camera sees, and the limit of drawing or the catalog leaves out, and why.
pub(crate) fn left_out(radiometry: &Radiometry, [drawn, faintest, seen]: [f64; 3]) -> Option<String> {
    if radiometry.seen_stars_left_out || seen <= drawn.min(faintest) + SAME_MAG {
        return None;
    }
    let why = match radiometry.limiting_mag {
        Some(_) if drawn < faintest => {
            format!("radiometry.limiting_mag is {drawn:.2}: leave it out, or set seen_stars_left_out = true")
        }
        None if drawn < faintest => {
            format!("no more stars than those to G = {drawn:.2} fit into memory: raise sky.memory_mb")
        }
        _ => format!(
            "the catalog ends at G = {faintest:.1}: name sky.layers, or set radiometry.seen_stars_left_out = true"
        ),
    };
    Some(format!("stars that the camera sees, to G = {seen:.2}, are left out: {why}"))
}

/// Warns of a field that has no star in most directions, where the directions of the run are not known.
fn write_mean_stars(facts: &mut Facts, bench: &Bench, sky: &Sky) {
    let stars: u64 = sky.layers.layers().map(StarIndex::stars).sum();
    let [width, height] = bench.camera.fov_deg().map(|side_deg| (0.5 * side_deg).to_radians());
    // The solid angle of a rectangular pyramid.
    let field_sr = 4.0 * (width.sin() * height.sin()).asin();
    let mean = stars as f64 * field_sr / SKY_SR;
    if mean < 1.0 {
        facts.warning(format_args!(
            "most frames have no star: the mean field has {mean:.2e} of the {stars} stars of the catalog, wanted 1 \
             at least"
        ));
    }
}

// `starloop check`, numbers of cameras that no camera has: most are of another unit.
//
// Impossible values are refused where a file is read. These are possible, and no hardware has them: each limit is that of
// hardware that exists, which is named beside it.

/// A number of a camera, and the values of real ones.
struct Usual {
    key: &'static str,
    value: fn(&Camera) -> f64,
    range: RangeInclusive<f64>,
    unit: &'static str,
}

const USUAL: [Usual; 6] = [
    // Sensors of telephones; detectors for X-rays.
    Usual {
        key: "detector.pixel_pitch_um",
        value: |camera| camera.detector.pixel_pitch_um,
        range: 0.5..=1000.0,
        unit: "um",
    },
    // Endoscopes; the Extremely Large Telescope has 743 m.
    Usual {
        key: "optics.focal_length_mm",
        value: |camera| camera.optics.focal_length_mm,
        range: 0.5..=800_000.0,
        unit: "mm",
    },
    // Cameras of telephones stopped down; the Extremely Large Telescope has 39 m.
    Usual { key: "optics.aperture_mm", value: |camera| camera.optics.aperture_mm, range: 0.3..=40_000.0, unit: "mm" },
    // Nothing in air is faster than f/0.5; beyond f/128 are pinholes.
    Usual { key: "focal length / aperture", value: f_number, range: 0.5..=128.0, unit: "" },
    // Electronic shutters of machine vision; an hour is the most that a file may give.
    Usual { key: "exposure.exposure_s", value: |camera| camera.exposure.exposure_s, range: 1e-6..=3600.0, unit: "s" },
    // A detector at the edge of its band still counts a photon in a hundred.
    Usual {
        key: "detector.quantum_efficiency",
        value: |camera| camera.detector.quantum_efficiency,
        range: 0.01..=1.0,
        unit: "",
    },
];

fn f_number(camera: &Camera) -> f64 {
    camera.optics.focal_length_mm / camera.optics.aperture_mm
}

/// Writes a warning for each number of a head's camera that no real camera has.
pub(super) fn write_cameras(facts: &mut Facts, bench: &Bench) {
    let mut cameras = vec![&bench.camera];
    for head in &bench.extra_heads {
        if !cameras.contains(&&head.camera) {
            cameras.push(&head.camera);
        }
    }
    for camera in cameras {
        for Usual { key, value, range, unit } in &USUAL {
            let got = value(camera);
            if !range.contains(&got) {
                let (least, most) = (range.start(), range.end());
                let wanted = format!("{least} to {most} {unit}");
                let wanted = wanted.trim_end();
                facts.warning(format_args!(
                    "camera \"{}\": {key} is {got}; real cameras have {wanted}: is it in another unit?",
                    camera.name
                ));
            }
        }
    }
}

// Sums of the light sections of a camera: illumination at the corners, background, stray light.

/// Angles of the Sun off the boresight for which stray light is printed, deg.
const SUN_ANGLES_DEG: [f64; 5] = [20.0, 30.0, 45.0, 60.0, 85.0];

/// Returns the illumination at the corners, constant background, and stray light against the Sun's angle; nothing when
/// all is off.
pub(super) fn write_light(facts: &mut Facts, camera: &CameraParams) {
    let exposure_s = camera.exposure_s;
    if !camera.illumination.is_even() {
        let corners = corners_px(camera);
        let lit = corners.map(|px| camera.geometry.tangent_of_pixel(px).map_or(0.0, |at| camera.illumination.at(at)));
        let (least, most) = lit.iter().fold((f64::MAX, 0.0_f64), |(a, b), v| (a.min(*v), b.max(*v)));
        let axis = camera.illumination.at(glam::DVec2::ZERO);
        let [ifov_x, ifov_y] = camera.geometry.ifov_rad();
        let per_px = camera.illumination.steepest_per_tangent() * ifov_x.max(ifov_y);
        facts.named("illumination").line(format_args!(
            "{axis:.4} on the axis, {least:.4} to {most:.4} in the corners, at most {per_px:.1e} per px"
        ));
        if least == 0.0 {
            facts.warning("a corner is dark: window_radius_mm is small for this field, or the distance large");
        }
    }
    let light = &camera.background;
    if light.is_dark() {
        return;
    }
    let constant = light.constant();
    facts.named("background").line(format_args!(
        "{:.3} e- uniform, {:.3} e- of even sky, per pixel and exposure",
        constant.uniform * exposure_s,
        constant.sky * exposure_s
    ));
    if let Some(stray) = &light.stray {
        let at = SUN_ANGLES_DEG.map(|deg| {
            let share = stray.baffle.transmittance.at(deg.to_radians());
            format!(" {deg} deg: {:.3e}", share * stray.sun_e_per_s * exposure_s)
        });
        facts.fact("stray light", format_args!("e- per pixel and exposure of the Sun at{}", at.concat()));
        let [sun, moon, earth] = stray.baffle.exclusion_rad.map(f64::to_degrees);
        facts.more(format_args!(
            "not meant to work within {sun} deg of the Sun, {moon} of the Moon, {earth} of the Earth"
        ));
        let full_moon = BrightBodies {
            sun_km: DVec3::NEG_Z * base::units::AU_KM,
            moon_km: DVec3::new(0.5, 0.0, 0.75_f64.sqrt()) * sky::moon::MEAN_DISTANCE_KM,
            earth_km: None,
        };
        let moon = stray.glare(&full_moon).share * stray.sun_e_per_s * exposure_s;
        facts.more(format_args!("of a full Moon at 30 deg: {moon:.3e}"));
    }
}

/// Returns the background of one planned frame; nothing when there is none.
pub(super) fn write_frame_light(
    facts: &mut Facts,
    light: &FieldLight,
    camera: &CameraParams,
    plan: &ExposurePlan,
) -> Result<()> {
    if camera.background.is_dark() {
        return Ok(());
    }
    let (background, glare) = light.at(&plan.motion.los)?;
    let [gx, gy] = background.gradient_e;
    facts.named("background").line(format_args!(
        "{:.3} e- in the middle, ({gx:.3}, {gy:.3}) e- to the right and bottom, {:.3} e- outwards, sky {:.3} e-",
        background.uniform_e, background.quadratic_e, background.sky_e
    ));
    if !camera.background.sky.is_dark() {
        let corners = corners_px(camera).map(|px| camera.geometry.unproject(px));
        let (least, most) = light.sky_over(&plan.motion.los, corners)?;
        facts.more(format_args!("sky of the corners {least:.3} to {most:.3} e-: one value serves the frame"));
    }
    for (body, _) in ["Sun", "Moon", "Earth"].into_iter().zip(glare.excluded).filter(|(_, is_in)| *is_in) {
        facts.warning(format_args!("the boresight is within the exclusion angle of the {body}"));
    }
    Ok(())
}

fn corners_px(camera: &CameraParams) -> [[f64; 2]; 4] {
    let [right, bottom] = [camera.geometry.width_px(), camera.geometry.height_px()].map(|side| side as f64 - 1.0);
    [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]]
}

#[cfg(test)]
mod sight_tests {
    use super::*;

    #[test]
    fn stars_that_are_seen_and_left_out_are_warned_of_on_both_sides() {
        let mut radiometry = Bench::built_in().unwrap().camera.radiometry;
        radiometry.seen_stars_left_out = false;
        let warned = |radiometry: &Radiometry, magnitudes| left_out(radiometry, magnitudes).unwrap_or_default();
        let given = Radiometry { limiting_mag: Some(7.0), ..radiometry };
        assert_eq!(warned(&given, [7.0, 8.5, 7.04]), "", "as good as seen");
        let text = warned(&given, [7.0, 8.5, 7.49]);
        assert!(text.contains("to G = 7.49") && text.contains("limiting_mag is 7.00"), "{text}");
        assert_eq!(warned(&Radiometry { seen_stars_left_out: true, ..given }, [7.0, 8.5, 7.49]), "", "on purpose");
        let auto = Radiometry { limiting_mag: None, ..radiometry };
        assert_eq!(warned(&auto, [8.0, 8.5, 7.49]), "");
        assert!(warned(&auto, [8.5, 8.5, 10.0]).contains("the catalog ends at G = 8.5"));
        assert!(warned(&auto, [12.0, 16.0, 14.0]).contains("sky.memory_mb"));
    }
}

#[cfg(test)]
mod camera_tests {
    use super::*;

    fn warned(change: impl Fn(&mut Camera)) -> String {
        let mut bench = Bench::built_in().unwrap();
        change(&mut bench.camera);
        let mut facts = Facts::indented();
        write_cameras(&mut facts, &bench);
        facts.text()
    }

    #[test]
    fn numbers_outside_of_what_exists_are_warned_of_on_both_sides() {
        assert_eq!(warned(|_| {}), "", "control");
        type Change = fn(&mut Camera, f64);
        let cases: [(&str, Change, [f64; 4]); 4] = [
            ("pixel_pitch_um", |camera, um| camera.detector.pixel_pitch_um = um, [0.49, 0.5, 1000.0, 1001.0]),
            ("exposure_s", |camera, s| camera.exposure.exposure_s = s, [0.9e-6, 1e-6, 3600.0, 3601.0]),
            ("quantum_efficiency", |camera, share| camera.detector.quantum_efficiency = share, [0.009, 0.01, 1.0, 1.1]),
            (
                "focal length / aperture",
                |camera, ratio| camera.optics.focal_length_mm = ratio * camera.optics.aperture_mm,
                [0.49, 0.5, 128.0, 129.0],
            ),
        ];
        for (key, change, [below, least, most, above]) in cases {
            for (value, warns) in [(below, true), (least, false), (most, false), (above, true)] {
                let text = warned(|camera| change(camera, value));
                assert_eq!(text.contains(&format!("{key} is ")), warns, "{key} = {value}: {text}");
            }
        }
    }

    #[test]
    fn an_aperture_in_metres_is_warned_of_with_its_number_and_limit() {
        let text = warned(|camera| camera.optics.aperture_mm = 0.011_43);
        assert!(text.contains("optics.aperture_mm is 0.01143; real cameras have 0.3 to 40000 mm"), "{text}");
    }

    #[test]
    fn every_head_is_looked_at_and_a_camera_once() {
        let mut bench = Bench::built_in().unwrap();
        let mut head = bench.first_head();
        head.camera.detector.pixel_pitch_um = 2000.0;
        bench.extra_heads = vec![head; 2];
        let mut facts = Facts::indented();
        write_cameras(&mut facts, &bench);
        assert_eq!(facts.warnings().len(), 1, "{}", facts.text());
    }
}
