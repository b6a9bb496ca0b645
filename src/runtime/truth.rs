//! Plan -> truth table: which stars are in the image, where, and with how much light.

use crate::detector::window::OutputGeometry;
use crate::exposure::ExposurePlan;
use crate::sink::TruthStar;
use crate::sky::catalog::ra_dec_rad;

/// Stars this far outside a window may still shine into it, sensor pixels.
const MARGIN_PX: f64 = 32.0;

/// Writes one row per planned star into `out`: places in pixels of the image that is put out, electrons on the whole
/// sensor. Stars well outside a window are left out.
pub fn fill_truth(plan: &ExposurePlan, output: &OutputGeometry, out: &mut Vec<TruthStar>) {
    let margin_px = MARGIN_PX / f64::from(output.binning);
    let is_near = |place_px: [f64; 2]| {
        let inside = |axis: usize| {
            let last = output.size_px[axis] as f64 - 1.0;
            (-margin_px..=last + margin_px).contains(&place_px[axis])
        };
        !output.is_cut || (inside(0) && inside(1))
    };
    let icrf_from_sensor = plan.motion.los.mid_sensor_from_icrf.inverse();
    out.clear();
    out.extend(plan.stars.iter().filter_map(|star| {
        let [x_px, y_px] = output.output_from_sensor(star.mean_px);
        if !is_near([x_px, y_px]) {
            return None;
        }
        let [ra_rad, dec_rad] = ra_dec_rad(icrf_from_sensor.apply(star.place.mid_sensor()));
        Some(TruthStar {
            id: star.id,
            ra_deg: ra_rad.to_degrees(),
            dec_deg: dec_rad.to_degrees(),
            mag: star.mag,
            x_px,
            y_px,
            electrons: star.electrons_on_detector,
        })
    }));
}
