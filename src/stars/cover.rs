//! A cone on the sky -> the HEALPix cells that may reach into it, without allocating; distances as squared chords.
//!
//! From the twelve base cells down: a cell whose bounding circle misses the cone is left with all it holds, one whose
//! circle lies inside is taken with all it holds, any other is looked at by its quarters. What is taken is a superset
//! of the cells that touch the cone, by at most the width of a cell; it holds for any radius. Order: ascending. Tests:
//! `no_cell_is_missed_and_few_are_taken_in_vain`, `every_cell_lies_within_its_circle`.

use base::source::direction_from_ra_dec;
use core::f64::consts::PI;
use glam::DVec3;

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
        let (lon_rad, lat_rad) = crate::healpix::centre(at_order, cell);
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
                let (lon, lat) = crate::healpix::centre(order, crate::healpix::cell(order, ra, dec));
                let off = direction.angle_between(direction_from_ra_dec(lon, lat)) * f64::from(1_u32 << order);
                worst = worst.max(off);
            }
            // The corners themselves, of cells all over.
            let cells = 12_u64 << (2 * order);
            for cell in (0..cells).step_by((cells / 5000).max(1) as usize) {
                let (lon, lat) = crate::healpix::centre(order, cell);
                let centre = direction_from_ra_dec(lon, lat);
                for share in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                    let (ra, dec) = crate::healpix::point(order, cell, share);
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
                    let is_found = found.binary_search(&crate::healpix::cell(order, ra, dec)).is_ok();
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
