//! Sources -> stars of a plan: where each stands at mid-exposure, and its mean over the exposure. All cores; source
//! order is kept, so a repeated plan is the same whatever the number of threads.

use crate::astrometry::CameraGeometry;
use crate::attitude::LosPath;
use crate::exposure::mean_field::MeanField;
use crate::exposure::plan::PlannedStar;
use crate::exposure::planner::{Source, SourcePlace};
use crate::exposure::track::{StarPlace, StarTrack};
use glam::DVec2;
use rayon::prelude::*;

/// Stars one thread takes at a time.
const CHUNK: usize = 2048;
/// A star that leaves no light on the detector.
const NOWHERE: [f64; 2] = [f64::NAN; 2];

/// Stars of all sources whose light can reach the detector: mean place within `margin_px` of it. A star is out of
/// sight when its direction is outside the camera's domain.
pub(super) fn place_stars(
    sources: &[Source],
    camera: &CameraGeometry,
    los: &LosPath,
    means: &MeanField,
    margin_px: f64,
    stars: &mut Vec<PlannedStar>,
) {
    stars.clear();
    stars.resize(sources.len(), EMPTY);
    let placed = |(star, source): (&mut PlannedStar, &Source)| *star = place(source, camera, los, means, margin_px);
    if sources.len() <= CHUNK {
        stars.iter_mut().zip(sources).for_each(placed);
    } else {
        stars.par_chunks_mut(CHUNK).zip(sources.par_chunks(CHUNK)).for_each(|(stars, sources)| {
            stars.iter_mut().zip(sources).for_each(placed);
        });
    }
    if stars.iter().any(|star| star.mean_px[0].is_nan()) {
        stars.retain(|star| !star.mean_px[0].is_nan());
    }
}

const EMPTY: PlannedStar = PlannedStar {
    id: 0,
    mag: 0.0,
    electrons: 0.0,
    electrons_on_detector: 0.0,
    place: StarPlace { mid_px: NOWHERE, tangent: DVec2::ZERO },
    mean_px: NOWHERE,
    list: 0,
};

fn place(source: &Source, camera: &CameraGeometry, los: &LosPath, means: &MeanField, margin_px: f64) -> PlannedStar {
    let place = match source.place {
        SourcePlace::Icrf(direction) => StarPlace::of_direction(camera, los.mid_sensor_from_icrf.apply(direction)),
        SourcePlace::Pixel(px) => StarPlace::of_pixel(camera, px),
    };
    let Some(place) = place else { return EMPTY };
    let mean_px = if means.is_still() {
        place.mid_px
    } else {
        let [dx, dy] = means.displacement_px(&StarTrack::new(camera, place));
        [place.mid_px[0] + dx, place.mid_px[1] + dy]
    };
    let inside = |v: f64, size: usize| v > -margin_px && v < size as f64 - 1.0 + margin_px;
    if !inside(mean_px[0], camera.width_px()) || !inside(mean_px[1], camera.height_px()) {
        return EMPTY;
    }
    PlannedStar { id: source.id, mag: source.mag, electrons: source.electrons, place, mean_px, ..EMPTY }
}
