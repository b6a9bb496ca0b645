//! Tiles of a field -> the sources of its stars, on all cores, in the tiles' order for any number of threads.
//!
//! Two passes, each over the blocks in parallel: selection of the stars, then their sources. Blocks write where those
//! before them end, so nothing is moved afterwards; buffers are reused. Test: `order_and_choice_are_those_of_a_loop`.
//!
//! *Bounds.* A camera -> whether a direction may leave light on its detector: two bounds on its tangents in sensor
//! axes.
//!
//! A cone about a square field has half as many stars again as the field. In: a margin for changes of a star's place
//! between the catalog and the detector. Out: for one attitude, a test of three products. Valid for fields of less than
//! a hemisphere whose whole border is imaged; for others nothing is left out. Test: `no_star_of_the_field_is_left_out`.

use base::axes::{Icrf, Rotation, Sensor};
use core::ops::Range;
use glam::DVec3;
use plan::exposure::{Source, SourcePlace};
use sky::astrometry::CameraGeometry;

/// Initial capacity for blocks of a field.
const BLOCKS_RESERVED: usize = 16_384;
/// Number of stars below which one thread handles them.
const FEW: usize = 4096;
/// Placeholder that is overwritten.
const NO_SOURCE: Source = Source { id: 0, electrons: 0.0, mag: 0.0, place: SourcePlace::Icrf(DVec3::Z) };

/// Buffers kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct FieldStars {
    /// Start of the stars of each block, and the end of the last block.
    first: Vec<usize>,
    /// The same for the selected ones.
    first_wanted: Vec<usize>,
    /// Indices of the selected stars in their block, at the front of the block's part.
    wanted: Vec<u32>,
}

impl FieldStars {
    /// Returns buffers with capacity for this many stars.
    pub(super) fn with_capacity(stars: usize) -> Self {
        let blocks = || Vec::with_capacity(BLOCKS_RESERVED);
        Self { first: blocks(), first_wanted: blocks(), wanted: Vec::with_capacity(stars) }
    }

    /// Replaces `sources` by the results of `seen` for the selected stars of `blocks`.
    pub(super) fn take<'a, T: Sync + 'a>(
        &mut self,
        block: impl Fn(usize) -> &'a [T] + Sync,
        blocks: usize,
        is_wanted: impl Fn(&T) -> bool + Sync,
        seen: impl Fn(&T) -> Source + Sync,
        sources: &mut Vec<Source>,
    ) {
        let Self { first, first_wanted, wanted } = self;
        first.clear();
        first.push(0);
        for number in 0..blocks {
            first.push(first[number] + block(number).len());
        }
        wanted.resize(first[blocks], 0);
        first_wanted.clear();
        first_wanted.resize(blocks + 1, 0);
        let find = |number: usize, wanted: &mut [u32], count: &mut [usize]| {
            let mut found = 0;
            for (i, star) in (0..).zip(block(number)) {
                wanted[found] = i;
                found += usize::from(is_wanted(star));
            }
            count[0] = found;
        };
        side_by_side(0..blocks, first, wanted, &mut first_wanted[1..], &find);
        for number in 0..blocks {
            first_wanted[number + 1] += first_wanted[number];
        }
        sources.resize(first_wanted[blocks], NO_SOURCE);
        let see = |number: usize, sources: &mut [Source], _: &mut [()]| {
            let stars = block(number);
            for (source, star) in sources.iter_mut().zip(&wanted[first[number]..]) {
                *source = seen(&stars[*star as usize]);
            }
        };
        side_by_side(0..blocks, first_wanted, sources, &mut [(); 0], &see);
    }
}

/// Calls `work` on every block with its part of `parts`, which starts at `first`, and its element of `each`, if there
/// are any.
fn side_by_side<T: Send, E: Send>(
    blocks: Range<usize>,
    first: &[usize],
    parts: &mut [T],
    each: &mut [E],
    work: &(impl Fn(usize, &mut [T], &mut [E]) + Sync),
) {
    let middle = blocks.start + blocks.len() / 2;
    let (parts_before, parts_after) = parts.split_at_mut(first[middle] - first[blocks.start]);
    let (each_before, each_after) = each.split_at_mut((middle - blocks.start).min(each.len()));
    match blocks.len() {
        0 => {}
        1 => work(blocks.start, parts_after, each_after),
        _ => {
            let (before, after) = (blocks.start..middle, middle..blocks.end);
            let few = first[blocks.end] - first[blocks.start] < FEW;
            let front = || side_by_side(before, first, parts_before, each_before, work);
            let back = || side_by_side(after, first, parts_after, each_after, work);
            if few {
                (front)();
                (back)();
            } else {
                rayon::join(front, back);
            }
        }
    }
}

/// Number of points of each side of the border at which the lens is evaluated.
const POINTS: u32 = 64;
/// Largest bulge of the border between two of them, as a share of the tangent.
const BULGE: f64 = 0.01;

/// The largest tangents of a field, x and y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FieldBounds {
    tangent: Option<[f64; 2]>,
}

/// The bounds for one attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Field {
    axes_icrf: [DVec3; 3],
    tangent: [f64; 2],
}

impl FieldBounds {
    pub(super) fn new(camera: &CameraGeometry) -> Self {
        let [width, height] = [camera.width_px() as f64, camera.height_px() as f64];
        let along = |size: f64, i: u32| f64::from(i) / f64::from(POINTS) * size - 0.5;
        let border = (0..=POINTS).flat_map(|i| {
            let (x, y) = (along(width, i), along(height, i));
            [[x, -0.5], [x, height - 0.5], [-0.5, y], [width - 0.5, y]]
        });
        let largest = border.map(|px| camera.tangent_of_pixel(px)).try_fold([0.0_f64; 2], |[x, y], tangent| {
            tangent.map(|tangent| [x.max(tangent.x.abs()), y.max(tangent.y.abs())])
        });
        Self { tangent: largest.map(|largest| largest.map(|tangent| tangent * (1.0 + BULGE))) }
    }

    /// Returns the bounds for a camera with this attitude, and directions known to `margin_rad`. `None`: nothing may be
    /// left out.
    pub(super) fn at(&self, sensor_from_icrf: &Rotation<Sensor, Icrf>, margin_rad: f64) -> Option<Field> {
        let icrf_from_sensor = sensor_from_icrf.inverse();
        let axes_icrf = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| icrf_from_sensor.apply(axis));
        // In a corner a turn by the margin is larger than that about one axis, like a step in longitude far from the
        // equator.
        let [x, y] = self.tangent?;
        let wider = [x, y].map(|tangent| tangent.atan() + margin_rad * (1.0 + x.max(y)));
        let is_bounded = wider.iter().all(|angle| *angle < 1.4);
        is_bounded.then(|| Field { axes_icrf, tangent: wider.map(f64::tan) })
    }
}

impl Field {
    /// Returns false only for a direction outside by more than the margin.
    pub(super) fn may_have(&self, direction_icrf: DVec3) -> bool {
        let [x, y, z] = self.axes_icrf.map(|axis| axis.dot(direction_icrf));
        x.abs() <= z * self.tangent[0] && y.abs() <= z * self.tangent[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_and_choice_are_those_of_a_loop() {
        let lengths = [3_u32, 0, 5000, 1, 0, 12_000, 7, 0];
        let stars: Vec<Vec<u32>> = lengths.iter().map(|n| (0..*n).map(|i| i * 7 + n).collect()).collect();
        let seen = |star: &u32| Source { id: *star, ..NO_SOURCE };
        let mut field = FieldStars::with_capacity(10);
        let mut sources = vec![NO_SOURCE; 5];
        for (blocks, divisor) in [(8, 3), (8, 1), (0, 3), (1, 2), (3, 5), (8, 100_000)] {
            let is_wanted = |star: &u32| star.is_multiple_of(divisor);
            field.take(|block| stars[block].as_slice(), blocks, is_wanted, seen, &mut sources);
            let wanted: Vec<u32> = stars[..blocks].iter().flatten().copied().filter(is_wanted).collect();
            let got: Vec<u32> = sources.iter().map(|source| source.id).collect();
            assert_eq!(got, wanted, "{blocks} blocks, every {divisor}th");
            assert!(divisor != 3 || blocks == 0 || got.len() > 1000, "control: there are some");
        }
    }
}

#[cfg(test)]
mod field_bounds_tests {
    use super::*;
    use base::axes::sensor_from_ra_dec_roll;
    use glam::DQuat;
    use sky::astrometry::{BrownConrady, CameraParameters};

    #[test]
    fn no_star_of_the_field_is_left_out() {
        for (focal_px, k1) in [(500.0, 0.0), (2900.0, -0.2), (2900.0, 0.05), (20_000.0, 0.0)] {
            let camera = CameraGeometry::new(CameraParameters {
                width_px: 1024,
                height_px: 700,
                focal_px: [focal_px; 2],
                principal_point_px: [480.0, 360.0],
                distortion: BrownConrady { k1, ..BrownConrady::default() },
            })
            .unwrap();
            let attitude = sensor_from_ra_dec_roll(4.6, -0.5, 0.3);
            let margin_rad = 1e-3;
            let field = FieldBounds::new(&camera).at(&attitude, margin_rad).unwrap();
            let (mut inside, mut outside) = (0, 0);
            for i in 0..200_000_u32 {
                let px = [f64::from(i % 447) * 5.0 - 600.0, f64::from(i / 447) * 5.0 - 700.0];
                let Some(tangent) = camera.tangent_of_pixel(px) else { continue };
                let direction = attitude.inverse().apply(tangent.extend(1.0).normalize());
                // Moved outwards by the full margin, away from the middle of the field.
                let boresight = attitude.inverse().apply(DVec3::Z);
                let about = boresight.cross(direction).normalize_or(DVec3::X);
                let pushed = DQuat::from_axis_angle(about, margin_rad) * direction;
                let is_on = (-0.5..1023.5).contains(&px[0]) && (-0.5..699.5).contains(&px[1]);
                assert!(!is_on || field.may_have(pushed), "{px:?} at {focal_px} px");
                inside += u32::from(is_on);
                outside += u32::from(!is_on && !field.may_have(direction));
            }
            assert!(inside > 10_000 && outside > 10_000, "control: {inside} in, {outside} left out");
        }
    }

    #[test]
    fn nothing_behind_the_camera_is_in_the_field() {
        let parameters = CameraParameters {
            width_px: 100,
            height_px: 100,
            focal_px: [60.0; 2],
            principal_point_px: [49.5; 2],
            distortion: BrownConrady::default(),
        };
        let bounds = FieldBounds::new(&CameraGeometry::new(parameters).unwrap());
        let field = bounds.at(&Rotation::IDENTITY, 0.0).unwrap();
        assert!(field.may_have(DVec3::Z) && !field.may_have(DVec3::NEG_Z) && !field.may_have(DVec3::X));
        assert_eq!(bounds.at(&Rotation::IDENTITY, 0.6), None, "a margin beyond a hemisphere bounds nothing");
    }
}
