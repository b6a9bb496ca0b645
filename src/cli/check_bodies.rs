//! Which of Sun, Moon, Earth and planets are in the field of a planned frame, or near it.

use anyhow::Result;
use core::fmt::Write;
use glam::DVec3;
use plan::exposure::ExposurePlan;
use scene::{camera::CameraParams, discs, sky_bodies::SkyBodies};

/// Bodies whose limb is nearer to the field than this are reported, deg.
const NEAR_DEG: f64 = 10.0;

/// Bodies of one planned frame; nothing when none is near.
pub(super) fn write_frame(
    text: &mut String,
    bodies: &SkyBodies,
    camera: &CameraParams,
    plan: &ExposurePlan,
) -> Result<()> {
    let los = &plan.motion.los;
    let boresight = los.mid_sensor_from_icrf.inverse().apply(DVec3::Z);
    let field_deg = camera.geometry.half_diagonal_rad().to_degrees();
    let [ifov_x, ifov_y] = camera.geometry.ifov_rad();
    for body in bodies.all(los.mid_exposure())? {
        let off_deg = body.apparent_icrf.angle_between(boresight).to_degrees();
        let limb_deg = off_deg - body.radius_rad.to_degrees();
        if limb_deg > field_deg + NEAR_DEG {
            continue;
        }
        let place = if limb_deg < field_deg { "in the field" } else { "near it" };
        let light = match body.mag_g {
            Some(mag_g) if mag_g > f64::from(camera.limiting_mag) => format!("G {mag_g:.2}, too faint to be drawn"),
            Some(mag_g) => format!("G {mag_g:.2}"),
            None => "sunlit".into(),
        };
        let across_px = 2.0 * body.radius_rad.tan() / ifov_x.min(ifov_y);
        writeln!(
            text,
            "  body         {} {place}: middle {off_deg:.3} deg off the axis, limb {limb_deg:.3} deg; {light}, {:.0} % lit, {across_px:.3} px across",
            body.name,
            100.0 * body.lit_share
        )?;
    }
    let counts = bodies.counts();
    if counts.occulted > 0 {
        writeln!(text, "               {} stars hidden by Earth or Moon", counts.occulted)?;
    }
    if counts.disc_sources > 0 {
        let step_px = counts.coarsest_px;
        let sigma_px = plan.psf.core_sigma_px();
        writeln!(
            text,
            "               discs drawn by {} sources in cells of up to {step_px:.3} px: edges within {:.1e} of their level",
            counts.disc_sources,
            discs::edge_error(step_px, sigma_px)
        )?;
        if step_px > 1.0 {
            writeln!(
                text,
                "  WARNING      a disc has more pixels than sources are kept for ({:.0}): its light shows as dots, {:.0} % of its level",
                discs::MOST_CELLS,
                100.0 * discs::ripple(step_px, sigma_px)
            )?;
        }
    }
    if counts.has_sun {
        writeln!(text, "  WARNING      the Sun is in the field: it is not drawn, and no tracker survives it")?;
    }
    Ok(())
}
