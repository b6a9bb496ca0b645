//! Sources -> stars of a plan: mid-exposure position, mean over the exposure, and electrons, which are those of the
//! source times the relative illumination at its mid-exposure position (bound of the change during the exposure:
//! [`crate::optics::illumination`]). Uses all cores; the order of sources is kept, so a repeated plan is the same for
//! any number of threads.
//!
//! *Blocks.* Directions or pixels -> places and mean places, eight stars at a time: the vector form of `place_one`.
//!
//! Domain: a lens without distortion and one mean pose for all rows (a global shutter, or a still image), where it is
//! the same arithmetic; otherwise stars are placed one by one. Test: `blocks_place_as_single_stars_do` in `place`.

use crate::exposure::mean_field::{Correction, MeanField};
use crate::exposure::pose::{Pose, ROLL, SHIFT};
use crate::exposure::share::Still;
use crate::exposure::source::{PlannedStar, Source, SourcePlace};
use crate::exposure::track::{StarPlace, StarTrack};
use crate::{attitude::LosPath, optics::Illumination};
use base::vector_level::vector_level;
use glam::{DVec2, DVec3};
use pulp::NullaryFnOnce;
use rayon::prelude::*;
use sky::astrometry::CameraGeometry;

/// Number of stars one thread takes at a time, at least.
const CHUNK: usize = 1024;

/// The brightest and the faintest of the stars, and how many may be drawn whole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Brightness {
    /// Electrons of the brightest (0 without stars).
    pub(super) most_e: f64,
    /// Electrons of the faintest (infinite without stars).
    pub(super) least_e: f64,
    /// Stars of [`Margins::from_e`] electrons and more.
    pub(super) whole: usize,
}

impl Brightness {
    const NONE: Self = Self { most_e: 0.0, least_e: f64::INFINITY, whole: 0 };

    /// Takes a star into account, if it is seen.
    #[inline(always)]
    fn add(&mut self, is_seen: bool, electrons: f64, whole_from_e: f64) {
        // Of two numbers, one instruction; `f64::max` also looks for NaN.
        self.most_e = if is_seen & (electrons > self.most_e) { electrons } else { self.most_e };
        self.least_e = if is_seen & (electrons < self.least_e) { electrons } else { self.least_e };
        self.whole += usize::from(is_seen & (electrons >= whole_from_e));
    }

    fn and(self, other: Self) -> Self {
        Self {
            most_e: self.most_e.max(other.most_e),
            least_e: self.least_e.min(other.least_e),
            whole: self.whole + other.whole,
        }
    }
}

/// Camera and illumination of the field of the sources.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lit<'a> {
    /// Projection and distortion.
    pub(super) camera: &'a CameraGeometry,
    /// Relative illumination of the image plane.
    pub(super) illumination: &'a Illumination,
    /// Shares of the light that lands on the detector, where stars do not move: else they depend on the path.
    pub(super) still: Option<Still<'a>>,
}

/// Replaces `stars` by those of all sources whose light can reach the detector: mean place within its margin of it. A
/// star is out of sight when its direction is outside the camera's domain. `seen` is a buffer for the number of stars
/// of every part of the sources.
pub(super) fn place_stars(
    sources: &[Source],
    lit: Lit<'_>,
    los: &LosPath,
    means: &MeanField,
    margins: Margins,
    (stars, seen): (&mut Vec<PlannedStar>, &mut Vec<usize>),
) -> Brightness {
    let (blocks, arch) = (BlockPlacer::new(lit.camera, los, means), vector_level());
    let place_part = |((stars, seen), sources): ((&mut [PlannedStar], &mut usize), &[Source])| {
        let mut placed = Placed { stars, seen: 0, brightness: Brightness::NONE, margins };
        let place_one = |source: &Source| place_one(source, lit, los, means, margins);
        let (eights, rest) = sources.as_chunks::<STARS>();
        if let Some(placer) = blocks {
            arch.dispatch(PlaceBlocks { placer, sources: eights, lit, placed: &mut placed, place_one });
        }
        let single = if blocks.is_some() { rest } else { sources };
        single.iter().filter_map(place_one).for_each(|star| placed.push(star));
        *seen = placed.seen;
        placed.brightness
    };
    // One part for each thread: stars behind a gap are moved, by one thread.
    let part = sources.len().div_ceil(rayon::current_num_threads()).next_multiple_of(STARS).max(CHUNK);
    // Not cleared: every star is overwritten.
    stars.resize(sources.len(), EMPTY);
    seen.resize(sources.len().div_ceil(part), 0);
    let found = if let [seen] = seen.as_mut_slice() {
        place_part(((stars, seen), sources))
    } else {
        let parts = stars.par_chunks_mut(part).zip(&mut *seen).zip(sources.par_chunks(part));
        parts.map(place_part).reduce(|| Brightness::NONE, Brightness::and)
    };
    let mut end = 0;
    for (first, seen) in (0..).step_by(part).zip(&*seen) {
        if end < first {
            stars.copy_within(first..first + seen, end);
        }
        end += seen;
    }
    stars.truncate(end);
    found
}

/// Calls `work` for all stars, in parallel when there are many.
pub(super) fn for_each_star(stars: &mut [PlannedStar], work: impl Fn(&mut PlannedStar) + Sync) {
    if stars.len() <= CHUNK {
        stars.iter_mut().for_each(work);
    } else {
        stars.par_chunks_mut(CHUNK).for_each(|stars| stars.iter_mut().for_each(&work));
    }
}

/// How the place of a source is given.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Icrf,
    Pixel,
}

/// Returns how all places are given; `None` where both kinds are mixed.
#[inline(always)]
fn kind_of_all(sources: &[Source; STARS]) -> Option<Kind> {
    let pixels: usize = sources.iter().map(|source| usize::from(matches!(source.place, SourcePlace::Pixel(_)))).sum();
    match pixels {
        0 => Some(Kind::Icrf),
        STARS => Some(Kind::Pixel),
        _ => None,
    }
}

/// The visible stars of a part of the sources, at its front.
struct Placed<'a> {
    stars: &'a mut [PlannedStar],
    seen: usize,
    brightness: Brightness,
    margins: Margins,
}

impl Placed<'_> {
    fn push(&mut self, star: PlannedStar) {
        self.brightness.add(true, star.electrons, self.margins.from_e);
        if let Some(slot) = self.stars.get_mut(self.seen) {
            *slot = star;
            self.seen += 1;
        }
    }
}

/// Blocks of a part, in the form that `pulp` compiles once per vector level. Sources of a block with places of both kinds
/// are placed one by one: a block is the same on any number of threads.
struct PlaceBlocks<'a, 'b, F> {
    placer: BlockPlacer,
    sources: &'a [[Source; STARS]],
    lit: Lit<'a>,
    placed: &'a mut Placed<'b>,
    place_one: F,
}

impl<F: Fn(&Source) -> Option<PlannedStar>> NullaryFnOnce for PlaceBlocks<'_, '_, F> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { placer, sources, lit, placed, place_one } = self;
        let mut lanes = [Brightness::NONE; STARS];
        for sources in sources {
            let Some(kind) = kind_of_all(sources) else {
                sources.iter().filter_map(&place_one).for_each(|star| placed.push(star));
                continue;
            };
            let Placed { stars, seen, margins, .. } = &mut *placed;
            let mut given = [[0.0; STARS]; 3];
            for (k, source) in sources.iter().enumerate() {
                let numbers = match source.place {
                    SourcePlace::Icrf(DVec3 { x, y, z }) => [x, y, z],
                    SourcePlace::Pixel([x, y]) => [x, y, 0.0],
                };
                for (row, number) in given.iter_mut().zip(numbers) {
                    row[k] = number;
                }
            }
            let places = placer.place(kind, &given);
            let tangent = |k: usize| DVec2::new(places.tangent[0][k], places.tangent[1][k]);
            let mut electrons: Eight = core::array::from_fn(|k| sources[k].electrons);
            if !lit.illumination.is_even() {
                for (k, electrons) in electrons.iter_mut().enumerate() {
                    *electrons *= lit.illumination.at(tangent(k));
                }
            }
            let is_seen: [bool; STARS] = core::array::from_fn(|k| margins.see(places.outside_px[k], electrons[k]));
            for k in 0..STARS {
                lanes[k].add(is_seen[k], electrons[k], margins.from_e);
            }
            for (k, source) in sources.iter().enumerate() {
                // Without a branch: what is not seen is overwritten by the next one, or cut off.
                let Some(slot) = stars.get_mut(*seen) else { continue };
                let place = StarPlace { mid_px: [places.mid_px[0][k], places.mid_px[1][k]], tangent: tangent(k) };
                let mean_px = [places.mean_px[0][k], places.mean_px[1][k]];
                *slot = star_at(source, electrons[k], place, mean_px, lit.still);
                *seen += usize::from(is_seen[k]);
            }
        }
        placed.brightness = lanes.into_iter().fold(placed.brightness, Brightness::and);
    }
}

/// Returns the star of a visible source.
#[inline(always)]
fn star_at(
    source: &Source,
    electrons: f64,
    place: StarPlace,
    mean_px: [f64; 2],
    still: Option<Still<'_>>,
) -> PlannedStar {
    let electrons_on_detector = still.map_or(0.0, |still| electrons * still.at(mean_px));
    let Source { id, mag, .. } = *source;
    PlannedStar { id, mag, electrons, drawn_e: electrons, electrons_on_detector, place, mean_px, ..EMPTY }
}

/// A place for a star that is not there yet.
const EMPTY: PlannedStar = PlannedStar {
    id: 0,
    mag: 0.0,
    electrons: 0.0,
    drawn_e: 0.0,
    electrons_on_detector: 0.0,
    place: StarPlace { mid_px: [f64::NAN; 2], tangent: DVec2::ZERO },
    mean_px: [f64::NAN; 2],
    list: 0,
};

/// Returns the star of a source; `None` when it leaves no light on the detector.
#[inline(always)]
fn place_one(source: &Source, lit: Lit<'_>, los: &LosPath, means: &MeanField, margins: Margins) -> Option<PlannedStar> {
    let camera = lit.camera;
    let place = match source.place {
        SourcePlace::Icrf(direction) => StarPlace::of_direction(camera, los.mid_sensor_from_icrf.apply(direction)),
        SourcePlace::Pixel(px) => StarPlace::of_pixel(camera, px),
    }?;
    let last_px = last_px(camera);
    let seen = |mean_px: [f64; 2]| {
        let electrons = source.electrons * lit.illumination.at(place.tangent);
        let is_seen = margins.see(outside_px(mean_px, last_px), electrons);
        is_seen.then(|| star_at(source, electrons, place, mean_px, lit.still))
    };
    if means.is_still() {
        return seen(place.mid_px);
    }
    let track = StarTrack::new(camera, place);
    let [dx, dy] = means.displacement_px(&track);
    let star = seen([place.mid_px[0] + dx, place.mid_px[1] + dy])?;
    Some(PlannedStar { drawn_e: star.drawn_e * means.rolling_gain(&track), ..star })
}

/// Distances from the detector within which the light of stars can reach it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Margins {
    /// For ordinary stars, px.
    pub(super) ordinary_px: f64,
    /// For those of `from_e` and more, which may be drawn whole, px.
    pub(super) whole_px: f64,
    /// Electrons from which on a star may be drawn whole.
    pub(super) from_e: f64,
}

impl Margins {
    /// Returns whether a star leaves light on the detector from `outside_px` beyond it.
    #[inline(always)]
    fn see(&self, outside_px: f64, electrons: f64) -> bool {
        (outside_px < self.ordinary_px) | (outside_px < self.whole_px) & (electrons >= self.from_e)
    }
}

/// Returns the place of the last pixel.
fn last_px(camera: &CameraGeometry) -> [f64; 2] {
    [camera.width_px(), camera.height_px()].map(|side| side as f64 - 1.0)
}

/// Returns how far a place is outside the pixels' centres, px; negative within. The larger one of both axes.
#[inline(always)]
fn outside_px([x, y]: [f64; 2], [last_x, last_y]: [f64; 2]) -> f64 {
    // Of two numbers, one instruction; `f64::max` also looks for NaN.
    let larger = |a: f64, b: f64| if a > b { a } else { b };
    larger(larger(-x, x - last_x), larger(-y, y - last_y))
}

/// Number of stars in a block.
const STARS: usize = 8;

/// Numbers of eight stars.
type Eight = [f64; STARS];

/// Data common to all stars of an exposure.
#[derive(Debug, Clone, Copy)]
struct BlockPlacer {
    /// Rows of the rotation from ICRF to sensor axes.
    rows: [DVec3; 3],
    focal_px: [f64; 2],
    centre_px: [f64; 2],
    /// Square of the largest tangent that is imaged.
    domain_squared: f64,
    /// Mean places are those of mid-exposure.
    is_still: bool,
    pose: Pose,
    correction: Correction,
    last_px: [f64; 2],
}

/// Places of eight stars; other values of stars that are infinitely far outside are undefined.
#[derive(Debug, Clone, Copy)]
struct Places {
    /// Distance of the mean places outside the detector, px (infinite: not imaged).
    outside_px: Eight,
    tangent: [Eight; 2],
    mid_px: [Eight; 2],
    mean_px: [Eight; 2],
}

impl BlockPlacer {
    /// Returns a placer for one exposure; `None` outside the domain.
    fn new(camera: &CameraGeometry, los: &LosPath, means: &MeanField) -> Option<Self> {
        let (pose, correction) = means.same_for_all_rows()?;
        if camera.is_distorted() {
            return None;
        }
        let parameters = camera.parameters();
        let inverse = los.mid_sensor_from_icrf.inverse();
        Some(Self {
            rows: [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| inverse.apply(axis)),
            focal_px: parameters.focal_px,
            centre_px: parameters.principal_point_px,
            domain_squared: camera.largest_tangent().powi(2),
            is_still: means.is_still(),
            pose,
            correction,
            last_px: last_px(camera),
        })
    }

    /// Places eight directions or pixels, by component.
    #[inline(always)]
    fn place(&self, kind: Kind, given: &[Eight; 3]) -> Places {
        let mut places = Places {
            outside_px: [f64::INFINITY; STARS],
            tangent: [[0.0; STARS]; 2],
            mid_px: [[0.0; STARS]; 2],
            mean_px: [[0.0; STARS]; 2],
        };
        let is_imaged = match kind {
            Kind::Icrf => self.project(given, &mut places),
            Kind::Pixel => self.take_px(given, &mut places),
        };
        if self.is_still {
            places.mean_px = places.mid_px;
        } else {
            self.mean(&mut places);
        }
        for k in 0..STARS {
            let outside_px = outside_px([places.mean_px[0][k], places.mean_px[1][k]], self.last_px);
            places.outside_px[k] = if is_imaged[k] { outside_px } else { f64::INFINITY };
        }
        places
    }

    /// Projects eight directions, and returns which are imaged.
    #[inline(always)]
    fn project(&self, [x, y, z]: &[Eight; 3], places: &mut Places) -> [bool; STARS] {
        let [row_x, row_y, row_z] = self.rows;
        let [cx, cy] = self.centre_px;
        let [fx, fy] = self.focal_px;
        let mut is_imaged = [false; STARS];
        for k in 0..STARS {
            let along = |row: DVec3| row.x * x[k] + row.y * y[k] + row.z * z[k];
            let forward = along(row_z);
            let (u, v) = (along(row_x) / forward, along(row_y) / forward);
            places.tangent[0][k] = u;
            places.tangent[1][k] = v;
            places.mid_px[0][k] = cx + fx * u;
            places.mid_px[1][k] = cy + fy * v;
            // A direction behind the camera, or beyond the domain, is not imaged.
            is_imaged[k] = (forward > 0.0) & (u * u + v * v <= self.domain_squared);
        }
        is_imaged
    }

    /// Takes eight pixels as they are, and returns which are imaged.
    #[inline(always)]
    fn take_px(&self, [x, y, _]: &[Eight; 3], places: &mut Places) -> [bool; STARS] {
        let [cx, cy] = self.centre_px;
        let [fx, fy] = self.focal_px;
        places.mid_px = [*x, *y];
        let mut is_imaged = [false; STARS];
        for k in 0..STARS {
            let (u, v) = ((x[k] - cx) / fx, (y[k] - cy) / fy);
            places.tangent[0][k] = u;
            places.tangent[1][k] = v;
            is_imaged[k] = u * u + v * v <= self.domain_squared;
        }
        is_imaged
    }

    #[inline(always)]
    fn mean(&self, places: &mut Places) {
        let Pose(p) = &self.pose;
        let (sin, less, shift) = (p[ROLL], p[ROLL + 1], [p[SHIFT], p[SHIFT + 1]]);
        let [cx, cy] = self.centre_px;
        let [fx, fy] = self.focal_px;
        for k in 0..STARS {
            let (u, v) = (places.tangent[0][k], places.tangent[1][k]);
            let (px, py) = (places.mid_px[0][k], places.mid_px[1][k]);
            let turned = |row: usize| p[3 * row] * u + p[3 * row + 1] * v + p[3 * row + 2];
            let back = turned(2);
            let scale = 1.0 / (1.0 + back);
            let dx = fx * ((turned(0) - u * back) * scale);
            let dy = fy * ((turned(1) - v * back) * scale);
            let (ax, ay) = (px - cx + dx, py - cy + dy);
            places.mean_px[0][k] = px + (dx + less * ax - sin * ay + shift[0]);
            places.mean_px[1][k] = py + (dy + sin * ax + less * ay + shift[1]);
        }
        self.correction.add_to_eight(&places.mid_px, &mut places.mean_px);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exposure::motion::{Motion, Shutter};
    use crate::{attitude::JitterLine, exposure::probes::Probes};
    use base::axes::{Rotation, sensor_from_ra_dec_roll};
    use base::time::Tai;
    use sky::astrometry::{BrownConrady, CameraParameters};

    /// Rounding of a few operations on tens of thousands of px.
    const ROUNDING_PX: f64 = 1e-10;
    /// Half of the sources may be drawn whole.
    const MARGINS: Margins = Margins { ordinary_px: 5.0, whole_px: 30.0, from_e: 2000.0 };

    fn camera(k1: f64) -> CameraGeometry {
        CameraGeometry::new(CameraParameters {
            width_px: 700,
            height_px: 500,
            focal_px: [900.0, 905.0],
            principal_point_px: [350.0, 244.0],
            distortion: BrownConrady { k1, ..BrownConrady::default() },
        })
        .unwrap()
    }

    fn motion(moves: bool) -> Motion {
        let at = Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap();
        let mut los = LosPath::commanded(sensor_from_ra_dec_roll(1.0, -0.4, 0.7), at, 0.1);
        if moves {
            los.rate_rad_s = DVec3::new(0.02, -0.03, 0.4);
            let amplitude_rad = DVec3::new(1e-3, 2e-3, 0.0);
            los.jitter.lines = vec![JitterLine { frequency_hz: 31.0, amplitude_rad, phase_rad: 0.3 }];
        }
        Motion { los, image_path: None }
    }

    /// Returns the same places as pixels, and some that no camera has.
    fn in_pixels(sources: &[Source], camera: &CameraGeometry, motion: &Motion) -> Vec<Source> {
        let pixel = |source: &Source| {
            let SourcePlace::Icrf(direction) = source.place else { return *source };
            let place = StarPlace::of_direction(camera, motion.los.mid_sensor_from_icrf.apply(direction));
            let px = place.map_or([f64::NAN, f64::INFINITY], |place| place.mid_px);
            Source { place: SourcePlace::Pixel(px), ..*source }
        };
        sources.iter().map(pixel).collect()
    }

    /// Returns directions all over the sky, most of them near the boresight.
    fn sources(motion: &Motion) -> Vec<Source> {
        let back: Rotation<_, _> = motion.los.mid_sensor_from_icrf.inverse();
        let source = |i: u32| {
            let [x, y] = [i * 131 % 1009, i * 197 % 907].map(|v| f64::from(v) / 500.0 - 0.95);
            let z = if i.is_multiple_of(17) { -1.0 } else { 1.0 };
            let direction = back.apply(DVec3::new(x, y, z).normalize());
            Source { id: i, electrons: f64::from(i), mag: 1.0, place: SourcePlace::Icrf(direction) }
        };
        (1..4000).map(source).collect()
    }

    #[test]
    fn blocks_place_as_single_stars_do() {
        // The sources from this number on have their places in pixels: in the last case but two from the middle of a block.
        const NONE: usize = usize::MAX;
        for (moves, k1, shutter, in_blocks, pixels_from) in [
            (true, 0.0, Shutter::Global, true, NONE),
            (false, 0.0, Shutter::Global, true, NONE),
            (true, 0.0, Shutter::Global, true, 0),
            (false, 0.0, Shutter::Global, true, 0),
            (true, 0.0, Shutter::Global, true, 1003),
            (true, -0.05, Shutter::Global, false, NONE),
            (true, 0.0, Shutter::Rolling { line_s: 1e-5 }, false, 0),
        ] {
            let (camera, motion, illumination) = (camera(k1), motion(moves), Illumination::EVEN);
            let mut probes = Probes::new(&camera, shutter);
            probes.measure(&motion, 0.8);
            let mut means = MeanField::new(&camera);
            means.measure(&motion, shutter, &probes);
            let lit = Lit { camera: &camera, illumination: &illumination, still: None };
            assert_eq!(BlockPlacer::new(&camera, &motion.los, &means).is_some(), in_blocks, "{moves} {k1}");
            let mut sources = sources(&motion);
            let pixels = in_pixels(&sources, &camera, &motion);
            let first = pixels_from.min(sources.len());
            sources[first..].copy_from_slice(&pixels[first..]);
            let kinds: Vec<_> = sources.as_chunks().0.iter().map(kind_of_all).collect();
            assert_eq!(kinds.contains(&Some(Kind::Icrf)), pixels_from > 0);
            assert_eq!(kinds.contains(&Some(Kind::Pixel)), pixels_from < NONE);
            assert_eq!(kinds.iter().filter(|kind| kind.is_none()).count(), usize::from(pixels_from == 1003));
            let (mut stars, mut seen) = (Vec::new(), Vec::new());
            let found = place_stars(&sources, lit, &motion.los, &means, MARGINS, (&mut stars, &mut seen));
            let single = |source: &Source| place_one(source, lit, &motion.los, &means, MARGINS);
            let wanted: Vec<_> = sources.iter().filter_map(single).collect();
            let ids = |stars: &[PlannedStar]| stars.iter().map(|star| star.id).collect::<Vec<_>>();
            assert_eq!(ids(&stars), ids(&wanted), "the same stars, in source order");
            assert!((400..3000).contains(&stars.len()), "control: {} in sight, others not", stars.len());
            let apart = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
            for (star, wanted) in stars.iter().zip(&wanted) {
                assert!(apart(star.mean_px, wanted.mean_px) < ROUNDING_PX, "{star:?} {wanted:?}");
                assert!(apart(star.place.mid_px, wanted.place.mid_px) < ROUNDING_PX);
                assert!(star.place.tangent.distance(wanted.place.tangent) < 1e-14);
            }
            let furthest = stars.iter().map(|star| apart(star.mean_px, star.place.mid_px)).fold(0.0, f64::max);
            let outside_px = |star: &PlannedStar| {
                let [x, y] = star.mean_px;
                (-x).max(x - 699.0).max(-y).max(y - 499.0)
            };
            let [faint_px, bright_px] = [false, true].map(|is_bright| {
                let of = stars.iter().filter(|star| (star.electrons >= MARGINS.from_e) == is_bright);
                of.map(outside_px).fold(0.0, f64::max)
            });
            assert!(faint_px < 5.0 && (5.0..30.0).contains(&bright_px), "furthest outside: {faint_px} {bright_px} px");
            assert_eq!(furthest > 1e-3, moves, "control: motion has moved the means by {furthest} px");
            let most_e = stars.iter().map(|star| star.electrons).fold(0.0, f64::max);
            assert_eq!(found.most_e, most_e);
            let whole = stars.iter().filter(|star| star.electrons >= MARGINS.from_e).count();
            assert!(whole > 0 && whole < stars.len(), "control: {whole} of {}", stars.len());
            assert_eq!(found.whole, whole);
        }
    }
}
