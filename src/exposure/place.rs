//! Sources -> stars of a plan: where each stands at mid-exposure, its mean over the exposure, and its electrons there:
//! those of the source times the relative illumination at its place at mid-exposure (bound of what the value may change
//! by during the exposure: [`crate::optics::illumination`]). All cores; source
//! order is kept, so a repeated plan is the same whatever the number of threads.

use crate::astrometry::CameraGeometry;
use crate::attitude::LosPath;
use crate::exposure::mean_field::MeanField;
use crate::exposure::place_block::{BlockPlacer, STARS};
use crate::exposure::plan::PlannedStar;
use crate::exposure::planner::{Source, SourcePlace};
use crate::exposure::track::{StarPlace, StarTrack};
use crate::optics::Illumination;
use glam::{DVec2, DVec3};
use pulp::{Arch, NullaryFnOnce};
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
}

impl Brightness {
    const NONE: Self = Self { most_e: 0.0, least_e: f64::INFINITY };

    fn and(self, other: Self) -> Self {
        Self { most_e: self.most_e.max(other.most_e), least_e: self.least_e.min(other.least_e) }
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

/// Replaces `stars` by those of all sources whose light can reach the detector: mean place within `margin_px` of it. A star
/// is out of sight when its direction is outside the camera's domain. `seen`: room for the number of stars of every chunk.
pub(super) fn place_stars(
    sources: &[Source],
    lit: Lit<'_>,
    los: &LosPath,
    means: &MeanField,
    margin_px: f64,
    (stars, seen): (&mut Vec<PlannedStar>, &mut Vec<usize>),
) -> Brightness {
    // No clearing: every star is written.
    stars.resize(sources.len(), EMPTY);
    seen.resize(sources.len().div_ceil(CHUNK), 0);
    let (blocks, arch) = (BlockPlacer::new(lit.camera, los, means, margin_px), Arch::new());
    let chunk = |((stars, seen), sources): ((&mut [PlannedStar], &mut usize), &[Source])| {
        let mut placed = Placed { stars, seen: 0, brightness: Brightness::NONE };
        // Sources of pixel places are few, and come alone.
        let is_icrf = |source: &Source| matches!(source.place, SourcePlace::Icrf(_));
        let in_blocks = blocks.filter(|_| sources.iter().all(is_icrf));
        let (eights, rest) = sources.as_chunks::<STARS>();
        if let Some(placer) = in_blocks {
            arch.dispatch(PlaceBlocks { placer, sources: eights, lit, placed: &mut placed });
        }
        let single = if in_blocks.is_some() { rest } else { sources };
        single.iter().for_each(|source| placed.push(place(source, lit, los, means, margin_px)));
        *seen = placed.seen;
        placed.brightness
    };
    let found = if let [seen] = seen.as_mut_slice() {
        chunk(((stars, seen), sources))
    } else {
        let chunks = stars.par_chunks_mut(CHUNK).zip(&mut *seen).zip(sources.par_chunks(CHUNK));
        chunks.map(chunk).reduce(|| Brightness::NONE, Brightness::and)
    };
    let mut end = 0;
    for (first, seen) in (0..).step_by(CHUNK).zip(&*seen) {
        if end < first {
            stars.copy_within(first..first + seen, end);
        }
        end += seen;
    }
    stars.truncate(end);
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

/// The stars of a chunk that are in sight, at its front.
struct Placed<'a> {
    stars: &'a mut [PlannedStar],
    seen: usize,
    brightness: Brightness,
}

impl Placed<'_> {
    #[inline(always)]
    fn push(&mut self, star: PlannedStar) {
        if !star.mean_px[0].is_nan() {
            self.stars[self.seen] = star;
            self.seen += 1;
            self.brightness = self.brightness.and(Brightness { most_e: star.electrons, least_e: star.electrons });
        }
    }
}

/// Blocks of a chunk, in the shape `pulp` compiles once per vector level.
struct PlaceBlocks<'a, 'b> {
    placer: BlockPlacer,
    sources: &'a [[Source; STARS]],
    lit: Lit<'a>,
    placed: &'a mut Placed<'b>,
}

impl NullaryFnOnce for PlaceBlocks<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        for sources in self.sources {
            let mut directions = [[0.0; STARS]; 3];
            for (k, source) in sources.iter().enumerate() {
                if let SourcePlace::Icrf(DVec3 { x, y, z }) = source.place {
                    directions[0][k] = x;
                    directions[1][k] = y;
                    directions[2][k] = z;
                }
            }
            let places = self.placer.place(&directions);
            for (k, source) in sources.iter().enumerate() {
                if places.in_sight[k] {
                    let tangent = DVec2::new(places.tangent[0][k], places.tangent[1][k]);
                    let place = StarPlace { mid_px: [places.mid_px[0][k], places.mid_px[1][k]], tangent };
                    let mean_px = [places.mean_px[0][k], places.mean_px[1][k]];
                    self.placed.push(star_at(source, place, mean_px, self.lit));
                }
            }
        }
    }
}

/// A source that is seen.
#[inline(always)]
fn star_at(source: &Source, place: StarPlace, mean_px: [f64; 2], lit: Lit<'_>) -> PlannedStar {
    let electrons = source.electrons * lit.illumination.at(place.tangent);
    PlannedStar { id: source.id, mag: source.mag, electrons, place, mean_px, ..EMPTY }
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
    let camera = lit.camera;
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
    star_at(source, place, mean_px, lit)
}
