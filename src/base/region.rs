//! Parts of an image that are read out: rectangles, as a camera's client gives them, and the runs of pixels that they
//! make of each row. Regions may overlap: a pixel of two is one pixel.

use crate::image::Image;
use core::ops::Range;

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
    pub fn is_within(&self, size_px: [usize; 2]) -> bool {
        let ends =
            |first: u32, count: u32, size: usize| count > 0 && u64::from(first) + u64::from(count) <= size as u64;
        ends(self.left_px, self.width_px, size_px[0]) && ends(self.top_px, self.height_px, size_px[1])
    }

    /// Returns its pixels.
    pub fn pixels(&self) -> usize {
        self.width_px as usize * self.height_px as usize
    }

    fn columns(&self) -> Range<usize> {
        self.left_px as usize..self.left_px as usize + self.width_px as usize
    }

    fn rows(&self) -> Range<usize> {
        self.top_px as usize..self.top_px as usize + self.height_px as usize
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
    pub fn of(regions: &[Region]) -> Option<Self> {
        let mut made = Self::WHOLE;
        made.list.get_mut(..regions.len())?.copy_from_slice(regions);
        made.count = regions.len();
        Some(made)
    }

    /// Returns the regions; none for the whole image.
    pub fn as_slice(&self) -> &[Region] {
        &self.list[..self.count]
    }

    /// Returns true when the whole image is read out.
    #[inline]
    pub fn is_whole(&self) -> bool {
        self.count == 0
    }

    /// Returns the same regions in pixels that are so many times smaller, of an image that begins at `first_px` of the
    /// other one's pixels.
    pub fn enlarged(&self, factor: u32, first_px: [u32; 2]) -> Self {
        let mut made = *self;
        for region in &mut made.list[..self.count] {
            *region = Region {
                left_px: first_px[0].saturating_add(region.left_px.saturating_mul(factor)),
                top_px: first_px[1].saturating_add(region.top_px.saturating_mul(factor)),
                width_px: region.width_px.saturating_mul(factor),
                height_px: region.height_px.saturating_mul(factor),
            };
        }
        made
    }

    /// Returns the pixels of a row that are read out, from left to right, as runs that do not meet; `width` is that of
    /// the image.
    pub fn runs(&self, row: usize, width: usize) -> Runs {
        let mut runs = Runs { list: [[0; 2]; REGIONS_MAX], next: 0, count: 0 };
        if self.is_whole() {
            (runs.list[0], runs.count) = ([0, width], 1);
            return runs;
        }
        for region in self.as_slice().iter().filter(|region| region.rows().contains(&row)) {
            let Range { start, end } = region.columns();
            runs.list[runs.count] = [start.min(width), end.min(width)];
            runs.count += 1;
        }
        runs.join();
        runs
    }

    /// Returns true when a rectangle of `size_px` columns and rows from column `left` and row `top` has a pixel that is
    /// read out.
    #[inline(always)]
    pub fn show(&self, left: i64, top: i64, size_px: [i64; 2]) -> bool {
        self.is_whole() || self.meet(left, top, size_px)
    }

    fn meet(&self, left: i64, top: i64, size_px: [i64; 2]) -> bool {
        let meets = |first: i64, count: i64, of: Range<usize>| first < of.end as i64 && first + count > of.start as i64;
        let meets_region =
            |region: &Region| meets(left, size_px[0], region.columns()) && meets(top, size_px[1], region.rows());
        self.as_slice().iter().any(meets_region)
    }

    /// Returns true when a pixel of these rows is read out.
    pub fn show_rows(&self, rows: &Range<usize>) -> bool {
        let meets = |of: Range<usize>| rows.start < of.end && of.start < rows.end;
        self.is_whole() || self.as_slice().iter().any(|region| meets(region.rows()))
    }

    /// Returns the sum of a number of each run of pixels over all rows of an image of so many columns and rows.
    pub fn sum_over_runs(&self, [width, height]: [usize; 2], of_run: impl Fn(Range<usize>, usize) -> usize) -> usize {
        let mut edges = [height; 2 * REGIONS_MAX + 2];
        edges[0] = 0;
        for (pair, region) in edges[1..].chunks_exact_mut(2).zip(self.as_slice()) {
            (pair[0], pair[1]) = (region.rows().start.min(height), region.rows().end.min(height));
        }
        edges.sort_unstable();
        // From edge to edge all rows are alike.
        let alike = edges.windows(2).map(|pair| pair[0]..pair[1]).filter(|rows| !rows.is_empty());
        alike
            .map(|rows| self.runs(rows.start, width).map(|run| of_run(run, rows.start)).sum::<usize>() * rows.len())
            .sum()
    }

    /// Returns the pixels that are read out, of an image of so many columns and rows.
    pub fn pixels(&self, size_px: [usize; 2]) -> usize {
        self.sum_over_runs(size_px, |run, _| run.len())
    }

    /// Returns the rows with a pixel that is read out, of an image of so many columns and rows.
    pub fn rows(&self, [width, height]: [usize; 2]) -> usize {
        let of_first = |run: Range<usize>, row: usize| {
            usize::from(self.runs(row, width).next().is_some_and(|first| first.start == run.start))
        };
        self.sum_over_runs([width, height], of_first)
    }

    /// Clears the pixels that are not read out.
    pub fn clear_outside<T: Copy + Default>(&self, image: &mut Image<T>) {
        if self.is_whole() {
            return;
        }
        let width = image.width();
        for (row, pixels) in image.pixels_mut().chunks_exact_mut(width.max(1)).enumerate() {
            let mut from = 0;
            for run in self.runs(row, width) {
                pixels[from..run.start].fill(T::default());
                from = run.end;
            }
            pixels[from..].fill(T::default());
        }
    }
}

/// The runs of pixels of one row that are read out.
#[derive(Debug, Clone)]
pub struct Runs {
    list: [[usize; 2]; REGIONS_MAX],
    next: usize,
    count: usize,
}

impl Runs {
    /// Sorts the runs, and joins those that meet.
    fn join(&mut self) {
        self.list[..self.count].sort_unstable();
        let mut kept = 0;
        for k in 0..self.count {
            let [start, end] = self.list[k];
            if start >= end {
                continue;
            }
            if kept > 0 && start <= self.list[kept - 1][1] {
                self.list[kept - 1][1] = self.list[kept - 1][1].max(end);
            } else {
                self.list[kept] = [start, end];
                kept += 1;
            }
        }
        self.count = kept;
    }
}

impl Iterator for Runs {
    type Item = Range<usize>;

    fn next(&mut self) -> Option<Range<usize>> {
        let [start, end] = *self.list[..self.count].get(self.next)?;
        self.next += 1;
        Some(start..end)
    }
}

impl core::fmt::Display for Region {
    /// Writes `left,top,width,height`.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{},{},{},{}", self.left_px, self.top_px, self.width_px, self.height_px)
    }
}

impl core::fmt::Display for Regions {
    /// Returns the regions with `+` between them; nothing for the whole image.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        for (number, region) in self.as_slice().iter().enumerate() {
            write!(f, "{}{region}", if number == 0 { "" } else { "+" })?;
        }
        Ok(())
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

    const SIZE: [usize; 2] = [20, 12];

    fn regions(of: &[[u32; 4]]) -> Regions {
        let region =
            |&[left_px, top_px, width_px, height_px]: &[u32; 4]| Region { left_px, top_px, width_px, height_px };
        Regions::of(&of.iter().map(region).collect::<Vec<_>>()).unwrap()
    }

    /// Returns whether a pixel is in one of the regions, tested pixel by pixel.
    fn is_in(of: &[[u32; 4]], x: usize, y: usize) -> bool {
        let within = |at: usize, first: u32, count: u32| (first as usize..(first + count) as usize).contains(&at);
        of.is_empty()
            || of.iter().any(|[left, top, width, height]| within(x, *left, *width) && within(y, *top, *height))
    }

    #[test]
    fn runs_are_the_pixels_of_the_regions() {
        let lists: [&[[u32; 4]]; 5] = [
            &[],
            &[[3, 2, 5, 4]],
            &[[10, 0, 4, 12], [3, 2, 5, 4], [8, 5, 2, 3]],
            &[[3, 2, 5, 4], [6, 4, 9, 3], [0, 11, 20, 1], [3, 2, 5, 4]],
            &[[15, 8, 30, 30]],
        ];
        for of in lists {
            let regions = regions(of);
            let mut image = Image::<u8>::new(SIZE[0], SIZE[1]);
            image.pixels_mut().fill(7);
            regions.clear_outside(&mut image);
            let (mut pixels, mut rows) = (0, 0);
            for y in 0..SIZE[1] {
                let runs: Vec<_> = regions.runs(y, SIZE[0]).collect();
                assert!(runs.windows(2).all(|pair| pair[0].end < pair[1].start), "{of:?}: {runs:?}");
                for x in 0..SIZE[0] {
                    let wanted = is_in(of, x, y);
                    assert_eq!(runs.iter().any(|run| run.contains(&x)), wanted, "{of:?}: {x}, {y}");
                    assert_eq!(image.get(x, y), Some(if wanted { 7 } else { 0 }), "{of:?}: {x}, {y}");
                    pixels += usize::from(wanted);
                }
                rows += usize::from(!runs.is_empty());
                assert_eq!(regions.show_rows(&(y..y + 1)), !runs.is_empty());
            }
            assert_eq!((regions.pixels(SIZE), regions.rows(SIZE)), (pixels, rows), "{of:?}");
        }
    }

    #[test]
    fn rectangles_meet_regions_or_not() {
        let one = regions(&[[10, 4, 6, 4]]);
        assert!(one.show(15, 7, [1, 1]) && one.show(-5, -5, [16, 10]) && one.show(12, 5, [100, 100]));
        assert!(!one.show(16, 7, [1, 1]) && !one.show(15, 8, [1, 1]) && !one.show(-5, -5, [15, 10]));
        assert!(Regions::WHOLE.show(500, 500, [1, 1]));
    }

    #[test]
    fn binned_pixels_are_those_of_the_sensor() {
        assert_eq!(regions(&[[1, 2, 3, 4]]).enlarged(2, [10, 20]), regions(&[[12, 24, 6, 8]]));
        assert!(Regions::WHOLE.enlarged(2, [10, 20]).is_whole());
    }

    #[test]
    fn lists_have_an_end() {
        let region = Region { left_px: 1, top_px: 2, width_px: 3, height_px: 4 };
        assert_eq!(Regions::of(&[region; REGIONS_MAX]).unwrap().as_slice().len(), REGIONS_MAX);
        assert!(Regions::of(&[region; REGIONS_MAX + 1]).is_none());
        assert!(Regions::of(&[]).unwrap().is_whole() && !Regions::of(&[region]).unwrap().is_whole());
    }
}
