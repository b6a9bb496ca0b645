//! HEALPix in the nested numbering: a direction -> its cell; a cell -> its points and its neighbours.
//!
//! Gorski et al. 2005, ApJ 622, 759; Calabretta & Roukema 2007, MNRAS 381, 865. The sphere is projected to a plane, x 0
//! to 8 eastward (pi/4 of longitude each), y -2 to 2 northward, where the twelve base cells are squares on a corner. A
//! base cell of order k has 2^k by 2^k cells: i counts from its southern corner towards the eastern one, j towards the
//! western one, and a cell's number is that of its base cell and, below, the bits of i and j in turn.
//!
//! The order of the arithmetic is that of the crate cdshealpix 0.10 (CDS Strasbourg; Apache-2.0 or MIT): files of
//! layers and of made-up stars depend on its last bits. Nothing allocates. Tests:
//! `cells_and_points_are_those_of_other_programs`, `points_of_a_cell_lie_in_it`, `neighbours_share_a_corner`.
//!
//! *Cones.* A cone on the sky -> the HEALPix cells that may reach into it, without allocating; distances as squared
//! chords.
//!
//! From the twelve base cells down: a cell whose bounding circle misses the cone is left with all it holds, one whose
//! circle lies inside is taken with all it holds, any other is looked at by its quarters. The cells taken are a superset
//! of the cells that touch the cone, by at most the width of a cell; it holds for any radius. Order: ascending. Tests:
//! `no_cell_is_missed_and_few_are_taken_in_vain`, `every_cell_lies_within_its_circle`.

use base::source::direction_from_ra_dec;
use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use glam::DVec3;

/// Finest order: a cell's number has 62 bits.
pub const MOST_ORDER: u8 = 29;
/// Up to this latitude, asin(2/3), the projection is the cylindrical one, rad.
const TRANSITION_RAD: f64 = 0.729_727_656_226_966_3;
const SQRT_6: f64 = 2.449_489_742_783_178;
/// Its own constant: 1 / `SQRT_6` rounds to another last bit.
const ONE_OVER_SQRT_6: f64 = 0.408_248_290_463_863;
const FOUR_OVER_PI: f64 = 4.0 / PI;
/// Nearer to a pole than this in y the longitude has no meaning.
const POLE: f64 = 1e-13;

/// Returns the cell of `order` (0 to 29) in which a direction lies; the latitude is within -pi/2 to pi/2.
pub fn cell(order: u8, lon_rad: f64, lat_rad: f64) -> u64 {
    let (base, x, y) = in_base_cell(lon_rad, lat_rad);
    let side = 1_u32 << order;
    let along = |halves: f64| ((0.5 * f64::from(side) * halves) as u32).min(side - 1);
    number(order, base, along(y + x), along(y - x))
}

/// Returns longitude and latitude of a cell's centre, rad.
pub fn centre(order: u8, cell: u64) -> (f64, f64) {
    point(order, cell, [0.5, 0.5])
}

/// Returns longitude and latitude of a point of a cell, rad: shares (0 to 1) of the ways from its southern corner to the
/// eastern and to the western one.
pub fn point(order: u8, cell: u64, [east, west]: [f64; 2]) -> (f64, f64) {
    let (base, i, j) = parts(order, cell);
    let (i, j, side) = (f64::from(i), f64::from(j), f64::from(1_u32 << order));
    let step = 1.0 / side;
    // The base cells' centres: those about the poles at odd x, those about the equator at even ones.
    let row = 1.0 - (base / 4) as f64;
    let x = 2.0 * (base % 4) as f64 + row.abs() + (i - j) * step;
    let y = row + (i + j - (side - 1.0)) * step;
    let wrapped = |x: f64| if x < 0.0 { x + 8.0 } else { x };
    unprojected(wrapped(wrapped(x) + (east - west) * step), y + (east + west - 1.0) * step)
}

/// Returns a cell and the cells that touch it: eight, or seven at a corner where three base cells meet, six at order 0.
pub fn with_neighbours(order: u8, cell: u64) -> impl Iterator<Item = u64> {
    let (base, i, j) = parts(order, cell);
    let (i, j) = (i64::from(i), i64::from(j));
    let steps = [(0, 0), (-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
    steps.into_iter().filter_map(move |(di, dj)| {
        let (base, i, j) = beyond(1 << order, base, i + di, j + dj)?;
        Some(number(order, base, u32::try_from(i).ok()?, u32::try_from(j).ok()?))
    })
}

/// Returns the base cell of a direction and where it lies in it, from the southern corner: x from -1 to 1, y from 0 to 2.
fn in_base_cell(lon_rad: f64, lat_rad: f64) -> (u64, f64, f64) {
    let (quarter, x) = quarter(lon_rad);
    if lat_rad > TRANSITION_RAD {
        let from_pole = SQRT_6 * (0.5 * lat_rad + FRAC_PI_4).cos();
        return (quarter, x * from_pole, 2.0 - from_pole);
    }
    if lat_rad < -TRANSITION_RAD {
        let from_pole = SQRT_6 * (0.5 * lat_rad - FRAC_PI_4).cos();
        return (quarter + 8, x * from_pole, from_pole);
    }
    let y = 1.5 * lat_rad.sin();
    match (x > y, x >= -y) {
        (false, true) => (quarter, x, y),
        (false, false) => (quarter + 4, x + 1.0, y + 1.0),
        (true, true) => ((quarter + 1) % 4 + 4, x - 1.0, y + 1.0),
        (true, false) => (quarter + 8, x, y + 2.0),
    }
}

/// Returns which quarter of the longitudes one is in, and where from its middle, -1 to 1.
fn quarter(lon_rad: f64) -> (u64, f64) {
    let x = lon_rad.abs() * FOUR_OVER_PI;
    let middle = x as u8 | 1;
    let quarter = u64::from(middle % 8 / 2);
    if lon_rad.is_sign_negative() { (3 - quarter, f64::from(middle) - x) } else { (quarter, x - f64::from(middle)) }
}

/// Returns longitude and latitude of a point of the plane, rad.
fn unprojected(x: f64, y: f64) -> (f64, f64) {
    let middle = x as u8 | 1;
    let mut off_middle = x - f64::from(middle);
    let lat_rad = if y.abs() <= 1.0 {
        (y.abs() * (2.0 / 3.0)).asin()
    } else {
        let from_pole = 2.0 - y.abs();
        if from_pole > POLE {
            off_middle = (off_middle / from_pole).clamp(-1.0, 1.0);
        }
        2.0 * (from_pole * ONE_OVER_SQRT_6).acos() - FRAC_PI_2
    };
    ((off_middle + f64::from(middle % 8)) * FRAC_PI_4, lat_rad.copysign(y))
}

/// Returns base cell and places of a cell that may lie one step beyond its base cell; `None` where no base cell is.
fn beyond(side: i64, base: u64, i: i64, j: i64) -> Option<(u64, i64, i64)> {
    let over = |at: i64| (at >= side) as i8 - (at < 0) as i8;
    let (last, column) = (2 * side - 1, base % 4);
    let (same, next, opposite, before) = (column, (column + 1) % 4, (column + 2) % 4, (column + 3) % 4);
    Some(match (base / 4, over(i), over(j)) {
        (_, 0, 0) => (base, i, j),
        (0, -1, -1) => (same + 8, i + side, j + side),
        (0, 0, -1) => (next + 4, i, j + side),
        (0, -1, 0) => (same + 4, i + side, j),
        (0, 1, 0) => (next, j, last - i),
        (0, 0, 1) => (before, last - j, i),
        (0, 1, 1) => (opposite, last - i, last - j),
        (1, 0, -1) => (same + 8, i, j + side),
        (1, 1, -1) => (next + 4, i - side, j + side),
        (1, -1, 0) => (before + 8, i + side, j),
        (1, 1, 0) => (same, i - side, j),
        (1, -1, 1) => (before + 4, i + side, j - side),
        (1, 0, 1) => (before, i, j - side),
        (2, -1, -1) => (opposite + 8, -1 - i, -1 - j),
        (2, 0, -1) => (next + 8, -1 - j, i),
        (2, -1, 0) => (before + 8, j, -1 - i),
        (2, 1, 0) => (next + 4, i - side, j),
        (2, 0, 1) => (same + 4, i, j - side),
        (2, 1, 1) => (same, i - side, j - side),
        _ => return None,
    })
}

fn number(order: u8, base: u64, i: u32, j: u32) -> u64 {
    base << (2 * order) | spread(i) | spread(j) << 1
}

/// Returns the base cell of a cell, and its places in it.
fn parts(order: u8, cell: u64) -> (u64, u32, u32) {
    let within = cell & ((1 << (2 * order)) - 1);
    (cell >> (2 * order), gathered(within), gathered(within >> 1))
}

/// Returns a number with its bits at the even places.
fn spread(bits: u32) -> u64 {
    let mut bits = u64::from(bits);
    for (shift, mask) in [
        (16, 0x0000_FFFF_0000_FFFF),
        (8, 0x00FF_00FF_00FF_00FF),
        (4, 0x0F0F_0F0F_0F0F_0F0F),
        (2, 0x3333_3333_3333_3333),
        (1, 0x5555_5555_5555_5555),
    ] {
        bits = (bits | bits << shift) & mask;
    }
    bits
}

/// Returns the bits at the even places.
fn gathered(bits: u64) -> u32 {
    let mut bits = bits & 0x5555_5555_5555_5555;
    for (shift, mask) in [
        (1, 0x3333_3333_3333_3333),
        (2, 0x0F0F_0F0F_0F0F_0F0F),
        (4, 0x00FF_00FF_00FF_00FF),
        (8, 0x0000_FFFF_0000_FFFF),
        (16, 0x0000_0000_FFFF_FFFF),
    ] {
        bits = (bits | bits >> shift) & mask;
    }
    bits as u32
}

/// Returns the squared chord of an angle on the unit sphere, exact for angles of milliarcseconds; more than any chord
/// from pi on.
pub fn chord_squared(angle_rad: f64) -> f64 {
    if angle_rad >= PI { f64::INFINITY } else { 4.0 * (angle_rad / 2.0).sin().powi(2) }
}

/// No point of a cell is further from its centre than this over the cells along a side of a base cell, rad: measured
/// 1.068 at fine orders, less at coarse ones.
pub const CIRCLE: f64 = 1.08;
/// Cells that may wait: three quarters at each order, and the base cells.
const WAITING: usize = 12 + 3 * 30;

/// Calls `take` with every cell of `order` that may have a point within `radius_rad` of `axis` (a unit vector). A
/// radius that is not a number or negative gives none.
pub(crate) fn cells_of_cone(order: u8, axis: DVec3, radius_rad: f64, mut take: impl FnMut(u64)) {
    if radius_rad.is_nan() || radius_rad < 0.0 {
        return;
    }
    let mut waiting = [(0_u8, 0_u64); WAITING];
    let mut count = 12;
    for (place, cell) in waiting.iter_mut().zip((0..12).rev()) {
        *place = (0, cell);
    }
    while count > 0 {
        count -= 1;
        let (at_order, cell) = waiting[count];
        let reach_rad = CIRCLE / f64::from(1_u32 << at_order);
        let (lon_rad, lat_rad) = centre(at_order, cell);
        let off_rad = axis.angle_between(direction_from_ra_dec(lon_rad, lat_rad));
        if off_rad > radius_rad + reach_rad {
            continue;
        }
        if at_order == order || off_rad + reach_rad <= radius_rad.min(PI) || radius_rad >= PI {
            let inside = 2 * (order - at_order);
            (cell << inside..(cell + 1) << inside).for_each(&mut take);
            continue;
        }
        for quarter in (0..4).rev() {
            waiting[count] = (at_order + 1, 4 * cell + quarter);
            count += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::{source::direction_from_ra_dec, units::DEG};
    use core::f64::consts::TAU;

    /// Points of the sphere, seeded, with the cells of two other programs: the file's head says how they were made.
    const VECTORS: &str = include_str!("healpix_vectors.csv");
    /// Two last bits of a longitude: sines of other mathematical libraries differ by that.
    const ROUNDING_RAD: f64 = 2e-15;

    #[test]
    fn cells_and_points_are_those_of_other_programs() {
        let rows = VECTORS.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit()));
        let mut compared = 0;
        for row in rows {
            let columns: Vec<&str> = row.split(',').collect();
            let order: u8 = columns[0].parse().unwrap();
            let [lon, lat, lon_of_centre, lat_of_centre] =
                [1, 2, 4, 5].map(|at: usize| columns[at].parse::<f64>().unwrap());
            let wanted: u64 = columns[3].parse().unwrap();
            assert_eq!(cell(order, lon, lat), wanted, "{row}");
            let (got_lon, got_lat) = centre(order, wanted);
            assert!((got_lon - lon_of_centre).abs() < ROUNDING_RAD, "{row}: {got_lon}");
            assert!((got_lat - lat_of_centre).abs() < ROUNDING_RAD, "{row}: {got_lat}");
            let mut around: Vec<u64> = with_neighbours(order, wanted).collect();
            around.sort_unstable();
            let wanted: Vec<u64> = columns[6].split(' ').map(|cell| cell.parse().unwrap()).collect();
            assert_eq!(around, wanted, "{row}");
            compared += 1;
        }
        assert_eq!(compared, 224);
    }

    /// A source's number in Gaia's archive, from bit 35 on, is its cell of order 12: Proxima Centauri, Sirius B.
    #[test]
    fn sources_of_gaia_lie_in_the_cells_of_their_numbers() {
        for (source_id, ra_deg, dec_deg) in [
            (5_853_498_713_190_525_696_u64, 217.392_321_472, -62.676_075_117),
            (2_947_050_466_531_873_024, 101.286_626_552, -16.720_932_805),
        ] {
            assert_eq!(cell(12, ra_deg * DEG, dec_deg * DEG), source_id >> 35);
        }
    }

    /// All cells of coarse orders, and some of every order: first, last, at random.
    fn cells() -> impl Iterator<Item = (u8, u64)> {
        (0..=MOST_ORDER).flat_map(|order| {
            let count = 12_u64 << (2 * order);
            let step = (count / 4096).max(1) | 1;
            (0..count).step_by(usize::try_from(step).unwrap()).chain([count - 1]).map(move |cell| (order, cell))
        })
    }

    #[test]
    fn points_of_a_cell_lie_in_it() {
        for (order, number) in cells() {
            for share in [[0.5, 0.5], [0.01, 0.01], [0.99, 0.01], [0.01, 0.99], [0.99, 0.99], [0.3, 0.8]] {
                let (lon, lat) = point(order, number, share);
                assert!((0.0..=TAU).contains(&lon) && lat.abs() <= FRAC_PI_2, "{order} {number}: {lon} {lat}");
                // At order 29 a cell is 2e-9 rad wide; a hundredth of that is still above the rounding of an angle, but
                // about the poles, where longitudes crowd.
                if order < 26 || lat.abs() < 1.5 {
                    assert_eq!(cell(order, lon, lat), number, "order {order}, {share:?}");
                }
            }
        }
    }

    #[test]
    fn neighbours_share_a_corner() {
        let corners = |order: u8, cell: u64| {
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|share| {
                let (lon, lat) = point(order, cell, share);
                direction_from_ra_dec(lon, lat)
            })
        };
        for (order, number) in cells().filter(|(order, _)| *order <= 12) {
            let own = corners(order, number);
            let mut around: Vec<u64> = with_neighbours(order, number).collect();
            assert_eq!(around[0], number);
            let near = 0.01 / f64::from(1_u32 << order);
            for other in &around[1..] {
                let theirs = corners(order, *other);
                let touches = own.iter().any(|a| theirs.iter().any(|b| a.distance(*b) < near));
                assert!(touches, "order {order}: {number} and {other}");
                assert!(
                    with_neighbours(order, *other).any(|back| back == number),
                    "{other} has {number} beside it, too"
                );
            }
            around.sort_unstable();
            around.dedup();
            assert!((7..=9).contains(&around.len()), "order {order}, {number}: {around:?}");
        }
    }

    #[test]
    fn places_beyond_the_domain_give_a_cell_and_no_panic() {
        for (lon, lat) in [(f64::NAN, 0.0), (0.0, f64::NAN), (f64::INFINITY, 1.0), (1e300, -9.0), (-1e300, 9.0)] {
            assert!(cell(8, lon, lat) < 12 << 16, "{lon} {lat}");
        }
        assert_eq!((cell(0, 0.0, 0.0), cell(0, -0.0, 0.0), cell(29, TAU, FRAC_PI_2)), (4, 4, (1 << 58) - 1));
    }
}

#[cfg(test)]
mod cover_tests {
    use super::*;
    use base::{source::ra_dec_rad, units::DEG};

    /// Returns a spiral over the sphere.
    fn directions(count: u32) -> impl Iterator<Item = DVec3> {
        let golden = PI * (3.0 - 5.0_f64.sqrt());
        (0..count).map(move |i| {
            let z = 1.0 - (f64::from(i) + 0.5) * 2.0 / f64::from(count);
            direction_from_ra_dec(golden * f64::from(i), z.asin())
        })
    }

    fn cells(order: u8, axis: DVec3, radius_rad: f64) -> Vec<u64> {
        let mut cells = Vec::new();
        cells_of_cone(order, axis, radius_rad, |cell| cells.push(cell));
        cells
    }

    #[test]
    fn every_cell_lies_within_its_circle() {
        let mut worst = 0.0_f64;
        for order in 0..=10 {
            for direction in directions(200_000) {
                let [ra, dec] = ra_dec_rad(direction);
                let (lon, lat) = centre(order, cell(order, ra, dec));
                let off = direction.angle_between(direction_from_ra_dec(lon, lat)) * f64::from(1_u32 << order);
                worst = worst.max(off);
            }
            // The corners themselves, of cells all over.
            let cells = 12_u64 << (2 * order);
            for cell in (0..cells).step_by((cells / 5000).max(1) as usize) {
                let (lon, lat) = centre(order, cell);
                let centre = direction_from_ra_dec(lon, lat);
                for share in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                    let (ra, dec) = point(order, cell, share);
                    let off = direction_from_ra_dec(ra, dec).angle_between(centre) * f64::from(1_u32 << order);
                    worst = worst.max(off);
                }
            }
        }
        println!("furthest point of a cell: {worst:.4}");
        assert!(worst < CIRCLE, "{worst}");
        assert!(worst > 0.95 * CIRCLE, "control: no larger than it must be: {worst}");
    }

    #[test]
    fn no_cell_is_missed_and_few_are_taken_in_vain() {
        for (order, radius_deg) in
            [(0, 5.0), (3, 0.0), (4, 0.1), (5, 10.0), (6, 20.0), (5, 89.9), (4, 150.0), (4, 179.0)]
        {
            for axis in directions(7).chain([DVec3::Z, DVec3::NEG_Z, DVec3::X]) {
                let radius_rad = radius_deg * DEG;
                let found = cells(order, axis, radius_rad);
                assert!(found.is_sorted_by(|a, b| a < b), "ascending, each once");
                let reach_rad = 2.0 * CIRCLE / f64::from(1_u32 << order);
                for direction in directions(30_000) {
                    let [ra, dec] = ra_dec_rad(direction);
                    let is_found = found.binary_search(&cell(order, ra, dec)).is_ok();
                    let off_rad = direction.angle_between(axis);
                    assert!(is_found || off_rad > radius_rad, "order {order}, {radius_deg} deg: missed at {off_rad}");
                    assert!(!is_found || off_rad <= radius_rad + reach_rad, "taken in vain at {off_rad}");
                }
            }
        }
    }

    #[test]
    fn the_ends_of_the_domain() {
        assert!(cells(3, DVec3::X, f64::NAN).is_empty() && cells(3, DVec3::X, -1e-9).is_empty());
        assert_eq!(cells(3, DVec3::X, PI).len(), 768, "the whole sky");
        assert_eq!(cells(3, DVec3::X, f64::INFINITY).len(), 768);
        assert!(!cells(10, DVec3::new(0.6, 0.64, 0.48), 0.0).is_empty(), "a direction lies in a cell");
    }
}
