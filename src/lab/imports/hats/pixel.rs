//! HEALPix pixels as HATS numbers and files them: nested, `Norder=k/Dir=d/Npix=n`.

use base::source::{direction_from_ra_dec, ra_dec_rad};
use core::f64::consts::{FRAC_PI_2, TAU};
use core::ops::Range;

/// Finest order there is.
pub(super) const MOST_ORDER: u8 = 29;
/// Pixels of a `Dir`.
const DIR_PIXELS: u64 = 10_000;
/// How far beyond the edge of its pixel a row may lie, rad (0.02 mas): other programs round differently.
const EDGE_RAD: f64 = 1e-10;
/// And with places of single precision, rad (0.06 arcsec: half a step of an f32 at 360 deg).
const COARSE_EDGE_RAD: f64 = 2.8e-7;

/// A pixel of the sphere.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pixel {
    /// HEALPix order.
    pub order: u8,
    /// Number at that order, nested.
    pub number: u64,
}

impl Pixel {
    /// Returns a pixel that there is.
    pub fn new(order: u64, number: u64) -> Option<Self> {
        let order = u8::try_from(order).ok().filter(|order| *order <= MOST_ORDER)?;
        (number < 12 << (2 * order)).then_some(Self { order, number })
    }

    /// Returns the pixel of a place; `None` when the angles are out of range or not finite.
    pub(super) fn of(order: u8, ra_rad: f64, dec_rad: f64) -> Option<Self> {
        let is_place = (0.0..=TAU).contains(&ra_rad) && (-FRAC_PI_2..=FRAC_PI_2).contains(&dec_rad);
        is_place.then(|| Self { order, number: stars::healpix::cell(order, ra_rad, dec_rad) })
    }

    /// Returns its first number at the finest order, and the first beyond.
    pub(super) fn finest(self) -> Range<u64> {
        let within = 2 * (MOST_ORDER - self.order);
        self.number << within..(self.number + 1) << within
    }

    /// Returns its numbers at a finer order.
    pub(super) fn at(self, order: u8) -> Range<u64> {
        let within = 2 * (order - self.order);
        self.number << within..(self.number + 1) << within
    }

    /// Returns its four parts.
    pub(super) fn parts(self) -> [Self; 4] {
        core::array::from_fn(|part| Self { order: self.order + 1, number: 4 * self.number + part as u64 })
    }

    /// Returns the folders of its partition within `dataset`.
    pub(super) fn folder(self) -> String {
        format!("Norder={}/Dir={}", self.order, self.number / DIR_PIXELS * DIR_PIXELS)
    }

    /// Returns whether a place lies in it, or so little beyond its edge that another program may have rounded it there.
    pub(super) fn has(self, ra_rad: f64, dec_rad: f64, is_coarse: bool) -> bool {
        let edge_rad = if is_coarse { COARSE_EDGE_RAD } else { EDGE_RAD };
        if Self::of(self.order, ra_rad, dec_rad) == Some(self) {
            return true;
        }
        let direction = direction_from_ra_dec(ra_rad, dec_rad);
        let east = direction_from_ra_dec(ra_rad + FRAC_PI_2, 0.0);
        let north = direction.cross(east);
        let is_in = |eastward: f64, northward: f64| {
            let [ra_rad, dec_rad] = ra_dec_rad(direction + edge_rad * (eastward * east + northward * north));
            Self::of(self.order, ra_rad, dec_rad) == Some(self)
        };
        let steps = [-1.0, 0.0, 1.0];
        steps.iter().any(|eastward| steps.iter().any(|northward| is_in(*eastward, *northward)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_that_there_are() {
        assert_eq!(Pixel::new(0, 11), Some(Pixel { order: 0, number: 11 }));
        assert_eq!((Pixel::new(0, 12), Pixel::new(30, 0), Pixel::new(29, 12 << 58)), (None, None, None));
        assert!(Pixel::new(29, (12 << 58) - 1).is_some());
        assert_eq!(Pixel { order: 8, number: 123_456 }.folder(), "Norder=8/Dir=120000");
        let pixel = Pixel { order: 2, number: 7 };
        assert_eq!(pixel.parts().map(|part| part.at(4).start), [112, 116, 120, 124]);
        assert_eq!((pixel.at(4), pixel.parts()[3].finest().end), (112..128, pixel.finest().end));
    }

    #[test]
    fn places_beyond_an_edge_by_rounding_are_within() {
        // Order 0 meets at RA 0 on the equator: pixels 0 and 3 to the north, 4 astride.
        let pixel = Pixel { order: 0, number: 4 };
        let at_edge = |off_rad: f64| {
            // The edge of pixel 4 towards pixel 0 runs from RA 0 Dec asin(2/3) to RA 45 Dec 0.
            let (mut inside, mut outside) = (0.3_f64, 0.6_f64);
            for _ in 0..60 {
                let middle = 0.5 * (inside + outside);
                if Pixel::of(0, middle, 0.3) == Some(pixel) { inside = middle } else { outside = middle }
            }
            (inside + off_rad / 0.3_f64.cos(), 0.3)
        };
        for (off_rad, is_coarse, wanted) in [
            (-1e-9, false, true),
            (0.5e-10, false, true),
            (3e-10, false, false),
            (1e-7, true, true),
            (9e-7, true, false),
        ] {
            let (ra, dec) = at_edge(off_rad);
            assert_eq!(pixel.has(ra, dec, is_coarse), wanted, "{off_rad} {is_coarse}");
        }
        assert!(Pixel { order: 29, number: 0 }.has(core::f64::consts::FRAC_PI_4, 0.0, false), "at a corner");
        assert_eq!(Pixel::of(3, 7.0, 0.0), None);
        assert_eq!(Pixel::of(3, 1.0, 1.6), None);
        let pole = Pixel::of(5, 1.0, FRAC_PI_2).unwrap();
        assert!(pole.has(4.0, FRAC_PI_2, false), "all right ascensions are one place at a pole");
    }
}
