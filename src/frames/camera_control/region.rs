//! Parts of an image that are read out.

/// Most regions of one image.
pub const REGIONS_MAX: usize = 32;

/// A part of an image, image pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Region {
    /// First column.
    pub left_px: u32,
    /// First row.
    pub top_px: u32,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
}

impl Region {
    /// Returns true when it has a pixel and lies within an image of so many columns and rows.
    #[must_use]
    pub fn is_within(&self, size_px: [usize; 2]) -> bool {
        let ends =
            |first: u32, count: u32, size: usize| count > 0 && u64::from(first) + u64::from(count) <= size as u64;
        ends(self.left_px, self.width_px, size_px[0]) && ends(self.top_px, self.height_px, size_px[1])
    }

    /// Returns its pixels.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width_px as usize * self.height_px as usize
    }
}

/// A list of regions, in the order in which they are sent; empty: the whole image.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Regions {
    list: [Region; REGIONS_MAX],
    count: usize,
}

impl Regions {
    /// The whole image.
    pub const WHOLE: Self =
        Self { list: [Region { left_px: 0, top_px: 0, width_px: 0, height_px: 0 }; REGIONS_MAX], count: 0 };

    /// Returns these regions; `None` when there are more than [`REGIONS_MAX`].
    #[must_use]
    pub fn of(regions: &[Region]) -> Option<Self> {
        let mut made = Self::WHOLE;
        made.list.get_mut(..regions.len())?.copy_from_slice(regions);
        made.count = regions.len();
        Some(made)
    }

    /// Returns the regions; none for the whole image.
    #[must_use]
    pub fn as_slice(&self) -> &[Region] {
        &self.list[..self.count]
    }

    /// Returns true when the whole image is read out.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.count == 0
    }
}

impl core::fmt::Debug for Regions {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_list().entries(self.as_slice()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_is_within_an_image_or_not() {
        let region = Region { left_px: 10, top_px: 4, width_px: 6, height_px: 4 };
        assert!(region.is_within([16, 8]));
        assert!(!region.is_within([15, 8]) && !region.is_within([16, 7]));
        assert!(!Region { width_px: 0, ..region }.is_within([16, 8]), "without a pixel");
        assert!(!Region { left_px: u32::MAX, ..region }.is_within([16, 8]), "no sum overflows");
        assert_eq!(region.pixels(), 24);
    }

    #[test]
    fn lists_have_an_end() {
        let region = Region { left_px: 1, top_px: 2, width_px: 3, height_px: 4 };
        assert_eq!(Regions::of(&[region; REGIONS_MAX]).unwrap().as_slice().len(), REGIONS_MAX);
        assert!(Regions::of(&[region; REGIONS_MAX + 1]).is_none());
        assert!(Regions::of(&[]).unwrap().is_whole() && !Regions::of(&[region]).unwrap().is_whole());
    }
}
