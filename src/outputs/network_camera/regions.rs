//! The regions of a camera: parts of the sensor's image that are sent, selected by number.
//!
//! The first one is always on. Several are sent as one image, one below the other in the order of their numbers: as
//! wide as the widest, narrower ones filled up with zeros at the right. They may overlap; together they have no more
//! pixels than the sensor, which is checked when an acquisition starts.

use frames::camera_control::{REGIONS_MAX, Region, Regions};

/// Every region with its place, and which are on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct RegionSet {
    list: [Region; REGIONS_MAX],
    /// One bit each.
    on: u32,
}

impl RegionSet {
    /// Returns regions that all are the whole image; the first is on.
    pub(super) fn new([width_px, height_px]: [u32; 2]) -> Self {
        Self { list: [Region { left_px: 0, top_px: 0, width_px, height_px }; REGIONS_MAX], on: 1 }
    }

    /// Returns a region; the first for a number that is none.
    pub(super) fn at(&self, number: u32) -> Region {
        self.list.get(number as usize).copied().unwrap_or(self.list[0])
    }

    /// Places a region.
    pub(super) fn place(&mut self, number: u32, region: Region) {
        if let Some(place) = self.list.get_mut(number as usize) {
            *place = region;
        }
    }

    /// Returns 1 when a region is on.
    pub(super) fn is_on(&self, number: u32) -> u32 {
        self.on.checked_shr(number).unwrap_or(0) & 1
    }

    /// Switches a region on or off; false for the first, which stays on.
    pub(super) fn switch(&mut self, number: u32, is_on: bool) -> bool {
        let bit = 1_u32.checked_shl(number).unwrap_or(0);
        self.on = if is_on { self.on | bit } else { self.on & !bit };
        let is_legal = self.on & 1 == 1;
        self.on |= 1;
        is_legal
    }

    /// Returns those that are on.
    pub(super) fn present(&self) -> Regions {
        let mut list = [Region::default(); REGIONS_MAX];
        let mut count = 0;
        for (_, region) in (0_u32..).zip(&self.list).filter(|(number, _)| self.is_on(*number) == 1) {
            (list[count], count) = (*region, count + 1);
        }
        Regions::of(&list[..count]).unwrap_or(Regions::WHOLE)
    }
}

/// Returns columns and rows of the image that these regions are sent as.
pub(super) fn stacked_px(regions: &Regions) -> [u32; 2] {
    let columns = regions.as_slice().iter().map(|region| region.width_px).max();
    [columns.unwrap_or(0), regions.as_slice().iter().map(|region| region.height_px).sum()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_that_are_on_are_sent_one_below_the_other() {
        let mut set = RegionSet::new([31, 17]);
        assert_eq!((set.present().as_slice().len(), stacked_px(&set.present())), (1, [31, 17]));
        let part = Region { left_px: 2, top_px: 3, width_px: 5, height_px: 4 };
        set.place(0, Region { width_px: 3, ..part });
        set.place(31, part);
        assert!(set.switch(31, true) && set.is_on(31) == 1);
        assert_eq!((set.present().as_slice()[1], stacked_px(&set.present())), (part, [5, 8]));
        assert!(!set.switch(0, false) && set.is_on(0) == 1, "the first stays");
        assert!(set.switch(31, false));
        assert_eq!(stacked_px(&set.present()), [3, 4]);
        set.place(32, part);
        assert_eq!((set.at(32), set.is_on(32)), (set.at(0), 0), "no such region");
    }
}
