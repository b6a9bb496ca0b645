//! Sources -> stars of a plan: where each stands at mid-exposure, its mean over the exposure, and its electrons there:
//! those of the source times the relative illumination at its place at mid-exposure (bound of what the value may change
//! by during the exposure: [`crate::optics::illumination`]). All cores; source
//! order is kept, so a repeated plan is the same whatever the number of threads.

use crate::astrometry::CameraGeometry;
use crate::attitude::LosPath;
use crate::exposure::mean_field::MeanField;
use crate::exposure::plan::PlannedStar;
use crate::exposure::planner::{Source, SourcePlace};
use crate::exposure::track::{StarPlace, StarTrack};
use crate::optics::Illumination;
use glam::DVec2;
use rayon::prelude::*;

/// Stars one thread takes at a time.
const CHUNK: usize = 1024;
/// A star that leaves no light on the detector.
const NOWHERE: [f64; 2] = [f64::NAN; 2];

/// The brightest and the faintest of the stars.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Brightness {
    /// Electrons of the brightest (0 without stars).
    pub(super) most_e: f64,
    /// Electrons of the faintest (infinite without stars).
    pub(super) least_e: f64,
    /// Stars that are out of sight.
    out: usize,
}

impl Brightness {
    const NONE: Self = Self { most_e: 0.0, least_e: f64::INFINITY, out: 0 };

    fn and(self, other: Self) -> Self {
        Self {
            most_e: self.most_e.max(other.most_e),
            least_e: self.least_e.min(other.least_e),
            out: self.out + other.out,
        }
    }
}

/// The field that sources stand in.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lit<'a> {
    /// Projection and distortion.
    pub(super) camera: &'a CameraGeometry,
    /// How the image plane is lit.
    pub(super) illumination: &'a Illumination,
}

/// Stars of all sources whose light can reach the detector: mean place within `margin_px` of it. A star is out of
/// sight when its direction is outside the camera's domain.
pub(super) fn place_stars(
    sources: &[Source],
    lit: Lit<'_>,
    los: &LosPath,
    means: &MeanField,
    margin_px: f64,
    stars: &mut Vec<PlannedStar>,
) -> Brightness {
    // No clearing: every star is written.
    stars.resize(sources.len(), EMPTY);
    let chunk = |(stars, sources): (&mut [PlannedStar], &[Source])| {
        stars.iter_mut().zip(sources).fold(Brightness::NONE, |found, (star, source)| {
            *star = place(source, lit, los, means, margin_px);
            if star.mean_px[0].is_nan() {
                return Brightness { out: found.out + 1, ..found };
            }
            found.and(Brightness { most_e: star.electrons, least_e: star.electrons, out: 0 })
        })
    };
    let found = if sources.len() <= CHUNK {
        chunk((stars, sources))
    } else {
        let chunks = stars.par_chunks_mut(CHUNK).zip(sources.par_chunks(CHUNK));
        chunks.map(chunk).reduce(|| Brightness::NONE, Brightness::and)
    };
    if found.out > 0 {
        stars.retain(|star| !star.mean_px[0].is_nan());
    }
    found
}

/// Runs `work` on all stars, side by side when there are many.
pub(super) fn for_each_star(stars: &mut [PlannedStar], work: impl Fn(&mut PlannedStar) + Sync) {
    if stars.len() <= CHUNK {
        stars.iter_mut().for_each(work);
    } else {
        stars.par_chunks_mut(CHUNK).for_each(|stars| stars.iter_mut().for_each(&work));
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

fn place(source: &Source, lit: Lit<'_>, los: &LosPath, means: &MeanField, margin_px: f64) -> PlannedStar {
    let Lit { camera, illumination } = lit;
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
    let electrons = source.electrons * illumination.at(place.tangent);
    PlannedStar { id: source.id, mag: source.mag, electrons, place, mean_px, ..EMPTY }
}
