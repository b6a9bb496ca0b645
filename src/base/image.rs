//! A row-major image: the container between render, detector and sink.

/// Pixels of one frame, row 0 at the top, `data[y * width + x]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Image<T> {
    width: usize,
    height: usize,
    data: Vec<T>,
}

/// Mean electrons per pixel before the detector, single precision.
pub type ElectronImage = Image<f32>;
/// Digital numbers as the detector reads them out.
pub type DnImage = Image<u16>;

impl<T: Copy + Default> Image<T> {
    /// Returns an image of default (zero) pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, data: vec![T::default(); width * height] }
    }
}

impl<T> Image<T> {
    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns all pixels, row by row from the top.
    pub fn pixels(&self) -> &[T] {
        &self.data
    }

    /// Returns all pixels, writable.
    pub fn pixels_mut(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// Returns the rows from the top.
    pub fn rows(&self) -> impl Iterator<Item = &[T]> {
        self.data.chunks_exact(self.width.max(1))
    }
}

impl<T: Copy> Image<T> {
    /// Returns the pixel in column `x`, row `y`, or `None` outside the image.
    pub fn get(&self, x: usize, y: usize) -> Option<T> {
        if x < self.width { self.data.get(y * self.width + x).copied() } else { None }
    }
}
