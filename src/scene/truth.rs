//! Plan -> truth table: the stars in the image, their places, and their light.

use crate::sky_bodies::{EARTH_NUMBER, MOON_NUMBER};
use crate::sky_targets::TargetFacts;
use base::axes::{Icrf, Rotation, Sensor};
use base::{region::Regions, source::ra_dec_rad};
use frames::sink::{TargetRow, TruthKind, TruthStar};
use glam::DVec3;
use image::detector::{protons::ProtonTrack, window::OutputGeometry};
use plan::exposure::target::{FIRST_BODY_ID, FIRST_FALSE_STAR_ID, FIRST_TARGET_ID, FIRST_TRACK_ID, Smear};
use plan::exposure::target_plan::{seen_after_mid_s, seen_by_row};
use plan::exposure::{ExposurePlan, PlannedStar, PlannedTarget};
use plan::exposure::{smear::polyline_px, track::StarPlace};
use sky::astrometry::Sight;

/// Distance outside a window from which stars may still shine into it, sensor pixels.
const MARGIN_PX: f64 = 32.0;

/// Writes one row per planned star, body and target into `out`: places in pixels of the output image, electrons on the
/// whole sensor. Stars well outside a window are left out. `sight` is the effect of the observer on directions; without
/// it catalog places are left out.
pub fn fill_truth(plan: &ExposurePlan, output: &OutputGeometry, sight: Option<&Sight>, out: &mut Vec<TruthStar>) {
    let margin_px = MARGIN_PX / f64::from(output.binning);
    let is_near = |place_px: [f64; 2]| {
        let inside = |axis: usize| {
            let last = output.size_px[axis] as f64 - 1.0;
            (-margin_px..=last + margin_px).contains(&place_px[axis])
        };
        !output.is_cut || (inside(0) && inside(1))
    };
    let directions = Directions { icrf_from_sensor: plan.motion.los.mid_sensor_from_icrf.inverse(), sight };
    let binning = f64::from(output.binning);
    out.clear();
    let bodies = FIRST_BODY_ID..FIRST_TRACK_ID;
    out.extend(plan.sky_stars().iter().filter(|star| !bodies.contains(&star.id)).filter_map(|star| {
        let [x_px, y_px] = output.output_from_sensor(star.mean_px);
        is_near([x_px, y_px]).then(|| TruthStar {
            id: star.id,
            mag: star.mag,
            x_px,
            y_px,
            electrons: star.electrons_on_detector,
            kind: kind_of(star.id),
            smear_px: plan.smear.length_px(star.place.mid_px) / binning,
            smear_deg: plan.smear.angle_rad(star.place.mid_px).to_degrees(),
            ..directions.row_at(&star.place)
        })
    }));
    add_bodies(plan, output, &directions, out);
    out.extend(plan.targets.iter().filter_map(|planned| {
        let Smear { length_px, angle_rad } = smear_of(planned, plan);
        let [x_px, y_px] = output.output_from_sensor(planned.mean_px);
        is_near([x_px, y_px]).then(|| TruthStar {
            id: planned.target.id,
            mag: planned.target.mag,
            x_px,
            y_px,
            electrons: planned.electrons_on_detector,
            kind: TruthKind::Target,
            smear_px: length_px / binning,
            smear_deg: angle_rad.to_degrees(),
            ..directions.row_at(&planned.place)
        })
    }));
}

/// Writes one row per target on the sky that is in the plan; `facts` contains theirs and others.
pub fn fill_targets(plan: &ExposurePlan, facts: &[TargetFacts], output: &OutputGeometry, out: &mut Vec<TargetRow>) {
    out.clear();
    let of = |planned: &PlannedTarget| facts.iter().find(|facts| facts.id == planned.target.id);
    out.extend(plan.targets.iter().filter_map(|planned| {
        let facts = of(planned)?;
        let ends = seen_after_mid_s(&planned.target, &plan.motion, 0.0)?;
        let [begin_px, end_px] = ends.map(|t_s| {
            let px = seen_by_row(&planned.target, plan, t_s);
            px.map_or([f64::NAN; 2], |px| output.output_from_sensor(px))
        });
        let [ra_rad, dec_rad] = ra_dec_rad(facts.apparent_icrf);
        Some(TargetRow {
            id: facts.id,
            ra_deg: ra_rad.to_degrees(),
            dec_deg: dec_rad.to_degrees(),
            begin_px,
            end_px,
            range_km: facts.range_km,
            range_rate_km_s: facts.range_rate_km_s,
            rate_deg_s: facts.rate_rad_s.to_degrees(),
            phase_deg: facts.phase_rad.to_degrees(),
            sunlight: facts.sunlight,
            mag_g: facts.mag_g,
        })
    }));
}

/// Adds a row per body: the sum of its sources and the centre of their light.
fn add_bodies(plan: &ExposurePlan, output: &OutputGeometry, directions: &Directions<'_>, out: &mut Vec<TruthStar>) {
    let mut sums = [BodySum::default(); MOON_NUMBER as usize + 1];
    for star in plan.sky_stars() {
        let sum = star.id.checked_sub(FIRST_BODY_ID).and_then(|number| sums.get_mut(number as usize));
        if let Some(sum) = sum {
            sum.add(star);
        }
    }
    for (number, sum) in (0..).zip(sums).filter(|(_, sum)| sum.electrons > 0.0) {
        let [mid_px, mean_px] = [sum.mid, sum.mean].map(|first| first.map(|v| v / sum.electrons));
        let Some(place) = StarPlace::of_pixel(&plan.camera, mid_px) else { continue };
        let [x_px, y_px] = output.output_from_sensor(mean_px);
        let kind = match number {
            EARTH_NUMBER => TruthKind::Earth,
            MOON_NUMBER => TruthKind::Moon,
            _ => TruthKind::Planet,
        };
        let (id, mag, electrons) = (FIRST_BODY_ID + number, sum.mag, sum.on_detector);
        let smear_px = plan.smear.length_px(mid_px) / f64::from(output.binning);
        let smear_deg = plan.smear.angle_rad(mid_px).to_degrees();
        let row = directions.row_at(&place);
        out.push(TruthStar { id, mag, x_px, y_px, electrons, kind, smear_px, smear_deg, ..row });
    }
}

/// The light of one body in a plan.
#[derive(Debug, Clone, Copy, Default)]
struct BodySum {
    mag: f32,
    electrons: f64,
    on_detector: f64,
    /// Sums of place times electrons, at mid-exposure and of the mean.
    mid: [f64; 2],
    mean: [f64; 2],
}

impl BodySum {
    fn add(&mut self, star: &PlannedStar) {
        self.mag = star.mag;
        self.electrons += star.electrons;
        self.on_detector += star.electrons_on_detector;
        for axis in 0..2 {
            self.mid[axis] += star.electrons * star.place.mid_px[axis];
            self.mean[axis] += star.electrons * star.mean_px[axis];
        }
    }
}

/// Adds a row per proton track: its middle, its electrons, and its length and direction instead of a smear.
pub fn add_tracks(tracks: &[ProtonTrack], output: &OutputGeometry, out: &mut Vec<TruthStar>) {
    out.extend((FIRST_TRACK_ID..FIRST_FALSE_STAR_ID).zip(tracks).map(|(id, track)| {
        let ([ax, ay], [bx, by]) = (track.start_px, track.end_px);
        let [x_px, y_px] = output.output_from_sensor([0.5 * (ax + bx), 0.5 * (ay + by)]);
        TruthStar {
            id,
            // A track has no place on the sky.
            apparent_deg: [f64::NAN; 2],
            catalog_deg: [f64::NAN; 2],
            mag: f32::NAN,
            x_px,
            y_px,
            electrons: track.electrons,
            kind: TruthKind::ProtonTrack,
            smear_px: (bx - ax).hypot(by - ay) / f64::from(output.binning),
            smear_deg: (by - ay).atan2(bx - ax).to_degrees(),
            source_id: None,
        }
    }));
}

/// Keeps only the rows of sources that may shine into the parts of the image that are read out; Earth and Moon, which
/// are large, stay.
pub fn keep_shown(
    plan: &ExposurePlan,
    output: &OutputGeometry,
    regions: &Regions,
    truth: &mut Vec<TruthStar>,
    targets: &mut Vec<TargetRow>,
) {
    if regions.is_whole() {
        return;
    }
    let binning = f64::from(output.binning);
    let reach_px = (plan.widest_half_px() as f64 + 1.0) / binning;
    let shows = |[x, y]: [f64; 2], reach_px: f64| {
        let [left, top] = [x - reach_px, y - reach_px].map(|px| px.round() as i64);
        regions.show(left, top, [(2.0 * reach_px) as i64 + 1; 2])
    };
    truth.retain(|row| {
        let is_large = matches!(row.kind, TruthKind::Moon | TruthKind::Earth);
        is_large || shows([row.x_px, row.y_px], reach_px + 0.5 * row.smear_px)
    });
    targets.retain(|row| truth.iter().any(|shown| shown.id == row.id));
}

/// Returns the kind of source for an identifier.
fn kind_of(id: u32) -> TruthKind {
    if (FIRST_FALSE_STAR_ID..FIRST_TARGET_ID).contains(&id) { TruthKind::FalseStar } else { TruthKind::Star }
}

/// Conversion of places on the detector to directions on the sky.
struct Directions<'a> {
    icrf_from_sensor: Rotation<Icrf, Sensor>,
    sight: Option<&'a Sight>,
}

impl Directions<'_> {
    /// Returns a row with only its directions.
    fn row_at(&self, place: &StarPlace) -> TruthStar {
        let degrees = |direction: DVec3| ra_dec_rad(direction).map(f64::to_degrees);
        let apparent = self.icrf_from_sensor.apply(place.mid_sensor());
        let catalog_deg = self.sight.map_or([f64::NAN; 2], |sight| degrees(sight.natural(apparent)));
        TruthStar { apparent_deg: degrees(apparent), catalog_deg, ..TruthStar::NONE }
    }
}

/// Returns the smear of a target's light on the sensor: of its own motion, and of the camera's if that moves.
fn smear_of(planned: &PlannedTarget, plan: &ExposurePlan) -> Smear {
    let ends = || {
        let times_s = seen_after_mid_s(&planned.target, &plan.motion, 0.0)?;
        let [begin, end] = times_s.map(|t_s| seen_by_row(&planned.target, plan, t_s));
        Some((begin?, end?))
    };
    let (false, Some((begin, end))) = (plan.motion.is_still(), ends()) else { return planned.smear };
    let nodes = plan.stars[planned.nodes.clone()].iter().map(|node| node.mean_px);
    let length_px = polyline_px(core::iter::once(begin).chain(nodes).chain([end]));
    Smear { length_px, angle_rad: (end[1] - begin[1]).atan2(end[0] - begin[0]) }
}
