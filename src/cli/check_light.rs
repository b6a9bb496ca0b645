//! Sums of the light sections of a camera: illumination at the corners, background, stray light.

use anyhow::Result;
use core::fmt::Write;
use glam::DVec3;
use plan::{exposure::ExposurePlan, optics::baffle::BrightBodies};
use scene::{camera::CameraParams, field_light::FieldLight};

/// Angles of the Sun off the boresight for which stray light is printed, deg.
const SUN_ANGLES_DEG: [f64; 5] = [20.0, 30.0, 45.0, 60.0, 85.0];

/// Returns the illumination at the corners, constant background, and stray light against the Sun's angle; nothing when
/// all is off.
pub(super) fn write_light(text: &mut String, camera: &CameraParams) -> Result<()> {
    let exposure_s = camera.exposure_s;
    if !camera.illumination.is_even() {
        let corners = corners_px(camera);
        let lit = corners.map(|px| camera.geometry.tangent_of_pixel(px).map_or(0.0, |at| camera.illumination.at(at)));
        let (least, most) = lit.iter().fold((f64::MAX, 0.0_f64), |(a, b), v| (a.min(*v), b.max(*v)));
        let axis = camera.illumination.at(glam::DVec2::ZERO);
        let [ifov_x, ifov_y] = camera.geometry.ifov_rad();
        let per_px = camera.illumination.steepest_per_tangent() * ifov_x.max(ifov_y);
        writeln!(
            text,
            "  illumination {axis:.4} on the axis, {least:.4} to {most:.4} in the corners, at most {per_px:.1e} per px"
        )?;
        if least == 0.0 {
            writeln!(
                text,
                "  WARNING      a corner is dark: window_radius_mm is small for this field, or the distance large"
            )?;
        }
    }
    let light = &camera.background;
    if light.is_dark() {
        return Ok(());
    }
    let constant = light.constant();
    writeln!(
        text,
        "  background   {:.3} e- uniform, {:.3} e- of even sky, per pixel and exposure",
        constant.uniform * exposure_s,
        constant.sky * exposure_s
    )?;
    if let Some(stray) = &light.stray {
        write!(text, "  stray light  e- per pixel and exposure of the Sun at")?;
        for deg in SUN_ANGLES_DEG {
            let share = stray.baffle.transmittance.at(deg.to_radians());
            write!(text, " {deg} deg: {:.3e}", share * stray.sun_e_per_s * exposure_s)?;
        }
        let [sun, moon, earth] = stray.baffle.exclusion_rad.map(f64::to_degrees);
        writeln!(
            text,
            "\n               not meant to work within {sun} deg of the Sun, {moon} of the Moon, {earth} of the Earth"
        )?;
        let full_moon = BrightBodies {
            sun_km: DVec3::NEG_Z * base::units::AU_KM,
            moon_km: DVec3::new(0.5, 0.0, 0.75_f64.sqrt()) * sky::moon::MEAN_DISTANCE_KM,
            earth_km: None,
        };
        let moon = stray.glare(&full_moon).share * stray.sun_e_per_s * exposure_s;
        writeln!(text, "               of a full Moon at 30 deg: {moon:.3e}")?;
    }
    Ok(())
}

/// Returns the background of one planned frame; nothing when there is none.
pub(super) fn write_frame(
    text: &mut String,
    light: &FieldLight,
    camera: &CameraParams,
    plan: &ExposurePlan,
) -> Result<()> {
    if camera.background.is_dark() {
        return Ok(());
    }
    let (background, glare) = light.at(&plan.motion.los)?;
    let [gx, gy] = background.gradient_e;
    writeln!(
        text,
        "  background   {:.3} e- in the middle, ({gx:.3}, {gy:.3}) e- to the right and bottom, {:.3} e- outwards, sky {:.3} e-",
        background.uniform_e, background.quadratic_e, background.sky_e
    )?;
    if camera.background.sky.is_dark() {
        return write_excluded(text, glare.excluded);
    }
    let (least, most) = light.sky_over(&plan.motion.los, corners_px(camera).map(|px| camera.geometry.unproject(px)))?;
    writeln!(text, "               sky of the corners {least:.3} to {most:.3} e-: one value serves the frame")?;
    write_excluded(text, glare.excluded)
}

fn write_excluded(text: &mut String, excluded: [bool; 3]) -> Result<()> {
    for (body, _) in ["Sun", "Moon", "Earth"].into_iter().zip(excluded).filter(|(_, is_in)| *is_in) {
        writeln!(text, "  WARNING      the boresight is within the exclusion angle of the {body}")?;
    }
    Ok(())
}

fn corners_px(camera: &CameraParams) -> [[f64; 2]; 4] {
    let [right, bottom] = [camera.geometry.width_px(), camera.geometry.height_px()].map(|side| side as f64 - 1.0);
    [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]]
}
