//! Plan -> truth table: which stars are in the image, where, and with how much light.

use crate::exposure::ExposurePlan;
use crate::sink::TruthStar;
use crate::sky::catalog::ra_dec_rad;

/// Writes one row per planned star into `out`.
pub fn fill_truth(plan: &ExposurePlan, out: &mut Vec<TruthStar>) {
    let icrf_from_sensor = plan.motion.los.mid_sensor_from_icrf.inverse();
    out.clear();
    out.extend(plan.stars.iter().map(|star| {
        let [ra_rad, dec_rad] = ra_dec_rad(icrf_from_sensor.apply(star.place.mid_sensor()));
        TruthStar {
            id: star.id,
            ra_deg: ra_rad.to_degrees(),
            dec_deg: dec_rad.to_degrees(),
            mag: star.mag,
            x_px: star.mean_px[0],
            y_px: star.mean_px[1],
            electrons: star.electrons_on_detector,
        }
    }));
}
