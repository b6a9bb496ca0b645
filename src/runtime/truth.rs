//! Plan -> truth table: which stars are in the image, where, and with how much light.

use crate::base::axes::{Icrf, Rotation, Sensor};
use crate::exposure::ExposurePlan;
use crate::exposure::target::{FIRST_FALSE_STAR_ID, FIRST_TARGET_ID, Smear};
use crate::exposure::track::StarPlace;
use crate::sink::{TruthKind, TruthStar};
use crate::sky::catalog::ra_dec_rad;

/// Writes one row per planned star and target into `out`.
pub fn fill_truth(plan: &ExposurePlan, out: &mut Vec<TruthStar>) {
    let icrf_from_sensor = plan.motion.los.mid_sensor_from_icrf.inverse();
    out.clear();
    out.extend(plan.sky_stars().iter().map(|star| TruthStar {
        id: star.id,
        mag: star.mag,
        x_px: star.mean_px[0],
        y_px: star.mean_px[1],
        electrons: star.electrons_on_detector,
        kind: kind_of(star.id),
        ..row_at(&star.place, &icrf_from_sensor)
    }));
    out.extend(plan.targets.iter().map(|planned| {
        let Smear { length_px, angle_rad } = planned.smear;
        TruthStar {
            id: planned.target.id,
            mag: planned.target.mag,
            x_px: planned.mean_px[0],
            y_px: planned.mean_px[1],
            electrons: planned.electrons_on_detector,
            kind: TruthKind::Target,
            smear_px: length_px,
            smear_deg: angle_rad.to_degrees(),
            ..row_at(&planned.place, &icrf_from_sensor)
        }
    }));
}

/// What stands behind an identifier.
fn kind_of(id: u32) -> TruthKind {
    if (FIRST_FALSE_STAR_ID..FIRST_TARGET_ID).contains(&id) { TruthKind::FalseStar } else { TruthKind::Star }
}

/// A row with nothing but its direction.
fn row_at(place: &StarPlace, icrf_from_sensor: &Rotation<Icrf, Sensor>) -> TruthStar {
    let [ra_rad, dec_rad] = ra_dec_rad(icrf_from_sensor.apply(place.mid_sensor()));
    TruthStar { ra_deg: ra_rad.to_degrees(), dec_deg: dec_rad.to_degrees(), ..TruthStar::NONE }
}
