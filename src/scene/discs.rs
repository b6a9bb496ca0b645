//! A lit body -> point sources on a grid over its disc, which planner, PSF and motion draw as they draw stars.
//!
//! The grid is that of the pixels, `k` cells to a pixel's side: a source in the middle of every lit cell, with the
//! cell's light. Summed over a whole grid of pixels, the PSF integrated over them is 1 for any position, so a uniform
//! disc is drawn without ripple for any PSF and motion. Errors of the grid:
//!
//! * At an edge of full contrast the light is in the middle of the cells instead of spread over them: `1 / (24 k^2)`
//!   times the
//!   slope of the PSF's line spread, 0.5 % of the disc at `k = 2` and sigma 0.7 px ([`edge_error`]).
//! * Cells of more than a pixel, taken when there would be more than [`MOST_CELLS`], show as dots: [`ripple`].
//!
//! Cells on the limb contain the part inside it, by straight lines between the cell's corners, at its centre of
//! gravity: the area of a disc is right to 0.1 % at `CELLS_PER_RADIUS`. Electrons are radiance times solid angle of the
//! cell, so that a part of a disc has its part of the light.
//!
//! Laws: the Earth and planets are Lambert spheres, `cos i`; Moon and Mercury are Lommel-Seeliger, `cos i / (cos i +
//! cos e)`, flat at full phase as the Moon is. Neither has clouds, seas or an opposition peak; the sum follows the
//! magnitude. Limits: the disc does not move among the stars during an exposure (the Earth's limb turns by 0.06 deg/s
//! in low orbit). Tests: below; `tests/physics/bodies.rs`.
//!
//! *Occultation.* Directions -> which are hidden by the Earth or the Moon at mid-exposure.
//!
//! In: the observer's position among the bodies, and the field. Out: yes or no for an apparent direction and a
//! distance; the Earth is the WGS 84 ellipsoid, the Moon a sphere. A spherical Earth would be wrong by up to 21 km at
//! the limb, 0.45 deg from 550 km up: 23 px of 71 arcsec. Limits: no refraction, air or mountains ([`sky::bodies`]);
//! a star that sets during the exposure is visible for all of it or not at all, so its setting is right to half an
//! exposure. Tests: `tests/physics/bodies.rs`.

use base::axes::{Icrf, Rotation, Sensor};
use core::f64::consts::{FRAC_PI_2, PI, TAU};
use glam::DVec3;
use plan::exposure::{Source, SourcePlace};
use rayon::prelude::*;
use sky::astrometry::CameraGeometry;
use sky::bodies::{Spheroid, Standpoint};

/// Number of cells per radius, for small discs.
const CELLS_PER_RADIUS: f64 = 16.0;
/// Largest number of cells of one disc; beyond it they are larger than pixels.
pub const MOST_CELLS: f64 = 1_572_864.0;
/// Number of cells below which discs have two cells to a pixel's side.
const FINE_CELLS: f64 = 65_536.0;
/// Length of a row of cells below which it is not shared among threads.
const CELLS_ALONE: usize = 256;
/// Distance beyond the detector from which light may reach it, px.
const MARGIN_PX: f64 = 32.0;
/// Number of places on the limb by which a disc's extent is found.
const LIMB_PLACES: u32 = 24;
/// Distance of a limb from the middle beyond which it is not projected and the whole detector is searched, rad.
const WIDE_RAD: f64 = 0.5;

/// Reflection law of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Law {
    /// Lambert: by the cosine of incidence.
    Lambert,
    /// Lommel-Seeliger: dust without multiple scattering.
    LommelSeeliger,
}

impl Law {
    /// Returns the radiance for the cosines of incidence and emergence.
    pub fn radiance(self, incidence: f64, emergence: f64) -> f64 {
        match self {
            _ if incidence <= 0.0 => 0.0,
            Self::Lambert => incidence,
            Self::LommelSeeliger => incidence / (incidence + emergence.max(0.0)),
        }
    }

    /// Returns the radiance integrated over a distant sphere's disc of unit radius, at a phase angle.
    pub fn over_disc(self, phase_rad: f64) -> f64 {
        let a = phase_rad.clamp(0.0, PI);
        match self {
            Self::Lambert => 2.0 / 3.0 * (a.sin() + (PI - a) * a.cos()),
            Self::LommelSeeliger if a < 1e-6 => FRAC_PI_2,
            Self::LommelSeeliger => {
                let half = 0.5 * a;
                FRAC_PI_2 * (1.0 - half.sin() * half.tan() * (1.0 / (0.5 * half).tan()).ln())
            }
        }
    }
}

/// A body to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// Its surface.
    pub body: Spheroid,
    /// Identifier of all its sources.
    pub id: u32,
    /// Magnitude in the instrument's band.
    pub mag: f32,
    /// Direction from the body to the Sun, unit, ICRF.
    pub to_sun: DVec3,
    /// Reflection law.
    pub law: Law,
    /// Electrons per steradian in an exposure for a value of 1 of the law.
    pub e_per_sr: f64,
    /// Total electrons, if the magnitude is known.
    pub electrons: Option<f64>,
}

/// Properties of a drawn disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawn {
    /// Number of sources.
    pub sources: usize,
    /// Side of a cell, px.
    pub step_px: f64,
}

/// Returns the error at a sharp edge, as a share of the disc's level, for cells of `step_px` and a PSF that falls like
/// a Gaussian.
pub fn edge_error(step_px: f64, sigma_px: f64) -> f64 {
    // Steepest slope of a Gaussian line spread, integrated over a pixel, whose variance is 1/12 more.
    let variance = sigma_px * sigma_px + 1.0 / 12.0;
    step_px * step_px / 24.0 / (TAU * core::f64::consts::E).sqrt() / variance
}

/// Returns the ripple of a uniform disc, as a share of its level, drawn by cells of `step_px`, with such a PSF: zero up
/// to a pixel, because such cells divide it.
pub fn ripple(step_px: f64, sigma_px: f64) -> f64 {
    if step_px <= 1.0 {
        return 0.0;
    }
    // The lattice's first harmonics, along both sides and the diagonals, through the PSF and the pixel.
    let turns = 1.0 / step_px;
    let pixel = (PI * turns).sin() / (PI * turns);
    let harmonic = (-2.0 * (PI * turns * sigma_px).powi(2)).exp() * pixel;
    (1.0 + 2.0 * harmonic).powi(2) - 1.0
}

/// A corner of cells.
#[derive(Debug, Clone, Copy)]
struct Corner {
    /// Direction, sensor axes, unit.
    direction: DVec3,
    /// Depth inside the limb.
    depth: f64,
    /// The law's value; 0 outside.
    radiance: f64,
    is_hidden: bool,
}

const NOWHERE: Corner = Corner { direction: DVec3::Z, depth: -1.0, radiance: 0.0, is_hidden: false };

/// A rectangle of the image plane in cells.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Grid {
    origin_px: [f64; 2],
    step_px: f64,
    cells: [usize; 2],
    /// True when the whole body is inside it.
    is_whole: bool,
}

/// Draws discs; keeps its buffers.
#[derive(Debug, Default)]
pub struct DiscPainter {
    /// Motion during the exposure, px: light from this much farther beyond the detector may reach it.
    pub sweep_px: f64,
    above: Vec<Corner>,
    below: Vec<Corner>,
}

impl DiscPainter {
    /// Adds the sources of a disc, except for the parts hidden by other bodies; returns `None` when it is not in the
    /// field. A disc completely on the grid has exactly its electrons: a crescent thinner than cells gets too few from
    /// its radiance.
    pub fn paint(
        &mut self,
        disc: &Disc,
        camera: &CameraGeometry,
        sensor_from_icrf: &Rotation<Sensor, Icrf>,
        before: &Occultation,
        out: &mut Vec<Source>,
    ) -> Option<Drawn> {
        let grid = grid(&disc.body, camera, sensor_from_icrf, MARGIN_PX + self.sweep_px)?;
        let view = View { disc, camera, icrf_from_sensor: sensor_from_icrf.inverse(), before };
        let (first, mut before_hiding_e) = (out.len(), 0.0);
        let Self { above, below, .. } = self;
        view.corners(&grid, 0, above);
        for row in 0..grid.cells[1] {
            view.corners(&grid, row + 1, below);
            for column in 0..grid.cells[0] {
                let corners = [above[column], above[column + 1], below[column + 1], below[column]];
                if corners.iter().any(|corner| corner.depth > 0.0) {
                    let (source, seen_share) = source(disc, &grid, [column, row], &corners);
                    before_hiding_e += source.electrons;
                    let electrons = source.electrons * seen_share;
                    out.extend((electrons > 0.0).then_some(Source { electrons, ..source }));
                }
            }
            core::mem::swap(above, below);
        }
        if let (Some(electrons), true) = (disc.electrons, grid.is_whole && before_hiding_e > 0.0) {
            out[first..].iter_mut().for_each(|source| source.electrons *= electrons / before_hiding_e);
        }
        Some(Drawn { sources: out.len() - first, step_px: grid.step_px })
    }
}

/// Inputs shared by all grid corners.
struct View<'a> {
    disc: &'a Disc,
    camera: &'a CameraGeometry,
    icrf_from_sensor: Rotation<Icrf, Sensor>,
    before: &'a Occultation,
}

impl View<'_> {
    fn corners(&self, grid: &Grid, row: usize, out: &mut Vec<Corner>) {
        let y = grid.origin_px[1] + row as f64 * grid.step_px;
        let at = |column: usize| self.corner([grid.origin_px[0] + column as f64 * grid.step_px, y]);
        if grid.cells[0] < CELLS_ALONE {
            out.clear();
            out.extend((0..=grid.cells[0]).map(at));
        } else {
            (0..grid.cells[0] + 1).into_par_iter().map(at).collect_into_vec(out);
        }
    }

    fn corner(&self, px: [f64; 2]) -> Corner {
        let Some(direction) = self.camera.unproject(px) else { return NOWHERE };
        let apparent = self.icrf_from_sensor.apply(direction);
        let depth = self.disc.body.depth(apparent);
        let Some(point) = self.disc.body.surface(apparent).filter(|_| depth > 0.0) else {
            return Corner { direction, depth, ..NOWHERE };
        };
        let radiance = self.disc.law.radiance(point.normal.dot(self.disc.to_sun), point.towards_observer);
        let is_hidden = self.before.hides(apparent, self.disc.body.centre_km.length());
        Corner { direction, depth, radiance, is_hidden }
    }
}

/// Returns the source of one cell, and the share of it that is not hidden.
fn source(disc: &Disc, grid: &Grid, [column, row]: [usize; 2], corners: &[Corner; 4]) -> (Source, f64) {
    let inside = corners.iter().filter(|corner| corner.depth > 0.0);
    let (count, sum, hidden) = inside.fold((0.0, 0.0, 0.0), |(count, sum, hidden), corner| {
        (count + 1.0, sum + corner.radiance, hidden + f64::from(u8::from(corner.is_hidden)))
    });
    let (share, middle) = part_inside(corners.map(|corner| corner.depth));
    let [a, b, c, d] = corners.map(|corner| corner.direction);
    let solid_angle = 0.5 * (c - a).cross(d - b).length();
    let px = [column, row].map(|cell| cell as f64);
    let place = core::array::from_fn(|i| grid.origin_px[i] + (px[i] + middle[i]) * grid.step_px);
    let electrons = disc.e_per_sr * (sum / count) * solid_angle * share;
    let source = Source { id: disc.id, electrons, mag: disc.mag, place: SourcePlace::Pixel(place) };
    (source, 1.0 - hidden / count)
}

/// Returns the area of the part of a unit square where depths given at its corners (around it, from the origin towards
/// x) are positive, and its centre of gravity: straight lines between the crossings of its sides.
fn part_inside(depths: [f64; 4]) -> (f64, [f64; 2]) {
    const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    if depths.iter().all(|depth| *depth > 0.0) {
        return (1.0, [0.5, 0.5]);
    }
    let mut points = [[0.0; 2]; 8];
    let mut count = 0;
    for i in 0..4 {
        let (next, depth) = ((i + 1) % 4, depths[i]);
        if depth > 0.0 {
            points[count] = CORNERS[i];
            count += 1;
        }
        if (depth > 0.0) != (depths[next] > 0.0) {
            let share = depth / (depth - depths[next]);
            points[count] =
                core::array::from_fn(|axis| CORNERS[i][axis] + share * (CORNERS[next][axis] - CORNERS[i][axis]));
            count += 1;
        }
    }
    let (mut area, mut first) = (0.0, [0.0; 2]);
    for i in 0..count {
        let ([ax, ay], [bx, by]) = (points[i], points[(i + 1) % count]);
        let twice = ax * by - bx * ay;
        area += 0.5 * twice;
        first = [first[0] + twice * (ax + bx) / 6.0, first[1] + twice * (ay + by) / 6.0];
    }
    if area <= 0.0 { (0.0, [0.5, 0.5]) } else { (area, first.map(|v| v / area)) }
}

/// Returns the cells that a body may cover; `None` when it is out of sight.
fn grid(
    body: &Spheroid,
    camera: &CameraGeometry,
    sensor_from_icrf: &Rotation<Sensor, Icrf>,
    margin_px: f64,
) -> Option<Grid> {
    let middle = sensor_from_icrf.apply(body.apparent_centre());
    let radius_rad = body.angular_radius_rad();
    let size_px = [camera.width_px(), camera.height_px()].map(|size| size as f64);
    let field_rad = camera.half_diagonal_rad() + margin_px * camera.ifov_rad()[0].max(camera.ifov_rad()[1]);
    if middle.angle_between(DVec3::Z) > radius_rad + field_rad {
        return None;
    }
    let everything = [[-margin_px; 2], size_px.map(|size| size - 1.0 + margin_px)];
    let limb = limb_px(middle, radius_rad, camera);
    let radius_px = limb.map_or(f64::INFINITY, |[low, high]| 0.5 * (high[0] - low[0]).max(high[1] - low[1]));
    let [low, high] = limb.unwrap_or(everything);
    let is_whole = limb.is_some() && (0..2).all(|i| low[i] >= everything[0][i] && high[i] <= everything[1][i]);
    let low: [f64; 2] = core::array::from_fn(|i| low[i].max(everything[0][i]));
    let high: [f64; 2] = core::array::from_fn(|i| high[i].min(everything[1][i]));
    let sides = [high[0] - low[0], high[1] - low[1]];
    if !(sides[0] > 0.0 && sides[1] > 0.0) {
        return None;
    }
    let step_px = step_px(radius_px, sides[0] * sides[1]);
    // Lines of the grid go between pixels, so that pixels consist of whole cells.
    let origin_px = low.map(|v| ((v + 0.5) / step_px).floor() * step_px - 0.5);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive, bounded by MOST_CELLS")]
    let cells = core::array::from_fn(|i| ((high[i] - origin_px[i]) / step_px).ceil() as usize);
    Some(Grid { origin_px, step_px, cells, is_whole })
}

/// Returns the side of the cells for a disc of this radius, with up to `area_px` on the detector.
fn step_px(radius_px: f64, area_px: f64) -> f64 {
    if area_px > MOST_CELLS {
        return (area_px / MOST_CELLS).sqrt().ceil();
    }
    let fine = if 4.0 * area_px <= FINE_CELLS { 2.0 } else { 1.0 };
    1.0 / (CELLS_PER_RADIUS / radius_px).ceil().max(fine)
}

/// Returns the rectangle that contains a limb, px; `None` when a part of it is not imaged, or it is too wide to be
/// followed by places.
fn limb_px(middle: DVec3, radius_rad: f64, camera: &CameraGeometry) -> Option<[[f64; 2]; 2]> {
    if radius_rad > WIDE_RAD || middle.angle_between(DVec3::Z) + radius_rad > WIDE_RAD {
        return None;
    }
    // The polygon about the places: its corners are farther out; with a margin for flattening and aberration.
    let wide = radius_rad / (PI / f64::from(LIMB_PLACES)).cos() * 1.001;
    let (east, (s, c)) = (middle.any_orthonormal_vector(), wide.sin_cos());
    let north = middle.cross(east);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for place in 0..LIMB_PLACES {
        let (sin, cos) = (TAU * f64::from(place) / f64::from(LIMB_PLACES)).sin_cos();
        let px = camera.project(middle * c + (east * cos + north * sin) * s)?;
        low = core::array::from_fn(|i| low[i].min(px[i]));
        high = core::array::from_fn(|i| high[i].max(px[i]));
    }
    Some([low, high])
}

/// The bodies that may hide sources in one field.
#[derive(Debug, Clone, Copy, Default)]
pub struct Occultation {
    /// The Earth and the Moon, if they reach into the field.
    bodies: [Option<Spheroid>; 2],
}

impl Occultation {
    /// Returns the bodies whose limb comes within `radius_rad` of the boresight.
    pub fn in_field(standpoint: &Standpoint, boresight_icrf: DVec3, radius_rad: f64) -> Self {
        let is_near = |body: &Spheroid| {
            body.apparent_centre().angle_between(boresight_icrf) < body.angular_radius_rad() + radius_rad
        };
        Self { bodies: [standpoint.earth(), standpoint.moon()].map(|body| body.filter(is_near)) }
    }

    /// Returns true when nothing in the field is hidden.
    pub fn is_none(&self) -> bool {
        self.bodies.iter().all(Option::is_none)
    }

    /// Returns true when a body nearer than `range_km` hides this apparent direction (unit).
    pub fn hides(&self, apparent_icrf: DVec3, range_km: f64) -> bool {
        self.bodies.iter().flatten().any(|body| lies_before(body, apparent_icrf, range_km))
    }

    /// Returns the same for the Moon alone.
    pub fn moon_hides(&self, apparent_icrf: DVec3, range_km: f64) -> bool {
        self.bodies[1].is_some_and(|moon| lies_before(&moon, apparent_icrf, range_km))
    }
}

fn lies_before(body: &Spheroid, apparent_icrf: DVec3, range_km: f64) -> bool {
    body.centre_km.length() < range_km && body.hides(apparent_icrf)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::DEG;
    use sky::astrometry::{BrownConrady, CameraParameters};

    const SIGMA_PX: f64 = 0.7;

    fn camera(size: usize, focal_px: f64) -> CameraGeometry {
        let middle = 0.5 * (size as f64 - 1.0);
        CameraGeometry::new(CameraParameters {
            width_px: size,
            height_px: size,
            focal_px: [focal_px; 2],
            principal_point_px: [middle; 2],
            distortion: BrownConrady::default(),
        })
        .expect("a camera")
    }

    /// Returns a full disc of this radius in pixels about the axis, 1 electron per pixel: its sources and their
    /// properties.
    fn full(camera: &CameraGeometry, radius_px: f64) -> (Vec<Source>, Drawn) {
        let focal_px = camera.parameters().focal_px[0];
        let radius_rad = (radius_px / focal_px).atan();
        let disc = Disc {
            body: Spheroid::sphere(DVec3::Z, 1.0, radius_rad.sin()),
            id: 1,
            mag: 0.0,
            to_sun: DVec3::NEG_Z,
            law: Law::LommelSeeliger,
            // Half of it by the law.
            e_per_sr: 2.0 * focal_px * focal_px,
            electrons: None,
        };
        let mut out = Vec::new();
        let drawn = DiscPainter::default()
            .paint(&disc, camera, &Rotation::IDENTITY, &Occultation::default(), &mut out)
            .expect("in the field");
        (out, drawn)
    }

    fn px(source: &Source) -> [f64; 2] {
        match source.place {
            SourcePlace::Pixel(px) => px,
            SourcePlace::Icrf(_) => unreachable!("discs are drawn by pixels"),
        }
    }

    /// Returns the electrons in a pixel by a Gaussian PSF integrated over it.
    fn pixel_e(sources: &[Source], at: [f64; 2], shift: f64) -> f64 {
        let share = |d: f64| {
            let edge = |d: f64| libm::erf(d / (SIGMA_PX * 2_f64.sqrt()));
            0.5 * (edge(d + 0.5) - edge(d - 0.5))
        };
        let of = |source: &Source| {
            let [x, y] = px(source);
            source.electrons * share(at[0] - x - shift) * share(at[1] - y - 0.3 * shift)
        };
        sources.iter().map(of).sum()
    }

    #[test]
    fn a_disc_has_its_area_and_an_even_one_no_ripple() {
        // So far away that the angles of incidence and emergence are equal all over the disc.
        let camera = camera(128, 5_000_000.0);
        for radius_px in [0.3, 1.7, 8.0, 40.0] {
            let (sources, drawn) = full(&camera, radius_px);
            let sum: f64 = sources.iter().map(|source| source.electrons).sum();
            let area = PI * radius_px * radius_px;
            assert!((sum / area - 1.0).abs() < 2e-3, "{radius_px}: {sum} {area}");
            assert!(drawn.step_px <= 0.5 && radius_px / drawn.step_px > 0.98 * CELLS_PER_RADIUS, "{drawn:?}");
            let middle = sources.iter().map(|source| source.electrons * px(source)[0]).sum::<f64>() / sum;
            assert!((middle - 63.5).abs() < 1e-3 * radius_px, "{middle}");
        }
        let (sources, _) = full(&camera, 40.0);
        for (at, shift) in [([63.0, 63.0], 0.0), ([70.0, 55.0], 0.0), ([70.0, 55.0], 0.37)] {
            let level = pixel_e(&sources, at, shift);
            // The Sun is farther away than the observer: the law's value falls by 3e-5 towards the edge.
            assert!((level - 1.0).abs() < 1e-4, "{level}");
            let still = pixel_e(&sources, at, 0.0);
            assert!((level - still).abs() < 1e-6, "flat whatever the shift by motion: {level} {still}");
        }
    }

    #[test]
    fn an_edge_is_right_to_its_bound_and_no_better() {
        let camera = camera(128, 50_000.0);
        let (sources, drawn) = full(&camera, 40.0);
        // The truth along a row through the middle: the edge of so large a disc, nearly straight, through PSF and
        // pixel.
        let fine = {
            let mut fine = Vec::new();
            for (i, j) in (0..1600).flat_map(|i| (0..1600).map(move |j| (i, j))) {
                let [x, y] = [i, j].map(|v| 63.5 - 40.0 + (f64::from(v) + 0.5) / 20.0);
                if x > 95.0 && (y - 64.0).abs() < 6.0 && (x - 63.5).hypot(y - 63.5) < 40.0 {
                    let place = SourcePlace::Pixel([x, y]);
                    fine.push(Source { id: 0, electrons: 1.0 / 400.0, mag: 0.0, place });
                }
            }
            fine
        };
        let off = |x: f64| (pixel_e(&sources, [x, 64.0], 0.0) - pixel_e(&fine, [x, 64.0], 0.0)).abs();
        let worst = (0..8).map(|i| off(100.0 + f64::from(i))).fold(0.0, f64::max);
        let bound = edge_error(drawn.step_px, SIGMA_PX);
        // Tolerance for the grid with steps of 0.05 px, and for the straight lines of the limb.
        assert!(worst < bound + 2e-3, "{worst} {bound}");
        assert!(edge_error(1.0, SIGMA_PX) > 3.9 * bound, "cells of twice the side err four times as much");
    }

    #[test]
    fn cells_beyond_the_most_show_as_ripple_within_its_bound() {
        assert_eq!(step_px(500.0, MOST_CELLS), 1.0);
        assert_eq!(step_px(600.0, MOST_CELLS + 1.0), 2.0);
        assert_eq!((step_px(60.0, FINE_CELLS / 4.0), step_px(60.0, FINE_CELLS / 4.0 + 1.0)), (0.5, 1.0));
        for step in [2.0, 3.0] {
            let lattice: Vec<Source> = (0..20)
                .flat_map(|i| (0..20).map(move |j| [i, j].map(|v| f64::from(v) * step)))
                .map(|place| Source { id: 0, electrons: step * step, mag: 0.0, place: SourcePlace::Pixel(place) })
                .collect();
            let levels = (0..6).flat_map(|i| (0..6).map(move |j| [i, j].map(|v| 20.0 + f64::from(v))));
            let worst = levels.map(|at| (pixel_e(&lattice, at, 0.0) - 1.0).abs()).fold(0.0, f64::max);
            let bound = ripple(step, SIGMA_PX);
            // The bound is that of the first harmonic, valid for steps up to two pixels; beyond, it gives the order of
            // magnitude.
            let most = if step <= 2.0 { 1.001 } else { 2.0 };
            assert!(worst < most * bound && worst > 0.2 * bound, "{step}: {worst} {bound}");
            assert!(worst > 0.05, "control: such cells do show: {worst}");
        }
        assert_eq!(ripple(1.0, SIGMA_PX), 0.0);
    }

    #[test]
    fn integrals_over_the_disc_are_those_of_the_laws() {
        for law in [Law::Lambert, Law::LommelSeeliger] {
            for phase_deg in [0.0, 30.0, 90.0, 150.0] {
                let (s, c) = (phase_deg * DEG).sin_cos();
                let sun = DVec3::new(s, 0.0, c);
                let n = 1_000;
                let mut sum = 0.0;
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let [x, y] = [i, j].map(|v| (f64::from(v) + 0.5) / f64::from(n) * 2.0 - 1.0);
                    let z2 = 1.0 - x * x - y * y;
                    if z2 > 0.0 {
                        sum += law.radiance(DVec3::new(x, y, z2.sqrt()).dot(sun), z2.sqrt());
                    }
                }
                let wanted = sum * 4.0 / f64::from(n * n);
                let got = law.over_disc(phase_deg * DEG);
                assert!((got - wanted).abs() < 1e-3, "{law:?} {phase_deg}: {got} {wanted}");
            }
        }
    }

    #[test]
    fn part_of_a_cell_is_cut_by_a_line() {
        assert_eq!(part_inside([1.0, 1.0, 1.0, 1.0]), (1.0, [0.5, 0.5]));
        let (area, [x, y]) = part_inside([1.0, -1.0, -1.0, 1.0]);
        assert!((area - 0.5).abs() < 1e-15 && (x - 0.25).abs() < 1e-15 && (y - 0.5).abs() < 1e-15, "{area} {x} {y}");
        let (area, [x, y]) = part_inside([1.0, -1.0, -3.0, -1.0]);
        assert!((area - 0.125).abs() < 1e-15 && (x - 1.0 / 6.0).abs() < 1e-15 && (y - x).abs() < 1e-15);
        let (area, _) = part_inside([-1.0, 1.0, 3.0, 1.0]);
        assert!((area - 0.875).abs() < 1e-15, "{area}");
    }
}
