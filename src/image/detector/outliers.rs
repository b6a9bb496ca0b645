//! Pixels that differ from their neighbours in one frame: in the camera's defects and the tracks of protons; out a
//! short sorted list that every backend reads.
//!
//! The list is made once per frame on the host and read by the pixel-local stages of both backends, at the places the
//! order of light gives: `response` with the photo response, `dark_e` with the dark signal (so it has shot noise),
//! `charge_e` after the shot noise. An empty list costs one comparison per block of pixels. Limits: as many pixels as
//! the list was made for; outliers that do not fit are counted by the caller.

use bytemuck::{Pod, Zeroable};

/// The differences of one pixel in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Outlier {
    /// Row-major index of the pixel.
    pub pixel: u32,
    /// Share of the light that it counts.
    pub response: f32,
    /// Mean electrons more.
    pub dark_e: f32,
    /// Electrons more after the shot noise.
    pub charge_e: f32,
}

impl Outlier {
    /// Returns a pixel in which nothing is different.
    pub fn none(pixel: u32) -> Self {
        Self { pixel, response: 1.0, dark_e: 0.0, charge_e: 0.0 }
    }

    /// Returns both in one: responses multiply, electrons add.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self {
            pixel: self.pixel,
            response: self.response * other.response,
            dark_e: self.dark_e + other.dark_e,
            charge_e: self.charge_e + other.charge_e,
        }
    }
}

/// The outliers of a frame, sorted by pixel, one each.
#[derive(Debug, Default)]
pub struct Outliers {
    list: Vec<Outlier>,
}

impl Clone for Outliers {
    fn clone(&self) -> Self {
        Self { list: with_space(&self.list) }
    }
}

impl Outliers {
    /// Returns an empty list with capacity for so many pixels; it never grows.
    pub fn with_capacity(pixels: usize) -> Self {
        Self { list: Vec::with_capacity(pixels) }
    }

    /// Returns the capacity, pixels.
    pub fn capacity(&self) -> usize {
        self.list.capacity()
    }

    /// Returns all of them.
    pub fn list(&self) -> &[Outlier] {
        &self.list
    }

    /// Returns true if no pixel differs.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.list.clear();
    }

    /// Returns the outliers among the `pixels` pixels from `first` on.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
    pub fn within(&self, first: usize, pixels: usize) -> &[Outlier] {
        if self.list.is_empty() {
            return &[];
        }
        let start = self.list.partition_point(|outlier| (outlier.pixel as usize) < first);
        let end = self.list.partition_point(|outlier| (outlier.pixel as usize) < first + pixels);
        &self.list[start..end]
    }

    /// Replaces all by two sorted lists together and returns the number of outliers that did not fit.
    pub fn merge(&mut self, mut defects: &[Outlier], mut tracks: &[Outlier]) -> usize {
        self.list.clear();
        let mut left_out = 0;
        loop {
            let next = match (defects.first(), tracks.first()) {
                (None, None) => return left_out,
                (Some(a), Some(b)) if a.pixel == b.pixel => {
                    (defects, tracks) = (&defects[1..], &tracks[1..]);
                    a.with(*b)
                }
                (Some(a), b) if b.is_none_or(|b| a.pixel < b.pixel) => {
                    defects = &defects[1..];
                    *a
                }
                (_, Some(b)) => {
                    tracks = &tracks[1..];
                    *b
                }
                (Some(_), None) => return left_out,
            };
            if self.list.len() < self.list.capacity() { self.list.push(next) } else { left_out += 1 }
        }
    }
}

/// Returns a copy with the same capacity: a plain clone has no spare capacity.
pub fn with_space<T: Clone>(list: &Vec<T>) -> Vec<T> {
    let mut copy = Vec::with_capacity(list.capacity());
    copy.extend_from_slice(list);
    copy
}

/// Merges outliers of the same pixel in a sorted list, in place, and returns the number that is left.
pub fn fold_equal(list: &mut [Outlier]) -> usize {
    let mut kept = 0;
    for i in 0..list.len() {
        if kept > 0 && list[kept - 1].pixel == list[i].pixel {
            list[kept - 1] = list[kept - 1].with(list[i]);
        } else {
            list[kept] = list[i];
            kept += 1;
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hot(pixel: u32, dark_e: f32) -> Outlier {
        Outlier { dark_e, ..Outlier::none(pixel) }
    }

    #[test]
    fn two_lists_become_one_sorted_list() {
        let struck = |pixel| Outlier { charge_e: 7.0, ..Outlier::none(pixel) };
        let mut both = Outliers::with_capacity(8);
        assert_eq!(both.merge(&[hot(1, 2.0), hot(5, 3.0), hot(9, 4.0)], &[struck(0), struck(5), struck(12)]), 0);
        let pixels: Vec<u32> = both.list().iter().map(|o| o.pixel).collect();
        assert_eq!(pixels, [0, 1, 5, 9, 12]);
        assert_eq!(both.list()[2], Outlier { charge_e: 7.0, ..hot(5, 3.0) }, "both in one pixel");
        assert_eq!(both.within(1, 5).len(), 2, "from 1 to 5");
        assert_eq!(both.within(6, 3).len(), 0, "none from 6 to 8");
        assert_eq!(both.within(9, 1).len(), 1);
        both.clear();
        assert!(both.is_empty() && both.within(0, 100).is_empty());
    }

    #[test]
    fn outliers_that_do_not_fit_are_counted() {
        let list: Vec<Outlier> = (0..100).map(|i| hot(i, 1.0)).collect();
        let mut few = Outliers::with_capacity(10);
        let space = few.capacity();
        assert_eq!(few.merge(&list, &[]), 100 - space);
        assert_eq!(few.list().len(), space);
        assert_eq!(few.capacity(), space, "never grows");
        few.clear();
        assert!(few.clone().capacity() >= space, "copies have the capacity too");
    }

    #[test]
    fn equal_pixels_fold_into_one() {
        let dead = |response| Outlier { response, ..Outlier::none(3) };
        let mut list = [hot(1, 1.0), hot(3, 1.0), dead(0.5), dead(0.25), hot(3, 2.0)];
        assert_eq!(fold_equal(&mut list), 2);
        assert_eq!(list[1], Outlier { response: 0.125, ..hot(3, 3.0) });
        assert_eq!(fold_equal(&mut []), 0);
    }
}
