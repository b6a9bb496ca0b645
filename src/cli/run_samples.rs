//! Recorded frames of a run for its report: boresight of each, and three of them as small pictures.

use crate::cli::run_finished::Finished;
use base::image::DnImage;
use base::input_file::{DATA_BYTES, InputFile};
use frames::sink::{fits::FitsImage, png::write_dn_for_people, recorder::frame_path};
use serde::Deserialize;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Longest side of a picture, px.
const SIDE_PX: usize = 200;
/// Largest picture, bytes: noise does not compress, so a larger one is shrunk further.
const MOST_PNG_BYTES: usize = 45_000;

/// A line of `frames.csv`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(super) struct Row {
    pub(super) frame: u32,
    pub(super) mid_exposure_tai_ns: i64,
    pub(super) ra_deg: Option<f64>,
    pub(super) dec_deg: Option<f64>,
    pub(super) roll_deg: Option<f64>,
    pub(super) stars: Option<u64>,
}

/// The recording of a run's first recorder.
#[derive(Debug)]
pub(super) struct Recording {
    folder: PathBuf,
    pub(super) rows: Vec<Row>,
}

/// A frame as a small picture.
#[derive(Debug)]
pub(super) struct Sample {
    pub(super) row: Row,
    pub(super) png: Vec<u8>,
    /// Columns and rows of the picture.
    pub(super) size: [usize; 2],
    /// Pixels of the frame along each side of one of the picture.
    pub(super) shrink: usize,
}

/// Returns the recording of the first sink that wrote files; `None` when none did.
pub(super) fn recording(finished: &Finished) -> Option<Recording> {
    let recorder = finished.end.sink_lines.iter().find(|line| line.kind == "recorder")?;
    let folder = PathBuf::from(recorder.output.as_ref()?);
    let mut table = csv::Reader::from_reader(InputFile::open(&folder.join("frames.csv"), DATA_BYTES).ok()?);
    // A last line that was cut is not a frame.
    let rows = table.deserialize().filter_map(Result::ok).collect();
    Some(Recording { folder, rows })
}

impl Recording {
    /// Returns the first, the middle and the last frame, those that are recorded as FITS.
    pub(super) fn samples(&self) -> Vec<Sample> {
        let Some(last) = self.rows.len().checked_sub(1) else { return Vec::new() };
        let mut places = vec![0, last / 2, last];
        places.dedup();
        places.into_iter().filter_map(|place| sample(&self.folder, &self.rows[place])).collect()
    }
}

fn sample(folder: &Path, row: &Row) -> Option<Sample> {
    let file = InputFile::open(&frame_path(folder, row.frame, "fits"), DATA_BYTES).ok()?;
    let image = FitsImage::read(BufReader::new(file)).ok()?;
    let longest = image.width.max(image.height);
    let mut shrink = longest.div_ceil(SIDE_PX).max(1);
    loop {
        let small = shrunk(&image, shrink);
        let mut png = Vec::new();
        write_dn_for_people(&mut png, &small).ok()?;
        if png.len() <= MOST_PNG_BYTES || shrink >= longest {
            return Some(Sample { row: row.clone(), png, size: [small.width(), small.height()], shrink });
        }
        shrink *= 2;
    }
}

/// Returns the image with `shrink` x `shrink` pixels as one, the brightest of them: no star is lost.
fn shrunk(image: &FitsImage, shrink: usize) -> DnImage {
    let size = [image.width.div_ceil(shrink), image.height.div_ceil(shrink)];
    let mut small = DnImage::new(size[0], size[1]);
    let pixels = image.top_row_first();
    for (place, value) in pixels.iter().enumerate() {
        let (x, y) = (place % image.width / shrink, place / image.width / shrink);
        let pixel = &mut small.pixels_mut()[y * size[0] + x];
        // A float-to-int cast saturates.
        *pixel = (*pixel).max(value.round() as u16);
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;
    use frames::sink::fits::{Header, image::OwnedPixels};

    #[test]
    fn brightest_of_each_block_is_kept_also_at_the_edge() {
        let mut pixels = vec![3_u16; 5 * 3];
        (pixels[1], pixels[14]) = (40, 70);
        let image = FitsImage { width: 5, height: 3, pixels: OwnedPixels::U16(pixels), header: Header::default() };
        let small = shrunk(&image, 2);
        assert_eq!((small.width(), small.height(), small.pixels()), (3, 2, &[40, 3, 3, 3, 3, 70][..]));
        assert_ne!(shrunk(&image, 1).pixels(), small.pixels(), "the comparison can fail");
    }
}
